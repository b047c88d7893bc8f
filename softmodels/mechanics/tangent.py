"""Products of a change of the unknowns with the second derivative of a potential, in the state that its functions hold.

A form's product recomputes the law's second derivatives each time. They are the same for all products at a state,
and GMRES needs about six: for tetrahedra they are computed once, by an expression compiled from the potential, and C code
(``moduli.c``) multiplies with them, several cells or faces side by side.

CPU time of whole runs with products by compiled forms, and by MatMult of a tangent assembled at each iterate, over
that with stored second derivatives (AMD EPYC family 26, AVX-512, one rank): default wedge of the disk 1.12 and 1.63, default
half of the seminar slab 1.14 and 1.50; iterative solver at 37,120 and 181,940 unknowns by forms 1.4 and 1.41.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import ModuleType

import numpy as np
import numpy.typing as npt

from softmodels.common.arrays import Array
from softmodels.common.lazy import Expr, PETSc, basix, fem, meshes, ufl
from softmodels.mechanics import assembly, compiling
from softmodels.mechanics.potential import Potential

Ints = npt.NDArray[np.int32]

PARALLEL_LANES = 8
"""Number of cells or faces that the C code processes in parallel lanes."""
CELLS_AT_ONCE = 512
"""Number of cells or faces whose second derivatives are computed at once, so that they stay in the processor's cache."""
FACES = np.array([(1, 2, 3), (0, 2, 3), (0, 1, 3), (0, 1, 2)])
"""Corners of a reference tetrahedron's faces."""


class TangentOperator:
    """Products with each term of a potential: by stored second derivatives (``kept``) if possible, else by a compiled form
    (``by_forms``).

    ``internal`` are compiled derivatives of its energies, ``loads`` of its cavities' volumes, ``tangent`` is
    `Potential.tangent`; ``matrices`` are compiled tangents of all terms, first those of the regions.
    """

    def __init__(
        self,
        potential: Potential,
        internal: Sequence[fem.Form],
        loads: Sequence[fem.Form],
        tangent: Sequence[ufl.Form],
        compiled: Callable[[ufl.Form], fem.Form],
    ):
        self.kept: list[QuadratureTangent] = []
        others: list[int] = []
        self.matrices = [compiled(form) for form in tangent]
        predicted = potential.predicted_tangents(potential.direction)
        terms = [[(energy, force)] for energy, force in zip(potential.energies, internal, strict=True)]
        pressures = zip(potential.pressures, potential.volumes, loads, strict=True)
        terms += [[(-pressure * volume, load) for pressure, volume, load in pressures]] if potential.volumes else []
        known = known_cells(potential.space)
        dofs = cell_dofs(potential.space, potential.mixed) if known else np.empty((0, 0), dtype=np.int32)
        for number, term in enumerate(terms):
            try:
                if not known or number in predicted:
                    raise NoModuliError("unsupported cells, or a tangent other than the energy's")
                self.kept += [QuadratureTangent(potential, energy, force, dofs) for energy, force in term]
            except NoModuliError:
                others.append(number)
        along = potential.tangent(potential.direction) if others else []
        self.by_forms = [compiled(along[number]) for number in others]

    def add(self, x: Array, y: Array) -> None:
        """Add the product with ``x`` to ``y``, both local dofs with ghosts; ghost values belong to their owners. Held dofs are
        as they are in x, which the potential's ``direction`` has too."""
        for moduli in self.kept:
            moduli.add_product(x, y)
        for form in self.by_forms:
            fem.assemble_vector(y, form)

    def add_to(self, matrix: PETSc.Mat, bcs: Sequence[fem.DirichletBC]) -> None:
        """Add the second derivative to a matrix, without finalising it.

        Args:
            matrix: With the pattern of the cells' dofs.
            bcs: Rows and columns of their dofs stay empty, but for ones on the diagonal.
        """
        for form in self.matrices:
            assembly.assemble_into(matrix, form, bcs)
            matrix.assemble(matrix.AssemblyType.FLUSH)  # held dofs' diagonal is put in, the rest is added up


def known_cells(space: fem.FunctionSpace) -> bool:
    """Return whether the C code supports the cells of a potential's space: tetrahedra, straight or with a node on each edge."""
    of = space.mesh
    return of.topology.cell_type == meshes.CellType.tetrahedron and of.geometry.cmaps[0].degree <= 2


def cell_dofs(space: fem.FunctionSpace, mixed: bool) -> Ints:
    """Return the unknowns of the cells: three of each node's displacement and, if mixed, p of each corner, shape (cells, 30 or
    34)."""
    vectors = space.sub(0) if mixed else space
    parts = [np.array(vectors.sub(k).dofmap.list) for k in range(3)]
    dofs = np.stack(parts, axis=2).reshape(len(parts[0]), 30)
    return np.hstack([dofs, np.array(space.sub(1).dofmap.list)]) if mixed else dofs


class QuadratureTangent:
    """Second derivative of an energy of a solid on `known_cells`, whose form has one integral; ``force`` is its compiled
    derivative, ``dofs`` are `cell_dofs`.

    Raises:
        NoModuliError: The C code has no such integral.
    """

    def __init__(self, potential: Potential, energy: ufl.Form, force: fem.Form, dofs: Ints):
        from ufl.algorithms import extract_coefficients
        from ufl.algorithms.analysis import extract_constants

        integral, w, mixed = only_integral(energy), potential.w, potential.mixed
        on_faces = integral.integral_type() == "exterior_facet"
        second = potential.unfreeze_history(second_derivatives(integral.integrand(), w, on_faces, mixed))
        cell = basix.CellType.triangle if on_faces else basix.CellType.tetrahedron
        points, weights = basix.make_quadrature(cell, integral.metadata()["quadrature_degree"])
        self._expression = fem.Expression(second, points, jit_options=compiling.JIT)
        # What histories begin with is large, and known to change only when they say so.
        begun = [history.begun for history in potential.histories]
        used = [c for c in extract_coefficients(second) if c not in begun]
        self._fields = list({id(field.x): field.x for field in (w, *used)}.values())
        self._histories, self._constants = potential.histories, extract_constants(second)
        self._mesh, self._known = w.function_space.mesh, list[Array]()
        compiled = force._cpp_object
        entities = np.array(compiled.domains(next(iter(compiled.integral_types)), 0), dtype=np.int32)
        c, rule = compiling.library(self._mesh.comm, "moduli"), (points, weights)
        if on_faces:
            pairs = entities.reshape(-1, 2)
            self._blocks = [_Block(c, self._mesh, dofs, pairs, int(side), rule, False) for side in np.unique(pairs[:, 1])]
        elif entities.size:
            self._blocks = [_Block(c, self._mesh, dofs, entities.ravel(), None, rule, mixed)]
        else:
            self._blocks = []  # of a region that other ranks have

    def add_product(self, x: Array, y: Array) -> None:
        """Add its product at the current state to ``y``, both local dofs with ghosts; those of ghosts are for their owners."""
        self._take()
        for block in self._blocks:
            block.add_product(x, y)

    def _take(self) -> None:
        here = [self._mesh.geometry.x, *(field.array for field in self._fields)]
        here += [np.asarray(constant.value) for constant in self._constants]
        here.append(np.array([history.prepared for history in self._histories]))
        if not (self._known and all(map(np.array_equal, here, self._known))):
            for block in self._blocks:
                block.take(self._expression)
            self._known = [values.copy() for values in here]


class _Block:
    """Cells, or faces (pairs of a local cell and its side) on the same ``side`` of their cells, with the data for the C code.
    ``rule`` has points and weights on the reference cell or triangle; ``pressure`` says whether p counts."""

    def __init__(
        self,
        c: ModuleType,
        mesh: meshes.Mesh,
        dofs: Ints,
        entities: Ints,
        side: int | None,
        rule: tuple[Array, Array],
        pressure: bool,
    ):
        self._mesh = mesh
        self._entities = entities if side is None else entities[entities[:, 1] == side]
        self._cells = self._entities if side is None else self._entities[:, 0]
        self._side, (points, self._rule) = side, rule
        if side is not None:
            reference = basix.geometry(basix.CellType.tetrahedron)[FACES[side]]
            points = reference[0] + points @ (reference[1:] - reference[0])
        self._points = points
        self._dofs = _side_by_side(dofs[self._cells, : 34 if pressure else 30])
        quadratic, linear = (_tabulated(degree, points) for degree in (2, 1))
        self._shapes, self._linear = np.ascontiguousarray(quadratic[0]), np.ascontiguousarray(linear[0])
        self._slopes = np.ascontiguousarray(quadratic[1:].transpose(1, 2, 0))
        strains = 12 if side is not None else 10 if pressure else 9
        self._moduli = np.empty((len(self._dofs), len(points), strains * (strains + 1) // 2, PARALLEL_LANES))
        self._c = c
        name = {9: "of_gradients", 10: "with_pressure", 12: "with_values"}[strains]
        self._product = getattr(c.lib, f"moduli_{name}")
        self._nodes = np.empty(0)

    def _measure(self) -> None:
        """Update the node positions, which a design moves."""
        geometry = self._mesh.geometry
        if np.array_equal(self._nodes, geometry.x):
            return
        self._nodes = geometry.x.copy()
        nodes = self._nodes[geometry.dofmaps[0][self._cells]]
        shapes = _tabulated(geometry.cmaps[0].degree, self._points)
        slopes = np.einsum("jqa,nax->nqxj", shapes[1:], nodes)  # of the place by the reference's coordinates
        if self._side is None:
            size = np.abs(np.linalg.det(slopes))
        else:
            a, b, c = basix.geometry(basix.CellType.tetrahedron)[FACES[self._side]]
            size = np.linalg.norm(np.cross(slopes @ (b - a), slopes @ (c - a)), axis=2)
            self._places = np.einsum("qa,nax->nqx", shapes[0], nodes)
        self._weights = np.ascontiguousarray(size * self._rule)
        curved = geometry.cmaps[0].degree > 1
        inverse = np.linalg.inv(slopes if curved else slopes[:, :1])
        self._inverse = _side_by_side(inverse.reshape(len(nodes), -1))
        tables = (self._inverse, self._shapes, self._slopes, self._linear, self._moduli)
        self._tables = [len(self._dofs), len(self._points), curved, self._c.ffi.from_buffer("int32_t[]", self._dofs)]
        self._tables += [self._c.ffi.from_buffer("double[]", table) for table in tables]

    def take(self, expression: fem.Expression) -> None:
        """Compute the second derivatives at the current state."""
        self._measure()
        buffer = self._c.ffi.from_buffer
        points, entries = self._moduli.shape[1:3]
        for first in range(0, len(self._entities), CELLS_AT_ONCE):
            some = self._entities[first : first + CELLS_AT_ONCE]
            values = expression.eval(self._mesh, some)
            if self._side is not None:
                values = self._in_order(values, self._places[first : first + CELLS_AT_ONCE])
            into, weights = self._moduli[first // PARALLEL_LANES :], self._weights[first:]
            arrays = [buffer("double[]", array) for array in (values, weights, into)]
            self._c.lib.moduli_take(len(some), points, entries, *arrays)

    @staticmethod
    def _in_order(values: Array, places: Array) -> Array:
        """Return the values at faces' points, shape (faces, points, entries and 3), the points' places behind the entries, in
        the order of the rule's ``places`` instead of the face's own orientation."""
        far = np.abs(values[:, None, :, -3:] - places[:, :, None]).sum(axis=3)
        return np.ascontiguousarray(np.take_along_axis(values[..., :-3], far.argmin(axis=2)[..., None], axis=1))

    def add_product(self, x: Array, y: Array) -> None:
        """Add the product with ``x`` to ``y``."""
        buffer = self._c.ffi.from_buffer
        self._product(*self._tables, buffer("double[]", x), buffer("double[]", y))


def _tabulated(degree: int, points: Array) -> Array:
    """Return the shape functions of a reference tetrahedron and their derivatives at points, shape (1 + 3, points, nodes)."""
    element = basix.create_element(basix.ElementFamily.P, basix.CellType.tetrahedron, degree)
    return np.asarray(element.tabulate(1, points)[..., 0])


def _side_by_side[T: np.generic](rows: npt.NDArray[T]) -> npt.NDArray[T]:
    """Return the rows of entities, shape (n, k), with `PARALLEL_LANES` of them as the last index: shape
    (n / PARALLEL_LANES, k, PARALLEL_LANES), filled up."""
    count = -(-len(rows) // PARALLEL_LANES)
    filled = np.concatenate([rows, np.repeat(rows[-1:], count * PARALLEL_LANES - len(rows), axis=0)])
    return np.ascontiguousarray(filled.reshape(count, PARALLEL_LANES, rows.shape[1]).transpose(0, 2, 1))


class NoModuliError(ValueError):
    """The C code does not support the second derivative of this energy."""


def only_integral(energy: ufl.Form) -> ufl.Integral:
    """Return the integral of an energy that has one, over cells or outer faces, by a rule of a stated degree; else raise
    `NoModuliError`."""
    integrals = energy.integrals()
    integral = integrals[0]
    kinds, known = ("cell", "exterior_facet"), {"quadrature_degree"}
    stated = set(integral.metadata()) == known and isinstance(integral.subdomain_id(), int | str)
    if len(integrals) != 1 or integral.integral_type() not in kinds or not stated:
        raise NoModuliError("several integrals, or an unusual one")
    return integral


def second_derivatives(density: Expr, w: fem.Function, on_faces: bool, mixed: bool) -> Expr:
    """Return the second derivative of an energy density over cells or faces by displacement (``on_faces``), its gradient and p
    (if ``mixed``, the last component of w): a vector, the upper triangle by rows; behind it on faces the position.

    Raises:
        NoModuliError: The density has something else of the unknowns.
    """
    from ufl.algorithms import expand_derivatives, replace
    from ufl.classes import Label, Variable

    gradient = ufl.grad(w)
    H, W = (Variable(of, Label(compiling.FIRST_LABEL + k)) for k, of in enumerate((gradient, w)))
    density = replace(expand_derivatives(density), {gradient: H, w: W})
    _let_go()
    allowed = {0, 1, 2} if on_faces else {3} if mixed else set()
    if not (_components(density, W) <= allowed and _components(density, H) <= {0, 1, 2}):
        raise NoModuliError("unsupported components")
    at = [(0, (i, j)) for i in range(3) for j in range(3)] + [(1, (i,)) for i in sorted(allowed)]
    variables = (H, W)
    once = [ufl.diff(density, variable) for variable in variables]
    twice = [[ufl.diff(first, variable) for variable in variables] for first in once]
    second = [twice[a][b][(*i, *j)] for k, (a, i) in enumerate(at) for b, j in at[k:]]
    places = ufl.SpatialCoordinate(w.function_space.mesh)
    return ufl.as_vector([*second, *([places[i] for i in range(3)] if on_faces else [])])


def _let_go() -> None:
    """Clear functools' cache of UFL's traversers (Python 3.13 and later), which would keep expression and mesh alive."""
    from ufl.corealg.dag_traverser import DAGTraverser

    kinds: list[type] = [DAGTraverser]
    for kind in kinds:  # grows by those that are derived from each
        kinds += kind.__subclasses__()
        kept = getattr(vars(kind).get("process"), "_method_cache", None)
        if kept is not None:
            kept.clear()


def _components(density: Expr, variable: Expr) -> set[int]:
    """Return which of the unknowns' components a density has of the unknowns' or their gradients' variable."""
    from ufl.classes import FixedIndex, Grad, Indexed
    from ufl.corealg.traversal import unique_pre_traversal

    components: set[int] = set()
    for node in unique_pre_traversal(density):
        if variable not in node.ufl_operands:
            continue
        if isinstance(node, Grad):
            raise NoModuliError("second gradients")
        first = node.ufl_operands[1][0] if isinstance(node, Indexed) else None
        components |= {int(first)} if isinstance(first, FixedIndex) else set(range(variable.ufl_shape[0]))
    return components
