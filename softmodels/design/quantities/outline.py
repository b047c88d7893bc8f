"""Distance of a device's outline from a target outline, measured or drawn."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import numpy.typing as npt

from softmodels.common.arrays import Array
from softmodels.design.quantities.base import DesignQuantity, Slopes, TargetMeasure, length, register_quantity
from softmodels.fitting.outlines.shapes import correlation, read_outlines, rising
from softmodels.fitting.outlines.silhouette import Silhouette, shadow_of
from softmodels.mechanics.body import BodyError
from softmodels.mechanics.mpi import everywhere, is_root, scattered

if TYPE_CHECKING:
    from softmodels.design.body import DesignedBody
    from softmodels.mechanics.system import State
    from softmodels.runs.grid import Closest, QuadraticCurve


# ----------------------------------------------------------------------------------------------------------------------
# The outline of a device whose mesh follows its design.


class MovedSilhouette(Silhouette):
    """The outer curve of a device under design, with the transpose of its derivative.

    Args:
        design: The device, its mesh as it was made.

    Raises:
        BodyError: The mesh has no such curve.

    Attributes:
        round: Whether the device is a body of revolution, of which both sides are seen alike.
    """

    def __init__(self, design: DesignedBody):
        super().__init__(design.system)
        self.design, actuator = design, design.system.body.actuator
        self.round = actuator.dimension == 2 or len(actuator.cut_planes) > 1
        axes = np.array([self._along, actuator.lift])
        self._axes = axes if actuator.dimension == 3 else axes[:, [0, 2]]
        """From the mesh's components to those of the outline's plane, shape (2, d)."""

    def transposed(self, covector: Array) -> tuple[Array, Array]:
        """Return the transpose of `moved`: from a covector on the curve's nodes, shape (n, 3, 2), the same on all ranks.

        Returns:
            By the owned unknowns, zero at held ones, and by the mesh's nodes, flat over `MeshMotion.space`.
        """
        system, motion = self.system, self.design.motion
        on_places = covector.copy()
        on_places[0, 0] -= covector.sum(axis=(0, 1))  # heights and distances count from the undeformed top
        axes = system.length_unit * self._axes
        by_w = _added(system.space, self._dofs, self._of_edges(covector) @ axes @ system.body.skew_inverse)
        at_nodes = np.einsum("sk,msd->mkd", self._mix, self._of_edges(on_places) @ axes)
        components = motion.dimension * self._blocks[..., None] + np.arange(motion.dimension)
        return system.by_unknowns(by_w[: system.n]).copy(), _added(motion.space, components, at_nodes)

    def _of_edges(self, values: Array) -> Array:
        """Return the transpose of gathering and arranging: values on the chain to this rank's edges, (m, 3, 2)."""
        back = values.copy()
        back[self._turned] = back[self._turned][:, [1, 0, 2]]
        comm, count = self.system.comm, len(self._dofs)
        found = np.zeros((len(everywhere(comm, np.zeros(count))), 3, 2))
        found[self._order] = back
        return scattered(comm, found if is_root(comm) else None, count)


def _added(space: object, dofs: npt.NDArray[np.integer], values: Array) -> Array:
    """Return the values added up at dofs, shape (local dofs,), complete on their owners."""
    from dolfinx import fem, la

    b = fem.Function(space).x
    np.add.at(b.array, dofs, values)
    b.scatter_reverse(la.InsertMode.add)
    return np.array(b.array)


FEWEST = 3
ONE_SIDED = 0.1
"""Fraction of its width within which the top of a one-sided outline lies, from the axis outwards."""


class OutlineMeasure(TargetMeasure):
    """Distances of points from the outline of a state.

    Args:
        design: The device, its mesh as it was made.
        points: In the outline's plane, m, shape (k, 2): distance from the axis (or clamped base) and height above the
            undeformed apex.
        measured: Whether heights are measured ones, that count from a flat surface.

    Raises:
        ValueError: The device has no outline, or its top is curved and a measured outline counts from a flat one.
    """

    def __init__(self, design: DesignedBody, points: Array, measured: bool):
        try:
            self.silhouette = MovedSilhouette(design)
        except BodyError as error:
            raise ValueError(f"no target outline: {error}") from None
        if measured and not self.silhouette.flat:
            raise ValueError(
                f"the undeformed top of the device is {self.silhouette.unevenness * 1e3:.3g} mm from flat, but heights "
                "of measured outlines count from a flat surface; give points with heights above its undeformed apex"
            )
        self.points = points
        if self.silhouette.round:
            away = points[:, 0] - (_middle(points) if measured else 0.0)
            self.points = np.column_stack([np.abs(away), points[:, 1]])

    def _closest(self, state: State) -> tuple[Closest, npt.NDArray[np.int64], Array]:
        """Return the closest points, and for each the piece of the curve that it is on with the weights of that piece's
        nodes."""
        curve: QuadraticCurve = self.silhouette.curve(state)
        if not self.silhouette.round:
            found = curve.closest(self.points)
            return found, found.piece, found.weights
        shadow = shadow_of(curve)
        found = shadow.curve.closest(self.points)
        return found, shadow.source[found.piece], np.einsum("ka,kab->kb", found.weights, shadow.weights[found.piece])

    def slopes(self, state: State | None) -> Slopes:
        assert state is not None
        found, piece, weights = self._closest(state)
        left = found.distance
        value = float(np.sqrt(left @ left / len(left)))
        rates = left / (len(left) * value) if value else np.zeros(len(left))
        covector = np.zeros((*self.silhouette.points.shape[:2], 2))
        np.add.at(covector, piece, -rates[:, None, None] * weights[..., None] * found.normal[:, None, :])
        by_w, by_X = self.silhouette.transposed(covector)
        return Slopes(value, by_w, 0.0, by_X, self._note())

    def _note(self) -> str:
        if self.silhouette.flat:
            return ""
        uneven = self.silhouette.unevenness * 1e3
        return f"the undeformed top is {uneven:.3g} mm from flat, and heights are counted from its apex"

    def residuals(self, state: State) -> Array:
        return self._closest(state)[0].distance

    def moved(self, state: State, w: Array, X: Array) -> Array:
        found, piece, weights = self._closest(state)
        return -np.einsum("kb,kbi,ki->k", weights, self.silhouette.moved(w, X)[piece], found.normal)


@register_quantity
@dataclasses.dataclass(frozen=True, kw_only=True)
class Outline(DesignQuantity):
    """Root mean square distance between points and the deformed outline.

    Of a disk the outline is its shadow; of a half slab its top's edge in the mirror plane, from the clamped base to the tip.

    Attributes:
        file: An outline that ``measurement photos`` has written; its points that rise are taken. A disk's axis is at its
            middle, or at 0 if it begins at its top.
        points: Or the points themselves, in m: distance from the axis (of a slab from the clamped base) and height above the
            undeformed apex.
        sigma: Standard error of a point across the outline in m, or a text with a unit; 0 to estimate it from what is left.
        run: Correlation length of the points' errors, in points.
    """

    name: ClassVar = "outline"
    unit: ClassVar = "m"
    help: ClassVar = "root mean square distance of the deformed outline from a target outline"

    file: str = ""
    points: tuple[tuple[float, float], ...] = ()
    sigma: float = 0.0
    run: float = dataclasses.field(default=1.0, init=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        if bool(self.file) == (len(self.points) > 0):
            raise ValueError("an outline needs either a file of points or the points themselves")
        object.__setattr__(self, "sigma", length("sigma", self.sigma))
        if self.file:
            points, run = _measured(Path(self.file))
            object.__setattr__(self, "run", run)
        else:
            try:
                points = np.array(self.points, dtype=float).reshape(len(self.points), 2)
            except (TypeError, ValueError):
                raise ValueError(
                    "the points of an outline are pairs: distance from the axis and height, in m"
                ) from None
        if len(points) < FEWEST or not np.isfinite(points).all():
            raise ValueError(f"an outline needs at least {FEWEST} points, all finite")
        object.__setattr__(self, "points", tuple(map(tuple, points.tolist())))

    @property
    def title(self) -> str:
        return f"distance from the outline {Path(self.file).stem}" if self.file else "distance from the outline"

    def measure(self, design: DesignedBody) -> OutlineMeasure:
        made = OutlineMeasure(design, np.array(self.points), bool(self.file))
        made.run, made.sigma = self.run, self.sigma
        return made


def _measured(file: Path) -> tuple[Array, float]:
    """Return the risen points of a measured outline, and the correlation length of their residuals in points.

    Raises:
        ValueError: No outline, one that is not trusted, or nothing rises.
    """
    (outline,) = read_outlines([file])
    outline = outline.measured()
    part = rising(outline)
    if part is None:
        raise ValueError(f"{file}: no point of this outline rises, so it is not usable as a target")
    return np.column_stack([outline.x[part], outline.z[part]]), correlation([outline])


def _middle(points: Array) -> float:
    """Return the axis position of a measured outline: the centroid under it, or 0 if it shows only one side."""
    x, z = points[:, 0], np.maximum(points[:, 1], 0.0)
    if x[np.argmax(z)] - x[0] < ONE_SIDED * np.ptp(x):
        return 0.0
    return float(np.trapezoid(x * z, x) / np.trapezoid(z, x))
