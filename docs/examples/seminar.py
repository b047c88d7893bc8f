"""The seminar actuator on a coarse mesh: half a slab, cut through its middle.

uv run python docs/examples/seminar.py
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

slab = sm.SeminarActuator(around=6, cell_size=0.006)
run = sm.inflate(
    slab, "ecoflex-00-30/marechal-2021", pressures="0,70,130,177 cm"
)

plotter = pv.Plotter(off_screen=True, window_size=(800, 420))
plotter.add_mesh(
    run.at("0 cm").grid.extract_surface(algorithm="dataset_surface"),
    color="grey",
    opacity=0.25,
)
half = (
    run.at("177 cm")
    .grid.warp_by_vector("displacement")
    .extract_surface(algorithm="dataset_surface")
)
half["von Mises stress (kPa)"] = half["von_mises"] / 1e3
plotter.add_mesh(
    half,
    scalars="von Mises stress (kPa)",
    cmap="viridis",
    clim=(0, 40),
    lighting=False,
    scalar_bar_args=BAR,
)
plotter.camera_position = [(0.09, -0.1, 0.05), (0.036, 0, 0.002), (0, 0, 1)]
plotter.screenshot("seminar.png")

tip = run.path["tip_z_mm"][-1]
print(f"tip at z = {tip:.2f} mm at 177 cm")
assert abs(tip - 14.34) < 0.1
