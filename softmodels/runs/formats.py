"""Formats of a run's files: steps in HDF5, read with care, and what else refers to them: VTKHDF, XDMF and CSV.

All is written as references to where each step lies, so that nothing is stored twice.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import os
import zlib
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any, Protocol

import h5py
import numpy as np
import numpy.typing as npt

from softmodels.common import files
from softmodels.common.arrays import Array
from softmodels.path import stability
from softmodels.runs import table

# ----------------------------------------------------------------------------------------------------------------------
# Restart data of a state, besides its fields.


type Restart = dict[str, Any]
"""Data to rebuild a `Point` besides its fields: P, V and their changes along the path (``tangent``), dimensionless, the
``signature``, and what `POINT_FIELDS` names."""
POINT_FIELDS = ("requested", "limit", "jump", "turn", "step", "line", "stiffest")


def restart_of(point: stability.Point) -> Restart:
    """Return the restart data of a point's step."""
    plain = {name: getattr(point, name) for name in POINT_FIELDS}
    tangent, signature = [point.tangent.P, point.tangent.V], dataclasses.asdict(point.signature)
    return {"P": point.state.P, "V": point.state.V, **plain, "tangent": tangent, "signature": signature}


@dataclasses.dataclass(frozen=True, eq=False)
class StateRecord:
    """What is stored of a state: its row of the table, on all ranks, nodal fields by name in SI units, shape (n,), (n, 3) or
    (n, 3, 3), with the ``mode`` at a bifurcation, on rank 0, and its restart data."""

    row: table.Row
    fields: Mapping[str, Array]
    restart: Restart


# ----------------------------------------------------------------------------------------------------------------------
# Read the HDF5 files of a results folder, which may be from an untrusted source.
#
# HDF5 takes values from other files where a dataset is stored outside (external storage), is put together from others (virtual)
# or is behind a link. Results never use these, so they are rejected: they would expose the bytes of other files.


MAX_FILE_SIZE = 1 << 50
"""Size limit of a results file: none."""
NUMBER_KINDS = "fiu"
"""Kinds of numpy's types that fields have."""


class ForeignDataError(ValueError):
    """A results file refers to other files; the message continues the file's name."""


@contextlib.contextmanager
def opened(path: Path) -> Iterator[h5py.File]:
    """Open a results file for reading; `OSError` if it is not a regular file, or not HDF5."""
    files.check_file(path, MAX_FILE_SIZE)
    with h5py.File(path, "r") as file:
        yield file


def inside(group: h5py.Group, path: str) -> Any:
    """Return a group, or a dataset of numbers stored in this file, at a path in a group; `KeyError` if there is nothing,
    `ForeignDataError` if it refers to another file."""
    place = group
    for name in filter(None, path.split("/")):
        if not isinstance(place, h5py.Group):
            raise KeyError(f"no {path}")
        if not isinstance(link := place.get(name, getlink=True), h5py.HardLink):
            raise (KeyError(f"no {path}") if link is None else ForeignDataError(f"{path} is a link; links are not followed"))
        place = place[name]
    if isinstance(place, h5py.Dataset):
        if place.external is not None or place.is_virtual:
            raise ForeignDataError(f"{path} takes its values from other files; these are not read")
        if place.dtype.kind not in NUMBER_KINDS or place.size * place.dtype.itemsize > place.id.get_storage_size():
            raise ForeignDataError(
                f"{path} is compressed, or holds fewer numbers than declared; results are stored uncompressed"
            )
    return place


def read_values(group: h5py.Group, path: str) -> npt.NDArray[np.generic]:
    """Return the numbers of a dataset; see `inside`."""
    return inside(group, path)[()]  # type: ignore[no-any-return]


# ----------------------------------------------------------------------------------------------------------------------
# Location of a run's step on disk.


ROW, RESTART = "row", "restart"
"""Attributes of a step: its row of ``path.csv``, and what a restart needs beside its fields."""


@dataclasses.dataclass(frozen=True)
class StoredStep:
    """Location of a step's fields, a group of an HDF5 file relative to the folder of results, its row of the table, what a
    `Point` needs to be made again beside its fields, and these fields' shapes by name, (n,), (n, 3) or (n, 9) of tensors."""

    file: str
    group: str
    row: table.Row
    restart: Restart
    shapes: Mapping[str, tuple[int, ...]]


class Shaped(Protocol):
    """An array, or a dataset of a file."""

    @property
    def shape(self) -> tuple[int, ...]: ...


def shapes_of(fields: Mapping[str, Shaped]) -> dict[str, tuple[int, ...]]:
    """Shapes of nodal fields or of datasets, sorted by name."""
    return {name: fields[name].shape for name in sorted(fields)}


def read_step(group: h5py.Group, file: str, path: str, cm: float | None) -> StoredStep:
    """Return a step from its group of an HDF5 file, named relative to the folder of results, ``cm`` as `table.Row` has it;
    `ForeignDataError` if a field is not in it."""
    fields, row = {name: inside(group, name) for name in group}, table.Row(files.parse_json(group.attrs[ROW]), cm)
    return StoredStep(file, path, row, files.parse_json(group.attrs[RESTART]), shapes_of(fields))


# ----------------------------------------------------------------------------------------------------------------------
# VTKHDF of a run: the group read by ParaView and VTK, made of references to the stored data.
#
# https://docs.vtk.org/en/latest/vtk_file_formats/vtkhdf_file_format/ : an unstructured grid with steps. The grid is there once;
# a nodal field is one array over all steps, which here is a virtual dataset: HDF5 reads it piece by piece from where each step
# lies, in this file or another beside it. Nothing is stored twice, and the light file can be replaced whole after each step.
# Once a run is gathered, the group is in the HDF5 file with all data, and the .vtkhdf is a second name of that file, so that it
# can be given away by itself.


FORMAT_VERSION = (2, 2)
GROUP = "VTKHDF"
TENSOR_COMPONENTS = 9
"""Components of a tensor in files, row by row: XX, XY, XZ, YX and so on, as VTK and XDMF have them."""
SAME_FILE = "."
"""HDF5's name of the file that a reference stands in."""
CELL_TYPES = {"Triangle_6": 22, "Tetrahedron_10": 24}
"""VTK's numbers of the cells, by XDMF's names."""
Shapes = tuple[int, tuple[int, ...], str]
"""Number of points, shape of the cells (c, k), and XDMF's name of them."""


def write_vtkhdf(file: h5py.File, heavy: str, shapes: Shapes, stored: Sequence[StoredStep]) -> None:
    """Add the group to an HDF5 file, with the shapes of the grid. ``heavy`` is the file with the grid, relative to this one's
    folder, or `SAME_FILE`; steps whose file it is are `SAME_FILE` then too."""
    points, (cells, corners), cell_name = shapes
    group = file.create_group(GROUP)
    group.attrs["Version"] = np.array(FORMAT_VERSION)
    group.attrs.create("Type", np.bytes_("UnstructuredGrid"))
    sizes = {"NumberOfPoints": points, "NumberOfCells": cells, "NumberOfConnectivityIds": cells * corners}
    for name, size in sizes.items():
        _put(group, name, np.array([size]))
    group["Points"] = file["mesh/points"] if heavy == SAME_FILE else h5py.ExternalLink(heavy, "/mesh/points")
    _flat(group, "Connectivity", heavy, "/mesh/cells", (cells, corners))
    offsets = group.create_dataset("Offsets", (cells + 1,), np.int64, chunks=(cells + 1,), compression="gzip", shuffle=True)
    offsets.id.write_direct_chunk((0,), _multiples(corners, cells + 1))
    # The type of all cells is the value of what was not stored.
    group.create_dataset("Types", (cells,), np.uint8, fillvalue=CELL_TYPES[cell_name])
    steps = group.create_group("Steps")
    steps.attrs["NSteps"] = len(stored)
    _put(steps, "Values", np.array(times_of(stored)))
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


def _over_steps(group: h5py.Group, name: str, shape: tuple[int, ...], stored: Sequence[StoredStep], heavy: str) -> np.ndarray:
    """Add a field over all steps, with unstored zeros for steps without it; return where each step's values begin."""
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


@functools.lru_cache(maxsize=4)  # the file is rewritten after each step
def _multiples(factor: int, count: int) -> bytes:
    """Return the first multiples of a number as 64-bit integers, shuffled and compressed as HDF5's filters do."""
    values = factor * np.arange(count, dtype="<i8")
    return zlib.compress(np.ascontiguousarray(values.view(np.uint8).reshape(count, 8).T).tobytes(), 4)


def _put(group: h5py.Group, name: str, values: npt.NDArray[np.int64 | np.float64]) -> None:
    """Store a small array of 64-bit numbers; a third of the time that h5py's own assignment takes, after each step anew."""
    kind = h5py.h5t.NATIVE_DOUBLE if values.dtype.kind == "f" else h5py.h5t.NATIVE_INT64
    made = h5py.h5d.create(group.id, name.encode(), kind, h5py.h5s.create_simple(values.shape), _unstamped())
    made.write(h5py.h5s.ALL, h5py.h5s.ALL, np.ascontiguousarray(values))


def _unstamped() -> h5py.h5p.PropDCID:
    """Return the properties of a dataset without the time it was made at: the same run writes the same bytes."""
    properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    properties.set_obj_track_times(False)
    return properties


def _flat(group: h5py.Group, name: str, file: str, path: str, shape: tuple[int, int]) -> None:
    """A one-dimensional virtual dataset over a whole two-dimensional one of 64-bit integers."""
    flat = h5py.h5s.create_simple((shape[0] * shape[1],))
    properties = _unstamped()
    properties.set_virtual(flat, file.encode(), path.encode(), h5py.h5s.create_simple(shape))
    h5py.h5d.create(group.id, name.encode(), h5py.h5t.NATIVE_INT64, flat, properties)


TIMES = ("time_s", "pressure_cm", "added_volume_ml")
"""Columns of ``path.csv`` that may be the time of steps: the first one that changes in one direction."""


def times_of(stored: Sequence[StoredStep]) -> list[float]:
    """Return the time of each step in ParaView and VTK, where it has to rise: that in s, the pressure in cm of the column or
    the added volume in ml, of a vacuum its size; the number of the step where the path turns in all of them."""
    for column in TIMES:
        values = np.abs(np.array([step.row.cells.get(column) for step in stored], dtype=float))
        if (np.diff(values) > 0.0).all() and np.isfinite(values).all():
            return values.tolist()
    return [step.row["step"] for step in stored]


def link_vtkhdf(file: Path, heavy: Path) -> None:
    """Make the VTKHDF of a gathered run a second name of the file with the grid and all steps; a reference to it on disks that
    have no second names."""
    try:
        files.replace(file, lambda aside: os.link(heavy, aside))
    except OSError:
        files.replace_hdf5(file, lambda light: light.__setitem__(GROUP, h5py.ExternalLink(heavy.name, f"/{GROUP}")))


# ----------------------------------------------------------------------------------------------------------------------
# XDMF file that gives ParaView the locations of the fields of every step.
#
# It spells out topology, geometry and all fields in every time step: VTK's reader crashes on the ``xi:include`` that DOLFINx
# would write, and ParaView would show each field on a grid of its own.


def xdmf(name: str, heavy: str, shapes: Shapes, stored: Sequence[StoredStep]) -> bytes:
    """Return the XDMF of a folder of results: the stem of its files, the HDF5 file with the grid, the grid's shapes, and where
    each step's fields are."""
    steps = [
        _grid(name, heavy, shapes, f"{time:.12g}", f"{step.file}:{step.group}", tuple(step.shapes.items()))
        for step, time in zip(stored, times_of(stored), strict=True)
    ]
    series = f'<Grid Name="{escape(name)}" GridType="Collection" CollectionType="Temporal">'
    lines = ["<?xml version='1.0' encoding='utf-8'?>", '<Xdmf Version="3.0">', "  <Domain>", f"    {series}", *steps]
    return "\n".join([*lines, "    </Grid>", "  </Domain>", "</Xdmf>"]).encode()


@functools.lru_cache(maxsize=4096)  # the file is rewritten after each step, and earlier steps have not changed
def _grid(
    name: str, heavy: str, shapes: Shapes, number: str, place: str, fields: tuple[tuple[str, tuple[int, ...]], ...]
) -> str:
    """Return one step's part of the file."""
    points, cells, cell_name = shapes

    def part(kind: str, attributes: str, shape: tuple[int, ...], path: str, number: str = "Float") -> str:
        item = f'DataItem Dimensions="{" ".join(map(str, shape))}" NumberType="{number}" Precision="8" Format="HDF"'
        return f"        <{kind} {attributes}>\n          <{item}>{escape(path)}</DataItem>\n        </{kind}>"

    topology = f'TopologyType="{cell_name}" NumberOfElements="{cells[0]}"'
    parts = [
        part("Topology", topology, cells, f"{heavy}:/mesh/cells", "Int"),
        part("Geometry", 'GeometryType="XYZ"', (points, 3), f"{heavy}:/mesh/points"),
    ]
    for field, shape in fields:
        kind = "Scalar" if len(shape) == 1 else "Tensor" if shape[1] == TENSOR_COMPONENTS else "Vector"
        attributes = f'Name="{escape(field)}" AttributeType="{kind}" Center="Node"'
        parts.append(part("Attribute", attributes, shape, f"{place}/{field}"))
    head = f'      <Grid Name="{escape(name)}" GridType="Uniform">\n        <Time Value="{number}" />'
    return "\n".join([head, *parts, "      </Grid>"])


# ----------------------------------------------------------------------------------------------------------------------
# The files of a results folder besides those of the steps: the light files, and the HDF5 file of a finished run.


def write_light(heavy: Path, shapes: Shapes, stored: Sequence[StoredStep], gathered: bool) -> None:
    """Write ``path.csv``, the XDMF and the light VTKHDF of a run, each replaced whole; ``heavy`` has the grid, and if
    ``gathered`` all steps' fields."""
    files.write_text(heavy.with_name("path.csv"), table.PathTable(step.row for step in stored).csv())
    light = xdmf(heavy.stem, heavy.name, shapes, stored)
    files.replace(heavy.with_suffix(".xdmf"), lambda path: path.write_bytes(light))

    light_hdf5 = heavy.with_suffix(".vtkhdf")
    if gathered:
        link_vtkhdf(light_hdf5, heavy)
    else:
        files.replace_hdf5(light_hdf5, lambda file: write_vtkhdf(file, heavy.name, shapes, stored))


def write_gathered(
    path: Path, heavy: Path, shapes: Shapes, stored: Sequence[StoredStep], gathered: Sequence[StoredStep]
) -> None:
    """Write all steps into one HDF5 file with the grid of the uncompressed ``heavy``; their fields are where ``stored`` says,
    and come to where ``gathered`` says."""
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
