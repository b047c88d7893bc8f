"""Faces and points of a foreign part picked by short texts, as they stand in a case file.

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
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from geometries.actuator import Vector
from geometries.errors import GeometryError
from geometries.face_labels import Colour, face_names, named_surfaces, surface_colours

LONGEST_TEXT = 300
AXES = "xyz"
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
SAME_COLOUR = 2
"""How far red, green and blue may be off: they are written in decimals and rounded."""
TILT = 1e-4
"""How far off, over its distance from the origin, a face may lie from a plane whose normal was typed with few digits."""


@dataclasses.dataclass(frozen=True)
class Faces:
    """A choice of faces: by plane, by box, by name or by colour; one of them is given.

    Attributes:
        text: What was written.
        normal: Unit normal of a plane.
        at: The plane's distance from the origin along the normal in m.
        box: Lowest and highest corner in m.
        name: As it stands in the file.
        colour: Red, green and blue, 0 to 255.
    """

    text: str
    normal: Vector | None = None
    at: float = 0.0
    box: tuple[tuple[float, ...], tuple[float, ...]] | None = None
    name: str | None = None
    colour: Colour | None = None


def faces(field: str, text: str) -> Faces:
    """Read a choice of faces.

    Raises:
        GeometryError: Not one of the forms this module knows.
    """
    _check_size(field, text)
    if found := re.fullmatch(r"\s*([xyz])\s*=\s*(.+)", text):
        x, y, z = (float(axis == found[1]) for axis in AXES)
        return Faces(text, normal=(x, y, z), at=_length(field, found[2]))
    if found := re.fullmatch(r"\s*normal" + ",".join([NUMBER] * 3) + r"(?:at\s*(.+))?", text):
        direction = np.array([_number(field, part) for part in found.groups()[:3]])
        if not direction.any():
            raise GeometryError(f"{field} is {text!r}; a normal has a length")
        x, y, z = (float(part) for part in direction / np.linalg.norm(direction))
        return Faces(text, normal=(x, y, z), at=_length(field, found[4]) if found[4] else 0.0)
    ranges = r"\s*in" + ",".join([NUMBER + r"\.\." + NUMBER] * 3) + r"([a-z]+)\s*"
    # "0..2" would be read as the number "0." and a stray point.
    if found := re.fullmatch(ranges, re.sub(r"\.\.", " .. ", text)):
        values = [_length(field, f"{number} {found[7]}") for number in found.groups()[:6]]
        if any(low > high for low, high in zip(values[::2], values[1::2], strict=True)):
            raise GeometryError(f"{field} is {text!r}; each range runs from its lower end to its higher one")
        return Faces(text, box=(tuple(values[::2]), tuple(values[1::2])))
    if found := re.fullmatch(r"\s*named\s+(.*\S)\s*", text):
        return Faces(text, name=found[1])
    if found := re.fullmatch(r"\s*colou?red\s+(\w+|#[0-9a-fA-F]{6})\s*", text):
        if found[1] not in COLOURS and not found[1].startswith("#"):
            raise GeometryError(f"{field} is {text!r}; write the colour as #rrggbb or one of {', '.join(COLOURS)}")
        return Faces(text, colour=COLOURS.get(found[1]) or _bytes(found[1]))
    raise GeometryError(f"{field} is {text!r}; write {FORMS}{_about_commas(text)}")


def point(field: str, text: str) -> tuple[float, float, float]:
    """Read a point, in m.

    Raises:
        GeometryError: Not of the form ``at 10, 0, 4 mm``.
    """
    _check_size(field, text)
    found = re.fullmatch(r"\s*at" + ",".join([NUMBER] * 3) + r"([a-z]+)\s*", text)
    if not found:
        raise GeometryError(f"{field} is {text!r}; write a point as 'at 10, 0, 4 mm'{_about_commas(text)}")
    x, y, z = (_length(field, f"{number} {found[4]}") for number in found.groups()[:3])
    return x, y, z


def _check_size(field: str, text: str) -> None:
    """Patterns take long over texts without end."""
    if len(text) > LONGEST_TEXT:
        raise GeometryError(f"{field} has {len(text)} characters; write {FORMS}")


def _about_commas(text: str) -> str:
    """A hint for "at 10,5, 0, 2 mm", which may be 10.5."""
    return "; commas part the numbers, and decimals have a point" if re.search(r"\d,\d", text) else ""


def _bytes(text: str) -> Colour:
    red, green, blue = bytes.fromhex(text[1:])
    return red, green, blue


def _number(field: str, text: str) -> float:
    from measurement.units import UnitError, number  # not above: whoever imports the devices need not have pint

    try:
        return number(text)
    except UnitError as error:
        raise GeometryError(f"{field}: {error}") from None


def _length(field: str, text: str) -> float:
    from measurement.units import UnitError, quantity

    try:
        return quantity(text, "m")
    except UnitError as error:
        raise GeometryError(f"{field}: {error}") from None


def chosen(
    field: str, choice: Faces, tags: list[int], near: float, file: str, pieces: Sequence[Sequence[int]] = ()
) -> list[int]:
    """Which faces of the current Gmsh model a choice picks out of ``tags``.

    Args:
        field: What the choice is for.
        choice: The choice.
        tags: Surfaces of the model.
        near: What counts as the same place, m.
        file: The STEP file that the model was made of, and of nothing else.
        pieces: For each surface of the file, in order, the model's surfaces that were made of it; empty if they are as read.

    Raises:
        GeometryError: The file has no such name or colour; the message lists those it has.
    """
    if choice.name is not None:
        known = face_names(file)
        if choice.name not in known:
            raise GeometryError(f"{field} is {choice.text!r}; {listed('name', sorted(known))}")
        return _at(named_surfaces(file, choice.name), tags, pieces)
    if choice.colour is not None:
        colours = surface_colours(file)
        wanted = np.array(choice.colour)
        places = [i for i, one in enumerate(colours) if one and np.abs(wanted - one).max() <= SAME_COLOUR]
        if not places:
            seen = sorted({"#{:02x}{:02x}{:02x}".format(*one) for one in colours if one})
            raise GeometryError(f"{field} is {choice.text!r}; {listed('colour', seen)}")
        return _at(places, tags, pieces)
    if choice.box is not None:
        return [tag for tag in tags if _in_box(tag, choice.box, near)]
    assert choice.normal is not None
    return [tag for tag in tags if _in_plane(tag, np.array(choice.normal), choice.at, near)]


def listed(what: str, known: list[str]) -> str:
    """What names or colours there are, for a message."""
    if not known:
        return f"no face in the file has a {what}"
    more = f" and {len(known) - 20} more" if len(known) > 20 else ""
    return f"the {what}s of faces in the file are {', '.join(known[:20])}{more}"


def _at(places: list[int], tags: list[int], pieces: Sequence[Sequence[int]]) -> list[int]:
    import gmsh  # type: ignore[import-untyped]

    every = pieces or [(tag,) for _, tag in gmsh.model.getEntities(2)]
    return [tag for place in places for tag in every[place] if tag in tags]


def _in_box(tag: int, box: tuple[tuple[float, ...], tuple[float, ...]], near: float) -> bool:
    import gmsh

    low, high = np.array(gmsh.model.occ.getBoundingBox(2, tag)).reshape(2, 3)
    return bool(np.all(low > np.array(box[0]) - near) and np.all(high < np.array(box[1]) + near))


def _in_plane(tag: int, normal: NDArray[np.float64], at: float, near: float) -> bool:
    points = surface_points(tag)
    typed = 0.0 if np.abs(normal).max() == 1.0 else TILT * float(np.linalg.norm(points, axis=1).max())
    return bool(np.abs(points @ normal - at).max() < near + typed)


def surface_points(tag: int) -> NDArray[np.float64]:
    """Some points all over a surface of the current Gmsh model, beyond its border too; shape (16, 3), m."""
    import gmsh

    low, high = gmsh.model.getParametrizationBounds(2, tag)
    places = np.stack(np.meshgrid(*np.linspace(low, high, 4).T), axis=-1)
    return np.array(gmsh.model.getValue(2, tag, places.ravel())).reshape(-1, 3)
