"""What a reader must know of a run before trusting its numbers: sentences, the same in the closing message and the report."""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import (
    Callable,
    Iterator,
    Mapping,
    Sequence,
)
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from geometries import Actuator
from softmodels.case.case import Case
from softmodels.case.materials import Region
from softmodels.case.requests import followed_text
from softmodels.common.commands import FULL
from softmodels.materials.silicones import (
    broken,
    density_of,
    extrapolated,
    material_spread,
    named,
    sheet_of,
    stretch_at_break,
)
from softmodels.materials.stability import (
    described,
    instabilities,
    last_stretch,
    weakest,
    weakness,
)
from softmodels.mechanics.compiling import LONG
from softmodels.mechanics.component import PathFailure, names_in
from softmodels.mechanics.holds import Clamp
from softmodels.mechanics.loads import Gravity
from softmodels.mechanics.mpi import petsc_reason
from softmodels.mechanics.rigid import Rigid
from softmodels.mechanics.sheet import locking
from softmodels.mechanics.walls import Walls
from softmodels.path.program import LOAD_KEYS, step_text
from softmodels.runs.band import SourceRows, span_sentence
from softmodels.runs.columns import StateLabels, loads_words, state_labels
from softmodels.runs.outcomes import RunError, UnwrittenError, no_memory
from softmodels.runs.row import Row, split

if TYPE_CHECKING:
    from softmodels.path.continuation import Continuation
    from softmodels.path.points import PathEnd
    from softmodels.runs.fields import Fields


DEEPEST = 0.01
"""Depth of a contact in sizes of the device above which the user is warned."""
FOLLOWED_DISTANCE = 1e-3
"""Distance in sizes of the device from which a point's place on the surface is told."""
LOCAL = 0.1
"""Share of that depth below which the force, spread over the device, would sink in: then it is an edge that has sunk."""
VOLUME_CHANGE = 0.05
"""Change of the silicone's volume (J at a vertex less 1) above which the user is warned."""


def notes_of(case: Case, rows: Sequence[Row], sources: SourceRows = MappingProxyType({})) -> list[str]:
    """Warnings that a run's states call for: sentences, none if all is well.

    Args:
        case: What was run.
        rows: Rows of ``path.csv``.
        sources: Those of every source of the silicone, where they were solved.
    """
    return [
        *typed_notes(case),
        *law_notes(case, rows),
        *stretch_notes(case, rows),
        *source_notes(case, sources),
        *weight_notes(case),
        *bonded_notes(case),
        *volume_notes(rows),
        *contact_notes(case, rows),
        *depth_notes(case, rows),
        *place_notes(case, rows),
        *band_notes(rows),
    ]


def typed_notes(case: Case) -> list[str]:
    """What was requested by a text that may have meant something else: a sentence, or none."""
    asked = (case.pressures_cm, case.volumes_ml, case.strokes_ml)
    return [doubt for values in asked if (doubt := getattr(values, "doubt", ""))]


def law_notes(case: Case, rows: Sequence[Row]) -> list[str]:
    """A sentence where a run stretches its silicone beyond what its law bears by Drucker's check; none if it does not."""
    most = max((float(row.get("max_stretch", 1.0)) for row in rows), default=1.0)
    # Of all deformations with this largest stretch, uniaxial tension has the least I1: the others reach it earlier. In the
    # other modes of tension the stretch itself tells, for a membrane is pulled in both directions.
    strain = most**2 + 2 / most - 3
    weak = [str(one) for one in instabilities(case.material) if one.strain <= strain or 1 < one.stretch <= most]
    if not weak:
        return []
    return [
        f"by Drucker's check the law {case.material.name} is not stable in {'; '.join(weak)}, and the run's largest stretch is "
        f"{most:.3g}: what is unstable there may be the law and not the device; see softmodels curve, and take a law that "
        "passes within this range"
    ]


def band_notes(rows: Sequence[Row]) -> list[str]:
    """Between which pressures a limit point lies by the material's errors: a sentence, none where they are not known."""
    for row in rows:
        half = row.get("pressure_95_cm", math.nan)
        if row.get("limit") and not math.isnan(half):
            low, high = row["pressure_cm"] - half, row["pressure_cm"] + half
            return [
                f"by the errors of the fitted material the limit point lies between {low:.4g} and {high:.4g} cm (95 %)"
            ]
    return []


def bonded_notes(case: Case) -> list[str]:
    """A sentence where plates or rings of a device are nothing but its silicone, which a plate on a bench is not."""
    meshed = {part.name for part in case.parts if isinstance(part, Region)}
    rigid = {name for part in case.parts if isinstance(part, Rigid) for name in (*names_in(part.face), part.region)}
    rigid |= {name for part in case.parts if isinstance(part, Clamp) for name in names_in(part.face)}
    soft = [name for name in case.actuator.plated if name not in meshed | rigid]
    if not soft:
        return []
    named, first = " and ".join(soft), soft[0]
    does = "bends and stretches" if len(soft) == 1 else "bend and stretch"
    region = ", or a region of another material" if first in case.actuator.regions else ""
    return [
        f"{named} {does} with the silicone here; a stiff one is a rigid part of a case file ([rigid.{first}] with "
        f"face = '{first}'){region}"
    ]


def stretch_notes(case: Case, rows: Sequence[Row]) -> list[str]:
    """What the largest stretches of a run mean for the silicone: sentences, none if it is not known or bears them."""
    if "max_stretch" not in rows[0]:
        return []
    source, breaks = broken(case.material), stretch_at_break(case.material)
    most = max(rows, key=lambda row: float(row["max_stretch"]))
    torn = next((row for row in rows if breaks is not None and row["max_stretch"] > breaks), None)
    if torn is not None and source is not None:
        return [
            f"at {state_labels(case).place(torn)} the largest stretch, {torn['max_stretch']:.3g}, passes {breaks:.3g}, at "
            f"which {named(case.material)} broke when pulled ({source.source}): the device tears there, and no state from "
            "there on is real"
        ]
    return list(filter(None, [extrapolated(case.material, float(most["max_stretch"]))]))


def source_notes(case: Case, sources: SourceRows = MappingProxyType({})) -> list[str]:
    """How far the sources of a named silicone lie apart, and this device's states by them where they were solved; none for a
    material that is not of the library."""
    texts = [material_spread(case.material), span_sentence(case, sources) if sources else ""]
    return [text for text in texts if text]


def weight_notes(case: Case) -> list[str]:
    """What the silicone's own weight was taken from, where gravity acts and no density was given: a sentence, or none."""
    if not any(isinstance(part, Gravity) and part.density is None for part in case.parts):
        return []
    sheet = sheet_of(case.material)
    source = f"by the {sheet.source}" if sheet else "as most silicones do, for no density was given"
    return [
        f"the silicone weighs {density_of(case.material):g} kg/m^3, {source} ([gravity] density, --gravity-density)"
    ]


def volume_notes(rows: Sequence[Row]) -> list[str]:
    """A sentence where the silicone's own volume changed more than rubber's can; none if it nearly kept it."""
    told = [row for row in rows if "J_min" in row]
    least, most = min((row["J_min"] for row in told), default=1.0), max((row["J_max"] for row in told), default=1.0)
    if least >= 1 - VOLUME_CHANGE and most <= 1 + VOLUME_CHANGE:
        return []
    return [
        f"the silicone's own volume changed to {least:.3f} to {most:.3f} of what it was (J); rubber keeps it, so take "
        "--poisson nearer to 0.5"
    ]


def contact_notes(case: Case, rows: Sequence[Row]) -> list[str]:
    """A sentence on walls that overlap; none if they do not."""
    overlapping = [row for row in rows if row.get("walls_touch")]
    if not overlapping:
        return []
    where, deepest = state_labels(case), min(overlapping, key=lambda row: row["least_gap_mm"])
    count = f"{len(overlapping)} of {len(rows)} states" if len(overlapping) > 1 else "one state"
    found = (
        f"WALLS OVERLAP: from {where.place(overlapping[0])} on, in {count}, walls pass through each other, by up to "
        f"{-deepest['least_gap_mm']:.3g} mm at {where.place(deepest)}: these states are not real (least_gap_mm and "
        "walls_touch in path.csv)"
    )
    walls = [part for part in case.parts if isinstance(part, Walls) and not part.off]
    if not walls:
        auto = "" if case.actuator.meeting == () else " (--walls auto)"
        return [f"{found}; let them press on each other{auto}, or name them in a [walls] table of a case file"]
    return [
        f"{found}; {', '.join(part.words for part in walls)} press on each other; take smaller cells (--cell-size), a larger "
        "stiffness, or name the faces there too ([walls])"
    ]


def depth_notes(case: Case, rows: Sequence[Row]) -> list[str]:
    """A sentence where faces have sunk deep into the plane that stops them."""
    deepest = max((row.get("contact_depth_mm", 0.0) for row in rows), default=0.0)
    if case.obstacle is None or deepest <= DEEPEST * case.actuator.size * 1e3:
        return []
    size, plane = case.actuator.size, case.obstacle
    force = max((abs(row.get("contact_force_N", 0.0)) for row in rows), default=0.0)
    # The depth that this force has when it is spread over the device; an edge that curls into the plane carries little of it.
    spread = force / (plane.stiffness * case.material.shear_modulus_0 * size**2)
    if spread < LOCAL * DEEPEST:
        return [
            f"an edge of the faces has sunk {deepest:.3g} mm into the contact's plane, under a force of {force:.3g} N in all: "
            "spread over the faces it would be far less, so a larger --contact-stiffness changes little but there; look at "
            "that edge (smaller cells, --cell-size), and take its place with care"
        ]
    return [
        f"faces have sunk {deepest:.3g} mm into the contact's plane, more than {DEEPEST:.0%} of the device's size; take a "
        f"larger --contact-stiffness than {case.obstacle.stiffness:g}"
    ]


def place_notes(case: Case, rows: Sequence[Row]) -> list[str]:
    """A sentence on each named point that is followed somewhere else than where it was named."""
    away = {name: 1e-3 * rows[0].get(column) for name, column in case.gauges.off_columns.items()} if rows else {}
    return [followed_text(name, far) for name, far in away.items() if far > FOLLOWED_DISTANCE * case.actuator.size]


def left_out(case: Case) -> str:
    """What is not in the model of a case: a sentence."""
    stopped = (
        "" if case.obstacle is None else f"; the rigid plane {case.obstacle.plane} stops {case.obstacle.faces} alone"
    )
    for part in case.parts:
        stopped += part.in_model
    pressing = [part.words for part in case.parts if isinstance(part, Walls) and not part.off]
    meeting = f"{'; '.join(pressing)} press on each other without friction, others" if pressing else "walls that meet"
    heavy = any(isinstance(part, Gravity) for part in case.parts)
    weight = "viscosity is" if heavy else "weight and viscosity are"
    return f"the silicone is elastic; {weight} not in the model, and {meeting} pass through{stopped}"


# ----------------------------------------------------------------------------------------------------------------------
# What the user is told about stability: sentences for the end of a run, and a table for ``summary.json``.


def events(rows: Sequence[Row], words: StateLabels) -> list[dict[str, float | str]]:
    """Limit points, bifurcations and jumps of a path, in order, as ``summary.json`` lists them.

    A jump tells from where it starts too: volume and the gauge's rise before, and whether the device inflates or collapses.
    """
    kinds = ("limit", "bifurcation", "stroke_limit", "jump")
    from_keys = ("pressure_cm", "added_volume_ml", f"{words.gauge}_mm")
    keys = ("step", "pressure_cm", "pressure_Pa", *from_keys[1:])
    found: list[dict[str, float | str]] = [
        {"kind": kind, **{key: row[key] for key in keys}} for row in rows for kind in kinds if row.get(kind)
    ]
    landed = [event for event in found if event["kind"] == "jump"]
    for event, (before, after) in zip(landed, jumps(rows), strict=True):
        event["way"] = _way(before, after, words)
        event |= {f"from_{key}": before[key] for key in from_keys}
    return found


def jumps(rows: Sequence[Row]) -> list[tuple[Row, Row]]:
    """The jumps of a path: the last state that held before, and the one where the device lands."""
    over, found = set(jumped_over(rows)), []
    for k, row in enumerate(rows):
        if row.get("jump"):
            held = [i for i in range(k) if i not in over]
            found.append((rows[held[-1] if held else 0], row))
    return found


def _way(before: Row, after: Row, words: StateLabels) -> str:
    moved = words.along[1]
    onwards, back = ("inflates", "collapses") if words.pressure else ("gives way", "springs back")
    return onwards if after[moved] > before[moved] else back


def jumps_text(rows: Sequence[Row], words: StateLabels) -> str:
    """Load, way and heights of a path's jumps, in a sentence without its stop; empty if there is none."""
    gauge, column = words.gauge, f"{words.gauge}_mm"
    parts = []
    for before, after in jumps(rows):
        same = not words.pressure or abs(after["pressure_cm"] - before["pressure_cm"]) < 1e-6
        volume = f", added volume {before['added_volume_ml']:.4g} to {after['added_volume_ml']:.4g} ml"
        parts.append(
            f"at {words.place(before)}{'' if same else f' to {words.place(after)}'} it {_way(before, after, words)}, {gauge} "
            f"rise {before[column]:.4g} to {after[column]:.4g} mm{volume if words.volume else ''}"
        )
    return f"the device jumps: {'; '.join(parts)}" if parts else ""


def jumped_over(rows: Sequence[Row]) -> list[int]:
    """Which states of a path a supply jumps over: those that its gas does not hold, and all up to where it lands."""
    found, falling = [], False
    for k, row in enumerate(rows):
        falling = falling and not row["jump"]
        if falling or not row.get("stable_under_supply", 1):
            found.append(k)
        falling = falling or bool(row.get("stroke_limit"))
    return found


def unseen(actuator: Actuator) -> str:
    """What a symmetric slice cannot show, and how to see it; empty for a whole device."""
    if actuator.dimension == 2:
        return f"a section shows no mode that varies around the axis; {actuator.fuller} shows those too"
    if actuator.copies > 1:
        parts = f"a slice of which {actuator.copies} make the device"
        return f"{parts} shows only modes with its symmetry; {actuator.fuller} shows all"
    return ""


def unlocated(rows: Sequence[Row], words: StateLabels) -> str:
    """That a bifurcation was passed and not located; empty if none was.

    The number of negative eigenvalues changes at limit points and bifurcations alone, whose own rows still have the old one;
    a cycle comes to some of them from the other side.
    """
    cyclic = any(row.get("jump") for row in rows)
    for before, after in itertools.pairwise(rows):
        told = before.get("limit") or before.get("bifurcation") or (cyclic and after.get("limit"))
        if before["negative_eigenvalues"] != after["negative_eigenvalues"] and not told:
            return (
                f"a bifurcation between {_between(before, after, words)} could not be located; "
                "more requested values around it, or a finer mesh, may show it"
            )
    return ""


def _between(before: Row, after: Row, words: StateLabels) -> str:
    if words.pressure:
        return f"{before['pressure_cm']:.4g} and {after['pressure_cm']:.4g} cm"
    return f"{words.place(before)} and {words.place(after)}"


def _state(row: Row, words: StateLabels) -> str:
    """Where a state lies: its load, and in brackets the volume that its cavity has taken."""
    return f"{words.place(row)} ({row['added_volume_ml']:.4g} ml)" if words.volume else words.place(row)


def stability_text(rows: Sequence[Row], actuator: Actuator, words: StateLabels, branch: Sequence[Row] = ()) -> str:
    """One or two sentences on how the last state stands and where it changed; for the closing message.

    Args:
        rows: The path's rows of ``path.csv``.
        actuator: The device.
        words: What is shown of a state.
        branch: Those of the branch that was followed, if one was.
    """
    if not rows or "negative_eigenvalues" not in rows[-1]:
        return ""
    last, found = rows[-1], [row for row in rows if row.get("bifurcation")]
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
            f"; at {lost[0]['stroke_ml']:.4g} ml of stroke ({lost[0]['pressure_cm']:.4g} cm) the gas of this {words.driver} no "
            f"longer holds the device, which jumps over {len(lost)} of the states (stroke_limit and jump in path.csv)"
        )
    if found:
        at = ", ".join(_state(row, words) for row in found)
        text += (
            f"; bifurcation{'s' if len(found) > 1 else ''} at {at}, beyond which the device leaves this shape "
            f"(mode.png; {'branch/ has where it goes' if branch else '--branch follows where it goes'})"
        )
    elif passed := unlocated(rows, words):
        text += f"; {passed}"
    if branch:
        end = branch[-1]
        rise, held = end[f"{actuator.gauge}_mm"], "stable" if end["stable_under_volume"] else "unstable"
        text += (
            f"; the branch was followed through {len(branch)} states to {_state(end, words)}, "
            f"{actuator.gauge} rise {rise:+.4g} mm, {held} under a given {moved}"
        )
    hidden = unseen(actuator)
    return f"{text} ({hidden})" if hidden else text


# ----------------------------------------------------------------------------------------------------------------------
# Why a path could be followed no further, as far as it is known: sentences that name the cause and what mends it.


NEAR_STRETCH_LIMIT = 0.95
"""Share of the stretch where a law loses its stability, or its chains are taut, from which that is what ended the path."""
SQUEEZED = 100.0
"""Shear moduli of pressure from which it is the silicone's volume that gives way, and no longer the device's shape."""
FOLDED = 0.3
"""Volume ratio at a vertex below which cells have all but folded."""


def unstable_law(case: Case, stretch: float) -> str:
    """A sentence without its full stop if the law has lost its stability at a stretch; else empty."""
    weak = weakest(case.material)
    if weak is None or stretch < NEAR_STRETCH_LIMIT * weak.stretch:
        return ""
    return (
        f"{weakness(case.material)}, and the last state has stretch {stretch:.3g}: there the silicone itself has no "
        "stable state, which no mesh and no step mends. Take a law that is stable over the stretches of this run "
        "(softmodels curve shows them; a fit over a wider range, or neo-hookean), or stay below"
    )


def known_causes(case: Case, figures: Row | Mapping[str, float], petsc: bool = False) -> list[str]:
    """What may have ended a path, the surest first; empty if nothing is conspicuous.

    Args:
        case: The case.
        figures: ``max_stretch``, ``J_min`` and ``pressure_Pa`` of the last state, ``contact_force_N`` where a plane stops
            faces, and the columns of parts.
        petsc: Whether PETSc's own options were given.
    """
    stretch = float(figures["max_stretch"])
    found = []
    if petsc:
        found.append("PETSc was given options of its own: leave them out first (what follows --)")
    if weak := unstable_law(case, stretch):
        found.append(weak)
    if stretch >= NEAR_STRETCH_LIMIT * last_stretch(case.material, "equibiaxial"):
        ends = ", ".join(f"{last_stretch(case.material, mode):.3g} ({mode})" for mode in ("uniaxial", "equibiaxial"))
        found.append(
            f"the chains of the law {described(case.material)} are taut at stretch {ends}, and the last state has "
            f"{stretch:.3g}: it can be deformed no further. Take a larger limit, or stay below"
        )
    modulus = case.material.shear_modulus_0
    if (pressure := float(figures.get("pressure_Pa") or 0.0)) > SQUEEZED * modulus:
        found.append(
            f"the pressure is {pressure / modulus:.3g} times the silicone's shear modulus: what holds or stiffens the device "
            "leaves it hardly any way to give, so that the silicone itself is squeezed. Hold less of it, or stay below"
        )
    if float(figures["J_min"]) < FOLDED:
        found.append(
            f"the smallest volume ratio (J) is {figures['J_min']:.3g}, so cells have all but folded: refine the mesh "
            "(--cell-size) or round its corners (--fillet)"
        )
    if case.obstacle is not None and figures.get("contact_force_N"):
        found.append(
            f"faces press on the contact's plane: try a --contact-stiffness below {case.obstacle.stiffness:g}, and smaller "
            "cells where they touch"
        )
    parts = (part.hindrance(case.actuator, lambda column: float(figures.get(column) or 0.0)) for part in case.parts)
    found += [sentence for sentence in parts if sentence]
    if case.sheet is not None:
        found.append(
            f"a sheet of {case.sheet.stiffness / 1e3:.4g} kN/m is bonded to {case.sheet.face}: see whether the run goes on "
            f"with a softer one (--sheet-stiffness){locking(case.sheet.stiffness, case.actuator)}"
        )
    return found


def mended(case: Case, cause: PathFailure, stretch: float) -> str:
    """What to do about a known end: its own advice, but where the law and not the device has become unstable."""
    weak = unstable_law(case, stretch)
    return weak[0].upper() + weak[1:] if weak else cause.advice


def advice(case: Case, figures: Row | Mapping[str, float], petsc: bool = False) -> str:
    """What is known of a lost path and what to do about it: sentences, the last without its full stop."""
    stretch, J = float(figures["max_stretch"]), float(figures["J_min"])
    if causes := known_causes(case, figures, petsc):
        return ". ".join(cause[0].upper() + cause[1:] for cause in causes)
    checked = (
        f"the law is stable at stretch {stretch:.3g} by Drucker's check and no cell has folded (smallest J {J:.3g})"
    )
    return (
        f"Nothing conspicuous was found: {checked}. If the curve was flattening, use --control auto or arc-length, which pass "
        "limit points; otherwise refine the mesh (--cell-size)"
    )


# ----------------------------------------------------------------------------------------------------------------------
# Why a path ended, where, and what can be done about it: sentences for the user.


def explain(case: Case, end: PathEnd, fields: Fields, path: Continuation, petsc: bool = False) -> str:
    """Why the path ended, where, and what can be done about it; ``petsc`` is whether PETSc had options of its own."""
    asked = f"{case.values[-1]:g} {case.unit}"
    device, last = case.actuator, fields.figures(path.last.state)
    pressure = f"{last.pressure / case.cm:.4g} cm ({last.pressure:.4g} Pa)"
    where = (
        f"The last state is at {state_labels(case).under(Row(last.device), pressure)}, {device.gauge} rise "
        f"{last.rises[device.gauge] * 1e3:+.4g} mm, largest stretch {last.max_stretch:.3g}. "
    )
    if end.cause:
        return f"{_not_met(asked, end.cause)}: {end.cause.clause}. {where}" + mended(case, end.cause, last.max_stretch)
    if end.limit is None:
        return f"{asked} was not reached: {end}. {where}" + advice(
            case,
            {"pressure_Pa": last.pressure, "max_stretch": last.max_stretch, "J_min": last.J_min, **last.device},
            petsc,
        )
    at = fields.figures(end.limit.state)
    if case.driven is not None:
        load = case.driven.of(case.parts)
        most = at.device[load.column]
        return (
            f"no equilibrium at {asked} on this path: the {load.table} has a limit point at {most:.5g} "
            f"{split(load.column)[1]}, where {_risen(device, at.rises)}; beyond it the device gives way. Stay below, take "
            f"{device.stiffer} or a stiffer silicone{_or_its_travel(load.table)}"
        )
    if case.supply is not None:
        stroke = path.value(end.limit.state) * fields.system.volume_unit * 1e6
        supply = case.supply
        gas = supply.its_gas or f"the gas of the {supply.name}"
        return (
            f"a stroke of {asked} was not reached: {end}. The stroke has a limit point at {stroke:.4g} ml "
            f"({at.pressure / case.cm:.4g} cm), where {_risen(device, at.rises)} and the cavity has taken "
            f"{at.added_volume * 1e6:.4g} ml; beyond it {gas} expands by itself and the device jumps. "
            f"Stay below{f', or take {supply.gentler}' if supply.gentler else ''}"
        )
    return (
        f"no equilibrium at {asked} on this path: the pressure has a limit point at {at.pressure / case.cm:.4g} cm "
        f"({at.pressure:.5g} Pa), where {_risen(device, at.rises)} and the cavity has taken "
        f"{at.added_volume * 1e6:.4g} ml; beyond it the device balloons. Stay below (with 25 % margin: "
        f"{0.8 * at.pressure / case.cm:.4g} cm), take {device.stiffer} or a stiffer silicone, or drive it by volume past "
        "the limit (--volume-ml, or --control volume)"
    )


def explain_step(case: Case, end: PathEnd, rows: Sequence[Row], come: float, petsc: bool = False) -> str:
    """The same of a program's step."""
    number = math.floor(come) + 1
    at = next((row for row in reversed(rows) if row["limit"]), rows[-1]) if end.limit else rows[-1]
    words = state_labels(case)
    pressures, volumes = words.pressures(at), words.volumes(at) if words.pressure else []
    names = [f"cavity{i} at " for i in range(1, len(pressures) + 1)] if len(pressures) > 1 else [""]
    cavities = [
        f"{name}{at[pressure]:.4g} cm with {at[volume]:.4g} ml added"
        for name, pressure, volume in zip(names, pressures, volumes, strict=True)
    ]
    place = ", ".join([*cavities, *loads_words(at)])
    asked = f"step {number} of the program ({step_text(case.program, number)})"
    gauge = case.actuator.gauge
    moved = f"the {gauge} has moved {at[f'{gauge}_mm']:+.4g} mm"
    if end.cause:
        return (
            f"{_not_met(asked, end.cause)}: {end.cause.clause}. The last state has {place}, and {moved}. "
            f"{mended(case, end.cause, float(at['max_stretch']))}"
        )
    if end.limit is None:
        return f"{asked} was not reached: {end}. The last state has {place}, and {moved}. {advice(case, at, petsc)}"
    beyond, instead = "a cavity balloons", "that cavity's added volume (volume_ml) in place of its pressure"
    if any(series.target for series in case.program):
        beyond, instead = (
            "the device gives way",
            "volumes and travels (volume_ml, travel_mm) in place of pressures and forces",
        )
    return (
        f"no equilibrium at {asked} on this path: its loads have a limit point with {place}, where {moved}; beyond it {beyond}."
        f" Stay below, take {case.actuator.stiffer} or a stiffer silicone, or give {instead}"
    )


def _not_met(asked: str, cause: PathFailure) -> str:
    """That what was asked for was not met: there is none, or the mesh does not lead there."""
    return f"{asked} was not reached" if cause.of_mesh else f"no equilibrium at {asked} on this path"


def _or_its_travel(table: str) -> str:
    """What passes a load's limit point: how far it moves what it acts on, if a case can request that."""
    options = (f"--{key.replace('_', '-')}" for key, given in LOAD_KEYS[table].items() if given.held)
    option = next(options, None)
    return f", or ask for how far it moves ({option}), which passes the limit" if option else ""


def _risen(device: Actuator, rises: dict[str, float]) -> str:
    """How far the device has moved: its gauge, and the other probes in brackets."""
    others = ", ".join(f"{name} {rise * 1e3:.4g} mm" for name, rise in rises.items() if name != device.gauge)
    return f"the {device.gauge} has risen {rises[device.gauge] * 1e3:.4g} mm" + (f" ({others})" if others else "")


def explain_failure(case: Case, failure: Exception, last: Row | None, petsc: bool = False) -> str:
    """The same where no state was found at the beginning or at a limit point, where there is no step to shorten.

    Args:
        case: The case.
        failure: What the solver reported.
        last: The last row of ``path.csv``, if there is one.
        petsc: Whether PETSc had options of its own.
    """
    words = "leave out PETSc's options (what follows --), " if petsc else ""
    told = f"{words}refine the mesh (--cell-size), or use another --control"
    return f"the path could not be followed ({failure})" + (f"; {told}" if last is None else f". {advice(case, last)}")


# ----------------------------------------------------------------------------------------------------------------------
# Failures of the libraries below, and of the disk, as the sentences that a user reads.


def unwritten(error: OSError) -> str:
    """Why results cannot be written, and what to do."""
    place = f" into {Path(error.filename).parent}" if isinstance(error.filename, str) else ""
    advice = "make room for them" if error.errno in FULL else "see that they can"
    return f"the results cannot be written{place} ({error.strerror or error}); {advice} and go on with --resume"


def no_mesh(error: OSError) -> str:
    """Why a mesh cannot be written."""
    return f"the mesh cannot be written ({error.strerror or error})"


@contextlib.contextmanager
def sentences(of_the_disk: Callable[[OSError], str] = no_mesh) -> Iterator[None]:
    """Raise a `RunError` with a sentence for what PETSc, the memory or the disk raises in here.

    Args:
        of_the_disk: Makes the sentence of what could not be written.
    """
    from petsc4py import PETSc

    try:
        yield
    except PETSc.Error as error:
        raise RunError(f"PETSc stopped ({petsc_reason(error)})") from error
    except MemoryError as error:
        raise RunError(no_memory(error)) from error
    except TimeoutError as error:
        raise RunError(LONG) from error
    except OSError as error:
        raise UnwrittenError(of_the_disk(error)) from error
