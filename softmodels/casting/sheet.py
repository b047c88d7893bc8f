"""The casting sheet: amounts, steps, dimensions and checks."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from softmodels.casting.bodies import MM
from softmodels.casting.make import Made, MouldBody
from softmodels.casting.settings import Asked
from softmodels.common.schema import shown
from softmodels.materials.silicones import HOUR, MINUTE

READ = "see the data sheet"
ML = 1e6
"""ml per m3."""

Row = tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class SheetTable:
    """A table of the sheet: heading, column names, rows."""

    heading: str
    head: Row
    rows: Sequence[Row]


@dataclasses.dataclass(frozen=True)
class BenchSheet:
    """Casting instructions for the bodies.

    Attributes:
        title: Of the sheet.
        about: Sentences about device, silicone and parting plane.
        amounts: Volumes and masses of silicone.
        steps: Order of work, a sentence or two each.
        walls: Thicknesses of silicone and of the bodies.
        checks: What was checked before anything was written.
        notes: What to know.
    """

    title: str
    about: Sequence[str]
    amounts: SheetTable
    steps: Sequence[str]
    walls: SheetTable
    checks: SheetTable
    notes: Sequence[str]


def bench_sheet(asked: Asked, made: Made) -> BenchSheet:
    """Return the sheet of a mould."""
    return BenchSheet(
        f"Mould of {asked.name}", _about(asked, made), _amounts(asked, made), _steps(asked, made),
        _walls(asked, made), _checks(asked, made), _notes(asked),
    )  # fmt: skip


def _about(asked: Asked, made: Made) -> list[str]:
    silicone, workshop = asked.casting, asked.workshop
    parting = asked.device.parting
    texts = [
        f"{type(asked.device).__name__}, {made.volume * ML:.4g} ml of silicone"
        + (f", {asked.silicone}." if asked.silicone else "; the silicone is not named."),
        "It is cast in two halves, which are bonded at the parting plane. "
        + (parting.why if parting else f"The mould opens along {workshop.pull.strip()}."),
    ]
    if silicone:
        a, b = silicone.parts
        texts.append(
            f"Mixing ratio {a:g} A to {b:g} B by {silicone.by}, density {silicone.density / 1e3:.2f} g/ml, pot life "
            f"{_time(silicone.pot_life)}, cure {_time(silicone.cure_time)} at 23 C. Source: {silicone.source}."
        )
    else:
        texts.append(f"Mixing ratio, density, pot life and cure time: {READ} of the silicone.")
    if workshop.shrinkage:
        larger = workshop.scale - 1.0
        texts.append(f"All bodies are larger by {larger:.2%}, for a linear shrinkage of {workshop.shrinkage:.2%}.")
    else:
        texts.append("The bodies are not scaled: no shrinkage is known or given.")
    return texts


def _time(seconds: float) -> str:
    return f"{seconds / MINUTE:.3g} min" if seconds < 2 * HOUR else f"{seconds / HOUR:.3g} h"


def _amounts(asked: Asked, made: Made) -> SheetTable:
    """Return the volumes and masses of each half and of both, with the surplus, and the amounts of A and B."""
    silicone, more = asked.casting, 1.0 + asked.workshop.surplus
    volumes = [(cast.name, cast.facets.volume / MM**3) for cast in made.casts]
    volumes.append(("both", sum(volume for _, volume in volumes)))
    rows = []
    for name, volume in volumes:
        row = [name, f"{volume * ML:.2f}", f"{volume * more * ML:.1f}"]
        if silicone:
            mass = 1e3 * silicone.density * volume
            a, b = (more * mass * part / sum(silicone.parts) for part in silicone.parts)
            row += [f"{mass:.2f}", f"{more * mass:.1f}", f"{a:.1f}", f"{b:.1f}"]
        else:
            row += [READ, "", "", ""]
        rows.append(tuple(row))
    extra = f"{asked.workshop.surplus:.0%}"
    head = (
        "part",
        "volume (ml)",
        f"mixed, {extra} more (ml)",
        "mass (g)",
        f"mixed, {extra} more (g)",
        "A (g)",
        "B (g)",
    )
    return SheetTable("Silicone", head, rows)


def _steps(asked: Asked, made: Made) -> list[str]:
    silicone, workshop = asked.casting, asked.workshop
    pot = f"within {_time(silicone.pot_life)}" if silicone else f"within its pot life ({READ})"
    cure = _time(silicone.cure_time) if silicone else f"its cure time ({READ})"
    weigh = (
        "Weigh A and B as in the table of silicone"
        if silicone
        else f"Weigh A and B in the ratio of the silicone ({READ})"
    )
    steps = [
        "Print or mill the four bodies (lengths in mm): cups on their floors, lids on their backs with the core upwards, "
        "without supports. Freshly printed resin inhibits platinum-cure silicone: bake or coat the prints.",
        "Test the fit of lid and cup without silicone. The three pins allow only one orientation; the rims must close without "
        "a gap.",
        "Coat cup, lid and core thinly with release agent.",
        f"{weigh}, mix, and draw the air out under vacuum; pour {pot}.",
        "Fill each cup to a little above its rim. Lower the lid from one side, so that the air escapes ahead of it, "
        "and press it on until the rims meet and silicone fills every vent. Top up through the pour opening.",
        f"Put weights on the lids, and let cure for {cure}.",
        "Lift the lids straight off, along the pins. Silicone in the pour opening and vents tears off at its neck; push it "
        "out.",
        "Bend the halves out of their cups. Cut the sprues flush with the bonding face.",
        "Spread a 0.1 mm film of the same silicone on the bonding faces, clear of the channels' edges. "
        f"Align the halves edge to edge, put a light weight on them, and let cure for {cure}.",
    ]
    if made.plug:
        steps.append(
            f"Push the tube ({shown(workshop.tube, 'm')} outside) into the inlet up to the cavity and seal it with silicone."
        )
    else:
        steps.append("Without an inlet: pierce the part with a needle, push the tube in and seal it with silicone.")
    steps.append("Inflate gently under water: no bubbles may rise from the bond or the tube.")
    return steps


def _walls(asked: Asked, made: Made) -> SheetTable:
    workshop = asked.workshop
    rows = [
        ("silicone above the cavity, along the pull", f"{made.wall_above * MM:.2f}", ""),
        ("silicone below the cavity, along the pull", f"{made.wall_below * MM:.2f}", ""),
        ("thinnest silicone", f"{made.thinnest * MM:.2f}", ""),
        ("narrowest channel or cavity", f"{made.channel * MM:.2f}", f"{workshop.least_wall * MM:g} (printer's rib)"),
        ("floors and lids of the mould", f"{workshop.wall * MM:.2f}", f"{workshop.least_wall * MM:g}"),
        ("rims of the mould", f"{workshop.rim * MM:.2f}", f"{workshop.least_wall * MM:g}"),
        ("gap around a pin", f"{workshop.clearance * MM:.2f}", ""),
    ]
    return SheetTable("Thicknesses", ("what", "mm", "at least, mm"), rows)


def _checks(asked: Asked, made: Made) -> SheetTable:
    rows = [_checked(body) for body in made.bodies]
    head = ("body", "watertight", "thinnest wall (mm)", "narrowest gap (mm)", "smallest draft of the part's walls (deg)",
            "smallest draft of pins and holes (deg)", f"STL error (um; {asked.workshop.chord * 1e6:g} allowed)")  # fmt: skip
    return SheetTable("Checked before writing", head, rows)


def _checked(body: MouldBody) -> Row:
    found = body.checked
    assert found is not None
    return (
        body.name, "yes" if body.facets.open_edges == 0 else "no", f"{found.wall * MM:.2f}", f"{found.gap * MM:.2f}",
        f"{max(found.lean, 0.0) + 0.0:.2f}", f"{found.own_lean:.2f}", f"{found.chord * 1e6:.0f}",
    )  # fmt: skip


def _notes(asked: Asked) -> list[str]:
    notes = [
        "Walls of the part parallel to the pull have no draft, so that the cast equals the computed device: the flexible "
        "silicone is bent out of its cup. Pins, sockets, pour opening, vents and an upright inlet have draft.",
        "The laws of the table of silicones were measured on cured sheets; a bond, a pigment or a thinner changes them.",
    ]
    if asked.casting:
        notes.append("Pot life and cure time are the maker's at 23 C; the data sheet of the batch takes precedence.")
    return notes
