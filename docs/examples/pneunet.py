"""A PneuNet finger whose chambers press on each other: half of it, cut open.

uv run python docs/examples/pneunet.py
"""

import pyvista as pv
import softmodels as sm

BAR = {
    "title": "von Mises (kPa)",
    "vertical": True,
    "n_labels": 3,
    "fmt": "%.0f",
    "position_x": 0.86,
}

finger = sm.PneuNet(cell_size=0.004)
run = sm.inflate(finger, "ecoflex-00-30/marechal-2021", pressures="0,4,8 cm")

half = run.last.grid.warp_by_vector("displacement")
half["von Mises stress (kPa)"] = half["von_mises"] / 1e3
plotter = pv.Plotter(off_screen=True, window_size=(800, 500))
plotter.add_mesh(
    half,
    scalars="von Mises stress (kPa)",
    cmap="viridis",
    clim=(0, 12),
    lighting=False,
    scalar_bar_args=BAR,
)
plotter.camera_position = [(0.02, -0.1, 0.03), (0.018, 0, 0.002), (0, 0, 1)]
plotter.screenshot("pneunet.png")

angle = run.path["bend_angle_deg"][-1]
print(f"the tip turns by {angle:.1f} degrees at 8 cm")
assert 22 < angle < 28
