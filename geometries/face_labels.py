"""Names and colours of the faces in a STEP file.

Gmsh passes on the colours of faces but not their names, so names travel as colours: in a copy of the file the wanted faces
get one colour each, and Open CASCADE itself brings it to its surface. No place is compared, so units, repaired or reordered
shells and faces of like shape do not matter. Gmsh loses colours where an assembly moves the part; the copy is unmoved.
"""

from __future__ import annotations

import contextlib
import re
import tempfile
from collections import defaultdict
from pathlib import Path

from geometries.errors import GeometryError
from measurement.user_file import GEOMETRY, read_file

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
    """Names that a file gives to faces, and the numbers of the instances that have each; faces without a name are left out."""
    found = defaultdict(list)
    for number, text in FACE.findall(_read(path)):
        if name := _plain(text).strip():
            found[name].append(int(number))
    return dict(found)


def named_surfaces(path: str | Path, name: str) -> list[int]:
    """Where the faces of a name stand among the surfaces that Gmsh makes of a file (0 is the first).

    Needs a current Gmsh session, and leaves its model as it is.

    Raises:
        GeometryError: So many faces have this name that it says nothing, or the CAD kernel changed one beyond recognition.
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
    """Name of the body that each volume which Gmsh makes of a file comes from, in their order; empty where it has none.

    Needs a current Gmsh session, and leaves its model as it is.
    """
    import gmsh  # type: ignore[import-untyped]

    text = _read(path)
    bodies = [(int(number), _plain(name).strip()) for number, name in SOLID.findall(text)]
    if not any(name for _, name in bodies) or len(bodies) >= SHADES**3:
        return [""] * len(gmsh.model.getEntities(3))
    marks = {_shades(k): number for k, (number, _) in enumerate(bodies)}
    names = {_mark(mark): name for mark, (_, name) in zip(marks, bodies, strict=True)}
    seen = _colours(_marked(text, {number: mark for mark, number in marks.items()}), 3)
    return [names.get(_mark(colour), "") if colour else "" for colour in seen]


def surface_colours(path: str | Path) -> list[Colour | None]:
    """Colour of each surface that Gmsh makes of a file, None where it has none; needs a current Gmsh session."""
    return _colours(_unmoved(_read(path)))


def _read(path: str | Path) -> str:
    return read_file(path, GEOMETRY).decode("latin-1")  # any byte is a letter, so that the copy holds the same bytes


def _plain(text: str) -> str:
    r"""A name without the escapes of ISO 10303-21: ``''``, ``\\``, ``\X\E9``, ``\X2\00E9\X0\``, ``\S\i``."""

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
    """The file with every part of an assembly where it was drawn."""
    return MOVE.sub(r"\1 \2, \2)", text)


def _marked(text: str, marks: dict[int, Colour]) -> str:
    """The file with these colours on these faces and no other."""
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
    """Colours of the surfaces, or volumes, that Gmsh makes of a file of this text."""
    import gmsh  # type: ignore[import-untyped]

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
    """Colour that marks something by a number."""
    return STEP * (number // SHADES**2), STEP * (number // SHADES % SHADES), STEP * (number % SHADES)


def _mark(colour: Colour) -> Colour:
    """The mark that a colour was: rounding moves it by a little."""
    red, green, blue = (STEP * (shade // STEP) + STEP // 2 for shade in colour)
    return red, green, blue
