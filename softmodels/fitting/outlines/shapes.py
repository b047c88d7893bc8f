"""Prepare measured outlines for a fit: check them, cut them to the risen part, and average correlated points.

Neighbouring points of an outline are correlated by smoothing. The fit uses means over bins of
three correlation lengths (integrated autocorrelation), each with the error of such a mean.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.interpolate import make_lsq_spline

from geometries import Actuator
from measurement.outline.edge import SPAN
from measurement.outline.outline import History, Outline, OutlineError, hold_of
from softmodels.common.arrays import Array
from softmodels.common.names import keep_arrays
from softmodels.common.units import pascal_per_cm
from softmodels.fitting.problem import FitError, autocorrelation_time

# ----------------------------------------------------------------------------------------------------------------------
# Read files of outlines, and exclude photographs.


class OutlineFitError(FitError):
    """Outlines cannot be fitted; the message is for the user."""


def read_outlines(files: Sequence[Path], untrusted: bool = False, exclude: Sequence[str] = ()) -> list[Outline]:
    """Read outlines' files, or all in a folder, but for photographs or files excluded by name.

    Raises `OutlineFitError` for no file, one that is no outline, or one that the measurement does not trust, unless
    ``untrusted``.
    """
    names: list[Path] = []
    for file in files:
        found = sorted(p for p in file.glob("*.csv") if p.name != "heights.csv") if file.is_dir() else [file]
        if not found:
            raise OutlineFitError(f"the folder {file} holds no outlines; create them with python -m measurement photos")
        names += found
    if not names:
        raise OutlineFitError("no measurements; give outlines made by python -m measurement photos")
    outlines = []
    for name in names:
        try:
            outlines.append(Outline.from_csv(name))
        except OutlineError as error:
            raise OutlineFitError(str(error)) from None
    keep = kept([(outline.source, name) for name, outline in zip(names, outlines, strict=True)], exclude)
    names, outlines = [names[i] for i in keep], [outlines[i] for i in keep]
    doubted = [(name, outline) for name, outline in zip(names, outlines, strict=True) if outline.trust == "no"]
    if doubted and not untrusted:
        name, outline = doubted[0]
        more = f", and {len(doubted) - 1} more" if len(doubted) > 1 else ""
        raise OutlineFitError(
            f"{name} is untrusted ({'; '.join(outline.reasons)}){more}; exclude it, write anyway "
            "beside it in the column use of the list of photographs and measure again, or use all with --untrusted"
        )
    return outlines


def kept(rows: Sequence[tuple[str, Path | None]], exclude: Sequence[str]) -> list[int]:
    """Return which rows, photographs with their files, are not excluded by name; `OutlineFitError` for a name that is none
    of them, or if nothing is left."""
    left = {}
    for name in exclude:
        found = [
            i for i, (source, file) in enumerate(rows)
            if name in (source, Path(source).stem, *((str(file), file.name, file.stem) if file else ()))
        ]  # fmt: skip
        if not found:
            known = ", ".join(source for source, _ in rows)
            raise OutlineFitError(f"--exclude {name}: there is no such photograph; there are {known}")
        left.update(dict.fromkeys(found))
    keep = [i for i in range(len(rows)) if i not in left]
    if rows and not keep:
        raise OutlineFitError("--exclude removes all measurements; keep at least one")
    return keep


FLOOR = 1e-4
"""Minimum height in m of used points: below, the support and the surrounding flat surface are visible too."""

FLOOR_ERRORS = 5.0
"""The same in standard errors, so that noise is not selected."""

FEWEST = 12
"""Minimum number of points above the floor of an outline."""

BIN = 3.0
"""Length of a bin in units of the errors' autocorrelation."""

KNOT = 60
"""Points per knot of the spline that represents the outline's shape when estimating its noise."""

LONGEST = 60.0
"""Maximum autocorrelation length, in points."""

TALLEST = 10.0
"""Maximum height of an outline, in widths of the device."""

SHALLOWEST = 1e-4
"""Minimum largest height of a series, in widths of the device."""

STRONGEST = 5e6
"""Maximum pressure in Pa of a silicone device."""

CLOSE = 1e-6
"""Relative tolerance of equal readings."""

ALIKE = 0.1
"""Relative tolerance of equal heights; two states at one pressure past a limit point differ more."""


@dataclasses.dataclass(frozen=True, eq=False)
class Shape:
    """An outline prepared for the fit.

    Attributes:
        points: Measured points, shape (k, 2), m.
        error: Standard error of each across the outline, shape (k,), m.
        bins: Bin of each point, rising from 0, shape (k,).
        weight: What the mean of a bin's standardised distances is multiplied with to have variance 1, shape (bins,).
        pressure, pressure_error: Reading and its standard error in Pa.
        height: Height of the top in m.
        centre: Where along x the middle of its area is, in m.
        scale_error: Standard error of all lengths together, as a share of them; 0 where none is stated.
        level_error: Standard error in m of all heights together.
        history: Pressures up to the photograph; empty if the times are not known.
    """

    source: str
    points: Array
    error: Array
    bins: npt.NDArray[np.int64]
    weight: Array
    pressure: float
    pressure_error: float
    height: float
    centre: float
    scale_error: float = 0.0
    level_error: float = 0.0
    history: History = ()

    def __post_init__(self) -> None:
        keep_arrays(self)

    @property
    def hold(self) -> float:
        """How long in s the pressure was held before the photograph; nan if that is not known."""
        return hold_of(self.history)

    @property
    def name(self) -> str:
        """Name of the photograph in messages."""
        held = f", held {self.hold:.4g} s" if self.history else ""
        return f"{self.pressure / pascal_per_cm():.4g} cm of water{held} ({self.source})"

    def mean(self, values: Array) -> Array:
        """Return the means over the bins of values (k, ...) divided by the points' errors, as residuals of variance 1."""
        count = len(self.weight)
        standard = values / self.error.reshape(-1, *[1] * (values.ndim - 1))
        sums = np.zeros((count, *values.shape[1:]))
        np.add.at(sums, self.bins, standard)
        factor = self.weight / np.bincount(self.bins, minlength=count)
        return sums * factor.reshape(-1, *[1] * (values.ndim - 1))


def prepare(outlines: Sequence[Outline], actuator: Actuator, width: float) -> tuple[list[Shape], list[str]]:
    """Check outlines against each other and the device, whose surface's edge is ``width`` m from its axis, and cut and bin
    them. Return shapes by rising pressure, and a sentence on each outline that was left out; `OutlineFitError` for what
    cannot be fitted."""
    # A bridge over a gap is not measured.
    chosen = sorted((outline.measured() for outline in outlines), key=lambda outline: outline.pressure)
    _check_pressures(chosen)
    _check_sizes(chosen, actuator, width)
    cut = [(outline, rising(outline)) for outline in chosen]
    notes = [
        f"{outline.source}: rise below {_floor(outline) * 1e3:.2g} mm: photograph not used"
        for outline, kept in cut
        if kept is None
    ]
    kept = [(outline, part) for outline, part in cut if part is not None]
    if not kept:
        raise OutlineFitError("no outline rises above the undeformed surface; give at least one that does")
    run = correlation([outline for outline, _ in kept])
    shapes = [_shape(outline, part, run) for outline, part in kept]
    _check_place(shapes, width)
    return shapes, notes


def correlation(outlines: Sequence[Outline]) -> float:
    """Return the correlation length of the outlines' residuals in points: the median of integrated autocorrelations.

    The shape is taken out by a spline. Where what is left is far below the stated errors there is no noise to judge by, and
    the measurement's own smoothing span is believed.
    """
    found = []
    for outline in outlines:
        part = rising(outline)
        if part is None or part.stop - part.start < 2 * KNOT:
            continue
        z, error = outline.z[part], outline.error[part]
        left = z - _spline(z)
        if float(np.sqrt(np.mean(left**2))) > 0.05 * float(np.median(error)):
            found.append(autocorrelation_time(left))
    return min(max(float(np.median(found)), 1.0), LONGEST) if found else SPAN / 2


def _spline(z: Array) -> Array:
    n = len(z)
    at = np.arange(n, dtype=float)
    inner = np.linspace(0, n - 1, max(n // KNOT, 2) + 1)[1:-1]
    knots = np.r_[[0.0] * 4, inner, [n - 1.0] * 4]
    return np.asarray(make_lsq_spline(at, z, knots, k=3)(at))


def _floor(outline: Outline) -> float:
    return max(FLOOR, FLOOR_ERRORS * float(np.median(outline.error)))


def rising(outline: Outline) -> slice | None:
    """Return the points between the outermost places at which three neighbours lie above the floor; None if there are too few.

    A cut by place: a cut by each point's own height would keep those whose errors point up. So would the places themselves,
    but for a smoothing span less at both ends.
    """
    high = outline.z > _floor(outline)
    if len(high) < FEWEST:
        return None
    steady = np.flatnonzero(high[:-2] & high[1:-1] & high[2:])
    if not len(steady):
        return None
    first, last = int(steady[0]), int(steady[-1]) + 3
    spare = min(SPAN, (last - first) // 10)
    return slice(first + spare, last - spare) if last - first - 2 * spare >= FEWEST else None


def _shape(outline: Outline, part: slice, run: float) -> Shape:
    x, z, error = outline.x[part], outline.z[part], outline.error[part]
    count = max(round(len(x) / (BIN * run)), 1)
    # With correlated errors, every few points carry the same information as all.
    stride = max(int(run / 3), 1)
    pick = np.arange(stride // 2, len(x), stride)
    bins = pick * count // len(x)
    bins = np.unique(bins, return_inverse=True)[1]
    weight = np.full(int(bins.max()) + 1, math.sqrt(max(len(x) / count / run, 1.0)))
    centre = float(np.trapezoid(x * np.maximum(z, 0.0), x) / np.trapezoid(np.maximum(z, 0.0), x))
    return Shape(
        outline.source, np.column_stack([x, z])[pick], error[pick], bins, weight, outline.pressure,
        outline.pressure_error, outline.height, centre, outline.scale_error, outline.level_error, outline.history,
    )  # fmt: skip


def _check_pressures(outlines: Sequence[Outline]) -> None:
    if not outlines:
        raise OutlineFitError("nothing to fit to; give outlines that python -m measurement photos has made")
    for outline in outlines:
        if not outline.pressure_error > 0.0:
            raise OutlineFitError(
                f"{outline.source}: its pressure has no standard error, which is needed as a "
                "weight; give one in the list of photographs"
            )
        if outline.pressure > STRONGEST:
            raise OutlineFitError(
                f"{outline.source}: a pressure of {outline.pressure / 1e3:.4g} kPa is too high for silicone; check its unit"
            )
    for one, two in itertools.pairwise(outlines):
        same = two.pressure - one.pressure <= CLOSE * abs(two.pressure)
        if (
            same
            and one.history == two.history
            and abs(two.height - one.height) <= ALIKE * max(abs(two.height), abs(one.height), FLOOR)
        ):
            raise OutlineFitError(
                f"{one.source} and {two.source} have the same pressure, {two.pressure:.5g} Pa, and the same height: the "
                "measurement would count twice, so give only one of them"
            )


def _check_sizes(outlines: Sequence[Outline], actuator: Actuator, width: float) -> None:
    tallest = max(outlines, key=lambda outline: float(outline.z.max()))
    top, span = float(tallest.z.max()), max(float(np.ptp(outline.x)) for outline in outlines)
    device = f"a {type(actuator).__name__} of {width * 2e3:.4g} mm across"
    if top > TALLEST * width or span > 50 * width:
        raise OutlineFitError(
            f"{tallest.source} is {top * 1e3:.4g} mm high and up to {span * 1e3:.4g} mm wide, which is impossible for "
            f"{device}; outlines are in metres, so check the unit of the photographs' grid and of the device"
        )
    if 0.0 < span < 0.05 * width or 0.0 < top < SHALLOWEST * width:
        raise OutlineFitError(
            f"the highest outline, {tallest.source}, is {top * 1e3:.4g} mm high and {span * 1e3:.4g} mm wide; for {device} "
            f"this suggests a wrong unit (outlines are in metres)"
        )


def _check_place(shapes: Sequence[Shape], width: float) -> None:
    """Check that the device is as wide as the risen part, and does not move."""
    low = min(shapes, key=lambda shape: shape.height)
    wide = float(np.ptp(low.points[:, 0]))
    if wide > 2.0 * width * 1.05:
        raise OutlineFitError(
            f"{low.source}: the risen part is {wide * 1e3:.4g} mm wide at a height of {low.height * 1e3:.3g} mm, more "
            f"than the device's {width * 2e3:.4g} mm: this is not the device of the case"
        )
    centres = [shape.centre for shape in shapes]
    if np.ptp(centres) > 0.25 * width:
        raise OutlineFitError(
            f"the outlines' centres are up to {np.ptp(centres) * 1e3:.3g} mm apart: the device or the camera has moved, or "
            "some photographs show only a part of it"
        )
