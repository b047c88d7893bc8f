"""What a mould leaves, read back as a STEP part, meshed and inflated, against the device drawn: disk, slab, bellows, finger.

As a program, ``python tests/benchmarks/mirrored_moulds.py [disk slab bellows finger]``: for each device the rise of its gauge
and the added volume of both models, and by how much they differ. The part is the bonded casts of a mould for a silicone that
shrinks by 1 %, cut where the device's symmetry allows, with tetrahedra of its own; the device has its usual mesh.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import gmsh

import softmodels as sm
from geometries import Actuator
from geometries.meshing import private_model
from softmodels.casting.files import mould


@dataclasses.dataclass(frozen=True)
class Mirrored:
    """A device, pressures, its gauge's column; the piece of the cast to model (a solid in mm), and how it is read."""

    device: Actuator
    pressures: str
    gauge: str
    piece: Callable[[], int]
    reading: Mapping[str, Any]


def wedge() -> int:
    """A twelfth of a circle."""
    return int(gmsh.model.occ.addCylinder(0, 0, -1, 0, 0, 200, 200, angle=math.pi / 6))


def half() -> int:
    """The half y > 0."""
    return int(gmsh.model.occ.addBox(-200, 0, -200, 500, 200, 400))


TWELFTH = ("y = 0 mm", "normal 0.5, -0.8660254, 0")
DEVICES: dict[str, Mirrored] = {
    "disk": Mirrored(
        sm.HollowDisk(section="axisymmetric", support="base"), "20,40 cm", "apex_mm", wedge,
        {"cavities": ("at 5, 1, 8 mm",), "support": "z = 0 mm", "planes": TWELFTH, "gauge_point": "at 0, 0, 16 mm"},
    ),
    "slab": Mirrored(
        sm.SeminarActuator(
            channels=1, length=0.04, base_width=0.03, manifold_radius=0.01, manifold_bore=0.0018, channel_bore=0.0016,
            end_bore=0.0012, fillet=0.0, offset=-0.001, around=8.0, cell_size=0.006,
        ), "20,40 cm", "tip_mm", half,
        {"cavities": ("at 10, 0.5, -1 mm",), "support": "x = 0 mm", "planes": ("y = 0 mm",),
         "gauge_point": "at 40, 0, 4 mm", "cell_size": 0.0035, "curvature": 16.0},
    ),
    "bellows": Mirrored(
        sm.Bellows(convolutions=2), "2,5 cm", "apex_mm", wedge,
        {"cavities": ("at 1, 0.1, 5 mm",), "support": "z = 0 mm", "planes": TWELFTH, "curvature": 24.0,
         "cell_size": 0.002},
    ),
    "finger": Mirrored(
        sm.PneuNet.variant("ribbed", chambers=2, cell_size=0.001), "5,10 cm", "tip_mm", half,
        {"cavities": ("at 7, 0.5, 6 mm",), "support": "x = 0 mm", "planes": ("y = 0 mm",), "cell_size": 0.0012,
         "gauge_point": "at 18, 0, -1.5 mm"},
    ),
}  # fmt: skip


def compare(name: str, folder: Path) -> None:
    """Print one device's line."""
    asked = DEVICES[name]
    (folder / "device.step").write_bytes(mould(asked.device, chord="0.1 mm", shrinkage=0.01).device)
    with private_model():
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
        whole = gmsh.model.occ.importShapes(str(folder / "device.step"))
        gmsh.model.occ.intersect(whole, [(3, asked.piece())])
        gmsh.model.occ.synchronize()
        gmsh.write(str(folder / "piece.step"))
        gmsh.option.setString("Geometry.OCCTargetUnit", "")
    part = sm.ImportedActuator(file=str(folder / "piece.step"), **asked.reading)
    law = sm.Yeoh(8e3, 100.0)
    cast, drawn = (sm.inflate(one, law, f"0,{asked.pressures}") for one in (part, asked.device))
    for pressure in asked.pressures.removesuffix(" cm").split(","):
        one, other = (run.at(f"{pressure} cm").row for run in (cast, drawn))
        pairs = [(one["tip_mm"], other[asked.gauge]), (one["added_volume_ml"], other["added_volume_ml"])]
        gaps = ", ".join(f"{100 * (a / b - 1):+.3f} %" for a, b in pairs)
        print(f"{name} at {other['pressure_cm']:g} cm: rise {pairs[0][1]:.4f} mm, added volume {pairs[1][1]:.4f} ml; "
              f"the cast differs by {gaps}", flush=True)  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=list(DEVICES))
    for name in parser.parse_args().names:
        with tempfile.TemporaryDirectory() as folder:
            compare(name, Path(folder))


if __name__ == "__main__":
    main()
