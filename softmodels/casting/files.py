"""Write a mould's files: STEP and STL of each body and cast in mm, the bonded device, checks and input."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from geometries import Actuator
from softmodels.case.case import Case
from softmodels.casting.facets import Facets
from softmodels.casting.make import Made, MouldBody, made
from softmodels.casting.pictures import write_sheet
from softmodels.casting.settings import Asked, asked_of
from softmodels.common.files import write_bytes, write_text
from softmodels.common.folders import ResultFolder
from softmodels.common.names import checked, place
from softmodels.common.processes import one_at_a_time

HEADER = b"softmodels, lengths in mm"


def stl_bytes(facets: Facets) -> bytes:
    """Return a binary STL of a surface: 84 bytes, then 50 for each triangle."""
    kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("colour", "<u2")])
    table = np.zeros(len(facets.triangles), dtype=kind)
    corners = facets.corners
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    table["normal"] = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0.0)
    table["corners"] = corners
    return HEADER.ljust(80) + np.array(len(table), dtype="<u4").tobytes() + table.tobytes()


def write_bodies(folder: Path, asked: Asked, made: Made) -> None:
    """Write everything but pictures and the sheet.

    Raises:
        OSError: There is no room.
    """
    for body in (*made.bodies, *made.casts):
        write_bytes(folder / f"{body.stem}.step", body.step)
        write_bytes(folder / f"{body.stem}.stl", stl_bytes(body.facets))
    write_bytes(folder / "device.step", made.device)
    write_text(folder / "mould.toml", asked.to_toml())
    write_text(folder / "checks.json", json.dumps(checks(asked, made), indent=1) + "\n")


def checks(asked: Asked, made: Made) -> dict[str, object]:
    """Return the check results; keys end in their unit."""
    return {
        "device_volume_mm3": made.volume * 1e9,
        "cast_volume_in_mould_mm3": made.cast_volume * 1e9,
        "inlet_volume_mm3": made.plug * 1e9,
        "device_less_cast_share": made.differs,
        "smallest_silicone_wall_mm": made.thinnest * 1e3,
        "smallest_channel_mm": made.channel * 1e3,
        "shrinkage": asked.workshop.shrinkage,
        "stl_chord_allowed_mm": asked.workshop.chord * 1e3,
        "bodies": {body.name: _of_body(body) for body in made.bodies},
    }


def _of_body(body: MouldBody) -> dict[str, float | int | bool]:
    assert body.checked is not None
    return {
        "watertight": body.facets.open_edges == 0,
        "volume_mm3": body.facets.volume,
        "least_lean_of_part_deg": body.checked.lean + 0.0,
        "least_draft_of_pins_and_holes_deg": body.checked.own_lean,
        "smallest_wall_mm": body.checked.wall * 1e3,
        "smallest_gap_mm": body.checked.gap * 1e3,
        "stl_triangles": len(body.facets.triangles),
        "stl_chord_mm": body.checked.chord * 1e3,
        "stl_volume_over_step_less_1": body.checked.volume_gap,
    }


# ----------------------------------------------------------------------------------------------------------------------
# The Python call that makes the mould of a device.


@checked
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
    pull: str | None = None,
    split: str | None = None,
) -> Made:
    """Make the mould of a device, and write it if a folder is given.

    Args:
        device: A device, a case, or a case file.
        folder: Where STEP and STL of each body, the sheet and the pictures go: empty, not there, or an earlier mould's.
        silicone: Product that is cast, such as ``"ecoflex-00-30"``; the case's if not given.
        wall, rim, draft, shrinkage, clearance, least_wall, least_gap, pin, pour, vent, vents, tube, chord, surplus, pull,
            split: Fields of `softmodels.casting.settings.Workshop`: numbers in SI units (angles in degrees), or texts
            with a unit, such as ``draft="2 deg"``; the case file's, or that class' own, if None.

    Returns:
        The bodies, what they cast, and what was checked.

    Raises:
        MouldError, CaseError, GeometryError: What cannot be made so.
        OwnFolderError: A folder that holds something else.
        MeshingError: The CAD kernel fails, or a body fails a check.
    """
    asked = asked_of(
        device, silicone, wall=wall, rim=rim, draft=draft, shrinkage=shrinkage, clearance=clearance, least_wall=least_wall,
        least_gap=least_gap, pin=pin, pour=pour, vent=vent, vents=vents, tube=tube, chord=chord, surplus=surplus, pull=pull,
        split=split,
    )  # fmt: skip
    if folder is None:
        return made(asked.device, asked.workshop)
    output = place("folder", folder, "a folder")
    options = {"silicone": asked.silicone, "workshop": asked.workshop}
    own = ResultFolder(output, output, "mould", options)
    try:
        found = made(asked.device, asked.workshop)
        with own.writing() as inside:
            write_bodies(inside, asked, found)
            write_sheet(inside, asked, found)
    finally:
        own.leave()
    return found
