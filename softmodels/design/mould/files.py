"""A mould's files: a STEP and an STL of each body and cast, in mm, the bonded device, what was checked and asked."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from softmodels.design.mould.asked import Asked
from softmodels.design.mould.facets import Facets
from softmodels.design.mould.make import Body, Made
from softmodels.results.writing import write_bytes, write_text

HEADER = b"softmodels, lengths in mm"


def stl_bytes(facets: Facets) -> bytes:
    """A binary STL of a surface: 84 bytes, then 50 for each triangle."""
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
    """What was found before anything was written; keys end in their unit."""
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


def _of_body(body: Body) -> dict[str, float | int | bool]:
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
