"""A folder of results that is readable at every moment, whatever stops the run.

New results are prepared aside, and replace those of an earlier run when their first step is there. Each step goes into a file
of its own, written aside and renamed, and the light files (XDMF, CSV) are replaced whole after each step. A run that ends well
gathers the steps into one HDF5 file. Only rank 0 has one of these; nothing here knows of MPI.
"""

from __future__ import annotations

import contextlib
import csv
import dataclasses
import errno
import functools
import io
import json
import os
import shutil
from collections.abc import (
    Iterable,
    Iterator,
    Mapping,
    Sequence,
)
from pathlib import Path
from typing import (
    TYPE_CHECKING,
    Any,
    Protocol,
    TypedDict,
)
from xml.etree import ElementTree

import h5py
import numpy as np
import numpy.typing as npt

from softmodels.case.case import Case
from softmodels.case.materials import SourceBand
from softmodels.common.errors import Spoken
from softmodels.common.files import (
    check_file,
    hdf5_reason,
    remove_steps,
    replace,
    replace_hdf5,
    write_text,
)
from softmodels.common.folders import PATIENCE, OwnFolder
from softmodels.runs.band import (
    FILE as SOURCES,
)
from softmodels.runs.band import (
    SourceRows,
    in_order,
    read_sources,
    write_sources,
)
from softmodels.runs.row import Row

if TYPE_CHECKING:
    from softmodels.path.points import Point


# ----------------------------------------------------------------------------------------------------------------------
# What a restart needs of a state, beside its fields.


class StoredSignature(TypedDict):
    """A `Signature` as it is stored."""

    negative_eigenvalues: int
    lowest: float
    exact: bool


class Restart(TypedDict):
    """What a `Point` needs to be made again, beside its fields; see there.

    Attributes:
        P, V: The state's pressure and volume, dimensionless.
        tangent: Changes of P and V along the path.
    """

    P: float
    V: float
    requested: bool
    limit: bool
    jump: bool
    turn: bool
    step: float
    line: str
    stiffest: float
    tangent: list[float]
    signature: StoredSignature


def restart_of(point: Point) -> Restart:
    """What a point's step stores for a restart."""
    signature = point.signature
    return {
        "P": point.state.P, "V": point.state.V, "requested": point.requested, "limit": point.limit, "jump": point.jump,
        "turn": point.turn, "step": point.step, "line": point.line, "stiffest": point.stiffest,
        "tangent": [point.tangent.P, point.tangent.V],
        "signature": {
            "negative_eigenvalues": signature.negative_eigenvalues, "lowest": signature.lowest, "exact": signature.exact,
        },
    }  # fmt: skip


# ----------------------------------------------------------------------------------------------------------------------
# Reading the HDF5 files of a folder of results, which may come from somebody else.
#
# HDF5 takes values from other files where a dataset is stored outside (external storage), is put together from others (virtual)
# or is behind a link. None of what is read here is written so, and what is so is refused: it would show other files' bytes.


LARGEST = 1 << 50
"""Bytes of a file of results: as many as there are."""
NUMBERS = "fiu"
"""Kinds of numpy's types that fields have."""


class ForeignDataError(ValueError):
    """A file of results that refers to other files; the message goes on from its name."""


@contextlib.contextmanager
def opened(path: Path) -> Iterator[h5py.File]:
    """A file of results, open for reading.

    Raises:
        OSError: It is not a regular file, or not HDF5.
    """
    import h5py

    check_file(path, LARGEST)
    with h5py.File(path, "r") as file:
        yield file


def inside(group: h5py.Group, path: str) -> Any:
    """What lies at a path in a group: a group, or a dataset of numbers that are stored in this file.

    Raises:
        KeyError: There is nothing.
        ForeignDataError: It refers to another file.
    """
    import h5py

    place = group
    for name in filter(None, path.split("/")):
        if not isinstance(place, h5py.Group):
            raise KeyError(f"no {path}")
        if not isinstance(link := place.get(name, getlink=True), h5py.HardLink):
            raise (
                KeyError(f"no {path}") if link is None else ForeignDataError(f"{path} is a link, which is not followed")
            )
        place = place[name]
    if isinstance(place, h5py.Dataset):
        if place.external is not None or place.is_virtual:
            raise ForeignDataError(f"{path} takes its values from other files, which are not read")
        if place.dtype.kind not in NUMBERS or place.size * place.dtype.itemsize > place.id.get_storage_size():
            raise ForeignDataError(
                f"{path} is packed, or holds fewer numbers than it announces; results are stored as they are"
            )
    return place


def read_values(group: h5py.Group, path: str) -> npt.NDArray[np.generic]:
    """The numbers of a dataset; see `inside`."""
    return inside(group, path)[()]  # type: ignore[no-any-return]


# ----------------------------------------------------------------------------------------------------------------------
# Where one step of a run is on disk.


ROW, RESTART = "row", "restart"
"""Attributes of a step: its row of ``path.csv``, and what a restart needs beside its fields."""


@dataclasses.dataclass(frozen=True)
class StoredStep:
    """Where one step's fields are, and what else is known of it.

    Attributes:
        file: HDF5 file, relative to the folder of results.
        group: Its group in there.
        row: Its row of ``path.csv``.
        restart: What a `Point` needs to be made again, beside its fields.
        shapes: Shapes of its nodal fields by name, (n,) or (n, 3).
    """

    file: str
    group: str
    row: Row
    restart: Restart
    shapes: Mapping[str, tuple[int, ...]]


class Shaped(Protocol):
    """An array, or a dataset of a file."""

    @property
    def shape(self) -> tuple[int, ...]: ...


def shapes_of(fields: Mapping[str, Shaped]) -> dict[str, tuple[int, ...]]:
    """Shapes of nodal fields or of datasets, sorted by name."""
    return {name: fields[name].shape for name in sorted(fields)}


def read_step(group: h5py.Group, file: str, path: str) -> StoredStep:
    """A step as a group of an HDF5 file has it; the file is named relative to the folder of results.

    Raises:
        ForeignDataError: One of its fields is not in this file.
    """
    fields = {name: inside(group, name) for name in group}
    return StoredStep(
        file, path, Row(json.loads(group.attrs[ROW])), json.loads(group.attrs[RESTART]), shapes_of(fields)
    )


# ----------------------------------------------------------------------------------------------------------------------
# VTKHDF of a run: the group that ParaView and VTK read, made of references to what is stored already.
#
# https://docs.vtk.org/en/latest/vtk_file_formats/vtkhdf_file_format/ : an unstructured grid with steps. The grid is there once;
# a nodal field is one array over all steps, which here is a virtual dataset: HDF5 reads it piece by piece from where each step
# lies, in this file or another beside it. Nothing is stored twice, and the light file can be replaced whole after each step.


VERSION = (2, 2)
GROUP = "VTKHDF"
SAME_FILE = "."
"""HDF5's name of the file that a reference stands in."""
CELL_TYPES = {"Triangle_6": 22, "Tetrahedron_10": 24}
"""VTK's numbers of the cells, by XDMF's names."""
Shapes = tuple[int, tuple[int, ...], str]
"""Number of points, shape of the cells (c, k), and XDMF's name of them."""


def write_vtkhdf(file: h5py.File, heavy: str, shapes: Shapes, stored: Sequence[StoredStep]) -> None:
    """Add the group to an HDF5 file.

    Args:
        file: Where to.
        heavy: The file with the grid, relative to this one's folder, or `HERE`. Steps whose file it is are `HERE` then too.
        shapes: Of the grid.
        stored: Where each step's fields are.
    """
    points, (cells, corners), cell_name = shapes
    group = file.create_group(GROUP)
    group.attrs["Version"] = np.array(VERSION)
    group.attrs.create("Type", np.bytes_("UnstructuredGrid"))
    sizes = {"NumberOfPoints": points, "NumberOfCells": cells, "NumberOfConnectivityIds": cells * corners}
    for name, size in sizes.items():
        _put(group, name, np.array([size]))
    group["Points"] = file["mesh/points"] if heavy == SAME_FILE else h5py.ExternalLink(heavy, "/mesh/points")
    _flat(group, "Connectivity", heavy, "/mesh/cells", (cells, corners))
    small = {"compression": "gzip", "shuffle": True}
    group.create_dataset("Offsets", data=np.arange(cells + 1) * corners, **small)
    group.create_dataset("Types", data=np.full(cells, CELL_TYPES[cell_name], dtype=np.uint8), **small)
    steps = group.create_group("Steps")
    steps.attrs["NSteps"] = len(stored)
    _put(steps, "Values", np.array([step.row["step"] for step in stored], dtype=float))
    none = np.zeros(len(stored), dtype=np.int64)
    _put(steps, "NumberOfParts", none + 1)
    for name in ("PartOffsets", "PointOffsets"):
        _put(steps, name, none)  # always the same grid
    for name in ("CellOffsets", "ConnectivityIdOffsets"):
        _put(steps, name, none[:, None])
    data, offsets = group.create_group("PointData"), steps.create_group("PointDataOffsets")
    names = {name: shape for step in stored for name, shape in step.shapes.items()}
    for name in sorted(names):
        _put(offsets, name, _over_steps(data, name, names[name], stored, heavy))


def _over_steps(
    group: h5py.Group, name: str, shape: tuple[int, ...], stored: Sequence[StoredStep], heavy: str
) -> np.ndarray:
    """Add a field over all steps; steps without it have zeros, which nothing stores. Where each step's values begin."""
    having = [step for step in stored if name in step.shapes]
    points = shape[0]
    blocks = len(having) + (len(having) < len(stored))
    size = (blocks * points, *shape[1:])
    properties = _unstamped()
    properties.set_fill_value(np.zeros(1))
    part, source, rest = h5py.h5s.create_simple(size), h5py.h5s.create_simple(shape), (0,) * (len(shape) - 1)
    for block, step in enumerate(having):
        part.select_hyperslab((block * points, *rest), shape)
        properties.set_virtual(
            part, (SAME_FILE if heavy == SAME_FILE else step.file).encode(), f"{step.group}/{name}".encode(), source
        )
    h5py.h5d.create(group.id, name.encode(), h5py.h5t.NATIVE_DOUBLE, h5py.h5s.create_simple(size), properties)
    place_of = {id(step): block for block, step in enumerate(having)}
    return np.array([place_of.get(id(step), len(having)) * points for step in stored], dtype=np.int64)


def _put(group: h5py.Group, name: str, values: npt.NDArray[np.int64 | np.float64]) -> None:
    """Store a small array of 64-bit numbers; a third of the time that h5py's own assignment takes, after each step anew."""
    kind = h5py.h5t.NATIVE_DOUBLE if values.dtype.kind == "f" else h5py.h5t.NATIVE_INT64
    made = h5py.h5d.create(group.id, name.encode(), kind, h5py.h5s.create_simple(values.shape), _unstamped())
    made.write(h5py.h5s.ALL, h5py.h5s.ALL, np.ascontiguousarray(values))


def _unstamped() -> h5py.h5p.PropDCID:
    """Properties of a dataset without the time it was made at: the same run writes the same bytes."""
    properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    properties.set_obj_track_times(False)
    return properties


def _flat(group: h5py.Group, name: str, file: str, path: str, shape: tuple[int, int]) -> None:
    """A one-dimensional virtual dataset over a whole two-dimensional one of 64-bit integers."""
    flat = h5py.h5s.create_simple((shape[0] * shape[1],))
    properties = _unstamped()
    properties.set_virtual(flat, file.encode(), path.encode(), h5py.h5s.create_simple(shape))
    h5py.h5d.create(group.id, name.encode(), h5py.h5t.NATIVE_INT64, flat, properties)


def link_vtkhdf(file: h5py.File, heavy: str) -> None:
    """The light file of a run that is gathered: its group is in the file with the grid and all steps."""
    file[GROUP] = h5py.ExternalLink(heavy, f"/{GROUP}")


# ----------------------------------------------------------------------------------------------------------------------
# The light file that tells ParaView where the fields of every step are.
#
# It spells out topology, geometry and all fields in every time step: VTK's reader crashes on the ``xi:include`` that DOLFINx
# would write, and ParaView would show each field on a grid of its own.


STEPS_MARK = "\ue000"
"""Where the steps go in the frame around them: a character for private use, which stands in no name."""


def xdmf(name: str, heavy: str, shapes: tuple[int, tuple[int, ...], str], stored: Sequence[StoredStep]) -> bytes:
    """The XDMF of a folder of results.

    Args:
        name: Stem of the result files.
        heavy: The HDF5 file with the grid.
        shapes: Number of points, shape of the cells, and XDMF's name of them.
        stored: Where each step's fields are.
    """
    root = ElementTree.Element("Xdmf", Version="3.0")
    domain = ElementTree.SubElement(root, "Domain")
    series = ElementTree.SubElement(domain, "Grid", Name=name, GridType="Collection", CollectionType="Temporal")
    series.text = STEPS_MARK
    ElementTree.indent(root)
    frame = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    steps = [
        _grid(name, heavy, shapes, str(step.row["step"]), f"{step.file}:{step.group}", tuple(step.shapes.items()))
        for step in stored
    ]
    return frame.replace(STEPS_MARK.encode(), "".join([*steps, "\n    "]).encode())


@functools.lru_cache(maxsize=4096)  # the file is written after each step, and the steps before have not changed
def _grid(
    name: str,
    heavy: str,
    shapes: tuple[int, tuple[int, ...], str],
    number: str,
    place: str,
    fields: tuple[tuple[str, tuple[int, ...]], ...],
) -> str:
    """One step's part of the file."""
    points, cells, cell_name = shapes
    grid = ElementTree.Element("Grid", Name=name, GridType="Uniform")
    ElementTree.SubElement(grid, "Time", Value=number)
    topology = ElementTree.SubElement(grid, "Topology", TopologyType=cell_name, NumberOfElements=str(cells[0]))
    _item(topology, cells, f"{heavy}:/mesh/cells", "Int", "8")
    _item(ElementTree.SubElement(grid, "Geometry", GeometryType="XYZ"), (points, 3), f"{heavy}:/mesh/points")
    for field, shape in fields:
        kind = "Scalar" if len(shape) == 1 else "Vector"
        attribute = ElementTree.SubElement(grid, "Attribute", Name=field, AttributeType=kind, Center="Node")
        _item(attribute, shape, f"{place}/{field}")
    ElementTree.indent(grid, level=3)
    return f"\n{3 * '  '}{ElementTree.tostring(grid, encoding='unicode')}"


def _item(
    parent: ElementTree.Element, shape: tuple[int, ...], place: str, number: str = "Float", precision: str = "8"
) -> None:
    item = ElementTree.SubElement(
        parent, "DataItem", Dimensions=" ".join(map(str, shape)), NumberType=number, Precision=precision, Format="HDF"
    )
    item.text = place


# ----------------------------------------------------------------------------------------------------------------------
# The files of a folder of results beside the steps' own: the light ones, and the one HDF5 file of a run that has ended.


def write_light(heavy: Path, shapes: Shapes, stored: Sequence[StoredStep], gathered: bool) -> None:
    """Write ``path.csv``, the XDMF and the light VTKHDF of a run; each is replaced whole.

    Args:
        heavy: The HDF5 file with the grid.
        shapes: Of the grid.
        stored: Where each step's fields are.
        gathered: Whether they are all in that file.
    """
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, fieldnames=list(stored[0].row), lineterminator="\n")
    writer.writeheader()
    writer.writerows(step.row.cells for step in stored)
    replace(heavy.with_name("path.csv"), lambda path: path.write_text(text.getvalue()))
    light = xdmf(heavy.stem, heavy.name, shapes, stored)
    replace(heavy.with_suffix(".xdmf"), lambda path: path.write_bytes(light))

    def fill(file: h5py.File) -> None:
        if gathered:
            link_vtkhdf(file, heavy.name)
        else:
            write_vtkhdf(file, heavy.name, shapes, stored)

    replace_hdf5(heavy.with_suffix(".vtkhdf"), fill)


def write_gathered(
    path: Path, heavy: Path, shapes: Shapes, stored: Sequence[StoredStep], gathered: Sequence[StoredStep]
) -> None:
    """Write all steps into one HDF5 file with the grid.

    Args:
        path: Where to.
        heavy: The file with the grid as it is.
        shapes: Of the grid.
        stored: Where each step's fields are.
        gathered: Where they will be.
    """
    with h5py.File(path, "w") as file:
        with opened(heavy) as old:
            old.copy("mesh", file)
            file.attrs["format"] = old.attrs.get("format", 0)
        for step, place in zip(stored, gathered, strict=True):
            with opened(heavy.parent / step.file) as source:
                group = file.create_group(place.group)
                part = source[step.group] if step.group else source
                for name in part:
                    part.copy(name, group)
                for key, value in part.attrs.items():
                    group.attrs[key] = value
        write_vtkhdf(file, SAME_FILE, shapes, gathered)


# ----------------------------------------------------------------------------------------------------------------------
# Names of what is drawn of a run, and the record of it in a folder of results.


PICTURES = (
    "profile",
    "mesh",
    "slice",
    "mode",
    "undeformed",
    "cut",
    "hot-spots",
    "stress",
    *(f"stress-{k}" for k in range(1, 5)),
)
"""Stems of the pictures drawn beside the one that has the gauge's name."""
PAGES = ("film.gif", "film.webp", "film.mp4", "report.html")


def picture_files(gauge: str) -> list[str]:
    """Names of all that is drawn of a run: pictures, film and report."""
    return [*(f"{picture}.png" for picture in (*PICTURES, gauge)), *PAGES]


def picture_folder(folder: Path) -> OwnFolder:
    """The pictures in a folder of results: a record beside the run's, for they are also drawn while the run goes on."""
    return OwnFolder(folder, "pictures", part="pictures")


FORMAT = 5
"""Of the stored steps, in the HDF5 file's attribute ``format``. An older one is read and not gone on with."""
INPUTS = "files/"
"""The folder inside for copies of what a case is made from, such as a part's mesh."""
RUN, BRANCH = "run", "branch/"
"""What a folder's record calls a run; the folder inside for a branch that leaves its path."""


class ResultsError(Spoken, RuntimeError):
    """Results that cannot be read or continued; the message is a sentence for the user."""


class Results:
    """Results of one run.

    Args:
        folder: Where to write; made if missing.
        name: Stem of the files, such as ``"disk"``.
        gauge: The device's `Actuator.gauge`, which names the picture of its rise.
        kind: What the folder's record calls them.

    Attributes:
        own: The folder, and what in it is the run's own.
        folder: Where the files are: in ``own``, or aside of the earlier results until the first step is there.
    """

    def __init__(self, folder: Path, name: str, gauge: str = "apex", kind: str = RUN):
        self.own = OwnFolder(folder, kind)
        self.folder, self.name, self.gauge = folder, name, gauge
        self.stored: list[StoredStep] = []
        self._about: dict[str, object] = {}
        self._renewal = ""

    @property
    def heavy(self) -> Path:
        return self.folder / f"{self.name}.h5"

    @property
    def steps(self) -> Path:
        return self.folder / f"{self.name}.steps"

    @property
    def rows(self) -> list[Row]:
        return [step.row for step in self.stored]

    def branch(self) -> Results:
        """Results of the branch that leaves this path, in a folder of their own; there may be none."""
        return Results(self.own.path / BRANCH.strip("/"), self.name, self.gauge, "branch")

    def write_sources(self, sources: SourceRows) -> None:
        """Write the paths of the silicone's other sources beside the run's own; none where there are none."""
        if sources:
            self.own.claim([SOURCES])
            write_sources(self.folder, sources)

    def sources(self, case: Case) -> dict[str, Sequence[Row]]:
        """Rows of each source of the silicone, the run's own among them; empty where no others were solved."""
        return in_order(case, self.rows, read_sources(self.folder) if isinstance(case.band, SourceBand) else {})

    @property
    def files(self) -> list[str]:
        """Names of what a run writes, pictures aside."""
        name = self.name
        return [
            "case.toml",
            f"{name}.h5",
            f"{name}.xdmf",
            f"{name}.vtkhdf",
            "path.csv",
            SOURCES,
            "summary.json",
            f"{name}.msh",
            f"{name}.steps/",
            INPUTS,
        ]

    @staticmethod
    def inputs_of(files: Iterable[str]) -> dict[str, str]:
        """Where copies of a case's own files lie, from the folder: by the file, each under a name of its own."""
        names: dict[str, str] = {}
        for file in files:
            stem, end, number = Path(file).stem, Path(file).suffix, 1
            while (name := f"{INPUTS}{stem}{'' if number == 1 else f'-{number}'}{end}") in names.values():
                number += 1
            names[file] = name
        return names

    def prepare(self, about: Mapping[str, object]) -> None:
        """Begin new results aside of the earlier ones, which stay until the first step is stored.

        Args:
            about: What to record of them.

        Raises:
            OwnFolderError: Somebody else's file has a name that a run writes.
            OSError: The folder cannot be written.
        """
        self.own.check_names([*self.files, BRANCH])
        self._about = dict(about)
        self.folder = self.own.prepare()

    def renew(self, case: str, about: Mapping[str, object]) -> None:
        """Write another case file with the next state, of a run that is gone on with to further values."""
        self._renewal, self._about = case, dict(about)

    def record(self, **about: object) -> None:
        """Record more of these results: at once, or with the first state."""
        self._about |= about
        if self.folder == self.own.path:
            self.own.claim([], about)

    def _bring_in(self) -> None:
        """Put the prepared results in the place of the earlier ones, whose pictures go too."""
        pictures = picture_folder(self.own.path)
        pictures.take(PATIENCE)  # they may be being drawn
        try:
            self.own.bring_in(self._about)
            self.folder = self.own.path
            pictures.remove(pictures.files)
        finally:
            pictures.leave()

    def clear(self) -> None:
        """Make the folder and take away what an earlier run left in it, at once.

        Raises:
            OwnFolderError: The folder is not a run's, or somebody else's file has a name that a run writes.
        """
        self.own.check()
        self.own.path.mkdir(parents=True, exist_ok=True)
        self.own.remove(self.own.files)
        self.own.claim(self.files)

    def begin(self, points: npt.NDArray[np.float64], cells: npt.NDArray[np.int64], cell_name: str) -> None:
        """Store the grid: points (n, 3) in m, cells (c, k) of an XDMF cell type."""
        self.folder.mkdir(parents=True, exist_ok=True)

        def fill(file: h5py.File) -> None:
            file["mesh/points"], file["mesh/cells"] = points, cells
            file["mesh"].attrs["cell_name"] = cell_name
            file.attrs["format"] = FORMAT

        replace_hdf5(self.heavy, fill)
        self._shapes = (len(points), cells.shape, cell_name)

    def check_grid(self, points: npt.NDArray[np.float64]) -> None:
        """Refuse to go on where the device is not meshed as it was.

        Args:
            points: Nodes of the mesh, shape (n, 3), m.

        Raises:
            ResultsError: The stored states lie on other nodes.
        """
        with opened(self.heavy) as file:
            stored = np.asarray(read_values(file, "mesh/points"))
        if stored.shape != points.shape or not np.allclose(stored, points, rtol=0.0, atol=1e-9 * np.abs(stored).max()):
            raise ResultsError(
                f"the states in {self.folder} are of another mesh ({len(stored)} nodes there, {len(points)} here), as another "
                "version of Gmsh would make; run without --resume"
            )

    def load(self, go_on: bool = False) -> None:
        """Take up what an earlier run left, for going on with it or for drawing.

        Args:
            go_on: Whether it is to be gone on with, which needs a run of this version.

        Raises:
            ResultsError: There is nothing, or it cannot be read, or another version wrote it.
        """
        if not self.heavy.exists():
            raise ResultsError(f"{self.folder} holds no {self.heavy.name}, so there is nothing to go on from")
        if self.steps.is_symlink():
            raise ResultsError(f"{self.steps} is a link, and the steps of a run are in its own folder; remove it")
        found: dict[int, StoredStep] = {}
        try:
            with opened(self.heavy) as file:
                self._check_format(int(file.attrs.get("format", 0)), go_on)
                points, cells = inside(file, "mesh/points").shape, inside(file, "mesh/cells").shape
                self._shapes = (points[0], cells, str(inside(file, "mesh").attrs["cell_name"]))
                for group in inside(file, "steps") if "steps" in file else ():
                    found[int(group)] = read_step(inside(file, f"steps/{group}"), self.heavy.name, f"/steps/{group}")
            for path in sorted(self.steps.glob("*.h5")):
                with opened(path) as file:
                    found[int(path.stem)] = read_step(file, f"{self.steps.name}/{path.name}", "")
        except (OSError, KeyError, ValueError, TypeError, AttributeError, RuntimeError) as error:
            if isinstance(error, ResultsError):
                raise
            raise ResultsError(f"the results in {self.folder} cannot be read ({hdf5_reason(error)})") from error
        self.stored = [found[step] for step in sorted(found)]

    def _check_format(self, found: int, go_on: bool) -> None:
        if found > FORMAT:
            raise ResultsError(
                f"{self.folder} was written by a later version of softmodels (its results have format {found}, this version "
                f"reads up to {FORMAT}); update softmodels"
            )
        if go_on and found < FORMAT:
            raise ResultsError(
                f"{self.folder} was written by an earlier version of softmodels (its results have format {found}, this version "
                f"goes on with {FORMAT}); run without --resume into another folder (--output), or draw it as it is "
                f"(softmodels draw {self.folder})"
            )

    def add(self, row: Row, fields: Mapping[str, npt.NDArray[np.float64]], restart: Restart) -> None:
        """Store one step: its row of ``path.csv``, nodal fields (n,) or (n, 3), and what a restart needs."""
        number = len(self.stored)
        self.steps.mkdir(exist_ok=True)

        def fill(file: h5py.File) -> None:
            for name, values in fields.items():
                file[name] = values
            file.attrs[ROW], file.attrs[RESTART] = json.dumps(row.cells), json.dumps(restart)

        path = self.steps / f"{number:04d}.h5"
        replace_hdf5(path, fill)
        self.stored.append(StoredStep(f"{self.steps.name}/{path.name}", "", row, restart.copy(), shapes_of(fields)))
        self.write_light()
        if self.folder != self.own.path:
            self._bring_in()
        elif self._renewal:
            write_text(self.folder / "case.toml", self._renewal)
            self.own.claim(["case.toml"], self._about)
            self._renewal = ""

    def fields(self, step: int, names: tuple[str, ...]) -> dict[str, npt.NDArray[np.float64]]:
        """Nodal fields of a stored step."""
        if not (self.folder / self.stored[step].file).exists():
            self.load()  # the run that wrote it has gathered its steps meanwhile
        stored = self.stored[step]
        with opened(self.folder / stored.file) as file:
            return {name: np.asarray(read_values(file, f"{stored.group}/{name}")) for name in names}

    def finish(self) -> None:
        """Gather all steps into the one HDF5 file. At no moment is a step readable nowhere.

        Raises:
            OSError: There is no room for it; all steps stay where they are.
        """

        size = sum(
            (self.folder / file).stat().st_size for file in {self.heavy.name, *(stored.file for stored in self.stored)}
        )
        # Asked beforehand, because HDF5 takes a full disk badly: see `replace_hdf5`. All at once may not fit in memory.
        if shutil.disk_usage(self.folder).free < size:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        gathered = [
            dataclasses.replace(stored, file=self.heavy.name, group=f"/steps/{number:04d}")
            for number, stored in enumerate(self.stored)
        ]

        try:
            replace(self.heavy, lambda path: write_gathered(path, self.heavy, self._shapes, self.stored, gathered))
        except (OSError, RuntimeError) as error:
            raise OSError(errno.EIO, hdf5_reason(error)) from error
        self.stored = gathered
        self.write_light(gathered=True)
        remove_steps(self.steps)

    def write_light(self, gathered: bool = False) -> None:
        """Write ``path.csv``, the XDMF and the light VTKHDF anew; ``gathered`` is whether the HDF5 file has all steps."""

        write_light(self.heavy, self._shapes, self.stored, gathered)
