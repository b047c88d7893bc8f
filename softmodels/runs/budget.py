"""The budget of a run's numbers: what the half width of each one's 95 % interval is made of, and what would narrow it.

Contributions are independent, so their half widths add up as squares (GUM, JCGM 100:2008, 5.1.2): that of the silicone (the
covariance of a fit, or how far published sources lie apart), that of its law's form (`softmodels.materials.laws.form_energy`),
those of the lengths as made and of the readings at the bench (tolerances of the case), each by the exact derivative of the
state, and that of the mesh (`softmodels.runs.mesh_error`). What a model leaves out is in none of them.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from geometries import Actuator, actuator as parameters
from softmodels.case import materials, tolerances
from softmodels.case.case import Case
from softmodels.common import units
from softmodels.common.arrays import Array
from softmodels.materials import laws
from softmodels.mechanics import controls, newton
from softmodels.path import stability, steps
from softmodels.runs import columns, fields, labels, mesh_error, table

if TYPE_CHECKING:
    from softmodels.mechanics import sensitivity

MATERIAL, FORM, MESH = materials.MATERIAL, laws.FORM, "mesh"
"""Contributions beside those of a case's deviations, which have the names of what deviates."""
MOST_SHOWN = 6
"""Contributions that a line has one by one."""
WORDS = {MATERIAL: "silicone", FORM: "law's form", tolerances.COLUMN: "column's density"}
"""Contributions that are printed under another name than their own."""


@dataclasses.dataclass(frozen=True)
class Contribution:
    """A cause's half of the 95 % interval of a number in SI; ``text`` is what it is, for people."""

    name: str
    half: float
    text: str


def total(parts: Sequence[Contribution]) -> float:
    """Return half the 95 % interval of a number from its independent parts."""
    return math.hypot(*(part.half for part in parts))


def contributions(halves: Mapping[str, float], deviations: Sequence[tolerances.Deviation]) -> list[Contribution]:
    """Return half widths by cause with what they are, the largest first."""
    known = {deviation.name: deviation for deviation in deviations}
    return ranked(Contribution(cause, half, _words(cause, known.get(cause))) for cause, half in halves.items())


def ranked(parts: Iterable[Contribution]) -> list[Contribution]:
    """Return contributions, the largest first."""
    return sorted(parts, key=lambda part: -part.half)


def parts(row: table.Row, name: str, meshed: Mapping[str, float]) -> dict[str, float]:
    """Return the half widths of a variable's 95 % intervals by their cause, in SI; ``meshed`` are mesh errors by variable."""
    causes = {cause: row[table.part_of(name, cause)] for cause in causes_in(row, name)}
    if not causes:
        causes = {MATERIAL: row.get(table.band_of(name), math.nan)}
    causes[MESH] = meshed.get(name, math.nan)
    return {cause: half for cause, half in causes.items() if half > 0.0}


def causes_in(row: table.Row, name: str) -> list[str]:
    """Return the causes of which a row has a variable's half widths, beside their sum."""
    start = table.part_of(name, "")
    return [other.removeprefix(start) for other in row if other.startswith(start)]


@dataclasses.dataclass(frozen=True)
class Budget:
    """The budgets of a path's numbers, from its table, those on other meshes, and those of the silicone's other sources.

    Attributes:
        case: What was solved.
        rows, meshes, sources: The tables; no sources but where the case asks for their band.
    """

    case: Case
    rows: table.PathTable
    meshes: columns.MeshTables
    sources: columns.SourceTables

    @functools.cached_property
    def mesh(self) -> mesh_error.MeshErrors:
        """The mesh errors of the path's states."""
        return mesh_error.MeshErrors(self.case, self.rows, self.meshes)

    @property
    def stated(self) -> list[table.Row]:
        """The states whose numbers are stated: the last requested one, and limit points."""
        return [*self.rows.where("requested")[-1:], *self.rows.where("limit")]

    def headline(self, row: table.Row) -> list[str]:
        """Return the variables that a state is known by: of a limit point its pressure, else what was not requested."""
        words = labels.state_labels(self.case)
        if row.get("limit"):
            return ["pressure"] if words.pressure else []
        device = self.case.actuator
        loads = [
            name for name in labels.PRESSURE_AND_VOLUME if name != self.case.variable and not words.hides(row.column(name))
        ]
        own = (device.gauge, *device.headline, *reversed(loads), "blocked_force", "contact_force", *self.case.gauges.variables)
        return [name for name in dict.fromkeys(own) if name in row]

    def contributions(self, row: table.Row, name: str) -> list[Contribution]:
        """Return what is known of a variable's error in a state, the largest contribution first."""
        halves = parts(row, name, self.mesh.of(row))
        if spread := self._spread(row, name):
            halves[MATERIAL] = spread
        return contributions(halves, self.case.deviations)

    def _spread(self, row: table.Row, name: str) -> float:
        """Return how far the other sources of the silicone lie away at the same requested value; 0 if there are none, and of
        words and counts."""
        if not row.unit(name):
            return 0.0
        value, away = row[self.case.variable], [0.0]
        for rows in self.sources.values():
            same = rows.where(lambda other: name in other and columns.stands_at(other, self.case, value))
            away += [abs(other[name] - row[name]) for other in same[:1]] if row["requested"] else []
        return max(away)

    def lines(self) -> list[str]:
        """Return a line for each headline number whose error is known, and which causes are not in them."""
        texts = [
            f"{self._called(row, name)} {interval(row, name, told)}: {', '.join(_shares(row, name, told))}"
            for row in self.stated
            for name in self.headline(row)
            if (told := self.contributions(row, name))
        ]
        texts += self._at_equal_rise(self.rows[-1])
        return [*texts, f"not in these intervals: {missing}"] if texts and (missing := ", ".join(self._missing())) else texts

    def _at_equal_rise(self, row: table.Row) -> Iterator[str]:
        """Yield the intervals of the pressure, where that is requested: they differ at equal volume and at equal rise."""
        gauge, names = self.case.actuator.gauge, (table.band_of("pressure"), table.at_rise(self.case.actuator.gauge))
        at_volume, at_rise = (row.shown(name) if name in row else math.nan for name in names)
        if at_volume > 0.0 and self.case.variable == "pressure":
            causes = causes_in(row, "pressure") or [MATERIAL]
            rising = "" if math.isnan(at_rise) else f", +- {at_rise:.3g} cm at equal rise of the {gauge}"
            half = f"{at_volume:.3g} {self.case.column.unit}"
            yield f"pressure +- {half} at equal added volume{rising} (95 %, {', '.join(map(_name, causes))})"

    def _called(self, row: table.Row, name: str) -> str:
        device = self.case.actuator
        if row.get("limit"):
            return f"limit {columns.term(row.column(name), device).name}"
        return f"{name} rise" if name == device.gauge else columns.term(row.column(name), device).name

    def _missing(self) -> Iterator[str]:
        """Yield causes that are not in the budget, with what states them."""
        case, given = self.case, {deviation.name for deviation in self.case.deviations}
        if case.band is None:
            yield "the silicone (--band)"
        if not given - {*tolerances.READINGS}:
            yield "lengths as made ([tolerance])"
        if tolerances.GAUGE not in given and case.load.has_pressure:
            yield "the gauge ([tolerance])"
        if case.band is not None and laws.FORM_ENERGIES.keys().isdisjoint(getattr(case.band, "names", ())):
            yield "the law's form (a fit)"
        if columns.FINER not in self.meshes:
            yield "the mesh (--mesh-error)"

    def half_text(self, row: table.Row, name: str) -> str:
        """Return half the 95 % interval of a variable of a state, such as ``"+- 0.21 mm (95 %)"``, and its cause if it has only
        one; "" if nothing is known."""
        told = self.contributions(row, name)
        if not told:
            return ""
        alone = f", {told[0].text} only" if len(told) == 1 else ""
        return f"+- {rounded(row, name, total(told))[1]} {row.unit(name)}".rstrip() + f" (95 %{alone})"

    def next_step(self, row: table.Row, name: str) -> str:
        """Return which contribution to narrow first and what half of it would give, or what to state first, as a sentence; ""
        if nothing is known."""
        told = self.contributions(row, name)
        if not told:
            return ""
        first, *others = told
        if first.name == MESH and not others and (missing := ", ".join(self._missing())):
            return f"Only the mesh is known here, and mostly a small part; state the others first: {missing}."
        halved = math.hypot(0.5 * first.half, *(other.half for other in others))
        now, then = (rounded(row, name, half)[1] for half in (total(told), halved))
        cure = {
            MESH: "use smaller cells (--finer 2)",
            MATERIAL: "test this silicone, and fit it",
            FORM: "test this silicone in another way too (a pull, planar or equibiaxial tension), and fit all data together",
        }
        return (
            f"The largest contribution is {first.text}: {cure.get(first.name, f'measure the {first.name} of this device')}. "
            f"Half of it would turn +- {now} into +- {then} {row.unit(name)}."
        )

    def tables(self) -> list[dict[str, object]]:
        """Return the budgets as in ``summary.json``: a table for each stated state, by column, with the value, the half width
        and its causes, in the column's unit; empty if none is known."""
        made = []
        for row in self.stated:
            known = {name: told for name in row if (told := self.contributions(row, name))}
            figures = {
                row.column(name): {
                    "value": row.shown(name),
                    "half_width": mesh_error.in_unit(row, name, total(told)),
                    **{part.name: mesh_error.in_unit(row, name, part.half) for part in told},
                }
                for name, told in known.items()
            }
            made += [{"step": row["step"], **figures}] if figures else []
        return made


def interval(row: table.Row, name: str, told: Sequence[Contribution]) -> str:
    """Return a variable with half its 95 % interval, two digits of it."""
    return units.with_error(row.shown(name), mesh_error.in_unit(row, name, total(told)), row.unit(name)) + " (95 %)"


def rounded(row: table.Row, name: str, half: float) -> tuple[str, str]:
    """Return a variable and a half width in its unit, to two digits of the latter (GUM, 7.2.6)."""
    return units.rounded(row.shown(name), mesh_error.in_unit(row, name, half))


def _shares(row: table.Row, name: str, told: Sequence[Contribution]) -> list[str]:
    digits, others = units.decimals(mesh_error.in_unit(row, name, total(told))), told[MOST_SHOWN:]
    shown = [*told[:MOST_SHOWN], *([Contribution("", total(others), f"{len(others)} others")] if others else [])]
    return [f"{part.text} {mesh_error.in_unit(row, name, part.half):.{digits}f} {row.unit(name)}".rstrip() for part in shown]


def _words(cause: str, deviation: tolerances.Deviation | None) -> str:
    return _name(cause) if deviation is None else f"{_name(cause)} +-{deviation.text}"


def _name(cause: str) -> str:
    return WORDS.get(cause, cause.replace("_", " "))


# ----------------------------------------------------------------------------------------------------------------------
# The first-order 95 % band of a path, from the errors of a fitted material and from tolerances.
#
# A state moves with parameters and lengths by the derivatives of its equilibrium (`mechanics.sensitivity`). The width of a
# band depends on the quantity that stays fixed:
#
# - At the same pressure (or other requested value) rises and volumes have a band: the state slides along the path by
#   the change of pressure. It grows without bound near a limit point.
# - At the same added volume the pressure has a band. It stays regular at a limit point, where it is the band of the limit.
# - At the same rise the pressure has another band: the horizontal distance between the curves of rise over pressure. Pressures
#   measured at a given height compare with it. A stiffer silicone also needs another volume for the same height.


SOLVE_TOLERANCE = 1e-6
"""Tolerance of the linear solver."""
DIFFERENCE_STEP = 1e-3
"""Finite-difference step for the device's own figures, in standard deviations."""


@dataclasses.dataclass(frozen=True)
class Change:
    """A change of one standard deviation: ``by`` changes of the material's parameters or a length, times ``size``; else of the
    pressure that is read, ``reading`` in Pa."""

    cause: str
    by: sensitivity.Along | None = None
    size: float = 1.0
    reading: float = 0.0

    @property
    def length(self) -> str:
        """The length that changes; "" of the others."""
        return self.by if isinstance(self.by, str) else ""


class Band:
    """Bands of a case's states from its errors of the material and its tolerances. What is requested is kept, and rises are
    reported at the same value of it: a pressure, a volume, or the force of dead loads, such as shares of the weight. Of a
    program that is what each step prescribes, at the same time: states of silicone with a memory depend on all states before,
    and so do their derivatives (`softmodels.mechanics.sensitivity.InTime`), which its solver carries along."""

    def __init__(self, made: fields.Fields, case: Case):
        from softmodels.mechanics.sensitivity import InTime, MeshMotion, Sensitivity

        self.fields, self.cm, self.kept, self.deviations = made, case.column.pascal, case.quantity, case.deviations
        self._roots = case.band.directions if isinstance(case.band, materials.MaterialErrors) else []
        self._device: Actuator = case.actuator
        lengths = [deviation.name for deviation in self.deviations if deviation.name not in tolerances.READINGS]
        self._motion = MeshMotion(made.system.body) if lengths else None
        self._sensitivity = Sensitivity(made.solver, self._motion, SOLVE_TOLERANCE)
        self._opened = {name: self._opened_at_rest(name) for name in lengths}
        self._in_time: InTime | None = None
        self._free: list[tuple[str, bool, int, float]] = []
        if case.program:
            roots = {str(k): root for k, (_, root) in enumerate(self._roots)}
            made.solver.carried = self._in_time = InTime(self._sensitivity, roots)
            self._free = _not_prescribed(made, case)

    def release(self) -> None:
        """Release the PETSc objects."""
        if self._motion is not None:
            self._motion.release()

    def _opened_at_rest(self, name: str) -> float:
        """Return the derivative of the cavity's volume at rest by a length, dimensionless."""
        assert self._motion is not None
        w = self.fields.system.w.x.array
        kept = w.copy()
        w[:] = 0.0
        opened = self._sensitivity.motion_force(self._motion.velocity(name))[1]
        w[:] = kept
        return opened

    def cells(self, point: stability.Point) -> dict[str, float | None]:
        """Half widths of the 95 % intervals at a point of the path, by column of ``path.csv``; None if undefined.

        Called by all ranks.
        """
        try:
            if self._in_time is not None:
                rates = (self._in_time.last or {}).values()
                moves = [(cause, self._move_in_time(point, rate)) for (cause, _), rate in zip(self._roots, rates, strict=False)]
            else:
                changes = [] if point.bifurcation else list(self._changes(point))
                moves = [(change.cause, self._move(point, change)) for change in changes]
        except newton.NoConvergence:
            moves = []
        if not moves:
            return dict.fromkeys([*self._columns(), *(column for column, _, _ in self._parts())])
        at_rest = point.state.P == 0.0 and self.fields.rest_volume == abs(point.state.V)

        def half(column: str, cause: str = "") -> float | None:
            own = [move[column] for of, move in moves if not cause or of == cause]
            width = 0.0 if at_rest else units.HALF_WIDTH_95 * float(np.linalg.norm(own))
            return width if math.isfinite(width) else None

        return {
            **{column: half(column) for column in self._columns()},
            **{column: half(whole, cause) for column, whole, cause in self._parts()},
        }

    def _columns(self) -> list[str]:
        actuator = self._device
        rises = [*(_named(f"{probe}_mm") for probe in actuator.probes), *map(_named, actuator.figure_columns.values())]
        if self._in_time is not None or self.kept == stability.DeadForce.name:
            return [*(column for column, *_ in self._free), *rises]
        return ["pressure_ci95_cm", f"{table.at_rise(actuator.gauge)}_cm", "added_volume_ci95_ml", *rises]

    def _parts(self) -> list[tuple[str, str, str]]:
        """Return the columns of each cause's share in the main bands, with the band's column and the cause; none where only the
        material has errors."""
        causes = [*dict.fromkeys(cause for cause, _ in self._roots), *(deviation.name for deviation in self.deviations)]
        if causes in ([], [MATERIAL]):
            return []
        main = {table.band_of(name) for name in ("pressure", "added_volume", self._device.gauge, *self._device.headline)}
        return [
            (f"{name}_{cause}_{column.removeprefix(f'{name}_')}", column, cause)
            for column in self._columns()
            if (name := table.split(column)[0]) in main
            for cause in causes
        ]

    def _changes(self, point: stability.Point) -> Iterator[Change]:
        """Yield independent changes of one standard deviation each, at a point."""
        yield from (Change(cause, root) for cause, root in self._roots)
        pressure = point.state.P * self.fields.system.stress_unit
        for deviation in self.deviations:
            if deviation.name in tolerances.READINGS:
                yield Change(deviation.name, reading=deviation.of_pressure(pressure) / units.HALF_WIDTH_95)
            else:
                yield Change(deviation.name, deviation.name, deviation.half / units.HALF_WIDTH_95)

    def _move(self, point: stability.Point, change: Change) -> dict[str, float]:
        """Return the changes by column."""
        eq, state, length = self.fields.system, point.state, change.length
        w, dP, dV = np.zeros_like(point.tangent.w), change.reading, 0.0
        if change.by is not None:
            eq.load(state)
            line = controls.volume_control(state.V)
            rate = self._sensitivity.rate(state, line, change.by, line.volume_coefficient * self._opened.get(length, 0.0))
            w, dP = change.size * rate.w, change.size * rate.P
        forced, sideways = self.kept == stability.DeadForce.name, dP - self._slope(point) * self._gauge_rise(w)
        if self.kept != stability.AddedVolume.name:
            slide = -dP / (eq.stress_unit * point.tangent.P) if point.tangent.P else math.inf
            w = w + slide * point.tangent.w
            dV = slide * point.tangent.V * eq.volume_unit
        rises = self._rises(state.w, w, length, change.size)
        if forced:
            return rises
        pressures = {"pressure_ci95_cm": dP / self.cm, f"{table.at_rise(self._device.gauge)}_cm": sideways / self.cm}
        return {**pressures, "added_volume_ci95_ml": 1e6 * dV, **rises}

    def _move_in_time(self, point: stability.Point, rate: sensitivity.Rate) -> dict[str, float]:
        """Return the changes by column with a derivative of the state under the program."""
        eq, state, ends = self.fields.system, point.state, []
        for sign in (1.0, -1.0):
            eq.load(dataclasses.replace(state, w=state.w + sign * DIFFERENCE_STEP * rate.w))
            ends.append(eq.driven())
        eq.load(state)
        moved = (ends[0] - ends[1]) / (2 * DIFFERENCE_STEP)
        pressures = eq.coupling.shares * rate.P / eq.stress_unit + eq.coupling.constraints.T @ rate.w[eq.dofs :]
        free = {column: scale * float((pressures if held else moved)[k]) for column, held, k, scale in self._free}
        return {**free, **self._rises(state.w, rate.w)}

    def _slope(self, point: stability.Point) -> float:
        """Return the pressure in Pa by which the pressure rises along the path for each m of the gauge's rise."""
        rise = self._gauge_rise(point.tangent.w)
        return point.tangent.P * self.fields.system.stress_unit / rise if rise else math.inf

    def _gauge_rise(self, change: Array) -> float:
        """Return the gauge's rise in m for a change of the dofs."""
        return float(self.fields.probes_moved(change)[self._device.gauge] @ np.asarray(self._device.lift))

    def _rises(self, w: Array, moved: Array, length: str = "", size: float = 0.0) -> dict[str, float]:
        """Return the changes of the probes' rises in mm and of the device's own figures for a change of the dofs, and of a
        ``length`` by ``size`` in m."""
        made, actuator = self.fields, self._device
        shifts = made.probes_moved(moved)
        rises = {_named(f"{name}_mm"): 1e3 * float(shift @ np.asarray(actuator.lift)) for name, shift in shifts.items()}
        if not all(np.isfinite(shift).all() for shift in shifts.values()):
            return rises | {_named(name): math.inf for name in actuator.figure_columns.values()}
        now = made.probes_moved(w)
        ends = []
        for sign in (1.0, -1.0) if actuator.figure_columns else ():
            step, device = sign * DIFFERENCE_STEP, actuator
            if length:
                value = parameters.parameter(actuator, length) + step * size
                device = parameters.changed(actuator, {length: value})
            places = {name: np.asarray(device.probes[name]) + now[name] + step * shifts[name] for name in shifts}
            ends.append(fields.device_columns(device, {name: (p[0], p[1], p[2]) for name, p in places.items()}))
        figures = ends[0] if ends else {}
        return rises | {_named(name): (figures[name] - ends[1][name]) / (2 * DIFFERENCE_STEP) for name in figures}


def _not_prescribed(made: fields.Fields, case: Case) -> list[tuple[str, bool, int, float]]:
    """Return of each driver of a program what it does not prescribe: the column of its band, whether that is a pressure or a
    force, because what it works on is held, the driver's place, and how many of the column's units a dimensionless one is."""
    eq, courses = made.system, steps.courses(case.steps)
    driven, held = {course.of for course in courses}, {course.of for course in courses if course.held}
    count, free = len(case.actuator.ratios), []
    for k in range(count):
        number = f"_{k + 1}" if count > 1 else ""
        if f"cavity{k + 1}" in held:
            free.append((_named(f"pressure{number}_cm"), True, k, eq.stress_unit / case.column.pascal))
        else:
            free.append((_named(f"added_volume{number}_ml"), False, k, 1e6 * eq.volume_unit))
    for k, part in enumerate(eq.dead.loads):
        magnitude, moved, _ = part.named_columns
        if part.key in held:
            free.append((_named(magnitude), True, count + k, float(eq.dead.units[k]) / part.column_unit))
        elif part.key in driven:
            free.append((_named(moved), False, count + k, float(eq.dead.moved_units[k]) / part.moved_column_unit))
    return free


def _named(column: str) -> str:
    """Return the column of another column's band: ``apex_ci95_mm`` of ``apex_mm``."""
    name = table.split(column)[0]
    return f"{table.band_of(name)}{column.removeprefix(name)}"
