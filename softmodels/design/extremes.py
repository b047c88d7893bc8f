"""Quantities that are the largest or smallest of many values: peak stretch and stress, and gaps between walls."""

from __future__ import annotations

import abc
import dataclasses
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import numpy.typing as npt

from softmodels.common.arrays import Array
from softmodels.common.lazy import Expr, basix, fem, la, meshes, scipy, ufl
from softmodels.design import quantities
from softmodels.materials import laws
from softmodels.mechanics import mpi
from softmodels.mechanics.body import cell_measure, in_space
from softmodels.runs import state_values

if TYPE_CHECKING:
    from softmodels.mechanics import regions
    from softmodels.mechanics.system import State


# ----------------------------------------------------------------------------------------------------------------------
# Peak stretch and peak von Mises stress of a design, as `softmodels.runs.state_values` has them: means over the 0.5 % of
# the volume where they are largest. The largest value at a point diverges under refinement at a sharp corner, so a limit
# satisfied on one mesh is violated on the next; and it is not differentiable where two points are equal.


WORTH_A_NOTE = 0.02
"""Relative excess of the largest point value over the peak above which it is reported."""


class PeakMeasure(quantities.FormMeasure):
    """The peak of a field over the body, by its value at rest and its values at the integration points from the principal
    stretches there; see `softmodels.runs.state_values`. The value q from which on the field counts is taken from the latter.
    There the peak is least as a function of q, so its derivatives are those at fixed q."""

    def __init__(
        self, design: quantities.DesignedBody, fields: Sequence[FieldPart], values_of: ValuesOf, counted_in_stress: bool,
        rest: float = 0.0,
    ):  # fmt: skip
        self._q = fem.Constant(design.system.body.mesh, 1.0)

        def excess(field: Expr) -> Expr:
            x = (field - rest) / self._q - 1.0
            rounded = ufl.conditional(
                ufl.gt(x, state_values.ROUNDING_HALF_WIDTH),
                x,
                (x + state_values.ROUNDING_HALF_WIDTH) ** 2 / (4 * state_values.ROUNDING_HALF_WIDTH),
            )
            return ufl.conditional(ufl.gt(x, -state_values.ROUNDING_HALF_WIDTH), rounded, 0.0)

        forms, combine = over_parts(design, fields, [excess, None], self._peak)
        super().__init__(design, forms, combine, counted_in_stress=counted_in_stress)
        self._values_of, self._rest, self._top = values_of, rest, rest

    def _peak(self, values: Array) -> tuple[float, Array]:
        q, (above, volume) = float(self._q.value), values
        share = above / (state_values.PEAK_VOLUME_SHARE * volume)
        return self._rest + q * (1.0 + share), q / (state_values.PEAK_VOLUME_SHARE * volume) * np.array([1.0, -above / volume])

    def value(self, state: State | None) -> float:
        self._settle()
        return super().value(state)

    def slopes(self, state: State | None) -> quantities.Slopes:
        self._settle()
        return super().slopes(state)

    def _settle(self) -> None:
        """Compute q from the loaded state."""
        design, system = self.design, self.design.system
        values = self._values_of(design, state_values.principal_stretches(design.gradients()))
        _, q = state_values.volume_peak(system.comm, values, system.point_volumes(), self._rest)
        self._q.value = q - self._rest or 1.0
        self._top = mpi.largest(system.comm, float(values.max()) if values.size else 0.0)

    def note(self, value: float) -> str:
        top = self._top * (self.design.system.stress_unit if self.counted_in_stress else 1.0)
        if not value or top < (1.0 + WORTH_A_NOTE) * value:
            return ""
        shown = f"{top / 1e3:.4g} kPa" if self.counted_in_stress else f"{top:.4g}"
        return (
            f"the mean over the {100 * state_values.PEAK_VOLUME_SHARE:g} % of the silicone where it is largest; the largest "
            f"point value is {shown} on this mesh, and grows with refinement at sharp corners and clamped edges"
        )


ValuesOf = Callable[["quantities.DesignedBody", Array], Array]
"""A field at the integration points, from the principal stretches there: (cells, points, 3) to (cells, points)."""


def _mises(design: quantities.DesignedBody, stretches: Array) -> Array:
    stresses = np.empty(stretches.shape[:2])
    for region in design.system.potential.regions:
        stresses[region.cells] = state_values.von_mises(state_values.shape_stresses(region.material, stretches[region.cells]))
    return stresses / design.system.stress_unit


@dataclasses.dataclass(frozen=True, eq=False)
class FieldPart:
    """A field where one of the device's materials is: an expression, where it is integrated, and the owned local cells."""

    field: Expr
    measure: ufl.Measure
    cells: npt.NDArray[np.int32]


@dataclasses.dataclass(frozen=True)
class CellChoice:
    """Some of a device's cells, of a region, ``above`` a height and ``within`` a distance from the axis in m along the lift
    (empty or 0 for any), chosen where its mesh is made; they move with the design."""

    region: str = ""
    above: float = 0.0
    within: float = 0.0

    def of(self, design: quantities.DesignedBody, cells: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
        """Return those of some cells that are chosen; raise ValueError for an unknown region."""
        body = design.system.body
        if self.region and self.region not in body.regions:
            known = ", ".join(body.regions) or "none"
            raise ValueError(f"the device has no region {self.region!r}; it has {known}")
        chosen = np.intersect1d(cells, body.regions[self.region]).astype(np.int32) if self.region else cells
        if self.above or self.within:
            middles = meshes.compute_midpoints(body.mesh, body.mesh.topology.dim, chosen) * design.system.length_unit
            places, lift = body.actuator.device_points(middles), np.asarray(body.actuator.lift)
            heights = places @ lift
            far = np.linalg.norm(places - np.outer(heights, lift), axis=1)
            chosen = chosen[(heights >= self.above) & ((far <= self.within) if self.within else True)]
        return chosen

    @property
    def words(self) -> str:
        """Which they are, a clause with a blank in front; empty for all."""
        told = f" of {self.region}" if self.region else ""
        told += f" above {1e3 * self.above:g} mm" if self.above else ""
        return told + (f" within {1e3 * self.within:g} mm" if self.within else "")


ALL_CELLS = CellChoice()


def stretch_field(design: quantities.DesignedBody, where: CellChoice = ALL_CELLS) -> list[FieldPart]:
    """Return the largest principal stretch in some cells."""
    return _parts(design, lambda _: ufl.sqrt(laws.eigenvalues(design.strain.C)[0]), where)


def mises_field(design: quantities.DesignedBody, where: CellChoice = ALL_CELLS) -> list[FieldPart]:
    """Return the von Mises stress in shear moduli, of the deviator of (dW/dF) F^T / J, in some cells."""

    def field(region: regions.MaterialRegion) -> Expr:
        F = ufl.variable(design.system.body.deformation_gradient(design.system.potential.displacement))
        strain = laws.Strain(F)
        stress = ufl.diff(region.shape(strain), F) * F.T / strain.J
        deviator = stress - ufl.tr(stress) / 3 * ufl.Identity(3)
        return ufl.sqrt(1.5 * ufl.inner(deviator, deviator) + 1e-12)  # the root is not differentiable at zero

    return _parts(design, field, where)


def _parts(
    design: quantities.DesignedBody, field: Callable[[regions.MaterialRegion], Expr], where: CellChoice
) -> list[FieldPart]:
    body, parts = design.system.body, []
    for region in design.system.potential.regions:
        cells = where.of(design, region.cells)
        if mpi.any_rank(body.mesh.comm, len(cells) > 0):
            parts.append(FieldPart(field(region), region.dx if where == ALL_CELLS else cell_measure(body, cells), cells))
    if not parts:
        raise ValueError(f"no cell of the device lies{where.words}")
    return parts


def over_parts(
    design: quantities.DesignedBody,
    parts: Sequence[FieldPart],
    integrands: Sequence[Callable[[Expr], Expr] | None],
    combine: quantities.Combine,
) -> tuple[list[ufl.Form], quantities.Combine]:
    """Return the integrals of functions of a field (None for 1) over its parts, and a function of each one's sum over them."""
    body, unit = design.system.body, fem.Constant(design.system.body.mesh, 1.0)
    values = ((unit if function is None else function(part.field), part) for function in integrands for part in parts)
    forms = [value * body.hoop * part.measure for value, part in values]

    def summed(values: Array) -> tuple[float, Array]:
        value, slopes = combine(values.reshape(len(integrands), -1).sum(axis=1))
        return value, np.repeat(slopes, len(parts))

    return forms, summed


class PeakStretch(quantities.DesignQuantity, name="peak_stretch", unit="1"):
    """Peak of the largest principal stretch: its mean over the 0.5 % of the silicone where it is largest."""

    def measure(self, design: quantities.DesignedBody) -> quantities.Measure:
        return PeakMeasure(
            design, stretch_field(design), lambda _, stretches: stretches[..., -1], counted_in_stress=False, rest=1.0
        )


class PeakVonMises(quantities.DesignQuantity, name="peak_von_mises", unit="Pa"):
    """Peak of the von Mises stress: its mean over the 0.5 % of the silicone where it is largest."""

    @property
    def title(self) -> str:
        return "peak von Mises stress"

    def measure(self, design: quantities.DesignedBody) -> quantities.Measure:
        return PeakMeasure(design, mises_field(design), _mises, counted_in_stress=True)


quantities.QUANTITIES.update({"max_stretch": PeakStretch, "von_mises": PeakVonMises})
"""Names in problem files of earlier versions, which meant a mean of high powers, fitted to the largest value at a point."""


# ----------------------------------------------------------------------------------------------------------------------
# Even stress: the standard deviation of the von Mises stress over the silicone or a region, and its power mean, a robust peak.


class OfRegion(quantities.DesignQuantity):
    """A quantity of the stress or stretch over a region (the whole device if empty), in cells above a least height along the
    lift and within a largest distance from the axis along it, in m or texts with a unit; 0 for any."""

    region: str = ""
    above: float = 0.0
    within: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("above", "within"):
            object.__setattr__(self, name, quantities.length(name, getattr(self, name)))

    @property
    def cells(self) -> CellChoice:
        return CellChoice(self.region, self.above, self.within)

    @property
    def title(self) -> str:
        return self.name.replace("_", " ").replace("von mises", "von Mises") + self.cells.words


class StressDeviation(OfRegion, name="stress_deviation", unit="Pa"):
    """Standard deviation of the von Mises stress over a region, by volume."""

    relative: ClassVar = False

    def measure(self, design: quantities.DesignedBody) -> quantities.Measure:
        def deviation(values: Array) -> tuple[float, Array]:
            volume, first, second = values
            mean = first / volume
            spread = max(second / volume - mean**2, 1e-300) ** 0.5
            slopes = np.array([2 * mean**2 - second / volume, -2 * mean, 1.0]) / (2 * volume * spread)
            if not self.relative:
                return spread, slopes
            return spread / mean, (slopes - spread / mean * np.array([-mean, 1.0, 0.0]) / volume) / mean

        functions = [None, lambda field: field, lambda field: field**2]
        forms, combine = over_parts(design, mises_field(design, self.cells), functions, deviation)
        return quantities.FormMeasure(design, forms, combine, counted_in_stress=not self.relative)


class StressUnevenness(StressDeviation, name="stress_unevenness", unit="1"):
    """The same over the mean: 0 of a silicone that is stressed evenly."""

    relative: ClassVar = True


class PowerMeasure(quantities.FormMeasure):
    """Power mean of a field over the body, (mean of field^p)^(1/p), counted from its value at rest."""

    def __init__(
        self,
        design: quantities.DesignedBody,
        fields: Sequence[FieldPart],
        exponent: float,
        rest: float,
        counted_in_stress: bool,
    ):
        self._p, self._rest = exponent, rest
        self._scale = fem.Constant(design.system.body.mesh, 1.0)  # of powers, which would not be numbers otherwise
        functions = [lambda field: ((field - rest) / self._scale) ** exponent, None]
        forms, combine = over_parts(design, fields, functions, self._mean)
        super().__init__(design, forms, combine, counted_in_stress=counted_in_stress)

    def _mean(self, values: Array) -> tuple[float, Array]:
        powers, volume = values
        mean = float(self._scale.value) * (powers / volume) ** (1 / self._p)
        return self._rest + mean, mean / self._p * np.array([1 / powers, -1 / volume])

    def slopes(self, state: State | None) -> quantities.Slopes:
        self._scale.value = 1.0
        unit = self.design.system.stress_unit if self.counted_in_stress else 1.0
        self._scale.value = max(self._combined()[0] / unit - self._rest, 1e-12)
        return super().slopes(state)

    def note(self, value: float) -> str:
        what = "von Mises stress" if self.counted_in_stress else "stretch minus 1"
        more = "" if self.counted_in_stress else ", plus 1"
        return f"(mean of {what} to the power {self._p:g} over the volume) to the power 1/{self._p:g}{more}"


class PowerMean(OfRegion):
    """A power mean of an exponent from 2 to 40, between the mean (1) and the largest value (infinity)."""

    exponent: float = 8.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 2.0 <= self.exponent <= 40.0:
            raise ValueError(f"exponent is {self.exponent:g}; it must be from 2 to 40")


class StressNorm(PowerMean, name="von_mises_norm", unit="Pa"):
    """Power mean of the von Mises stress over the silicone or a region."""

    def measure(self, design: quantities.DesignedBody) -> quantities.Measure:
        return PowerMeasure(design, mises_field(design, self.cells), self.exponent, 0.0, counted_in_stress=True)


class StretchNorm(PowerMean, name="stretch_norm", unit="1"):
    """Power mean of the largest principal stretch over the silicone or a region, counted from 1."""

    def measure(self, design: quantities.DesignedBody) -> quantities.Measure:
        return PowerMeasure(design, stretch_field(design, self.cells), self.exponent, 1.0, counted_in_stress=False)


# ----------------------------------------------------------------------------------------------------------------------
# Smallest gap between facing walls; negative if they overlap.
#
# The gap at a place of the surface is that of `softmodels.runs.state_values`: the signed distance to the closest place of a
# wall that it faces. The minimum of several values is not differentiable where two are equal. The quantity is therefore the
# smooth minimum of Kreisselmeier and Steinhauser (1979, doi 10.1016/S1474-6670(17)65584-8),
#
#     -ln(sum over places exp(-rho gap)) / rho,    rho = `MINIMUM_SHARPNESS` / t,
#
# with the thickness t of the thinnest of these walls on the initial mesh. It never exceeds the smallest gap, and is below
# it by ln(k)/rho for k equally close places, so a design that keeps it positive has no overlapping walls. The smallest gap
# itself is reported too.


MINIMUM_SHARPNESS = 50.0
"""rho times the thickness of the thinnest wall: ten places that are equally close take 5 % of that thickness off the gap."""


class NodesMeasure(quantities.Measure):
    """A function of the deformed places of all nodes."""

    def __init__(self, design: quantities.DesignedBody):
        self.design, self.system = design, design.system
        self._grid = state_values.Grid(self.system)
        skew, _ = state_values.displacement_maps(self.system, self._grid)
        self._skew = skew[: self._grid.owned]
        self._from_nodes = _interpolation(self._grid, design)
        self._made = self._places()

    @abc.abstractmethod
    def _smooth(self, shift: Array | None) -> tuple[float, str, Array | None]:
        """Return the value in SI units, a note, and the derivative by the places of the grid's nodes, on rank 0, with these
        shifted from the undeformed mesh as it was made by a shift in m, shape (n, 3)."""

    def slopes(self, state: State | None) -> quantities.Slopes:
        system, grid, motion = self.system, self._grid, self.design.motion
        assert state is not None
        moved = in_space(system.w.x.array[self._skew] @ system.body.skew_inverse.T * system.length_unit)
        shift = grid.collect(self._places() - self._made + moved)
        value, note, rates = mpi.on_root(system.comm, lambda: self._smooth(shift))
        mesh = grid.distribute(rates if mpi.is_root(system.comm) else None) * system.length_unit  # by dimensionless places
        mesh = mesh if motion.dimension == 3 else mesh[:, [0, 2]]
        by_w = np.zeros(system.n)
        by_w[self._skew] = mesh @ system.body.skew_inverse
        return quantities.Slopes(value, system.by_unknowns(by_w).copy(), 0.0, self._by_nodes(mesh), note)

    def _places(self) -> Array:
        """Return the owned nodes of the grid on the current mesh, device coordinates in m, shape (n, 3)."""
        system = self.system
        here = self._grid.space.tabulate_dof_coordinates()[: self._grid.owned] * system.length_unit
        return system.body.actuator.device_points(here)

    def _by_nodes(self, rates: Array) -> Array:
        """Return the derivatives by the grid's owned nodes, shape (n, d), as those by the mesh's own nodes; see `Slopes.X`."""
        b = fem.Function(self.design.motion.space).x
        b.array[:] = (self._from_nodes.T @ rates).ravel()
        b.scatter_reverse(la.InsertMode.add)
        return np.array(b.array)


class GapMeasure(NodesMeasure):
    """The smooth least gap of a meshed design."""

    def __init__(self, design: quantities.DesignedBody):
        super().__init__(design)
        self._walls: state_values.FacingWalls | None = None  # on rank 0
        self._rho = 0.0

    def _smooth(self, shift: Array | None) -> tuple[float, str, Array | None]:
        assert shift is not None
        grid = self._grid
        if self._walls is None:
            planes = [plane.normal for plane in self.system.body.actuator.cut_planes]
            self._walls = state_values.FacingWalls(grid.points, grid.cells, grid.cell_name, planes)
        gaps, rates = self._near(self._walls, shift), np.zeros_like(shift)
        if not len(gaps.values):  # within the search distance
            return state_values.OVERLAP_REACH * self._walls.size, "no walls are near each other", rates
        if not self._rho:
            self._rho = MINIMUM_SHARPNESS / float(gaps.thickness.min())
        least = float(gaps.values.min())
        weights = np.exp(-self._rho * (gaps.values - least))
        near = weights > 1e-16
        value = least - float(np.log(weights.sum())) / self._rho
        _add_rates(rates, self._walls, gaps, near, weights[near] / weights.sum())
        return value, f"the smallest gap is {1e3 * least:.4g} mm", rates

    @staticmethod
    def _near(walls: state_values.FacingWalls, shift: Array) -> state_values.Gaps:
        """Return the gaps up to twice the least one, or as far as they are looked for."""
        reach = state_values.GAP_REACH * walls.size
        while True:
            gaps = walls.gaps(shift, reach)
            if np.min(gaps.values, initial=np.inf) < reach / 2 or reach >= state_values.OVERLAP_REACH * walls.size:
                return gaps
            reach *= 2.0


def _add_rates(
    rates: Array, walls: state_values.FacingWalls, gaps: state_values.Gaps, chosen: npt.NDArray[np.bool_], shares: Array
) -> None:
    """Add the derivatives of chosen gaps by the nodes' places, times a share of each."""
    facets, others, normals = gaps.facets[chosen], gaps.others[chosen], gaps.normals[chosen]
    own, other = walls.shapes(gaps.points[chosen]), gaps.weights[chosen]
    plane = others < 0
    along = shares[:, None] * normals
    # The image in a cut plane moves against the place itself.
    np.add.at(rates, walls.facets[facets], np.where(plane, 2.0, 1.0)[:, None, None] * own[:, :, None] * along[:, None])
    np.add.at(rates, walls.facets[others[~plane]], -other[~plane][:, :, None] * along[~plane][:, None])


def _interpolation(grid: state_values.Grid, design: quantities.DesignedBody) -> scipy.sparse.csr_matrix:
    """Return the places of the grid's owned nodes from those of the mesh's own local nodes, shape (owned, nodes of
    `MeshMotion.space`)."""
    mesh, space = grid.space.mesh, design.motion.space
    element = basix.ufl.element("P", mesh.basix_cell(), mesh.geometry.cmaps[0].degree)
    shapes = element.tabulate(0, grid.space.element.interpolation_points)[0]  # (grid's nodes of a cell, mesh's nodes of it)
    nodes, own = np.asarray(grid.space.dofmap.list), np.asarray(space.dofmap.list)
    owned, first = np.unique(nodes.ravel(), return_index=True)
    cell, local = np.divmod(first[owned < grid.owned], nodes.shape[1])
    rows = np.repeat(np.arange(grid.owned), own.shape[1])
    size = (grid.owned, len(space.tabulate_dof_coordinates()))
    return scipy.sparse.csr_matrix((shapes[local].ravel(), (rows, own[cell].ravel())), shape=size)


class LeastGap(quantities.DesignQuantity, name="least_gap", unit="m"):
    """Smallest gap between facing walls, as a smooth minimum; negative if they overlap."""

    def measure(self, design: quantities.DesignedBody) -> quantities.Measure:
        return GapMeasure(design)


# ----------------------------------------------------------------------------------------------------------------------
# Height of the highest point: the smooth maximum (as of the gaps) of the heights of all nodes, which is never below the
# highest node.


HEIGHT_SHARPNESS = 1000.0
"""rho times the device's size: ten nodes of one height add 0.2 % of the size."""


class _TopMeasure(NodesMeasure):
    """The height of the highest node along the lift."""

    def _smooth(self, shift: Array | None) -> tuple[float, str, Array | None]:
        assert shift is not None
        lift = np.asarray(self.system.body.actuator.lift)
        heights, rho = (self._grid.points + shift) @ lift, HEIGHT_SHARPNESS / self.system.length_unit
        highest = float(heights.max())
        weights = np.exp(rho * (heights - highest))
        value = highest + float(np.log(weights.sum())) / rho
        return value, f"the highest node is at {1e3 * highest:.5g} mm", np.outer(weights / weights.sum(), lift)


class TopHeight(quantities.DesignQuantity, name="top_height", unit="m"):
    """Height of the highest point of the deformed device, as a smooth maximum."""

    def measure(self, design: quantities.DesignedBody) -> quantities.Measure:
        return _TopMeasure(design)
