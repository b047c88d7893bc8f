"""The call of a notebook for a deck: a case written for CalculiX or FEBio."""

from __future__ import annotations

import tempfile
from pathlib import Path

from softmodels.case.case import Case, CaseError
from softmodels.case.decks.calculix import calculix
from softmodels.case.decks.deck import WRITTEN, Deck, Forces, acting, check, deck_of
from softmodels.case.decks.febio import check_without_loads, febio

WRITERS = {".inp": (check, calculix), ".feb": (check_without_loads, febio)}
"""By the ending of a deck's file: what refuses a case before it is meshed, and what writes it."""


def export(case: Case | str | Path, file: str | Path) -> Deck:
    """Write a case for another program: the same mesh, silicones, supports, dead loads and pressures.

    Args:
        case: The case, or its file.
        file: Where to: ``.inp`` for CalculiX, ``.feb`` for FEBio. An earlier deck is replaced, any other file is not.

    Returns:
        What was written.

    Raises:
        CaseError: A case that decks have no words for, another ending, or a file that is no deck.
        MeshingError: The device cannot be meshed.
        PartError, BodyError, CompilingError: Dead loads that are not on its mesh, or whose equations cannot be made.
        OSError: The file cannot be written.
    """
    whole, path = case if isinstance(case, Case) else Case.from_file(Path(case)), Path(file)
    suffix = path.suffix.lower()
    if suffix not in WRITERS:
        raise CaseError(
            f"{path} ends in {path.suffix or 'nothing'}; decks are {' for CalculiX and '.join(WRITERS)} for FEBio"
        )
    if path.exists() and WRITTEN.encode() not in path.read_bytes()[:500]:
        raise CaseError(f"{path} is there already and is no deck of this program; give another name")
    refuse, writer = WRITERS[suffix]
    refuse(whole)
    with tempfile.TemporaryDirectory() as folder:
        mesh = whole.actuator.write(Path(folder) / "device.msh")
        deck = deck_of(whole, mesh, _forces(whole, mesh))
    text = writer(deck)
    partial = path.with_name(f".{path.name}.part")
    partial.write_text(text, encoding="utf-8")
    partial.replace(path)
    return deck


def _forces(case: Case, mesh: Path) -> Forces | None:
    """Of the dead loads on the mesh's nodes; None where there are none.

    Raises:
        PartError: They are not on this mesh.
        BodyError, CompilingError: The equations cannot be made.
    """
    if not acting(case):
        return None
    from softmodels.mechanics.mpi import start

    start()
    from mpi4py import MPI

    from softmodels.mechanics.body import Body
    from softmodels.mechanics.compiling import compiling
    from softmodels.mechanics.nodal_forces import nodal_forces
    from softmodels.mechanics.system import System

    with compiling():
        body = Body.from_file(case.actuator, mesh, MPI.COMM_SELF)
        return nodal_forces(System(body, case.material, "displacement", parts=case.parts))
