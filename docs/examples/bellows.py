"""The round bellows at rest and at 20 cm of water.

uv run python docs/examples/bellows.py
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

run = sm.inflate(sm.Bellows(), sm.NeoHookean(30e3), pressures="0,10,20 cm")

plotter = pv.Plotter(off_screen=True, window_size=(800, 500), shape=(1, 2))
for place, pressure in enumerate(("0 cm", "20 cm")):
    section = (
        run.at(pressure)
        .grid.warp_by_vector("displacement")
        .extract_surface(algorithm="dataset_surface")
    )
    solid = section.extrude_rotate(
        angle=270, resolution=90, rotation_axis=(0, 0, 1), capping=True
    )
    plotter.subplot(0, place)
    plotter.add_text(pressure, font_size=10)
    plotter.add_mesh(
        solid,
        scalars="largest_stretch",
        cmap="viridis",
        clim=(1, 1.6),
        show_scalar_bar=place == 1,
        lighting=False,
        scalar_bar_args=BAR,
    )
    plotter.camera_position = [(0.1, -0.1, 0.09), (0, 0, 0.028), (0, 0, 1)]
plotter.screenshot("bellows.png")

rise = run.rise[-1]
print(f"the upper plate rises {rise * 1e3:.2f} mm at 20 cm")
assert abs(rise - 23.9e-3) < 0.2e-3
