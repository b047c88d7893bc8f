"""A tube in a fabric: stiff yarns around it hold its diameter, and it lengthens.

uv run python docs/examples/fabric.py
"""

import pyvista as pv
import softmodels as sm

BAR = {
    "title": "stretch",
    "vertical": True,
    "n_labels": 3,
    "fmt": "%.1f",
    "position_x": 0.8,
}

tube = sm.Cylinder()
silicone = sm.NeoHookean(30e3, poisson=0.49)
fabric = sm.Fabric("outer", along=50.0, across=5e3)
cases = {
    "plain": sm.inflate(tube, silicone, "0,60 cm"),
    "fabric": sm.inflate(tube, silicone, "0,60 cm", components=[fabric]),
}

plotter = pv.Plotter(off_screen=True, window_size=(800, 500), shape=(1, 2))
for place, (name, run) in enumerate(cases.items()):
    section = run.last.grid.warp_by_vector("displacement").extract_surface(
        algorithm="dataset_surface"
    )
    solid = section.extrude_rotate(
        angle=270, resolution=90, rotation_axis=(0, 0, 1), capping=True
    )
    plotter.subplot(0, place)
    plotter.add_text(f"{name}, 60 cm", font_size=10)
    plotter.add_mesh(
        solid,
        scalars="largest_stretch",
        cmap="viridis",
        clim=(1, 1.8),
        show_scalar_bar=place == 1,
        lighting=False,
        scalar_bar_args=BAR,
    )
    plotter.camera_position = [(0.12, -0.12, 0.1), (0, 0, 0.034), (0, 0, 1)]
plotter.screenshot("fabric.png")

plain, woven = (run.path["diameter_mm"][-1] for run in cases.values())
longer = cases["fabric"].path["elongation_percent"][-1]
print(
    f"diameter {plain:.1f} mm without, {woven:.1f} mm with the fabric, which lengthens the tube by {longer:.1f} %"
)
assert woven < 16.5 < plain
