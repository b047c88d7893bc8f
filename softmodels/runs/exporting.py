"""The call of a notebook for a deck: a case written for CalculiX or FEBio."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from measurement.arguments import checked, place
from measurement.user_file import GEOMETRY, read_file
from softmodels.case.case import Case, CaseError
from softmodels.case.decks.calculix import calculix
from softmodels.case.decks.deck import WRITTEN, Deck, check, deck_of, needs_equations
from softmodels.case.decks.febio import check_without_springs, febio
from softmodels.case.parts_entry import without_walls

if TYPE_CHECKING:
    from softmodels.mechanics.system import System

WRITERS = {".inp": (check, calculix), ".feb": (check_without_springs, febio)}
"""By the ending of a deck's file: what refuses a case before it is meshed, and what writes it."""


@checked
def export(case: Case | str | Path, file: str | Path) -> Deck:
    """Write a case for another program: the same mesh, silicones, supports, rigid parts, contact, dead loads and pressures.

    Args:
        case: The case, or its file.
        file: Where to: ``.inp`` for CalculiX, ``.feb`` for FEBio. An earlier deck is replaced, any other file is not.

    Returns:
        What was written.

    Raises:
        CaseError: A case that decks have no words for, another ending, or a file that is no deck.
        MeshingError: The device cannot be meshed.
        PartError, ObstacleError, BodyError, CompilingError: What is added to the device cannot be on its mesh, or its
            equations cannot be made.
        OSError: The file cannot be written.
    """
    whole = case if isinstance(case, Case) else Case.from_file(place("case", case, "a case file, or a Case"))
    path = place("file", file, "a file")
    suffix = path.suffix.lower()
    if suffix not in WRITERS:
        raise CaseError(
            f"{path} ends in {path.suffix or 'nothing'}; decks are {' for CalculiX and '.join(WRITERS)} for FEBio"
        )
    if path.exists() and WRITTEN.encode() not in read_file(path, GEOMETRY)[:500]:
        raise CaseError(f"{path} is there already and is no deck of this program; give another name")
    refuse, writer = WRITERS[suffix]
    refuse(whole)
    with tempfile.TemporaryDirectory() as folder:
        mesh = whole.actuator.write(Path(folder) / "device.msh")
        deck = deck_of(whole, mesh, _system(whole, mesh))
    text = writer(deck)
    partial = path.with_name(f".{path.name}.part")
    partial.write_text(text, encoding="utf-8")
    partial.replace(path)
    return deck


def _system(case: Case, mesh: Path) -> System | None:
    """The equations of a device with displacements alone; None where its deck needs none.

    Raises:
        PartError, ObstacleError: What is added to it cannot be on this mesh.
        BodyError, CompilingError: The equations cannot be made.
    """
    if not needs_equations(case):
        return None
    from softmodels.mechanics.mpi import start

    start()
    from mpi4py import MPI

    from softmodels.mechanics.body import Body
    from softmodels.mechanics.compiling import compiling
    from softmodels.mechanics.system import System

    with compiling():
        body = Body.from_file(case.actuator, mesh, MPI.COMM_SELF)
        return System(body, case.material, "displacement", obstacle=case.obstacle, parts=without_walls(case.parts))
