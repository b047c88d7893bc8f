"""Base class of parts from files, drawn or meshed, with texts that assign roles to faces."""

from __future__ import annotations

import abc
import contextlib
import dataclasses
import hashlib
import re
import tempfile
import unicodedata
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from geometries.actuator import Actuator, CutPlane, Hold, Vector, reflected
from softmodels.common.errors import GeometryError, whole_path
from softmodels.common.files import GEOMETRY, file_digest, read_file
from softmodels.common.names import lazy_module
from softmodels.common.schema import choice_field, list_field, text_field

gmsh = lazy_module("gmsh")

FORMATS: Mapping[str, str] = {".msh": "gmsh", ".inp": "abaqus", ".stl": "stl"}
"""Endings of the files that are read, and meshio's names for them."""
UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "inch": 0.0254}
"""Of files that do not store the unit of their lengths, in m."""
MAIN = "solid"
"""Region of a file with one solid."""
NONE = "none"
"""What ``cavities`` says of a part without air."""


def only_inner_shell[Shell](file: str, inner: Sequence[Shell], centre: Callable[[Shell], NDArray[np.float64]]) -> Shell:
    """Return the wall of a part's only cavity.

    Args:
        file: The part's file.
        inner: Walls of the part that are neither its outside nor joined to it.
        centre: Gives the middle of a wall's box in m, shape (3,).

    Raises:
        GeometryError: There is none, or there are several; the message lists where they are.
    """
    if not inner:
        raise GeometryError(
            f"cavities is empty, and file {file} has no closed inner shell that could be the cavity: close its inlet where "
            "it is drawn, name the planes of a part that is cut, or write cavities = ['none'] for a part without air"
        )
    if len(inner) > 1:
        middles = sorted(tuple(1e3 * centre(shell)) for shell in inner)
        places = "; ".join(", ".join(f"{value:.4g}" for value in middle) for middle in middles[:4])
        places += "; ..." if len(inner) > 4 else ""
        raise GeometryError(
            f"cavities is empty, and file {file} has {len(inner)} closed inner shells, with their middles at {places} mm; "
            "give a point in the air of each cavity, such as cavities = ['at 10, 0, 4 mm']"
        )
    return inner[0]


def cavity_role(number: int) -> str:
    """Return the role of a cavity's walls, counted from 0."""
    return "cavity" if number == 0 else f"cavity{number + 1}"


@dataclasses.dataclass(frozen=True)
class Reading:
    """Contents of a file in m and m3, of the part as drawn.

    Attributes:
        normals: Outward unit normals of the cut planes.
        gauge: The corner whose motion is reported.
        solid_volume: Of the solid.
        cavity_volumes: Of each cavity.
        regions: Names of its solids, if there are several.
    """

    normals: tuple[Vector, ...]
    gauge: Vector
    solid_volume: float
    cavity_volumes: tuple[float, ...]
    regions: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True, kw_only=True)
class ImportedPart(Actuator):
    """A part from a file, with one or more closed cavities; without ``cavities`` its only closed inner shell is the cavity, and
    with ``cavities = ["none"]`` it has no air.

    A half, a quarter or a wedge of a part is cut on planes through the origin (``planes``), which meet at 180/n degrees, and
    its cavities may be open there and nowhere else. Physical groups: volume "solid", or several by their names; surfaces
    "cavity", "cavity2", ... in the order of ``cavities``, "support", "plane0", "plane1", ..., those of
    ``surfaces`` by their names, and "outer" for all that is left.
    How faces are selected is described below.

    With several cavities, cavity i has the pressure ``pressure_ratios[i]`` times P. Then P works on the sum of the volumes
    times their ratios, and that is what `cavity_volume` and a run's added volume are. A load that gives each cavity a series
    of its own needs no ratios.
    """

    file: str = text_field("", "the part's file")
    cavities: tuple[str, ...] = list_field(
        (),
        "a point in the air of each cavity, such as 'at 10, 0, 4 mm', or faces of its wall, such as 'named chamber'; "
        "not needed where the part has exactly one closed inner shell; 'none' for a part without air",
    )
    support: str = text_field("", "held faces, such as 'x = 0 mm' or 'named flange'; three planes need none")
    surfaces: tuple[str, ...] = list_field(
        (),
        "names for faces of the outside, which loads, clamps, sheets, contact and others may use, such as 'pad = coloured red'",
    )
    planes: tuple[str, ...] = list_field(
        (), "symmetry planes through the origin where the part is cut, such as 'y = 0 mm' or 'normal 1, -1, 0'"
    )
    pressure_ratios: tuple[float, ...] = list_field(
        (), "pressure in each cavity over the requested one; all 1 if not given", numbers=True, shape=False
    )
    gauge_point: str = text_field(
        "", "corner whose motion is reported, such as 'at 70, 0, 4 mm'; the farthest if not given"
    )
    rise: str = choice_field("z", ("x", "y", "z"), "direction in which that motion is counted")

    stem: ClassVar = "part"
    unbonded: ClassVar = ("outer",)
    meeting: ClassVar = None
    kind: ClassVar[str] = "file"
    """Description of the file for messages."""

    def check(self) -> None:
        if not self.file:
            raise GeometryError(f"file is empty; name the part's {self.kind}")
        object.__setattr__(self, "file", whole_path(self.file))
        if not self.support and len(self.planes) < 3:
            raise GeometryError("support is empty; give the held faces, such as 'x = 0 mm'")
        if len(set(self.planes)) != len(self.planes) or len(self.planes) > 3:
            raise GeometryError(f"planes is {', '.join(self.planes)}; at most three, each once")
        if self.pressure_ratios and len(self.pressure_ratios) != self.cavity_count:
            cavities = f"{self.cavity_count} cavit{'y' if self.cavity_count == 1 else 'ies'}"
            raise GeometryError(f"pressure_ratios has {len(self.pressure_ratios)} values for {cavities}; give one each")
        if self.ratios and not any(self.ratios):
            raise GeometryError("pressure_ratios are all 0; give one other than 0, below it for a vacuum")
        _ = self.patches
        self.check_cells()
        _ = self.reading

    @abc.abstractmethod
    def check_cells(self) -> None:
        """Check what decides the mesh, before the file is opened."""

    @property
    @abc.abstractmethod
    def reading(self) -> Reading:
        """Contents of the file; read once."""

    def digest(self) -> str:
        """Return SHA-256 of the file's content.

        Raises:
            GeometryError: It cannot be read.
        """
        try:
            return file_digest(self.file)
        except OSError as error:
            raise GeometryError(f"file {self.file} cannot be read ({error.strerror})") from None
        except ValueError:  # a zero byte in its name
            raise GeometryError(f"file {self.file!r} is not a file name") from None

    @property
    def files(self) -> Mapping[str, str]:
        return {"file": self.file}

    @property
    def key(self) -> str:
        """Twelve digits that change with the parameters and the file's contents, not with its path."""
        parameters = [(f.name, getattr(self, f.name)) for f in dataclasses.fields(self) if f.name != "file"]
        return hashlib.sha256(repr((type(self).__name__, self.digest(), parameters)).encode()).hexdigest()[:12]

    @property
    def copies(self) -> int:
        return len(reflected(self.reading.normals))

    @property
    def faces(self) -> tuple[str, ...]:  # type: ignore[override]
        return tuple(self.patches)

    @property
    def patches(self) -> dict[str, str]:
        """Faces of the outside by the names that the user gives them."""
        found: dict[str, str] = {}
        taken = {"outer", "support", "axis", MAIN, *(f"plane{i}" for i in range(3))}
        for text in self.surfaces:
            name, _, which = (part.strip() for part in text.partition("="))
            if not (re.fullmatch(r"[a-z]\w*", name) and which):
                raise GeometryError(f"surfaces has {text!r}; write a name and its faces, such as 'pad = coloured red'")
            if name in taken or name in found or re.fullmatch(r"cavity\d*", name):
                raise GeometryError(f"surfaces has {text!r}; the name {name!r} is taken, so use another")
            faces("surfaces", which)
            found[name] = which
        return found

    @property
    def airless(self) -> bool:
        """Whether it has no cavity."""
        return self.cavities == (NONE,)

    @property
    def fuller(self) -> str:
        return "a drawing of the whole part, without planes,"

    @property
    def lift(self) -> Vector:  # type: ignore[override]
        return (float(self.rise == "x"), float(self.rise == "y"), float(self.rise == "z"))

    @property
    def ratios(self) -> tuple[float, ...]:
        return self.pressure_ratios or (1.0,) * self.cavity_count

    @property
    def cavity_count(self) -> int:
        """Number of cavities; 1 if none is named, because then the file's only closed inner shell is the cavity."""
        return 0 if self.airless else max(len(self.cavities), 1)

    @property
    def size(self) -> float:
        return float(np.cbrt(max(self.reading.cavity_volumes, default=self.reading.solid_volume)))

    @property
    def cut_planes(self) -> tuple[CutPlane, ...]:
        return tuple(CutPlane(f"plane{i}", normal) for i, normal in enumerate(self.reading.normals))

    @property
    def holds(self) -> tuple[Hold, ...]:
        return (Hold("support", None),) if self.support else ()

    @property
    def probes(self) -> Mapping[str, Vector]:
        return {"tip": self.reading.gauge}

    @property
    def cavity_volume(self) -> float:
        """Sum of the whole part's cavities in m3, each times its pressure ratio, from a mesh of their walls."""
        volumes = zip(self.ratios, self.reading.cavity_volumes, strict=True)
        return self.copies * sum(ratio * volume for ratio, volume in volumes)

    @property
    def solid_volume(self) -> float:
        """Volume in m3 of the whole part."""
        return self.copies * self.reading.solid_volume

    def on_profile(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """None: which line a camera would see is not known of a foreign part."""
        return np.zeros(len(points), dtype=bool)


# ----------------------------------------------------------------------------------------------------------------------
# Names of regions: short words, from whatever other programs call a solid or a set of cells.


def region_name(text: str) -> str:
    """Return a name of small letters, digits and ``_`` that begins with a letter: "Base plate (2)" is ``base_plate_2``."""
    plain = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    name = re.sub(r"\W+", "_", plain).strip("_").lower()
    return name if re.match(r"[a-z]", name) else f"region_{name}".rstrip("_")


# ----------------------------------------------------------------------------------------------------------------------
# Names and colours of the faces in a STEP file.
#
# Gmsh passes on the colours of faces but not their names, so names travel as colours: in a copy of the file the wanted faces
# get one colour each, and Open CASCADE itself brings it to its surface. No place is compared, so units, repaired or reordered
# shells and faces of like shape do not matter. Gmsh loses colours where an assembly moves the part; the copy is unmoved.


REST = r"(?:[^';]|'[^']*')*;"
"""Up to the end of an instance; semicolons in texts do not count."""
FACE = re.compile(r"#(\d+)\s*=\s*(?:ADVANCED_FACE|FACE_SURFACE)\s*\(\s*'((?:[^']|'')*)'")
SOLID = re.compile(r"#(\d+)\s*=\s*(?:MANIFOLD_SOLID_BREP|BREP_WITH_VOIDS|FACETED_BREP)\s*\(\s*'((?:[^']|'')*)'")
STYLE = re.compile(r"(#\d+\s*=\s*)\w*STYLED_ITEM\s*\(" + REST)
MOVE = re.compile(r"(ITEM_DEFINED_TRANSFORMATION\s*\(\s*'[^']*'\s*,\s*'[^']*'\s*,)\s*(#\d+)\s*,\s*#\d+\s*\)")
CONTEXT = re.compile(r"#(\d+)\s*=[^;=]*GEOMETRIC_REPRESENTATION_CONTEXT")
ESCAPE = re.compile(r"\\X\\([0-9A-F]{2})|\\X2\\([0-9A-F]+)\\X0\\|\\X4\\([0-9A-F]+)\\X0\\|\\S\\(.)|\\(\\)")

SHADES, STEP = 16, 16
"""Values of each of red, green and blue that mark a face: and how far apart, to survive rounding."""

Colour = tuple[int, int, int]


def face_names(path: str | Path) -> dict[str, list[int]]:
    """Return the names that a file gives to faces, and the numbers of the instances that have each; faces without a name are
    left out."""
    found = defaultdict(list)
    for number, text in FACE.findall(_read(path)):
        if name := _plain(text).strip():
            found[name].append(int(number))
    return dict(found)


def named_surfaces(path: str | Path, name: str) -> list[int]:
    """Return where the faces of a name stand among the surfaces that Gmsh makes of a file (0 is the first).

    Needs a current Gmsh session, and leaves its model unchanged.

    Raises:
        GeometryError: Too many faces have this name, or the CAD kernel changed one beyond recognition.
    """
    wanted = face_names(path)[name]
    if len(wanted) >= SHADES**3:
        raise GeometryError(f"{len(wanted)} faces of {path} are named {name!r}; pick them by plane, box or colour")
    marks = {_mark(_shades(k)): k for k in range(len(wanted))}
    colours = _colours(_marked(_read(path), dict(zip(wanted, marks, strict=True))))
    found = {place: marks[_mark(colour)] for place, colour in enumerate(colours) if colour and _mark(colour) in marks}
    if set(found.values()) != set(marks.values()):
        raise GeometryError(f"a face named {name!r} in {path} is lost on import; pick it by plane, box or colour")
    return list(found)


def solid_names(path: str | Path) -> list[str]:
    """Return the name of the body that each volume which Gmsh makes of a file comes from, in their order; empty where it has
    none.

    Needs a current Gmsh session, and leaves its model unchanged.
    """
    text = _read(path)
    bodies = [(int(number), _plain(name).strip()) for number, name in SOLID.findall(text)]
    if not any(name for _, name in bodies) or len(bodies) >= SHADES**3:
        return [""] * len(gmsh.model.getEntities(3))
    marks = {_shades(k): number for k, (number, _) in enumerate(bodies)}
    names = {_mark(mark): name for mark, (_, name) in zip(marks, bodies, strict=True)}
    seen = _colours(_marked(text, {number: mark for mark, number in marks.items()}), 3)
    return [names.get(_mark(colour), "") if colour else "" for colour in seen]


def surface_colours(path: str | Path) -> list[Colour | None]:
    """Return the colour of each surface that Gmsh makes of a file, None where it has none; needs a current Gmsh session."""
    return _colours(_unmoved(_read(path)))


def _read(path: str | Path) -> str:
    return read_file(path, GEOMETRY).decode("latin-1")  # any byte is a letter, so that the copy holds the same bytes


def _plain(text: str) -> str:
    r"""Return a name without the escapes of ISO 10303-21: ``''``, ``\\``, ``\X\E9``, ``\X2\00E9\X0\``, ``\S\i``."""

    def letter(found: re.Match[str]) -> str:
        short, two, four, shifted, slash = found.groups()
        if short:
            return chr(int(short, 16))
        if two or four:
            return bytes.fromhex(two or four).decode("utf-16-be" if two else "utf-32-be", errors="replace")
        return chr(ord(shifted) + 128) if shifted else slash

    plain = ESCAPE.sub(letter, re.sub(r"[\r\n]", "", text).replace("''", "'"))
    for _ in range(2):  # many write UTF-8 without escapes, and Open CASCADE encodes it once more
        with contextlib.suppress(UnicodeError):
            plain = plain.encode("latin-1").decode()
    return plain


def _unmoved(text: str) -> str:
    """Return the file with every part of an assembly where it was drawn."""
    return MOVE.sub(r"\1 \2, \2)", text)


def _marked(text: str, marks: dict[int, Colour]) -> str:
    """Return the file with these colours on these faces and no other."""
    text = STYLE.sub(
        r"\1 CARTESIAN_POINT('', (0., 0., 0.));", _unmoved(text)
    )  # what refers to a style still finds something
    context = CONTEXT.search(text)
    if context is None:
        return text  # no shape to mark
    free = 1 + max(int(number) for number in re.findall(r"#(\d+)\s*=", text))
    added, styles = [], []
    for face, shades in marks.items():
        chain = [
            f"COLOUR_RGB('', {', '.join(f'{shade / 255:.6f}' for shade in shades)})",
            "FILL_AREA_STYLE_COLOUR('', #{})",
            "FILL_AREA_STYLE('', (#{}))",
            "SURFACE_STYLE_FILL_AREA(#{})",
            "SURFACE_SIDE_STYLE('', (#{}))",
            "SURFACE_STYLE_USAGE(.BOTH., #{})",
            "PRESENTATION_STYLE_ASSIGNMENT((#{}))",
            f"STYLED_ITEM('', (#{{}}), #{face})",
        ]
        for item in chain:
            added.append(f"#{free} = {item.format(free - 1)};")
            free += 1
        styles.append(f"#{free - 1}")
    group = f"MECHANICAL_DESIGN_GEOMETRIC_PRESENTATION_REPRESENTATION('', ({', '.join(styles)}), #{context[1]})"
    head, end, tail = text.rpartition("ENDSEC;")
    return "\n".join([head, *added, f"#{free} = {group};", end + tail])


def _colours(text: str, dimension: int = 2) -> list[Colour | None]:
    """Return the colours of the surfaces, or volumes, that Gmsh makes of a file of this text."""
    before = gmsh.model.getCurrent()
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "copy.step"
        copy.write_bytes(text.encode("latin-1"))
        gmsh.model.add(folder)
        try:
            gmsh.model.occ.importShapes(str(copy), format="step")
            gmsh.model.occ.synchronize()
            seen = [gmsh.model.getColor(*entity) for entity in gmsh.model.getEntities(dimension)]
        finally:
            gmsh.model.remove()
            gmsh.model.setCurrent(before)
    return [(red, green, blue) if opaque else None for red, green, blue, opaque in seen]


def _shades(number: int) -> Colour:
    """Return the colour that marks something by a number."""
    return STEP * (number // SHADES**2), STEP * (number // SHADES % SHADES), STEP * (number % SHADES)


def _mark(colour: Colour) -> Colour:
    """Return the mark that a colour was: rounding moves it by a little."""
    red, green, blue = (STEP * (shade // STEP) + STEP // 2 for shade in colour)
    return red, green, blue


# ----------------------------------------------------------------------------------------------------------------------
# Faces and points of a foreign part picked by short texts, as they stand in a case file.
#
# "x = 0 mm"                          all faces that lie in this plane (x, y or z)
# "normal 1, -1, 0 at 2 mm"           all faces that lie in this plane; without "at" it goes through the origin
# "in -1..31, -5..5, 0..2 mm"         all faces that lie in this box (ranges along x, y and z)
# "named lid"                         all faces that have this name in the file
# "coloured red", "coloured #ff8000"  all faces that have this colour in the file
# "at 10, 0, 4 mm"                    a point


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
        GeometryError: Not one of this module's forms.
    """
    _check_size(field, text)
    if found := re.fullmatch(r"\s*([xyz])\s*=\s*(.+)", text):
        x, y, z = (float(axis == found[1]) for axis in AXES)
        return Faces(text, normal=(x, y, z), at=_length(field, found[2]))
    if found := re.fullmatch(r"\s*normal" + ",".join([NUMBER] * 3) + r"(?:at\s*(.+))?", text):
        direction = np.array([_number(field, part) for part in found.groups()[:3]])
        if not direction.any():
            raise GeometryError(f"{field} is {text!r}; a normal must not have zero length")
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
    """Return a hint for "at 10,5, 0, 2 mm", which may be 10.5."""
    return "; separate numbers by commas, and write decimals with a point" if re.search(r"\d,\d", text) else ""


def _bytes(text: str) -> Colour:
    red, green, blue = bytes.fromhex(text[1:])
    return red, green, blue


def _number(field: str, text: str) -> float:
    from softmodels.common.units import UnitError, number  # not above: whoever imports the devices need not have pint

    try:
        return number(text)
    except UnitError as error:
        raise GeometryError(f"{field}: {error}") from None


def _length(field: str, text: str) -> float:
    from softmodels.common.units import UnitError, quantity

    try:
        return quantity(text, "m")
    except UnitError as error:
        raise GeometryError(f"{field}: {error}") from None


def chosen(
    field: str, choice: Faces, tags: list[int], near: float, file: str, pieces: Sequence[Sequence[int]] = ()
) -> list[int]:
    """Return which faces of the current Gmsh model a choice picks out of ``tags``.

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
    """Return what names or colours there are, for a message."""
    if not known:
        return f"no face in the file has a {what}"
    more = f" and {len(known) - 20} more" if len(known) > 20 else ""
    return f"the {what}s of faces in the file are {', '.join(known[:20])}{more}"


def _at(places: list[int], tags: list[int], pieces: Sequence[Sequence[int]]) -> list[int]:
    every = pieces or [(tag,) for _, tag in gmsh.model.getEntities(2)]
    return [tag for place in places for tag in every[place] if tag in tags]


def _in_box(tag: int, box: tuple[tuple[float, ...], tuple[float, ...]], near: float) -> bool:
    low, high = np.array(gmsh.model.occ.getBoundingBox(2, tag)).reshape(2, 3)
    return bool(np.all(low > np.array(box[0]) - near) and np.all(high < np.array(box[1]) + near))


def _in_plane(tag: int, normal: NDArray[np.float64], at: float, near: float) -> bool:
    points = surface_points(tag)
    typed = 0.0 if np.abs(normal).max() == 1.0 else TILT * float(np.linalg.norm(points, axis=1).max())
    return bool(np.abs(points @ normal - at).max() < near + typed)


def surface_points(tag: int) -> NDArray[np.float64]:
    """Return some points all over a surface of the current Gmsh model, beyond its border too; shape (16, 3), m."""
    low, high = gmsh.model.getParametrizationBounds(2, tag)
    places = np.stack(np.meshgrid(*np.linspace(low, high, 4).T), axis=-1)
    return np.array(gmsh.model.getValue(2, tag, places.ravel())).reshape(-1, 3)
