"""The shape that all light profiles across an edge have in common, and where in it half of the lamp is seen.

A lamp's penumbra is symmetric about the place where half of the lamp is seen: the integral over the chords of a disc, a ramp
or trapezoid of a square, an error function of a frosted bulb, each blurred by the lens. What the camera does to the numbers
is not: a tone curve other than the assumed one, and sharpening of the stored numbers, draw the half light to one side. The
mean of hundreds of profiles shows all of it, so one model is fitted to it: a lamp under a Gaussian blur, x + e x (1 - x) in
place of the light x between shadow and screen, and an unsharp mask of the stored numbers. The lamp's shape moves the edge
nowhere; e and the mask do, and by how much is known as well as they are.

The lamp's light over the distance t from its middle is (1 - t^2/R^2)^m: m = 1/2 is a uniform disc (the length of its
chords), m = 0 a square along its side, m = 3/2 stands for a turned square and for softer lamps.
"""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares
from scipy.special import ndtr

from measurement.robust import deviation

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

STEP, FAR = 0.05, 9.0
"""Distance of the nodes of a tabulated shape, and the distance of the outermost from the edge, in its widths."""

LAMPS = (0.5, 0.0, 1.5)
"""Exponents m of the lamps that are tried."""

BINS, REACH, FEWEST, KIN = 40, 4.0, 20, 4.0
"""Bins of the mean profile, the widths to which they reach on either side, the least number of samples in one, and how many
samples err together."""

PARAMETERS = 6
"""Parameters of the shape that have no prior of their own, or one that is wider than what the profile shows."""

FLOOR, INKED = 6e-4, 3e-3
"""Errors of the mean profile, as a share of the edge's rise, that no number of samples takes away: by the picture's compression
(JPEG files bend profiles that much), and by the ink that is divided out, where every profile has some."""

TONE, SHARPENING, MASK, MASK_SPREAD = 0.03, 0.5, 1.3, 0.6
"""Usual sizes of e and of the mask's amount, and its radius in px with the usual deviation from that.

An S curve that adds a fifth of the smooth step 3 v^2 - 2 v^3 to sRGB's has e = 0.04.
"""

UNKNOWN = 0.03
"""Error of the half light's place in widths where the profiles do not show the edge's shape."""

LEAST = 0.006
"""Error of the half light's place in widths that no photograph's noise tells: edges of one camera differ by that much."""

CAMERA, CAMERA_TONE = 0.012, 0.4
"""Error of the half light's place in widths that the model leaves, as it is no camera's, and how it grows with e."""


@dataclasses.dataclass(frozen=True, eq=False)
class EdgeShape:
    """A symmetric or distorted step from 0 to 1 over the distance from the half light in widths.

    Attributes:
        values: The step at the nodes of `nodes`.
        shift_error: Standard error of the half light's place in it, in widths, by the noise of this photograph.
        model_error: The same by the model, which all photographs with one lamp and camera have in common.
        tone: e, by which the light differs from what the assumed tone curve gives.
        misfit: Root mean square of the mean profile's distance from it in its standard error, with the priors'.
    """

    values: Array
    shift_error: float = 0.0
    model_error: float = 0.0
    tone: float = 0.0
    misfit: float = np.nan

    @property
    def chi_square(self) -> float:
        """Sum of the squares of which ``misfit`` is the mean; infinite where no shape was fitted."""
        return float("inf") if np.isnan(self.misfit) else (BINS - PARAMETERS) * self.misfit**2

    def __call__(self, z: Array) -> Array:
        """The step at distances z (...) in widths."""
        return np.asarray(np.interp(z, nodes(), self.values))

    def slope(self, z: Array) -> Array:
        """Its derivative there."""
        return np.asarray(np.interp(z, nodes(), self._slopes))

    @functools.cached_property
    def _slopes(self) -> Array:
        return np.gradient(self.values, STEP)


@functools.cache
def nodes() -> Array:
    """Distances from the edge in widths at which shapes are tabulated."""
    return np.arange(-FAR, FAR + 0.5 * STEP, STEP)


def gaussian(shift_error: float = 0.0) -> EdgeShape:
    """An error function."""
    return EdgeShape(ndtr(nodes()), shift_error, CAMERA)


@dataclasses.dataclass(frozen=True, eq=False)
class Stored:
    """How light became numbers at an edge.

    Attributes:
        light: Light of every stored number by the assumed tone curve, shape (256,).
        low: Light in the shadow.
        high: Light of the lit screen.
        width: Width of the edge in px.
    """

    light: Array
    low: float
    high: float
    width: float

    def seen(self, share: Array, amount: float, radius: float) -> Array:
        """The light (n,) over light and shadow that a share (n,) of the lamp at `nodes` is taken for after sharpening."""
        numbers = np.linspace(0.0, 1.0, len(self.light))
        stored = np.interp(self.low + (self.high - self.low) * share, self.light, numbers)
        sharp = stored + amount * (stored - _blurred(stored, radius / self.width))
        # Beyond the last number the curve goes on, as a channel mixed of several does.
        back = np.interp(sharp, numbers, self.light)
        back += np.maximum(sharp - 1.0, 0.0) * (self.light[-1] - self.light[-2]) * (len(numbers) - 1.0)
        return np.asarray((back - self.low) / (self.high - self.low))


def common_shape(z: Array, residual: Array, clean: Mask, stored: Stored) -> EdgeShape:
    """The shape that profiles have in common, from what error functions leave of them.

    Args:
        z: Distance of the samples from the middle of each profile's error function in its widths, shape (n, k).
        residual: What that leaves of the profile over its rise, shape (n, k).
        clean: Samples that are clear of ink, shape (n, k).
        stored: How light became numbers.
    """
    sides = (np.abs(z + 1.5) < 1.0, np.abs(z - 1.5) < 1.0)
    # An edge that runs along a grid line, or just beside it, has hardly a sample off the ink on one side.
    on_ink = any(clean[side].mean() < 0.5 for side in sides if side.any())
    place, value, error = _mean_profile(z, residual, np.ones_like(clean) if on_ink else clean)
    if len(place) < BINS // 2:
        return gaussian(UNKNOWN)
    # An edge far out of focus has a grid line in nearly all of its profiles, which leaves more there than e does.
    inked = 1.0 - float(clean.all(axis=1).mean())
    spread = np.hypot(error, np.hypot(FLOOR, INKED * inked))
    fits = [_fitted(place, value, spread, lamp, stored) for lamp in LAMPS]
    lamp, best = min(zip(LAMPS, fits, strict=True), key=lambda pair: float(pair[1].cost))
    misfit = float(np.sqrt(2.0 * best.cost / (len(place) - PARAMETERS)))
    # Neighbouring bins err together to an unknown extent; how far the profile lies off the shape shows how far each errs.
    share = float(np.sqrt(np.sum(best.fun[: len(place)] ** 2) / (len(place) - PARAMETERS)))
    data, priors = best.jac[: len(place)] / share, best.jac[len(place) :]
    own = float(np.sqrt(np.linalg.pinv(data.T @ data + priors.T @ priors)[0, 0]))
    # An asymmetry that is no camera's may be the penumbra's own, as of a deep body's level surface.
    departure = abs(float(best.x[3]))
    strange = 0.6 * max(0.0, departure - 3.0 * TONE)
    model = float(np.hypot(CAMERA, CAMERA_TONE * departure))
    return EdgeShape(
        _shape(best.x, lamp, stored), float(np.linalg.norm([own, LEAST, strange])), model, float(best.x[3]), misfit
    )


def _mean_profile(z: Array, residual: Array, clean: Mask) -> tuple[Array, Array, Array]:
    """Places (m,) in widths, the median profile there and its standard error."""
    bins = np.floor((z + REACH) / (2.0 * REACH) * BINS).astype(np.int64)
    found = []
    for number in range(BINS):
        chosen = clean & (bins == number)
        if chosen.sum() < FEWEST:
            chosen = bins == number
        if chosen.sum() < FEWEST:
            continue
        own = residual[chosen]
        middle, at = float(np.median(own)), float(z[chosen].mean())
        # The median of n normal values errs by 1.25 sigma / sqrt(n).
        found.append((at, ndtr(at) + middle, 1.25 * deviation(own - middle) / np.sqrt(len(own) / KIN)))
    return tuple(np.array(found).reshape(-1, 3).T)  # type: ignore[return-value]


def _fitted(place: Array, value: Array, spread: Array, lamp: float, stored: Stored):  # type: ignore[no-untyped-def]
    """Parameters: place of the half light, logarithm of the width, the lamp's share of the variance, e, the mask's amount and
    radius, and what the profiles' own levels and fall of light have taken."""

    def missed(p: Array) -> Array:
        step = np.interp(place - p[0], nodes(), _shape(p, lamp, stored))
        model = p[6] + (1.0 + p[7] + p[8] * place) * step
        usual = (p[3] / TONE, p[4] / SHARPENING, (p[5] - MASK) / MASK_SPREAD, p[6] / 0.05, p[7] / 0.05, p[8] / 0.02)
        return np.r_[(model - value) / spread, usual]

    start = [0.0, 0.0, 0.5, 0.0, 0.05, MASK, 0.0, 0.0, 0.0]
    low, high = (
        [-1.0, -1.0, 0.0, -1.0, 0.0, 0.4, -1.0, -1.0, -1.0],
        [1.0, 1.0, 0.98, 1.0, 3.0, 4.0, 1.0, 1.0, 1.0],
    )
    scale = [0.01, 0.1, 0.3, 0.1, 0.3, 0.5, 0.01, 0.01, 0.01]
    return least_squares(missed, start, bounds=(low, high), x_scale=scale, diff_step=1e-4, ftol=1e-4, max_nfev=40)


def _shape(p: Array, lamp: float, stored: Stored) -> Array:
    """The step at `nodes` for parameters of `_fitted`, its half light at 0."""
    width, share = float(np.exp(p[1])), float(p[2])
    bare = np.interp(nodes() / (width * np.sqrt(share) + 1e-3), *_lamp(lamp))
    step = _blurred(bare, width * np.sqrt(1.0 - share))
    return stored.seen(step + p[3] * step * (1.0 - step), float(p[4]), float(p[5]))


@functools.cache
def _lamp(exponent: float) -> tuple[Array, Array]:
    """Nodes and the share of a lamp of unit variance that lies beyond them."""
    at = np.linspace(-1.0, 1.0, 801)
    light = np.maximum(1.0 - at * at, 0.0) ** exponent
    share = np.r_[0.0, np.cumsum(0.5 * (light[1:] + light[:-1]))]
    return at * np.sqrt(2.0 * exponent + 3.0), share / share[-1]


def _blurred(values: Array, width: float) -> Array:
    """Values at `nodes` under a Gaussian blur of a standard deviation in widths."""
    if width < 0.2 * STEP:
        return values
    reach = min(int(np.ceil(4.5 * width / STEP)), len(values) - 1)
    # Each tap holds the bell's integral over its step, so that narrow bells keep their weight.
    bell = np.diff(ndtr((np.arange(-reach, reach + 2) - 0.5) * STEP / width))
    padded = np.pad(values, reach, mode="edge")
    return np.convolve(padded, bell / bell.sum(), "valid")
