"""Files of outlines, and which photographs of them are left out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from measurement.outline.outline import Outline, OutlineError
from softmodels.fitting.problem import FitError

Array = npt.NDArray[np.float64]


class OutlineFitError(FitError):
    """Outlines that cannot be fitted; the message is a sentence for the user."""


def read_outlines(files: Sequence[Path], untrusted: bool = False, without: Sequence[str] = ()) -> list[Outline]:
    """Read outlines' files; folders stand for all outlines in them.

    Args:
        files: Files and folders.
        untrusted: Take outlines that the measurement does not trust.
        without: Names of photographs or files to leave out.

    Raises:
        OutlineFitError: No file, one that is no outline, or one that is not trusted, unless ``untrusted`` allows it.
    """
    names: list[Path] = []
    for file in files:
        found = sorted(p for p in file.glob("*.csv") if p.name != "heights.csv") if file.is_dir() else [file]
        if not found:
            raise OutlineFitError(f"the folder {file} holds no outlines; python -m measurement photos makes them")
        names += found
    if not names:
        raise OutlineFitError("nothing to fit to; give outlines that python -m measurement photos has made")
    outlines = []
    for name in names:
        try:
            outlines.append(Outline.from_csv(name))
        except OutlineError as error:
            raise OutlineFitError(str(error)) from None
    keep = kept([(outline.source, name) for name, outline in zip(names, outlines, strict=True)], without)
    names, outlines = [names[i] for i in keep], [outlines[i] for i in keep]
    doubted = [(name, outline) for name, outline in zip(names, outlines, strict=True) if not outline.trusted]
    if doubted and not untrusted:
        name, outline = doubted[0]
        more = f", and {len(doubted) - 1} more" if len(doubted) > 1 else ""
        raise OutlineFitError(
            f"{name} is not to be trusted ({'; '.join(outline.reasons)}){more}; leave it out, or take it with --untrusted"
        )
    return outlines


def kept(rows: Sequence[tuple[str, Path | None]], without: Sequence[str]) -> list[int]:
    """Which rows, photographs with their files, are not left out by name.

    Raises:
        OutlineFitError: A name that is none of them, or nothing is left.
    """
    left = {}
    for name in without:
        found = [
            i for i, (source, file) in enumerate(rows) if name in (source, Path(source).stem, str(file), *_names(file))
        ]
        if not found:
            known = ", ".join(source for source, _ in rows)
            raise OutlineFitError(f"--without {name}: there is no such photograph; there are {known}")
        left.update(dict.fromkeys(found))
    keep = [i for i in range(len(rows)) if i not in left]
    if rows and not keep:
        raise OutlineFitError("--without leaves nothing to fit to")
    return keep


def _names(file: Path | None) -> tuple[str, ...]:
    return (file.name, file.stem) if file else ()
