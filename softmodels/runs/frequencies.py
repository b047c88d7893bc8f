"""Natural frequencies of a device along its path: at rest, and at every state up to the requested pressures or volumes."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.common.arrays import Array
from softmodels.common.names import read_only
from softmodels.materials.silicones import sheet_of
from softmodels.mechanics.mpi import on_root
from softmodels.runs.grid import Cells
from softmodels.runs.model import AtRest, Equilibrium, Mode, Model, meshed
from softmodels.runs.notes import unseen
from softmodels.runs.outcomes import Ended, RunError

if TYPE_CHECKING:
    from mpi4py import MPI

MOST_MODES = 20
"""Largest number of modes: of higher ones the mesh decides."""


@dataclasses.dataclass(frozen=True, eq=False)
class NaturalFrequencies:
    """Natural frequencies along a path, SI units; arrays are read-only.

    Attributes:
        pressure: In Pa, shape (states,).
        added_volume: In m3, shape (states,).
        frequency: In Hz, lowest first, nan of unstable modes, shape (states, count).
        requested: Whether a state was asked for, and not only passed, shape (states,).
        modes: The modes of each state.
        points: Undeformed nodes in device coordinates, m, shape (n, 3).
        displacement: Of each state, m, shape (states, n, 3).
        cells: Node numbers in VTK's order.
        cell_name: XDMF's name of the cells.
        notes: Assumptions and limits of these numbers, sentences.
        ended: Why the path ended before the last requested value; its status is 0 if it did not.
    """

    pressure: Array
    added_volume: Array
    frequency: Array
    requested: Array
    modes: tuple[tuple[Mode, ...], ...]
    points: Array
    displacement: Array
    cells: Cells
    cell_name: str
    notes: tuple[str, ...]
    ended: Ended

    @property
    def unstable(self) -> list[str]:
        """A sentence on each run of states that are not stable."""
        found, bad = [], [sum(not mode.stable for mode in modes) for modes in self.modes]
        for state, count in enumerate(bad):
            if count and not (state and bad[state - 1]):
                rate = max(mode.rate for mode in self.modes[state] if not mode.stable)
                found.append(
                    f"unstable at {self.pressure[state]:.4g} Pa and {self.added_volume[state] * 1e6:.4g} ml: {count} of the "
                    f"modes have no frequency, and the fastest grows by a factor of e in {1 / rate:.2g} s"
                )
        return found


def case_for_modes(case: Case, pressures_cm: Sequence[float] = ()) -> Case:
    """Return a case with only its pressures or added volumes as a load; at rest, or under its dead loads, if it has none.

    Args:
        case: The case.
        pressures_cm: Pressures in cm of the column, instead of its load.

    Raises:
        CaseError: It has another load.
    """
    load = {
        "pressures_cm": tuple(pressures_cm) or case.pressures_cm,
        "volumes_ml": () if pressures_cm else case.volumes_ml,
    }
    if case.values and not any(load.values()):
        raise CaseError(
            "frequencies are found at rest, or at rising pressures or added volumes, and not along a program, strokes or "
            "forces; give the pressures (--pressure-cm)"
        )
    values = {field.name: getattr(case, field.name) for field in dataclasses.fields(case)} | load
    others = {"strokes_ml": (), "supply": None, "program": (), "driven": None, "load_unload": False, "band": None}
    return (Case if any(load.values()) else AtRest)(**{**values, **others})


def find_frequencies(case: Case, count: int, sealed: bool, comm: MPI.Comm) -> NaturalFrequencies:
    """Find the natural frequencies at every state of a case's path; all ranks call it.

    Args:
        case: The device and its pressures or added volumes; see `case_for_modes`.
        count: Number of modes.
        sealed: See `Model.modes`.
        comm: MPI communicator.

    Raises:
        CaseError, MeshingError, RunError: As for a run, and as `Model.modes`.
    """
    model, ended, states = Model.of(case, meshed(case.actuator, comm)), Ended(), list[Equilibrium]()
    try:
        try:
            path = model.followed(case, case.quantity) if case.values else [model.solve()]
            for state in path:
                states.append(state)  # modes change the loaded state, so the path is followed first
        except RunError as error:
            if not states:
                raise
            ended = Ended.by(error)
        modes = tuple(tuple(model.modes(state, count, sealed=sealed)[:count]) for state in states)
        grid, shape = model.fields.grid, model.fields.shape
        shapes = [shape(state.state.w) for state in states]
        points, cells, moved = on_root(comm, lambda: (grid.points, grid.cells, np.array(shapes)))
        return NaturalFrequencies(
            read_only(np.array([state.pressure for state in states])),
            read_only(np.array([state.volume for state in states])),
            read_only(np.array([[mode.frequency for mode in these] for these in modes])),
            read_only(np.array([state.requested or state.point is None for state in states])),
            modes,
            read_only(points),
            read_only(moved),
            cells,
            grid.cell_name,
            tuple(_notes(case, modes[0][0].density, sealed)),
            ended,
        )
    finally:
        model.release()


def _notes(case: Case, density: float, sealed: bool) -> list[str]:
    sheet = sheet_of(case.material.relaxed)
    source = " by its data sheet" if sheet and sheet.density == density else ""
    texts = [f"the silicone has {density:g} kg/m^3{source}, and no damping"]
    if sealed:
        texts.append(
            "the cavities are sealed, with air that keeps its temperature; adiabatic air is 1.4 times as stiff"
        )
    if case.remembers:
        texts.append(
            "the silicone has a memory, and these are the frequencies of the relaxed one: vibrations that are quicker than it "
            "relaxes meet a stiffer silicone"
        )
    return [*texts, *filter(None, [unseen(case.actuator)])]
