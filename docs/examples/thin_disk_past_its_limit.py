"""A thin disk under volume control, past its limit point: pressure against added volume.

uv run python docs/examples/thin_disk_past_its_limit.py
"""

import matplotlib.pyplot as plt
import numpy as np
import softmodels as sm

disk = sm.HollowDisk.variant("shadow", section="axisymmetric", support="base")
silicone = sm.NeoHookean(20e3, poisson=0.49)

run = sm.inflate(disk, silicone, volumes="0:60:5 ml")
limit = sm.limit(disk, silicone)

figure, axes = plt.subplots()
axes.plot(run.added_volume * 1e6, run.pressure / 1e3, ".-", label="states")
axes.plot(
    limit.added_volume * 1e6,
    limit.pressure / 1e3,
    "o",
    mfc="none",
    ms=10,
    label="limit point",
)
axes.set(
    xlabel="added volume in ml",
    ylabel="pressure in kPa",
    title="A thin disk under volume control",
)
axes.legend()
figure.savefig("thin_disk_past_its_limit.png", dpi=150)

assert np.isclose(limit.pressure, 3311.5, rtol=1e-3), "34.81 cm of water"
assert run.pressure.max() <= limit.pressure * (1 + 1e-6), (
    "no state lies above the limit point"
)
assert run.pressure[-1] < 0.95 * limit.pressure, "past it the pressure falls"
print(
    f"limit point at {limit.pressure:.1f} Pa, where the cavity has taken {limit.added_volume * 1e6:.2f} ml"
)
