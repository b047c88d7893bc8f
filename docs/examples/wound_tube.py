"""A tube wound with thread: the angle of the thread decides whether it lengthens or shortens.

uv run python docs/examples/wound_tube.py
"""

import matplotlib.pyplot as plt
import numpy as np
import softmodels as sm

tube = sm.Cylinder()
silicone = sm.NeoHookean(30e3, poisson=0.49)
angles = np.array([35.0, 45.0, 54.7, 65.0, 75.0, 85.0])

figure, axes = plt.subplots()
last = []
for angle in angles:
    thread = sm.Fibres(on="outer", angle=angle, stiffness=10e3)
    run = sm.inflate(
        tube, silicone, pressures="0:100:25 cm", components=[thread]
    )
    last.append(run.path["elongation_percent"][-1])
    axes.plot(
        run.pressure / 1e3,
        run.path["elongation_percent"],
        ".-",
        label=f"{angle:g} deg",
    )
axes.set(
    xlabel="pressure (kPa)",
    ylabel="elongation (%)",
    title="A tube wound with thread of 10 kN/m",
)
axes.legend(title="angle from the axis")
figure.savefig("wound_tube.png", dpi=110)

print(
    "elongation in % at 100 cm:",
    ", ".join(
        f"{angle:g} deg {value:.1f}"
        for angle, value in zip(angles, last, strict=True)
    ),
)
assert np.all(np.diff(last) > 0) and abs(last[4] - 15.9) < 0.1
