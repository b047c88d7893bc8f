"""A disk that is inflated against a rigid ball.

uv run python docs/examples/ball.py
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

ball = sm.RigidShape(
    "sphere", "top", at=(0.0, 0.0, 0.0265), radius=0.010, name="ball"
)
disk = sm.HollowDisk(section="axisymmetric")
run = sm.inflate(
    disk, "ecoflex-00-30/smooth-on", "0,60,120 cm", components=[ball]
)

section = run.last.grid.warp_by_vector("displacement").extract_surface(
    algorithm="dataset_surface"
)
solid = section.extrude_rotate(
    angle=270, resolution=90, rotation_axis=(0, 0, 1), capping=True
)
solid["von Mises stress (kPa)"] = solid["von_mises"] / 1e3
plotter = pv.Plotter(off_screen=True, window_size=(800, 560))
plotter.add_mesh(
    solid,
    scalars="von Mises stress (kPa)",
    cmap="viridis",
    lighting=False,
    scalar_bar_args=BAR,
)
plotter.add_mesh(
    pv.Sphere(radius=ball.radius, center=ball.at), color="silver", opacity=0.5
)
plotter.camera_position = [(0.08, -0.08, 0.05), (0, 0, 0.014), (0, 0, 1)]
plotter.screenshot("ball.png")

force = run.path["ball_force_z_N"]
print("force on the ball in N:", ", ".join(f"{value:.3f}" for value in force))
assert force[-1] > force[-2] >= 0
