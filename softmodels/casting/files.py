"""A mould's files: STEP and STL of each body and cast in mm, a 3MF of all bodies, checks and input; the casting sheet."""

from __future__ import annotations

import dataclasses
import io
import itertools
import json
import math
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from geometries import Actuator, actuator
from softmodels.case.case import Case
from softmodels.casting import facets, make, settings
from softmodels.casting.bodies import MM_PER_M
from softmodels.casting.pictures import DRAWING, EXPLODED, PLATES, STEPS, draw_all, drawing, plates_picture
from softmodels.common import commands, names, pages, schema
from softmodels.common.files import image_uri, json_number, render, write_bytes, write_text
from softmodels.common.processes import one_at_a_time
from softmodels.materials import silicones
from softmodels.pictures import offscreen

HEADER = b"softmodels, lengths in mm"


def stl_bytes(*surfaces: facets.Facets) -> bytes:
    """Return a binary STL of surfaces: 84 bytes, then 50 for each triangle."""
    tables = b"".join(_triangles(surface) for surface in surfaces)
    count = sum(len(surface.triangles) for surface in surfaces)
    return HEADER.ljust(80) + np.array(count, dtype="<u4").tobytes() + tables


def _triangles(surface: facets.Facets) -> bytes:
    kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("colour", "<u2")])
    table = np.zeros(len(surface.triangles), dtype=kind)
    corners = surface.corners
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    table["normal"] = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0.0)
    table["corners"] = corners
    return table.tobytes()


THREE_MF = {
    "[Content_Types].xml": '<?xml version="1.0" encoding="UTF-8"?><Types xmlns="http://schemas.openxmlformats.org/package/2006/'
    'content-types"><Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/><Default '
    'Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>',
    "_rels/.rels": '<?xml version="1.0" encoding="UTF-8"?><Relationships xmlns="http://schemas.openxmlformats.org/package/2006/'
    'relationships"><Relationship Target="/3D/3dmodel.model" Id="rel0" '
    'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>',
}
"""The parts of a 3MF package beside its model (ECMA-376 part 2; 3MF core specification 1.3)."""


def three_mf_bytes(bodies: Mapping[str, facets.Facets]) -> bytes:
    """Return a 3MF of several surfaces by their names, each an object in its place, in mm."""
    objects, items = [], []
    for k, (name, surface) in enumerate(bodies.items(), 1):
        points = "".join(f'<vertex x="{x:.9g}" y="{y:.9g}" z="{z:.9g}"/>' for x, y, z in surface.points)
        corners = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in surface.triangles)
        mesh = f"<mesh><vertices>{points}</vertices><triangles>{corners}</triangles></mesh>"
        objects.append(f'<object id="{k}" name={quoteattr(name)} type="model">{mesh}</object>')
        items.append(f'<item objectid="{k}"/>')
    model = (
        '<?xml version="1.0" encoding="UTF-8"?><model unit="millimeter" xml:lang="en-US" '
        'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">'
        f"<resources>{''.join(objects)}</resources><build>{''.join(items)}</build></model>"
    )
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as package:
        for name, text in {**THREE_MF, "3D/3dmodel.model": model}.items():
            package.writestr(zipfile.ZipInfo(name), text, zipfile.ZIP_DEFLATED)  # without a time: the same bytes again
    return data.getvalue()


def write_bodies(folder: Path, asked: settings.MouldRequest, made: make.Mould) -> None:
    """Write everything but pictures and the sheet."""
    for body in (*made.bodies, *made.casts, *made.extras):
        write_bytes(folder / f"{body.stem}.step", body.step)
        write_bytes(folder / f"{body.stem}.stl", stl_bytes(body.facets))
    placed = printed(asked, made)
    for plate, name in enumerate(facets.plate_names(placed), 1):
        on_it = {placed_body.name: placed_body.facets for placed_body in placed if placed_body.plate == plate}
        write_bytes(folder / f"{name}.3mf", three_mf_bytes(on_it))
        write_bytes(folder / f"{name}.stl", stl_bytes(*on_it.values()))
    write_bytes(folder / "device.step", made.device)
    write_text(folder / "mould.toml", asked.to_toml())
    write_text(folder / "checks.json", json.dumps(checks(asked, made), indent=1) + "\n")


def printed(asked: settings.MouldRequest, made: make.Mould) -> list[facets.PlacedBody]:
    """Return all that is printed, on plates."""
    return facets.arranged([(body.name, body.facets) for body in (*made.printed, *made.extras)], asked.workshop)


def checks(asked: settings.MouldRequest, made: make.Mould) -> dict[str, object]:
    """Return the check results; keys end in their unit."""
    return {
        "device_volume_mm3": made.volume * 1e9,
        "cast_volume_in_mould_mm3": made.cast_volume * 1e9,
        "inlet_volume_mm3": made.plug * 1e9,
        "groove_volume_mm3": made.grooved * 1e9,
        "device_less_cast_share": made.differs,
        "block_less_bodies_openings_casts_share": made.balance,
        "smallest_silicone_wall_mm": made.thinnest * 1e3,
        "smallest_channel_mm": json_number(made.channel * 1e3),
        "shrinkage": asked.workshop.shrinkage,
        "stl_chord_allowed_mm": asked.workshop.chord * 1e3,
        "bodies": {body.name: _of_body(body) for body in made.bodies},
    }


def _of_body(body: make.MouldBody) -> dict[str, object]:
    assert body.checked is not None
    return {
        "watertight": body.facets.open_edges == 0,
        "volume_mm3": body.facets.volume,
        "least_lean_of_part_deg": body.checked.lean + 0.0,
        "least_draft_of_pins_and_holes_deg": json_number(body.checked.own_lean),
        "smallest_wall_mm": body.checked.wall * 1e3,
        "smallest_gap_mm": json_number(body.checked.gap * 1e3),
        "overlap_on_the_way_out_mm": body.checked.overlap * 1e3,
        "fins": [
            {
                "count": fin.alike,
                "thickness_mm": fin.thickness * MM_PER_M,
                "depth_mm": fin.depth * MM_PER_M,
                "length_mm": fin.length * MM_PER_M,
                "draft_deg": fin.draft,
                "depth_over_thickness": fin.slenderness,
                "depth_over_thickness_allowed": fin.allowed,
            }
            for fin in body.checked.fins
        ],
        "stl_triangles": len(body.facets.triangles),
        "stl_chord_mm": body.checked.chord * 1e3,
        "stl_volume_over_step_less_1": body.checked.volume_gap,
    }


# ----------------------------------------------------------------------------------------------------------------------
# The Python call that makes the mould of a device.


@names.checked
@one_at_a_time
def mould(
    device: Actuator | Case | str | Path,
    folder: str | Path | None = None,
    silicone: str | None = None,
    *,
    wall: float | str | None = None,
    rim: float | str | None = None,
    draft: float | str | None = None,
    shrinkage: float | str | None = None,
    clearance: float | str | None = None,
    least_wall: float | str | None = None,
    least_gap: float | str | None = None,
    pin: float | str | None = None,
    pour: float | str | None = None,
    vent: float | str | None = None,
    vents: int | None = None,
    tube: float | str | None = None,
    chord: float | str | None = None,
    surplus: float | str | None = None,
    inlet: str | None = None,
    core: str | None = None,
    wax_shrinkage: float | str | None = None,
    thread: float | str | None = None,
    spacing: float | str | None = None,
    lay: str | None = None,
    bolt: float | str | None = None,
    bed_width: float | str | None = None,
    bed_depth: float | str | None = None,
    layer: float | str | None = None,
    layer_time: float | str | None = None,
    pull: str | None = None,
    split: str | None = None,
) -> make.Mould:
    """Make the mould of a device, and write it if a folder is given.

    Args:
        device: A device, a case, or a case file.
        folder: Where STEP and STL of each body, the sheet and the pictures go: empty, not there, or an earlier mould's.
        silicone: Product that is cast, such as ``"ecoflex-00-30"``; the case's if not given.
        wall, rim, draft, shrinkage, clearance, least_wall, least_gap, pin, pour, vent, vents, tube, inlet, core,
            wax_shrinkage, thread, spacing, lay, bolt, bed_width, bed_depth, layer, layer_time, chord, surplus, pull,
            split: Fields of `softmodels.casting.settings.Workshop`: numbers in SI units (angles in degrees), or texts with
            a unit, such as ``draft="2 deg"``; the case file's, or that class' own, if None.

    Returns:
        The bodies, what they cast, and what was checked.

    Raises:
        MouldError, CaseError, GeometryError: What cannot be made so.
        OwnFolderError: A folder that holds something else.
        MeshingError: The CAD kernel fails, or a body fails a check.
    """
    asked = settings.asked_of(
        device, silicone, wall=wall, rim=rim, draft=draft, shrinkage=shrinkage, clearance=clearance, least_wall=least_wall,
        least_gap=least_gap, pin=pin, pour=pour, vent=vent, vents=vents, tube=tube, chord=chord, surplus=surplus, pull=pull,
        split=split, inlet=inlet, core=core, wax_shrinkage=wax_shrinkage, thread=thread, spacing=spacing, lay=lay,
        bolt=bolt, bed_width=bed_width, bed_depth=bed_depth, layer=layer, layer_time=layer_time,
    )  # fmt: skip
    return _made_into(folder, asked)


def _made_into(folder: str | Path | None, asked: settings.MouldRequest) -> make.Mould:
    """Make a mould, and write it into a folder if one is given."""
    if folder is None:
        return make.made(asked.device, asked.workshop)
    output = names.place("folder", folder, "a folder")
    own = commands.ResultFolder(output, output, "mould", {"silicone": asked.silicone, "workshop": asked.workshop})
    try:
        mould = make.made(asked.device, asked.workshop)
        with own.writing() as inside:
            write_bodies(inside, asked, mould)
            write_sheet(inside, asked, mould)
    finally:
        own.leave()
    return mould


# ----------------------------------------------------------------------------------------------------------------------
# The casting sheet: amounts, steps, dimensions and checks.


READ_DATA_SHEET = "see the data sheet"
ML_PER_M3 = 1e6

Row = tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class SheetTable:
    """A table of the sheet: heading, column names, rows."""

    heading: str
    head: Row
    rows: Sequence[Row]


@dataclasses.dataclass(frozen=True)
class BenchSheet:
    """Casting instructions for the bodies, the parts of the sheet in their order."""

    title: str
    about: Sequence[str]
    amounts: SheetTable
    prints: SheetTable
    steps: Sequence[str]
    walls: SheetTable
    checks: SheetTable
    notes: Sequence[str]


def bench_sheet(asked: settings.MouldRequest, made: make.Mould) -> BenchSheet:
    """Return the sheet of a mould."""
    return BenchSheet(
        f"Mould of {asked.name}", _description(asked, made), _amounts(asked, made), _prints(asked, made), _steps(asked, made),
        _walls(asked, made), _checks(asked, made), [*(f"{text[0].upper()}{text[1:]}." for text in made.notes), *_notes(asked)],
    )  # fmt: skip


def _description(asked: settings.MouldRequest, made: make.Mould) -> list[str]:
    silicone, workshop = asked.casting, asked.workshop
    count = ("", "", "two", "three", "four")[min(len(made.casts), 4)]
    pieces = ", ".join(f"the {cast.piece}" for cast in made.casts)
    how = f"It is cast in {count} pieces, {pieces}, which are bonded. " if count else "It is cast in one piece. "
    texts = [
        f"{type(asked.device).__name__}, {made.volume * ML_PER_M3:.4g} ml of silicone"
        + (f", {asked.silicone}." if asked.silicone else "; the silicone is not named."),
        how + made.recipe.why,
    ]
    if silicone:
        a, b = silicone.parts
        texts.append(
            f"Mixing ratio {a:g} A to {b:g} B by {silicone.by}, density {silicone.density / 1e3:.2f} g/ml, pot life "
            f"{_time(silicone.pot_life)}, cure {_time(silicone.cure_time)} at 23 C. Source: {silicone.source}."
        )
    else:
        texts.append(f"Mixing ratio, density, pot life and cure time: {READ_DATA_SHEET} of the silicone.")
    if workshop.shrinkage:
        larger = workshop.scale - 1.0
        texts.append(f"All bodies are larger by {larger:.2%}, for a linear shrinkage of {workshop.shrinkage:.2%}.")
    else:
        texts.append("The bodies are not scaled: no shrinkage is known or given.")
    if made.waxes:
        larger = 1.0 / (1.0 - workshop.wax_shrinkage) - 1.0
        texts.append(
            f"The moulds of wax cores are larger by {larger:.2%} than the cores, for a linear shrinkage of the wax of "
            f"{workshop.wax_shrinkage:.2%}." if larger else
            "The moulds of wax cores are as large as the cores: no shrinkage of the wax is given (--wax-shrinkage)."
        )  # fmt: skip
    return texts


def _time(seconds: float) -> str:
    return f"{seconds / silicones.MINUTE:.3g} min" if seconds < 2 * silicones.HOUR else f"{seconds / silicones.HOUR:.3g} h"


def _amounts(asked: settings.MouldRequest, made: make.Mould) -> SheetTable:
    """Return the volumes and masses of each piece and of all, with the surplus, and the amounts of A and B."""
    silicone, more = asked.casting, 1.0 + asked.workshop.surplus
    volumes = [(cast.name, cast.facets.volume / MM_PER_M**3) for cast in made.casts]
    if len(volumes) > 1:
        volumes.append(("all", sum(volume for _, volume in volumes)))
    rows = []
    for name, volume in volumes:
        row = [name, f"{volume * ML_PER_M3:.2f}", f"{volume * more * ML_PER_M3:.1f}"]
        if silicone:
            mass = 1e3 * silicone.density * volume
            a, b = (more * mass * part / sum(silicone.parts) for part in silicone.parts)
            row += [f"{mass:.2f}", f"{more * mass:.1f}", f"{a:.1f}", f"{b:.1f}"]
        else:
            row += [READ_DATA_SHEET, "", "", ""]
        rows.append(tuple(row))
    extra = f"{asked.workshop.surplus:.0%}"
    head = ("part", "volume (ml)", f"mixed, {extra} more (ml)", "mass (g)", f"mixed, {extra} more (g)", "A (g)", "B (g)")
    return SheetTable("Silicone", head, rows)


def _prints(asked: settings.MouldRequest, made: make.Mould) -> SheetTable:
    """Return the resin of all bodies, and the printer's time for each plate."""
    workshop, placed = asked.workshop, printed(asked, made)
    prints = facets.print_estimate(placed, workshop)
    rows = [
        ("resin", f"{prints.resin * ML_PER_M3:.1f} ml, {1e3 * prints.mass:.0f} g", "without supports and what the wash takes"),
        *((f"plate {k}, {name}.stl", _time(time),
           f"layers of {schema.shown(workshop.layer, 'm')}, {schema.shown(workshop.layer_time, 's')} each")
          for k, (name, time) in enumerate(zip(facets.plate_names(placed), prints.times, strict=True), 1)),
    ]  # fmt: skip
    rows += [
        (name, "larger than the plate", "print it on a larger one, or in pieces") for name in facets.too_large(placed, workshop)
    ]
    return SheetTable("Printing", ("what", "estimate", "of"), rows)


def _steps(asked: settings.MouldRequest, made: make.Mould) -> list[str]:
    silicone = asked.casting
    pot = f"within {_time(silicone.pot_life)}" if silicone else f"within its pot life ({READ_DATA_SHEET})"
    cure = _time(silicone.cure_time) if silicone else f"its cure time ({READ_DATA_SHEET})"
    weigh = (
        "Weigh A and B as in the table of silicone"
        if silicone
        else f"Weigh A and B in the ratio of the silicone ({READ_DATA_SHEET})"
    )
    steps = [
        f"Print or mill the {len(made.printed)} bodies (lengths in mm), as laid flat in the plates' files, without supports. "
        "Freshly printed resin inhibits platinum-cure silicone: bake or coat the prints.",
        "Try the coupon first: which sockets take its pin, and which ribs and slots are whole? From the corner cut off, "
        f"clearances are {_list(facets.COUPON_CLEARANCES)} mm and widths {_list(facets.COUPON_WIDTHS)} mm.",
        "Test the fit without silicone. The pins allow only one orientation; the rims must close without a gap.",
        "Coat all bodies thinly with release agent.",
        *itertools.chain.from_iterable(_wax_steps(pour, *made.of(pour)) for pour in made.recipe.pours if pour.wax),
        f"{weigh}, mix, and draw the air out under vacuum; pour {pot}.",
    ]
    for pour in made.recipe.pours:
        if not pour.wax:
            steps += _pour_steps(pour, [body.name for body in made.of(pour)[0]], cure, asked.workshop.core == "wax")
    steps += made.recipe.steps
    if len(made.casts) > 1:
        steps.append(
            "Spread a 0.1 mm film of the same silicone on the bonding faces, clear of the channels' edges. "
            f"Align the pieces edge to edge in the jig, put a light weight on them, and let cure for {cure}."
        )
    return [*steps, *_thread_steps(made), *_tube_steps(asked, made)]


def _thread_steps(made: make.Mould) -> list[str]:
    """Return how a tube is wound."""
    wound = made.wound
    if wound is None:
        return []
    steps = []
    for lay in wound.lays:
        length = f"{lay.length(wound.radius, wound.end - wound.begin):.2f} m in all"
        if lay.threads:
            hand = "right" if lay.angle > 0.0 else "left"
            threads = f"{lay.threads} thread{'s side by side, each' if lay.threads > 1 else ','} one turn every"
            steps.append(f"at {abs(lay.angle):g} deg, {hand}-handed: {threads} {settings.length_text(lay.advance)}, {length}")
        else:
            steps.append(f"rings every {settings.length_text(lay.spacing)}, {length}")
    return [
        f"Wind thread of {schema.shown(wound.width, 'm')} into the grooves without stretching the tube ({'; '.join(steps)}). "
        "Hold its ends with a drop of silicone, then brush a thin coat of silicone over all of it."
    ]


def _list(values: Sequence[float]) -> str:
    return ", ".join(f"{value:g}" for value in values)


def _wax_steps(pour: actuator.Pour, bodies: Sequence[make.MouldBody], core: make.MouldBody) -> list[str]:
    """Return how a lost core is cast of wax."""
    parts, sideways = " and ".join(f"the {body.name}" for body in bodies), pour.sideways is not None
    vented = any(body.checked and not math.isnan(body.checked.own_lean) for body in bodies)
    full = "until wax stands in the vents" if vented else "to the brim, and tilt and tap the air out from under its shoulder"
    return [
        f"Clamp {parts} and stand them with the open end up. Melt {1.2 * core.facets.volume / MM_PER_M**3 * ML_PER_M3:.1f} ml "
        "of wax that melts below the softening point of the prints, warm the mould, and pour through the open end, or inject "
        f"with a warm syringe, {full}. Top up while it sets and shrinks, and scrape it flush when it is cold.",
        f"{'Part the halves sideways' if sideways else 'Lift the floor off, and the frame the other way'}, take the "
        f"{pour.name} out{', cut off what set in the vents' if vented else ''}, and smooth its seam with a warm blade.",
    ]


def _pour_steps(pour: actuator.Pour, bodies: Sequence[str], cure: str, wax: bool = False) -> list[str]:
    """Return how one piece is cast and demoulded."""
    parts = {name: pour.part(name) for name in bodies}
    cup = " and ".join(f"the {name}" for name, part in parts.items() if "cup" in part)
    pins = [name for name, part in parts.items() if "pin" in part]
    steps, lost = [], any(part == " core" for part in parts.values())
    if lost:
        steps.append(
            f"Press the wax core's peg into the {pour.name} lid. Keep it cool until the silicone has cured." if wax else
            f"Print the {pour.name} core of a filament that dissolves, such as PVA, and press its peg into the lid."
        )  # fmt: skip
    if pins:
        steps.append(f"Push the {pins[0]} through its hole up to the core and seal its gap with a little wax.")
    if not pour.lid:
        tray = "frame on its floor" if pour.floor is not None else "tray"
        steps.append(f"Fill the {pour.name} {tray}, scrape it flat with a straight edge, and let cure for {cure}.")
    elif not pour.filled_open:
        steps.append(
            f"Put {cup} on the {pour.name} lid and bolt or clamp them. Pour through the wide opening in a thin stream until "
            f"silicone fills every vent; tap the air out, top up, and let cure for {cure}."
        )
    else:
        out = "wipe off what is pressed out between the rims" if pour.squeezed else (
            "silicone fills every vent; top up through the pour opening"
        )  # fmt: skip
        pot = f"Bolt {cup} together and fill them" if pour.sideways is not None else f"Fill the {pour.name} cup"
        steps.append(
            f"{pot} to a little above the rim. Lower the lid from one side, so that the air escapes ahead "
            f"of it, and press it on until the rims meet; {out}. Bolt or clamp them, and let cure for {cure}."
        )
    first = f"Pull the {pins[0]} out straight. " if pins else ""
    if pour.sideways is not None:
        core = " off the lid" if lost else " off the lid and slide it off its core"
        steps.append(f"{first}Part the halves of the cup sideways, lift the piece{core}. Cut the sprues flush.")
    elif pour.lid:
        steps.append(
            f"{first}Lift the lid straight off, along the pins, and bend the piece out of its cup. Silicone in the openings "
            "tears off at its neck; push it out, and cut the sprues flush."
        )
    else:
        steps.append(f"{first}Bend the {pour.name} out.")
    if lost:
        out = "Melt the wax out in hot water" if wax else "Dissolve the core in warm water"
        steps.append(f"{out} with the opening down, until no more comes, and rinse the cavity.")
    return steps


def _tube_steps(asked: settings.MouldRequest, made: make.Mould) -> list[str]:
    """Return how the tube is put in, and the test of the cavity; nothing without a closed one."""
    workshop = asked.workshop
    if made.plug:
        fitting = {"tube": "tube", "barb": "barb", "luer": "male Luer slip"}[workshop.inlet]
        wide = "" if workshop.inlet == "luer" else f" ({schema.shown(workshop.tube, 'm')} outside)"
        first = f"Push the {fitting}{wide} into the inlet up to the cavity and seal it with silicone."
    elif len(made.casts) > 1:
        first = "Without an inlet: pierce the part with a needle, push the tube in and seal it with silicone."
    elif math.isnan(made.channel):
        return []
    else:
        first = "Close the open end with its fitting, and seal it with silicone."
    return [first, "Inflate gently under water: no bubbles may rise from the bond or the tube."]


def _walls(asked: settings.MouldRequest, made: make.Mould) -> SheetTable:
    workshop = asked.workshop
    rows = [(f"silicone of the {cast.piece} beyond its core, along the pull", f"{cast.beyond * MM_PER_M:.2f}", "")
            for cast in made.casts if cast.beyond > 1e-6]  # fmt: skip
    rows.append(("thinnest silicone", f"{made.thinnest * MM_PER_M:.2f}", ""))
    if not math.isnan(made.channel):
        rows.append(
            (
                "narrowest channel or cavity",
                f"{made.channel * MM_PER_M:.2f}",
                f"{workshop.least_wall * MM_PER_M:g} (printer's rib)",
            )
        )
    rows += [
        ("floors and lids of the mould", f"{workshop.wall * MM_PER_M:.2f}", f"{workshop.least_wall * MM_PER_M:g}"),
        ("rims of the mould", f"{workshop.rim * MM_PER_M:.2f}", f"{workshop.least_wall * MM_PER_M:g}"),
        ("pins, diameter at their root", f"{workshop.pin * MM_PER_M:.2f}", ""),
        ("gap around a pin", f"{workshop.clearance * MM_PER_M:.2f}", ""),
    ]
    if made.wound:
        size = f"{made.wound.width * MM_PER_M:.2f} x {made.wound.depth * MM_PER_M:.2f}"
        rows.append(("groove for the thread, width and depth", size, f"{workshop.least_wall * MM_PER_M:g} (printer's wall)"))
    if workshop.bolt:
        rows.append(("holes for bolts, diameter", f"{workshop.bolt * MM_PER_M:.2f}", ""))
    return SheetTable("Thicknesses", ("what", "mm", "at least, mm"), rows)


def _checks(asked: settings.MouldRequest, made: make.Mould) -> SheetTable:
    rows = [_checked_body(body) for body in made.bodies]
    head = ("body", "watertight", "thinnest wall (mm)", "narrowest gap (mm)", "smallest draft of the part's walls (deg)",
            "smallest draft of pins and holes (deg)", "depth of fins over their thickness",
            f"STL error (um; {asked.workshop.chord * 1e6:g} allowed)")  # fmt: skip
    return SheetTable("Checked before writing", head, rows)


def _checked_body(body: make.MouldBody) -> Row:
    checks = body.checked
    assert checks is not None
    return (
        body.name, "yes" if body.facets.open_edges == 0 else "no", f"{checks.wall * MM_PER_M:.2f}",
        f"{checks.gap * MM_PER_M:.2f}" if math.isfinite(checks.gap) else "",
        f"{max(checks.lean, 0.0) + 0.0:.2f}", "" if math.isnan(checks.own_lean) else f"{checks.own_lean:.2f}",
        f"{checks.fins[0].slenderness:.3g} ({checks.fins[0].allowed:g} allowed)" if checks.fins else "",
        f"{checks.chord * 1e6:.0f}",
    )  # fmt: skip


def _notes(asked: settings.MouldRequest) -> list[str]:
    notes = [
        "Walls of the part parallel to the pull have no draft, so that the cast equals the computed device: the flexible "
        "silicone is bent out of its cup. Pins, sockets, pour opening, vents and an upright inlet have draft.",
        "The laws of the table of silicones were measured on cured sheets; a bond, a pigment or a thinner changes them.",
    ]
    if asked.casting:
        notes.append("Pot life and cure time are the maker's at 23 C; the data sheet of the batch takes precedence.")
    return notes


# ----------------------------------------------------------------------------------------------------------------------
# The sheet with its pictures.


def write_sheet(folder: Path, asked: settings.MouldRequest, made: make.Mould, pictures: bool = True) -> bool:
    """Write ``sheet.md``, ``sheet.html``, the drawings and the pictures into a folder; return whether pictures were rendered:
    if wanted, and where that can be done."""
    rendered = pictures and offscreen.can_render()
    drawing(made).savefig(folder / DRAWING)
    size = (MM_PER_M * asked.workshop.bed_width, MM_PER_M * asked.workshop.bed_depth)
    plates_picture(printed(asked, made), size).savefig(folder / PLATES)
    files = draw_all(folder, made) if rendered else []
    files += [(PLATES, "The printer's plates from above"), (DRAWING, "Outer dimensions of the bodies")]
    sheet = bench_sheet(asked, made)
    # Markdown text is inserted unescaped.
    write_text(folder / "sheet.md", render("mould.md", "softmodels.pictures", pictures=files, sheet=sheet))
    pictures_inside = {name: pages.Picture(image_uri(folder / name), text) for name, text in files}
    write_text(folder / "sheet.html", sheet_page(sheet, pictures_inside, made))
    return rendered


def sheet_page(sheet: BenchSheet, pictures: Mapping[str, pages.Picture], made: make.Mould) -> str:
    """Return the sheet as a page, with pictures by the names of their files."""
    first, steps, plates = ([pictures[name]] if name in pictures else [] for name in (EXPLODED, STEPS, PLATES))
    others = [picture for name, picture in pictures.items() if name not in (EXPLODED, STEPS, PLATES)]
    of_casts = [pages.Table(table.rows, table.head) for table in (sheet.amounts, sheet.walls, sheet.checks, sheet.prints)]
    return pages.Page(
        sheet.title, " ".join(sheet.about[:2]),
        [
            ("", [pages.Bullets(sheet.about[2:]), *first]),
            (sheet.amounts.heading, [of_casts[0]]),
            ("Order of work", [pages.Bullets(sheet.steps, ordered=True), *steps]),
            (sheet.prints.heading, [of_casts[3], *plates]),
            (sheet.walls.heading, [of_casts[1]]),
            (sheet.checks.heading, [of_casts[2], *others]),
            ("Notes", [pages.Bullets(sheet.notes)]),
        ],
        commands.Provenance.now(),
        [
            pages.Fact("Silicone of the device", f"{made.volume * ML_PER_M3:.4g} ml"),
            pages.Fact("Thinnest silicone", f"{made.thinnest * MM_PER_M:.3g} mm"),
pages.Fact("Silicone to mix", f"{sheet.amounts.rows[-1][2]} ml", sheet.amounts.head[2].partition(" (")[0]),
        ],
    ).html()  # fmt: skip
