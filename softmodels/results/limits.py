"""The limit of a design: the first pressure at which it loses its stability, and where it is strained most there.

Asked of many designs at once, for a list of materials or for the scatter of a workshop, so nothing is written on the way.
"""

from __future__ import annotations

import dataclasses
import re
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from geometries import Actuator, GeometryError
from geometries.fields import about
from geometries.kinds import Length, Quantity
from measurement.units import UnitError, brief, number, quantity
from softmodels.case.case import STIFFNESS_RANGE, Case, CaseError
from softmodels.materials.laws import Material
from softmodels.mechanics.compiling import compiling
from softmodels.mechanics.loads import weighed
from softmodels.mechanics.mpi import on_root
from softmodels.mechanics.parts import Part, PartError

if TYPE_CHECKING:
    from mpi4py import MPI

    from softmodels.mechanics.solver import Solver
    from softmodels.mechanics.system import State
    from softmodels.path.continuation import Continuation
    from softmodels.path.points import Point
    from softmodels.results.fields import Fields

LONGEST_TEXT = 300
"""Characters of the longest tolerance: patterns take long over texts without end."""
LARGEST_STRETCH = 5.0
"""Stretch at which the search ends if nothing is met: silicones fail at 3 to 10, and their laws are mostly fitted to less."""


@dataclasses.dataclass(frozen=True)
class Limit:
    """How far a design can be inflated; SI units.

    Attributes:
        kind: ``"limit"`` (the pressure has a maximum, or the device another end, see ``why``), ``"bifurcation"`` (it leaves its
            shape before that), ``"none"`` (the stretch of `LARGEST_STRETCH` came first), or ``"lost"`` (the path could not be
            followed so far).
        pressure: Pressure in Pa there; for ``"none"`` at that stretch, for ``"lost"`` the last one known to be stable.
        added_volume: Volume in m3 taken by then.
        rises: Rise of the probes in m.
        stretch: Largest principal stretch.
        place: Undeformed device coordinates in m of the integration point with the largest stretch.
        why: What ended a lost path, or a limit that is no maximum of the pressure alone; else empty.
    """

    kind: str
    pressure: float
    added_volume: float
    rises: dict[str, float]
    stretch: float
    place: tuple[float, float, float]
    why: str = ""

    @property
    def found(self) -> bool:
        return self.kind in ("limit", "bifurcation")


def find_limit(case: Case, materials: Sequence[Material], comm: MPI.Comm) -> list[Limit]:
    """Limits of one device in several materials; it is meshed once.

    Args:
        case: The device, what is around it, and how its equations are solved; its load and material are not looked at.
        materials: The silicones.
        comm: MPI communicator.

    Raises:
        MeshingError, BodyError, MaterialError, ObstacleError, PartError: As for a run.
    """
    from softmodels.mechanics.body import Body
    from softmodels.mechanics.solver import Solver
    from softmodels.mechanics.system import System
    from softmodels.results.fields import Fields

    with tempfile.TemporaryDirectory() as folder:
        path = Path(comm.bcast(folder)) / "device.msh"
        on_root(comm, lambda: case.actuator.write(path))
        body = Body.from_file(case.actuator, path, comm)
        comm.barrier()
    known: dict[tuple[type[Material], int, tuple[Part, ...]], tuple[Solver, Fields]] = {}
    found = []
    try:
        for material in materials:
            own = weighed(case.parts, material)
            key = (type(material), len(getattr(material, "mu", ())), own)
            if key not in known:
                with compiling():
                    system = System(body, material, case.formulation, case.sheet, case.obstacle, own)
                    solver = Solver(system, case.solver)
                    known[key] = solver, Fields(solver)
            solver, fields = known[key]
            solver.system.set_material(material)
            found.append(_search(solver, fields))
    finally:
        for solver, _ in known.values():
            solver.release()
    return found


def _search(solver: Solver, fields: Fields) -> Limit:
    from softmodels.mechanics.newton import NoConvergence
    from softmodels.path.continuation import Continuation, trace
    from softmodels.path.points import PathEnd

    path = Continuation(solver, start=_hanging(solver))
    kind, why, last = "none", "", None
    try:
        for point in trace(path, [STIFFNESS_RANGE]):
            before, last = last, point
            if point.limit or point.bifurcation:
                kind = "limit" if point.limit else "bifurcation"
                break
            if before is not None and fields.figures(point.state).max_stretch > LARGEST_STRETCH:
                last = _stretched(path, fields, before, point)
                break
    except (PathEnd, NoConvergence) as end:
        kind, why = "lost", str(end)
        if isinstance(end, PathEnd) and end.cause:
            kind, why = "lost" if end.cause.of_mesh else "limit", end.cause.clause
    assert last is not None  # the state at rest is always there
    figures = fields.figures(last.state)
    return Limit(
        kind, figures.pressure, figures.added_volume, dict(figures.rises), figures.max_stretch,
        figures.max_stretch_at, why,
    )  # fmt: skip


def _hanging(solver: Solver) -> State | None:
    """The state in which a device hangs under its dead loads, all of which are kept; None without any.

    Raises:
        PartError: There is none.
    """
    from softmodels.path.stages import HangingEnd, hang, inflate_from

    system = solver.system
    if not system.dead.loads:
        return None
    cavities = np.zeros(len(system.body.actuator.ratios))
    try:
        hung = hang(solver, [("its dead loads", np.concatenate([cavities, system.dead.amounts / system.dead.units]))])
    except HangingEnd as end:
        raise PartError(
            f"the device does not bear {end.what} ({end}): they could be applied to {end.share:.3g} of themselves"
        ) from end
    return inflate_from(solver, hung)


def _stretched(path: Continuation, fields: Fields, before: Point, after: Point) -> Point:
    """The point between two where the largest stretch is `LARGEST_STRETCH`, to a part in a thousand or so."""
    for _ in range(2):  # each time from the end that is nearer
        low, high = (fields.figures(point.state).max_stretch for point in (before, after))
        between = path.corrector.on_the_way(before, after, (LARGEST_STRETCH - low) / (high - low))
        before, after = (
            (between, after) if fields.figures(between.state).max_stretch < LARGEST_STRETCH else (before, between)
        )
    return between


# -- the scatter of a workshop ----------------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class Tolerance:
    """A parameter or deviation of the device and how far it may be off: ``middle`` plus or minus ``half``.

    Attributes:
        name: A field of the device, or one of its `Actuator.deviations`.
        middle, half: In ``unit``.
        unit: ``"m"``, ``"degree"`` or ``""``.
        signed: Whether it may be zero or below, so that its effect is told per half width and not per percent.
    """

    name: str
    middle: float
    half: float
    unit: str = "m"
    signed: bool = False

    @classmethod
    def parse(cls, text: str, device: type[Actuator]) -> Tolerance:
        """Read ``"membrane=2mm+-0.2mm"``; also ``+/-`` and the sign itself, and ``%`` of the middle.

        Raises:
            CaseError: Not of this form, an unknown parameter, or a wrong unit.
        """
        match = len(text) < LONGEST_TEXT and re.fullmatch(r"\s*([\w-]+)\s*=\s*(.+?)\s*(?:\+/?-|±)\s*(.+?)\s*", text)
        if not match:
            raise CaseError(f"--vary {brief(text)} is not of the form membrane=2mm+-0.2mm")
        name, middle, half = match[1].replace("-", "_"), match[2], match[3]
        kinds = {name: field.kind for name, field in about(device).items()}
        known = {
            name: (kind.unit, isinstance(kind, Length) and kind.signed)
            for name, kind in kinds.items()
            if isinstance(kind, Quantity)
        }
        known |= dict.fromkeys(device.deviations, ("m", True))
        if name not in known:
            listed = ", ".join(key.replace("_", "-") for key in known)
            raise CaseError(
                f"--vary {text!r}: {device.__name__} has no parameter {match[1]!r} to vary; it has {listed}"
            )
        unit, signed = known[name]
        try:
            value = quantity(middle, unit)
            width = abs(value) * number(half[:-1]) / 100 if half.endswith("%") else quantity(half, unit)
        except UnitError as error:
            raise CaseError(f"--vary {text!r}: {error}") from None
        if not width > 0.0 or (not signed and width >= value):
            between = "above zero" if signed else "between zero and the value"
            raise CaseError(f"--vary {text!r}: the tolerance must lie {between}")
        return cls(name, value, width, unit, signed)


def samples(tolerances: Sequence[Tolerance], count: int, normal: bool = False) -> npt.NDArray[np.float64]:
    """Quasi-random values of the parameters: Halton's sequence, scrambled with a fixed seed, so that a run repeats itself.

    Args:
        tolerances: The parameters.
        count: How many devices.
        normal: Take the half width as two standard deviations of a normal scatter; else all values in it are as likely.

    Returns:
        Shape (count, parameters).
    """
    from scipy.stats import norm, qmc

    unit = qmc.Halton(len(tolerances), seed=2013).random(count)
    spread = norm.ppf(unit) / 2 if normal else 2 * unit - 1
    return np.array([t.middle for t in tolerances]) + spread * np.array([t.half for t in tolerances])


def scatter(
    case: Case, material: Material, tolerances: Sequence[Tolerance], values: npt.NDArray[np.float64], comm: MPI.Comm
) -> list[tuple[Mapping[str, float], Limit]]:
    """The limit of each sampled device, with its parameters.

    Args:
        case: See `find_limit`; the device as drawn.
        material: The silicone.
        tolerances: The parameters that are sampled.
        values: See `samples`, shape (count, parameters).
        comm: MPI communicator.

    Raises:
        CaseError: Tolerances that make no device.
    """
    found: list[tuple[Mapping[str, float], Limit]] = []
    for row in values:
        changes = {t.name: float(value) for t, value in zip(tolerances, row, strict=True)}
        try:
            device = case.actuator.made(changes)
        except GeometryError as error:
            raise CaseError(f"within the tolerances there is a device that cannot be built: {error}") from None
        found.append((changes, find_limit(dataclasses.replace(case, actuator=device), [material], comm)[0]))
    return found
