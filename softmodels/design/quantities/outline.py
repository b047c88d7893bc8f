"""How far a device's outline is from one that it is to have: a measured one, or one that is drawn."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import numpy.typing as npt

from softmodels.design.moved_silhouette import MovedSilhouette
from softmodels.design.quantities.base import Quantity, Slopes, TargetMeasure, length, quantity
from softmodels.fitting.outlines.reading import read_outlines
from softmodels.fitting.outlines.shadow import shadow_of
from softmodels.fitting.outlines.shapes import correlation, rising
from softmodels.mechanics.body import BodyError

if TYPE_CHECKING:
    from softmodels.design.designed_body import DesignedBody
    from softmodels.mechanics.system import State
    from softmodels.results.quadratic_curve import Closest, QuadraticCurve

Array = npt.NDArray[np.float64]

FEWEST = 3
ONE_SIDED = 0.1
"""An outline whose top is in this share of its width from its beginning shows one side, from the axis outwards."""


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
            raise ValueError(f"there is no outline to follow: {error}") from None
        if measured and not self.silhouette.flat:
            raise ValueError(
                f"the undeformed top of the device is {self.silhouette.unevenness * 1e3:.3g} mm from flat, and heights of "
                "measured outlines are counted from a flat surface; give points with heights above its undeformed apex"
            )
        self.points = points
        if self.silhouette.round:
            away = points[:, 0] - (_middle(points) if measured else 0.0)
            self.points = np.column_stack([np.abs(away), points[:, 1]])

    def _closest(self, state: State) -> tuple[Closest, npt.NDArray[np.int64], Array]:
        """Closest points, and for each the piece of the curve that it is on with the weights of that piece's nodes."""
        self.silhouette.follow()
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


@quantity
@dataclasses.dataclass(frozen=True, kw_only=True)
class Outline(Quantity):
    """Root mean square distance between points and the deformed outline.

    Of a disk the outline is its shadow; of a half slab its top's edge in the mirror plane, from the clamped base to the tip.

    Attributes:
        file: An outline that ``measurement photos`` has written; its points that rise are taken. A disk's axis is at its
            middle, or at 0 if it begins at its top.
        points: Or the points themselves, in m: distance from the axis (of a slab from the clamped base) and height above the
            undeformed apex.
        sigma: Standard error of a point across the outline in m, or a text with a unit; 0 to estimate it from what is left.
        run: Over how many neighbours the points' errors keep together.
    """

    name: ClassVar = "outline"
    unit: ClassVar = "m"
    help: ClassVar = "root mean square distance of the deformed outline from one that it is to have"

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
            raise ValueError(f"an outline needs at least {FEWEST} points, all of them finite")
        object.__setattr__(self, "points", tuple(map(tuple, points.tolist())))

    @property
    def title(self) -> str:
        return f"distance from the outline {Path(self.file).stem}" if self.file else "distance from the outline"

    def measure(self, design: DesignedBody) -> OutlineMeasure:
        made = OutlineMeasure(design, np.array(self.points), bool(self.file))
        made.run, made.sigma = self.run, self.sigma
        return made


def _measured(file: Path) -> tuple[Array, float]:
    """Points of a measured outline that rise, and over how many neighbours their errors keep together.

    Raises:
        ValueError: No outline, one that is not trusted, or nothing rises.
    """
    (outline,) = read_outlines([file])
    outline = outline.measured()
    part = rising(outline)
    if part is None:
        raise ValueError(f"{file}: nothing of this outline rises, so it has no shape to follow")
    return np.column_stack([outline.x[part], outline.z[part]]), correlation([outline])


def _middle(points: Array) -> float:
    """Where a measured outline's axis is: the centroid of what lies under it, or 0 where it shows one side alone."""
    x, z = points[:, 0], np.maximum(points[:, 1], 0.0)
    if x[np.argmax(z)] - x[0] < ONE_SIDED * np.ptp(x):
        return 0.0
    return float(np.trapezoid(x * z, x) / np.trapezoid(z, x))
