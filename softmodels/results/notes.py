"""What a reader must know of a run before trusting its numbers: sentences, the same in the closing message and the report."""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import MappingProxyType

from softmodels.case.case import Case
from softmodels.case.gauges import followed_text
from softmodels.case.region import Region
from softmodels.materials.casting import density_of, sheet_of
from softmodels.materials.silicones import broken, extrapolated, named, stretch_at_break
from softmodels.materials.spread import material_spread
from softmodels.materials.stability import instabilities
from softmodels.mechanics.holds import Clamp
from softmodels.mechanics.loads import Gravity
from softmodels.mechanics.named_places import names_in
from softmodels.mechanics.rigid import Rigid
from softmodels.mechanics.walls.part import Walls
from softmodels.results.row import Row
from softmodels.results.sources import SourceRows, span_sentence
from softmodels.results.state_words import state_words

DEEPEST = 0.01
"""Depth of a contact in sizes of the device above which the user is warned."""
NEAR = 1e-3
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
            f"at {state_words(case).place(torn)} the largest stretch, {torn['max_stretch']:.3g}, passes {breaks:.3g}, at which "
            f"{named(case.material)} broke when pulled ({source.source}): the device tears there, and no state from there on "
            "is real"
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
    where, deepest = state_words(case), min(overlapping, key=lambda row: row["least_gap_mm"])
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
    return [followed_text(name, far) for name, far in away.items() if far > NEAR * case.actuator.size]


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
