"""VTKHDF of a run: the group that ParaView and VTK read, made of references to what is stored already.

https://docs.vtk.org/en/latest/vtk_file_formats/vtkhdf_file_format/ : an unstructured grid with steps. The grid is there once;
a nodal field is one array over all steps, which here is a virtual dataset: HDF5 reads it piece by piece from where each step
lies, in this file or another beside it. Nothing is stored twice, and the light file can be replaced whole after each step.
"""

from __future__ import annotations

from collections.abc import Sequence

import h5py
import numpy as np
import numpy.typing as npt

from softmodels.results.stored_step import StoredStep

VERSION = (2, 2)
GROUP = "VTKHDF"
HERE = "."
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
    group["Points"] = file["mesh/points"] if heavy == HERE else h5py.ExternalLink(heavy, "/mesh/points")
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
            part, (HERE if heavy == HERE else step.file).encode(), f"{step.group}/{name}".encode(), source
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
