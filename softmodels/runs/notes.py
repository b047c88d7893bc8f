"""Warnings of a run, the same in the closing message and the report."""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import math
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np

from geometries import Actuator
from softmodels.case import entries, materials
from softmodels.case.case import Case
from softmodels.common import commands
from softmodels.components import contact
from softmodels.components.loads import Gravity
from softmodels.components.rigid import Clamp, Rigid
from softmodels.materials import laws, silicones, specimens
from softmodels.mechanics import compiling, component, controls, mpi
from softmodels.mechanics.body import Body
from softmodels.path import schedule, stability, steps
from softmodels.path.continuation import Continuation
from softmodels.path.supply import MAX_LAMINAR_REYNOLDS, Reservoir
from softmodels.runs import budget, columns, labels, outcomes, table
from softmodels.runs.fields import Fields


def notes_of(known: budget.Budget) -> list[str]:
    """Return the warnings for a run's states, as sentences, from its table, those of every source of the silicone, and the one
    with smaller cells."""
    case, rows = known.case, known.rows
    return [
        *case.load.doubts,
        *vacuum_notes(case),
        *law_notes(case, rows),
        *stretch_notes(case, rows),
        *source_notes(case, known.sources),
        *weight_notes(case),
        *bonded_notes(case),
        *volume_notes(rows),
        *contact_notes(case, rows),
        *lifted_notes(case, rows),
        *sealing_notes(case, rows),
        *depth_notes(case, rows),
        *place_notes(case, rows),
        *band_notes(case, rows),
        *known.mesh.doubts(),
        *time_notes(case, rows),
        *motion_notes(case, rows),
        *supply_notes(case, rows),
    ]


MAX_QUIET_PENETRATION = 0.01
"""Penetration of a contact, relative to the device's size, above which the user is warned."""
FOLLOWED_DISTANCE = 1e-3
"""Distance of a named point from the surface, relative to the device's size, above which it is reported."""
LOCAL_PENETRATION_SHARE = 0.1
"""Fraction of that penetration which the force, spread over the device, would cause; below it only an edge penetrates."""
LOWEST_USUAL_PRESSURE = -85e3
"""Pressure in Pa below which few sources of a vacuum come."""
VOLUME_CHANGE = 0.05
"""Change of the silicone's volume (J - 1 at a vertex) above which the user is warned."""


def density_of_main(case: Case) -> float:
    """Return the density in kg/m3 of a case's silicone."""
    given = next((part.density for part in case.components if isinstance(part, Gravity)), None)
    return silicones.density_of(case.material) if given is None else given


def supplied_work(case: Case, rows: table.PathTable) -> float:
    """Return the work in J of the air and of dead loads along a run's states."""
    count = len(case.actuator.ratios)
    pairs = [(f"pressure_{i}", f"added_volume_{i}") for i in range(1, count + 1)]
    pairs = [("pressure", "added_volume")] if count == 1 else pairs
    loads = [part for part in case.components if isinstance(part, controls.LoadPart)]
    names = [(part.variables[0], part.variables[1]) for part in loads]
    pairs += [pair for pair in names if pair[0] in rows]
    return sum(float(np.sum((rows[f][1:] + rows[f][:-1]) / 2 * np.diff(rows[x]))) for f, x in pairs)


def supply_notes(case: Case, rows: table.PathTable) -> Iterator[str]:
    """Yield sentences on a supply in time: how long it fills the device, how the device leaks, and whether a tube's flow is
    turbulent."""
    supply = case.supply
    if not isinstance(supply, Reservoir) or not rows:
        return
    time, pressure = rows["time"], rows["pressure"]
    if (seconds := fill_time(rows)) is not None:
        most = max(rows, key=lambda row: row["source_pressure"])
        source = case.column.full(most["source_pressure"])
        yield f"the device takes {seconds:.3g} s to {FILLED_SHARE:.0%} of the source's {source}"
    opening = steps.prescribes(case.steps, steps.VALVE)
    closed = np.array([opening and steps.value_at(case.steps, steps.VALVE, row["load_step"]) == 0.0 for row in rows])
    if supply.leak is not None and closed.any():
        first = int(np.argmax(closed))
        length = int(np.argmin(np.append(closed[first:], False)))
        left, since = pressure[first : first + length], time[first : first + length] - time[first]
        if left[0] > 0.0 and left.min() <= left[0] / 2:
            half = float(np.interp(-left[0] / 2, -left, since))
            yield f"with the valve closed the leak takes {half:.3g} s to half of {case.column.full(left[0])}"
        elif left[0] > 0.0 and since[-1] > 0.0:
            lost = 1 - left[-1] / left[0]
            yield f"with the valve closed the leak takes {lost:.1%} of {case.column.full(left[0])} in {since[-1]:.3g} s"
    flow = float(np.abs(rows["flow"]).max()) * supply.ambient
    if supply.tube is not None and (number := supply.tube.reynolds(flow)) > MAX_LAMINAR_REYNOLDS:
        yield (
            f"the flow in the tube has a Reynolds number up to {number:.0f} and is turbulent above "
            f"{MAX_LAMINAR_REYNOLDS:.0f}; it is computed as laminar, which is too fast"
        )


def fill_time(rows: table.PathTable) -> float | None:
    """Return the time in s in which a device fills to `FILLED_SHARE` of the source's largest pressure; None if it does not."""
    if not (most := rows["source_pressure"].max()) > 0.0:  # NaN where the source gives a flow
        return None
    for before, after in itertools.pairwise(rows):
        low, high = before["pressure"], after["pressure"]
        if low < (wanted := FILLED_SHARE * most) <= high:
            return float(before["time"] + (wanted - low) / (high - low) * (after["time"] - before["time"]))
    return None


def vacuum_notes(case: Case) -> Iterator[str]:
    """Yield a sentence on a vacuum that few sources reach, or none."""
    if (lowest := case.load.lowest()) <= LOWEST_USUAL_PRESSURE:
        yield (
            f"{case.column.full(lowest)} are {lowest / 1e3:.4g} kPa: at sea level ejectors reach about -85 kPa, single-stage "
            "pumps -90 kPa; check the source's data sheet"
        )


def lifted_notes(case: Case, rows: table.PathTable) -> Iterator[str]:
    """Yield where a face that only stands on its plane lifts off, as a sentence; none if it does not."""
    role = case.actuator.standing
    forces = rows.get(f"{role}_force", math.nan)
    at = next((k for k, (above, below) in enumerate(itertools.pairwise(forces)) if above > 0.0 >= below), None)
    if at is not None:
        share = forces[at] / (forces[at] - forces[at + 1])
        before, after = (rows[k][case.variable] for k in (at, at + 1))
        yield (
            f"the {role} LIFTS OFF at about {case.load.told(before + share * (after - before))}, between states {at} "
            f"and {at + 1} ({role}_force_N falls to 0): beyond it the seal leaks, and the states are invalid"
        )


def sealing_notes(case: Case, rows: table.PathTable) -> Iterator[str]:
    """Yield what each seal holds in the last state, as sentences."""
    for part in case.components if rows else ():
        last, label = rows[-1], part.label
        if part.sealing and (hold := last[f"{label}_hold"]) > 0.0:
            slides = last[f"{label}_shear"] if part.remembers else 0.0  # where the seal opens, it presses no more
            shear = f"; its lip slides at a lateral force of {slides:.4g} N" if slides > MIN_LATERAL_SHARE * hold else ""
            yield (
                f"in the last state the holding force of {part.where} is {hold:.4g} N (vacuum times "
                f"{last.shown(f'{label}_sealed'):.4g} mm2 inside the seal){shear}"
            )


def law_notes(case: Case, rows: table.PathTable) -> Iterator[str]:
    """Yield a sentence if the law's numbers look like those of another convention, if the material is stiffer than silicones
    and soft rubbers, and if a run stretches it beyond the stability of its law by Drucker's criterion."""
    if case.material.misread:
        yield case.material.misread
    if (modulus := case.material.shear_modulus_0) > laws.MAX_SHEAR_MODULUS:
        yield (
            f"the material's shear modulus is {modulus / 1e6:.4g} MPa; silicones have 5 to 500 kPa, so check the units of its "
            "parameters"
        )
    most = float(rows.get("max_stretch", 1.0).max(initial=1.0))
    # Of all deformations with this largest stretch, uniaxial tension has the least I1: the others reach it earlier. In the
    # other modes of tension the stretch itself is compared, because a membrane is pulled in both directions.
    strain = most**2 + 2 / most - 3
    weak = [
        str(instability)
        for instability in specimens.instabilities(case.material)
        if instability.strain <= strain or 1 < instability.stretch <= most
    ]
    if weak:
        yield (
            f"by Drucker's criterion the law {case.material.name} is unstable in {'; '.join(weak)}, and the run's largest "
            f"stretch is {most:.3g}: an instability there may come from the law, not the device; see softmodels curve, and use "
            "a law that is stable in this range"
        )


def band_notes(case: Case, rows: table.PathTable) -> Iterator[str]:
    """Yield the 95 % interval of the limit pressure from the material's errors, as a sentence; none if unknown."""
    for row in rows:
        if row.get("limit") and not math.isnan(row.get("pressure_ci95", math.nan)):
            half = row.shown("pressure_ci95")
            low, high = row.shown("pressure") - half, row.shown("pressure") + half
            yield (
                f"limit pressure between {low:.4g} and {high:.4g} {case.column.unit} (95 % confidence interval from the "
                "fitted material's errors)"
            )
            return


def bonded_notes(case: Case) -> Iterator[str]:
    """Yield a sentence if plates or rings of a device are modelled as silicone, unlike real plates."""
    meshed = {part.name for part in case.components if isinstance(part, materials.Region)}
    rigid = {
        name for part in case.components if isinstance(part, Rigid) for name in (*component.names_in(part.face), part.region)
    }
    rigid |= {name for part in case.components if isinstance(part, Clamp) for name in component.names_in(part.face)}
    soft = [name for name in case.actuator.plated if name not in meshed | rigid]
    if not soft:
        return
    named, first = " and ".join(soft), soft[0]
    does = "bends and stretches" if len(soft) == 1 else "bend and stretch"
    region = ", or a region of another material" if first in case.actuator.regions else ""
    yield (
        f"{named} {does} like the silicone in this model; for a stiff one add a rigid part to the case file ([rigid.{first}] "
        f"with face = '{first}'){region}"
    )


def stretch_notes(case: Case, rows: table.PathTable) -> Iterator[str]:
    """Yield a sentence on stretches beyond the silicone's range or its stretch at break; none if unknown or below."""
    if "max_stretch" not in rows:
        return
    breaks = silicones.stretch_at_break(case.material)
    most = float(rows["max_stretch"].max())
    torn = next((row for row in rows if breaks is not None and row["max_stretch"] > breaks), None)
    if torn is not None:
        product = silicones.product_of(silicones.named(case.material) or "")
        yield (
            f"at {labels.state_labels(case).place(torn)} the largest stretch, {torn['max_stretch']:.3g}, passes "
            f"{breaks:.3g}, the "
            f"least stretch at break of {product} ({silicones.break_words(case.material)}): the device may tear "
            "there, and states from "
            "there on may not be real"
        )
    elif text := silicones.extrapolated(case.material, most):
        yield text


def source_notes(case: Case, sources: columns.SourceTables) -> Iterator[str]:
    """Yield the spread of a named silicone's sources, and of this device's states if solved for them."""
    texts = (silicones.material_spread(case.material), span_sentence(case, sources) if sources else "")
    yield from (text for text in texts if text)


def weight_notes(case: Case) -> Iterator[str]:
    """Yield the assumed density if gravity acts and none was given, as a sentence."""
    if any(isinstance(part, Gravity) and part.density is None for part in case.components):
        sheet = silicones.sheet_of(case.material)
        source = f"by the {sheet.source}" if sheet else "assumed, as for most silicones, because no density was given"
        yield (
            f"the silicone weighs {silicones.density_of(case.material):g} kg/m^3, {source} ([gravity] density, "
            "--gravity-density)"
        )


def volume_notes(rows: table.PathTable) -> Iterator[str]:
    """Yield a sentence if the silicone's own volume changed more than that of rubber can."""
    least, most = rows.get("J_min", 1.0).min(initial=1.0), rows.get("J_max", 1.0).max(initial=1.0)
    if least < 1 - VOLUME_CHANGE or most > 1 + VOLUME_CHANGE:
        yield (
            f"the silicone's volume ratio J is {least:.3f} to {most:.3f}; rubber is nearly incompressible, so "
            f"use a --poisson closer to 0.5"
        )


def contact_notes(case: Case, rows: table.PathTable) -> Iterator[str]:
    """Yield a sentence on walls that overlap or a surface that is folded onto itself; none if there are none."""
    invalid = rows.where("walls_touch")
    if not invalid:
        return
    where, deepest = labels.state_labels(case), max(invalid, key=labels.overlap_of)
    count = f"{len(invalid)} of {len(rows)} states" if len(invalid) > 1 else "one state"
    since, told = f"from {where.place(invalid[0])} on, in {count},", "these states are invalid"
    if not labels.overlap_of(deepest):
        yield (
            f"SURFACE FOLDED: {since} the silicone's surface is folded onto itself within a cell: {told} (walls_touch in "
            "path.csv); round its edges more, or use smaller cells there (--cell-size)"
        )
        return
    overlap = (
        f"WALLS OVERLAP: {since} walls overlap by up to {1e3 * labels.overlap_of(deepest):.3g} mm at "
        f"{where.place(deepest)}: {told} "
        "(least_gap_mm and walls_touch in path.csv)"
    )
    walls = [part for part in case.components if isinstance(part, contact.Walls) and not part.off]
    if walls:
        yield (
            f"{overlap}; {', '.join(part.words for part in walls)} are in contact; use smaller cells (--cell-size), a "
            "larger stiffness, or add the faces there ([walls])"
        )
    else:
        auto = "" if case.actuator.meeting == () else " (--walls auto)"
        yield f"{overlap}; enable self-contact{auto}, or name the faces in a [walls] table of a case file"


def depth_notes(case: Case, rows: table.PathTable) -> Iterator[str]:
    """Yield a sentence if faces penetrate deep into the contact plane."""
    deepest, size = rows.get("contact_depth").max(initial=0.0), case.actuator.size
    if deepest <= MAX_QUIET_PENETRATION * size or (plane := contact.obstacle_of(case.components)) is None:
        return
    force = np.abs(rows.get("contact_force")).max(initial=0.0)
    # The penetration of this force if spread over the device; an edge that curls into the plane carries little of it.
    spread = force / (plane.stiffness * case.material.shear_modulus_0 * size**2)
    if spread < LOCAL_PENETRATION_SHARE * MAX_QUIET_PENETRATION:
        yield (
            f"an edge of the faces penetrates the contact plane by {1e3 * deepest:.3g} mm under a total "
            f"force of {force:.3g} N; the faces as a whole penetrate far less, so a larger --contact-stiffness "
            f"changes only that edge. Check it with smaller cells (--cell-size)"
        )
    else:
        yield (
            f"faces penetrate the contact plane by {1e3 * deepest:.3g} mm, more than {MAX_QUIET_PENETRATION:.0%} of the "
            f"device's size; use a --contact-stiffness above {plane.stiffness:g}"
        )


def place_notes(case: Case, rows: table.PathTable) -> Iterator[str]:
    """Yield a sentence on each named point that is tracked away from its named position."""
    away = {name: rows[0].get(f"{name}_off") for name in case.gauges.places} if rows else {}
    yield from (entries.followed_text(name, far) for name, far in away.items() if far > FOLLOWED_DISTANCE * case.actuator.size)


def left_out(case: Case) -> str:
    """Return what the model of a case leaves out, as a sentence."""
    stopped = "".join(part.in_model for part in case.components)
    pressing = [part.words for part in case.components if isinstance(part, contact.Walls) and not part.off]
    meeting = f"{'; '.join(pressing)} are in frictionless contact, others" if pressing else "other walls"
    heavy = any(isinstance(part, Gravity) for part in case.components)
    weight = "viscosity is" if heavy else "weight and viscosity are"
    return f"the silicone is elastic; {weight} not modelled; {meeting} may overlap{stopped}"


# ----------------------------------------------------------------------------------------------------------------------
# Loads in time: what a silicone with a memory loses, creeps and keeps.


@dataclasses.dataclass(frozen=True)
class Cycle:
    """A cycle of a run in time, from one state without pressure to the next: its rows, the work of the air on the way up, and
    what it does not get back, the area of the loop, in J."""

    rows: table.PathTable
    work: float
    lost: float

    @property
    def closed(self) -> bool:
        return not self.rows[-1]["pressure"]

    @property
    def loss(self) -> str:
        """What it loses, in words."""
        return f"{1e3 * self.lost:.3g} mJ, {self.lost / self.work:.1%} of the work"


def cycles(rows: table.PathTable) -> list[Cycle]:
    """Return the cycles of one cavity in time, an unfinished one among them; none where nothing inflates it."""
    ends = [0, *(i for i, row in enumerate(rows) if i and row["requested"] and not row["pressure"]), len(rows) - 1]
    cycles = []
    for first, last in itertools.pairwise(dict.fromkeys(ends)):
        part = rows[first : last + 1]
        P = part["pressure"]
        steps = (P[1:] + P[:-1]) / 2 * np.diff(part["added_volume"])
        if P.any():
            cycles.append(Cycle(part, float(np.maximum(steps, 0.0).sum()), float(steps.sum())))
    return cycles


def time_notes(case: Case, rows: table.PathTable) -> Iterator[str]:
    """Yield sentences on the last cycle of a load in time, or on times and memories that do nothing without each other."""
    if case.remembers and not case.timed:
        yield (
            "the silicone has a memory, but the load has no times: every state is that after a long time; add --rate or --hold "
            "for what happens before"
        )
    if case.timed and not (case.inertia or case.remembers or case.supply):
        yield "the load has times, but the silicone has no memory ([material.memory]): they change nothing"
    if case.inertia or not (case.timed and case.remembers):
        return
    all_cycles, gauge = cycles(rows), case.actuator.gauge
    told = []
    if all_cycles and all_cycles[-1].closed and all_cycles[-1].work:
        cycle, rises = all_cycles[-1], np.abs(all_cycles[-1].rows[gauge])
        rest = f"; {rises[-1] / rises.max():.1%} of the {gauge}'s rise are left" if rises.any() else ""
        told.append(f"cycle {len(all_cycles)} loses {cycle.loss}{rest}")
    for first, last in _holds(rows):
        if first[gauge] and last[gauge]:
            held = f"{case.column.full(first['pressure'])} for {last['time'] - first['time']:.4g} s"
            told.append(
                f"held at {held}, the {gauge} creeps from "
                f"{first.shown(gauge):+.4g} to {last.told(gauge, '+.4g')} ({last[gauge] / first[gauge] - 1:+.1%})"
            )
    yield from dict.fromkeys(told[:1] + told[-1:])


def _holds(rows: table.PathTable) -> list[tuple[table.Row, table.Row]]:
    """Return the ends of the times at which the pressure of one cavity is held above zero."""
    asked = [*rows.where("requested"), *rows[-1:]]
    pairs = itertools.pairwise(asked)
    return [(a, b) for a, b in pairs if 0.0 < a["pressure"] == b["pressure"] and b["time"] > a["time"]]


def motion_notes(case: Case, rows: table.PathTable) -> Iterator[str]:
    """Yield the density that inertia has, and the balance of energy, as sentences; none without inertia."""
    if not case.inertia or not rows:
        return
    work = supplied_work(case, rows)
    stored = rows[-1]["stored_energy"] - rows[0]["stored_energy"]
    lost, kinetic = (rows[-1].get(f"{name}_energy") for name in ("dissipated", "kinetic"))
    left = work - stored - lost - kinetic
    most = max(abs(work), rows["kinetic_energy"].max())
    yield f"the silicone's inertia is that of {density_of_main(case):g} kg/m^3"
    if most:
        yield (
            f"work of the supply and loads {1e3 * work:.4g} mJ = {1e3 * stored:.4g} mJ stored + {1e3 * lost:.4g} mJ dissipated "
            f"by the silicone + {1e3 * kinetic:.4g} mJ kinetic + {1e3 * left:.2g} mJ ({abs(left) / most:.2g} of the largest) "
            f"for numerical damping (--spectral-radius {case.spectral_radius:g}), friction and the error of the steps"
        )


FILLED_SHARE = 0.9
"""Share of the source's pressure at which a device counts as filled."""
MIN_LATERAL_SHARE = 1e-3
"""Share of the holding force below which the lateral force at which a lip slides is not told."""


def span_sentence(case: Case, sources: columns.SourceTables) -> str:
    """Return the range over the sources of a silicone at the last value that all reach, and at their limits."""
    words, own = labels.state_labels(case), silicones.named(case.material)
    common = _common(case, sources)
    parts = []
    if common:
        rows = {name: many[common[name]] for name, many in sources.items()}
        here = rows[own or ""]
        told = case.load.told(here[case.variable])
        place = words.under(here, case.column.full(here["pressure"])) if case.variable == "pressure" else told
        parts.append(f"at {place} the {words.gauge} rises {_ends(rows, words.gauge)}")
        if words.volume and case.variable != "added_volume":
            parts.append(f"the cavity takes {_ends(rows, 'added_volume')}")
        if words.pressure and case.variable != "pressure":
            parts.append(f"the pressure is {_ends(rows, 'pressure')}")
    limits = {name: many.where("limit")[0] for name, many in sources.items() if many["limit"].any()}
    if limits:
        none = [columns.key_of(name) for name in sources if name not in limits]
        met = f" (none met with {', '.join(none)})" if none else ""
        parts.append(f"the limit point lies at {_ends(limits, 'pressure')}{met}")
    band = case.band.product if isinstance(case.band, materials.SourceBand) else own
    return f"over the {len(sources)} sources of {band}, {'; '.join(parts)}" if parts else ""


def _common(case: Case, sources: columns.SourceTables) -> dict[str, int]:
    """Return the row of each source at the last requested value that all of them reach; empty if they share none under load."""
    for value in sorted(case.values, key=abs, reverse=True):
        common: dict[str, int] = {}
        for name, rows in sources.items():
            there = [k for k, row in enumerate(rows) if columns.stands_at(row, case, value)]
            if there:
                common[name] = there[0]
        if value and len(common) == len(sources):
            return common
    return {}


def _ends(rows: Mapping[str, table.Row], variable: str) -> str:
    ordered = sorted(rows, key=lambda name: rows[name][variable])
    low, high = (f"{rows[name].told(variable)} ({columns.key_of(name)})" for name in (ordered[0], ordered[-1]))
    return low if len(rows) == 1 else f"{low} to {high}"


# ----------------------------------------------------------------------------------------------------------------------
# Report stability: sentences for the end of a run, and a table for ``summary.json``.


def events(rows: table.PathTable, words: labels.StateLabels) -> list[dict[str, float | str]]:
    """Return the limit points, bifurcations and snap-throughs of a path in order, as in ``summary.json``.

    A jump includes its starting point: volume and the gauge's rise before, and whether the device inflates or collapses, or a
    part of it snaps.
    """
    kinds = ("limit", "bifurcation", "stroke_limit", "jump")
    from_keys = ("pressure_cm", "added_volume_ml", f"{words.gauge}_mm")
    keys = ("step", "pressure_cm", "pressure_Pa", *from_keys[1:])
    events: list[dict[str, float | str]] = [
        {"kind": kind, **{key: row.cell(key) for key in keys}} for row in rows for kind in kinds if row.get(kind)
    ]
    landed = [event for event in events if event["kind"] == "jump"]
    for event, (before, after) in zip(landed, jumps(rows), strict=True):
        event["way"] = _way(before, after, words, rows)
        event |= {f"from_{key}": before.cell(key) for key in from_keys}
    return events


def jumps(rows: table.PathTable) -> list[tuple[table.Row, table.Row]]:
    """Return the snap-throughs of a path: the last state before and the first one after each."""
    over, jumps = set(jumped_over(rows)), []
    for k, row in enumerate(rows):
        if row.get("jump"):
            held = [i for i in range(k) if i not in over]
            jumps.append((rows[held[-1] if held else 0], row))
    return jumps


LOCAL_SNAP = 0.02
"""Share of the volume or travel of a path up to which a snap-through is that of a part of the device."""


def _way(before: table.Row, after: table.Row, words: labels.StateLabels, rows: table.PathTable) -> str:
    moved = words.along[1]
    if abs(after[moved] - before[moved]) < LOCAL_SNAP * np.ptp(rows[moved]):
        return "snaps in a part"
    onwards, back = ("inflates", "collapses") if words.pressure else ("gives way", "springs back")
    return onwards if after[moved] > before[moved] else back


def jumps_text(rows: table.PathTable, words: labels.StateLabels) -> str:
    """Return the load, direction and heights of a path's snap-throughs in a sentence without full stop; "" if none."""
    gauge, components = words.gauge, []
    for before, after in jumps(rows):
        same = not words.pressure or abs(after.shown("pressure") - before.shown("pressure")) < 1e-6
        volume = f", added volume {before.shown('added_volume'):.4g} to {after.told('added_volume')}"
        components.append(
            f"at {words.place(before)}{'' if same else f' to {words.place(after)}'} it {_way(before, after, words, rows)}, "
            f"{gauge} rise {before.shown(gauge):.4g} to {after.told(gauge)}{volume if words.volume else ''}"
        )
    return f"snap-through: {'; '.join(components)}" if components else ""


def jumped_over(rows: table.PathTable) -> list[int]:
    """Return which states of a path a supply skips by snap-through: the unstable ones, and all up to the next stable one."""
    jumped, falling = [], False
    for k, row in enumerate(rows):
        falling = falling and not row["jump"]
        if falling or not row.get("stable_under_supply", 1):
            jumped.append(k)
        falling = falling or bool(row.get("stroke_limit"))
    return jumped


def unseen(actuator: Actuator) -> str:
    """Return which modes a symmetric slice cannot detect, and how to detect them; empty for a whole device."""
    if actuator.dimension == 2:
        return f"an axisymmetric section detects no mode that varies around the axis; use {actuator.fuller} to detect those"
    if actuator.copies > 1:
        components = f"a 1/{actuator.copies} model"
        return f"{components} detects only modes with that symmetry; {actuator.fuller} detects all"
    return ""


def held_on_edge(body: Body) -> str:
    """Return that a device is held along edges or at points, which give way further under a reaction with every refinement;
    empty if only faces hold it. Under air alone such holds have no reaction."""
    roles = dict.fromkeys(hold.role for hold in body.holds if hold.point or body.is_edge(hold.role))
    if not roles:
        return ""
    names = " and ".join(map(repr, roles))
    return (
        f"the device is held along edges or at points ({names}), which give way further with every refinement of the mesh: the "
        "frequencies fall with it, and have no mesh error; hold a face instead, such as a disk's bottom (support = base)"
    )


def unlocated(rows: table.PathTable, words: labels.StateLabels) -> str:
    """Return that a bifurcation was passed but not located; empty if none was. The number of negative eigenvalues changes only
    at limit points and bifurcations, whose own rows still have the old one; a cycle comes to some of them from the other
    side."""
    cyclic = rows.get("jump").any()
    for before, after in itertools.pairwise(rows):
        told = before.get("limit") or before.get("bifurcation") or after.get("jump") or (cyclic and after.get("limit"))
        if before["negative_eigenvalues"] != after["negative_eigenvalues"] and not told:
            return (
                f"a bifurcation between {_between(before, after, words)} could not be "
                "located; request more values around it, or refine the mesh"
            )
    return ""


def _between(before: table.Row, after: table.Row, words: labels.StateLabels) -> str:
    if words.pressure:
        return f"{before.shown('pressure'):.4g} and {after.told('pressure')}"
    return f"{words.place(before)} and {words.place(after)}"


def _state(row: table.Row, words: labels.StateLabels) -> str:
    """Return the load of a state, and in brackets its added volume."""
    return f"{words.place(row)} ({row.told('added_volume')})" if words.volume else words.place(row)


def stability_text(
    rows: table.PathTable, actuator: Actuator, words: labels.StateLabels, branch: table.PathTable | None = None
) -> str:
    """Return one or two sentences on the stability of the last state of a path, or of the branch that was followed, and its
    changes, for the closing message."""
    if not rows or "negative_eigenvalues" not in rows[-1]:
        return ""
    last, bifurcations = rows[-1], rows.where("bifurcation")
    load, moved = words.kept
    if last["stable_under_pressure"]:
        text = f"stable under {load} and under {moved}"
    elif last["stable_under_volume"]:
        text = f"unstable under a {load}, stable under a given {moved}"
    else:
        count = last["negative_eigenvalues"]
        text = f"unstable: the energy falls in {count} direction{'s' if count > 1 else ''}"
    text = f"the last state is {text}"
    lost = [rows[k] for k in jumped_over(rows)]
    if told := jumps_text(rows, words):
        text += f"; {told}"
    if lost:
        text += (
            f"; at {lost[0].told('stroke')} of stroke ({lost[0].told('pressure')}) the device snaps through with "
            f"the gas of this {words.driver}, skipping {len(lost)} of the states (stroke_limit and jump in path.csv)"
        )
    if bifurcations:
        at = ", ".join(_state(row, words) for row in bifurcations)
        text += (
            f"; bifurcation{'s' if len(bifurcations) > 1 else ''} at {at}, beyond which the device leaves "
            f"this shape (mode.png; {'the new branch is in branch/' if branch else 'use --branch to follow the new branch'})"
        )
    elif passed := unlocated(rows, words):
        text += f"; {passed}"
    if branch:
        end = branch[-1]
        rise, held = end.told(actuator.gauge, "+.4g"), "stable" if end["stable_under_volume"] else "unstable"
        text += (
            f"; the branch was followed through {len(branch)} states to {_state(end, words)}, "
            f"{actuator.gauge} rise {rise}, {held} under a given {moved}"
        )
    hidden = unseen(actuator)
    return f"{text} ({hidden})" if hidden else text


# ----------------------------------------------------------------------------------------------------------------------
# The last state of a run, and how the run has ended.


def closing(case: Case, row: table.Row) -> list[str]:
    """Return the last state of a run that has reached all its values, for its closing message; the errors of its numbers are
    those of `softmodels.runs.budget.Budget.lines`."""
    words, gauge = labels.state_labels(case), case.actuator.gauge
    volume = f", added volume {row.shown('added_volume'):.5g} ml" if words.volume else ""
    breaks, overlap = silicones.break_words(case.material), labels.overlap_text(row)
    further = "".join(f", {_named(name, row, case.actuator)}" for name in case.actuator.headline)
    state = (
        f"{_loaded(row, words)}: {gauge} rise {row.shown(gauge):+.5g} mm{further}{volume}{pressed(row)}, "
        f"largest stretch {row['max_stretch']:.4g}{f' [{breaks}]' if breaks else ''} and von Mises stress "
        f"{row.told('max_von_mises')} (at integration points), J {row['J_min']:.4f} to {row['J_max']:.4f} (at vertices)"
        f"{f'; {overlap}' if overlap else ''}"
    )
    gauges = ", ".join(_gauge(name, row) for name in case.gauges.variables)
    return [text for text in (state, gauges) if text]


def _gauge(name: str, row: table.Row) -> str:
    """Return a named point or angle with its value and unit."""
    unit = row.unit(name)
    return f"{name.replace('_', ' ')} {row.shown(name):.5g}{unit if unit == '°' else f' {unit}'}"


def _loaded(row: table.Row, words: labels.StateLabels) -> str:
    cavities, pressure = (
        words.pressures(row),
        f"{row.shown('pressure'):.6g} {words.unit} ({row['pressure'] / 1e3:.5g} kPa)",
    )
    if "load_step" in row and len(cavities) > 1:
        pressure = ", ".join(f"cavity{i} {row.shown(name):.6g} {words.unit}" for i, name in enumerate(cavities, 1))
    return words.under(row, pressure)


def _named(name: str, row: table.Row, actuator: Actuator) -> str:
    """Return a variable's short name and value."""
    return f"{columns.term(row.column(name), actuator).name} {row.told(name)}"


def pressed(row: table.Row) -> str:
    """Return the contact forces of the device, for the closing line."""
    forces = ("blocked_force", "contact_force")
    return "".join(f", {columns.term(row.column(name)).name} {row.told(name)}" for name in forces if name in row)


def ending(rows: table.PathTable, row: table.Row, words: labels.StateLabels, told: Mapping[str, object]) -> str:
    """Return how a run ended and what one of its states has reached, in a sentence or two; ``told`` is ``summary.json``, empty
    if it was interrupted."""
    stroke = f"{row.told('stroke')} of stroke and " if "stroke" in row else ""
    reached = f"At {stroke}{labels.load(row, words)} the {words.gauge} has {risen(row[words.gauge])}{_taken(row, words)}"
    if "max_stretch" in row:
        reached += f"; the largest stretch is {row['max_stretch']:.4g}"
    for name in ("blocked_force", "contact_force"):
        if name in row:
            reached += f"; the {columns.term(row.column(name)).name} is {row.told(name)}"
    if not told:
        return f"The run was interrupted; {len(rows)} states are stored. {reached}."
    if told.get("status") == commands.EXIT_DONE:
        return f"All requested values were reached in {len(rows)} states. {reached}."
    start = "The run stopped at a limit point" if told.get("status") == commands.EXIT_NO_EQUILIBRIUM else "The run failed"
    return f"{start}: {told.get('message', '')}. {reached}."


def _taken(row: table.Row, words: labels.StateLabels) -> str:
    count = len(words.volumes(row))
    taker = "the cavities have together" if count > 1 else "the cavity has"
    return f" and {taker} {gained(row['added_volume'])}" if count else ""


# ----------------------------------------------------------------------------------------------------------------------
# Messages on why a continuation failed: the known causes and their fixes.


NEAR_STRETCH_LIMIT = 0.95
"""Fraction of the stretch at loss of stability, or at locking of the chains, above which that counts as the cause."""
MAX_QUIET_PRESSURE = 100.0
"""Pressure in shear moduli above which the silicone's own volume is compressed rather than the device's shape changed."""
MIN_QUIET_VOLUME_RATIO = 0.3
"""Volume ratio at a vertex below which cells are nearly inverted."""


def unstable_law(case: Case, stretch: float) -> str:
    """Return a sentence without full stop if the law is unstable at a stretch, else ""."""
    weak = specimens.weakest(case.material)
    if weak is None or stretch < NEAR_STRETCH_LIMIT * weak.stretch:
        return ""
    return (
        f"{specimens.weakness(case.material)}, and the last state has stretch {stretch:.3g}: the material itself is "
        f"unstable there, so a finer mesh or smaller steps do not help. Use a law that is stable over the stretches "
        f"of this run (see softmodels curve; fit a wider range, or use neo-hookean), or stay below"
    )


def known_causes(case: Case, row: table.Row, petsc: bool = False) -> list[str]:
    """Return possible causes of the end of a path, the most certain first; empty if none is found. The row has at least
    ``max_stretch``, ``J_min`` and ``pressure`` of the last state, and the variables of parts; ``petsc`` says whether PETSc's
    own options were given."""
    stretch = row["max_stretch"]
    causes = []
    if petsc:
        causes.append("PETSc options were given: first try without them (what follows --)")
    if weak := unstable_law(case, stretch):
        causes.append(weak)
    if stretch >= NEAR_STRETCH_LIMIT * specimens.last_stretch(case.material, "equibiaxial"):
        ends = ", ".join(f"{specimens.last_stretch(case.material, mode):.3g} ({mode})" for mode in ("uniaxial", "equibiaxial"))
        causes.append(
            f"the chains of the law {specimens.described(case.material)} lock at stretch {ends}, and the last state "
            f"has {stretch:.3g}: it cannot deform further. Use a larger limit, or stay below"
        )
    modulus = case.material.shear_modulus_0
    if (pressure := row.get("pressure")) > MAX_QUIET_PRESSURE * modulus:
        causes.append(
            f"the pressure is {pressure / modulus:.3g} times the silicone's shear modulus: the supports or stiffeners "
            "leave the device almost no freedom, so the silicone itself is compressed. Support less of it, or stay below"
        )
    if row["J_min"] < MIN_QUIET_VOLUME_RATIO:
        causes.append(
            f"the smallest volume ratio (J) is {row['J_min']:.3g}, so cells are nearly inverted: refine the mesh "
            "(--cell-size) or round its corners (--fillet)"
        )
    components = (part.hindrance(case.actuator, row.get) for part in case.components)
    causes += [sentence for sentence in components if sentence]
    return causes


def mended(case: Case, cause: component.PathFailure, stretch: float) -> str:
    """Return the fix for a known cause: its own advice, unless the law is unstable rather than the device."""
    weak = unstable_law(case, stretch)
    return weak[0].upper() + weak[1:] if weak else cause.advice


def advice(case: Case, row: table.Row, petsc: bool = False) -> str:
    """Return the known causes of a failed continuation and their fixes, as sentences, the last without full stop."""
    stretch, J = row["max_stretch"], row["J_min"]
    if causes := known_causes(case, row, petsc):
        return ". ".join(cause[0].upper() + cause[1:] for cause in causes)
    checked = f"the law is stable at stretch {stretch:.3g} by Drucker's criterion and no cell is inverted (smallest J {J:.3g})"
    return (
        f"No cause was found: {checked}. If the curve was flattening, use --control auto or arc-length, which pass "
        "limit points; otherwise refine the mesh (--finer 2)"
    )


# ----------------------------------------------------------------------------------------------------------------------
# Messages on why and where a path ended, and how to fix it.


def explain(case: Case, end: stability.PathEnd, fields: Fields, path: Continuation, petsc: bool = False) -> str:
    """Return why and where the path ended and how to fix it; ``petsc`` is whether the user gave PETSc options."""
    asked = case.load.told(case.values[-1], "g")
    device, last = case.actuator, fields.figures(path.last.state)
    pressure = f"{case.column.full(last.pressure)} ({last.pressure:.4g} Pa)"
    cells = {"pressure_Pa": last.pressure, "max_stretch": last.max_stretch, "J_min": last.extremes["J"][0]}
    row = table.Row(cells | last.device, case.column.pascal)
    where = (
        f"The last state is at {labels.state_labels(case).under(row, pressure)}, {device.gauge} rise "
        f"{last.rises[device.gauge] * 1e3:+.4g} mm, largest stretch {last.max_stretch:.3g}. "
    )
    if end.cause:
        return f"{_not_met(asked, end.cause)}: {end.cause.clause}. {where}" + mended(case, end.cause, last.max_stretch)
    if end.limit is None:
        return f"{asked} was not reached: {end}. {where}{advice(case, row, petsc)}"
    at = fields.figures(end.limit.state)
    if case.load.driven is not None:
        load = case.load.driven_part
        most = table.Row(at.device, case.column.pascal).told(load.variables[0], ".5g")
        return (
            f"no equilibrium at {asked} on this path: the {load.table} has a limit point at {most}, "
            f"where {_risen(device, at.rises)}; beyond it the device collapses. Stay below, "
            f"or use {device.stiffer} or a stiffer silicone{_or_its_travel(load.table)}"
        )
    if case.supply is not None:
        stroke = path.value(end.limit.state) * fields.system.volume_unit * 1e6
        supply = case.supply
        gas = supply.its_gas or f"the gas of the {supply.name}"
        return (
            f"a stroke of {asked} was not reached: {end}. The stroke has a limit point at {stroke:.4g} ml "
            f"({case.column.full(at.pressure)}), where {_risen(device, at.rises)} and the cavity has "
            f"{gained(at.added_volume)}; beyond it {gas} expands and the device snaps "
            f"through. Stay below{f', or use {supply.gentler}' if supply.gentler else ''}"
        )
    happens = "balloons" if at.added_volume > 0.0 else "collapses"
    return (
        f"no equilibrium at {asked} on this path: the pressure has a limit point at "
        f"{case.column.full(at.pressure)} ({at.pressure:.5g} Pa), where {_risen(device, at.rises)} and the cavity has "
        f"{gained(at.added_volume)}; beyond it the device {happens}. Stay below (with 25 % margin: "
        f"{case.column.text(0.8 * at.pressure)}), use {device.stiffer} or a stiffer silicone, or drive it by volume "
        f"past the limit (--volume-ml, or --control volume)"
    )


def explain_step(case: Case, end: stability.PathEnd, rows: table.PathTable, reached: float, petsc: bool = False) -> str:
    """Return the same for a program's step."""
    number = math.floor(reached) + 1
    at = next((row for row in reversed(rows) if row["limit"]), rows[-1]) if end.limit else rows[-1]
    words = labels.state_labels(case)
    pressures, volumes = words.pressures(at), words.volumes(at) if words.pressure else []
    names = [f"cavity{i} at " for i in range(1, len(pressures) + 1)] if len(pressures) > 1 else [""]
    cavities = [
        f"{name}{at.told(pressure)} with {at.told(volume)} added"
        for name, pressure, volume in zip(names, pressures, volumes, strict=True)
    ]
    place = ", ".join([*cavities, *words.loads_words(at)])
    asked = f"step {number} of the program ({steps.step_text(case.steps, number)})"
    gauge = case.actuator.gauge
    moved = f"the {gauge} has moved {at.told(gauge, '+.4g')}"
    if end.cause:
        return (
            f"{_not_met(asked, end.cause)}: {end.cause.clause}. The last state has {place}, and {moved}. "
            f"{mended(case, end.cause, at['max_stretch'])}"
        )
    if isinstance(end, schedule.SnapInTime):
        return (
            f"{asked} was not reached: at {steps.time_at(case.steps, reached):.4g} s, {place}, where {moved}, {end}. "
            "Stay below, use "
            f"{case.actuator.stiffer} or a stiffer silicone, or request added volumes without the supply (volume_ml)"
        )
    if isinstance(end, schedule.LostInTime):
        time = steps.time_at(case.steps, reached)
        return (
            f"{asked} was not reached: at {time:.4g} s {end}, {place}, where {moved}; beyond it {_beyond(case)[0]}. Stay "
            f"below, hold it for less time, use {case.actuator.stiffer} or a stiffer silicone, or request volumes (volume_ml)"
        )
    if end.limit is None:
        return f"{asked} was not reached: {end}. The last state has {place}, and {moved}. {advice(case, at, petsc)}"
    beyond, instead = _beyond(case)
    return (
        f"no equilibrium at {asked} on this path: its loads have a limit point with {place}, where {moved}; beyond it {beyond}."
        f" Stay below, use {case.actuator.stiffer} or a stiffer silicone, or request {instead}"
    )


def _beyond(case: Case) -> tuple[str, str]:
    """Return what a device does beyond a program's limit point, and what to request instead."""
    if any(not driver.of_cavity for step in case.steps for driver in step.prescribed):
        return "the device collapses", "volumes and travels (volume_ml, travel_mm) instead of pressures and forces"
    return "a cavity balloons", "that cavity's added volume (volume_ml) instead of its pressure"


def _not_met(asked: str, cause: component.PathFailure) -> str:
    """Return that the requested value was not reached: no equilibrium exists, or the mesh fails first."""
    return f"{asked} was not reached" if cause.of_mesh else f"no equilibrium at {asked} on this path"


def _or_its_travel(table: str) -> str:
    """Return the request that passes a load's limit point: its travel, if a case can request that."""
    options = (f"--{key.replace('_', '-')}" for key, given in controls.requestable()[table].items() if given.held)
    option = next(options, None)
    return f", or request its travel ({option}), which passes the limit" if option else ""


def _risen(device: Actuator, rises: dict[str, float]) -> str:
    """Return how far the device has moved: its gauge, and the other probes in brackets."""
    others = ", ".join(f"{name} {rise * 1e3:.4g} mm" for name, rise in rises.items() if name != device.gauge)
    return f"the {device.gauge} has {risen(rises[device.gauge])}" + (f" ({others})" if others else "")


def risen(rise: float) -> str:
    """Return how a place has moved that has a rise in m."""
    return f"{'sunk' if rise < 0.0 else 'risen'} {1e3 * abs(rise):.4g} mm"


def gained(volume: float) -> str:
    """Return what a cavity has done that has an added volume in m3."""
    return f"{'lost' if volume < 0.0 else 'gained'} {1e6 * abs(volume):.4g} ml"


def explain_failure(case: Case, failure: Exception, last: table.Row | None, petsc: bool = False) -> str:
    """Return the same if no state was found at the start or at a limit point, where no step can be shortened, from the
    solver's failure and the last row, if there is one."""
    words = "leave out PETSc's options (what follows --), " if petsc else ""
    told = f"{words}refine the mesh (--finer 2), or use another --control"
    return f"the path could not be followed ({failure})" + (f"; {told}" if last is None else f". {advice(case, last)}")


def no_branch(case: Case, rows: table.PathTable) -> str:
    """Return why a run has no branch to follow."""
    if rows.get("bifurcation").any():
        return "the bifurcation was passed before the run was resumed; run without --resume to follow the branch"
    if text := unlocated(rows, labels.state_labels(case)):
        return text
    hidden = unseen(case.actuator)
    return f"no bifurcation on this path, so there is no branch to follow{f'; {hidden}' if hidden else ''}"


# ----------------------------------------------------------------------------------------------------------------------
# Turn errors of libraries and of the disk into messages for the user.


def unwritten(error: OSError) -> str:
    """Return why results cannot be written, and the fix."""
    place = f" into {Path(error.filename).parent}" if isinstance(error.filename, str) else ""
    advice = "free some disk space" if error.errno in commands.DISK_FULL_ERRORS else "check the permissions"
    return f"the results cannot be written{place} ({error.strerror or error}); {advice} and continue with --resume"


def no_mesh(error: OSError) -> str:
    """Return why a mesh cannot be written."""
    return f"the mesh cannot be written ({error.strerror or error})"


@contextlib.contextmanager
def sentences(of_the_disk: Callable[[OSError], str] = no_mesh) -> Iterator[None]:
    """Turn errors of PETSc, the memory or the disk raised in this context into a `RunError`; ``of_the_disk`` makes the
    sentence of the disk's."""
    try:
        yield
    except RuntimeError as error:
        loaded = sys.modules.get("petsc4py.PETSc")  # not where curves are fitted
        if loaded is None or not isinstance(error, loaded.Error):
            raise
        raise outcomes.RunError(f"PETSc stopped ({mpi.petsc_reason(error)})") from error
    except MemoryError as error:
        raise outcomes.RunError(outcomes.no_memory(error)) from error
    except TimeoutError as error:
        raise outcomes.RunError(compiling.LONG) from error
    except OSError as error:
        raise outcomes.UnwrittenError(of_the_disk(error)) from error
