"""Reflections on the planes where a slice was cut out of a body: how many images of the slice make the whole, and which."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from geometries.errors import GeometryError

NARROWEST = np.pi / 90
"""Smallest angle between two planes in rad."""
SAME_ANGLE = 1e-5
"""How far from 180/n degrees the angle between two planes may be, in rad: drawings are rounded."""
SAME_IMAGE = 1e-2
"""How far the entries of two matrices may differ for one image: above what `SAME_ANGLE` adds up to, below `NARROWEST`."""


def reflected(normals: ArrayLike, count: int | None = None, dimension: int = 3) -> NDArray[np.float64]:
    """The first products of reflections on planes through the origin: a slice, its neighbours, their neighbours and so on.

    Args:
        normals: Unit normals, shape (k, dimension).
        count: How many at most; all if not given, which must be finitely many.
        dimension: 3, or 2 in the plane of a section.

    Returns:
        Matrices that take the slice to its places, shape (m, dimension, dimension); the first is the identity.
    """
    one = np.eye(dimension)
    mirrors = [one - 2 * np.outer(normal, normal) for normal in np.reshape(normals, (-1, dimension))]
    found = [one]
    for image in found:
        for mirror in mirrors:
            if len(found) == count:
                return np.array(found)
            new = image @ mirror
            if np.abs(np.array(found) - new).max(axis=(1, 2)).min() > SAME_IMAGE:
                found.append(new)
    return np.array(found)


def check_slice(normals: ArrayLike, texts: tuple[str, ...]) -> None:
    """Check that images of a slice fill the space around it once.

    Args:
        normals: Outward unit normals of its planes, shape (k, 3).
        texts: What was written for each, for the message.

    Raises:
        GeometryError: Two planes do not meet at 180/n degrees inside the slice, or three meet in one line.
    """
    outward = np.reshape(normals, (-1, 3))
    for i in range(len(outward)):
        for j in range(i):
            angle = float(np.arccos(np.clip(-outward[i] @ outward[j], -1.0, 1.0)))
            parts = round(np.pi / max(angle, NARROWEST))
            if parts < 2 or abs(angle - np.pi / parts) > SAME_ANGLE:
                raise GeometryError(
                    f"planes has {texts[j]!r} and {texts[i]!r}, {np.degrees(angle):.6g} degrees apart in the part; "
                    f"its images fill the whole only at 180/n degrees, such as 90, 60, 45 or 30"
                )
    if len(outward) and np.linalg.svd(outward, compute_uv=False)[-1] < 1e-6:
        raise GeometryError(f"planes has {', '.join(map(repr, texts))}, which meet in one line; only two of them can")
