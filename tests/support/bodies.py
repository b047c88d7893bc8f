"""Bodies whose behaviour is known in closed form."""

from __future__ import annotations

import dataclasses
import math
from collections import defaultdict

import numpy as np

from geometries import Actuator, CutPlane, Hold
from softmodels.common.schema import choice_field, length_field, number_field


@dataclasses.dataclass(frozen=True, kw_only=True)
class Plain(Actuator):
    """An actuator that is only what the mechanics asks for: no camera, no checks."""

    @property
    def mesh_order(self):
        return 2

    @property
    def copies(self):
        return 1

    @property
    def holds(self):
        return ()

    @property
    def probes(self):
        return {}

    @property
    def cavity_volume(self):
        return math.nan

    @property
    def solid_volume(self):
        return math.nan

    def on_profile(self, points):
        return np.zeros(len(points), dtype=bool)

    def check(self):
        pass


def _group(dimension, tags, name):
    import gmsh

    # Compiled forms carry the cavity's tag: that of the default hollow disk lets all bodies share them.
    tag = 4 if name == "cavity" else 10 + len(gmsh.model.getPhysicalGroups())
    gmsh.model.addPhysicalGroup(dimension, tags, tag, name)


def _octant_planes():
    return tuple(CutPlane(f"plane{i}", tuple(-1.0 if k == i else 0.0 for k in range(3))) for i in range(3))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Sphere(Plain):
    """Upper half of a spherical shell as an axisymmetric quarter ring, ``through`` x ``along`` cells, each two triangles."""

    inner: float = length_field(0.010, "inner radius")
    outer: float = length_field(0.015, "outer radius")
    through: float = number_field(2, "cells through the wall")
    along: float = number_field(6, "cells from the equator to the pole")

    dimension = 2

    @property
    def size(self):
        return self.inner

    @property
    def cut_planes(self):
        return (CutPlane("equator", (0.0, 0.0, -1.0)),)

    @property
    def holds(self):
        return (Hold("axis", (1.0, 0.0, 0.0)),)

    @property
    def cavity_volume(self):
        return 2 / 3 * math.pi * self.inner**3

    def build(self):
        import gmsh

        geo, mesh = gmsh.model.geo, gmsh.model.geo.mesh
        centre = geo.addPoint(0, 0, 0)
        a, b = geo.addPoint(self.inner, 0, 0), geo.addPoint(self.outer, 0, 0)
        c, d = geo.addPoint(0, self.outer, 0), geo.addPoint(0, self.inner, 0)
        equator, outside = geo.addLine(a, b), geo.addCircleArc(b, centre, c)
        axis, inside = geo.addLine(c, d), geo.addCircleArc(d, centre, a)
        face = geo.addPlaneSurface([geo.addCurveLoop([equator, outside, axis, inside])])
        for curves, cells in (((equator, axis), self.through), ((outside, inside), self.along)):
            for curve in curves:
                mesh.setTransfiniteCurve(curve, round(cells) + 1)
        mesh.setTransfiniteSurface(face)
        geo.synchronize()
        _group(2, [face], "solid")
        for curve, name in ((equator, "equator"), (axis, "axis"), (inside, "cavity"), (outside, "outer")):
            _group(1, [curve], name)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Octant(Plain):
    """One eighth of a spherical shell in three dimensions, tetrahedra."""

    inner: float = length_field(0.010, "inner radius")
    outer: float = length_field(0.015, "outer radius")
    cell_size: float = length_field(0.004, "edge length")

    dimension = 3
    copies = 8

    @property
    def size(self):
        return self.inner

    @property
    def cut_planes(self):
        return _octant_planes()

    @property
    def cavity_volume(self):
        return 4 / 3 * math.pi * self.inner**3

    def build(self):
        import gmsh

        occ = gmsh.model.occ
        half = math.pi / 2
        whole = occ.addSphere(0, 0, 0, self.outer, angle1=0, angle2=half, angle3=half)
        hole = occ.addSphere(0, 0, 0, self.inner, angle1=0, angle2=half, angle3=half)
        solid, _ = occ.cut([(3, whole)], [(3, hole)])
        occ.synchronize()
        _group(3, [tag for _, tag in solid], "solid")
        for _, face in gmsh.model.getEntities(2):
            points = _corner_coordinates(face)
            flat = [i for i in range(3) if np.abs(points[:, i]).max() < 1e-9]
            radius = np.linalg.norm(points, axis=1)
            name = f"plane{flat[0]}" if flat else "cavity" if radius.max() < 1.001 * self.inner else "outer"
            _group(2, [face], name)
        gmsh.model.mesh.setSizeCallback(lambda *args: self.cell_size)


def _corner_coordinates(tag, dimension=2):
    import gmsh

    corners = gmsh.model.getBoundary([(dimension, tag)], recursive=True)
    return np.array([gmsh.model.getValue(0, tag, []) for _, tag in corners])


@dataclasses.dataclass(frozen=True, kw_only=True)
class Tube(Plain):
    """A slice of an endless tube between two planes that hold it: axisymmetric, or a quarter in three dimensions."""

    inner: float = length_field(0.010, "inner radius")
    outer: float = length_field(0.015, "outer radius")
    height: float = length_field(0.002, "height of the slice")
    through: float = number_field(4, "cells through the wall")
    along: float = number_field(1, "cells along the height")
    pressed: str = choice_field("inside", ("inside", "outside"), "face that the pressure acts on")
    section: str = choice_field("axisymmetric", ("axisymmetric", "quarter"), "half section, or a quarter in 3-D")

    @property
    def dimension(self):
        return 3 if self.section == "quarter" else 2

    @property
    def size(self):
        return self.inner

    @property
    def cut_planes(self):
        return _octant_planes() if self.dimension == 3 else (CutPlane("plane2", (0.0, 0.0, -1.0)),)

    @property
    def holds(self):
        return (Hold("top", (0.0, 0.0, 1.0)),)

    @property
    def cavity_volume(self):
        whole = math.pi * (self.inner if self.pressed == "inside" else self.outer) ** 2 * self.height
        return whole if self.dimension == 2 else whole / 4  # a quarter with no copies

    def build(self):
        import gmsh

        occ, mesh = gmsh.model.occ, gmsh.model.mesh
        if self.dimension == 2:
            face = occ.addRectangle(self.inner, 0, 0, self.outer - self.inner, self.height)
            occ.synchronize()
            bottom, outside, top, inside = (tag for _, tag in gmsh.model.getBoundary([(2, face)], oriented=False))
            for curve in (bottom, top):
                mesh.setTransfiniteCurve(curve, round(self.through) + 1)
            for curve in (inside, outside):
                mesh.setTransfiniteCurve(curve, round(self.along) + 1)
            mesh.setTransfiniteSurface(face)
            _group(2, [face], "solid")
            for curve, name in ((bottom, "plane2"), (outside, "outer"), (top, "top"), (inside, "cavity")):
                _group(1, [curve], name)
            return
        whole, hole = (occ.addCylinder(0, 0, 0, 0, 0, self.height, r, angle=math.pi / 2) for r in (self.outer, self.inner))
        cut, _ = occ.cut([(3, whole)], [(3, hole)])
        occ.synchronize()
        _group(3, [tag for _, tag in cut], "solid")
        for _, face in gmsh.model.getEntities(2):
            points = _corner_coordinates(face)
            flat = [f"plane{i}" for i in range(3) if np.abs(points[:, i]).max() < 1e-9]
            flat += ["top"] if np.abs(points[:, 2] - self.height).max() < 1e-9 else []
            inside = np.linalg.norm(points[:, :2], axis=1).max() < 1.001 * self.inner
            pressed = inside == (self.pressed == "inside")
            _group(2, [face], flat[0] if flat else "cavity" if pressed else "outer")
        size = (self.outer - self.inner) / self.through
        mesh.setSizeCallback(lambda *args: size)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Block(Plain):
    """A cube of edge ``edge`` on three planes through its corner, or a cylinder as high as its radius.

    The pressure acts on the faces away from the planes, so the "cavity" is the world outside and its volume minus the
    block's own.
    """

    edge: float = length_field(0.010, "edge length")
    section: str = choice_field("cube", ("cube", "axisymmetric"), "cube or cylinder")
    cells: float = number_field(2, "cells per edge")

    @property
    def dimension(self):
        return 3 if self.section == "cube" else 2

    @property
    def size(self):
        return self.edge

    @property
    def cut_planes(self):
        return _octant_planes() if self.dimension == 3 else (CutPlane("plane2", (0.0, 0.0, -1.0)),)

    @property
    def holds(self):
        return () if self.dimension == 3 else (Hold("plane0", (1.0, 0.0, 0.0)),)

    def build(self):
        import gmsh

        occ = gmsh.model.occ
        if self.dimension == 3:
            occ.addBox(0, 0, 0, self.edge, self.edge, self.edge)
        else:
            occ.addRectangle(0, 0, 0, self.edge, self.edge)
        occ.synchronize()
        top = self.dimension
        _group(top, [1], "solid")
        # A cylinder's height is the mesh's second direction and the device's third.
        names = {0: "plane0", 1: "plane1" if top == 3 else "plane2", 2: "plane2"}
        faces = {}
        for _, face in gmsh.model.getEntities(top - 1):
            box = np.array(gmsh.model.getBoundingBox(top - 1, face)).reshape(2, 3)
            flat = [names[i] for i in range(top) if np.abs(box[:, i]).max() < 1e-6]
            faces.setdefault(flat[0] if flat else "cavity", []).append(face)
        for name, tags in faces.items():
            _group(top - 1, tags, name)
        gmsh.model.mesh.setSizeCallback(lambda *args: self.edge / self.cells)


@dataclasses.dataclass(frozen=True, kw_only=True)
class HeldBlock(Plain):
    """The unit cube: "cavity" at x = 0 is pressed, the faces along x are "sides" and held, "free" is at x = -1."""

    edge: float = length_field(1.0, "edge")
    cells: float = number_field(4, "cells along an edge")

    dimension = 3
    mesh_order = 1
    cut_planes = ()
    holds = (Hold("sides", None),)
    chamber_volume = 1.0

    @property
    def size(self):
        return self.edge

    def build(self):
        import gmsh

        gmsh.model.occ.addBox(-self.edge, 0, 0, self.edge, self.edge, self.edge)
        gmsh.model.occ.synchronize()
        _group(3, [1], "solid")
        faces = {"cavity": [], "free": [], "sides": []}
        for _, face in gmsh.model.getEntities(2):
            along = _corner_coordinates(face)[:, 0]
            faces["sides" if np.ptp(along) > 1e-3 else "cavity" if along[0] > -0.5 else "free"].append(face)
        for name, found in faces.items():
            _group(2, found, name)
        gmsh.model.mesh.setSizeCallback(lambda *args: self.edge / self.cells)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Plate(Plain):
    """A plate that keeps its width, pushed together along x: a platen at x = 0 and the pressed one, the "cavity"."""

    length: float = length_field(0.050, "length")
    thickness: float = length_field(0.010, "thickness")
    cell_size: float = length_field(0.0025, "edge length")

    dimension = 3

    @property
    def size(self):
        return self.thickness

    @property
    def cut_planes(self):
        return (CutPlane("plane0", (-1.0, 0.0, 0.0)), CutPlane("plane2", (0.0, 0.0, -1.0)))

    @property
    def holds(self):
        return (Hold("front", (0.0, 0.0, 1.0)), Hold("edge", (0.0, 1.0, 0.0)))

    @property
    def cavity_volume(self):
        return self.length * self.thickness * self.cell_size  # the room that the platen can take away

    def build(self):
        import gmsh

        gmsh.model.occ.addBox(0, 0, 0, self.length, self.thickness, self.cell_size)
        gmsh.model.occ.synchronize()
        _group(3, [1], "solid")
        self.name_faces(gmsh.model.getEntities(2))

    def name_faces(self, faces):
        """Name the faces outside, and the edge that is held across."""
        import gmsh

        places = {"plane0": (0, 0.0), "cavity": (0, self.length), "plane2": (2, 0.0), "front": (2, self.cell_size)}
        groups = {}
        for _, face in faces:
            points = _corner_coordinates(face)
            flat = [name for name, (axis, at) in places.items() if np.abs(points[:, axis] - at).max() < 1e-9]
            groups.setdefault(flat[0] if flat else "outer", []).append(face)
        for name, faces in groups.items():
            _group(2, faces, name)
        for _, edge in gmsh.model.getEntities(1):
            if np.abs(_corner_coordinates(edge, 1)[:, :2]).max() < 1e-9:
                _group(1, [edge], "edge")
        gmsh.model.mesh.setSizeCallback(lambda *args: self.cell_size)


@dataclasses.dataclass(frozen=True, kw_only=True)
class LayeredSphere(Sphere):
    """The section of a sphere of two layers: the main material inside, the region ``shell`` around it."""

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
        faces = [geo.addPlaneSurface([geo.addCurveLoop([equator[i], arcs[i + 1], -axis[i], -arcs[i]])]) for i in range(2)]
        for curve in (*equator, *axis):
            mesh.setTransfiniteCurve(curve, round(self.through) + 1)
        for curve in arcs:
            mesh.setTransfiniteCurve(curve, round(self.along) + 1)
        for face in faces:
            mesh.setTransfiniteSurface(face)
        geo.synchronize()
        _group(2, [faces[0]], "solid")
        _group(2, [faces[1]], "shell")
        for curves, name in ((equator, "equator"), (axis, "axis"), (arcs[:1], "cavity"), (arcs[2:], "outer")):
            _group(1, curves, name)


@dataclasses.dataclass(frozen=True, kw_only=True)
class LayeredTube(Tube):
    """The section of a tube of two layers, as `LayeredSphere`."""

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
        _group(2, [inside], "solid")
        _group(2, [outside], "shell")
        for name, curves in groups.items():
            _group(1, curves, name)


@dataclasses.dataclass(frozen=True, kw_only=True)
class LayeredPlate(Plate):
    """A `Plate` whose upper half is the region ``upper``."""

    regions = ("upper",)

    def build(self):
        import gmsh

        occ, half = gmsh.model.occ, 0.5 * self.thickness
        boxes = [occ.addBox(0, i * half, 0, self.length, half, self.cell_size) for i in range(2)]
        occ.fragment([(3, boxes[0])], [(3, boxes[1])])
        occ.synchronize()
        _group(3, boxes[:1], "solid")
        _group(3, boxes[1:], "upper")
        self.name_faces(gmsh.model.getBoundary([(3, box) for box in boxes], combined=True, oriented=False))


@dataclasses.dataclass(frozen=True, kw_only=True)
class CutBlock(Block):
    """The section of a cylinder as high as its radius, cut on a slant: below the main material, above the region ``lid``."""

    section: str = choice_field("axisymmetric", ("axisymmetric",), "cylinder")
    regions = ("lid",)

    def build(self):
        import gmsh

        geo, e = gmsh.model.geo, self.edge
        places = [(0, 0), (e, 0), (e, 0.7 * e), (e, e), (0, e), (0, 0.3 * e)]
        points = [geo.addPoint(x, z, 0) for x, z in places]
        lines = [geo.addLine(points[i], points[(i + 1) % 6]) for i in range(6)]
        cut = geo.addLine(points[2], points[5])
        below = geo.addPlaneSurface([geo.addCurveLoop([lines[0], lines[1], cut, lines[5]])])
        above = geo.addPlaneSurface([geo.addCurveLoop([lines[2], lines[3], lines[4], -cut])])
        geo.synchronize()
        _group(2, [below], "solid")
        _group(2, [above], "lid")
        for tags, name in (
            ([lines[4], lines[5]], "plane0"),
            ([lines[0]], "plane2"),
            ([lines[1], lines[2], lines[3]], "cavity"),
        ):
            _group(1, tags, name)
        gmsh.model.mesh.setSizeCallback(lambda *args: self.edge / self.cells)


@dataclasses.dataclass(frozen=True, kw_only=True)
class TwoBlocks(Plain):
    """Two cylinders on each other as an axisymmetric section, with cells of their own that do not match; or as a quarter two
    boxes. The lower one is held, the upper one pressed on its lid."""

    below: float = length_field(0.004, "edge length of the lower one's cells")
    above: float = length_field(0.0027, "edge length of the upper one's cells")
    wide: float = length_field(0.010, "radius, or half the width")
    section: str = choice_field("axisymmetric", ("axisymmetric", "quarter"), "half section, or a quarter in 3-D")

    copies = 1
    size = 0.010
    bodies = (("lower",), ("upper",))
    regions = ("lower", "upper")
    faces = ("lid", "skin", "rest")
    holds = (Hold("support", (0.0, 0.0, 1.0)),)
    unbonded = None
    ratios = ()

    @property
    def dimension(self):
        return 3 if self.section == "quarter" else 2

    @property
    def cut_planes(self):
        return _octant_planes()[:2] if self.dimension == 3 else (CutPlane("plane0", (-1.0, 0.0, 0.0)),)

    @property
    def solid_volume(self):
        return (math.pi if self.dimension == 2 else 1.0) * self.wide**2 * 0.02

    def build(self):
        import gmsh

        occ, d, a = gmsh.model.occ, self.dimension, self.wide
        if d == 2:
            tags = [occ.addRectangle(0, -0.01, 0, a, 0.01), occ.addRectangle(0, 0, 0, a, 0.01)]
        else:
            tags = [occ.addBox(0, 0, -0.01, a, a, 0.01), occ.addBox(0, 0, 0, a, a, 0.01)]
        occ.synchronize()
        names = defaultdict(list)
        for tag, region in zip(tags, ("lower", "upper"), strict=True):
            _group(d, [tag], region)
            for _, face in gmsh.model.getBoundary([(d, tag)], oriented=False):
                low, high = np.array(gmsh.model.getBoundingBox(d - 1, face)).reshape(2, 3)
                flat = [i for i in range(d) if high[i] - low[i] < 1e-5]
                axis, at = flat[0], float(low[flat[0]])
                cut = abs(at) < 1e-5 and axis < d - 1
                top, bottom = axis == d - 1 and at > 0.009, axis == d - 1 and at < -0.009
                names[f"plane{axis}" if cut else "lid" if top else "support" if bottom
                      else "rest" if region == "lower" else "skin"].append(face)  # fmt: skip
        for name, faces in names.items():
            _group(d - 1, faces, name)
        gmsh.model.mesh.setSizeCallback(
            lambda dim, tag, x, y, z, other: self.above if (y if d == 2 else z) > 1e-9 else self.below
        )


@dataclasses.dataclass(frozen=True, kw_only=True)
class TwoBalls(Plain):
    """Halves of two balls that touch in a point, as an axisymmetric section, fine around it."""

    radius: float = length_field(0.010, "radius")
    other: float = length_field(0.010, "radius of the upper one")
    fine: float = length_field(10e-6, "edge length of the cells where they touch")

    dimension = 2
    copies = 1
    size = 0.010
    cut_planes = ()
    bodies = (("lower",), ("upper",))
    regions = ("lower", "upper")
    faces = ("lid", "skin", "rest")
    holds = (Hold("support", (0.0, 0.0, 1.0)), Hold("axis", (1.0, 0.0, 0.0)))
    unbonded = None
    ratios = ()

    @property
    def solid_volume(self):
        return 2 / 3 * math.pi * (self.radius**3 + self.other**3)

    def build(self):
        import gmsh

        occ, roles = gmsh.model.occ, defaultdict(list)
        for region, r, sign, flat, skin in (
            ("lower", self.radius, -1, "support", "rest"),
            ("upper", self.other, 1, "lid", "skin"),
        ):
            centre, pole, rim = (occ.addPoint(*at, 0) for at in ((0, sign * r), (0, 0), (r, sign * r)))
            curves = [occ.addLine(centre, rim), occ.addCircleArc(rim, centre, pole), occ.addLine(pole, centre)]
            face = occ.addPlaneSurface([occ.addCurveLoop(curves)])
            occ.synchronize()
            _group(2, [face], region)
            for name, curve in zip((flat, skin, "axis"), curves, strict=True):
                roles[name].append(curve)
        for name, curves in roles.items():
            _group(1, curves, name)

        def size(dim, tag, x, y, z, other):
            share = self.fine * (1.0 if y <= 0 else 0.8)  # meshes that do not match
            return share + 0.3 * max(math.hypot(x, y) - 16 * self.fine, 0.0)

        gmsh.model.mesh.setSizeCallback(size)
