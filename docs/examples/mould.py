"""The mould of a disk: its bodies, apart along the pull, with the cast halves between.

uv run python docs/examples/mould.py
"""

import numpy as np
import pyvista as pv
import softmodels as sm

disk = sm.HollowDisk.variant("shadow", section="axisymmetric")
mould = sm.mould(disk, silicone="ecoflex-00-30", chord="0.1 mm")

bodies = {body.name: body.facets for body in (*mould.bodies, *mould.casts)}
plotter = pv.Plotter(off_screen=True, window_size=(800, 800))
top = 0.0
for name in (
    "lower cup",
    "lower cast",
    "lower lid",
    "upper lid",
    "upper cast",
    "upper cup",
):
    facets = bodies[name]
    points = facets.points * (
        1 if name.startswith("upper") else (1, -1, -1)
    )  # a piece lies above its lid
    faces = np.insert(facets.triangles, 0, 3, axis=1)
    points = points + np.array([0, 0, top - points[:, 2].min()])
    plotter.add_mesh(
        pv.PolyData(points, faces),
        color="#e8b796" if name.endswith("cast") else "#b4c3d4",
    )
    top = points[:, 2].max() + 12
plotter.camera_position = [(180, -260, 200), (0, 0, top / 2), (0, 0, 1)]
plotter.screenshot("mould.png")

print(
    f"{mould.volume * 1e6:.1f} ml of silicone, thinnest wall {mould.thinnest * 1e3:.2f} mm"
)
assert mould.differs < 1e-6
