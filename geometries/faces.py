"""Texts in a case file that pick faces and points of a part from a file, and what such files are.

"x = 0 mm"                          all faces that lie in this plane (x, y or z)
"normal 1, -1, 0 at 2 mm"           all faces that lie in this plane; without "at" it goes through the origin
"in -1..31, -5..5, 0..2 mm"         all faces that lie in this box (ranges along x, y and z)
"named lid"                         all faces that have this name in the file
"coloured red", "coloured #ff8000"  all faces that have this colour in the file
"at 10, 0, 4 mm"                    a point
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping

import numpy as np

from geometries import actuator
from geometries.actuator import Vector
from softmodels.common import units
from softmodels.common.errors import GeometryError


@dataclasses.dataclass(frozen=True)
class Faces:
    """A choice of faces, as written in ``text``: by a plane (unit normal, and distance ``at`` from the origin in m), by a box
    (lowest and highest corner in m), by the name in the file or by colour (red, green and blue, 0 to 255)."""

    text: str
    normal: Vector | None = None
    at: float = 0.0
    box: tuple[tuple[float, ...], tuple[float, ...]] | None = None
    name: str | None = None
    colour: Colour | None = None


SURFACES = (".stl", ".obj", ".ply", ".3mf")
"""Endings of the files that are read as surfaces."""
FORMATS: Mapping[str, str] = {
    ".msh": "gmsh", ".inp": "abaqus", ".vtk": "vtk", ".vtu": "vtu", **{ending: ending[1:] for ending in SURFACES},
}  # fmt: skip
"""Endings of the files that are read, and meshio's names for them."""
DRAWINGS = (".svg", ".dxf")
"""Endings of the drawings of networks that are read."""
FILE_DEVICES: Mapping[str, tuple[str, str]] = {
    **dict.fromkeys((".step", ".stp"), ("ImportedActuator", "file")),
    **dict.fromkeys(FORMATS, ("ImportedMesh", "file")),
    **dict.fromkeys(DRAWINGS, ("ChannelPlate", "network")),
}
"""Devices that users' files describe, by the files' endings, and the fields that name the files."""
UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "inch": 0.0254}
"""Of files that do not store the unit of their lengths, in m."""
Colour = tuple[int, int, int]

LONGEST_TEXT = 300
NUMBER = r"\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*"
FORMS = "'x = 0 mm', 'normal 1, -1, 0 at 2 mm', 'in -1..31, -5..5, 0..2 mm', 'named lid' or 'coloured #ff0000'"

COLOURS: dict[str, Colour] = {
    "black": (0, 0, 0),
    "red": (255, 0, 0),
    "green": (0, 255, 0),
    "blue": (0, 0, 255),
    "yellow": (255, 255, 0),
    "magenta": (255, 0, 255),
    "cyan": (0, 255, 255),
    "white": (255, 255, 255),
}
"""Colours by the names that STEP itself has for them (ISO 10303-46)."""


class FaceNumberError(GeometryError):
    """A choice of faces in a form that is known, with a number that cannot be read; the message is for the user."""


def faces(field: str, text: str) -> Faces:
    """Read a choice of faces; GeometryError if it has none of this module's forms."""
    _check_size(field, text)
    if match := re.fullmatch(r"\s*([xyz])\s*=\s*(.+)", text):
        x, y, z = (float(axis == match[1]) for axis in actuator.AXES)
        return Faces(text, normal=(x, y, z), at=_number(field, match[2], "m"))
    if match := re.fullmatch(r"\s*normal" + ",".join([NUMBER] * 3) + r"(?:at\s*(.+))?", text):
        direction = np.array([_number(field, part) for part in match.groups()[:3]])
        if not direction.any():
            raise GeometryError(f"{field} is {text!r}; a normal must not have zero length")
        x, y, z = (float(part) for part in direction / np.linalg.norm(direction))
        return Faces(text, normal=(x, y, z), at=_number(field, match[4], "m") if match[4] else 0.0)
    ranges = r"\s*in" + ",".join([NUMBER + r"\.\." + NUMBER] * 3) + r"([a-z]+)\s*"
    # "0..2" would be read as the number "0." and a stray point.
    if match := re.fullmatch(ranges, re.sub(r"\.\.", " .. ", text)):
        values = [_number(field, f"{number} {match[7]}", "m") for number in match.groups()[:6]]
        if any(low > high for low, high in zip(values[::2], values[1::2], strict=True)):
            raise GeometryError(f"{field} is {text!r}; each range runs from its lower end to its higher one")
        return Faces(text, box=(tuple(values[::2]), tuple(values[1::2])))
    if match := re.fullmatch(r"\s*named\s+(.*\S)\s*", text):
        return Faces(text, name=match[1])
    if match := re.fullmatch(r"\s*colou?red\s+(\w+|#[0-9a-fA-F]{6})\s*", text):
        if match[1] not in COLOURS and not match[1].startswith("#"):
            raise GeometryError(f"{field} is {text!r}; write the colour as #rrggbb or one of {', '.join(COLOURS)}")
        return Faces(text, colour=COLOURS.get(match[1]) or _bytes(match[1]))
    raise GeometryError(f"{field} is {text!r}; write {FORMS}{_about_commas(text)}")


def point(field: str, text: str) -> tuple[float, float, float]:
    """Read a point, in m; GeometryError if it is not of the form ``at 10, 0, 4 mm``."""
    _check_size(field, text)
    match = re.fullmatch(r"\s*at" + ",".join([NUMBER] * 3) + r"([a-z]+)\s*", text)
    if not match:
        raise GeometryError(f"{field} is {text!r}; write a point as 'at 10, 0, 4 mm'{_about_commas(text)}")
    x, y, z = (_number(field, f"{number} {match[4]}", "m") for number in match.groups()[:3])
    return x, y, z


def _check_size(field: str, text: str) -> None:
    """Patterns take long over texts without end."""
    if len(text) > LONGEST_TEXT:
        raise GeometryError(f"{field} has {len(text)} characters; write {FORMS}")


def _about_commas(text: str) -> str:
    """Return a hint for "at 10,5, 0, 2 mm", which may be 10.5."""
    return "; separate numbers by commas, and write decimals with a point" if re.search(r"\d,\d", text) else ""


def _bytes(text: str) -> Colour:
    red, green, blue = bytes.fromhex(text[1:])
    return red, green, blue


def _number(field: str, text: str, unit: str = "") -> float:
    try:
        return units.quantity(text, unit) if unit else units.number(text)
    except units.UnitError as error:
        raise FaceNumberError(f"{field}: {error}") from None
