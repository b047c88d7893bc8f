"""Photographs as light: reading the file, undoing its gamma curve, and taking values between pixels.

A shadow's edge lies where half of the lamp is seen, which is half of the light and not half of the stored number: in a
JPEG the two differ by a good part of the penumbra's width. So the stored numbers go through sRGB's curve first
(IEC 61966-2-1), at the pixels that are looked at only.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from measurement.camera.picture_file import PictureError, Pixels, read_pixels

Array = npt.NDArray[np.float64]

_STORED = np.arange(256) / 255.0
LIGHT: npt.NDArray[np.float32] = np.where(
    _STORED <= 0.04045, _STORED / 12.92, ((_STORED + 0.055) / 1.055) ** 2.4
).astype(np.float32)
"""Light from 0 to 1 of every stored number by sRGB's curve, shape (256,)."""

TONES: dict[str, npt.NDArray[np.float32]] = {"srgb": LIGHT, "linear": _STORED.astype(np.float32)}
"""Known tone curves: a camera's JPEG, and numbers proportional to light (a developed raw file)."""


class Unmeasurable(ValueError):
    """A photograph that must not be measured; the message is the reason, a sentence for the user."""


def read_photograph(path: Path, size: tuple[int, int] | None = None) -> Pixels:
    """Read a photograph as it left the sensor, unturned: the lens and the screen were measured in its own pixels.

    Args:
        path: A picture file as `picture_file.read_pixels` takes it.
        size: Width and height it must have, None if any will do.

    Returns:
        Red, green and blue, shape (height, width, 3); a grey picture has three equal channels.

    Raises:
        Unmeasurable: No file, no picture, cut short, or another size.
    """
    try:
        return read_pixels(path, size)
    except PictureError as error:
        raise Unmeasurable(str(error)) from None


def sample_light(image: Pixels, points: Array, light: npt.NDArray[np.float32] = LIGHT) -> Array:
    """Light between pixels, bilinear.

    Args:
        image: Stored numbers, shape (h, w, 3).
        points: Places (x, y) in px, shape (..., 2); outside the frame the value is NaN.
        light: Light of every stored number, shape (256,).

    Returns:
        Light of the channels, shape (..., 3).
    """
    height, width = image.shape[:2]
    flat = points.reshape(-1, 2)
    x, y = flat[:, 0], flat[:, 1]
    with np.errstate(invalid="ignore"):
        inside = (x >= 0.0) & (y >= 0.0) & (x <= width - 1.0) & (y <= height - 1.0)
    x, y = np.where(inside, x, 0.0), np.where(inside, y, 0.0)
    left, top = np.minimum(x.astype(np.int64), width - 2), np.minimum(y.astype(np.int64), height - 2)
    right_share, low_share = (x - left).astype(np.float32), (y - top).astype(np.float32)
    rows = image.reshape(-1, 3)
    first = top * width + left
    value = np.zeros((len(flat), 3), dtype=np.float32)
    for offset, share in (
        (0, (1 - right_share) * (1 - low_share)),
        (1, right_share * (1 - low_share)),
        (width, (1 - right_share) * low_share),
        (width + 1, right_share * low_share),
    ):
        value += light[rows[first + offset]] * share[:, None]
    value[~inside] = np.nan
    return value.astype(np.float64).reshape(*points.shape[:-1], 3)
