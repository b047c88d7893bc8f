"""What a mould leaves, read back as a STEP part, meshed and inflated, against the device drawn: disk, slab, bellows, finger.

As a program, ``python tests/benchmarks/mirrored_moulds.py [disk slab bellows finger]``: for each device the rise of its gauge
and the added volume of the part, and by how much they differ from those of the device. The part is the bonded casts of a mould
for a silicone that shrinks by 1 %, cut where the device's symmetry allows, with tetrahedra of its own. The device is solved
twice: as a part that is drawn and meshed in the same way, so that only what the mould leaves can differ, and on its usual mesh.
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
from geometries.meshing import private_model, write_step
from softmodels.casting.bodies import imported
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
         "cell_size": 0.002, "gauge_point": "at 0, 0, 24 mm"},
    ),
    "finger": Mirrored(
        sm.PneuNet.variant("ribbed", chambers=2, cell_size=0.0007), "5,10 cm", "tip_mm", half,
        {"cavities": ("at 7, 0.5, 6 mm",), "support": "x = 0 mm", "planes": ("y = 0 mm",), "cell_size": 0.0007,
         "gauge_point": "at 18, 0, -1.5 mm"},
    ),
}  # fmt: skip


def part(asked: Mirrored, whole: Path) -> sm.ImportedActuator:
    """Return the piece to model of a STEP file's solid, as a part with tetrahedra of its own."""
    piece = whole.with_name(f"{whole.stem}-piece.step")
    with private_model():
        gmsh.model.occ.intersect(imported(whole), [(3, asked.piece())])
        gmsh.model.occ.synchronize()
        write_step(piece)
    return sm.ImportedActuator(file=str(piece), **asked.reading)


def compare(name: str, folder: Path) -> None:
    """Print one device's lines."""
    asked = DEVICES[name]
    (folder / "cast.step").write_bytes(mould(asked.device, chord="0.1 mm", shrinkage=0.01).device)
    with private_model():
        asked.device.build_whole()
        gmsh.model.occ.synchronize()
        write_step(folder / "drawn.step")
    models = {
        "cast": part(asked, folder / "cast.step"),
        "drawn": part(asked, folder / "drawn.step"),
        "own mesh": asked.device,
    }
    law = sm.Yeoh(8e3, 100.0)
    runs = {label: sm.inflate(model, law, f"0,{asked.pressures}") for label, model in models.items()}
    for pressure in asked.pressures.removesuffix(" cm").split(","):
        found = {
            label: (row["tip_mm" if label != "own mesh" else asked.gauge], row["added_volume_ml"])
            for label, row in ((label, run.at(f"{pressure} cm").row) for label, run in runs.items())
        }
        rise, volume = found["cast"]
        print(f"{name} at {pressure} cm: the cast's rise {rise:.4f} mm, its added volume {volume:.4f} ml; they differ by " +
              " and by ".join(f"{100 * (rise / a - 1):+.3f} %, {100 * (volume / b - 1):+.3f} % from {words}"
                              for words, (a, b) in (("the device drawn, meshed alike", found["drawn"]),
                                                    ("the device's own mesh", found["own mesh"]))), flush=True)  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=list(DEVICES))
    for name in parser.parse_args().names:
        with tempfile.TemporaryDirectory() as folder:
            compare(name, Path(folder))


if __name__ == "__main__":
    main()
