"""Parts from files, with texts that assign roles to faces: STEP drawings, meshes of other programs, surfaces (STL)."""

from __future__ import annotations

import abc
import contextlib
import dataclasses
import functools
import hashlib
import io
import itertools
import math
import re
import tempfile
import unicodedata
import warnings
import zipfile
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from geometries import abaqus, actuator, mesh_arrays, meshing, registry, revolved, surfaces
from geometries.actuator import Actuator, CutPlane, Hold, Vector
from geometries.faces import FORMATS, SURFACES, UNITS, Colour, Faces, faces, point
from geometries.inlets import CUT_TOLERANCE, AirSpace, Inlet, air_spaces, on_plate, plugged, whole
from geometries.surfaces import Surface
from softmodels.common import errors, files, schema
from softmodels.common.arrays import Array
from softmodels.common.errors import GeometryError, MeshingError
from softmodels.common.lazy import gmsh, pyvista, scipy
from softmodels.common.units import quantity

OUTER = "outer"
"""Role of the faces that have no other."""


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

    file: str = schema.text_field("", "the part's file")
    cavities: tuple[str, ...] = schema.list_field(
        (),
        "a point in the air of each cavity, such as 'at 10, 0, 4 mm', or faces of its wall, such as 'named chamber'; "
        "not needed where the part has exactly one closed inner shell; 'none' for a solid part (no cavity)",
    )
    support: str = schema.text_field("", "held faces, such as 'x = 0 mm' or 'named flange'; three planes need none")
    surfaces: tuple[str, ...] = schema.list_field(
        (),
        "names for faces of the outside, which loads, clamps, sheets, contact and others may use, such as 'pad = coloured red'",
    )
    inlets: tuple[str, ...] = schema.list_field(
        (),
        "openings of the cavities to close with plugs of the part's material, each a point near it such as 'at 0, 0, 4 mm'; "
        "found without being named where the cavities are not closed; 'none' leaves all open",
    )
    planes: tuple[str, ...] = schema.list_field(
        (), "symmetry planes through the origin where the part is cut, such as 'y = 0 mm' or 'normal 1, -1, 0'"
    )
    pressure_ratios: tuple[float, ...] = schema.list_field(
        (), "pressure in each cavity over the requested one; all 1 if not given", numbers=True, shape=False
    )
    gauge_point: str = schema.text_field(
        "", "corner whose motion is reported, such as 'at 70, 0, 4 mm'; the farthest if not given"
    )
    rise: str = schema.choice_field("z", ("x", "y", "z"), "direction in which that motion is counted")

    stem: ClassVar = "part"
    headline: ClassVar = ("tip_shift", "tip_turn", "max_displacement")
    figure_texts: ClassVar = {
        "tip_shift": ("mm", "tip displacement", "distance that the tip has moved, in whatever direction"),
        "tip_turn": (
            "deg",
            "turn of the tip",
            "angle by which the line from the middle of the held faces to the tip has turned; half the bend of a circular arc",
        ),
    }
    unbonded: ClassVar = (OUTER,)
    foreign: ClassVar = True
    meeting: ClassVar = None
    kind: ClassVar[str] = "file"
    """Description of the file for messages."""

    def check(self) -> None:
        if not self.file:
            raise GeometryError(f"file is empty; name the part's {self.kind}")
        object.__setattr__(self, "file", errors.whole_path(self.file))
        if not self.support and len(self.planes) < 3:
            raise GeometryError("support is empty; give the held faces, such as 'x = 0 mm'")
        if len(set(self.planes)) != len(self.planes) or len(self.planes) > 3:
            raise GeometryError(f"planes is {', '.join(self.planes)}; at most three, each once")
        _ = self.patches
        self.check_cells()
        if self.pressure_ratios and len(self.pressure_ratios) != self.cavity_count:
            cavities = f"{self.cavity_count} cavit{'y' if self.cavity_count == 1 else 'ies'}"
            raise GeometryError(f"pressure_ratios has {len(self.pressure_ratios)} values for {cavities}; give one each")
        if self.ratios and not any(self.ratios):
            raise GeometryError("pressure_ratios are all 0; give one other than 0, below it for a vacuum")
        _ = self.reading

    @abc.abstractmethod
    def check_cells(self) -> None:
        """Check what decides the mesh, before the file is opened."""

    @property
    @abc.abstractmethod
    def reading(self) -> Reading:
        """Contents of the file; read once."""

    @property
    def files(self) -> Mapping[str, str]:
        return {"file": self.file}

    @property
    def key(self) -> str:
        """Twelve digits that change with the parameters and the file's contents, not with its path."""
        of_files = {name.partition("[")[0] for name in self.files}
        parameters = [(f.name, getattr(self, f.name)) for f in dataclasses.fields(self) if f.name not in of_files]
        return hashlib.sha256(repr((type(self).__name__, self.digest(), parameters)).encode()).hexdigest()[:12]

    @property
    def copies(self) -> int:
        return len(actuator.reflected(self.reading.normals))

    @property
    def faces(self) -> tuple[str, ...]:  # type: ignore[override]
        return tuple(self.patches)

    @property
    def patches(self) -> dict[str, str]:
        """Faces of the outside by the names that the user gives them."""
        patches: dict[str, str] = {}
        taken = {OUTER, "support", "axis", MAIN, *(f"plane{i}" for i in range(3))}
        for text in self.surfaces:
            name, _, which = (part.strip() for part in text.partition("="))
            if not (re.fullmatch(r"[a-z]\w*", name) and which):
                raise GeometryError(f"surfaces has {text!r}; write a name and its faces, such as 'pad = coloured red'")
            if name in taken or name in patches or re.fullmatch(r"cavity\d*", name):
                raise GeometryError(f"surfaces has {text!r}; the name {name!r} is taken, so use another")
            faces("surfaces", which)
            patches[name] = which
        return patches

    @property
    def chosen_by_name(self) -> bool:
        """Whether a face is picked by a name of the file's."""
        return any(re.match(r"\s*named\b", text) for text in (self.support, *self.cavities, *self.patches.values()))

    @property
    def airless(self) -> bool:
        """Whether it has no cavity."""
        return self.cavities == (NONE,)

    @property
    def remarks(self) -> tuple[str, ...]:  # type: ignore[override]
        reading = self.reading
        remarks = [*reading.repairs]
        remarks += [
            f"the opening {plug.text} is closed by a plug {1e3 * plug.length:.2g} mm long; --inlets none leaves it open"
            for plug in reading.plugs
        ]
        if (count := meshing.expected_cells(self)) > MANY_CELLS:
            remarks.append(
                f"about {float(f'{count:.1e}'):,.0f} cells take ten minutes or more on one core; larger ones (--cell-size) are "
                "fewer, down to what small features need"
            )
        if (size := getattr(self, "cell_size", 0.0) / self.finer) > COARSE_CELLS * reading.wall > 0.0:
            remarks.append(
                f"cells of up to {schema.shown(size, 'm')} are coarse for walls about {1e3 * reading.wall:.2g} mm thick; "
                "smaller ones (--finer 2) take longer, and --mesh-error says what they change"
            )
        share = sum(reading.cavity_volumes) / reading.air_on_file - 1.0 if reading.air_on_file else 0.0
        if abs(share) > SURFACE_VOLUME_TOLERANCE:
            remarks.append(
                f"the cavities have {abs(share):.2%} {'more' if share > 0 else 'less'} volume in these cells than in the file; "
                "use smaller ones (--cell-size)"
            )
        return tuple(remarks)

    def to_close(self, inner: int, surface: Callable[[], Surface], normals: Sequence[Vector]) -> list[Inlet]:
        """Return the openings to close in a part with a number of inner shells that are closed but where it is cut, by the
        outward unit normals of its cut planes. Its closed surface (corners in m, and triangles) is made only where it is
        needed; the openings are those of its air, or those that ``inlets`` names. GeometryError for one that is not there."""
        if self.airless or self.inlets == (NONE,):
            return []
        if inner >= self.cavity_count and not self.inlets:
            return []
        points = [point("cavities", text) for text in self.cavities if re.match(r"\s*at\b", text)]

        def search() -> dict[str, Array]:
            drawn = whole(surface(), normals)
            spaces = air_spaces(*drawn) or self._air_over_plate(drawn)
            openings = [
                own.row
                for space in spaces
                if not points or any(map(space.holds, points))
                for opening in space.inlets
                if (own := opening.within(normals))
            ]
            return {"openings": np.array(openings).reshape(-1, 9)}

        key = ("openings", self.digest(), points, self.support, getattr(self, "unit", ""), tuple(normals))
        openings = [Inlet.from_row(row) for row in meshing.cached_arrays(key, search)["openings"].tolist()]
        if not self.inlets:
            return openings
        named = []
        for text in self.inlets:
            place = np.array(point("inlets", text))
            nearest = min(openings, key=lambda opening: float(np.linalg.norm(place - opening.place)), default=None)
            if nearest is None or np.linalg.norm(place - nearest.place) > nearest.reach + nearest.length:
                places = "; ".join(opening.text for opening in openings) or "none that looks like an inlet"
                raise GeometryError(f"inlets has {text!r}; there is no opening. The openings found: {places}")
            named.append(nearest)
        return list(dict.fromkeys(named))

    def _air_over_plate(self, surface: Surface) -> list[AirSpace]:
        """Return the air spaces of a closed surface that are open but for their bores to the plane of its support."""
        held = faces("support", self.support) if self.support and not self.planes else None
        if held is None or held.normal is None:
            return []
        plated = on_plate(surface, np.array(held.normal), held.at)
        return air_spaces(*plated) if plated else []

    @property
    def bodies(self) -> tuple[tuple[str, ...], ...]:  # type: ignore[override]
        return self.reading.bodies

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
    def plate(self) -> Vector:  # type: ignore[override]
        return self.reading.plate

    @property
    def cut_planes(self) -> tuple[CutPlane, ...]:
        return tuple(CutPlane(f"plane{i}", normal) for i, normal in enumerate(self.reading.normals))

    @property
    def holds(self) -> tuple[Hold, ...]:
        return (Hold("support", None),) if self.support else ()

    @property
    def probes(self) -> Mapping[str, Vector]:
        return {"tip": self.reading.gauge}

    def device_figures(self, places: Mapping[str, Vector]) -> dict[str, float]:
        """Return how far the tip has moved and turned around the support; see `Actuator.device_figures`."""
        here, rest, held = (np.array(place) for place in (places["tip"], self.reading.gauge, self.reading.held))
        turn = math.atan2(float(np.linalg.norm(np.cross(rest - held, here - held))), float((rest - held) @ (here - held)))
        return {"tip_shift": math.dist(here, rest), "tip_turn": turn}

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


MAIN = "solid"
"""Region of a file with one solid."""
SURFACE_VOLUME_TOLERANCE = 1e-3
"""Share of the air's volume by which cells may miss that of the file's surface without a remark."""
NONE = "none"
"""What ``cavities`` says of a solid part."""


USUAL_SIZE, USUAL_CELLS = 3e-3, (3000.0, 5000.0)
"""Longest edge (m) of a part's cells if none is given, and between which numbers of cells it stays, roundings aside: 5000
cells are 30,000 unknowns, whose path takes a minute or two on one core."""
CELLS_PER_TRIANGLE, CELLS_PER_CUBE = 3.2, 4.4
"""Cells for each triangle of a thin wall's faces, and for each cube of the edge in a thick part, about."""
TRIED_CURVATURES = (10.0, 8.0, 6.0, 4.0)
"""Cells around a full circle, in the order tried."""
MANY_CELLS = 15_000
"""Cells whose path takes more than minutes on one core: 6,500 take 50 to 100 s, and time grows as their 1.3rd power."""
COARSE_CELLS = 2.0
"""Longest edge of the cells over the thickness of the walls, above which a remark says that they are coarse."""


def usual_size(area: float, volume: float) -> float:
    """Return a longest edge in m with which cells of a solid with this surface (m2) and volume (m3) are neither too few nor too
    many to be solved in minutes: they fill its volume, and on thin walls follow its area."""

    def of_count(cells: float) -> float:
        thin = math.sqrt(CELLS_PER_TRIANGLE * area / (revolved.TRIANGLE_AREA * cells))
        return max(thin, float(np.cbrt(CELLS_PER_CUBE * volume / cells)))

    size = min(max(USUAL_SIZE, of_count(USUAL_CELLS[1])), of_count(USUAL_CELLS[0]))
    return float(np.format_float_positional(size, precision=2, fractional=False))


def cavity_role(number: int) -> str:
    """Return the role of a cavity's walls, counted from 0."""
    return "cavity" if number == 0 else f"cavity{number + 1}"


@dataclasses.dataclass(frozen=True)
class Reading:
    """Contents of a file in m and m3, of the part as drawn: outward unit normals of the cut planes, the corner whose motion
    is reported, volumes of the solid and of each cavity, names of its solids, if there are several, and the openings closed by
    plugs."""

    normals: tuple[Vector, ...]
    gauge: Vector
    solid_volume: float
    cavity_volumes: tuple[float, ...]
    regions: tuple[str, ...] = ()
    plugs: tuple[Inlet, ...] = ()
    bodies: tuple[tuple[str, ...], ...] = ()
    """Regions of each of several bodies, which share no face."""
    air_on_file: float = 0.0
    """Volume in m3 of the air within a file's closed surface; its cells may follow it less closely."""
    repairs: tuple[str, ...] = ()
    """What was done to close and join the file's surfaces, and a unit other than mm that it states, in words."""
    plate: Vector = (0.0, 0.0, 0.0)
    """A place (m) in the plate that closes a cavity without a floor; the origin if there is none."""
    held: Vector = (0.0, 0.0, 0.0)
    """The middle of the held faces in m; the origin if there are none."""
    wall: float = 0.0
    """Thickness of its walls in m: twice the volume over the area of their faces; 0 of a mesh, whose cells are given."""
    cells: float = math.inf
    """Expected number of cells."""


# ----------------------------------------------------------------------------------------------------------------------
# Names of regions: short words, from whatever other programs call a solid or a set of cells.


def region_name(text: str) -> str:
    """Return a name of small letters, digits and ``_`` that begins with a letter: "Base plate (2)" is ``base_plate_2``."""
    plain = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    name = re.sub(r"\W+", "_", plain).strip("_").lower()
    return name if re.match(r"[a-z]", name) else f"region_{name}".rstrip("_")


def region_names(file: str, texts: Iterable[str]) -> dict[str, str]:
    """Return a file's names by those of their regions; `GeometryError` for two that become one."""
    region_names: dict[str, str] = {}
    for text in texts:
        if (other := region_names.setdefault(region_name(text), text)) != text:
            raise GeometryError(
                f"file {file}: {other!r} and {text!r} both become the region {region_name(text)}; names of regions have small "
                "letters, digits and _: rename one of them in the program that wrote the file"
            )
    return region_names


# ----------------------------------------------------------------------------------------------------------------------
# Names and colours of the faces in a STEP file.
#
# Gmsh passes on the colours of faces but not their names, so names travel as colours: in a copy of the file the wanted faces
# get one colour each, and Open CASCADE itself brings it to its surface. No place is compared, so units, repaired or reordered
# shells and faces of like shape do not matter. Gmsh loses colours where an assembly moves the part; the copy is unmoved.


ENTITY_REST = r"(?:[^';]|'[^']*')*;"
"""Up to the end of an instance; semicolons in texts do not count."""
FACE = re.compile(r"#(\d+)\s*=\s*(?:ADVANCED_FACE|FACE_SURFACE)\s*\(\s*'((?:[^']|'')*)'")
SOLID = re.compile(r"#(\d+)\s*=\s*(?:MANIFOLD_SOLID_BREP|BREP_WITH_VOIDS|FACETED_BREP)\s*\(\s*'((?:[^']|'')*)'")
STYLE = re.compile(r"(#\d+\s*=\s*)\w*STYLED_ITEM\s*\(" + ENTITY_REST)
MOVE = re.compile(r"(ITEM_DEFINED_TRANSFORMATION\s*\(\s*'[^']*'\s*,\s*'[^']*'\s*,)\s*(#\d+)\s*,\s*#\d+\s*\)")
CONTEXT = re.compile(r"#(\d+)\s*=[^;=]*GEOMETRIC_REPRESENTATION_CONTEXT")
CONTEXT_UNITS = re.compile(r"GLOBAL_UNIT_ASSIGNED_CONTEXT\s*\(\s*\(([^)]*)\)")
LENGTH_UNIT = re.compile(
    r"#(\d+)\s*=\s*\((?=[^;]*\bLENGTH_UNIT\b)[^;]*?"
    r"(?:CONVERSION_BASED_UNIT\s*\(\s*'([^']*)'|SI_UNIT\s*\(\s*(?:\.(\w+)\.|\$)\s*,\s*\.(METRE)\.)"
)
"""The number of a unit of length, and its name or the prefix of its metre."""
ESCAPE = re.compile(r"\\X\\([0-9A-F]{2})|\\X2\\([0-9A-F]+)\\X0\\|\\X4\\([0-9A-F]+)\\X0\\|\\S\\(.)|\\(\\)")

SHADES_PER_COLOUR, SHADE_STEP = 16, 16
"""Values of each of red, green and blue that mark a face: and how far apart, to survive rounding."""


def face_names(path: str | Path) -> dict[str, list[int]]:
    """Return the names that a file gives to faces, and the numbers of the instances that have each; faces without a name are
    left out."""
    face_names = defaultdict(list)
    for number, text in FACE.findall(_read(path)):
        if name := _plain(text).strip():
            face_names[name].append(int(number))
    return dict(face_names)


def named_surfaces(path: str | Path, name: str) -> list[int]:
    """Return where the faces of a name stand among the surfaces that Gmsh makes of a file (0 is the first), in a current
    session whose model stays as it is. GeometryError if too many faces have this name, or the CAD kernel changed one beyond
    recognition."""
    wanted = face_names(path)[name]
    if len(wanted) >= SHADES_PER_COLOUR**3:
        raise GeometryError(f"{len(wanted)} faces of {path} are named {name!r}; pick them by plane, box or colour")
    marks = {_mark_of_colour(_shades(k)): k for k in range(len(wanted))}
    colours = _colours(_with_marked_faces(_read(path), dict(zip(wanted, marks, strict=True))))
    named_surfaces = {
        place: marks[_mark_of_colour(colour)]
        for place, colour in enumerate(colours)
        if colour and _mark_of_colour(colour) in marks
    }
    if set(named_surfaces.values()) != set(marks.values()):
        raise GeometryError(f"a face named {name!r} in {path} is lost on import; pick it by plane, box or colour")
    return list(named_surfaces)


def length_unit(path: str | Path) -> str:
    """Return the unit of a STEP file's lengths in words, such as 'millimetre' or 'inch'. GeometryError for a file without one,
    of which the CAD kernel would take each number for one of whatever unit is asked for."""
    text = re.sub(r"/\*.*?\*/", "", _read(path), flags=re.DOTALL)
    used = set(re.findall(r"#(\d+)", " ".join(CONTEXT_UNITS.findall(text))))
    names = {"".join(words).lower() for number, *words in LENGTH_UNIT.findall(text) if number in used}
    if not re.search(r"\bDATA\b.*#\s*\d+\s*=", text, re.DOTALL):
        raise GeometryError(f"file {path} has no shape: its DATA section is empty; export the part again from the CAD program")
    if not (used and "LENGTH_UNIT" in text):
        raise GeometryError(f"file {path} states no unit of its lengths; export it again from the CAD program, in mm or inches")
    return " and ".join(sorted(names)) or "an unknown one"


def solid_names(path: str | Path) -> list[str]:
    """Return the name of the body that each volume which Gmsh makes of a file comes from, in their order; empty where it has
    none.

    Needs a current Gmsh session, and leaves its model unchanged.
    """
    text = _read(path)
    bodies = [(int(number), _plain(name).strip()) for number, name in SOLID.findall(text)]
    if not any(name for _, name in bodies) or len(bodies) >= SHADES_PER_COLOUR**3:
        return [""] * len(gmsh.model.getEntities(3))
    marks = {_shades(k): number for k, (number, _) in enumerate(bodies)}
    names = {_mark_of_colour(mark): name for mark, (_, name) in zip(marks, bodies, strict=True)}
    seen = _colours(_with_marked_faces(text, {number: mark for mark, number in marks.items()}), 3)
    return [names.get(_mark_of_colour(colour), "") if colour else "" for colour in seen]


def _read(path: str | Path) -> str:
    return files.read_file(path, files.MAX_GEOMETRY_BYTES).decode(
        "latin-1"
    )  # any byte is a letter, so that the copy holds the same bytes


def _plain(text: str) -> str:
    r"""Return a name without the escapes of ISO 10303-21: ``''``, ``\\``, ``\X\E9``, ``\X2\00E9\X0\``, ``\S\i``."""

    def letter(match: re.Match[str]) -> str:
        short, two, four, shifted, slash = match.groups()
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


def _without_placements(text: str) -> str:
    """Return the file with every part of an assembly where it was drawn."""
    return MOVE.sub(r"\1 \2, \2)", text)


def _with_marked_faces(text: str, marks: dict[int, Colour]) -> str:
    """Return the file with these colours on these faces and no other."""
    text = STYLE.sub(
        r"\1 CARTESIAN_POINT('', (0., 0., 0.));", _without_placements(text)
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
    return (
        SHADE_STEP * (number // SHADES_PER_COLOUR**2),
        SHADE_STEP * (number // SHADES_PER_COLOUR % SHADES_PER_COLOUR),
        SHADE_STEP * (number % SHADES_PER_COLOUR),
    )


def _mark_of_colour(colour: Colour) -> Colour:
    """Return the mark that a colour was: rounding moves it by a little."""
    red, green, blue = (SHADE_STEP * (shade // SHADE_STEP) + SHADE_STEP // 2 for shade in colour)
    return red, green, blue


# ----------------------------------------------------------------------------------------------------------------------
# Faces picked by such texts.


POINTS_TRIED = 100
"""Places that are looked at for one in the air within a shell."""
SAME_COLOUR = 2
"""How far red, green and blue may be off: they are written in decimals and rounded."""
PLANE_TOLERANCE = 1e-4
"""How far off, over its distance from the origin, a face may lie from a plane whose normal was typed with few digits."""


def chosen(
    field: str, choice: Faces, tags: list[int], near: float, file: str, pieces: Sequence[Sequence[int]] = ()
) -> list[int]:
    """Return which of the surfaces ``tags`` of the current Gmsh model, made of a STEP file and of nothing else, a field's
    choice picks out; ``near`` counts as the same place, m. ``pieces`` are for each surface of the file, in order, the model's
    surfaces that were made of it; empty if they are as read. GeometryError lists the names or colours of a file that has not
    the one chosen."""
    if choice.name is not None:
        known = face_names(file)
        if choice.name not in known:
            raise GeometryError(f"{field} is {choice.text!r}; {listed('name', sorted(known))}")
        return _at(named_surfaces(file, choice.name), tags, pieces)
    if choice.colour is not None:
        colours = _colours(_without_placements(_read(file)))
        wanted = np.array(choice.colour)
        places = [i for i, colour in enumerate(colours) if colour and np.abs(wanted - colour).max() <= SAME_COLOUR]
        if not places:
            seen = sorted({"#{:02x}{:02x}{:02x}".format(*colour) for colour in colours if colour})
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
    typed = 0.0 if np.abs(normal).max() == 1.0 else PLANE_TOLERANCE * float(np.linalg.norm(points, axis=1).max())
    return bool(np.abs(points @ normal - at).max() < near + typed)


def surface_points(tag: int) -> NDArray[np.float64]:
    """Return some points all over a surface of the current Gmsh model, beyond its border too; shape (16, 3), m."""
    low, high = gmsh.model.getParametrizationBounds(2, tag)
    places = np.stack(np.meshgrid(*np.linspace(low, high, 4).T), axis=-1)
    return np.array(gmsh.model.getValue(2, tag, places.ravel())).reshape(-1, 3)


def shells(surfaces: list[int]) -> list[list[int]]:
    """Return the surfaces that are connected by their curves."""
    left, shells = set(surfaces), []
    curves = {tag: {abs(curve) for _, curve in gmsh.model.getBoundary([(2, tag)], oriented=False)} for tag in surfaces}
    while left:
        shell = [left.pop()]
        for tag in shell:
            joined = {other for other in left if curves[other] & curves[tag]}
            left -= joined
            shell += joined
        shells.append(shell)
    return shells


# ----------------------------------------------------------------------------------------------------------------------
# What each face of a part does: cut plane, wall of a cavity, support, or just its outside.
#
# A cavity is found from a point in its air or from faces of its wall. Take away the faces on the cut planes: the walls that
# hang together by their edges are then the outside or one cavity each, and the wall nearest to the point is that of its own
# cavity, since the straight way there crosses no other. So a cavity is open only on cut planes; one with an inlet is connected
# with the outside.


class Boundary(abc.ABC):
    """Faces of a part by number: surfaces of a drawing in the current Gmsh model, or triangles of a mesh. ``near`` counts as
    the same place, m; ``program`` is a clause on where a user changes the part."""

    program: ClassVar[str]
    digits: ClassVar[int]
    """Decimals that normals are rounded to: a plane square to an axis has exactly this axis."""

    def __init__(self, part: ImportedPart, near: float):
        self.part, self.near = part, near
        self.plate = np.zeros(3)
        """A place (m) in the plate that closes the cavity, or the origin, in which cut planes meet."""

    @property
    @abc.abstractmethod
    def every(self) -> mesh_arrays.Ints:
        """All faces."""

    @property
    @abc.abstractmethod
    def nodes(self) -> Array:
        """Places all over the part in m, shape (n, 3)."""

    @abc.abstractmethod
    def pieces(self, among: mesh_arrays.Ints) -> list[mesh_arrays.Ints]:
        """Return the faces that are connected by their edges."""

    @abc.abstractmethod
    def body_of(self, faces: mesh_arrays.Ints) -> mesh_arrays.Ints:
        """Return the number of the body that each face belongs to."""

    @abc.abstractmethod
    def chosen(self, field: str, text: str, among: mesh_arrays.Ints) -> mesh_arrays.Ints:
        """Return the faces that a text picks."""

    @abc.abstractmethod
    def points(self, faces: mesh_arrays.Ints) -> Array:
        """Return places on faces in m, as many on each, shape (n, 3)."""

    @abc.abstractmethod
    def box(self, faces: mesh_arrays.Ints) -> Array:
        """Return the lowest and highest corner of some faces' box in m, shape (2, 3)."""

    @abc.abstractmethod
    def holds(self, place: Vector) -> bool:
        """Return whether a point (m) lies in the solid."""

    @abc.abstractmethod
    def nearest(self, place: Vector, pieces: list[mesh_arrays.Ints]) -> mesh_arrays.Ints:
        """Return the piece nearest to a point."""

    @abc.abstractmethod
    def inwards(self, normal: Array, faces: mesh_arrays.Ints) -> bool:
        """Return whether a normal of flat faces points into the solid."""

    @property
    def in_plate(self) -> Vector:
        """A place (m) in the plate that closes the cavity, or the origin."""
        return _vector(self.plate)

    @property
    def closed_by_plate(self) -> tuple[str, ...]:
        """A remark on the plate that closes the cavity, if one does."""
        if not self.plate.any():
            return ()
        return (f"the cavity opens onto {self.part.support!r}: the plate that holds the part there closes it",)

    def fitted(self, faces: mesh_arrays.Ints) -> Array:
        """Return the unit normal of the plane nearest to some faces."""
        points = self.points(faces)
        normal = np.round(np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][2], self.digits)
        return np.asarray(normal / np.linalg.norm(normal) + 0.0)  # no -0

    def roles(self) -> dict[str, mesh_arrays.Ints]:
        """Return the faces by role; every face has one, those of the outside perhaps several. GeometryError for a choice that
        picks nothing, or something that cannot have this role."""
        part, left, roles = self.part, self.every, dict[str, mesh_arrays.Ints]()

        def take(role: str, reference: mesh_arrays.Ints) -> None:
            nonlocal left
            roles[role], left = reference, left[~np.isin(left, reference)]

        for role, faces_of_plane in self.cut_faces().items():
            take(role, faces_of_plane)
        pieces = self.pieces(left)
        inner = self._inner(pieces)
        outside = np.setdiff1d(left, np.concatenate([left[:0], *inner]))
        if len(inner) < part.cavity_count and (behind := self._behind_support(left)):
            inner, outside = behind, np.setdiff1d(outside, np.concatenate(behind))
            pieces = [*inner, outside]
        if not part.cavities:
            take(cavity_role(0), self._only_inner(inner, pieces))
        for i, text in enumerate(part.cavities[: part.cavity_count]):
            wall = self._wall(text, pieces, left)
            if np.isin(outside, wall).any():
                raise GeometryError(f"cavities has {text!r}; that is outside the part, or its cavity is open to the outside")
            if not np.isin(wall, left).all():
                raise GeometryError(f"cavities has {text!r}; that cavity is already selected")
            take(cavity_role(i), wall)
        patches = [(name, "surfaces", text) for name, text in part.patches.items()]
        uncut = left  # of which a face may be held and have several names
        for role, field, text in (("support", "support", part.support), *patches):
            if text:
                take(role, self._some(f"{field} is {text!r}", field, text, uncut))
        return {name: faces for name, faces in {**roles, OUTER: left}.items() if len(faces)}

    def cut_faces(self) -> dict[str, mesh_arrays.Ints]:
        """Return the faces in each of the cut planes, by role."""
        left, roles = self.every, dict[str, mesh_arrays.Ints]()
        for i, text in enumerate(self.part.planes):
            roles[f"plane{i}"] = taken = self._in_cut_plane(text, left)
            left = left[~np.isin(left, taken)]
        return roles

    def outward(self, roles: Mapping[str, mesh_arrays.Ints]) -> tuple[Vector, ...]:
        """Return the unit normals of the cut planes, away from the solid. GeometryError for a plane that does not bound the
        part, or planes between which its images do not fill the whole."""
        normals = []
        for i, text in enumerate(self.part.planes):
            normal = self.fitted(roles[f"plane{i}"])
            normal = np.where(self.inwards(normal, roles[f"plane{i}"]), -normal, normal) + 0.0
            if (self.nodes @ normal).max() > self.near:
                raise GeometryError(f"planes has {text!r}; the part extends to both sides of it, so it is not cut there")
            normals.append(_vector(normal))
        actuator.check_slice(normals, self.part.planes)
        return tuple(normals)

    def _some(self, what: str, field: str, text: str, left: mesh_arrays.Ints) -> mesh_arrays.Ints:
        """Return the faces among ``left`` that a text picks; there must be some."""
        faces_left = self.chosen(field, text, left)
        if not len(faces_left):
            ends = zip(actuator.AXES, *(1e3 * self.box(self.every)), strict=True)
            spans = ", ".join(f"{name} {low:.7g} to {high:.7g}" for name, low, high in ends)
            raise GeometryError(
                f"{what}; the part has no such face, or it already belongs to a cut plane or a cavity (it spans {spans} mm)"
            )
        return faces_left

    def _in_cut_plane(self, text: str, left: mesh_arrays.Ints) -> mesh_arrays.Ints:
        """Return all faces in the plane of those that a text picks, which must go through the origin."""
        what = f"planes has {text!r}"
        picked = self._some(what, "planes", text, left)
        normal = self.fitted(picked)
        distances = self.points(picked) @ normal
        if np.ptp(distances) > 2 * self.near:
            raise GeometryError(f"{what}; these faces do not lie in one plane")
        if abs(distances.mean()) > self.near:
            shift = ", ".join(f"{value:.6g}" for value in -1e3 * distances.mean() * normal + 0.0)
            raise GeometryError(f"{what}; cut planes go through the origin: move the part by {shift} mm {self.program}")
        off = np.abs(self.points(left) @ normal).reshape(len(left), -1).max(axis=1)
        return left[off < self.near]

    def _behind_support(self, left: mesh_arrays.Ints) -> list[mesh_arrays.Ints]:
        """Return the walls that only the held faces join with the outside, if these lie in one plane: a plate there closes the
        air of a chamber without a floor."""
        part = self.part
        if not part.support or part.planes or part.inlets == (NONE,):
            return []
        held = self._some(f"support is {part.support!r}", "support", part.support, left)
        if np.ptp(self.points(held) @ self.fitted(held)) > 2 * self.near:
            return []
        if behind := self._inner(self.pieces(left[~np.isin(left, held)])):
            self.plate = self.points(held).mean(axis=0)
        return behind

    def _inner(self, pieces: list[mesh_arrays.Ints]) -> list[mesh_arrays.Ints]:
        """Return the pieces but the widest of each body, its outside."""
        widths = [float(np.linalg.norm(np.ptp(self.box(piece), axis=0))) for piece in pieces]
        widest = set({int(self.body_of(pieces[k][:1])[0]): k for k in np.argsort(widths)}.values())
        return [piece for k, piece in enumerate(pieces) if k not in widest]

    def _only_inner(self, inner: list[mesh_arrays.Ints], pieces: list[mesh_arrays.Ints]) -> mesh_arrays.Ints:
        """Return the wall of the only cavity, of those that are neither the outside nor joined to it; ``pieces`` are all."""
        file = self.part.file
        if not inner:
            where = "close it where it is drawn"
            if Path(file).suffix.lower() in {*FORMATS} - {*SURFACES}:
                where = (
                    "inlets of a mesh are closed where it has no regions and no face is picked by name; else take its STEP or "
                    "STL file"
                )
            raise GeometryError(
                f"cavities is empty, and file {file} has no closed inner shell that could be the cavity, and no inlet that "
                f"could be closed: {where}, name the planes of a part that is cut, or write cavities = ['none'] for a solid "
                "part (no cavity)"
            )
        if len(inner) > 1:
            largest = sorted(inner, key=lambda shell: -float(np.prod(np.ptp(self.box(shell), axis=0))))
            places = "; ".join(self._in_air(shell, pieces) for shell in largest[:4]) + ("; ..." if len(inner) > 4 else "")
            raise GeometryError(
                f"cavities is empty, and file {file} has {len(inner)} closed inner shells, with air {places}; name those to "
                "press, such as --cavities 'at 10, 0, 4 mm', or cavities = ['at 10, 0, 4 mm'] in a case file"
            )
        return inner[0]

    def _in_air(self, shell: mesh_arrays.Ints, pieces: list[mesh_arrays.Ints]) -> str:
        """Return a point in the air within a shell, which is one of the pieces, as `cavities` takes it: the middle, or one
        half-way between two places of its wall."""
        walls = self.points(shell)
        first, second = np.random.default_rng(0).integers(len(walls), size=(2, POINTS_TRIED))
        tried = [self.box(shell).mean(axis=0), *(0.5 * (walls[first] + walls[second]))]
        rounded = [np.round(place, 5) for place in tried]
        own = (place for place in rounded if not self.holds(_vector(place)) and self.nearest(_vector(place), pieces) is shell)
        return f"at {', '.join(f'{1e3 * value:.6g}' for value in next(own, rounded[0]) + 0.0)} mm"

    def _wall(self, text: str, pieces: list[mesh_arrays.Ints], left: mesh_arrays.Ints) -> mesh_arrays.Ints:
        """Return the piece of wall nearest to a point in the air, or that or those to which picked faces belong."""
        if re.match(r"\s*at\b", text):
            place = point("cavities", text)
            if self.holds(place):
                raise GeometryError(f"cavities has {text!r}; that point lies in the solid, not in a cavity's air")
            return self.nearest(place, pieces)
        picked = self._some(f"cavities has {text!r}", "cavities", text, left)
        return np.concatenate([piece for piece in pieces if np.isin(piece, picked).any()])


# ----------------------------------------------------------------------------------------------------------------------
# How many triangles the mesh of a STEP part's faces takes, from their areas and curvature, before any is made.


MOST_TRIANGLES = 1_000_000

CURVATURE_SAMPLES = 5
"""Places in each direction of a face's parameters where its curvature is looked at."""


def expected_triangles(faces: Iterable[int], cell_size: float, curvatures: Sequence[float]) -> Array:
    """Return the numbers of triangles on faces of the current Gmsh model, of a longest edge in m, for some numbers of cells
    around a full circle; or fewer: fine edges make the faces beside them finer."""
    total = np.zeros(len(curvatures))
    for face in faces:
        around = 2.0 * np.pi / np.outer(curvatures, np.maximum(_curvatures(face), 1e-30))
        total += gmsh.model.occ.getMass(2, face) * np.mean(np.minimum(cell_size, around) ** -2.0, axis=1)
    return np.asarray(total / revolved.TRIANGLE_AREA)


def cells_around(faces: Iterable[int], cell_size: float, choices: Sequence[float], most: float) -> tuple[float, float]:
    """Return the first of some numbers of cells around a full circle, largest first, with which no more than so many triangles
    are expected on faces of the current Gmsh model, or the last of them; and how many are. See `expected_triangles`."""
    triangles = expected_triangles(faces, cell_size, choices)
    few = np.flatnonzero(triangles <= most)
    chosen = int(few[0]) if len(few) else -1
    return choices[chosen], float(triangles[chosen])


def _curvatures(face: int) -> np.ndarray:
    """Return the largest curvature (1/m) at places all over a face."""
    low, high = gmsh.model.getParametrizationBounds(2, face)
    share = (np.arange(CURVATURE_SAMPLES) + 0.5) / CURVATURE_SAMPLES
    u, v = (low[i] + share * (high[i] - low[i]) for i in range(2))
    places = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1)
    largest, smallest = gmsh.model.getPrincipalCurvatures(face, list(places))[:2]
    return np.maximum(np.abs(largest), np.abs(smallest))


# ----------------------------------------------------------------------------------------------------------------------
# The solids of a STEP file: one, or several that are glued where they touch, each a region with its own name.
#
# A solid's name is that of its body in the file, else that of its part. Bodies' names do not come through Gmsh; they travel as
# colours, as faces' names do (see above).


MAX_OVERLAP_SHARE = 0.01
"""Volume over that of the later solid up to which an overlap of two solids is a sliver, that counts to the earlier one."""
NAMELESS = re.compile(r"Open CASCADE STEP translator.*|SOLID|COMPOUND|")


class Solids(Boundary):
    """Solids of the current Gmsh model by region. ``made`` are for each of the file's surfaces, in their order, those that
    gluing made of it; empty if nothing was glued."""

    program = "in its CAD program"
    digits = 12

    def __init__(self, part: ImportedPart, regions: dict[str, list[int]], made: Sequence[Sequence[int]] = ()):
        low, high = np.array(gmsh.model.getBoundingBox(-1, -1)).reshape(2, 3)
        self.extent, self.regions, self.made = float(np.linalg.norm(high - low)), regions, made
        self.plugs: tuple[Inlet, ...] = ()
        self.repairs: tuple[str, ...] = ()
        self.bodies = _bodies(regions)
        super().__init__(part, 1e-5 * self.extent)  # Gmsh's boxes are wider by its tolerance

    @property
    def tags(self) -> list[int]:
        return [tag for tags in self.regions.values() for tag in tags]

    @functools.cached_property
    def every(self) -> mesh_arrays.Ints:
        """Surfaces that bound the union of the solids, without those between two of them."""
        volumes = [(3, tag) for tag in self.tags]
        boundary = gmsh.model.getBoundary(volumes, combined=len(volumes) > 1, oriented=False)
        return np.array([abs(tag) for _, tag in boundary], dtype=np.int64)

    @property
    def volume(self) -> float:
        """Volume in m3."""
        return sum(float(gmsh.model.occ.getMass(3, tag)) for tag in self.tags)

    @property
    def centre(self) -> np.ndarray:
        """Centre of mass in m, shape (3,)."""
        masses = [gmsh.model.occ.getMass(3, tag) for tag in self.tags]
        return np.average([gmsh.model.occ.getCenterOfMass(3, tag) for tag in self.tags], axis=0, weights=masses)

    @property
    def nodes(self) -> Array:
        """Nodes of the surfaces, once they are meshed."""
        return np.asarray(gmsh.model.mesh.getNodes()[1].reshape(-1, 3))

    def pieces(self, among: mesh_arrays.Ints) -> list[mesh_arrays.Ints]:
        return [np.array(sorted(shell), dtype=np.int64) for shell in shells([int(tag) for tag in among])]

    def body_of(self, faces: mesh_arrays.Ints) -> mesh_arrays.Ints:
        owner = {tag: number for number, names in enumerate(self.bodies) for name in names for tag in self.regions[name]}
        volumes = [gmsh.model.getAdjacencies(2, int(face))[0] for face in faces]
        return np.array([next(owner[int(tag)] for tag in both if int(tag) in owner) for both in volumes], dtype=np.int64)

    def chosen(self, field: str, text: str, among: mesh_arrays.Ints) -> mesh_arrays.Ints:
        chosen_faces = chosen(field, faces(field, text), among.tolist(), self.near, self.part.file, self.made)
        return np.array(chosen_faces, dtype=np.int64)

    def points(self, faces: mesh_arrays.Ints) -> Array:
        return np.concatenate([np.zeros((0, 3)), *(surface_points(tag) for tag in faces)])

    def box(self, faces: mesh_arrays.Ints) -> Array:
        boxes = np.array([gmsh.model.occ.getBoundingBox(2, tag) for tag in faces])
        return np.array([boxes[:, :3].min(axis=0), boxes[:, 3:].max(axis=0)])

    def holds(self, place: Vector) -> bool:
        return any(gmsh.model.isInside(3, tag, list(place)) for tag in self.tags)

    def nearest(self, place: Vector, pieces: list[mesh_arrays.Ints]) -> mesh_arrays.Ints:
        probe = gmsh.model.occ.addPoint(*place)
        nearest_piece = min(pieces, key=lambda piece: min(gmsh.model.occ.getDistance(0, probe, 2, tag)[0] for tag in piece))
        gmsh.model.occ.remove([(0, probe)])
        return nearest_piece

    def inwards(self, normal: Array, faces: mesh_arrays.Ints) -> bool:
        return bool(normal @ self.centre > 0)

    def cut_normals(self) -> tuple[Vector, ...]:
        """Return the outward unit normals of the cut planes, before the part is meshed and checked."""
        fitted = [self.fitted(faces) for faces in self.cut_faces().values()]
        return tuple(_vector(-normal if self.inwards(normal, self.every) else normal) for normal in fitted)


def glued(part: ImportedActuator, metre: float, plugs: Sequence[tuple[int, int]] = ()) -> Solids:
    """Return the solids of the current Gmsh model, read from a part's file, glued where they touch unless they are loose, with
    volumes ``plugs`` of our own in the part's openings; a metre has so many of its units. GeometryError if there is none, or
    they overlap by more than a sliver."""
    volumes = [volume for volume in gmsh.model.getEntities(3) if volume not in plugs]
    if len(volumes) == 1 and not plugs:
        return Solids(part, {MAIN: [volumes[0][1]]})
    if not volumes:
        raise GeometryError(f"file {part.file} holds no solid, but {len(gmsh.model.getEntities(2))} faces")
    names = _names(part.file, volumes) if len(volumes) > 1 else [MAIN]
    if unknown := [name for name in part.loose if name not in names]:
        raise GeometryError(f"loose has {unknown[0]!r}; the solids of the file are {', '.join(dict.fromkeys(names))}")
    names += [names[0]] * len(plugs)
    own = set(gmsh.model.getBoundary(list(plugs), combined=False, oriented=False)) if plugs else set()
    surfaces = [surface for surface in gmsh.model.getEntities(2) if surface not in own]
    volumes = [*volumes, *plugs]
    bonded = [volume for name, volume in zip(names, volumes, strict=True) if name not in part.loose]
    apart = set(gmsh.model.getBoundary([volume for volume in volumes if volume not in bonded], False, False))
    cut = [*bonded, *(surface for surface in surfaces if surface not in apart)]
    made = dict(zip(cut, gmsh.model.occ.fragment(bonded, cut[len(bonded) :])[1], strict=True)) if len(bonded) > 1 else {}
    gmsh.model.occ.synchronize()
    regions: dict[str, list[int]] = defaultdict(list)
    owner: dict[int, str] = {}
    healed = []
    for name, volume in zip(names, volumes, strict=True):
        pieces_of_region = made.get(volume, [volume])
        whole = sum(gmsh.model.occ.getMass(*piece) for piece in pieces_of_region)
        for _, tag in pieces_of_region:
            if tag in owner:
                common = gmsh.model.occ.getMass(3, tag) / metre**3
                x, y, z = (1e3 * value / metre for value in gmsh.model.occ.getCenterOfMass(3, tag))
                what = f"the solids {owner[tag]} and {name} overlap by {1e9 * common:.3g} mm3 at {x:.4g}, {y:.4g}, {z:.4g} mm"
                if common * metre**3 > MAX_OVERLAP_SHARE * whole:
                    raise GeometryError(f"file {part.file}: {what}; cut one by the other")
                healed.append(f"{what}, which counts to {owner[tag]}")
                continue
            owner[tag] = name
            regions[name].append(tag)
    solids = Solids(part, dict(regions), tuple(tuple(tag for _, tag in made.get(face, [face])) for face in surfaces))
    solids.repairs = tuple(healed)
    return solids


def _names(file: str, volumes: list[tuple[int, int]]) -> list[str]:
    """Return the names of the regions of a file's solids, in the order of the volumes."""
    region_names_of_parts = []
    for number, (own, volume) in enumerate(zip(solid_names(file), volumes, strict=True), 1):
        label = str(gmsh.model.getEntityName(*volume)).rpartition("/")[2]
        region_names_of_parts.append(next((text for text in (own, label) if not NAMELESS.fullmatch(text)), f"solid {number}"))
    region_names(file, region_names_of_parts)
    return [region_name(text) for text in region_names_of_parts]


def _bodies(regions: Mapping[str, list[int]]) -> tuple[tuple[str, ...], ...]:
    """Return the regions of each body: those whose volumes share faces, or a name."""
    faces = {
        name: [abs(face) for tag in tags for _, face in gmsh.model.getBoundary([(3, tag)])] for name, tags in regions.items()
    }
    bodies: list[set[str]] = []
    for name in regions:
        beside = [body for body in bodies if any(set(faces[name]) & set(faces[other]) for other in body)]
        bodies = [*(body for body in bodies if body not in beside), {name}.union(*beside)]
    return tuple(tuple(name for name in regions if name in body) for body in bodies)


# ----------------------------------------------------------------------------------------------------------------------
# A STEP file in Gmsh: its unit, its volumes, its mesh.


CELLS_PER_CIRCLE = (40.0, 30.0, 20.0, 10.0)
"""Cells around a circle in the mesh of faces that the cavities' volumes are measured on and openings found, in the order
tried."""
MEASURED_TRIANGLES = 50_000
"""Triangles of that mesh above which it has fewer around a circle."""


@functools.lru_cache(maxsize=32)
def _usual_cells(file: str, digest: str, cell_size: float, curvature: float) -> tuple[float, float]:
    """Return the longest edge in m of a STEP file's cells, and how many of them are around a circle, for those that are 0: see
    `usual_size`, and the largest of `TRIED_CURVATURES` that makes no more than `MANY_CELLS`, or the smallest."""

    def measure() -> dict[str, Array]:
        return {"sizes": np.array(apart(file, _usual_cells_of, file, cell_size, curvature))}

    key = ("usual cells", digest, cell_size, curvature)
    size, around = meshing.cached_arrays(key, measure)["sizes"].tolist()
    return size, around


def _usual_cells_of(file: str, cell_size: float, curvature: float) -> tuple[float, float]:
    """See `_usual_cells`."""
    with meshing.private_model():
        import_step(file, "M")
        occ = gmsh.model.occ
        area, volume = (sum(occ.getMass(*entity) for entity in occ.getEntities(d)) for d in (2, 3))
        size = cell_size or usual_size(area, volume)
        if curvature:
            return size, curvature
        faces = [face for _, face in occ.getEntities(2)]
        return size, cells_around(faces, size, TRIED_CURVATURES, MANY_CELLS / CELLS_PER_TRIANGLE)[0]


PER_METRE = {"M": 1.0, "MM": 1e3}
"""Units of the CAD kernel in a metre, by its names."""


def apart[T](file: str, task: Callable[..., T], *arguments: object) -> T:
    """Carry out a task on a file in a process of its own; GeometryError if that dies."""
    try:
        return meshing.apart(task, *arguments)
    except MeshingError as error:
        raise GeometryError(f"file {file} cannot be read: {error}") from None


@functools.lru_cache(maxsize=32)
def read_part(part: ImportedActuator, digest: str) -> Reading:
    """Open the file, in a process of its own, and check every choice against it. Another digest, of another content, is
    another reading. GeometryError for a file or a choice that makes no device."""
    return apart(part.file, _read_step, part)


def _read_step(part: ImportedActuator) -> Reading:
    with meshing.private_model():
        solids = open_part(part)
        roles = solids.roles()
        faces = solids.every.tolist()
        choices = [max(part.curvature, cells) for cells in CELLS_PER_CIRCLE]
        around, expected = cells_around(faces, part.cell_size, choices, MEASURED_TRIANGLES)
        (triangles,) = expected_triangles(faces, part.cell_size, [part.curvature])
        if expected > MOST_TRIANGLES:
            raise GeometryError(
                f"cell_size is {schema.shown(part.cell_size, 'm')} with curvature {part.curvature:g}; about "
                f"{expected:.2g} triangles "
                f"are expected on the part's faces and {MOST_TRIANGLES:,} are allowed"
            )
        gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", around)
        gmsh.option.setNumber("Mesh.MeshSizeMax", part.cell_size)
        with meshing.ended_after(MAX_SURFACE_SECONDS):
            gmsh.model.mesh.generate(2)
        gmsh.model.mesh.setOrder(2)
        volumes = tuple(_enclosed_volume(solids, roles[cavity_role(i)]) for i in range(part.cavity_count))
        held = np.mean([gmsh.model.occ.getCenterOfMass(2, tag) for tag in roles.get("support", ())] or [np.zeros(3)], axis=0)
        return Reading(
            solids.outward(roles),
            _gauge(part, held),
            solids.volume,
            volumes,
            tuple(solids.regions) if len(solids.regions) > 1 else (),
            solids.plugs,
            bodies=solids.bodies if len(solids.bodies) > 1 else (),
            repairs=(*solids.repairs, *solids.closed_by_plate),
            plate=solids.in_plate,
            held=_vector(held),
            wall=2.0 * solids.volume / sum(gmsh.model.occ.getMass(2, face) for face in solids.every),
            cells=max(CELLS_PER_TRIANGLE * triangles, CELLS_PER_CUBE * solids.volume / part.cell_size**3),
        )


def build_part(part: ImportedActuator) -> None:
    """Fill the current Gmsh model with the part, its roles and its cell sizes (m)."""
    solids = open_part(part)
    for name, tags in solids.regions.items():
        gmsh.model.addPhysicalGroup(3, tags, name=name)
    every, roles = solids.every, solids.roles()
    places = {role: np.flatnonzero(np.isin(every, groups)) for role, groups in roles.items()}
    for names, groups in meshing.disjoint(places, len(every), OUTER).items():
        gmsh.model.addPhysicalGroup(2, every[groups].tolist(), name=names)
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", part.curvature)
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 1)
    gmsh.model.mesh.setSizeCallback(lambda dim, tag, x, y, z, other: min(other, part.cell_size))


def open_part(part: ImportedActuator, unit: str = "M") -> Solids:
    """Read the file in metres, or another of the CAD kernel's units, whatever its own; its solids are glued, and its openings
    closed."""
    own_unit = import_step(part.file, unit)
    metre = PER_METRE[unit]
    solids = glued(part, metre)
    if own_unit != "millimetre":
        solids.repairs = (f"the unit of length of {part.file} is {own_unit}, as the file states", *solids.repairs)
    cut = np.concatenate([solids.every[:0], *solids.cut_faces().values()]) if unit == "M" else solids.every[:0]
    normals = solids.cut_normals() if len(cut) else ()
    shells_of_air = len(solids.pieces(solids.every[~np.isin(solids.every, cut)])) - 1
    plugs = tuple(part.to_close(shells_of_air, lambda: _surface(metre), normals))
    if not plugs:
        return solids
    volumes = [_plug_volume(solids, plug, metre, normals) for plug in plugs]
    gmsh.model.occ.synchronize()
    closed = glued(part, metre, volumes)
    closed.plugs, closed.repairs = plugs, solids.repairs
    return closed


def import_step(file: str, unit: str) -> str:
    """Read a STEP file into the current Gmsh model, in a unit of the CAD kernel's; return its own, see `length_unit`.
    GeometryError for a file that is none, states no unit, or whose unit makes a part far too small or large."""
    gmsh.option.setNumber("Geometry.OCCImportLabels", 1)
    try:
        with meshing.drawn_in(unit):
            gmsh.model.occ.importShapes(file, format="step")
        gmsh.model.occ.synchronize()
    except Exception as error:  # Gmsh raises bare Exception
        raise GeometryError(f"file {file} cannot be read as STEP ({str(error).strip() or 'no reason given'})") from None
    own_unit = length_unit(file)
    if not gmsh.model.getEntities(2):
        return own_unit
    low, high = np.array(gmsh.model.getBoundingBox(-1, -1)).reshape(2, 3) / PER_METRE[unit]
    if not MIN_EXTENT < (extent := float(np.linalg.norm(high - low))) < MAX_EXTENT:
        raise GeometryError(
            f"file {file} spans {schema.shown(extent, 'm')}, because its unit of length is {own_unit}; parts span "
            f"{1e3 * MIN_EXTENT:g} mm to {MAX_EXTENT:g} m, so export it again in the unit that it was drawn in"
        )
    return own_unit


def _surface(metre: float) -> Surface:
    """Return corners in m and triangles of the current model's surfaces, of which a metre has so many of its units."""
    low, high = np.array(gmsh.model.getBoundingBox(-1, -1)).reshape(2, 3)
    size = float(np.linalg.norm(high - low)) / 20.0
    around, _ = cells_around([face for _, face in gmsh.model.getEntities(2)], size, CELLS_PER_CIRCLE, MEASURED_TRIANGLES)
    sizes = {"Mesh.MeshSizeFromCurvature": around, "Mesh.MeshSizeMax": size}
    before = {name: gmsh.option.getNumber(name) for name in sizes}
    for name, size in sizes.items():
        gmsh.option.setNumber(name, size)
    with meshing.ended_after(MAX_SURFACE_SECONDS):
        gmsh.model.mesh.generate(2)
    for name, size in before.items():
        gmsh.option.setNumber(name, size)
    tags, places, _ = gmsh.model.mesh.getNodes()
    number = np.zeros(int(tags.max()) + 1, dtype=np.int64)
    number[tags.astype(np.int64)] = np.arange(len(tags))
    corners = number[gmsh.model.mesh.getElementsByType(2)[1].astype(np.int64)].reshape(-1, 3)
    gmsh.model.mesh.clear()
    return places.reshape(-1, 3) / metre, corners


def _plug_volume(solids: Solids, opening: Inlet, metre: float, normals: Sequence[Vector]) -> tuple[int, int]:
    """Return a volume of the current model that fills an opening, up to cut planes of these outward unit normals: what a
    somewhat wider cylinder has of the air there."""
    occ = gmsh.model.occ
    place, way = metre * np.array(opening.place), metre * opening.length * np.array(opening.axis)
    cylinder = occ.addCylinder(*place, *way, metre * opening.cylinder)
    plugs, middle = [(3, cylinder)], metre * np.array(opening.middle)
    for normal in np.reshape(normals, (-1, 3)):
        depth, reach = float(middle @ normal), 2.0 * metre * (opening.cylinder + opening.length)
        if depth > -reach:
            beyond = occ.addCylinder(*(middle - depth * normal), *(reach * normal), reach)
            plugs, _ = occ.cut(plugs, [(3, beyond)])
            middle = middle - max(depth + 0.25 * metre * opening.radius, 0.0) * normal
    left, _ = occ.cut(plugs, [(3, tag) for tag in solids.tags], removeTool=False)
    occ.synchronize()
    middle = middle.tolist()
    own = next((volume for volume in left if gmsh.model.isInside(*volume, middle)), None)
    plug = own or max(left, key=lambda volume: float(occ.getMass(*volume)), default=None)  # a bore that turns
    occ.remove([volume for volume in left if volume != plug], recursive=True)
    if plug is None:
        raise GeometryError(
            f"the opening {opening.text} cannot be closed; close it where it is drawn, or leave it open: inlets = ['none']"
        )
    return plug


def _enclosed_volume(solids: Solids, tags: mesh_arrays.Ints) -> float:
    """Volume within a wall by the divergence theorem on its mesh, -1/3 int x . n: cut planes through the origin add nothing, as
    does a plate."""
    total = 0.0
    for tag in tags:
        for kind in gmsh.model.mesh.getElementTypes(2, tag):
            local, weights = gmsh.model.mesh.getIntegrationPoints(kind, "Gauss4")
            jacobians, determinants, places = gmsh.model.mesh.getJacobians(kind, local, tag)
            normals, at = jacobians.reshape(-1, 3, 3)[:, 2], places.reshape(-1, 3)
            # A face's mesh may be turned either way; the solid lies behind its outward normal.
            turned = 1.0 if solids.holds(tuple(at[0] - 1e-4 * solids.extent * normals[0])) else -1.0
            along = np.einsum("ij,ij->i", at - solids.plate, normals) * determinants
            total -= turned * float((along.reshape(-1, len(weights)) @ weights).sum()) / 3.0
    return total


def _corner(part: ImportedPart, corners: Array, held: Array) -> Vector:
    """Return which of some corners (n, 3) is the nearest to the wanted point, or the farthest from the middle (3,) of the
    held faces, in m."""
    if part.gauge_point:
        at = corners[np.linalg.norm(corners - point("gauge_point", part.gauge_point), axis=1).argmin()]
    else:
        at = corners[np.linalg.norm(corners - held, axis=1).argmax()]
    return _vector(at)


def _gauge(part: ImportedActuator, held: Array) -> Vector:
    """Return the corner nearest to the wanted point, or the one farthest from the middle (3,) of the held faces, in m."""
    corners = np.array([gmsh.model.getValue(0, tag, []) for _, tag in gmsh.model.getEntities(0)])
    if not len(corners):
        raise GeometryError(f"file {part.file} has no corner to follow; split an edge where the motion matters")
    gauge = _corner(part, corners, held)
    if part.gauge_point and math.dist(gauge, point("gauge_point", part.gauge_point)) > 1e-4:
        near = ", ".join(f"{value * 1e3:.6g}" for value in gauge)
        raise GeometryError(f"gauge_point is {part.gauge_point!r}; it must be a corner, the nearest is at {near} mm")
    return gauge


# ----------------------------------------------------------------------------------------------------------------------
# The device that a STEP file draws.


@registry.register_device
@dataclasses.dataclass(frozen=True, kw_only=True)
class ImportedActuator(ImportedPart):
    """A part from a STEP file, whose own unit counts; see `ImportedPart`.

    Several solids that touch are glued, unless they are ``loose``, and each is a region of its own name.
    """

    loose: tuple[str, ...] = schema.list_field(
        (), "solids that are not glued where they touch others, such as piston: bodies of their own, between which contact acts"
    )

    cell_size: float = schema.length_field(
        0.0,
        "longest edge of the cells; 0: 3 mm, or what makes a few thousand cells of a part, roundings aside",
        zero=True,
        shape=False,
    )
    curvature: float = schema.number_field(
        0.0, "cells around a full circle; 0: 10, or down to 4 where all would be more than 15,000", shape=False
    )
    order: int = schema.choice_field(2, (1, 2), "order of the cells' geometry: 1 straight, 2 curved edges")

    kind: ClassVar[str] = "STEP file (--file part.step)"

    def check_cells(self) -> None:
        if self.curvature and not 4.0 <= self.curvature <= 100.0:
            raise GeometryError(f"curvature is {self.curvature:g}; it must be between 4 and 100 cells around a circle")
        if not (self.cell_size and self.curvature):
            usual = _usual_cells(self.file, self.digest(), self.cell_size, self.curvature)
            for name, value in zip(("cell_size", "curvature"), usual, strict=True):
                object.__setattr__(self, name, value)

    @property
    def reading(self) -> Reading:
        return read_part(self, self.digest())

    @property
    def expected_cells(self) -> float:
        return self.reading.cells

    @property
    def regions(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the file's solids, if there are several."""
        return self.reading.regions

    def cast_along(self, pull: Vector | None, level: float | None) -> actuator.Recipe:
        if pull is None:
            raise GeometryError("the mould of this part needs its opening direction, such as --pull '0, 0, 1'")
        return actuator.in_halves(pull, level, f"The mould opens along {', '.join(f'{x:g}' for x in pull)}.")

    def build_whole(self) -> None:
        if self.planes:
            raise GeometryError(
                f"file {self.file} draws one of {self.copies} equal pieces, cut on its planes; draw the whole part"
            )
        solids = open_part(self, unit="MM")
        first, *others = ((3, tag) for tag in solids.tags)
        if len(others) > len(solids.plugs):
            raise GeometryError(f"file {self.file} has several solids; a mould needs a part of a single solid")
        if others:  # plugs, of the part's own silicone
            gmsh.model.occ.fuse([first], others)
            gmsh.model.occ.synchronize()

    def build(self) -> None:
        build_part(self)


# ----------------------------------------------------------------------------------------------------------------------
# Read meshes of other programs into arrays, with their names of faces and regions.
#
# Gmsh's ``.msh`` is read by meshio, which runs nothing that a file holds, Abaqus' ``.inp`` by `abaqus`. An ``.stl`` has
# surfaces only; the solid between them is meshed by Gmsh, in a separate process.


MAX_COORDINATE = 1e3
"""Distance in m of a corner of a surface from the origin, above which its file is damaged or in another unit."""
MAIN_MODEL, MAX_MODEL_BYTES, MAX_PLACED = "/3D/3dmodel.model", 500_000_000, 10_000
"""The model of a 3MF package, the largest size of all of its parts, and how many objects it may place."""
MIN_EXTENT, USUAL_EXTENT, MAX_EXTENT = 5e-4, 0.1, 10.0
"""Diagonals in m between which a part lies, and one of many; beyond them its file is in another unit."""
MIN_EDGE_ANGLE = math.radians(40.0)
"""Angle between triangles of an STL file from which their edge is one of the part."""
FILL_SIZES = (1.0, 0.9, 0.8)
"""Shares of the cell size to try in turn where Gmsh leaves a cell without volume."""
FACET_TOLERANCE, MAX_FACETS = 0.01, 30_000
"""Distance over the walls' thickness within which facets of an STL part are joined where they cannot be meshed as they are, or
are more than a number, from which Gmsh takes minutes or does not come back."""
FILL_CELLS_PER_CIRCLE, MIN_FILL_SHARE = 5.0, 0.35
"""Cells around a full circle of an STL part's roundings, and the smallest ones there over the cell size."""
MAX_FILL_GROWTH = 0.3
"""Growth of the cells' size over the distance from such a rounding."""
SIZE_GRID_POINTS = 100_000
"""Points of the grid, about, on which Gmsh looks up those sizes."""
EASING = (0.5,) * 5
"""Shares of their way from straight edges at which mid-edge nodes of spoilt cells stay, round by round."""
Sets = list[tuple[str, Sequence[Any]]]
"""Names of a file, and of each block of cells those that have the name; None for none."""
OTHER_CELLS = ("hexahedron", "wedge", "pyramid", "voxel")


def read_mesh(file: str, unit: float) -> mesh_arrays.Tetrahedra:
    """Read a mesh of tetrahedra, in m, of which ``unit`` is metres in one of its lengths. GeometryError for no such file, not a
    mesh, or none of tetrahedra."""
    kind = Path(file).suffix.lower()
    if kind not in FORMATS:
        raise GeometryError(f"file is {file!r}; meshes are read from {', '.join(FORMATS)}, drawings from STEP")
    return mesh_of(file, _by_meshio(file, FORMATS[kind]), unit)


def mesh_of(file: str, mesh_read: Any, unit: float) -> mesh_arrays.Tetrahedra:
    """Return a mesh of meshio's, which is a file's, in m; see `read_mesh`."""
    cells, blocks = _tetrahedra(file, mesh_read)
    kind = Path(file).suffix.lower()
    sets = _physical_groups(file, mesh_read) if kind == ".msh" else list(mesh_read.cell_sets.items())
    faces, regions = _face_names(mesh_read, sets), _region_names(mesh_read, sets, blocks)
    if kind == ".msh":
        cells, regions = _each_once(cells, regions)
    mesh = mesh_arrays.Tetrahedra.made(unit * np.asarray(mesh_read.points, dtype=float)[:, :3], cells, faces, regions)
    if len(bodies := mesh.bodies) > 1:
        numbered = {f"body{number}": cells for number, cells in enumerate(bodies, 1)}
        mesh = dataclasses.replace(mesh, regions={**numbered, **mesh.regions})
    return mesh


def _by_meshio(file: str, format_name: str) -> Any:
    import meshio

    try:
        files.check_file(file)
        content = b"" if format_name == "stl" else files.read_file(file, files.MAX_GEOMETRY_BYTES)
    except OSError as error:
        raise GeometryError(f"file {file} cannot be read ({errors.reason(error)})") from None
    try:
        with (
            contextlib.redirect_stdout(io.StringIO()),
            contextlib.redirect_stderr(io.StringIO()),
            warnings.catch_warnings(action="ignore"),
        ):
            if format_name == "gmsh":
                with tempfile.NamedTemporaryFile(suffix=".msh") as plain:
                    plain.write(_without_groups(content))
                    plain.flush()
                    mesh = meshio.read(plain.name, format_name)
            elif format_name == "abaqus":
                mesh = abaqus.Deck(file, content.decode("utf-8", errors="replace")).mesh()
            elif format_name == "3mf":
                corners = _three_mf(file)
                mesh = meshio.Mesh(corners, [("triangle", np.arange(len(corners)).reshape(-1, 3))])
            elif format_name in ("obj", "ply"):
                read = pyvista.read(file).extract_surface().triangulate()
                mesh = meshio.Mesh(np.asarray(read.points), [("triangle", np.asarray(read.regular_faces))])
            elif format_name == "stl" and len(corners := _binary_stl(file)):
                mesh = meshio.Mesh(corners, [("triangle", np.arange(len(corners)).reshape(-1, 3))])
            else:
                mesh = meshio.read(file, format_name)
    except OSError as error:
        raise GeometryError(f"file {file} cannot be read ({errors.reason(error)})") from None
    except GeometryError:
        raise
    except SystemExit:  # meshio's way with some files
        raise GeometryError(f"file {file} is not a mesh of the format of its extension") from None
    except Exception as error:  # meshio raises what its readers happen to meet
        words = " ".join(str(error).split())[:200] or "no reason given"
        raise GeometryError(f"file {file} is not a mesh of the format of its extension ({words})") from None
    if len(mesh.points) > Path(file).stat().st_size:  # a count in its header that no numbers follow
        raise GeometryError(
            f"file {file} is not a mesh of the format of its extension (it announces more nodes than it has bytes)"
        )
    if not len(mesh.points) or not np.isfinite(mesh.points).all() or np.shape(mesh.points)[1] != 3:
        raise GeometryError(f"file {file} has no nodes in three dimensions")
    return mesh


def _three_mf(file: str) -> Array:
    """Return the corners in mm of the triangles of a 3MF package, three of each, shape (3 t, 3): those of the models that it
    builds, where it puts them (3MF core and production specifications)."""
    with zipfile.ZipFile(file) as package:
        if sum(member.file_size for member in package.infolist()) > MAX_MODEL_BYTES:
            raise GeometryError(f"file {file} has models of more than {MAX_MODEL_BYTES / 1e6:g} MB; save it as STL")
        models = {
            f"/{name}": ElementTree.fromstring(package.read(name)) for name in package.namelist() if name.endswith(".model")
        }

    def moved(item: ElementTree.Element) -> Array:
        move = np.eye(4)
        if text := item.get("transform"):
            move[:, :3] = np.array(text.split(), dtype=float).reshape(4, 3)
        return move

    placed = itertools.count()

    def of_object(path: str, number: str | None, move: Array) -> Iterator[Array]:
        if next(placed) > MAX_PLACED:
            raise GeometryError(f"file {file} places more than {MAX_PLACED} objects; save it as STL")
        for entry in models[path].iterfind("{*}resources/{*}object"):
            if entry.get("id") != number or entry.get("type", "model") != "model":
                continue
            places = [[float(v.get(axis, "nan")) for axis in "xyz"] for v in entry.iterfind("{*}mesh/{*}vertices/{*}vertex")]
            ends = [[int(t.attrib[v]) for v in ("v1", "v2", "v3")] for t in entry.iterfind("{*}mesh/{*}triangles/{*}triangle")]
            if ends:
                yield (np.array(places) @ move[:3, :3] + move[3, :3])[np.ravel(ends)]
            for part in entry.iterfind("{*}components/{*}component"):
                elsewhere = next((text for name, text in part.items() if name.endswith("}path")), path)
                yield from of_object(elsewhere, part.get("objectid"), moved(part) @ move)

    main = MAIN_MODEL if MAIN_MODEL in models else next(iter(models))
    unit = 1e3 * quantity(f"1 {models[main].get('unit', 'millimeter')}", "m")
    items = [item for item in models[main].iterfind("{*}build/{*}item") if item.get("printable") != "0"]
    corners = [array for item in items for array in of_object(main, item.get("objectid"), moved(item))]
    return unit * np.concatenate(corners)


def _binary_stl(file: str) -> Array:
    """Return the corners of the triangles of a binary STL file, three of each, shape (3 t, 3); none if it is text. Many begin
    with "solid" as texts do, so zeros among its first bytes decide. Some count their triangles wrongly: as many are taken as
    there are. GeometryError for a file that ends within one."""
    size = Path(file).stat().st_size
    with Path(file).open("rb") as stream:
        head = stream.read(84)
        count = int.from_bytes(head[80:], "little")
        if b"\0" not in head + stream.read(50) and size != 84 + 50 * count:
            return np.empty((0, 3))
        if (size - 84) % 50:
            raise GeometryError(
                f"file {file} announces {count} triangles and has the bytes of {(size - 84) / 50:.1f}: it was cut off or "
                "damaged on its way; copy or export it again"
            )
        stream.seek(84)
        facets = np.fromfile(stream, dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    return facets["corners"].reshape(-1, 3).astype(float)


def _tetrahedra(file: str, mesh: Any) -> tuple[mesh_arrays.Ints, list[int]]:
    """Return all tetrahedra of one order, and the cell blocks that they come from."""
    kinds = [block.type for block in mesh.cells]
    if other := sorted({kind for kind in kinds if kind.startswith(OTHER_CELLS)}):
        raise GeometryError(f"file {file} has {', '.join(other)} cells; only tetrahedra of 4 or 10 nodes are supported")
    blocks = [i for i, kind in enumerate(kinds) if kind in ("tetra", "tetra4", "tetra10")]
    if not blocks:
        raise GeometryError(f"file {file} has no tetrahedra; it has {', '.join(sorted(set(kinds))) or 'no cells'}")
    if len({np.shape(mesh.cells[i].data)[1] for i in blocks}) > 1:
        raise GeometryError(f"file {file} mixes tetrahedra of 4 and of 10 nodes; mesh it with one kind")
    cells = np.concatenate([np.asarray(mesh.cells[i].data, dtype=np.int64) for i in blocks])
    if cells.min() < 0 or cells.max() >= len(mesh.points):
        raise GeometryError(f"file {file} has cells with undefined nodes")
    return cells, blocks


def _face_names(mesh: Any, sets: Sets) -> dict[str, mesh_arrays.Ints]:
    """Return by name the nodes of node sets, and the corners of the triangles of surfaces, sets and physical surfaces."""
    names = {name: np.asarray(nodes, dtype=np.int64) for name, nodes in mesh.point_sets.items()}
    chosen = defaultdict[str, list[mesh_arrays.Ints]](list)
    for name, parts in sets:
        chosen[name] += [
            np.asarray(block.data)[np.asarray(part, dtype=np.int64), :3]
            for block, part in zip(mesh.cells, parts, strict=False)
            if block.type.startswith("triangle") and part is not None and len(part)
        ]
    return names | {name: np.concatenate(triangles) for name, triangles in chosen.items() if triangles}


def _region_names(mesh: Any, sets: Sets, blocks: list[int]) -> dict[str, mesh_arrays.Ints]:
    """Return the cells by name, counted among the tetrahedra."""
    starts = dict(zip(blocks, np.cumsum([0] + [len(mesh.cells[i].data) for i in blocks]).tolist(), strict=False))
    chosen = defaultdict[str, list[mesh_arrays.Ints]](list)
    for name, parts in sets:
        chosen[name] += [np.asarray(parts[i], dtype=np.int64) + start for i, start in starts.items() if i < len(parts)
                         and parts[i] is not None and len(parts[i])]  # fmt: skip
    return {name: np.unique(np.concatenate(cells)) for name, cells in chosen.items() if cells}


# Gmsh's physical groups. An entity may be in several, and a face and the solid behind it may bear one name; meshio keeps one of
# each, and refuses a mesh some of whose entities are in none. So it reads the mesh without them.
GROUP = re.compile(rb'^\s*(\d)\s+-?(\d+)\s+"(.*)"\s*$', re.MULTILINE)
"""Dimension, number and name of a physical group."""


def _section(content: bytes, name: bytes) -> tuple[int, int]:
    """Return where the content of a section of a Gmsh file begins and ends; equal if there is none."""
    begin = re.search(rb"^\$" + name + rb"[ \t]*\r?\n", content, re.MULTILINE)
    end = content.find(b"$End" + name, begin.end()) if begin else -1
    return (begin.end(), end) if begin and end >= 0 else (0, 0)


def _without_groups(content: bytes) -> bytes:
    """Return a Gmsh file without its physical groups and the entities that are in them; meshio takes MSH 4 for 4.1."""
    content = re.sub(rb"(\$MeshFormat\s+)4 ", rb"\g<1>4.0 ", content, count=1)
    for name in (b"PhysicalNames", b"Entities", b"Periodic"):
        begin, end = _section(content, name)
        if end:
            content = content[: content.rfind(b"$", 0, begin)] + content[end + len(b"$End" + name) :].lstrip(b"\r\n")
    return content


def _physical_groups(file: str, mesh: Any) -> Sets:
    """Return the physical groups with a name of a Gmsh file: of each block of cells those in it."""
    content = files.read_file(file, files.MAX_GEOMETRY_BYTES)
    begin, end = _section(content, b"PhysicalNames")
    named = [(int(d), int(number), name.decode("utf-8", "replace")) for d, number, name in GROUP.findall(content[begin:end])]
    try:
        entities, data = _entities(content), mesh.cell_data
    except (ValueError, OverflowError, StopIteration):
        raise GeometryError(
            f"file {file} is not a mesh of the format of its extension (its section $Entities is damaged)"
        ) from None
    sets: Sets = []
    for dimension, number, name in named:
        parts = []
        for i, block in enumerate(mesh.cells):
            part = np.arange(len(block.data) if block.dim == dimension else 0)
            if entities is None:
                marks = data["gmsh:physical"][i] if "gmsh:physical" in data else np.zeros(len(block.data))
                part = part[np.abs(marks[part]) == number]
            elif len(part) and number not in entities.get((dimension, int(data["gmsh:geometrical"][i][0])), ()):
                part = part[:0]
            parts.append(part)
        sets.append((name, parts))
    return sets


def _entities(content: bytes) -> dict[tuple[int, int], set[int]] | None:
    """Return the numbers of the physical groups by dimension and tag of the entities in them; None in a file of MSH 2, which
    repeats a cell for each of its groups."""
    version, binary, _ = content.split(b"$MeshFormat", 1)[1].split(None, 3)[:3]
    if version.startswith(b"2"):
        return None
    begin, end = _section(content, b"Entities")
    data, at = content[begin:end], 0
    words = iter(() if binary == b"1" else data.split())

    def take(kind: str, count: int) -> list[float]:
        nonlocal at
        if binary == b"0":
            return [float(next(words)) for _ in range(count)]
        values = np.frombuffer(data, kind, count, at)
        at += values.nbytes
        return values.tolist()  # type: ignore[no-any-return]

    entities = {}
    for dimension, count in enumerate(take("<u8", 4) if end else ()):
        for _ in range(int(count)):
            (tag,) = take("<i4", 1)
            take("<f8", 3 if dimension == 0 and version == b"4.1" else 6)
            entities[dimension, int(tag)] = {abs(int(number)) for number in take("<i4", int(take("<u8", 1)[0]))}
            if dimension:
                take("<i4", int(take("<u8", 1)[0]))
    return entities


def _each_once(
    cells: mesh_arrays.Ints, regions: dict[str, mesh_arrays.Ints]
) -> tuple[mesh_arrays.Ints, dict[str, mesh_arrays.Ints]]:
    """Return the cells of a Gmsh file and of its regions without those that MSH 2 repeats."""
    _, first, same = np.unique(np.sort(cells, axis=1), axis=0, return_index=True, return_inverse=True)
    if len(first) == len(cells):
        return cells, regions
    kept = np.sort(first)
    number = np.searchsorted(kept, first)[same.ravel()]
    return cells[kept], {name: np.unique(number[region]) for name, region in regions.items()}


def read_surfaces(file: str, unit: float) -> tuple[Surface, list[str]]:
    """Return the closed surfaces of a file, repaired, and what was done to them, in words. GeometryError for no such file,
    no STL, or a surface that is not closed."""
    if (kind := Path(file).suffix.lower()) not in SURFACES:
        raise GeometryError(f"file is {file!r}; surfaces are read from {', '.join(SURFACES)}")
    arrays = _by_meshio(file, FORMATS[kind])
    triangles = [np.asarray(block.data, dtype=np.int64) for block in arrays.cells if block.type == "triangle"]
    if not triangles:
        raise GeometryError(f"file {file} has no triangles")
    places = unit * np.asarray(arrays.points, dtype=float)
    extent = float(np.abs(places).max()) if np.isfinite(places).all() else math.inf
    if extent > MAX_COORDINATE:
        raise GeometryError(
            f"file {file} has a corner {extent:.4g} m from its origin, more than {MAX_COORDINATE:g} m; check its unit, "
            "or repair it in the program that wrote it"
        )
    return surfaces.repaired(file, places, np.concatenate(triangles))


def meshed_solid(file: str, surface: Surface, cell_size: float) -> mesh_arrays.Tetrahedra:
    """Return the solid between the surfaces of an STL file, meshed."""

    def fill() -> dict[str, NDArray[Any]]:
        nodes, cells = _filled_apart(surface, cell_size)
        return {"nodes": np.asarray(nodes), "cells": np.asarray(cells)}

    try:
        nodes, cells = meshing.cached_arrays(("filled", *(array.tobytes() for array in surface), cell_size), fill).values()
    except MeshingError as error:
        raise GeometryError(
            f"the solid between the surfaces of {file} cannot be meshed ({error}); look for surfaces that touch or cross each "
            "other, or try another cell_size"
        ) from None
    return mesh_arrays.Tetrahedra.made(nodes, cells, {}, {})


def _filled_apart(surface: Surface, cell_size: float) -> tuple[NDArray[np.float64], mesh_arrays.Ints]:
    """Mesh the solid between closed surfaces in processes of their own: as they are unless they have very many facets, then
    simplified, or between their facets."""
    for reading in _readings(surface):
        with contextlib.suppress(MeshingError):  # the mesher crashed at some surfaces, or did not come back from them
            if made := meshing.apart(_fill, *reading, cell_size):
                return made
    return meshing.apart(_fill_between_facets, reading, cell_size)


def _readings(surface: Surface) -> Iterator[Surface]:
    if len(surface[1]) <= MAX_FACETS:
        yield surface
    area, volume = _area_and_volume(surface)
    yield surfaces.simplified(surface, FACET_TOLERANCE * 2.0 * volume / area)


def _fill(
    points: NDArray[np.float64], triangles: mesh_arrays.Ints, cell_size: float
) -> tuple[NDArray[np.float64], mesh_arrays.Ints] | None:
    """Mesh the solid between closed surfaces, of which the largest is the outside, with surfaces of their own: nodes in m, and
    tetrahedra; None where that gives flat cells."""
    for share in FILL_SIZES:
        try:
            nodes, cells = _mesh_surfaces(points, triangles, share * cell_size, True)
        except Exception:  # bare: Gmsh finds no parameters of some surfaces, or lets them cross
            return None
        if not mesh_arrays.flat_cell(nodes, cells):
            return nodes, cells
    return None


def _fill_between_facets(surface: Surface, cell_size: float) -> tuple[NDArray[np.float64], mesh_arrays.Ints]:
    """Mesh the solid with the triangles of its surface as faces of cells, split where they are longer than a cell: slivers
    from edge to edge of a wall would be several times too stiff."""
    return _mesh_surfaces(*surfaces.split(surface, cell_size), cell_size, False)


def _mesh_surfaces(
    points: NDArray[np.float64], triangles: mesh_arrays.Ints, cell_size: float, anew: bool
) -> tuple[NDArray[np.float64], mesh_arrays.Ints]:
    """See `_fill`; ``anew`` meshes the surfaces anew with cells of their own, else the file's triangles stay."""
    with meshing.private_model():
        tag = gmsh.model.addDiscreteEntity(2)
        gmsh.model.mesh.addNodes(2, tag, np.arange(1, len(points) + 1), points.ravel())
        gmsh.model.mesh.addElementsByType(tag, 2, [], (triangles + 1).ravel())
        with meshing.ended_after(MAX_SURFACE_SECONDS):
            gmsh.model.mesh.classifySurfaces(MIN_EDGE_ANGLE, True, anew, math.pi)
            if anew:
                gmsh.model.mesh.createGeometry()
        surfaces = shells([tag for _, tag in gmsh.model.getEntities(2)])
        outer = max(surfaces, key=_extent)
        loops = [gmsh.model.geo.addSurfaceLoop(shell) for shell in [outer, *(s for s in surfaces if s is not outer)]]
        solid = gmsh.model.geo.addVolume(loops)
        gmsh.model.geo.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 1)
        gmsh.option.setNumber("Mesh.MeshSizeMax", cell_size)
        if anew:
            _use_sizes(points, _sizes_of_roundings(points, triangles, cell_size), cell_size)
        try:
            with meshing.ended_after(MAX_SURFACE_SECONDS):
                gmsh.model.mesh.generate(2)
            gmsh.model.mesh.generate(3)
        except Exception as error:  # Gmsh raises bare Exception
            raise MeshingError(str(error).strip() or "Gmsh gives no reason") from None
        with meshing.quiet_output(b"BFGS update error"):
            gmsh.model.mesh.optimize("Netgen")
        # Edges of cells bend onto the file's facets, or the air would lose up to a tenth of its volume; where the facets
        # themselves are faces of cells, they stay straight.
        gmsh.option.setNumber("Mesh.SecondOrderLinear", not anew)
        gmsh.model.mesh.setOrder(2)
        if anew:
            meshing.straighten(3, EASING)
        known, places, _ = gmsh.model.mesh.getNodes()
        at = np.empty((int(known.max()) + 1, 3))
        at[known.astype(int)] = places.reshape(-1, 3)
        _, nodes = gmsh.model.mesh.getElementsByType(11, solid)
        if not len(nodes):
            raise MeshingError("Gmsh made no cells")
        return at, nodes.astype(np.int64).reshape(-1, 10)[:, mesh_arrays.TO_GMSH]


MAX_SURFACE_SECONDS = 90.0
"""CPU time in which Gmsh finds parameters of surfaces, or meshes them, a few seconds for most; it never ends with some."""


def _sizes_of_roundings(points: Array, triangles: mesh_arrays.Ints, cell_size: float) -> tuple[Array, Array]:
    """Return places (n, 3) on the rounded faces of a closed surface where cells have to be smaller than a size, and theirs, in
    m: the curvature at an edge is the angle there over the mean height of its two triangles."""
    normal = np.cross(points[triangles[:, 1]] - points[triangles[:, 0]], points[triangles[:, 2]] - points[triangles[:, 0]])
    double_area = np.linalg.norm(normal, axis=1)
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    order = np.lexsort(edges.T)  # of a closed surface, where two triangles share each
    start, end = edges[order[::2]].T
    first, second = order[::2] // 3, order[1::2] // 3
    length = np.linalg.norm(points[end] - points[start], axis=1)
    cosine = (normal[first] * normal[second]).sum(axis=1) / (double_area[first] * double_area[second])
    angle = np.arccos(np.clip(cosine, -1.0, 1.0))
    height = 0.5 * (double_area[first] + double_area[second]) / length
    sizes = 2.0 * np.pi / FILL_CELLS_PER_CIRCLE * height / np.maximum(angle, 1e-9)
    rounded = (angle < MIN_EDGE_ANGLE) & (sizes < cell_size)
    sizes = np.maximum(sizes[rounded], MIN_FILL_SHARE * cell_size)
    pieces = np.ceil(length[rounded] / sizes).astype(int) + 1
    edge = np.repeat(np.arange(len(sizes)), pieces)
    share = (np.arange(len(edge)) - np.repeat(np.cumsum(pieces) - pieces, pieces)) / np.repeat(pieces - 1, pieces)
    start, end = points[start[rounded]], points[end[rounded]]
    return start[edge] + share[:, None] * (end - start)[edge], sizes[edge]


def _use_sizes(points: Array, sizes: tuple[Array, Array], cell_size: float) -> None:
    """Let the current Gmsh model have cells of some sizes at some places, and of a longest edge far from them."""
    places, wanted = sizes
    low, high = points.min(axis=0), points.max(axis=0)
    step = float(np.cbrt(np.prod(high - low) / SIZE_GRID_POINTS))
    count = np.ceil((high - low) / step).astype(int) + 2
    axes = [low[i] - 0.5 * step + step * np.arange(count[i]) for i in range(3)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    size = np.full(len(grid), cell_size)
    classes = np.floor(np.log(wanted / wanted.min(initial=cell_size)) / np.log(1.5)).astype(int)
    for number in np.unique(classes):
        own = classes == number
        least = float(wanted[own].mean())
        reach = (cell_size - least) / MAX_FILL_GROWTH + least
        away, _ = scipy.spatial.cKDTree(places[own]).query(grid, distance_upper_bound=reach)
        size = np.minimum(size, least + MAX_FILL_GROWTH * np.maximum(np.minimum(away, reach) - least, 0.0))
    with tempfile.NamedTemporaryFile(suffix=".grid") as table:
        for values in (low - 0.5 * step, np.full(3, step), count.astype("<i4"), size):
            table.write(values.tobytes())
        table.flush()
        field = gmsh.model.mesh.field.add("Structured")
        gmsh.model.mesh.field.setString(field, "FileName", table.name)
        gmsh.model.mesh.field.setNumber(field, "TextFormat", 0)
        gmsh.model.mesh.field.setAsBackgroundMesh(field)
        gmsh.model.mesh.generate(1)  # which reads the table


def _extent(shell: list[int]) -> float:
    boxes = np.array([gmsh.model.getBoundingBox(2, tag) for tag in shell])
    return float(np.linalg.norm(boxes[:, 3:].max(axis=0) - boxes[:, :3].min(axis=0)))


# ----------------------------------------------------------------------------------------------------------------------
# The boundary of a foreign mesh.


class Triangles(Boundary):
    """Boundary triangles of a mesh."""

    program = "where it is meshed"
    digits = 6  # files round to seven

    def __init__(self, part: ImportedPart, mesh: mesh_arrays.Tetrahedra):
        super().__init__(part, 1e-5 * mesh.extent)  # files round to seven digits
        self.mesh = mesh

    @property
    def every(self) -> mesh_arrays.Ints:
        return np.arange(len(self.mesh.triangles))

    @property
    def nodes(self) -> Array:
        return self.mesh.points

    def pieces(self, among: mesh_arrays.Ints) -> list[mesh_arrays.Ints]:
        return self.mesh.pieces(among)

    def body_of(self, faces: mesh_arrays.Ints) -> mesh_arrays.Ints:
        number = np.zeros(len(self.mesh.points), dtype=np.int64)
        for k, cells in enumerate(self.mesh.bodies):
            number[self.mesh.cells[cells]] = k
        return np.asarray(number[self.mesh.triangles[faces, 0]])

    def chosen(self, field: str, text: str, among: mesh_arrays.Ints) -> mesh_arrays.Ints:
        choice, near, mesh = faces(field, text), self.near, self.mesh
        if choice.colour is not None:
            raise GeometryError(f"{field} is {text!r}; a mesh has no colours: name faces, or pick them by their place")
        if choice.name is not None:
            if choice.name not in mesh.faces:
                raise GeometryError(f"{field} is {text!r}; {listed('name', sorted(mesh.faces))}")
            return np.intersect1d(among, mesh.named(choice.name))
        corners = mesh.corners[among]
        if choice.box is not None:
            low, high = (np.array(end) for end in choice.box)
            return among[((corners > low - near) & (corners < high + near)).all(axis=(1, 2))]
        normal = np.array(choice.normal)
        typed = (
            0.0 if np.abs(normal).max() == 1.0 else PLANE_TOLERANCE * float(np.linalg.norm(corners, axis=2).max(initial=0.0))
        )
        return among[(np.abs(corners @ normal - choice.at) < near + typed).all(axis=1)]

    def points(self, faces: mesh_arrays.Ints) -> Array:
        return self.mesh.corners[faces].reshape(-1, 3)

    def box(self, faces: mesh_arrays.Ints) -> Array:
        places = self.points(faces)
        return np.array([places.min(axis=0), places.max(axis=0)])

    def holds(self, place: Vector) -> bool:
        return self.mesh.holds(place)

    def nearest(self, place: Vector, pieces: list[mesh_arrays.Ints]) -> mesh_arrays.Ints:
        away = self.mesh.distances(place)
        return min(pieces, key=lambda piece: float(away[piece].min()))

    def inwards(self, normal: Array, faces: mesh_arrays.Ints) -> bool:
        return bool(self.mesh.normals[faces[0]] @ normal < 0)


def put_on_planes(
    mesh: mesh_arrays.Tetrahedra, roles: Mapping[str, mesh_arrays.Ints], normals: Sequence[Vector]
) -> mesh_arrays.Tetrahedra:
    """Return the mesh with the nodes on its cut planes exactly there: files round."""
    points = mesh.points.copy()
    for _ in range(3):  # a node on two planes comes nearer to both
        for i, normal in enumerate(normals):
            nodes = np.unique(mesh.triangles[roles[f"plane{i}"]])
            points[nodes] -= np.outer(points[nodes] @ normal, normal)
    return dataclasses.replace(mesh, points=points)


def cavity_volumes(
    part: ImportedMesh, mesh: mesh_arrays.Tetrahedra, roles: Mapping[str, mesh_arrays.Ints], plate: Array
) -> tuple[float, ...]:
    """Return the volume in m3 of each cavity of the part as meshed, perhaps closed by a plate through a place (m);
    GeometryError for a wall that encloses nothing."""
    volumes = tuple(mesh.enclosed(roles[cavity_role(i)], plate) for i in range(part.cavity_count))
    for i, volume in enumerate(volumes):
        if not volume > 0.0:
            what = f"cavities has {part.cavities[i]!r}" if part.cavities else "the part has one closed inner shell"
            raise GeometryError(f"{what}; its wall encloses no air, so the mesh is no solid around it")
    return volumes


@registry.register_device
@dataclasses.dataclass(frozen=True, kw_only=True)
class ImportedMesh(ImportedPart):
    """A part from a mesh: ``.msh`` of Gmsh, ``.inp`` of Abaqus and CalculiX, ``.vtk`` or ``.vtu``, or an ``.stl``,
    ``.obj``, ``.ply`` or ``.3mf`` of its surfaces, air's included.

    Cells are tetrahedra, of 4 or of 10 nodes, and are taken as they are; hexahedra and wedges of decks are split. An STL file
    is filled with cells of ``cell_size``. Faces are picked as of a drawing, "named x" by a node set, a set of triangles or a
    physical surface; cells with a name are a region.
    """

    unit: str = schema.choice_field(
        "mm", tuple(UNITS), "unit of the file's lengths, which such files do not store (3MF does: leave it)"
    )
    cell_size: float = schema.length_field(
        0.0,
        "longest edge of the cells, only for an STL file; 0: 3 mm, or what makes a few thousand cells of a part",
        zero=True,
        shape=False,
    )
    air: tuple[str, ...] = schema.list_field(
        (),
        "STL files of the part's air, such as cavity.stl, if the part's own file has it not, or has it filled; each body in "
        "them is a cavity, in their order, unless cavities are named",
    )

    meshed: ClassVar[bool] = True
    kind: ClassVar[str] = "mesh (--file part.msh, part.inp or part.vtu) or surface (part.stl, part.obj or part.3mf)"

    def check_cells(self) -> None:
        """Check the files of its air, each body of which is a cavity in their order; a mesh is used as it is."""
        object.__setattr__(self, "air", tuple(map(errors.whole_path, self.air)))
        if self.air and not all(Path(file).suffix.lower() in SURFACES for file in self.files.values()):
            endings = ", ".join(SURFACES)
            raise GeometryError(f"air is {', '.join(self.air)}; give it with a part of its own, all as surfaces ({endings})")
        if self.air and not self.cavities:
            places = [at for file in self.air for at in surfaces.air_points(read_surfaces(file, UNITS[self.unit])[0])]
            if len(places) > 1:
                texts = (", ".join(f"{1e3 * x:.6g}" for x in place) for place in places)
                object.__setattr__(self, "cavities", tuple(f"at {text} mm" for text in texts))
        if self.refinable and not self.cell_size:
            surface = read_surfaces(self.file, UNITS[self.unit])[0]
            object.__setattr__(self, "cell_size", usual_size(*_area_and_volume(surface)))

    @property
    def refinable(self) -> bool:
        return Path(self.file).suffix.lower() in SURFACES

    @property
    def files(self) -> Mapping[str, str]:
        return {"file": self.file} | {f"air[{number}]": file for number, file in enumerate(self.air, 1)}

    @property
    def mesh(self) -> mesh_arrays.Tetrahedra:
        """The mesh in m; read once."""
        return _read_mesh(self, self.digest())[0]

    @property
    def reading(self) -> Reading:
        return _read_mesh(self, self.digest())[1]

    def cast_along(self, pull: Vector | None, level: float | None) -> actuator.Recipe:
        raise GeometryError(
            f"file {self.file} holds a mesh, without the exact faces that a mould is cut along; use the part's STEP file"
        )

    @property
    def regions(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names that the file has for some of the cells."""
        return tuple(self._named)

    @property
    def _named(self) -> dict[str, str]:
        """The file's names by those of the regions."""
        return _parts_of(self.file, self.mesh)

    @property
    def mesh_order(self) -> int:
        return 1 if self.mesh.cells.shape[1] == 4 else 2

    @property
    def expected_cells(self) -> float:
        return len(self.mesh.cells) / self.finer**3

    def build(self) -> None:
        """Put the mesh into the current Gmsh model, every role a group of its boundary, every region of its cells."""
        mesh = self.mesh
        second = mesh.cells.shape[1] == 10
        solid = gmsh.model.addDiscreteEntity(3)
        gmsh.model.mesh.addNodes(3, solid, np.arange(1, len(mesh.points) + 1), mesh.points.ravel())
        regions = {name: mesh.regions[given] for name, given in self._named.items()}
        for name, cells in meshing.disjoint(regions, len(mesh.cells), MAIN).items():
            tag = solid if name == MAIN else gmsh.model.addDiscreteEntity(3)
            nodes = mesh.cells[cells][:, mesh_arrays.TO_GMSH] if second else mesh.cells[cells]
            gmsh.model.mesh.addElementsByType(tag, 11 if second else 4, [], (nodes + 1).ravel())
            gmsh.model.addPhysicalGroup(3, [tag], name=name)
        roles = Triangles(self, mesh).roles()
        for role, triangles in meshing.disjoint(roles, len(mesh.triangles), OUTER).items():
            tag = gmsh.model.addDiscreteEntity(2)
            gmsh.model.mesh.addElementsByType(tag, 9 if second else 2, [], (mesh.triangles[triangles] + 1).ravel())
            gmsh.model.addPhysicalGroup(2, [tag], name=role)


def _cut_normals(part: ImportedPart, points: Array) -> tuple[Vector, ...]:
    """Return the outward unit normals of the planes on which a surface is cut, whose corners are given in m."""
    normals = [choice.normal for text in part.planes if (choice := faces("planes", text)).normal is not None]
    return tuple(_vector(np.array(n) if (points @ n).mean() < 0.0 else -np.array(n)) for n in normals)


def _vector(values: Array) -> Vector:
    x, y, z = (float(value) + 0.0 for value in values)
    return x, y, z


def _area_and_volume(surface: Surface) -> tuple[float, float]:
    """Return the area (m2) of a closed surface and the volume (m3) of the solid that it bounds."""
    points, triangles = surface
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    normal = np.cross(b - a, c - a)
    area = 0.5 * float(np.linalg.norm(normal, axis=1).sum())
    return area, abs(float(np.einsum("ij,ij->", a - points[0], normal))) / 6.0


def _parts_of(file: str, mesh: mesh_arrays.Tetrahedra) -> dict[str, str]:
    """Return the file's names of some of the cells by those of their regions; `GeometryError` for two that become one."""
    return region_names(file, [name for name, cells in mesh.regions.items() if 0 < len(cells) < len(mesh.cells)])


@functools.lru_cache(maxsize=8)
def _read_mesh(part: ImportedMesh, digest: str) -> tuple[mesh_arrays.Tetrahedra, Reading]:
    """Read the file and check every choice against it. Another digest, of another content, is another reading."""
    air, wall, size = np.zeros(0), 0.0, part.cell_size
    mesh, surface, repairs = None, None, list[str]()
    if part.refinable:
        surface, repairs = read_surfaces(part.file, UNITS[part.unit])
        for file in part.air:
            space, more = read_surfaces(file, UNITS[part.unit])
            surface, cut = surfaces.without_air(part.file, surface, file, space)
            repairs += more + cut
    else:
        mesh = read_mesh(part.file, UNITS[part.unit])
        if not (_parts_of(part.file, mesh) or part.chosen_by_name):
            surface = mesh.surface
    given = surface[0] if surface else mesh.points if mesh else np.zeros((1, 3))
    extent = float(np.linalg.norm(np.ptp(given, axis=0)))
    if not MIN_EXTENT < extent < MAX_EXTENT:
        likely = min(
            UNITS, key=lambda unit: abs(math.log10(max(extent, 1e-300) / UNITS[part.unit] * UNITS[unit] / USUAL_EXTENT))
        )
        raise GeometryError(
            f"file {part.file} spans {schema.shown(extent, 'm')} with unit {part.unit!r}; give the unit of its lengths, such "
            f"as --unit {likely}"
        )
    plugs: list[Inlet] = []
    if surface:
        points, triangles = surface
        normals = _cut_normals(part, points)
        depths = np.abs(points @ np.reshape(normals, (-1, 3)).T)
        cut = (depths[triangles] < CUT_TOLERANCE * np.ptp(points, axis=0).max()).all(axis=1).any(axis=1)
        walls = triangles[~cut]
        shells = len(np.unique(mesh_arrays.shells(walls, len(points))))
        if plugs := part.to_close(shells - 1, lambda: (points, triangles), normals):
            surface = plugged(surface, plugs, normals)
            if mesh:
                repairs.append(f"the cells of {part.file} are made anew, because an opening is closed")
        if plugs or not mesh:
            air = mesh_arrays.enclosed_air(*surface)
            area, volume = _area_and_volume(surface)
            wall, size = 2.0 * volume / area, size or usual_size(area, volume)
            mesh = meshed_solid(part.file, surface, size / part.finer)
    assert mesh is not None
    _parts_of(part.file, mesh)
    boundary = Triangles(part, mesh)
    roles = boundary.roles()
    normals = boundary.outward(roles)
    mesh = put_on_planes(mesh, roles, normals)
    volumes = cavity_volumes(part, mesh, roles, boundary.plate)
    on_file = float(air.sum()) if len(air) == len(volumes) else 0.0  # others are not named, or closed by what holds the part
    said = (*repairs, *boundary.closed_by_plate)
    held = mesh.corners[roles["support"]].reshape(-1, 3).mean(axis=0) if "support" in roles else np.zeros(3)
    at = _corner(part, mesh.points[np.unique(mesh.triangles[:, :3])], held)
    named, cells = _parts_of(part.file, mesh), mesh.bodies
    bodies = tuple(tuple(name for name, given in named.items() if np.isin(mesh.regions[given], own).all()) for own in cells)
    bodies = bodies if len(cells) > 1 else ()
    return mesh, Reading(
        normals, at, mesh.volume, volumes, plugs=tuple(plugs), bodies=bodies, air_on_file=on_file, repairs=said,
        plate=boundary.in_plate, held=_vector(held), wall=wall,
    )  # fmt: skip
