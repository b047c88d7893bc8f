"""Membranes with a bonded plate and a weight, up to 1,300 ml: the default mesh against the membrane equations by shooting.

    uv run python tests/benchmarks/plated_membranes.py [weight in kg ...]

Six cases, those of Campbell and others (arXiv 2504.01156): a membrane of 70 mm and 2 mm with a plate of 25.4 mm and 1.5, 2.5
and 4 kg, in two sources of one silicone; some 15 s each.
"""

from __future__ import annotations

import math
import sys

import numpy as np

import softmodels as sm
from softmodels.components.loads import Gravity
from softmodels.components.rigid import Rigid
from tests.support import membrane_shooting as shooting

WEIGHTS = (1.5, 2.5, 4.0)
SOURCES = ("liao-2021", "marechal-2021")
LARGEST = 1300.0
MEMBRANE = sm.Membrane(radius=0.070, thickness=0.002, plate_radius=0.0254, chamber_depth=0.1)


def exact(law: sm.Yeoh, mass: float):
    """Volumes in ml, pressures in Pa and heights in mm of the membrane equations, from where the plate is above the clamp."""
    numbers = shooting.Yeoh(law.c1, law.c2, law.c3)
    membrane = shooting.CircularMembrane(MEMBRANE.radius, MEMBRANE.thickness, numbers, MEMBRANE.plate_radius, 9.81 * mass)
    # From a height where all of the weight hangs safely, upwards and downwards.
    parts = [membrane.path(np.linspace(0.5, end, 40) * MEMBRANE.radius) for end in (1.3, 0.05)]
    path = [*reversed(parts[1]), *parts[0][1:]]
    return np.array([(1e6 * one.volume, one.pressure, 1e3 * one.height) for one in path]).T


def main() -> None:
    wanted = [float(text) for text in sys.argv[1:]] or WEIGHTS
    print(f"{'silicone':14} {'kg':>4} {'reached':>9} {'pressure':>20} {'height':>18}   (worst, from the least volume shown on)")
    for source in SOURCES:
        for mass in wanted:
            law = sm.silicone(f"ecoflex-00-30/{source}")
            parts = [Rigid("plate", name="plate", mass=mass), Gravity("-z", density=0.0)]
            run = sm.inflate(MEMBRANE, law, volumes="0:1300 ml", components=parts)
            volume, pressure, height = (run.path[name] for name in ("added_volume_ml", "pressure_Pa", "plate_z_mm"))
            V, P, z = exact(law, mass)
            order = np.argsort(V)
            shown = (volume >= V.min()) & (volume <= V.max())
            there = [np.interp(volume[shown], V[order], values[order]) for values in (P, z)]
            off = 100 * (pressure[shown] / there[0] - 1)
            low = (height[shown] - there[1]) / (1e3 * MEMBRANE.radius) * 100
            worst, least = (values[np.abs(values).argmax()] if len(values) else math.nan for values in (off, low))
            last = f"{off[-1]:+.2f} % at the end" if len(off) else ""
            first = volume[shown].min() if shown.any() else math.nan
            print(
                f"{source:14} {mass:4.1f} {volume[-1]:6.0f} ml {worst:+6.2f} % {last:>16} {least:+6.2f} % of the radius, from "
                f"{first:.0f} ml",
                flush=True,
            )


if __name__ == "__main__":
    main()
