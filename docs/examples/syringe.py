"""A disk on a pump with twenty litres of air: at the limit point of the stroke it snaps through.

uv run python docs/examples/syringe.py
"""

import matplotlib.pyplot as plt
import softmodels as sm

disk = sm.HollowDisk.variant("shadow", section="axisymmetric", support="base")
pump = sm.Syringe(syringe="1000 ml", dead_volume="20000 ml")
run = sm.inflate(
    disk, sm.NeoHookean(20e3, poisson=0.49), strokes="0:720 ml", supply=pump
)
stroke = run.path["stroke_ml"]
turn = int(run.path["stroke_limit"].argmax())
landed = int(run.path["jump"].argmax())

figure, axes = plt.subplots()
axes.plot(stroke, run.apex * 1e3, ".-", label="equilibrium")
axes.annotate(
    "",
    (stroke[landed], run.apex[landed] * 1e3),
    (stroke[turn], run.apex[turn] * 1e3),
    arrowprops={"arrowstyle": "->"},
)
axes.set(
    xlabel="stroke in ml",
    ylabel="rise of the apex in mm",
    title="A disk on a pump with 20 l of air",
)
axes.legend()
figure.savefig("syringe.png", dpi=150)

assert abs(stroke[turn] - 694.7) < 0.5, "the limit point of the stroke"
assert run.apex[landed] > 2 * run.apex[turn], (
    "it lands more than twice as high"
)
print(
    f"at a stroke of {stroke[turn]:.1f} ml it jumps from {run.apex[turn] * 1e3:.1f} to {run.apex[landed] * 1e3:.1f} mm"
)
