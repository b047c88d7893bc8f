"""Outlines from photographs, fitted: the fit recovers the silicone and what the bench got wrong.

The photographs are computed here, of a disk whose silicone is known.

uv run python docs/examples/fit_outlines.py
"""

import dataclasses
from pathlib import Path

import matplotlib.pyplot as plt
import measurement
import numpy as np
import softmodels as sm
from softmodels.cli.examples import TRUTH, inflated, scene_of, take_photographs
from softmodels.mechanics.mpi import start

truth = dataclasses.replace(TRUTH, pressures=TRUTH.pressures[::2])
_, shadows = inflated(truth, start())
take_photographs(Path("photographs"), truth, shadows, scene_of(1.0))

setup = measurement.setup_from_grid("photographs/IMG_0100.JPG", pitch=9e-3)
found = measurement.outlines("photographs/photos.csv", setup)
disk = sm.HollowDisk(section="axisymmetric")
options = sm.FitOptions(
    changes={"c3": {"start": 0.0, "fixed": True}}, profiles=False
)
report = sm.fit(disk, found.outlines, "yeoh", options)
figure, axes = plt.subplots(figsize=(7, 4))
for colour, match in enumerate(report.photographs["yeoh"]):
    curve = (
        match.shadow.curve
    )  # quadratic pieces: distance from the axis, height
    simulated = (
        np.concatenate(
            [
                curve.at(piece, np.linspace(-1, 1, 9))[0]
                for piece in range(len(curve.nodes))
            ]
        )
        * 1e3
    )
    simulated = simulated[np.argsort(simulated[:, 0])]
    measured = match.points * 1e3
    axes.plot(
        (match.side * measured[:, 0])[::5],
        measured[::5, 1],
        "o",
        ms=4,
        mfc="none",
        color=f"C{colour}",
    )
    axes.plot(simulated[:, 0], simulated[:, 1], "k", lw=1)
    axes.plot(-simulated[:, 0], simulated[:, 1], "k", lw=1)
axes.set(
    xlabel="distance from the axis (mm)",
    ylabel="height (mm)",
    title="Outlines: points measured, lines fitted",
)
axes.set_xlim(-17, 17)
axes.set_ylim(-0.1, 4.3)
figure.savefig("fit_outlines.png", dpi=110)

low, high = report.chosen.interval("c1")
print(
    f"c1 between {low / 1e3:.2f} and {high / 1e3:.2f} kPa (95 %); it was 14 kPa"
)
assert low < 14e3 < high
