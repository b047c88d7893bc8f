"""Mesh convergence of the solid forms of the tube, for its page: a finger that bends and a tube that one helix twists.

As a program, ``python tests/benchmarks/cylinder_convergence.py [bending|twisting] [LARGEST SMALLEST]``: one line per mesh, cell
sizes in mm from 2 mm, one cell through the wall, down to 1 mm, two (a quarter of an hour on one core; 1.4 mm ends after three
minutes). The tubes are shorter than the default ones, 20 mm, so that finer meshes can be had.
"""

from __future__ import annotations

import argparse

import softmodels as sm

LAW = sm.NeoHookean(30e3, 0.49)
SIZES = (2.0, 1.7, 1.4, 1.2, 1.0)
"""Cell sizes in mm."""
SHOWN = (
    "bend_angle_deg",
    "twist_deg",
    "tip_x_mm",
    "elongation_percent",
    "diameter_mm",
    "added_volume_ml",
    "max_stretch",
)


def bending(size: float) -> sm.Run:
    """A thread around the tube and a sheet along one side, as on the page."""
    tube = sm.Cylinder(section="half", strip=120.0, length=0.020, cell_size=size * 1e-3)
    thread = sm.Fibres(on="outer, strip", angle=80.0, stiffness=1e3, helices=2, name="thread")
    return sm.inflate(tube, LAW, "50 cm", components=[thread, sm.Sheet("strip", 1e3)])


def twisting(size: float) -> sm.Run:
    """One helix of a soft thread."""
    tube = sm.Cylinder(section="whole", length=0.020, cell_size=size * 1e-3)
    return sm.inflate(
        tube, LAW, "40 cm", components=[sm.Fibres(on="outer", angle=60.0, stiffness=300.0, helices=1, name="thread")]
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("form", nargs="?", choices=("bending", "twisting"))
    parser.add_argument("span", nargs="*", type=float, default=[SIZES[0], SIZES[-1]])
    given = parser.parse_args()
    for solve in (bending, twisting):
        if given.form in (None, solve.__name__):
            for size in (one for one in SIZES if given.span[-1] <= one <= given.span[0]):
                run = solve(size)
                row = run.rows[-1]
                figures = ", ".join(f"{name} {row[name]:.4f}" for name in SHOWN if name in row)
                print(f"{solve.__name__} {size:g} mm, {len(run.last.cells)} cells: {figures}", flush=True)


if __name__ == "__main__":
    main()
