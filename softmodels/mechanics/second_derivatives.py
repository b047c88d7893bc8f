"""Second derivatives of energy densities by what they have of the unknowns at a point, in UFL."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import ufl
    from dolfinx import fem
    from ufl.core.expr import Expr

LABEL = 1_000_000
"""Number of the first of two labels, above all that UFL gives out."""


class NoModuliError(ValueError):
    """An energy whose second derivative the C code has no product for."""


def only_integral(energy: ufl.Form) -> ufl.Integral:
    """The integral of an energy that has one, over cells or outer faces, by a rule of a stated degree.

    Raises:
        NoModuliError: It has several, or an unusual one.
    """
    integrals = energy.integrals()
    integral = integrals[0]
    kinds, known = ("cell", "exterior_facet"), {"quadrature_degree"}
    stated = set(integral.metadata()) == known and isinstance(integral.subdomain_id(), int | str)
    if len(integrals) != 1 or integral.integral_type() not in kinds or not stated:
        raise NoModuliError("several integrals, or an unusual one")
    return integral


def second_derivatives(density: Expr, w: fem.Function, on_faces: bool, mixed: bool) -> Expr:
    """Second derivative of an energy density by what it has of the displacement and p, and behind it on faces the place.

    Args:
        density: Integrand over cells, or over faces.
        w: The unknowns.
        on_faces: Whether it is of the displacement itself too.
        mixed: Whether the last component of ``w`` is p.

    Raises:
        NoModuliError: It has something else of the unknowns.

    Returns:
        A vector: the upper triangle, by rows.
    """
    import ufl
    from ufl.algorithms import expand_derivatives, replace
    from ufl.classes import Label, Variable

    gradient = ufl.grad(w)
    # Labels of one's own, the same in every run: they are part of a form's name in the cache of compiled ones.
    H, W = (Variable(of, Label(LABEL + k)) for k, of in enumerate((gradient, w)))
    density = replace(expand_derivatives(density), {gradient: H, w: W})
    _let_go()
    allowed = {0, 1, 2} if on_faces else {3} if mixed else set()
    if not (_components(density, W) <= allowed and _components(density, H) <= {0, 1, 2}):
        raise NoModuliError("what no solid has")
    at = [(0, (i, j)) for i in range(3) for j in range(3)] + [(1, (i,)) for i in sorted(allowed)]
    variables = (H, W)
    once = [ufl.diff(density, variable) for variable in variables]
    twice = [[ufl.diff(first, variable) for variable in variables] for first in once]
    second = [twice[a][b][(*i, *j)] for k, (a, i) in enumerate(at) for b, j in at[k:]]
    places = ufl.SpatialCoordinate(w.function_space.mesh)
    return ufl.as_vector([*second, *([places[i] for i in range(3)] if on_faces else [])])


def _let_go() -> None:
    """Empty what functools keeps of UFL's traversers from Python 3.13 on: each would hold its expression and mesh for good."""
    from ufl.corealg.dag_traverser import DAGTraverser

    kinds: list[type] = [DAGTraverser]
    for kind in kinds:  # grows by those that are derived from each
        kinds += kind.__subclasses__()
        kept = getattr(vars(kind).get("process"), "_method_cache", None)
        if kept is not None:
            kept.clear()


def _components(density: Expr, variable: Expr) -> set[int]:
    """Which of the unknowns' components a density has of the unknowns' or their gradients' variable."""
    from ufl.classes import FixedIndex, Grad, Indexed
    from ufl.corealg.traversal import unique_pre_traversal

    found: set[int] = set()
    for node in unique_pre_traversal(density):
        if variable not in node.ufl_operands:
            continue
        if isinstance(node, Grad):
            raise NoModuliError("second gradients")
        first = node.ufl_operands[1][0] if isinstance(node, Indexed) else None
        found |= {int(first)} if isinstance(first, FixedIndex) else set(range(variable.ufl_shape[0]))
    return found
