"""Reading a mesh file that may come from anywhere: checked before Gmsh sees it.

Gmsh takes a file that is no mesh for a script in its own language and runs it, commands of the shell included; it also runs
the options in ``NAME.msh.opt`` beside a mesh. A results folder may come from somebody else, so nothing but the mesh itself,
in the one format that this project writes, reaches Gmsh, and from a folder of its own.
"""

from __future__ import annotations

import re
import tempfile
from pathlib import Path

from geometries.errors import MeshFileError
from measurement.user_file import GEOMETRY, read_file

START = re.compile(rb"\$MeshFormat\r?\n4\.1 0 8\r?\n\$EndMeshFormat\r?\n")
"""How a mesh file begins: MSH 4.1, text."""

LAST_WORDS = b"$EndElements"
"""How a complete one ends."""

SECTION = re.compile(rb"^\$(\w+)\s*$", re.MULTILINE)
SECTIONS = ("MeshFormat", "PhysicalNames", "Entities", "Nodes", "Elements")
"""Sections of a mesh file, in order; each ends with its name after "End"."""


def is_whole(path: Path) -> bool:
    """Whether a mesh file is complete: Gmsh does not tell of a full disk, its file then ends early."""
    with path.open("rb") as file:
        file.seek(max(path.stat().st_size - 2 * len(LAST_WORDS), 0))
        return LAST_WORDS in file.read()


def load_mesh(path: str | Path, dimension: int | None = None) -> list[tuple[int, int, str]]:
    """Read a mesh file into the current Gmsh model (see `geometries.meshing.private_model`).

    Args:
        path: A file made by `Actuator.write`.
        dimension: 2 for an axisymmetric mesh, 3 for a solid one; any if not given.

    Returns:
        Dimension, tag and name of its physical groups; a region and the face of it may bear one name.

    Raises:
        FileNotFoundError: No such file.
        MeshFileError: Not a complete mesh of that format and dimension.
    """
    import gmsh  # type: ignore[import-untyped]

    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path} is not a file")
    _check(path, read_file(path, GEOMETRY))
    with tempfile.TemporaryDirectory() as folder:
        alone = Path(folder) / "alone.msh"  # nothing of Gmsh's beside it
        alone.symlink_to(path.resolve())
        try:
            gmsh.merge(str(alone))
        except Exception as error:  # Gmsh raises bare Exception
            raise MeshFileError(f"{path} is a broken mesh file ({str(error).strip() or 'no reason given'})") from None
    if dimension not in (None, found := gmsh.model.getDimension()):
        raise MeshFileError(f"{path} is the mesh of another device: its cells have {found} dimensions, not {dimension}")
    return [(*group, gmsh.model.getPhysicalName(*group)) for group in gmsh.model.getPhysicalGroups()]


def _check(path: Path, content: bytes) -> None:
    """Refuse what does not have a mesh's sections, whole and in order, and nothing between them."""
    if not START.match(content):
        raise MeshFileError(f"{path} is not a mesh file (MSH 4.1, text) as this program writes it")
    if b"\0" in content:
        raise MeshFileError(f"{path} is a broken mesh file: it holds bytes that are no text")
    marks = list(SECTION.finditer(content))
    expected = [word for name in SECTIONS for word in (name.encode(), b"End" + name.encode())]
    if [mark[1] for mark in marks] != expected:
        raise MeshFileError(f"{path} is a broken mesh file: its sections are not {', '.join(SECTIONS)}, each whole")
    between = [content[end.end() : start.start()] for end, start in zip(marks[1::2], marks[2::2], strict=False)]
    if b"".join([*between, content[marks[-1].end() :]]).strip():
        raise MeshFileError(f"{path} is a broken mesh file: there is something between or after its sections")
