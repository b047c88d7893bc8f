"""User-defined outputs of a device: positions of named points, angles between them, a profile.

[points]
tip = "70, 0, 4 mm"                 # the nearest place on the surface is tracked
base = "5, 0, 4 mm"

[angles]
bend = "face x = 70 mm"             # mean rotation of this flat face, positive towards the lift (bending angle)
chord = "base to tip"               # rotation of this line: for a circular arc half the bending angle
jaws = ["base to tip", "base to thumb"]     # the angle between two lines

[profile]
plane = "y = 0 mm"                  # plane of the drawn section
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from geometries import Actuator, GeometryError
from geometries.actuator import Vector
from geometries.imported.part import Faces, faces, point
from softmodels.common.arrays import Array
from softmodels.common.errors import Spoken
from softmodels.common.names import checked

Line = tuple[str, str]

NAME = r"[A-Za-z]\w*"


class ProbeError(Spoken, ValueError):
    """Invalid points, angles or profile; the message is for the user."""


@checked
@dataclasses.dataclass(frozen=True)
class Probes:
    """Points by name, angles by name as one or two lines from point to point or as a face, and the plane of the profile.

    Attributes:
        points: Names and places, as written.
        angles: Names and lines.
        faces: Names and faces whose rotation is an angle, as written, such as "x = 70 mm".
        plane: As written; empty for none.

    Raises:
        ProbeError: From the constructor, if a text has none of these forms or a name is unknown.
    """

    points: tuple[tuple[str, str], ...] = ()
    angles: tuple[tuple[str, tuple[Line, ...]], ...] = ()
    plane: str = ""
    faces: tuple[tuple[str, str], ...] = ()

    def __post_init__(self) -> None:
        names = {name for name, _ in self.points}
        for name in (*names, *(name for name, _ in (*self.angles, *self.faces))):
            if not re.fullmatch(NAME, name):
                raise ProbeError(f"{name!r} cannot be used as a column name; use letters, digits and '_'")
        for name, lines in self.angles:
            for line in lines:
                if missing := [end for end in line if end not in names]:
                    known = ", ".join(sorted(names)) or "none"
                    raise ProbeError(f"angle {name}: there is no point {missing[0]!r}; [points] has {known}")
                if line[0] == line[1]:
                    raise ProbeError(f"angle {name}: a line needs two different points, not {line[0]} twice")
        _ = self.places, self.cut, self.turning

    @property
    def places(self) -> dict[str, Vector]:
        """Wanted places by name in device coordinates, m."""
        return {name: _reworded(point, f"point {name}", _with_at(text)) for name, text in self.points}

    @property
    def turning(self) -> dict[str, Faces]:
        """Faces by the name of the angle of their mean rotation; each is selected by a plane or a box."""
        found = {name: _reworded(faces, f"angle {name}", text) for name, text in self.faces}
        for name, one in found.items():
            if one.normal is None and one.box is None:
                raise ProbeError(
                    f"angle {name} uses the face {one.text!r}; select the face by its position, such as 'face x = 70 mm'"
                )
        return found

    @property
    def cut(self) -> tuple[Vector, float] | None:
        """Unit normal of the profile's plane, and its distance from the origin in m; None if there is none."""
        if not self.plane:
            return None
        found = _reworded(faces, "profile plane", self.plane)
        if found.normal is None:
            raise ProbeError(f"profile plane is {self.plane!r}; write a plane as 'y = 0 mm' or 'normal 1, -1, 0'")
        return found.normal, found.at

    def columns(self) -> list[str]:
        """Return the columns of positions and angles that it adds to ``path.csv``."""
        return [f"{name}_{axis}_mm" for name, _ in self.points for axis in "xyz"] + [
            f"{name}_deg" for name, _ in (*self.angles, *self.faces)
        ]

    @property
    def off_columns(self) -> dict[str, str]:
        """Columns with the distance of the tracked place from the named point, by the point's name."""
        return {name: f"{name}_off_mm" for name, _ in self.points}

    def check(self, actuator: Actuator) -> None:
        """Reject names whose columns already exist.

        Raises:
            ProbeError: A name that is taken.
        """
        if self.faces and actuator.dimension == 2:
            raise ProbeError(f"angle {self.faces[0][0]}: faces of an axisymmetric section do not rotate; leave it out")
        taken = {*actuator.device_figures(actuator.probes), *(f"max_stretch_{axis}_mm" for axis in "xyz")}
        for column in (*self.columns(), *self.off_columns.values()):
            if column in taken:
                raise ProbeError(f"{column} is already a column of path.csv; use another name in [points] or [angles]")

    def figures(
        self,
        rest: Mapping[str, Vector],
        moved: Mapping[str, Array],
        lift: Vector,
        normals: Mapping[str, tuple[Array, Array]] | None = None,
    ) -> dict[str, float]:
        """Return the values by column.

        Args:
            rest: Undeformed places by name, m.
            moved: Displacements by name, m.
            lift: Direction of the device's lift.
            normals: Normals of the faces of `turning` by name: undeformed, and turned by the face's mean rotation.
        """
        now = {name: np.asarray(rest[name]) + moved[name] for name in rest}
        found = {
            f"{name}_{axis}_mm": float(now[name][i]) * 1e3 for name, _ in self.points for i, axis in enumerate("xyz")
        }
        wanted = self.places
        found |= {column: 1e3 * math.dist(rest[name], wanted[name]) for name, column in self.off_columns.items()}
        for name, lines in self.angles:
            first, *second = ([now[b] - now[a], np.asarray(rest[b]) - np.asarray(rest[a])] for a, b in lines)
            found[f"{name}_deg"] = _angle(first[0], second[0][0]) if second else _turned(first[1], first[0], lift)
        for name, (before, now_there) in (normals or {}).items():
            found[f"{name}_deg"] = _turned(before, now_there, lift)
        return found


NONE = Probes()


def from_tables(tables: Mapping[str, Mapping[str, object]]) -> Probes:
    """Read the tables ``[points]``, ``[angles]`` and ``[profile]`` of a case.

    Raises:
        ProbeError: What they hold makes no points, angles or plane.
    """
    points, angles, profile = (tables.get(name, {}) for name in ("points", "angles", "profile"))
    named: list[tuple[str, str]] = []
    for name, text in points.items():
        if not isinstance(text, str):
            raise ProbeError(f"point {name} is {text!r}; write a point as '70, 0, 4 mm'")
        named.append((name, text))
    if unknown := set(profile) - {"plane"}:
        raise ProbeError(f"[profile] has an unknown entry {min(unknown)!r}; known is plane")
    plane = profile.get("plane", "")
    if not isinstance(plane, str):
        raise ProbeError(f"profile plane is {plane!r}; write a plane as 'y = 0 mm'")
    turning = {name: found[1] for name, value in angles.items() if (found := _face(value))}
    lines = tuple((name, _lines(name, value)) for name, value in angles.items() if name not in turning)
    return Probes(tuple(named), lines, plane, tuple(turning.items()))


def to_tables(gauges: Probes) -> dict[str, Mapping[str, object]]:
    """Return the tables that `from_tables` reads; none for nothing."""
    angles = {name: [" to ".join(line) for line in lines] for name, lines in gauges.angles}
    tables: dict[str, Mapping[str, object]] = {
        "points": dict(gauges.points),
        "angles": {name: lines[0] if len(lines) == 1 else lines for name, lines in angles.items()}
        | {name: f"face {text}" for name, text in gauges.faces},
        "profile": {"plane": gauges.plane} if gauges.plane else {},
    }
    return {name: table for name, table in tables.items() if table}


def followed_text(name: str, away: float, place: Sequence[float] = ()) -> str:
    """Return a sentence on the distance (m) of a tracked point from its named position, with the undeformed place
    if given."""
    where = f" {', '.join(f'{1e3 * value:.5g}' for value in place)} mm," if len(place) else ""
    near = "on the surface" if away < 1e-9 else f"the nearest surface point of the model, {away * 1e3:.3g} mm away"
    return f"point {name} is tracked at{where} {near}"


def _face(value: object) -> re.Match[str] | None:
    return re.fullmatch(r"\s*face\s+(?!to\s)(.*\S)\s*", value) if isinstance(value, str) else None


def _lines(name: str, value: object) -> tuple[Line, ...]:
    texts = [value] if isinstance(value, str) else value
    if not isinstance(texts, list) or not 1 <= len(texts) <= 2 or not all(isinstance(text, str) for text in texts):
        raise ProbeError(
            f"angle {name} is {value!r}; write 'face x = 70 mm', 'base to tip', or two such lines in a list"
        )
    found = [re.fullmatch(rf"\s*({NAME})\s+to\s+({NAME})\s*", text) for text in texts]
    if not all(found):
        raise ProbeError(
            f"angle {name} is {value!r}; write a line as 'base to tip', from point to point, or a face as 'face x = 70 mm'"
        )
    return tuple((one[1], one[2]) for one in found if one)


def _with_at(text: str) -> str:
    return text if text.lstrip().startswith("at") else f"at {text.strip()}"


def _reworded[T](read: Callable[[str, str], T], field: str, text: str) -> T:
    try:
        return read(field, text)
    except GeometryError as error:
        raise ProbeError(str(error)) from None


def _angle(a: Array, b: Array) -> float:
    """Return the angle between two vectors in degrees, exact near 0 and 180 too."""
    return math.degrees(math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b)))


def _turned(rest: Array, now: Array, lift: Vector) -> float:
    """Return the rotation of a line in degrees; negative away from the lift."""
    up = np.asarray(lift)
    risen = float(now @ up / np.linalg.norm(now) - rest @ up / np.linalg.norm(rest))
    return math.copysign(_angle(rest, now), risen) if risen else _angle(rest, now)
