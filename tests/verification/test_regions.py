"""Two materials bonded in one body: closed forms, and one material cut in two."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.integrate import quad

from geometries.fields import length_field
from softmodels.case.region import Region
from softmodels.materials.laws import NeoHookean, Yeoh
from softmodels.mechanics.body import Body
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from softmodels.results.fields import Fields

SOFT, HARD = NeoHookean(30e3, 0.5), Yeoh(60e3, 2e3, 100.0, 0.5)
SPHERE = "closed integrals of a sphere of two layers, radii 10, 12 and 15 mm, inner stretch to 1.8"
TUBE = "closed integrals of a tube of two layers, radii 10, 12 and 15 mm, inner stretch to 1.8"
SAME = "one region, cut in two of one material"
STRETCHES = np.array([1.1, 1.4, 1.8])


def add_group(dimension, tags, name):
    import gmsh

    tag = 4 if name == "cavity" else 10 + len(gmsh.model.getPhysicalGroups())
    gmsh.model.addPhysicalGroup(dimension, tags, tag, name)


@pytest.fixture(scope="module")
def layered(bodies):
    """Sphere and tube of two layers: the main one inside, ``shell`` around it."""

    @dataclasses.dataclass(frozen=True, kw_only=True)
    class LayeredSphere(bodies.Sphere):
        between: float = length_field(0.012, "radius of the interface")
        regions = ("shell",)

        def build(self):
            import gmsh

            geo, mesh = gmsh.model.geo, gmsh.model.geo.mesh
            centre = geo.addPoint(0, 0, 0)
            radii = (self.inner, self.between, self.outer)
            low, high = ([geo.addPoint(*place) for place in places] for places in
                         ([(r, 0, 0) for r in radii], [(0, r, 0) for r in radii]))  # fmt: skip
            arcs = [geo.addCircleArc(a, centre, b) for a, b in zip(low, high, strict=True)]
            equator, axis = ([geo.addLine(ends[i], ends[i + 1]) for i in range(2)] for ends in (low, high))
            faces = [
                geo.addPlaneSurface([geo.addCurveLoop([equator[i], arcs[i + 1], -axis[i], -arcs[i]])]) for i in range(2)
            ]
            for curve in (*equator, *axis):
                mesh.setTransfiniteCurve(curve, round(self.through) + 1)
            for curve in arcs:
                mesh.setTransfiniteCurve(curve, round(self.along) + 1)
            for face in faces:
                mesh.setTransfiniteSurface(face)
            geo.synchronize()
            add_group(2, [faces[0]], "solid")
            add_group(2, [faces[1]], "shell")
            for curves, name in ((equator, "equator"), (axis, "axis"), (arcs[:1], "cavity"), (arcs[2:], "outer")):
                add_group(1, curves, name)

    @dataclasses.dataclass(frozen=True, kw_only=True)
    class LayeredTube(bodies.Tube):
        between: float = length_field(0.012, "radius of the interface")
        regions = ("shell",)

        def build(self):
            import gmsh

            occ, mesh = gmsh.model.occ, gmsh.model.mesh
            inside = occ.addRectangle(self.inner, 0, 0, self.between - self.inner, self.height)
            outside = occ.addRectangle(self.between, 0, 0, self.outer - self.between, self.height)
            occ.fragment([(2, inside)], [(2, outside)])
            occ.synchronize()
            groups = {"plane2": [], "top": [], "cavity": [], "outer": []}
            for _, curve in gmsh.model.getEntities(1):
                low, high = np.array(gmsh.model.getBoundingBox(1, curve)).reshape(2, 3)
                flat = high[0] - low[0] < 1e-6
                mesh.setTransfiniteCurve(curve, round(self.along if flat else self.through) + 1)
                if not flat:
                    groups["plane2" if high[1] < 1e-6 else "top"].append(curve)
                elif abs(low[0] - self.between) > 1e-5:
                    groups["cavity" if low[0] < self.between else "outer"].append(curve)
            for _, face in gmsh.model.getEntities(2):
                mesh.setTransfiniteSurface(face)
            add_group(2, [inside], "solid")
            add_group(2, [outside], "shell")
            for name, curves in groups.items():
                add_group(1, curves, name)

    return {"sphere": LayeredSphere(through=3, along=12), "tube": LayeredTube(through=3)}


def slope(law, stretch, mode):
    """W' of equibiaxial (3) or planar (2) tension, of a law in I1."""
    if mode == 3:
        I1, by_stretch = 2 * stretch**2 + stretch**-4, 4 * stretch - 4 * stretch**-5
    else:
        I1, by_stretch = stretch**2 + stretch**-2 + 1, 2 * stretch - 2 * stretch**-3
    if isinstance(law, NeoHookean):
        return law.shear_modulus / 2 * by_stretch
    return (law.c1 + 2 * law.c2 * (I1 - 3) + 3 * law.c3 * (I1 - 3) ** 2) * by_stretch


def exact(device, laws, stretch, mode):
    """Pressure of incompressible layers: int W'/(l^m - 1) dl over each of them."""

    def at(radius):
        return (1 + (stretch**mode - 1) * (device.inner / radius) ** mode) ** (1 / mode)

    walls = [at(radius) for radius in (device.inner, device.between, device.outer)]
    return sum(
        quad(lambda x, law=law: slope(law, x, mode) / (x**mode - 1), walls[i + 1], walls[i], epsrel=1e-11)[0]
        for i, law in enumerate(laws)
    )


@pytest.mark.parametrize(("name", "mode", "against"), [("sphere", 3, SPHERE), ("tube", 2, TUBE)])
def test_two_layers(name, mode, against, layered, body_of, tube_body, solved, figure):
    device = layered[name]
    body = body_of(device, tube_body if name == "tube" else Body)
    for laws in ((SOFT, HARD), (HARD, SOFT)):
        equations = Solver(System(body, laws[0], parts=[Region(laws[1], name="shell")]))
        rest = equations.system.rest().V
        _, points, end = solved(equations, [(s**mode - 1) * rest for s in STRETCHES], "volume", "volume")
        assert end is None
        found = [point.state.P * equations.system.stress_unit for point in points if point.requested]
        known = [exact(device, laws, stretch, mode) for stretch in STRETCHES]
        figure(against, "pressure on the section, soft inside and outside", np.array(found) / known - 1, 1e-4)
    assert all(point.signature.negative_eigenvalues == 0 for point in points[:2])
    check_values(equations, points[-1].state, laws, figure, against)


def check_values(equations, state, laws, figure, against):
    """Each region's stress is of its own law: on the walls the integration points' von Mises stress has a closed form."""
    fields = Fields(equations)
    values = fields.values(state)
    found = np.empty(values.von_mises.shape)
    for region, law in zip(equations.system.potential.regions, laws, strict=True):
        stretch = values.stretches[region.cells]
        mode = 3 if against == SPHERE else 2
        found[region.cells] = stretch[..., 2] * slope(law, stretch[..., 2], mode) / (2 if mode == 3 else 1)
    scale = found.max()
    off = (values.von_mises - found) / scale if against == SPHERE else 0.0
    figure(against, "von Mises stress at the integration points of both layers", off, 3e-2)
    p = values.p
    assert np.isfinite(p).all() and fields.figures(state).stored_energy > 0
