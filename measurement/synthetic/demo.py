"""A bench's worth of synthetic photographs: the grid alone, and a disk that rises from 0 to 9 mm."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from measurement.synthetic.photographer import Scene, dome, photograph, save

SCENE = Scene(
    width=2400, height=1600, focal_px=4200.0, pixel_size=20e-6, tilt=12.0, pan=-28.0, roll=1.0, target=(0.0, 0.001),
    ambient=0.12, penumbra=70e-6, dust=12, jpeg_quality=93, srgb=True,
)  # fmt: skip
"""A camera that looks at the screen obliquely, as on the bench."""

HEIGHTS = np.arange(10) * 1e-3
"""Heights of the disk in m."""

RADIUS, FLOOR = 0.0145, -0.0067
"""Radius of the disk and Z of its undeformed surface in m: no grid line lies along it."""

PA_PER_CM = 95.1
"""Pressure in Pa of a centimetre of the column's water."""


def column(height: float) -> float:
    """Height in cm of the demo's water column for a rise in m: stiff at first, then softer, as a membrane is."""
    return 16.0 * (1.0 - np.exp(-height / 0.006)) + 250.0 * height


def make_photographs(folder: Path) -> None:
    """Write ``IMG_0100.JPG`` (the grid), one photograph per height from ``IMG_0101.JPG`` on, and ``photos.csv``."""
    folder.mkdir(parents=True, exist_ok=True)
    save(folder / "IMG_0100.JPG", photograph(SCENE, None, seed=100)[0])
    rows = ["# levels of both tubes of the water column, read to half a millimetre", "file,left,right"]
    for number, height in enumerate(HEIGHTS, 101):
        picture = photograph(SCENE, dome(float(height), RADIUS, floor=FLOOR), seed=number)[0]
        save(folder / f"IMG_{number:04d}.JPG", picture)
        half = column(float(height)) / 2.0
        rows.append(f"IMG_{number:04d}.JPG,{25.0 + half:.1f} cm,{25.0 - half:.1f} cm")
    (folder / "photos.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
