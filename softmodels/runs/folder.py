"""Where a run's results go, and whether it begins anew or goes on: all that is checked before anything is solved."""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from measurement.default_folder import numbered, take_default
from measurement.output_place import FULL
from measurement.own_files import is_same
from measurement.own_folder import OwnFolder
from measurement.user_file import file_digest, read_text
from softmodels.case.case import Case
from softmodels.case.identity import difference, identity
from softmodels.mechanics.mpi import on_root
from softmodels.results.outcomes import BAD_INPUT, FAILED, RunError
from softmodels.results.picture_files import picture_files, picture_folder
from softmodels.results.resume import check_same, check_values, drop_between
from softmodels.results.store import RUN, Results, ResultsError
from softmodels.results.writing import write_text

if TYPE_CHECKING:
    from mpi4py import MPI

MOST_GAPS = 20
"""Numbered folders that may be missing in a row where an earlier run is looked for."""


def begin(
    case: Case, output: Path | None, resume: bool, draw: bool, inputs: Sequence[Path] = ()
) -> tuple[Results, bool]:
    """Take a folder for a run and prepare it.

    Args:
        case: What is run.
        output: The folder; None for ``results/NAME``, or the next number where that holds another run.
        resume: Go on from what an interrupted run of this case has left.
        draw: Whether pictures are to be drawn there too.
        inputs: Files that the user has given, such as the case file: they are never written.

    Returns:
        The results, their folder locked; and whether there are states in it to go on from.

    Raises:
        RunError, OwnFolderError, InUseError, ResultsError, CaseError: The folder, or what is in it, cannot be used.
    """
    try:
        return _begin(case, output, resume, draw, inputs)
    except OSError as error:
        status = FAILED if error.errno in FULL else BAD_INPUT
        folder = output or Path("results") / case.name
        raise RunError(f"the folder {folder} cannot be written ({error.strerror})", status) from None


def begin_together(
    case: Case, output: Path | None, resume: bool, comm: MPI.Comm, *, draw: bool, inputs: Sequence[Path] = ()
) -> tuple[Results, bool]:
    """The same on all ranks, where rank 0 alone takes the folder and writes there; see `begin`."""
    begun: list[Results] = []

    def on_rank_0() -> tuple[Path, Path, bool]:
        results, resumed = begin(case, output, resume, draw, inputs)
        begun.append(results)
        return results.own.path, results.folder, resumed

    home, at, resumed = on_root(comm, on_rank_0)
    results = begun[0] if begun else Results(home, case.name, case.actuator.gauge)
    results.folder = at
    return results, resumed


def _begin(case: Case, output: Path | None, resume: bool, draw: bool, inputs: Sequence[Path]) -> tuple[Results, bool]:
    wanted = identity(case)
    if output is None:
        base = Path("results") / case.name
        output = _found(base, case, wanted) if resume else None
        own = take_default(base, RUN, wanted) if output is None else OwnFolder(output, RUN)
    else:
        own = OwnFolder(output, RUN)
        _check_earlier(output)
    results = Results(own.path, case.name, case.actuator.gauge)
    results.own = own
    own.take()
    try:
        if draw:
            picture_folder(own.path).check_names(picture_files(case.actuator.gauge))
        resumed = resume and _go_on(case, wanted, results)
        if not resumed:
            _begin_anew(case, wanted, results, inputs)
    except BaseException:
        own.leave()
        raise
    return results, resumed


def _found(base: Path, case: Case, wanted: Mapping[str, str]) -> Path:
    """The numbered folder that holds a run which this case can go on from.

    Raises:
        RunError: There is none, or several.
    """
    fitting, exact, gaps = [], [], 0
    for path in numbered(base):
        gaps = 0 if path.exists() else gaps + 1
        if gaps > MOST_GAPS:
            break
        old = OwnFolder(path, RUN).about.get("inputs")
        if isinstance(old, dict) and difference(old, wanted) is None:
            fitting.append(path)
            exact += [path] if old == dict(wanted) else []
    chosen = exact if len(exact) == 1 else fitting
    if len(chosen) > 1:
        raise RunError(
            f"{' and '.join(map(str, chosen))} hold runs that this case fits; say which to go on with (--output)",
            BAD_INPUT,
        )
    if not chosen:
        first = f"; {base} holds another one" if base.exists() else ""
        raise RunError(
            f"no folder {base}, {base.name}-2 and so on holds a run of this case to go on with{first}; name its folder "
            "(--output), or run without --resume",
            BAD_INPUT,
        )
    return chosen[0]


def _check_earlier(folder: Path) -> None:
    """Name the results of a version that kept no record of its files.

    Raises:
        RunError: The folder holds such results.
    """
    if OwnFolder(folder, RUN).record is not None or not (folder / "case.toml").is_file():
        return
    if (folder / "path.csv").is_file() and any(folder.glob("*.h5")):
        raise RunError(
            f"{folder} holds results of an earlier version of softmodels, which kept no record of its files: they can be drawn "
            f"(softmodels draw {folder}), but not be gone on with or replaced; take another folder (--output), or move it away",
            BAD_INPUT,
        )


def _go_on(case: Case, wanted: Mapping[str, str], results: Results) -> bool:
    """Take up the states of an earlier run; returns whether there are any.

    Raises:
        RunError, ResultsError: They are of another case, or cannot be gone on with.
    """
    folder, about = results.own.path, results.own.about
    stored = [file for file in results.own.files if file.endswith(".h5") and (folder / file).exists()]
    if not stored:
        return False
    file = folder / "case.toml"
    if not file.exists():
        raise RunError(
            f"{folder} holds states of an earlier run but no case.toml that says what they are of; put it back, or run "
            "without --resume, which replaces them",
            BAD_INPUT,
        )
    if not isinstance(about.get("inputs"), dict):
        raise ResultsError(f"{folder} does not record which case its states are of; run without --resume")
    _check_unchanged(results)
    check_same(case, Case.from_file(file), about["inputs"], wanted, folder)
    results.load(go_on=True)
    if not case.cycle:
        drop_between(case, results)
        check_values(case, results)
    text = case.to_toml()
    results.renew(text, {"inputs": dict(wanted), "case_file": _digest(text)})
    return bool(results.stored)


def _begin_anew(case: Case, wanted: Mapping[str, str], results: Results, inputs: Sequence[Path]) -> None:
    """Prepare a folder aside of the earlier results."""
    text, folder = case.to_toml(), results.own.path
    for name, file in itertools.product(results.own.files, inputs):
        # A case file that lies among its own run's results may repeat it: what is written then is what is there.
        if is_same(folder / name, file) and not (name == "case.toml" and read_text(file) == text):
            raise RunError(
                f"{file} is read, and would be replaced by the results of this run; take another folder (--output)",
                BAD_INPUT,
            )
    _check_unchanged(results)
    results.prepare({"inputs": dict(wanted), "case_file": _digest(text)})
    write_text(results.folder / "case.toml", text)


def _check_unchanged(results: Results) -> None:
    """Refuse to replace a case.toml that the user has changed since it was written.

    Raises:
        RunError: It was changed.
    """
    file, known = results.own.path / "case.toml", results.own.about.get("case_file")
    if known is not None and file.exists() and file_digest(file) != known:
        raise RunError(
            f"{file} was changed since its run wrote it; move it out of its results and run it from there, or take another "
            "folder (--output)",
            BAD_INPUT,
        )


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def mesh_is_known(results: Results, mesh: Path) -> bool:
    """Whether a mesh file is the one that the run has written: it may have been changed or damaged since."""
    known = results.own.about.get("mesh")
    return mesh.is_file() and known == file_digest(mesh)
