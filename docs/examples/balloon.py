"""A balloon on a neck, inflated by volume past its limit point.

uv run python docs/examples/balloon.py
"""

import pyvista as pv
import softmodels as sm

BAR = {
    "title": "stretch",
    "vertical": True,
    "n_labels": 3,
    "fmt": "%.1f",
    "position_x": 0.83,
}

balloon = sm.Balloon()
run = sm.inflate(balloon, sm.NeoHookean(30e3), volumes="0,20,40 ml")

plotter = pv.Plotter(off_screen=True, window_size=(900, 420), shape=(1, 3))
for place, volume in enumerate(("0 ml", "20 ml", "40 ml")):
    section = (
        run.at(volume)
        .grid.warp_by_vector("displacement")
        .extract_surface(algorithm="dataset_surface")
    )
    solid = section.extrude_rotate(
        angle=270, resolution=90, rotation_axis=(0, 0, 1), capping=True
    )
    plotter.subplot(0, place)
    plotter.add_text(volume, font_size=10)
    plotter.add_mesh(
        solid,
        scalars="largest_stretch",
        cmap="viridis",
        clim=(1, 2.2),
        show_scalar_bar=place == 0,
        lighting=False,
        scalar_bar_args=BAR,
    )
    plotter.camera_position = [(0.11, -0.11, 0.08), (0, 0, 0.022), (0, 0, 1)]
plotter.screenshot("balloon.png")

assert run.pressure.max() > run.pressure[-1], (
    "past the limit point the pressure falls"
)
print(
    f"largest pressure {run.pressure.max():.0f} Pa, at 40 ml {run.pressure[-1]:.0f} Pa"
)
