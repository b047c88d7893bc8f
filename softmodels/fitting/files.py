"""The material files of a fit: what may go into a simulation has another name than what may not."""

from __future__ import annotations

import contextlib
import tomllib
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from measurement.user_file import read_text
from softmodels.fitting.fit_report import FitReport
from softmodels.fitting.fitted_law import FittedLaw
from softmodels.fitting.tables import material_toml

SOUND, UNSOUND, EARLIER = "fitted", "unsound", "earlier-"


def write_materials(report: FitReport, folder: Path, more: Mapping[str, str] = MappingProxyType({})) -> None:
    """Write each law's material file, as ``fitted.toml`` only if the chosen law is sound.

    An earlier fit's ``fitted*.toml`` that this one does not replace is renamed to ``earlier-fitted*.toml``: nobody shall take
    it for this one's. An earlier ``unsound*.toml`` is removed.

    Args:
        report: The fit.
        folder: Where to.
        more: Texts of further files by their names.
    """
    texts = {name_of(report.chosen): material_toml(report.chosen, report)}
    if len(report.laws) > 1:
        texts |= {name_of(fitted, fitted.choice.name): material_toml(fitted, report) for fitted in report.laws}
    texts |= more
    retire(folder, set(texts))
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")


def name_of(fitted: FittedLaw, law: str = "") -> str:
    """File name of a law's material; without its name, the chosen one's."""
    return f"{SOUND if fitted.sound else UNSOUND}{'-' + law if law else ''}.toml"


def retire(folder: Path, replaced: set[str] = frozenset()) -> None:  # type: ignore[assignment]
    """Take an earlier fit's material files out of the way, but for those whose names are in ``replaced``."""
    for stem in (SOUND, UNSOUND):
        for path in sorted({*folder.glob(f"{stem}.toml"), *folder.glob(f"{stem}-*.toml")}):
            if path.name in replaced or not _of_a_fit(path):
                continue
            if stem == UNSOUND:
                path.unlink()
            else:
                path.replace(path.with_name(f"{EARLIER}{path.name}"))


def _of_a_fit(path: Path) -> bool:
    """Whether a file is one that `write_materials` has written; a user's own stays."""
    with contextlib.suppress(OSError, UnicodeDecodeError, tomllib.TOMLDecodeError):
        return {"material", "fit"} <= set(tomllib.loads(read_text(path)))
    return False
