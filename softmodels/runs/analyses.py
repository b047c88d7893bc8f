"""Limit pressure of a design and its scatter; natural frequencies along a path."""

from __future__ import annotations

import dataclasses
import functools
import math
import re
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from geometries import Actuator, GeometryError, registry
from softmodels.case import load, materials, tolerances
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.case.materials import MaterialErrors
from softmodels.common import cards, errors, processes, schema, units
from softmodels.common.arrays import Array
from softmodels.common.lazy import MPI, scipy
from softmodels.common.names import read_only
from softmodels.components import loads
from softmodels.materials import silicones, specimens
from softmodels.materials.laws import Material
from softmodels.mechanics import controls, mpi, newton, regions
from softmodels.mechanics.body import Body
from softmodels.path import continuation, schedule, stability, supply
from softmodels.path.continuation import Continuation, LoadedState
from softmodels.path.steps import PRESSURE, VOLUME, Prescribed, Step, Steps
from softmodels.runs import budget, grid, mesh_error, notes, outcomes, simulation, table
from softmodels.runs.fields import Fields
from softmodels.runs.outcomes import RunError
from softmodels.runs.simulation import Equilibrium, Mode, Model

# ----------------------------------------------------------------------------------------------------------------------
# The limit of a design: the first pressure at which it loses stability, and the place of the largest stretch there.
#
# It is computed for many designs at once (several materials, fabrication tolerances), so no states are written.


LONGEST_TEXT = 300
"""Maximum number of characters of a tolerance: patterns are slow on very long texts."""
MAX_VACUUM_SHARE = 0.999
"""Share of ambient pressure at which the search ends below it."""
MAX_STRETCH = 5.0
"""Stretch at which the search ends if it finds no limit: silicones fail at 3 to 10, and laws are mostly fitted to less."""

END_TEXTS = {
    "limit": "limit point", "bifurcation": "bifurcation", "none": "no limit up to this stretch",
    "lost": "path lost", "stopped": "stopped by the user",
}  # fmt: skip
"""How a path ends, in words."""


@dataclasses.dataclass(frozen=True, repr=False)
class Limit(cards.ResultCard):
    """Inflation limits of a design; SI units.

    Attributes:
        kind: ``"limit"`` (the pressure has a maximum, or the device another end, see ``why``), ``"bifurcation"`` (it leaves its
            shape before that), ``"none"`` (the stretch of `MAX_STRETCH` came first), or ``"lost"`` (the path could not be
            followed so far).
        pressure: Pressure in Pa there, below 0 of a vacuum; for ``"none"`` at that stretch or at nearly absolute vacuum, for
            ``"lost"`` the last one known to be stable.
        added_volume: Volume in m3 taken by then.
        rises: Rise of the probes in m.
        stretch: Largest principal stretch.
        place: Undeformed device coordinates in m of the integration point with the largest stretch.
        why: What ended a lost path, or a limit that is not a maximum of only the pressure; else empty.
        held: Hold time in s that the device withstands; 0: unlimited.
        errors: Contributions to the pressure's error in Pa, the largest first; empty if unknown.
        path: Added volume in m3 and pressure in Pa of each state up to there; empty if they were not kept.
        notes: Warnings about the mesh, sentences.
    """

    kind: str
    pressure: float
    added_volume: float
    rises: dict[str, float]
    stretch: float
    place: tuple[float, float, float]
    why: str = ""
    held: float = 0.0
    errors: tuple[budget.Contribution, ...] = dataclasses.field(default=(), compare=False)
    path: tuple[tuple[float, float], ...] = dataclasses.field(default=(), compare=False)
    notes: tuple[str, ...] = ()

    @property
    def exists(self) -> bool:
        return self.kind in ("limit", "bifurcation")

    @property
    def mesh_error(self) -> float:
        """Half width in Pa of the pressure's 95 % interval due to the mesh; NaN if unknown."""
        return next((part.half for part in self.errors if part.name == budget.MESH), math.nan)

    @property
    def half_width(self) -> float:
        """Half width in Pa of the pressure's 95 % interval; NaN if unknown."""
        return budget.total(self.errors) if self.errors else math.nan

    def _line(self) -> str:
        return f"at {self.pressure / 1e3:.4g} kPa: {END_TEXTS[self.kind]}, largest stretch {self.stretch:.4g}"

    def _figures(self) -> cards.Table:
        place = ", ".join(f"{axis} = {1e3 * x:.3g}" for axis, x in zip("xyz", self.place, strict=True))
        return [
            ("end", END_TEXTS[self.kind]),
            ("pressure", f"{self.pressure / 1e3:.4g} kPa"),
            *([("half its 95 % interval", f"{self.half_width:.2g} Pa")] if self.errors else []),
            *((f"of that {part.text}", f"{part.half:.2g} Pa") for part in self.errors),
            *([("held for", f"{self.held:.4g} s")] if self.held else []),
            ("added volume", f"{self.added_volume * 1e6:.4g} ml"),
            *((f"rise of the {name}", f"{rise * 1e3:.4g} mm") for name, rise in self.rises.items()),
            ("largest stretch", f"{self.stretch:.4g}"),
            ("its place, undeformed", f"{place} mm"),
        ]

    def _remarks(self) -> list[str]:
        return [*([self.why] if self.why else []), *self.notes]


def find_limit(
    case: Case, materials: Sequence[Material], comm: MPI.Comm, hold: float = 0.0, fitted: Sequence[MaterialErrors] = ()
) -> list[Limit]:
    """Find the limits of one device in several materials, on one mesh, and once more on a finer one where the case asks for the
    mesh error; its load and material are not looked at. ``hold`` is the hold time in s that silicones with a memory must
    survive at constant pressure; 0: unlimited. ``fitted`` has the errors of some of the materials, beside the case's.
    CaseError, MeshingError, RunError, MaterialError and ComponentError as for a run."""
    _check_accuracy(case)
    known = [*fitted, *([case.band] if isinstance(case.band, MaterialErrors) else [])]
    limits = _limits(case, simulation.meshed(case.actuator, comm), materials, hold, known)
    if not case.mesh_error:
        return limits
    finer = mesh_error.FINER[case.actuator.dimension]
    others = _limits(case, simulation.meshed(case.actuator.refined(finer), comm), materials, hold)
    return [_with_mesh_error(limit, other, finer) for limit, other in zip(limits, others, strict=True)]


def _check_accuracy(case: Case) -> None:
    if case.accuracy:
        raise CaseError(
            "--accuracy chooses the cells of a run only; leave it out, and use --mesh-error with smaller cells (--finer 2)"
        )


def _with_mesh_error(limit: Limit, other: Limit, finer: float) -> Limit:
    if limit.kind != other.kind:
        text = f"with cells {finer:g} times smaller the path ends otherwise ({END_TEXTS[other.kind]}); use smaller cells"
        return dataclasses.replace(limit, notes=(*limit.notes, text))
    half = mesh_error.half_width(limit.pressure, other.pressure, finer)
    text = f"the mesh error of the pressure is {half / abs(limit.pressure):.1%}; use smaller cells (--finer 2)"
    doubts = (errors.spoken(text),) if half > mesh_error.LARGE_ERROR * abs(limit.pressure) else ()
    parts = budget.ranked([*limit.errors, budget.Contribution(budget.MESH, half, budget.MESH)])
    return dataclasses.replace(limit, errors=tuple(parts), notes=(*limit.notes, *doubts))


def _limits(
    case: Case, body: Body, materials: Sequence[Material], hold: float, fitted: Sequence[MaterialErrors] = ()
) -> list[Limit]:
    """Return the limits on one mesh, with the errors of those materials of which they are known."""
    limits, known = [], dict[object, Model]()
    try:
        for material in materials:
            own = loads.weighed(case.components, material)
            key = (type(material), len(getattr(material, "mu", ())), own)
            if key not in known:
                known[key] = Model.of(case, body, material, own)
            known[key].system.set_material(material.relaxed)
            band = next((own for own in fitted if own.around in (None, material)), None)
            erring = dataclasses.replace(case, material=material, band=band)
            limit = _search(known[key], erring=erring)
            if hold and material.memory is not None and limit.kind == "limit" and not limit.why:
                limit = _held(erring, body, limit, hold)
            limits.append(dataclasses.replace(limit, notes=tuple(known[key].notes)))
    finally:
        for model in known.values():
            model.release()
    return limits


def check_hold(hold: object, materials: Sequence[Material]) -> float:
    """Return a hold time in s at constant pressure; `CaseError` for no such time, or a silicone that does not creep."""
    try:
        seconds = schema.Quantity("s").settled("hold", hold)
    except errors.FieldError as error:
        raise CaseError(str(error)) from None
    if seconds < 0.0:
        raise CaseError(f"hold is {seconds:g} s; it must be 0 or more")
    if seconds and (elastic := next((material for material in materials if material.memory is None), None)):
        raise CaseError(
            f"hold is {seconds:g} s, but {elastic.title or elastic.name} has no memory: what it withstands at "
            "once it withstands for any time; give it one ([material.memory], with_memory), or leave out the hold"
        )
    return seconds


HOLD_TOLERANCE = 1e-3
"""Relative error of a pressure that a device withstands for a time."""


def _held(case: Case, body: Body, relaxed: Limit, hold: float) -> Limit:
    """Return the largest pressure that is applied at once and withstood for a time, by bisection between the limits of the
    relaxed silicone and of one that does not creep at all."""
    parts, times = loads.weighed(case.components, case.material), (Step((Prescribed(PRESSURE, (100.0,)),), hold),)
    model = Model.of(dataclasses.replace(case, components=parts, steps=times, band=None, tolerance=None), body)

    def held(pressure: float) -> stability.Point:
        applied = tuple(
            Prescribed(PRESSURE, (pressure * ratio,), f"cavity{i}") for i, ratio in enumerate(case.actuator.ratios, 1)
        )
        model.system.potential.commit(rest.w, reset=True)
        *_, (_, last) = schedule.follow(model.solver, (Step(applied, 0.0), Step(applied, hold)), preload=preload)
        return last

    try:
        rest, preload = model.system.rest(), model.preload()
        best, low, high = relaxed, relaxed.pressure, _search(model, preload).pressure
        while high > low * (1 + HOLD_TOLERANCE):
            tried = (low * high) ** 0.5
            try:
                last = held(tried)
            except stability.PathEnd as end:
                if not isinstance(end, schedule.LostInTime):
                    raise RunError(f"{case.column.full(tried)} could not be followed for {hold:g} s: {end}") from end
                high = tried
                continue
            low, best = tried, _limit_of(model.fields, last, "limit")
        dead = all(isinstance(part, controls.LoadPart | loads.Mass) for part in parts)
        halves = _halves_held(case, model, low, functools.partial(held, low)) if dead else {}
        # As shares, those by lengths are as those of the relaxed limit, exactly so of a thin sphere.
        lengths = {part.name: part.half * low / relaxed.pressure for part in relaxed.errors if part.name not in halves}
        errors = budget.contributions(lengths | halves, case.deviations) if halves else ()
        return dataclasses.replace(best, pressure=low, held=hold, errors=tuple(errors))
    finally:
        model.release()


def _halves_held(case: Case, model: Model, pressure: float, held: Callable[[], object]) -> dict[str, float]:
    """Return half widths in Pa by cause of a pressure that the device withstands for a time, of the material and of readings.

    Where the device is lost, its derivatives by the material and by the pressure grow without bound in one direction, and
    their ratio is the derivative of the pressure that it withstands so long. That by the pressure is the one by all moduli and
    all dead loads, except for the sign: only the silicone resists, so a state stays if all of these change by one factor.
    """
    from softmodels.mechanics import sensitivity

    halves = {own.name: own.of_pressure(pressure) for own in case.deviations if own.name in tolerances.READINGS}
    if not isinstance(case.band, MaterialErrors):
        return halves
    law = case.material
    moduli = {name: value for name, value in law.parameters.items() if law.parameter_unit(name) == "Pa"}
    if law.memory is not None and law.memory.softening is not None:
        moduli[specimens.SOFTENING[1]] = law.memory.softening.m
    roots = {str(k): root for k, (_, root) in enumerate(case.band.directions)}
    known = sensitivity.Sensitivity(model.solver, aside=budget.SOLVE_TOLERANCE)
    dead = [part for part in model.components if isinstance(part, controls.LoadPart)]
    factors = {f"{part.key}.{number}": part.number(number) for part in dead for number in part.variable}
    along: dict[str, sensitivity.Along] = {**roots, "all moduli": tuple(moduli.items()), **{name: name for name in factors}}
    model.solver.carried = in_time = sensitivity.InTime(known, along)
    held()
    model.solver.carried = None
    if not in_time.last:
        return {}
    by_all = in_time.last["all moduli"].V + sum(value * in_time.last[name].V for name, value in factors.items())
    for (cause, _), name in zip(case.band.directions, roots, strict=True):
        move = units.HALF_WIDTH_95 * pressure * in_time.last[name].V / by_all
        halves[cause] = math.hypot(halves.get(cause, 0.0), move)
    return halves


def _search(model: Model, preload: LoadedState | None = None, erring: Case | None = None) -> Limit:
    """Return the first limit of a device; ``preload``: its `Model.preload`, where it is known. ``erring`` has the errors of its
    material and its tolerances."""
    path, fields = model.continuation(preload=preload), model.fields
    kind, why, last, passed = "none", "", None, list[tuple[float, float]]()
    try:
        vacuum = MAX_VACUUM_SHARE * supply.AMBIENT_PRESSURE / model.system.stress_unit
        goal = load.STIFFNESS_RANGE if model.system.direction > 0 else vacuum
        for point in continuation.trace(path, [goal]):
            before, last = last, point
            passed.append(_volume_and_pressure(fields, point))
            if point.limit or point.bifurcation:
                kind = "limit" if point.limit else "bifurcation"
                break
            if before is not None and fields.figures(point.state).max_stretch > MAX_STRETCH:
                last = _stretched(path, fields, before, point)
                passed[-1] = _volume_and_pressure(fields, last)
                break
    except (stability.PathEnd, newton.NoConvergence) as end:
        kind, why = "lost", str(end)
        if isinstance(end, stability.PathEnd) and end.cause:
            kind, why = "lost" if end.cause.of_mesh else "limit", end.cause.clause
    assert last is not None  # the state at rest always exists
    parts = _errors_at(fields, last, erring) if erring and last.limit else ()
    return dataclasses.replace(_limit_of(fields, last, kind, why), errors=parts, path=tuple(passed))


def _errors_at(fields: Fields, point: stability.Point, case: Case) -> tuple[budget.Contribution, ...]:
    """Return the contributions to the pressure's error at a limit point, which are those at the same volume."""
    if case.band is None and not case.deviations:
        return ()
    band = budget.Band(fields, case)
    try:
        cells = {column: half for column, half in band.cells(point).items() if half is not None}
    finally:
        band.release()
    halves = budget.parts(table.Row(cells, case.column.pascal), "pressure", {})
    return tuple(budget.contributions(halves, case.deviations))


def _volume_and_pressure(fields: Fields, point: stability.Point) -> tuple[float, float]:
    """Return the added volume in m3 and the pressure in Pa at a point, without its other figures, which take longer."""
    eq, state = fields.system, point.state
    return float((state.V - fields.rest_volume) * eq.volume_unit), float(state.P * eq.stress_unit)


def _limit_of(fields: Fields, point: stability.Point, kind: str, why: str = "") -> Limit:
    figures = fields.figures(point.state)
    return Limit(
        kind, figures.pressure, figures.added_volume, dict(figures.rises), figures.max_stretch,
        figures.max_stretch_at, why,
    )  # fmt: skip


def _stretched(path: Continuation, fields: Fields, before: stability.Point, after: stability.Point) -> stability.Point:
    """Return the point between two where the largest stretch is `MAX_STRETCH`, to about 0.1 %."""
    for _ in range(2):  # from the nearer end
        low, high = (fields.figures(point.state).max_stretch for point in (before, after))
        between = path.corrector.on_the_way(before, after, (MAX_STRETCH - low) / (high - low))
        before, after = (between, after) if fields.figures(between.state).max_stretch < MAX_STRETCH else (before, between)
    return between


# -- fabrication tolerances ---------------------------------------------------------------------------------------------
@dataclasses.dataclass(frozen=True)
class Tolerance:
    """A parameter or deviation of the device and its tolerance: ``middle`` plus or minus ``half``, in the unit ``"m"``,
    ``"degree"`` or ``""``. One that is ``signed`` may be zero or below, so that its effect is given per half width and not per
    percent."""

    name: str
    middle: float
    half: float
    unit: str = "m"
    signed: bool = False

    @classmethod
    def parse(cls, text: str, device: type[Actuator]) -> Tolerance:
        """Read ``"membrane=2mm+-0.2mm"``; also ``+/-`` and the sign itself, and ``%`` of the middle. `CaseError` for another
        form, parameter or unit."""
        match = len(text) < LONGEST_TEXT and re.fullmatch(r"\s*([\w-]+)\s*=\s*(.+?)\s*(?:\+/?-|±)\s*(.+?)\s*", text)
        if not match:
            raise CaseError(f"--vary {units.brief(text)} is not of the form membrane=2mm+-0.2mm")
        name, middle, half = match[1].replace("-", "_"), match[2], match[3]
        kinds = {name: field.kind for name, field in schema.about(device).items()}
        known = {
            name: (kind.unit, isinstance(kind, schema.Length) and kind.signed)
            for name, kind in kinds.items()
            if isinstance(kind, schema.Quantity)
        }
        known |= dict.fromkeys(device.deviations, ("m", True))
        if name not in known:
            listed = ", ".join(key.replace("_", "-") for key in known)
            raise CaseError(f"--vary {text!r}: {device.__name__} has no parameter {match[1]!r} to vary; it has {listed}")
        unit, signed = known[name]
        try:
            value = units.quantity(middle, unit)
            width = abs(value) * units.number(half[:-1]) / 100 if half.endswith("%") else units.quantity(half, unit)
        except units.UnitError as error:
            raise CaseError(f"--vary {text!r}: {error}") from None
        if not width > 0.0 or (not signed and width >= value):
            between = "above zero" if signed else "between zero and the value"
            raise CaseError(f"--vary {text!r}: the tolerance must lie {between}")
        return cls(name, value, width, unit, signed)


def samples(tolerances: Sequence[Tolerance], count: int, normal: bool = False) -> npt.NDArray[np.float64]:
    """Return quasi-random values of the parameters, shape (count, parameters): Halton's sequence, scrambled with a fixed seed
    for repeatability. ``normal`` takes the half width as two standard deviations; else all values in it are as likely."""
    unit = scipy.stats.qmc.Halton(len(tolerances), seed=2013).random(count)
    spread = scipy.stats.norm.ppf(unit) / 2 if normal else 2 * unit - 1
    return np.array([t.middle for t in tolerances]) + spread * np.array([t.half for t in tolerances])


def scatter(
    case: Case, material: Material, tolerances: Sequence[Tolerance], values: npt.NDArray[np.float64], comm: MPI.Comm
) -> list[tuple[Mapping[str, float], Limit]]:
    """Find the limit of each sampled device, with its parameters of `samples`; several are solved at a time, on all cores.
    `CaseError` for tolerances that make no device, `RunError` for one that cannot be meshed or solved."""
    every = [{t.name: float(value) for t, value in zip(tolerances, row, strict=True)} for row in values]
    try:
        devices = [case.actuator.made(changes) for changes in every]
    except GeometryError as error:
        raise CaseError(f"the tolerances include a device that cannot be built: {error}") from None
    nominal = dataclasses.replace(case, material=material, mesh_error=False, band=None, tolerance=None)
    tasks = {k: dataclasses.replace(nominal, actuator=device) for k, device in enumerate(devices)}
    answers = mpi.on_root(comm, lambda: dict(processes.answers(__name__, limit_of.__name__, tasks, processes.cores())))
    for done, value in answers.values():
        if not done:
            raise RunError(value)
    return [(changes, answers[k][1]) for k, changes in enumerate(every)]


def limit_of(case: Case) -> Limit:
    """Return the limit of a case, whose load is not looked at; called in a process of its own."""
    materials.import_own_modules()
    comm = mpi.start()
    with notes.sentences():
        return find_limit(case, [case.material], comm)[0]


# ----------------------------------------------------------------------------------------------------------------------
# Limit pressures of a named silicone over all its sources.


def with_sources(materials: Mapping[str, Material]) -> tuple[dict[str, Material], dict[str, tuple[str, ...]]]:
    """Return the materials with every tension source of each silicone that is given by its product name, and by product the
    names that its band is made of; empty for a product of one source. Silicones named with their source stay single."""
    every: dict[str, Material] = dict(materials)
    bands: dict[str, tuple[str, ...]] = {}
    for name, material in materials.items():
        known = silicones.named(material)
        if known is None or known not in silicones.PRODUCTS or "/" in name:
            continue
        product, band = silicones.product_of(known), []
        for silicone in silicones.spanning(product):
            label = name if silicone is silicones.SILICONES[product] else silicones.full_name(product, silicone)
            every.setdefault(label, _like(silicone.material, material))
            band.append(label)
        bands[product] = tuple(band)
    return every, bands


def _like(source: Material, asked: Material) -> Material:
    """Return a source with the requested Poisson's ratio."""
    return dataclasses.replace(source, poisson=asked.poisson)  # type: ignore[call-arg]


def band_texts(bands: Mapping[str, tuple[str, ...]], limits: Mapping[str, Limit], column: units.Column) -> list[str]:
    """Return the range of the limits over each silicone's sources, as sentences; for a single source the scatter
    of other products."""
    texts = []
    for product, names in bands.items():
        if not names:
            texts.append(f"note: {silicones.spread_sentence(product)}")
            continue
        ranked = sorted(((limits[name], name) for name in names), key=lambda pair: pair[0].pressure)
        low, high = (
            f"{column.full(limit.pressure)} ({limit.pressure / 1e3:.4g} kPa, {_what(limit, name)})"
            for limit, name in (ranked[0], ranked[-1])
        )
        texts.append(f"{product} over its {len(names)} sources: {low} to {high}; see softmodels silicones {product}")
    return texts


def _what(limit: Limit, name: str) -> str:
    return name if limit.exists else f"{name}, no limit found up to there"


# ----------------------------------------------------------------------------------------------------------------------
# Check that a varied parameter changes the device; otherwise the scatter would silently be zero.


def check_varied(actuator: Actuator, tolerances: Sequence[Tolerance], comm: MPI.Comm) -> None:
    """Raise `CaseError`, before anything is solved, for the first tolerance that does not change the device as drawn, or that
    makes no device; MeshingError or OSError if a mesh is needed to decide and cannot be made."""
    for tolerance in tolerances:
        try:
            devices = [actuator.made({tolerance.name: tolerance.middle + way * tolerance.half}) for way in (-1, 1, 0)]
        except GeometryError as error:
            raise CaseError(f"the tolerances include a device that cannot be built: {error}") from None
        if len({_figures(device) for device in devices}) == 1 and _of_one_mesh(devices, comm):
            low, high = (schema.shown(tolerance.middle + way * tolerance.half, tolerance.unit) for way in (-1, 1))
            raise CaseError(
                f"--vary {tolerance.name.replace('_', '-')}: this {type(actuator).__name__} is the same at {low} and at {high}"
                f"{_because(actuator, tolerance.name)}, so the limit does not scatter; leave it out"
            )


def _figures(device: Actuator) -> str:
    """Return a device's figures without a mesh, to tell whether it has changed."""
    told = (
        device.cavity_volume, device.solid_volume, device.chamber_volume, device.ratios, dict(device.probes),
        device.cut_planes, device.holds, device.copies, device.size,
    )  # fmt: skip
    return repr(told)


def _of_one_mesh(devices: Sequence[Actuator], comm: MPI.Comm) -> bool:
    """Return whether the meshes of all devices are the same to the last digit, on all ranks."""

    def on_rank_0() -> bool:
        with tempfile.TemporaryDirectory() as folder:
            meshes = (device.write(Path(folder) / "device.msh").read_bytes() for device in devices)
            first = next(meshes)
            return all(mesh == first for mesh in meshes)

    return mpi.on_root(comm, on_rank_0)


def _because(actuator: Actuator, name: str) -> str:
    """Return the parameter that makes this one ineffective, if known, as a clause with a leading blank."""
    field = schema.about(actuator).get(name)
    other = field.idle(actuator) if field else ""
    return f" ({registry.flag(name)} has no effect with {registry.flag(other)} {getattr(actuator, other)})" if other else ""


# ----------------------------------------------------------------------------------------------------------------------
# Natural frequencies of a device along its path: at rest, and at every state up to the requested pressures or volumes.


MAX_MODES = 20
"""Largest number of modes: of higher ones the mesh decides."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class NaturalFrequencies(cards.ResultCard):
    """Natural frequencies along a path, SI units; arrays are read-only.

    Attributes:
        pressure: In Pa, shape (states,).
        added_volume: In m3, shape (states,).
        frequency: In Hz, lowest first, nan of unstable modes, shape (states, count).
        damping: Damping ratios, 0 without a memory, nan of unstable modes, shape (states, count).
        mesh_error: Half widths in Hz of the frequencies' 95 % intervals due to the mesh, of requested states; nan if unknown,
            shape (states, count).
        requested: Whether a state was asked for, and not only passed, shape (states,).
        modes: The modes of each state.
        points: Undeformed nodes in device coordinates, m, shape (n, 3).
        displacement: Of each state, m, shape (states, n, 3).
        cells: Node numbers in VTK's order.
        cell_name: XDMF's name of the cells.
        notes: Assumptions and limits of these numbers, sentences.
        ended: Why the path ended before the last requested value; its status is 0 if it did not.
        convergent: Whether they converge with smaller cells; not of a device that is held along edges or at points.
    """

    pressure: Array
    added_volume: Array
    frequency: Array
    damping: Array
    mesh_error: Array
    requested: Array
    modes: tuple[tuple[Mode, ...], ...]
    points: Array
    displacement: Array
    cells: grid.Cells
    cell_name: str
    notes: tuple[str, ...]
    ended: outcomes.Ended
    convergent: bool

    def _line(self) -> str:
        lowest = " to ".join(f"{value:.4g}" for value in dict.fromkeys(self.frequency[[0, -1], 0].tolist()))
        pressures = " to ".join(f"{value / 1e3:.4g}" for value in dict.fromkeys(self.pressure[[0, -1]].tolist()))
        return f"at {pressures} kPa: lowest {lowest} Hz"

    def _figures(self) -> cards.Table:
        return [
            (f"{pressure / 1e3:.4g} kPa", f"{', '.join(f'{value:.4g}' for value in values)} Hz")
            for pressure, values, asked in zip(self.pressure, self.frequency, self.requested, strict=True)
            if asked
        ]

    def _remarks(self) -> list[str]:
        return [*self.unstable, *self.notes]

    @property
    def unstable(self) -> list[str]:
        """A sentence on each run of states that are not stable."""
        texts, bad = [], [sum(not mode.stable for mode in modes) for modes in self.modes]
        for state, count in enumerate(bad):
            if count and not (state and bad[state - 1]):
                rate = max(mode.rate for mode in self.modes[state] if not mode.stable)
                texts.append(
                    f"unstable at {self.pressure[state]:.4g} Pa and {self.added_volume[state] * 1e6:.4g} ml: {count} of the "
                    f"modes have no frequency, and the fastest grows by a factor of e in {1 / rate:.2g} s"
                )
        return texts


def case_for_modes(case: Case, pressures: Steps | None = None) -> Case:
    """Return a case with only its pressures or added volumes, or the given pressures, as a load; at rest, or under its dead
    loads, if these are 0 or it has none. `CaseError` for another load."""
    steps = case.steps if pressures is None else pressures
    asked = () if case.program and pressures is None else steps[-1].prescribed[0].values if steps else ()
    if pressures is None and any(case.values) and not (case.load.of(PRESSURE) or case.load.of(VOLUME)):
        raise CaseError(
            "frequencies are found at rest, or at rising pressures or added volumes, and not along a program, strokes or "
            "forces; give the pressures (--pressure-cm 0:10), or 0 for the state at rest (--pressure-cm 0)"
        )
    values = {field.name: getattr(case, field.name) for field in dataclasses.fields(case)}
    others = {
        "steps": steps if any(asked) else (),
        "supply": None,
        "load_unload": False,
        "band": None,
        "tolerance": None,
        "inertia": False,
    }
    return (Case if any(asked) else simulation.AtRest)(**{**values, **others})


def find_frequencies(case: Case, count: int, sealed: bool, comm: MPI.Comm) -> NaturalFrequencies:
    """Find the natural frequencies at every state of a case's path; all ranks call it. See `case_for_modes` and
    `Model.modes`. CaseError, MeshingError and RunError as for a run."""
    _check_accuracy(case)
    modes = _frequencies(case, count, sealed, simulation.meshed(case.actuator, comm))
    if not case.mesh_error or not modes.convergent:
        return modes
    finer = mesh_error.FINER[case.actuator.dimension]
    others = _frequencies(case, count, sealed, simulation.meshed(case.actuator.refined(finer), comm))
    half = np.full_like(modes.frequency, math.nan)
    for state in np.flatnonzero(modes.requested):
        near = np.isclose(others.pressure, modes.pressure[state], rtol=1e-6) & others.requested
        if case.quantity != PRESSURE:
            near = np.isclose(others.added_volume, modes.added_volume[state], rtol=1e-6) & others.requested
        for other in np.flatnonzero(near)[:1]:
            half[state] = mesh_error.half_width(modes.frequency[state], others.frequency[other], finer)
    return dataclasses.replace(modes, mesh_error=read_only(half))


def _frequencies(case: Case, count: int, sealed: bool, body: Body) -> NaturalFrequencies:
    """Return the natural frequencies on one mesh."""
    model, ended, states = Model.of(case, body), outcomes.Ended(), list[Equilibrium]()
    try:
        try:
            path = model.followed(case, case.quantity) if case.steps else [model.solve()]
            for state in path:
                states.append(state)  # modes change the loaded state, so the path is followed first
        except RunError as error:
            if not states:
                raise
            ended = outcomes.Ended.by(error)
        modes = tuple(tuple(model.modes(state, count, sealed=sealed)[:count]) for state in states)
        edge = notes.held_on_edge(model.system.body)
        grid, shape = model.fields.grid, model.fields.shape
        shapes = [shape(state.state.w) for state in states]
        points, cells, moved = mpi.on_root(body.mesh.comm, lambda: (grid.points, grid.cells, np.array(shapes)))
        return NaturalFrequencies(
            read_only(np.array([state.pressure for state in states])),
            read_only(np.array([state.volume for state in states])),
            read_only(np.array([[mode.frequency for mode in these] for these in modes])),
            read_only(np.array([[mode.damping for mode in these] for these in modes])),
            read_only(np.full((len(modes), len(modes[0])), math.nan)),
            read_only(np.array([state.requested or state.point is None for state in states])),
            modes,
            read_only(points),
            read_only(moved),
            cells,
            grid.cell_name,
            (*_notes(case, modes[0][0].density, sealed), *filter(None, [edge]), *model.notes),
            ended,
            not edge,
        )
    finally:
        model.release()


def _notes(case: Case, density: float, sealed: bool) -> list[str]:
    sheet = silicones.sheet_of(case.material.relaxed)
    source = " by its data sheet" if sheet and sheet.density == density else ""
    materials_of = [case.material, *(part.material for part in case.components if isinstance(part, regions.RegionPart))]
    memories = [material.memory for material in materials_of if material.memory is not None]
    branches = [branch for memory in memories for branch in memory.branches]
    texts = [f"the silicone has {density:g} kg/m^3{source}, and {'the damping of its memory' if branches else 'no damping'}"]
    if sealed:
        texts.append("the cavities are sealed, with air that keeps its temperature; adiabatic air is 1.4 times as stiff")
    if branches:
        texts.append("the branches of its memory stiffen and damp each mode at its own frequency, about the relaxed state")
    if any(branch.growth for branch in branches) and case.steps:
        texts.append("relaxation times are those of the undeformed silicone, although its viscosity grows with strain")
    if any(memory.softening for memory in memories):
        texts.append("the silicone is not softened")
    return [*texts, *filter(None, [notes.unseen(case.actuator)])]
