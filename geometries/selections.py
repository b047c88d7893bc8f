"""Faces and points of a foreign part picked by short texts, as they stand in a case file.

"x = 0 mm"                          all faces that lie in this plane (x, y or z)
"in -1..31, -5..5, 0..2 mm"         all faces that lie in this box (ranges along x, y and z)
"at 10, 0, 4 mm"                    a point
"""

from __future__ import annotations

import dataclasses
import re

import numpy as np

from geometries.errors import GeometryError

AXES = "xyz"
NUMBER = r"\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*"


@dataclasses.dataclass(frozen=True)
class Faces:
    """A choice of faces: by plane, by box or by name.

    Attributes:
        text: What was written.
        axis: 0, 1 or 2 for a plane square to x, y or z, else None.
        at: The plane's place along the axis in m.
        box: Lowest and highest corner in m, or None.
    """

    text: str
    axis: int | None = None
    at: float = 0.0
    box: tuple[tuple[float, ...], tuple[float, ...]] | None = None


def faces(field: str, text: str) -> Faces:
    """Read a choice of faces.

    Raises:
        GeometryError: Not one of the forms this module knows.
    """
    if found := re.fullmatch(r"\s*([xyz])\s*=\s*(.+)", text):
        return Faces(text, axis=AXES.index(found[1]), at=_length(field, found[2]))
    ranges = r"\s*in" + ",".join([NUMBER + r"\.\." + NUMBER] * 3) + r"([a-z]+)\s*"
    # "0..2" would be read as the number "0." and a stray point.
    if found := re.fullmatch(ranges, re.sub(r"\.\.", " .. ", text)):
        values = [_length(field, f"{number} {found[7]}") for number in found.groups()[:6]]
        if any(low > high for low, high in zip(values[::2], values[1::2], strict=True)):
            raise GeometryError(f"{field} is {text!r}; each range runs from its lower end to its higher one")
        return Faces(text, box=(tuple(values[::2]), tuple(values[1::2])))
    raise GeometryError(f"{field} is {text!r}; write 'x = 0 mm' or 'in -1..31, -5..5, 0..2 mm'")


def point(field: str, text: str) -> tuple[float, float, float]:
    """Read a point, in m.

    Raises:
        GeometryError: Not of the form ``at 10, 0, 4 mm``.
    """
    found = re.fullmatch(r"\s*at" + ",".join([NUMBER] * 3) + r"([a-z]+)\s*", text)
    if not found:
        raise GeometryError(f"{field} is {text!r}; write a point as 'at 10, 0, 4 mm'")
    x, y, z = (_length(field, f"{number} {found[4]}") for number in found.groups()[:3])
    return x, y, z


def _length(field: str, text: str) -> float:
    from measurement.units import UnitError, quantity  # not above: whoever imports the devices need not have pint

    try:
        return quantity(text, "m")
    except UnitError as error:
        raise GeometryError(f"{field}: {error}") from None


def chosen(choice: Faces, tags: list[int], near: float) -> list[int]:
    """Which faces of the current Gmsh model a choice picks out of ``tags``; lengths in m."""
    import gmsh  # type: ignore[import-untyped]

    found = []
    for tag in tags:
        low, high = np.array(gmsh.model.occ.getBoundingBox(2, tag)).reshape(2, 3)
        if choice.axis is not None:
            inside = abs(low[choice.axis] - choice.at) < near and abs(high[choice.axis] - choice.at) < near
        else:
            assert choice.box is not None
            inside = bool(
                np.all(low > np.array(choice.box[0]) - near) and np.all(high < np.array(choice.box[1]) + near)
            )
        if inside:
            found.append(tag)
    return found
