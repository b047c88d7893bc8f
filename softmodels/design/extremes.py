"""Quantities that are the largest or smallest of many values: peak stretch and stress, and gaps between walls."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import numpy.typing as npt

from softmodels.common.arrays import Array
from softmodels.design.quantities import QUANTITIES, DesignQuantity, FormMeasure, Measure, Slopes, register_quantity
from softmodels.materials.strain import Strain, eigenvalues
from softmodels.mechanics.body import in_space
from softmodels.mechanics.mpi import is_root, largest, on_root
from softmodels.runs.grid import Grid, displacement_maps
from softmodels.runs.state_values import (
    LAST_REACH,
    REACH,
    ROUNDED,
    SHARE,
    FacingWalls,
    Gaps,
    principal_stretches,
    shape_stresses,
    volume_peak,
    von_mises,
)

if TYPE_CHECKING:
    import scipy.sparse
    from ufl.core.expr import Expr

    from softmodels.design.quantities import DesignedBody
    from softmodels.mechanics.system import State


# ----------------------------------------------------------------------------------------------------------------------
# Peak stretch and peak von Mises stress of a design, as `softmodels.runs.state_values` has them: means over the 0.5 % of
# the volume where they are largest. The largest value at a point diverges under refinement at a sharp corner, so a limit
# satisfied on one mesh is violated on the next; and it is not differentiable where two points are equal.


WORTH_A_NOTE = 0.02
"""Relative excess of the largest point value over the peak above which it is reported."""


class PeakMeasure(FormMeasure):
    """The peak of a field over the body; see `softmodels.runs.state_values`.

    The value q from which on the field counts is taken from the values at the integration points. There the peak is least as a
    function of q, so its derivatives are those at fixed q.

    Args:
        design: The meshed device.
        field: UFL expression of the field, differentiable where it counts.
        values_of: Its values at the integration points, from the principal stretches there.
        counted_in_stress: Whether the field is in shear moduli.
        rest: Its value at rest.
    """

    def __init__(
        self, design: DesignedBody, field: Expr, values_of: ValuesOf, counted_in_stress: bool, rest: float = 0.0
    ):
        import ufl
        from dolfinx import fem

        body = design.system.body
        self._q = fem.Constant(body.mesh, 1.0)
        x = (field - rest) / self._q - 1.0
        rounded = ufl.conditional(ufl.gt(x, ROUNDED), x, (x + ROUNDED) ** 2 / (4 * ROUNDED))
        excess = ufl.conditional(ufl.gt(x, -ROUNDED), rounded, 0.0)
        forms = [density * body.hoop * body.measures()[0] for density in (excess, fem.Constant(body.mesh, 1.0))]
        super().__init__(design, forms, self._peak, counted_in_stress=counted_in_stress)
        self._values_of, self._rest, self._top = values_of, rest, rest

    def _peak(self, values: Array) -> tuple[float, Array]:
        q, (above, volume) = float(self._q.value), values
        share = above / (SHARE * volume)
        return self._rest + q * (1.0 + share), q / (SHARE * volume) * np.array([1.0, -above / volume])

    def value(self, state: State | None) -> float:
        self._settle()
        return super().value(state)

    def slopes(self, state: State | None) -> Slopes:
        self._settle()
        return super().slopes(state)

    def _settle(self) -> None:
        """Compute q from the loaded state."""
        design, system = self.design, self.design.system
        values = self._values_of(design, principal_stretches(design.gradients()))
        _, q = volume_peak(system.comm, values, system.point_volumes(), self._rest)
        self._q.value = q - self._rest or 1.0
        self._top = largest(system.comm, float(values.max()) if values.size else 0.0)

    def note(self, value: float) -> str:
        top = self._top * (self.design.system.stress_unit if self.counted_in_stress else 1.0)
        if not value or top < (1.0 + WORTH_A_NOTE) * value:
            return ""
        shown = f"{top / 1e3:.4g} kPa" if self.counted_in_stress else f"{top:.4g}"
        return (
            f"the mean over the {100 * SHARE:g} % of the silicone where it is largest; the largest point value is {shown} "
            f"on this mesh, and grows with refinement at sharp corners and clamped edges"
        )


class ValuesOf:
    """A field at the integration points, from the principal stretches there: (cells, points, 3) to (cells, points)."""

    def __call__(self, design: DesignedBody, stretches: Array) -> Array:
        raise NotImplementedError


class _Stretch(ValuesOf):
    def __call__(self, design: DesignedBody, stretches: Array) -> Array:
        return stretches[..., -1]


class _Mises(ValuesOf):
    def __call__(self, design: DesignedBody, stretches: Array) -> Array:
        return von_mises(shape_stresses(design.system.material, stretches)) / design.system.stress_unit


@register_quantity
@dataclasses.dataclass(frozen=True, kw_only=True)
class PeakStretch(DesignQuantity):
    """Peak of the largest principal stretch: its mean over the 0.5 % of the silicone where it is largest."""

    name: ClassVar = "peak_stretch"
    unit: ClassVar = "1"
    help: ClassVar = (
        "largest principal stretch, the mean over the 0.5 % of the silicone where it is largest (1 is undeformed)"
    )

    def measure(self, design: DesignedBody) -> Measure:
        import ufl

        return PeakMeasure(
            design, ufl.sqrt(eigenvalues(design.strain.C)[0]), _Stretch(), counted_in_stress=False, rest=1.0
        )


@register_quantity
@dataclasses.dataclass(frozen=True, kw_only=True)
class PeakVonMises(DesignQuantity):
    """Peak of the von Mises stress: its mean over the 0.5 % of the silicone where it is largest."""

    name: ClassVar = "peak_von_mises"
    unit: ClassVar = "Pa"
    help: ClassVar = "largest von Mises stress, the mean over the 0.5 % of the silicone where it is largest"

    @property
    def title(self) -> str:
        return "peak von Mises stress"

    def measure(self, design: DesignedBody) -> Measure:
        import ufl

        field = ufl.sqrt(_mises_square(design) + 1e-12)  # the root is not differentiable at zero
        return PeakMeasure(design, field, _Mises(), counted_in_stress=True)


QUANTITIES.update({"max_stretch": PeakStretch, "von_mises": PeakVonMises})
"""Names in problem files of earlier versions, which meant a mean of high powers, fitted to the largest value at a point."""


def _mises_square(design: DesignedBody) -> Expr:
    """Return the square of the von Mises stress in shear moduli: of the deviator of (dW/dF) F^T / J."""
    import ufl

    potential = design.system.potential
    F = ufl.variable(design.system.body.deformation_gradient(potential.displacement))
    strain = Strain(F)
    law = design.system.material
    stress = ufl.diff(law.shape(strain, potential.parameters), F) * F.T / strain.J
    deviator = stress - ufl.tr(stress) / 3 * ufl.Identity(3)
    return 1.5 * ufl.inner(deviator, deviator)


# ----------------------------------------------------------------------------------------------------------------------
# Smallest gap between facing walls; negative if they overlap.
#
# The gap at a place of the surface is that of `softmodels.runs.state_values`: the signed distance to the closest place of a
# wall that it faces. The minimum of several values is not differentiable where two are equal. The quantity is therefore the
# smooth minimum of Kreisselmeier and Steinhauser (1979, doi 10.1016/S1474-6670(17)65584-8),
#
#     -ln(sum over places exp(-rho gap)) / rho,    rho = `SHARPNESS` / t,
#
# with the thickness t of the thinnest of these walls on the initial mesh. It never exceeds the smallest gap, and is below
# it by ln(k)/rho for k equally close places, so a design that keeps it positive has no overlapping walls. The smallest gap
# itself is reported too.


SHARPNESS = 50.0
"""rho times the thickness of the thinnest wall: ten places that are equally close take 5 % of that thickness off the gap."""


class GapMeasure(Measure):
    """The smooth least gap of a meshed design.

    Args:
        design: The device, its mesh as it was made.
    """

    def __init__(self, design: DesignedBody):
        self.design, self.system = design, design.system
        self._grid = Grid(self.system)
        skew, _ = displacement_maps(self.system, self._grid)
        self._skew = skew[: self._grid.owned]
        self._from_nodes = _interpolation(self._grid, design)
        self._made = self._places()
        self._walls: FacingWalls | None = None  # on rank 0
        self._rho = 0.0

    def slopes(self, state: State | None) -> Slopes:
        system, grid, motion = self.system, self._grid, self.design.motion
        assert state is not None
        moved = in_space(system.w.x.array[self._skew] @ system.body.skew_inverse.T * system.length_unit)
        shift = grid.collect(self._places() - self._made + moved)
        value, least, rates = on_root(system.comm, lambda: self._smooth(shift))
        mesh = grid.distribute(rates if is_root(system.comm) else None) * system.length_unit  # by dimensionless places
        mesh = mesh if motion.dimension == 3 else mesh[:, [0, 2]]
        by_w = np.zeros(system.n)
        by_w[self._skew] = mesh @ system.body.skew_inverse
        note = f"the smallest gap is {1e3 * least:.4g} mm" if np.isfinite(least) else "no walls are near each other"
        return Slopes(value, system.by_unknowns(by_w).copy(), 0.0, self._by_nodes(mesh), note)

    def _places(self) -> Array:
        """Return the owned nodes of the grid on the current mesh, device coordinates in m, shape (n, 3)."""
        system = self.system
        here = self._grid.space.tabulate_dof_coordinates()[: self._grid.owned] * system.length_unit
        return system.body.actuator.device_points(here)

    def _by_nodes(self, rates: Array) -> Array:
        """Return the derivatives by the grid's owned nodes, shape (n, d), as those by the mesh's own nodes; see `Slopes.X`."""
        from dolfinx import fem, la

        b = fem.Function(self.design.motion.space).x
        b.array[:] = (self._from_nodes.T @ rates).ravel()
        b.scatter_reverse(la.InsertMode.add)
        return np.array(b.array)

    def _smooth(self, shift: Array | None) -> tuple[float, float, Array | None]:
        """Return the smooth and true least gap in m, and the smooth one's derivative by the places of the grid's nodes; on rank
        0."""
        assert shift is not None
        grid = self._grid
        if self._walls is None:
            planes = [plane.normal for plane in self.system.body.actuator.cut_planes]
            self._walls = FacingWalls(grid.points, grid.cells, grid.cell_name, planes)
        gaps, rates = self._near(self._walls, shift), np.zeros_like(shift)
        if not len(gaps.values):  # within the search distance
            return LAST_REACH * self._walls.size, np.inf, rates
        if not self._rho:
            self._rho = SHARPNESS / float(gaps.thickness.min())
        least = float(gaps.values.min())
        weights = np.exp(-self._rho * (gaps.values - least))
        near = weights > 1e-16
        value = least - float(np.log(weights.sum())) / self._rho
        _add_rates(rates, self._walls, gaps, near, weights[near] / weights.sum())
        return value, least, rates

    @staticmethod
    def _near(walls: FacingWalls, shift: Array) -> Gaps:
        """Return the gaps up to twice the least one, or as far as they are looked for."""
        reach = REACH * walls.size
        while True:
            gaps = walls.gaps(shift, reach)
            if np.min(gaps.values, initial=np.inf) < reach / 2 or reach >= LAST_REACH * walls.size:
                return gaps
            reach *= 2.0


def _add_rates(rates: Array, walls: FacingWalls, gaps: Gaps, chosen: npt.NDArray[np.bool_], shares: Array) -> None:
    """Add the derivatives of chosen gaps by the nodes' places, times a share of each."""
    facets, others, normals = gaps.facets[chosen], gaps.others[chosen], gaps.normals[chosen]
    own, other = walls.shapes(gaps.points[chosen]), gaps.weights[chosen]
    plane = others < 0
    along = shares[:, None] * normals
    # The image in a cut plane moves against the place itself.
    np.add.at(rates, walls.facets[facets], np.where(plane, 2.0, 1.0)[:, None, None] * own[:, :, None] * along[:, None])
    np.add.at(rates, walls.facets[others[~plane]], -other[~plane][:, :, None] * along[~plane][:, None])


def _interpolation(grid: Grid, design: DesignedBody) -> scipy.sparse.csr_matrix:
    """Return the places of the grid's owned nodes from those of the mesh's own local nodes, shape (owned, nodes of
    `MeshMotion.space`)."""
    import basix.ufl
    from scipy.sparse import csr_matrix

    mesh, space = grid.space.mesh, design.motion.space
    element = basix.ufl.element("P", mesh.basix_cell(), mesh.geometry.cmaps[0].degree)
    shapes = element.tabulate(0, grid.space.element.interpolation_points)[
        0
    ]  # (grid's nodes of a cell, mesh's nodes of it)
    nodes, own = np.asarray(grid.space.dofmap.list), np.asarray(space.dofmap.list)
    owned, first = np.unique(nodes.ravel(), return_index=True)
    cell, local = np.divmod(first[owned < grid.owned], nodes.shape[1])
    rows = np.repeat(np.arange(grid.owned), own.shape[1])
    size = (grid.owned, len(space.tabulate_dof_coordinates()))
    return csr_matrix((shapes[local].ravel(), (rows, own[cell].ravel())), shape=size)


@register_quantity
@dataclasses.dataclass(frozen=True, kw_only=True)
class LeastGap(DesignQuantity):
    """Smallest gap between facing walls, as a smooth minimum; negative if they overlap."""

    name: ClassVar = "least_gap"
    unit: ClassVar = "m"
    help: ClassVar = "smallest gap between facing walls (smooth minimum); negative if they overlap"

    def measure(self, design: DesignedBody) -> Measure:
        return GapMeasure(design)
