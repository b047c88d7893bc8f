"""How long an 18-megapixel photograph takes, from the JPEG file to the outline, on one core.

Run it with ``uv run python tests/benchmarks/photograph.py``; it makes the photograph first, prints the median of five
measurements and its parts, and how far the outline lies from the truth. Other work on the machine makes it slower.
"""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

from measurement.camera import Camera
from measurement.photographer import Scene, dome, dome_height, photograph, save, truth_of
from measurement.pictures import read_pixels
from measurement.screen.grid import find_grid
from measurement.screen.setup import Setup
from measurement.series.measuring import outline_of, trace, trace_image, zero_of

SCENE = Scene(
    width=5184, height=3456, focal_px=9000.0, pixel_size=10e-6, tilt=10.0, pan=-20.0, target=(0.001, 0.002), ambient=0.12,
    blur=1.5, dust=20, srgb=True,
)  # fmt: skip
HEIGHT, RADIUS, FLOOR = 9e-3, 14e-3, -6e-3
ROUNDS = 5


def main() -> None:
    """Time it."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    cv2.setNumThreads(1)
    grid = photograph(SCENE, None, 1)[0]
    camera = Camera.ideal(SCENE.width, SCENE.height, SCENE.focal_px)
    found = find_grid(grid, camera, SCENE.grid_pitch)
    setup = Setup(camera, found.plane(camera), grid_pitch=SCENE.grid_pitch)
    truth = truth_of(SCENE)
    origin = np.rint(truth.to_metres(setup.to_pixels([[0.0, 0.0]])) / SCENE.grid_pitch)[0] * SCENE.grid_pitch
    zero = zero_of(trace_image(photograph(SCENE, dome(0.0, RADIUS, floor=FLOOR), 2)[0], setup))
    with tempfile.TemporaryDirectory() as folder:
        file = save(Path(folder) / "IMG_0001.JPG", photograph(SCENE, dome(HEIGHT, RADIUS, floor=FLOOR), 3)[0])
        whole, reading, tracing = [], [], []
        for _ in range(ROUNDS):
            started = time.perf_counter()
            outline = outline_of(trace(file, setup, likely=zero.tone), zero, 1000.0, 10.0, file.name)
            whole.append(time.perf_counter() - started)
            started = time.perf_counter()
            read_pixels(file)
            reading.append(time.perf_counter() - started)
            started = time.perf_counter()
            trace(file, setup)
            tracing.append(time.perf_counter() - started)
    print(f"one photograph of {SCENE.width * SCENE.height / 1e6:.1f} megapixels: {statistics.median(whole):.2f} s")
    print(f"  reading the file {statistics.median(reading):.2f} s, with its edge {statistics.median(tracing):.2f} s")
    miss = outline.z - dome_height(outline.x + origin[0], HEIGHT, RADIUS)
    print(f"  {len(outline.x)} points, apex {1e6 * (outline.height - HEIGHT):+.1f} um, heights {1e6 * np.std(miss):.1f} um rms")


if __name__ == "__main__":
    main()
