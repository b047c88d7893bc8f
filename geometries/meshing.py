"""Gmsh from start to finish: a private model, one mesh, one complete file.

Only this module starts Gmsh, so the settings that make a mesh repeatable stand in one place.
"""

from __future__ import annotations

import contextlib
import dataclasses
import errno
import math
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from geometries import kept_meshes
from geometries.apart import apart
from geometries.errors import GeometryError, MeshingError
from geometries.hushed import hushed
from geometries.mesh_files import is_whole, load_mesh
from geometries.mirroring import mirror_mesh
from measurement.one_at_a_time import LOCK, one_at_a_time
from measurement.signal_handlers import handlers_kept

if TYPE_CHECKING:
    from geometries.actuator import Actuator

SETTINGS = {
    "General.Terminal": 0,
    # One thread and fixed algorithms: the same parameters give the same file on every run.
    "General.NumThreads": 1,
    "Mesh.MaxNumThreads1D": 1,
    "Mesh.MaxNumThreads2D": 1,
    "Mesh.MaxNumThreads3D": 1,
    "Mesh.Algorithm": 6,
    "Mesh.Algorithm3D": 1,
    # The device's own size function is the only source of cell sizes.
    "Mesh.MeshSizeExtendFromBoundary": 0,
    "Mesh.MeshSizeFromPoints": 0,
    "Mesh.MeshSizeFromCurvature": 0,
    "Mesh.MeshSizeMax": 1e22,
    "Mesh.SecondOrderLinear": 0,
    "Mesh.SecondOrderIncomplete": 0,
    "Mesh.MshFileVersion": 4.1,
    "Mesh.Binary": 0,
    "Mesh.SaveAll": 0,
    "Mesh.ScalingFactor": 1,
}
"""Gmsh options of every mesh, by name."""


DRAWN_IN = "Geometry.OCCTargetUnit"
"""Gmsh's option with the unit of a drawing's numbers; empty for the kernel's own, mm."""

LEAST_QUALITY = 0.05
"""Smallest quality (Gmsh's SICN) left alone; below it the mesher tries to improve the cells, at 0 it gives up."""

EDGES = ((0, 1), (1, 2), (2, 0), (3, 0), (2, 3), (1, 3))
"""Ends of the edges of a second-order triangle (the first three) or tetrahedron, in Gmsh's order of nodes."""

MOST_CELLS = 5_000_000
"""More than a machine of 100 GB solves for."""

QUICK = 10_000
"""Up to this many cells a device is meshed within a second or so, in this very process."""

ROUNDS = 10
"""How often straightened cells may spoil their neighbours before that is given up."""


@dataclasses.dataclass(frozen=True)
class MeshSummary:
    """What a mesh file holds.

    Attributes:
        cells: Number of tetrahedra (3-D) or triangles (axisymmetric).
        nodes: Number of nodes, those inside edges included.
        quality: Smallest scaled Jacobian-based quality (Gmsh's SICN) of all cells: 1 is regular, 0 or less is invalid.
        measure: Sum of the curved cells' volumes in m3 (3-D) or areas in m2 (axisymmetric).
    """

    cells: int
    nodes: int
    quality: float
    measure: float


@contextlib.contextmanager
def private_model() -> Iterator[None]:
    """Give a fresh, current Gmsh model; afterwards a caller's own Gmsh session is as it was."""

    with LOCK:
        yield from _fresh_model()


def _fresh_model() -> Iterator[None]:
    """See `private_model`, whose thread has its turn."""
    import gmsh

    ours = not gmsh.isInitialized()
    if ours:
        # Not interruptible: Gmsh would otherwise replace the signal handler, which only a main thread may do.
        with handlers_kept():
            gmsh.initialize(readConfigFiles=False, interruptible=False)
    previous = None if ours else gmsh.model.getCurrent()
    before, unit = {name: gmsh.option.getNumber(name) for name in SETTINGS}, gmsh.option.getString(DRAWN_IN)
    fresh = f"softmodels-{os.getpid()}-{id(before)}"
    try:
        for name, value in SETTINGS.items():
            gmsh.option.setNumber(name, value)
        gmsh.option.setString(DRAWN_IN, "")
        gmsh.model.add(fresh)
        yield
    finally:
        if ours:
            with handlers_kept():
                gmsh.finalize()
        else:
            gmsh.model.setCurrent(fresh)
            gmsh.model.remove()
            gmsh.model.setCurrent(previous)
            for name, value in before.items():
                gmsh.option.setNumber(name, value)
            gmsh.option.setString(DRAWN_IN, unit)


@one_at_a_time
def write_mesh(actuator: Actuator, path: Path, stopped: Callable[[], bool] = bool) -> Path:
    """Mesh a device into a file; see `Actuator.write`, which is the way to call this."""
    if path.suffix != ".msh":
        raise GeometryError(f"path is {str(path)!r}; the name of a mesh file must end in .msh")
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, "a folder, not a mesh file", str(path))
    partial = path.with_name(f".{path.stem}-{os.getpid()}.msh")
    # Made before the meshing starts, so that a folder that cannot be written is known within a moment.
    try:
        partial.touch()
    except OSError as error:
        raise OSError(error.errno, f"cannot write in this folder: {error.strerror}", str(path.parent)) from None
    try:
        kept = kept_meshes.take(actuator, partial) and is_whole(partial)
        if not kept:
            if actuator.expected_cells <= QUICK:
                _make(actuator, partial)
            else:
                apart(_make, actuator, partial, stopped=stopped)
        if not is_whole(partial):
            raise OSError(errno.ENOSPC, "the mesh file ended early; is the disk full?", str(path))
        if not kept:
            kept_meshes.keep(actuator, partial)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
    return path


def _make(actuator: Actuator, path: Path) -> None:
    """Mesh a device into a file with a private model of Gmsh's."""
    import gmsh

    with private_model():
        try:
            actuator.build()
            if not actuator.meshed:
                _generate(actuator)
            elif _worst(actuator.dimension) <= 0.0:
                raise MeshingError("the mesh has a cell turned inside out; mesh the part anew where it comes from")
            for mirror in actuator.mirrors:
                mirror_mesh(mirror)
            gmsh.write(str(path))
        except (GeometryError, MeshingError):
            raise
        except Exception as error:  # Gmsh raises bare Exception
            raise MeshingError(
                f"Gmsh could not mesh {type(actuator).__name__}: {str(error).strip() or 'no reason given'}; "
                f"try a larger fillet (or none) or another cell size"
            ) from error


def summarize(path: str | Path) -> MeshSummary:
    """Count a mesh file's cells and nodes.

    Args:
        path: A file made by `Actuator.write`.

    Raises:
        FileNotFoundError: No such file.
        MeshFileError: Not a complete mesh.
        MeshingError: The file holds no cells.
    """
    import gmsh

    with private_model():
        load_mesh(path)
        cells = _cells(gmsh.model.getDimension())
        if cells.size == 0:
            raise MeshingError(f"{path} holds no cells")
        quality = gmsh.model.mesh.getElementQualities(cells, "minSICN").min()
        measure = _measure(gmsh.model.getDimension())
        nodes = gmsh.model.mesh.getNodes()[0].size
    return MeshSummary(int(cells.size), int(nodes), float(quality), measure)


def _generate(actuator: Actuator) -> None:
    import gmsh

    if actuator.dimension == 3 and math.isinf(actuator.expected_cells):
        gmsh.model.mesh.generate(2)
        _check_cells()
    gmsh.model.mesh.generate(actuator.dimension)
    cells = _cells(actuator.dimension)
    if cells.size == 0:
        raise MeshingError("Gmsh made no cells inside the solid; try a larger fillet (or none) or another cell size")
    if actuator.dimension == 3:
        # Flat tetrahedra are reshaped while the edges are still straight; curving them would turn some inside out.
        with hushed(b"BFGS update error"):  # of Netgen's, at a cell so flat that one of its steps is left out
            gmsh.model.mesh.optimize("Netgen")
    gmsh.model.mesh.setOrder(actuator.mesh_order)
    if _worst(actuator.dimension) > LEAST_QUALITY:
        return
    # Curving an edge onto an arc bends a flat cell too far; moving the inner nodes usually mends it.
    with contextlib.suppress(
        Exception
    ):  # bare, and of no consequence: its solver gave up, and the cells are judged next
        gmsh.model.mesh.optimize("HighOrderElastic")
    if _worst(actuator.dimension) <= LEAST_QUALITY:
        _straighten(actuator.dimension)
    worst = _worst(actuator.dimension)
    if worst <= 0.0:
        raise MeshingError(
            f"The mesh has a cell turned inside out (smallest quality {worst:.2g}); "
            f"try a smaller cell size, more refinement or a larger fillet (or none)"
        )


def _check_cells() -> None:
    """Refuse a solid whose faces, meshed already, promise more cells than a machine solves for.

    Meshes that Gmsh makes of thin and of thick parts alike have within 1.5 times as many tetrahedra as this expects.
    """
    import gmsh

    kinds = gmsh.model.mesh.getElementTypes(2)
    if not len(kinds):
        return  # no solid will come of that, and it is reported so
    tags, places, _ = gmsh.model.mesh.getNodes()
    at = np.empty((int(tags.max()) + 1, 3))
    at[tags.astype(int)] = places.reshape(-1, 3)
    _, nodes = gmsh.model.mesh.getElementsByType(kinds[0])
    corners = at[nodes.astype(int).reshape(-1, 3)]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean(axis=1)
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    volume = sum(gmsh.model.occ.getMass(*solid) for solid in gmsh.model.occ.getEntities(3))
    expected = max(3.2 * len(corners), 4.4 * volume / np.average(edges, weights=areas) ** 3)
    if expected > MOST_CELLS:
        raise GeometryError(
            f"about {expected:.2g} cells are expected and {MOST_CELLS:,} are allowed; the part's roundings and holes ask for "
            "small ones: use a larger cell_size, or fewer cells around a circle"
        )


def _straighten(dimension: int) -> None:
    """Put the mid-edge nodes of spoilt cells back on straight edges; their neighbours follow until all are sound.

    With straight edges every cell is as good as before it was curved. A few chords in place of arcs cost little volume.
    """
    import gmsh

    (kind,) = gmsh.model.mesh.getElementTypes(dimension)
    tags, nodes = gmsh.model.mesh.getElementsByType(kind)
    nodes = nodes.reshape(len(tags), -1)
    known, places, _ = gmsh.model.mesh.getNodes()
    at = np.empty((int(known.max()) + 1, 3))
    at[known.astype(int)] = places.reshape(-1, 3)
    for _ in range(ROUNDS):
        spoilt = nodes[gmsh.model.mesh.getElementQualities(tags, "minSICN") <= LEAST_QUALITY]
        if not len(spoilt):
            return
        for k, (a, b) in enumerate(EDGES[: nodes.shape[1] - dimension - 1]):
            for middle, start, end in zip(spoilt[:, dimension + 1 + k], spoilt[:, a], spoilt[:, b], strict=True):
                gmsh.model.mesh.setNode(int(middle), 0.5 * (at[int(start)] + at[int(end)]), [])


def _cells(dimension: int) -> np.ndarray:
    import gmsh

    _, tags, _ = gmsh.model.mesh.getElements(dimension)
    return np.concatenate(tags) if tags else np.empty(0, dtype=np.uint64)


def _worst(dimension: int) -> float:
    import gmsh

    return float(gmsh.model.mesh.getElementQualities(_cells(dimension), "minSICN").min())


def _measure(dimension: int) -> float:
    """Integrate 1 over the cells of the current mesh, curved edges included."""
    import gmsh

    total = 0.0
    for kind in gmsh.model.mesh.getElementTypes(dimension):
        points, weights = gmsh.model.mesh.getIntegrationPoints(kind, "Gauss4")
        _, determinants, _ = gmsh.model.mesh.getJacobians(kind, points)
        total += float((np.reshape(determinants, (-1, len(weights))) @ weights).sum())
    return total
