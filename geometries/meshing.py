"""Mesh a device with Gmsh: private model, mesh, complete file; in a process of its own where it takes long.

Only this module starts Gmsh, so the settings that make a mesh repeatable stand in one place.
"""

from __future__ import annotations

import contextlib
import ctypes
import dataclasses
import errno
import functools
import hashlib
import itertools
import math
import os
import pickle
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import zipfile
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from softmodels.common import files, processes
from softmodels.common.errors import GeometryError, MeshFileError, MeshingError, MeshingStopped
from softmodels.common.lazy import gmsh
from softmodels.common.processes import one_at_a_time


class Meshable(Protocol):
    """What the mesher asks of a device: a frozen dataclass whose fields decide its mesh; see `geometries.actuator.Actuator`."""

    __dataclass_fields__: ClassVar[dict[str, dataclasses.Field[Any]]]

    def digest(self) -> str: ...
    @property
    def finer(self) -> float: ...
    @property
    def dimension(self) -> int: ...
    @property
    def portion(self) -> str: ...
    @property
    def mirrors(self) -> tuple[Mirror, ...]: ...
    @property
    def mesh_order(self) -> int: ...
    @property
    def expected_cells(self) -> float: ...
    @property
    def meshed(self) -> bool: ...
    @property
    def foreign(self) -> bool: ...
    def build(self) -> None: ...
    def curve(self) -> None: ...


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
    "Mesh.MeshSizeFactor": 1,
    "Mesh.SecondOrderLinear": 0,
    "Mesh.SecondOrderIncomplete": 0,
    "Mesh.MshFileVersion": 4.1,
    "Mesh.Binary": 0,
    "Mesh.SaveAll": 0,
    "Mesh.ScalingFactor": 1,
    "Mesh.MeshOnlyEmpty": 0,
}
"""Gmsh options of every mesh, by name."""

DRAWN_IN = "Geometry.OCCTargetUnit"
"""Gmsh's option with the unit of a drawing's numbers; empty for the kernel's own, mm."""

AIMED_JACOBIAN, MIN_JACOBIAN = 0.1, 0.05
"""Least Jacobian determinant of a curved cell over that of the same cell with straight edges: below the first, Gmsh's own aim,
nodes are moved; cells below the second are straightened. A flat cell is as flat without curved edges, so that its shape says
nothing here."""

CURVINGS = ("HighOrderElastic", "HighOrder", "")
"""What moves nodes where curved edges spoil cells, in the order tried: an elastic smoother, which moves the inner ones; the
direct optimisation, which also moves those on curved faces along them, and may end the process; none, which leaves the smoother
and straight edges."""

EDGES = ((0, 1), (1, 2), (2, 0), (3, 0), (2, 3), (1, 3))
"""Ends of the edges of a second-order triangle (the first three) or tetrahedron, in Gmsh's order of nodes."""

NOT_REFINED = "the cells of a mesh file are used as they are; mesh the part more finely in its own program, and compare"

MOST_CELLS = 5_000_000
"""More than a machine of 100 GB solves for."""

MAX_CELLS_IN_PROCESS = 10_000
"""Up to this many cells a device is meshed within a second or so, in this very process."""

MAX_STRAIGHTENING_ROUNDS = 10
"""How often straightened cells may spoil their neighbours before that is given up."""

STRAIGHT_TOLERANCE = 1e-9
"""Share of half an edge's length by which its middle is off the straight one, above which the edge is curved."""


@dataclasses.dataclass(frozen=True)
class MeshSummary:
    """Contents of a mesh file: numbers of cells and of nodes, those inside edges included; the smallest scaled Jacobian-based
    quality (Gmsh's SICN) of all cells, 1 regular and 0 or less invalid; the sum of the curved cells' volumes in m3 (3-D) or
    areas in m2 (axisymmetric); the number of straight edges on curved faces."""

    cells: int
    nodes: int
    quality: float
    measure: float
    straight: int


@contextlib.contextmanager
def private_model() -> Iterator[None]:
    """Return a fresh, current Gmsh model; afterwards a caller's own Gmsh session is as it was."""
    with processes.WORKER_LOCK:
        yield from _fresh_model()


def _fresh_model() -> Iterator[None]:
    ours = not gmsh.isInitialized()
    if ours:
        # Not interruptible: Gmsh would otherwise replace the signal handler, which only a main thread may do.
        with processes.handlers_kept():
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
            with processes.handlers_kept():
                gmsh.finalize()
        else:
            gmsh.model.setCurrent(fresh)
            gmsh.model.remove()
            gmsh.model.setCurrent(previous)
            for name, value in before.items():
                gmsh.option.setNumber(name, value)
            gmsh.option.setString(DRAWN_IN, unit)


@contextlib.contextmanager
def drawn_in(unit: str) -> Iterator[None]:
    """Make Gmsh read and write CAD files whose numbers are in a unit, one of the CAD kernel's names: "MM", "M"."""
    gmsh.option.setString(DRAWN_IN, unit)
    try:
        yield
    finally:
        gmsh.option.setString(DRAWN_IN, "")


def write_step(file: Path) -> None:
    """Write the solids of the current Gmsh model as a STEP file, in mm."""
    with drawn_in("MM"):
        gmsh.write(str(file))


@one_at_a_time
def write_mesh(actuator: Meshable, path: Path, stopped: Callable[[], bool] = bool) -> Path:
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
        kept = load_cached_mesh(actuator, partial) and is_whole(partial)
        if not kept:
            _make_curved(actuator, partial, stopped)
        if not is_whole(partial):
            raise OSError(errno.ENOSPC, "the mesh file ended early; is the disk full?", str(path))
        if not kept:
            cache_mesh(actuator, partial)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
    return path


def expected_cells(actuator: Meshable) -> float:
    """Return a device's estimated number of cells; infinite if unknown."""
    return actuator.expected_cells * actuator.finer**actuator.dimension


class InvalidCellsError(MeshingError):
    """Curved edges spoil cells, and moving nodes in one way does not mend them."""


def _make_curved(actuator: Meshable, path: Path, stopped: Callable[[], bool]) -> None:
    """Mesh a device into a file in the first of `CURVINGS` that makes its cells sound."""
    try:
        if expected_cells(actuator) <= MAX_CELLS_IN_PROCESS and not actuator.foreign:
            return _make(actuator, path, CURVINGS[0])
        return apart(_make, actuator, path, CURVINGS[0], stopped=stopped)
    except InvalidCellsError:
        pass
    if processes.pickled((_make, (actuator, path, CURVINGS[1]))) is not None:
        with contextlib.suppress(MeshingError):  # spoilt, or its process has ended
            return apart(_make, actuator, path, CURVINGS[1], stopped=stopped)
    return apart(_make, actuator, path, CURVINGS[2], stopped=stopped)


def _make(actuator: Meshable, path: Path, curving: str) -> None:
    """Mesh a device into a file with a private model of Gmsh's; `InvalidCellsError` if a way of `CURVINGS` leaves some."""
    with private_model():
        gmsh.option.setNumber("Mesh.MeshSizeFactor", 1.0 / actuator.finer)
        try:
            actuator.build()
            if not actuator.meshed:
                _generate(actuator, curving)
            elif _worst(actuator.dimension) <= 0.0:
                raise MeshingError("the mesh has an inverted cell; remesh the part in its own program")
            for mirror in actuator.mirrors:
                mirror_mesh(mirror)
            gmsh.write(str(path))
        except (GeometryError, MeshingError):
            raise
        except Exception as error:  # Gmsh raises bare Exception
            raise MeshingError(
                f"Gmsh could not mesh {type(actuator).__name__}: {str(error).strip() or 'no reason given'}; "
                f"try smaller cells (--finer 1.5), a larger fillet (or none), or another cell size"
            ) from error


def summarize(path: str | Path) -> MeshSummary:
    """Count the cells and nodes of a file of `Actuator.write`; errors as of `load_mesh`, and MeshingError if it holds no
    cells."""
    with private_model():
        load_mesh(path)
        cells = _cells(gmsh.model.getDimension())
        if cells.size == 0:
            raise MeshingError(f"{path} holds no cells")
        quality = gmsh.model.mesh.getElementQualities(cells, "minSICN").min()
        measure = _measure(gmsh.model.getDimension())
        nodes, straight = gmsh.model.mesh.getNodes()[0].size, straight_edges()
    return MeshSummary(int(cells.size), int(nodes), float(quality), measure, straight)


def _generate(actuator: Meshable, curving: str) -> None:
    if actuator.dimension == 3 and (actuator.foreign or math.isinf(actuator.expected_cells)):
        gmsh.model.mesh.generate(2)
        _check_cells()
    gmsh.model.mesh.generate(actuator.dimension)
    cells = _cells(actuator.dimension)
    if cells.size == 0:
        raise MeshingError("Gmsh made no cells inside the solid; try a larger fillet (or none) or another cell size")
    if actuator.dimension == 3:
        # Flat tetrahedra are reshaped while the edges are still straight; curving them would turn some inside out.
        with quiet_output(b"BFGS update error"):  # of Netgen's, at a cell so flat that one of its steps is left out
            gmsh.model.mesh.optimize("Netgen")
    gmsh.model.mesh.setOrder(actuator.mesh_order)
    actuator.curve()
    if actuator.mesh_order > 1 and _jacobian_ratios(actuator.dimension).min() < AIMED_JACOBIAN:
        # Curving an edge onto an arc bends a flat cell too far; moving the inner nodes usually mends it.
        with contextlib.suppress(Exception):  # bare: its solver gave up, and the cells are judged next
            gmsh.model.mesh.optimize(curving or CURVINGS[0])
        if _jacobian_ratios(actuator.dimension).min() < MIN_JACOBIAN:
            if curving:
                raise InvalidCellsError(f"{curving} leaves cells that curved edges spoil")
            straighten(actuator.dimension)
    worst = _worst(actuator.dimension)
    if worst <= 0.0:
        raise MeshingError(
            f"The mesh has an inverted cell (smallest quality {worst:.2g}); "
            f"try a smaller cell size, more refinement or a larger fillet (or none)"
        )


def _check_cells() -> None:
    """Reject a solid whose faces, meshed already, promise more cells than a machine solves for.

    Meshes that Gmsh makes of thin and of thick parts alike have within 1.5 times as many tetrahedra as this expects.
    """
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
            f"about {expected:.2g} cells are expected, but at most {MOST_CELLS:,} are allowed; the part's roundings and "
            f"holes need small ones: use a larger cell_size, or fewer cells around a circle"
        )


def _jacobian_ratios(dimension: int) -> NDArray[np.float64]:
    """Return of each cell its least Jacobian determinant over that of the same cell with straight edges."""
    tags, nodes, at = _curved_cells(dimension)
    corners = at[nodes[:, : dimension + 1]]
    a, b, *c = np.moveaxis(corners[:, 1:] - corners[:, :1], 1, 0)
    across = np.cross(a, b)
    straight = np.abs(np.einsum("ni,ni->n", across, c[0])) if c else np.linalg.norm(across, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):  # a cell without volume, which is reported as inverted
        shares = gmsh.model.mesh.getElementQualities(tags, "minDetJac") / straight
    return np.nan_to_num(shares, nan=1.0)


def _curved_cells(dimension: int) -> tuple[NDArray[np.uint64], NDArray[np.int64], NDArray[np.float64]]:
    """Return tags and nodes of the cells, which are of one kind, and places in the model's unit by node."""
    (kind,) = gmsh.model.mesh.getElementTypes(dimension)
    tags, nodes = gmsh.model.mesh.getElementsByType(kind)
    known, places, _ = gmsh.model.mesh.getNodes()
    at = np.empty((int(known.max()) + 1, 3))
    at[known.astype(int)] = places.reshape(-1, 3)
    return tags, nodes.astype(np.int64).reshape(len(tags), -1), at


def straighten(dimension: int, shares: Sequence[float] = ()) -> None:
    """Put the mid-edge nodes of spoilt cells back on straight edges, or first some ``shares`` of the way from there, round by
    round; their neighbours follow until all are sound. The model keeps how many edges on curved faces are straight by that.

    With straight edges every cell is as good as before it was curved, but a wall there is a polygon.
    """
    boundary = np.concatenate([gmsh.model.mesh.getNodes(d, includeBoundary=True)[0] for d in range(dimension)])
    straight = set[int]()
    for share in (*shares, *[0.0] * MAX_STRAIGHTENING_ROUNDS):
        _, nodes, at = _curved_cells(dimension)
        spoilt = nodes[_jacobian_ratios(dimension) < MIN_JACOBIAN]
        if not len(spoilt):
            break
        for k, (a, b) in enumerate(EDGES[: nodes.shape[1] - dimension - 1]):
            middles, chords = spoilt[:, dimension + 1 + k], 0.5 * (at[spoilt[:, a]] + at[spoilt[:, b]])
            bent = np.linalg.norm(at[middles] - chords, axis=1) > STRAIGHT_TOLERANCE * np.linalg.norm(
                chords - at[spoilt[:, a]], axis=1
            )
            places = chords[bent] + share * (at[middles[bent]] - chords[bent])
            for middle, place in zip(middles[bent].tolist(), places, strict=True):
                gmsh.model.mesh.setNode(middle, place, [])
            if not share:
                straight.update(middles[bent].tolist())
    if count := int(np.isin(list(straight), boundary).sum()):
        gmsh.model.setAttribute(STRAIGHT, [str(straight_edges() + count)])


def _cells(dimension: int) -> np.ndarray:
    _, tags, _ = gmsh.model.mesh.getElements(dimension)
    return np.concatenate(tags) if tags else np.empty(0, dtype=np.uint64)


def _worst(dimension: int) -> float:
    return float(gmsh.model.mesh.getElementQualities(_cells(dimension), "minSICN").min())


def _measure(dimension: int) -> float:
    """Integrate 1 over the cells of the current mesh, curved edges included."""
    total = 0.0
    for kind in gmsh.model.mesh.getElementTypes(dimension):
        points, weights = gmsh.model.mesh.getIntegrationPoints(kind, "Gauss4")
        _, determinants, _ = gmsh.model.mesh.getJacobians(kind, points)
        total += float((np.reshape(determinants, (-1, len(weights))) @ weights).sum())
    return total


# ----------------------------------------------------------------------------------------------------------------------
# Run a Gmsh task in a separate process, so that it can be stopped and cannot crash the caller.
#
# Gmsh and its CAD kernel do not hear Ctrl-C while they work, may end the whole process on a damaged file, and print words of
# their own. In a process of its own all three are somebody else's: it is killed when the caller is stopped or killed itself, a
# crash becomes a sentence, and its output is hidden.


POLLING_INTERVAL = 0.02
"""Polling interval in seconds for the end of the task or a stop request."""

WORKER = """
import os, pickle, sys
answer = os.dup(1)
os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
sys.path[:] = pickle.load(sys.stdin.buffer)
from geometries.meshing import answer_to
from softmodels.common import processes
processes.end_with_parent()
with os.fdopen(answer, "wb") as out:
    out.write(answer_to(sys.stdin.buffer.read()))
"""


def apart[T](task: Callable[..., T], *arguments: Any, stopped: Callable[[], bool] = bool) -> T:
    """Carry out a task, a function that is imported by name, in another process and return its result. Once ``stopped``,
    asked several times a second, is true the task is killed: MeshingStopped. MeshingError if the process died, else what the
    task raised."""
    if (order := processes.pickled((task, arguments))) is None:
        return task(*arguments)
    with tempfile.TemporaryFile() as words, tempfile.TemporaryFile() as answer, tempfile.TemporaryFile() as errors:
        pickle.dump(sys.path, words)
        words.write(order)
        words.seek(0)
        # A session of its own: Ctrl-C at a terminal reaches all of the foreground's processes, and this one is ended by us.
        process = subprocess.Popen(
            [sys.executable, "-P", "-c", WORKER], stdin=words, stdout=answer, stderr=errors, start_new_session=True
        )
        try:
            while process.poll() is None:
                if stopped():
                    raise MeshingStopped
                time.sleep(POLLING_INTERVAL)
        finally:
            if process.poll() is None:
                process.kill()
                process.wait()
        if process.returncode:
            time.sleep(POLLING_INTERVAL)  # a batch queue signals all processes of a job, this one perhaps a moment later
            if stopped():
                raise MeshingStopped
            errors.seek(0)
            raise MeshingError(_end_of_process(process.returncode, errors.read().decode(errors="replace")))
        answer.seek(0)
        done, value = pickle.load(answer)
    if not done:
        raise value
    return value  # type: ignore[no-any-return]


def answer_to(order: bytes) -> bytes:
    """Carry out a pickled task; return its pickled result, or what it raised."""
    task, arguments = pickle.loads(order)
    try:
        return pickle.dumps((True, task(*arguments)))
    except Exception as error:
        return pickle.dumps((False, error))


@contextlib.contextmanager
def ended_after(seconds: float) -> Iterator[None]:
    """End this process, one of `apart`, if what is within takes more CPU seconds, because Gmsh does not come back from some
    surfaces. Nothing is limited where the system cannot do that."""
    try:
        import resource
    except ImportError:  # Windows
        yield
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_CPU)
    if soft == resource.RLIM_INFINITY:
        resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(time.process_time() + seconds), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_CPU, (soft, hard))


def _end_of_process(status: int, words: str) -> str:
    """Return why a process ended, as a sentence."""
    if status == -signal.SIGKILL:
        return "the mesher was killed, most likely out of memory; use larger cells (--cell-size)"
    if status == -getattr(signal, "SIGXCPU", 0):
        return "the mesher does not come back from its surface; repair or simplify it in the program that drew it"
    if status < 0:
        return (
            f"the mesher crashed ({signal.Signals(-status).name}); the file it read may be damaged, or the cells too "
            "small for the memory; try another cell size"
        )
    last = words.strip().splitlines()[-1:] or [f"status {status}"]
    return f"the meshing process failed ({last[0]})"


# ----------------------------------------------------------------------------------------------------------------------
# Words that a library below prints by itself, kept off the terminal.


OUTPUT_STREAMS = (1, 2)


@contextlib.contextmanager
def quiet_output(words: bytes) -> Iterator[None]:
    """Leave lines with these words out of what is written to standard output and errors; all other lines come afterwards.

    It is for short calls: what other threads write meanwhile comes late too.
    """
    library = ctypes.CDLL(None)
    with contextlib.ExitStack() as stack:
        for stream in OUTPUT_STREAMS:
            with contextlib.suppress(OSError):  # closed, as in a service: no output is shown there
                stack.enter_context(_without_start(stream, words))
        try:
            yield
        finally:
            library.fflush(None)  # what C has not written yet


@contextlib.contextmanager
def _without_start(stream: int, words: bytes) -> Iterator[None]:
    before = os.dup(stream)
    with tempfile.TemporaryFile() as heard:
        os.dup2(heard.fileno(), stream)
        try:
            yield
        finally:
            os.dup2(before, stream)
            heard.seek(0)
            if kept := b"".join(line for line in heard if words not in line):
                os.write(before, kept)
            os.close(before)


# ----------------------------------------------------------------------------------------------------------------------
# Cache of meshes in the user's folder, so that the same device is meshed once.
#
# A mesh is known by the device's class and fields, by the file it is drawn in, and by what meshes it: Gmsh's version and the
# source of this package. Classes from elsewhere are meshed anew each time, since what they build from is not known here.


MOST_KEPT = 500_000_000
"""Maximum size of the cache in bytes; least recently used meshes are removed first."""


def folder() -> Path:
    """Return where meshes are kept."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "softmodels" / "meshes"


def load_cached_mesh(actuator: Meshable, path: Path) -> bool:
    """Copy a device's cached mesh to a file; return whether there was one."""
    with contextlib.suppress(OSError, RuntimeError):  # without a cache, or a home for it, nothing is kept
        if (kept := _place(actuator)) is not None and kept.exists():
            shutil.copyfile(kept, path)
            os.utime(kept)
            return True
    return False


def is_mesh_cached(actuator: Meshable) -> bool:
    """Return whether a device's mesh is kept."""
    with contextlib.suppress(OSError, RuntimeError):
        return (kept := _place(actuator)) is not None and kept.exists()
    return False


def mesh_label(actuator: Meshable) -> str:
    """Return the message before a device is meshed."""
    kind = "solid" if actuator.dimension == 3 else "axisymmetric section"
    cells = "" if actuator.finer == 1.0 else f", cells {actuator.finer:g} times smaller"
    what = f"{type(actuator).__name__} ({kind}, {actuator.portion}{cells})"
    if is_mesh_cached(actuator):
        return f"{what}: using the cached mesh"
    expected = expected_cells(actuator)
    return f"meshing {what}" if math.isinf(expected) else f"meshing {what}: about {float(f'{expected:.1e}'):,.0f} cells"


def cache_mesh(actuator: Meshable, path: Path) -> None:
    """Keep the mesh in a file as a device's."""
    with contextlib.suppress(OSError, RuntimeError):
        if (kept := _place(actuator)) is not None:
            _keep(kept, lambda partial: shutil.copyfile(path, partial))


def cached_arrays(key: object, make: Callable[[], dict[str, NDArray[Any]]]) -> dict[str, NDArray[Any]]:
    """Return arrays by name that are kept beside the meshes under a key, whose text has all that they depend on; made where
    they are not."""
    name = f"{hashlib.sha256(repr((key, _mesher_versions())).encode()).hexdigest()[:32]}.npz"
    with contextlib.suppress(OSError, RuntimeError, ValueError, zipfile.BadZipFile), np.load(folder() / name) as kept:
        return dict(kept)
    arrays = make()

    def write(partial: Path) -> None:
        with partial.open("wb") as stream:
            np.savez(stream, **arrays)  # type: ignore[arg-type]  # no name of these is one of its options

    with contextlib.suppress(OSError, RuntimeError):
        _keep(folder() / name, write)
    return arrays


def _keep(kept: Path, write: Callable[[Path], object]) -> None:
    """Write a file of the cache whole, and take away what is beyond its size."""
    kept.parent.mkdir(parents=True, exist_ok=True)
    partial = kept.with_name(f".{kept.name}-{os.getpid()}")
    try:
        write(partial)
        partial.replace(kept)
    finally:
        partial.unlink(missing_ok=True)
    _forget_old(kept.parent)


def _place(actuator: Meshable) -> Path | None:
    """Return the file in the cache; None for a device that is not kept."""
    kind = type(actuator)
    if kind.__module__.partition(".")[0] != __name__.partition(".")[0]:
        return None
    fields = [(field.name, getattr(actuator, field.name)) for field in dataclasses.fields(actuator)]
    key = repr((kind.__qualname__, fields, actuator.digest(), _mesher_versions()))
    return folder() / f"{hashlib.sha256(key.encode()).hexdigest()[:32]}.msh"


@functools.cache
def _mesher_versions() -> str:
    source = hashlib.sha256(gmsh.__version__.encode())
    for file in sorted(Path(__file__).parent.rglob("*.py")):
        source.update(file.read_bytes())
    return source.hexdigest()


def _forget_old(place: Path) -> None:
    kept_files = sorted(((file.stat().st_mtime, file.stat().st_size, file) for file in place.glob("*.[mn]*")), reverse=True)
    total = 0
    for _, size, file in kept_files:
        total += size
        if total > MOST_KEPT:
            file.unlink(missing_ok=True)


# ----------------------------------------------------------------------------------------------------------------------
# Reading a mesh file that may come from anywhere: checked before Gmsh sees it.
#
# Gmsh takes a file that is no mesh for a script in its own language and runs it, commands of the shell included; it also runs
# the options in ``NAME.msh.opt`` beside a mesh. A results folder may come from somebody else, so nothing but the mesh itself,
# in the one format that this project writes, reaches Gmsh, and from a folder of its own.


START = re.compile(rb"\$MeshFormat\r?\n4\.1 0 8\r?\n\$EndMeshFormat\r?\n")
"""How a mesh file begins: MSH 4.1, text."""

LAST_WORDS = (b"$EndElements", b"$EndStraightEdges")
"""How a complete one ends: without or with straight edges on curved faces."""

SECTION = re.compile(rb"^\$(\w+)\s*$", re.MULTILINE)
SECTIONS = ("MeshFormat", "PhysicalNames", "Entities", "Nodes", "Elements")
"""Sections of a mesh file, in order; each ends with its name after "End"."""
STRAIGHT = "StraightEdges"
"""Section behind them, and Gmsh's attribute, with how many edges on curved faces are straight; absent if none are."""


def is_whole(path: Path) -> bool:
    """Return whether a mesh file is complete: Gmsh does not tell of a full disk, its file then ends early."""
    with path.open("rb") as file:
        file.seek(max(path.stat().st_size - 2 * max(map(len, LAST_WORDS)), 0))
        end = file.read()
    return any(words in end for words in LAST_WORDS)


def load_mesh(path: str | Path, dimension: int | None = None) -> list[tuple[int, int, str]]:
    """Read a mesh file of `Actuator.write` into the current Gmsh model (see `private_model`), of dimension 2 (axisymmetric),
    3 (solid) or any; return dimension, tag and name of its physical groups (see `named_groups`). FileNotFoundError, or
    MeshFileError if it is no complete mesh of that dimension."""
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path} is not a file")
    _check(path, files.read_file(path, files.MAX_GEOMETRY_BYTES))
    with tempfile.TemporaryDirectory() as folder:
        alone = Path(folder) / "alone.msh"  # nothing of Gmsh's beside it
        alone.symlink_to(path.resolve())
        try:
            gmsh.merge(str(alone))
        except Exception as error:  # Gmsh raises bare Exception
            raise MeshFileError(f"{path} is a broken mesh file ({str(error).strip() or 'no reason given'})") from None
    if dimension not in (None, top_dimension := gmsh.model.getDimension()):
        raise MeshFileError(f"{path} is the mesh of another device: its cells have {top_dimension} dimensions, not {dimension}")
    return named_groups()


JOINT = "+"
"""Between the names of what has several: every facet and every cell is in one physical group, as DOLFINx' reader wants."""


def disjoint(groups: Mapping[str, NDArray[np.int64]], count: int, rest: str) -> dict[str, NDArray[np.int64]]:
    """Return groups of numbers below a count without any in two: those of several have their names with `JOINT` between, those
    of none the rest's."""
    inside = np.zeros((count, len(groups) + 1), dtype=bool)  # one more: rows have to have a column
    for column, members in enumerate(groups.values()):
        inside[members, column] = True
    kinds, kind = np.unique(inside, axis=0, return_inverse=True)
    names = [JOINT.join(itertools.compress(groups, row)) or rest for row in kinds]
    groups_by_name = {name: np.flatnonzero(kind.ravel() == k) for k, name in enumerate(names)}
    return dict(reversed(groups_by_name.items()))  # in the order of the groups, the rest last


def straight_edges() -> int:
    """Return how many edges on curved faces of the current model's mesh are straight, without their mirror images."""
    return int(gmsh.model.getAttribute(STRAIGHT)[0]) if STRAIGHT in gmsh.model.getAttributeNames() else 0


def straight_text(count: int) -> str:
    """Return the warnings on straight edges on curved faces."""
    return (
        f"{count} edges of the mesh on curved faces are straight, because curved ones would turn cells inside out: thin walls "
        "are polygons there, and too stiff or too soft; use smaller cells (--finer 1.5)"
    )


def named_groups() -> list[tuple[int, int, str]]:
    """Return dimension, tag and name of the current model's physical groups, one with several names once for each; a region
    and the face of it may bear one name."""
    groups = [(*group, gmsh.model.getPhysicalName(*group)) for group in gmsh.model.getPhysicalGroups()]
    return [(dimension, tag, name) for dimension, tag, names in groups for name in names.split(JOINT)]


def _check(path: Path, content: bytes) -> None:
    """Reject what does not have a mesh's sections, whole and in order, and nothing between them."""
    if not START.match(content):
        raise MeshFileError(f"{path} is not a mesh file (MSH 4.1, text) as this program writes it")
    if b"\0" in content:
        raise MeshFileError(f"{path} is a broken mesh file: it holds bytes that are no text")
    marks = list(SECTION.finditer(content))
    expected = [word for name in (*SECTIONS, STRAIGHT) for word in (name.encode(), b"End" + name.encode())]
    if [mark[1] for mark in marks] not in (expected[:-2], expected):
        raise MeshFileError(f"{path} is a broken mesh file: its sections are not {', '.join(SECTIONS)}, each whole")
    between = [content[end.end() : start.start()] for end, start in zip(marks[1::2], marks[2::2], strict=False)]
    if b"".join([*between, content[marks[-1].end() :]]).strip():
        raise MeshFileError(f"{path} is a broken mesh file: there is something between or after its sections")


# ----------------------------------------------------------------------------------------------------------------------
# A mesh of half a body mirrored into a mesh of the whole: cell by cell, so that it is as symmetric as the body.


REFLECTED_NODES = {
    1: [1, 0],
    8: [1, 0, 2],
    2: [1, 0, 2],
    9: [1, 0, 2, 3, 5, 4],
    4: [1, 0, 2, 3],
    11: [1, 0, 2, 3, 4, 6, 5, 9, 8, 7],
}
"""Gmsh's lines, triangles and tetrahedra of first and second order: the order of nodes with the first two corners exchanged.

An image is turned inside out; this turns it back.
"""


@dataclasses.dataclass(frozen=True)
class Mirror:
    """A coordinate plane through the origin, square to an axis of 0 to 2, on which a mesh of half a body is mirrored into one
    of the whole, which has no facets of the plane's role. A group whose image is another one is ``renamed``, such as
    ``{"top": "bottom"}``; the image of any other joins it."""

    role: str
    axis: int
    renamed: Mapping[str, str]


def mirror_mesh(mirror: Mirror) -> None:
    """Add the image of the current model's mesh and its physical groups; nodes on the plane are shared."""
    # Nodes of points of a spline belong to no cell: they are not saved, and their numbers are the images'.
    used = np.concatenate([own for dimension in (2, 3) for own in gmsh.model.mesh.getElements(dimension)[2]])
    for point in gmsh.model.getEntities(0):
        if not np.isin(gmsh.model.mesh.getNodes(*point)[0], used).any():
            gmsh.model.mesh.clear([point])
    tags, places, _ = gmsh.model.mesh.getNodes()
    places = places.reshape(-1, 3).copy()
    groups = {gmsh.model.getPhysicalName(*group): group for group in gmsh.model.getPhysicalGroups()}
    on_plane = gmsh.model.mesh.getNodesForPhysicalGroup(*groups[mirror.role])[0]
    image = np.zeros(int(tags.max()) + 1, dtype=np.uint64)
    image[on_plane] = on_plane
    moved = image[tags] == 0
    image[tags[moved]] = int(tags.max()) + 1 + np.arange(np.count_nonzero(moved))
    places[:, mirror.axis] *= -1.0

    made: list[tuple[int, str, list[int], int]] = []
    for name, (dimension, group) in sorted(groups.items(), key=lambda item: item[1], reverse=True):  # cells first
        if name == mirror.role:
            continue
        entities = list(gmsh.model.getEntitiesForPhysicalGroup(dimension, group))
        copy = gmsh.model.addDiscreteEntity(dimension)
        if not made:
            gmsh.model.mesh.addNodes(dimension, copy, image[tags[moved]], places[moved].ravel())
        for entity in entities:
            for kind, _, nodes in zip(*gmsh.model.mesh.getElements(dimension, entity), strict=True):
                turned = image[nodes].reshape(-1, len(REFLECTED_NODES[kind]))[:, REFLECTED_NODES[kind]]
                gmsh.model.mesh.addElementsByType(copy, kind, [], turned.ravel())
        made.append((dimension, name, entities, copy))
    gmsh.model.removePhysicalGroups()
    for name in groups:  # Gmsh keeps the names, and would not give them anew
        gmsh.model.removePhysicalName(name)
    joined: dict[tuple[int, str], list[int]] = {}
    for dimension, name, entities, copy in made:
        joined.setdefault((dimension, name), []).extend(entities)
        joined.setdefault((dimension, mirror.renamed.get(name, name)), []).append(copy)
    for (dimension, name), members in sorted(joined.items()):
        gmsh.model.addPhysicalGroup(dimension, members, name=name)


# ----------------------------------------------------------------------------------------------------------------------
# Solids in layers that are bonded to each other, in Gmsh: common faces where they touch, names for regions and faces.
#
# The model is in mm and the mesh is written in m: the CAD kernel's fixed tolerances suit mm.


Entity = tuple[int, int]
Vector = tuple[float, float, float]

MM_PER_M = 1e3


def add_block(low: Vector, high: Vector) -> Entity:
    """Add a block with sides along the axes, its corners in m."""
    return (3, int(gmsh.model.occ.addBox(*(MM_PER_M * np.array(low)), *(MM_PER_M * np.subtract(high, low)))))


def one_solid(solids: Sequence[Entity]) -> Entity:
    """Return the only one of them; MeshingError if the CAD kernel has made more or none."""
    if [dimension for dimension, _ in solids] != [3]:
        raise MeshingError(f"the CAD kernel made {len(solids)} solids of one body; please report this with the parameters")
    return solids[0]


def bond(layers: Mapping[str, Sequence[Entity]], role_of: Callable[[int], str]) -> None:
    """Make the faces between layers (solids by region) common, and name the regions and the faces on the boundary, whose
    roles are known by their tags."""
    every = [(solid, name) for name, solids in layers.items() for solid in solids]
    _, parts = gmsh.model.occ.fragment([every[0][0]], [solid for solid, _ in every[1:]])
    gmsh.model.occ.synchronize()
    regions: dict[str, list[int]] = defaultdict(list)
    for (_, name), part in zip(every, parts, strict=True):
        regions[name] += [tag for _, tag in part]
    name_groups(3, regions)
    solids = [(3, tag) for tags in regions.values() for tag in tags]
    roles: dict[str, list[int]] = defaultdict(list)
    for _, tag in gmsh.model.getBoundary(solids, combined=True, oriented=False):
        roles[role_of(tag)].append(tag)
    name_groups(2, roles)


def divided(cells: int) -> int:
    """Return how many cells a structured line gets that has a number of them in the device's own mesh."""
    return math.ceil(cells / gmsh.option.getNumber("Mesh.MeshSizeFactor") - 1e-9)


def set_sizes(size: Callable[[float, float, float], float]) -> None:
    """Let cells have a size in m that is a function of the place in m; the mesh is written in m."""
    gmsh.option.setNumber("Mesh.ScalingFactor", 1.0 / MM_PER_M)
    gmsh.model.mesh.setSizeCallback(lambda dim, tag, x, y, z, other: MM_PER_M * size(x / MM_PER_M, y / MM_PER_M, z / MM_PER_M))


def face_block(tag: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the corners in m of the block around a face, which is larger by up to 1e-10 m."""
    low, high = np.array(gmsh.model.occ.getBoundingBox(2, tag)).reshape(2, 3) / MM_PER_M
    return low, high


# ----------------------------------------------------------------------------------------------------------------------
# Parts of the model that is being meshed.


def name_group(dimension: int, tags: list[int], role: str) -> None:
    """Give entities of a dimension a role, by a physical group."""
    if not tags:
        raise MeshingError(f"The shape has no place for {role!r}; please report this with the parameters")
    gmsh.model.addPhysicalGroup(dimension, tags, name=role)


def place_of(tag: int) -> NDArray[np.float64]:
    """Return the coordinates of a point of the CAD model, shape (3,)."""
    return np.array(gmsh.model.getValue(0, tag, []))


def points_at(place: Vector | NDArray[np.float64], near: float) -> list[int]:
    """Return the points of the CAD model whose coordinates all differ by less than a length from a place's."""
    return [tag for _, tag in gmsh.model.getEntities(0) if np.abs(place_of(tag) - place).max() < near]


def corners_of(tag: int, dimension: int = 2) -> NDArray[np.float64]:
    """Return the corner points of a face or a curve of the CAD model, shape (n, 3)."""
    boundary = gmsh.model.getBoundary([(dimension, tag)], combined=False, oriented=False, recursive=True)
    return np.array([place_of(point) for _, point in boundary])


def name_groups(dimension: int, groups: Mapping[str, list[int]]) -> None:
    """Give entities of a dimension their roles, by physical groups."""
    for role, tags in groups.items():
        name_group(dimension, tags, role)


def name_boundary(role_of: Callable[[int], str]) -> None:
    """Give every boundary face of the solids its role, of its tag; inner faces get none."""
    roles: dict[str, list[int]] = defaultdict(list)
    for _, tag in gmsh.model.getEntities(2):
        if len(gmsh.model.getAdjacencies(2, tag)[0]) == 1:
            roles[role_of(tag)].append(tag)
    name_groups(2, roles)
