"""Rise of a disk against the thickness of its membrane: a study is a loop.

uv run python docs/examples/membrane_thickness.py
"""

import matplotlib.pyplot as plt
import numpy as np

import softmodels as sm

silicone = sm.silicone("dragon-skin-20")
thicknesses = np.linspace(1.5e-3, 4e-3, 6)

figure, axes = plt.subplots()
rises = []
for membrane in thicknesses:
    disk = sm.HollowDisk(section="axisymmetric", membrane=membrane)
    run = sm.inflate(disk, silicone, pressures="0:100 cm")
    rises.append(run.apex[-1])
    axes.plot(run.pressure / 1e3, run.apex * 1e3, label=f"{membrane * 1e3:.1f} mm")
axes.set(xlabel="pressure in kPa", ylabel="rise of the apex in mm", title="Membranes of Dragon Skin 20")
axes.legend(title="membrane")
figure.savefig("membrane_thickness.png", dpi=150)

assert np.all(np.diff(rises) < 0), "a thicker membrane rises less"
assert np.isclose(np.interp(2e-3, thicknesses, rises), 2.352e-3, rtol=1e-3)
print(f"from {rises[0] * 1e3:.2f} mm at 1.5 mm to {rises[-1] * 1e3:.2f} mm at 4 mm")
