"""Fit two laws to a tensile curve of a test machine: which one the data prefer, and its confidence interval.

uv run python docs/examples/fit_a_curve.py
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import softmodels as sm
from softmodels.materials.specimens import respond

truth = sm.Yeoh(9e3, 120.0, poisson=0.5)
stretch = np.linspace(1.02, 3.5, 120)
exact = respond(truth, stretch).stress
measured = exact * (
    1 + 0.01 * np.random.default_rng(7).standard_normal(len(exact))
)
rows = [
    f"{L:.5f},{s / 1e3:.5f}" for L, s in zip(stretch, measured, strict=True)
]
Path("strip.csv").write_text(
    "\n".join(["stretch,nominal stress (kPa)", *rows])
)

report = sm.fit_curves("strip.csv", ("neo-hookean", "yeoh"))
best = report.chosen
low, high = best.interval("c1")

figure, axes = plt.subplots()
axes.plot(stretch, measured / 1e3, ".", color="grey", label="measured")
for fitted in report.laws:
    axes.plot(
        stretch,
        respond(fitted.material, stretch).stress / 1e3,
        label=fitted.choice.name,
    )
axes.set(
    xlabel="stretch",
    ylabel="nominal stress in kPa",
    title="One strip, two laws",
)
axes.legend()
figure.savefig("fit_a_curve.png", dpi=150)

c1 = best.fit.values["c1"]
print(
    f"{best.choice.name}: c1 = {c1 / 1e3:.2f} kPa, 95 % {low / 1e3:.2f} to {high / 1e3:.2f} kPa; it was 9 kPa"
)
assert best.choice.name == "yeoh"
assert abs(c1 - 9e3) < 0.01 * 9e3
