"""Distance of a face from a target surface that a formula gives, such as a dome, a saddle or a twist."""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from geometries import Actuator, actuator
from softmodels.common import units
from softmodels.common.arrays import Array
from softmodels.common.lazy import Expr, basix, fem, ufl
from softmodels.design import quantities
from softmodels.mechanics import body, compiling, mpi

if TYPE_CHECKING:
    from softmodels.mechanics.system import State


class Surface(quantities.OfFace, name="surface", unit="m"):
    """Root mean square distance of a deformed face, such as "top", from a target surface, along its normal to first order.

    Attributes:
        height: Height of the surface over the undeformed face at places x and y in device coordinates, a `Formula`.
        sigma: Standard error of a distance in m, or a text with a unit, 0 to estimate it from what is left.
        tilted: Whether the face may also be anywhere else: rise and tilt of the surface do not count.
    """

    of: str = "top"
    height: str = ""
    sigma: float = 0.0
    tilted: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "sigma", quantities.length("sigma", self.sigma))
        if not isinstance(self.height, str) or not isinstance(self.tilted, bool):
            raise ValueError(f"height of a surface is a formula, such as {EXAMPLE!r}, and tilted is true or false")
        Formula(self.height)

    @property
    def title(self) -> str:
        return f"distance of {self.of} from the surface"

    def integrands(self, along: Expr, unit: Expr, X: Expr, x: Expr) -> list[Expr]:
        raise TypeError("the places of a surface are those of its measure")

    def measure(self, design: quantities.DesignedBody) -> SurfaceMeasure:
        made = SurfaceMeasure(design, self.of, Formula(self.height), self.tilted)
        made.sigma = self.sigma
        return made


# ----------------------------------------------------------------------------------------------------------------------
# A face and a surface: with a target z = f(x, y) over the face's undeformed height, a point is (z - f) / sqrt(1 + |grad f|^2)
# from it. Rise and tilt that do not count are the plane that fits these distances best over the face.


class SurfaceMeasure(quantities.FormMeasure, quantities.TargetMeasure):
    """Distances of a face from a target surface, in m. ValueError if the mesh has no such face, or is of a slice of the
    device, of which the surface is not the mirror image."""

    def __init__(self, design: quantities.DesignedBody, of: str, formula: Formula, tilted: bool):
        system, solid = design.system, design.system.body
        if solid.actuator.dimension != 3 or tuple(solid.actuator.lift) != (0.0, 0.0, 1.0):
            raise ValueError("a target surface needs a device in space with its lift along z; use an outline")
        _check_mirrors(formula, solid.actuator)
        try:
            area, _ = solid.sheet_face(of)
        except body.BodyError as error:
            raise ValueError(str(error)) from None
        self._unit = system.length_unit
        self._rate, self._shift = fem.Function(system.space), fem.Function(design.motion.space)
        X, unit = ufl.SpatialCoordinate(solid.mesh), fem.Constant(solid.mesh, 1.0)
        u = solid.displacement(system.potential.displacement)
        moved = solid.displacement(ufl.split(self._rate)[0] if system.mixed else self._rate)
        x = ufl.variable(ufl.as_vector([X[0] + u[0], X[1] + u[1], u[2]]))
        apart = x[2] - formula(self._unit * x[0], self._unit * x[1], ufl) / self._unit
        slope = ufl.diff(apart, x)
        distance = apart / ufl.sqrt(ufl.inner(slope, slope))
        rate = ufl.dot(slope, moved + ufl.as_vector([self._shift[0], self._shift[1], 0.0 * unit])) / ufl.sqrt(
            ufl.inner(slope, slope)
        )
        plane = [unit, *(ufl.dot(fem.Constant(solid.mesh, way), X) for way in _tilts(solid.actuator))] if tilted else [unit]
        self._count, self._tilted = len(plane), tilted
        pairs = [(i, j) for i in range(self._count) for j in range(i, self._count)]
        integrands = [*(plane[i] * plane[j] for i, j in pairs), *(distance * own for own in plane), distance**2]
        self._pairs = np.array(pairs)
        super().__init__(design, [value * area for value in integrands], self._root_mean_square)
        self._places(of, [distance, rate, *plane])

    def _root_mean_square(self, values: Array) -> tuple[float, Array]:
        """Return the distance from the integrals of the plane's products, of the distances with it, and of their squares."""
        i, j = self._pairs.T
        alike = np.zeros((self._count, self._count))
        alike[i, j] = alike[j, i] = values[: len(i)]
        first, area = values[len(i) : -1], values[0]
        plane = np.linalg.solve(alike, first) if self._tilted else np.zeros(self._count)
        value = max((values[-1] - plane @ first) / area, 1e-300) ** 0.5
        by_pairs = np.where(i == j, 1.0, 2.0) * plane[i] * plane[j]
        by_pairs[0] -= value**2
        slopes = np.concatenate([by_pairs, -2.0 * plane, [1.0]]) / (2.0 * area * value)
        return self._unit * value, self._unit * slopes

    def note(self, value: float) -> str:
        return "rise and tilt of the face do not count" if self._tilted else ""

    # -- distances of single points, for least squares ------------------------------------------------------------------

    def _places(self, of: str, expressions: list[Expr]) -> None:
        """Prepare the values at the integration points of the face, of which the weights are their shares of its area."""
        mesh = self.design.system.body.mesh
        points, weights = basix.make_quadrature(basix.CellType.triangle, body.SURFACE_DEGREE)
        facets = self.design.system.body.entities[of][1]
        pairs = fem.compute_integration_domains(fem.IntegralType.exterior_facet, mesh.topology, np.sort(facets))
        self._facets = np.asarray(pairs).reshape(-1, 2)
        self._facets = self._facets[self._facets[:, 0] < mesh.topology.index_map(3).size_local]
        with compiling.compiling():
            self._at = fem.Expression(ufl.as_vector(expressions), points, jit_options=compiling.JIT)
        degree = mesh.geometry.cmaps[0].degree
        of_facet = np.array(basix.ufl.element("P", "tetrahedron", degree).entity_closure_dofs[2])
        element = basix.ufl.element("P", "triangle", degree)
        cells = mesh.geometry.dofmaps[0][self._facets[:, 0]]
        nodes = mesh.geometry.x[np.take_along_axis(cells, of_facet[self._facets[:, 1]], axis=1)]
        along, across = np.einsum("dqn,fni->dfqi", element.tabulate(1, points)[1:], nodes)
        self._weights = (np.linalg.norm(np.cross(along, across), axis=2) * weights).ravel()

    def _values(self) -> tuple[Array, Array]:
        """Return distances and their rates, shape (k,), without the plane, times the roots of the points' shares of the
        face."""
        mesh = self.design.system.body.mesh
        local = np.asarray(self._at.eval(mesh, self._facets)).reshape(len(self._weights), -1)
        table = mpi.everywhere(self.design.system.comm, np.column_stack([local, self._weights]))
        share = np.sqrt(table[:, -1] / table[:, -1].mean())[:, None]
        both, plane = share * table[:, :2], share * table[:, 2:-1]
        if self._tilted:
            both = both - plane @ np.linalg.lstsq(plane, both, rcond=None)[0]
        return self._unit * both[:, 0], self._unit * both[:, 1]

    def residuals(self, state: State) -> Array:
        return self._values()[0]

    def moved(self, state: State, w: Array, X: Array) -> Array:
        self._rate.x.array[:] = w[: len(self._rate.x.array)]
        self._shift.x.array[:] = X.ravel()[: len(self._shift.x.array)]
        return self._values()[1]


def _tilts(device: Actuator) -> list[Array]:
    """Return directions in the plane along which a face can tilt: all, or those in the mirrors of a slice."""
    normals = np.array([plane.normal for plane in device.cut_planes]).reshape(-1, 3)[:, :2]
    _, sizes, ways = np.linalg.svd(normals) if len(normals) else (None, np.zeros(0), np.eye(2))
    free = ways[int((sizes > MIRROR_TOLERANCE).sum()) :]
    return [np.array([*way, 0.0]) for way in free]


def _check_mirrors(formula: Formula, device: Actuator) -> None:
    """Reject a surface that is not its own image in the mirrors of the slice that is meshed."""
    places = device.size * np.random.default_rng(0).uniform(-1.0, 1.0, (16, 3))
    with np.errstate(all="ignore"):
        heights, *others = (
            formula((places @ image)[:, 0], (places @ image)[:, 1], np) * np.ones(16)
            for image in actuator.reflected([plane.normal for plane in device.cut_planes])
        )
    size = np.nanmax(np.abs(heights), initial=0.0)
    if any(np.nanmax(np.abs(heights - other), initial=0.0) > MIRROR_TOLERANCE * size for other in others):
        raise ValueError(
            f"surface {formula.text!r} is not its own mirror image, but only 1/{device.copies} of the device is meshed; "
            f"use {device.fuller}"
        )


MIRROR_TOLERANCE = 1e-6
EXAMPLE = "2 mm * (1 - (x^2 + y^2) / (15 mm)^2)"


class Formula:
    """A length over places x and y, such as `EXAMPLE`, from numbers with units, + - * / ^, brackets, pi and `FUNCTIONS`;
    called with places in m it is in m, of numbers, arrays or UFL. ValueError if the text is none."""

    def __init__(self, text: str):
        self.text = text
        try:
            tree = ast.parse(WITH_UNIT.sub(self._read, text[:MAX_TEXT]).replace("^", "**").strip(), mode="eval")
        except (SyntaxError, RecursionError, ValueError) as error:
            raise self._wrong(str(error) if isinstance(error, units.UnitError) else "it cannot be read") from None
        self._body = tree.body
        x, y = np.random.default_rng(0).uniform(1e-3, 2e-3, (2, 8))
        try:
            with np.errstate(all="ignore"):
                here, there = (self._value(self._body, {"x": k * x, "y": k * y, METRE: k}, np) for k in (1.0, 2.0))
        except (TypeError, ArithmeticError, RecursionError):
            raise self._wrong("it cannot be evaluated") from None
        if not np.isfinite(here).any():
            raise self._wrong("it has no value")
        if not np.allclose(2.0 * here, there, rtol=1e-9, atol=1e-12 * np.nanmax(np.abs(here)), equal_nan=True):
            raise self._wrong("its value is no length; check the units of its numbers")

    def __call__(self, x: object, y: object, functions: object) -> Expr:
        """Return the length; ``functions`` is the module numpy or UFL."""
        return self._value(self._body, {"x": x, "y": y, METRE: 1.0}, functions)

    @staticmethod
    def _read(match: re.Match[str]) -> str:
        number, unit = match.groups()
        if ANGLE.fullmatch(unit):
            return f"({math.radians(units.quantity(f'{number} {unit}', 'degree'))!r})"
        return f"({units.quantity(f'{number} {unit}', 'm')!r} * {METRE})"

    def _wrong(self, why: str) -> ValueError:
        return ValueError(f"surface {units.brief(self.text)}: {why}; write a height such as '{EXAMPLE}'")

    def _value(self, node: ast.AST, names: Mapping[str, object], functions: object) -> Expr:
        match node:
            case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
                return float(value)
            case ast.Name(id="pi"):
                return math.pi
            case ast.Name(id=name) if name in names:
                return names[name]
            case ast.UnaryOp(op=ast.USub(), operand=inner):
                return -self._value(inner, names, functions)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in OPERATIONS:
                return OPERATIONS[type(op)](*(self._value(side, names, functions) for side in (left, right)))
            case ast.Call(func=ast.Name(id=name), args=[inner], keywords=[]) if name in FUNCTIONS:
                return getattr(functions, name)(self._value(inner, names, functions))
            case ast.Name(id=name) | ast.Call(func=ast.Name(id=name)):
                raise self._wrong(f"{name!r} is not known; it may have x, y, pi and {', '.join(FUNCTIONS)}")
        raise self._wrong("it may only have numbers with units, x, y, pi, + - * / ^, brackets and functions")


MAX_TEXT = 1000
WITH_UNIT = re.compile(r"(?<![\w.])((?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([a-zA-Zµ°]+)")
ANGLE = re.compile(r"deg(?:rees?)?|°|rad(?:ians?)?")
METRE = "_metre"
"""Name of the unit of lengths in a formula, which is 1 m."""
OPERATIONS = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv, ast.Pow: operator.pow,
}  # fmt: skip
FUNCTIONS = ("sin", "cos", "tan", "sqrt", "exp")
