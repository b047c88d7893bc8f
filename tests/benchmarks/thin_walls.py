"""Thin curved walls on coarse cells: limit pressures of balloons and the stiffness of bellows, by wall and cell size.

    OMP_NUM_THREADS=1 uv run python tests/benchmarks/thin_walls.py [Balloon] [Bellows]

A closed balloon is compared with the integral through its wall, one on a neck and a bellows against their finest mesh: the
limit pressure and the pressure at an added volume of 1 ml should differ by less than 0.2 %. Five minutes.

Measured: closed balloons 0.000 %, those on a neck 0.020 %, bellows 0.145 % (a wall of 0.1 mm, cells of 2 mm), with cells of 4
mm shortened to 0.5 and 1 mm at walls of 0.05 and 0.1 mm.
"""

from __future__ import annotations

import sys

import numpy as np

import softmodels as sm
from softmodels.materials.specimens import sphere_pressure

WALLS, CELLS = (0.05, 0.1, 0.2, 0.3, 0.5), (0.3, 0.5, 1.0, 2.0, 4.0)
"""In mm; the first cell size is that of the finest mesh."""
RUBBER = sm.MooneyRivlin(c10=25e3, c01=2.5e3, poisson=0.5)
RADIUS = 0.02


def devices(kind, wall: float, cells=CELLS, **lengths):
    """Yield cell sizes in mm, and the device of a wall in mm with each."""
    for cell in cells:
        yield cell, kind(wall=1e-3 * wall, cell_size=1e-3 * cell, **lengths)


def sphere_limit(wall: float) -> float:
    """Limit pressure in Pa of a closed balloon with a wall in mm: the largest of the integral through the wall."""
    return float(sphere_pressure(RUBBER, RADIUS, RADIUS + 1e-3 * wall, np.linspace(1.2, 1.8, 20_001)).max())


def main(names: list[str]) -> int:
    """Print one line for each mesh; see above."""
    worst = 0.0
    for wall in WALLS:
        for neck in (0.0, 0.004) if "Balloon" in names else ():
            exact = 0.0 if neck else sphere_limit(wall)
            for cell, balloon in devices(sm.Balloon, wall, radius=RADIUS, neck_radius=neck):
                found = sm.limit(balloon, RUBBER).pressure
                exact = exact or found
                worst = max(worst, abs(found / exact - 1))
                print(f"Balloon, neck {1e3 * neck:g} mm, wall {wall:g} mm, cells {cell:g} mm: "
                      f"{found:.3f} Pa, {found / exact - 1:+.3%}", flush=True)  # fmt: skip
        exact = 0.0
        for cell, bellows in devices(sm.Bellows, wall) if "Bellows" in names else ():
            found = sm.Model(bellows, RUBBER).solve(volume="1 ml").pressure
            exact = exact or found
            worst = max(worst, abs(found / exact - 1))
            print(f"Bellows, wall {wall:g} mm, cells {cell:g} mm: {found:.5f} Pa at 1 ml, "
                  f"{found / exact - 1:+.3%}", flush=True)  # fmt: skip
    print(f"largest difference {worst:.3%}")
    return int(worst > 2e-3)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:] or ["Balloon", "Bellows"]))
