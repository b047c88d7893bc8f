"""A results folder that is readable at any moment, even if the run is interrupted.

New results are prepared in a subfolder, and replace those of an earlier run once their first step is stored. Each step is
written to its own file under a temporary name and renamed; the light files (XDMF, CSV) are rewritten after each step. A
finished run merges the steps into one HDF5 file. Used on rank 0 only, without MPI.
"""

from __future__ import annotations

import contextlib
import dataclasses
import errno
import functools
import json
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import h5py
import numpy as np
import numpy.typing as npt

from geometries import Actuator
from geometries.actuator import Vector
from softmodels.case.case import Case
from softmodels.case.materials import SourceBand
from softmodels.common.arrays import Array
from softmodels.common.errors import Spoken
from softmodels.common.files import hdf5_reason, remove_steps, replace, replace_hdf5
from softmodels.common.folders import PATIENCE, OwnFolder
from softmodels.common.pages import Provenance
from softmodels.runs import formats
from softmodels.runs.columns import (
    FILE as SOURCES,
    SourceRows,
    StateLabels,
    in_order,
    read_sources,
    state_labels,
    write_sources,
)
from softmodels.runs.fields import Row
from softmodels.runs.formats import opened, read_values
from softmodels.runs.grid import OUTSIDE, Surface, surface_of

PICTURES = ("profile", "loop", "mesh", "slice", "mode", "undeformed", "cut", "hot-spots", "stress",
            *(f"stress-{k}" for k in range(1, 5)))  # fmt: skip
"""Stems of the pictures other than the one named after the gauge."""
PAGES = ("film.gif", "film.webp", "film.mp4", "report.html")
FORMAT = 5
"""Of the stored steps, in the HDF5 file's attribute ``format``. An older one is read, but not resumed."""
OLDER = "run without --resume into another folder (--output), or only draw it (softmodels draw)"
INPUTS = "files/"
"""Subfolder for copies of a case's input files, such as a part's mesh."""
RUN, BRANCH = "run", "branch/"
"""Kind of a run in a folder's record; subfolder for the branch at its bifurcation."""


def picture_files(gauge: str) -> list[str]:
    """Return the file names of a run's pictures, film and report."""
    return [*(f"{picture}.png" for picture in (*PICTURES, gauge)), *PAGES]


def picture_folder(folder: Path) -> OwnFolder:
    """Return the record of the pictures in a results folder, separate from the run's because they are also drawn during it."""
    return OwnFolder(folder, "pictures", part="pictures")


class ResultsError(Spoken, RuntimeError):
    """Results cannot be read or resumed; the message is for the user."""


class Results:
    """Results of one run.

    Args:
        folder: Where to write; made if missing.
        name: Stem of the files, such as ``"disk"``.
        gauge: The device's `Actuator.gauge`, which names the picture of its rise.
        kind: What the folder's record calls them.

    Attributes:
        own: The folder's record.
        folder: Where the files are: in ``own``, or aside of the earlier results until the first step is there.
        started: When the run that writes them began (`time.monotonic`); None if unknown.
    """

    def __init__(self, folder: Path, name: str, gauge: str = "apex", kind: str = RUN):
        self.own = OwnFolder(folder, kind)
        self.folder, self.name, self.gauge = folder, name, gauge
        self.stored: list[formats.StoredStep] = []
        self._about: dict[str, object] = {}
        self.started: float | None = None

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
        """Results of the branch at this path's bifurcation, in their own folder, which may not exist."""
        return Results(self.own.path / BRANCH.strip("/"), self.name, self.gauge, "branch")

    def write_sources(self, sources: SourceRows) -> None:
        """Write the paths of the silicone's other sources, if any."""
        if sources:
            self.own.claim([SOURCES])
            write_sources(self.folder, sources)

    def sources(self, case: Case) -> dict[str, Sequence[Row]]:
        """Return the rows of each source of the silicone, the run's own included; empty if no others were solved."""
        return in_order(case, self.rows, read_sources(self.folder) if isinstance(case.band, SourceBand) else {})

    @property
    def files(self) -> list[str]:
        """Names of the files of a run, pictures excluded."""
        own = (f"{self.name}{end}" for end in (".h5", ".xdmf", ".vtkhdf", ".msh", ".steps/"))
        return ["case.toml", *own, "path.csv", SOURCES, "summary.json", INPUTS]

    @staticmethod
    def inputs_of(files: Iterable[str]) -> dict[str, str]:
        """Return where copies of a case's own files lie, from the folder: by the file, each under a name of its own."""
        names: dict[str, str] = {}
        for file in files:
            stem, end, number = Path(file).stem, Path(file).suffix, 1
            while (name := f"{INPUTS}{stem}{'' if number == 1 else f'-{number}'}{end}") in names.values():
                number += 1
            names[file] = name
        return names

    def prepare(self, about: Mapping[str, object]) -> None:
        """Start new results beside the earlier ones, which stay until a step is stored; ``about`` is recorded of them."""
        self.own.check_names([*self.files, BRANCH])
        self._about = dict(about)
        self.folder = self.own.prepare()

    def record(self, **about: object) -> None:
        """Add to the record of these results: at once, or with the first state."""
        self._about |= about
        if self.folder == self.own.path:
            self.own.claim([], about)

    def _bring_in(self) -> None:
        """Replace the earlier results, pictures included, by the prepared ones."""
        pictures = picture_folder(self.own.path)
        pictures.take(PATIENCE)  # a drawing process may be using them
        try:
            self.own.bring_in(self._about)
            self.folder = self.own.path
            pictures.remove(pictures.files)
        finally:
            pictures.leave()

    def clear(self) -> None:
        """Create the folder and remove the files of an earlier run at once; `OwnFolderError` if it is not a run's."""
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
        """Raise `ResultsError` if the stored states lie on other nodes than these, shape (n, 3), m."""
        with formats.opened(self.heavy) as file:
            stored = np.asarray(formats.read_values(file, "mesh/points"))
        if stored.shape != points.shape or not np.allclose(stored, points, rtol=0.0, atol=1e-9 * np.abs(stored).max()):
            nodes = f"{len(stored)} nodes there, {len(points)} here"
            raise ResultsError(f"the states in {self.folder} are of another mesh ({nodes}); run without --resume")

    def load(self, go_on: bool = False) -> None:
        """Load the results of an earlier run, to draw it or to ``go_on``, which needs a run of this version.

        Raises:
            ResultsError: There is nothing, or it cannot be read, or another version wrote it.
        """
        if not self.heavy.exists():
            raise ResultsError(f"{self.folder} holds no {self.heavy.name}, so there is no run to resume")
        if self.steps.is_symlink():
            raise ResultsError(f"{self.steps} is a link, but the steps of a run must be in its own folder; remove it")
        found: dict[int, formats.StoredStep] = {}
        try:
            with formats.opened(self.heavy) as file:
                written = int(file.attrs.get("format", 0))
                if written > FORMAT or (go_on and written < FORMAT):
                    which, fix = ("a later", "update softmodels") if written > FORMAT else ("an earlier", OLDER)
                    text = (
                        f"{self.folder} was written by {which} version of softmodels (format {written}, not {FORMAT})"
                    )
                    raise ResultsError(f"{text}; {fix}")
                points, cells = formats.inside(file, "mesh/points").shape, formats.inside(file, "mesh/cells").shape
                self._shapes = (points[0], cells, str(formats.inside(file, "mesh").attrs["cell_name"]))
                for group in formats.inside(file, "steps") if "steps" in file else ():
                    step = formats.inside(file, f"steps/{group}")
                    found[int(group)] = formats.read_step(step, self.heavy.name, f"/steps/{group}")
            for path in sorted(self.steps.glob("*.h5")):
                with formats.opened(path) as file:
                    found[int(path.stem)] = formats.read_step(file, f"{self.steps.name}/{path.name}", "")
        except ResultsError:
            raise
        except (OSError, KeyError, ValueError, TypeError, AttributeError, RuntimeError) as error:
            raise ResultsError(f"the results in {self.folder} cannot be read ({hdf5_reason(error)})") from error
        self.stored = [found[step] for step in sorted(found)]

    def add(self, row: Row, fields: Mapping[str, npt.NDArray[np.float64]], restart: formats.Restart) -> None:
        """Store one step: its row of ``path.csv``, nodal fields (n,), (n, 3) or (n, 3, 3), and its restart data."""
        flat = {
            name: values if values.ndim < 3 else values.reshape(-1, formats.TENSOR) for name, values in fields.items()
        }
        self.steps.mkdir(exist_ok=True)

        def fill(file: h5py.File) -> None:
            for name, values in flat.items():
                file[name] = values
            file.attrs[formats.ROW], file.attrs[formats.RESTART] = json.dumps(row.cells), json.dumps(restart)

        path = self.steps / f"{len(self.stored):04d}.h5"
        replace_hdf5(path, fill)
        self.stored.append(
            formats.StoredStep(f"{self.steps.name}/{path.name}", "", row, restart.copy(), formats.shapes_of(flat))
        )
        self.write_light()
        if self.folder != self.own.path:
            self._bring_in()

    def fields(self, step: int, names: tuple[str, ...]) -> dict[str, npt.NDArray[np.float64]]:
        """Return the nodal fields of a stored step."""
        if not (self.folder / self.stored[step].file).exists():
            self.load()  # the run that wrote it has merged its steps meanwhile
        stored = self.stored[step]
        with formats.opened(self.folder / stored.file) as file:
            found = {name: np.asarray(formats.read_values(file, f"{stored.group}/{name}")) for name in names}
        return {
            name: values.reshape(-1, 3, 3) if values.shape[1:] == (formats.TENSOR,) else values
            for name, values in found.items()
        }

    def finish(self) -> None:
        """Merge all steps into one HDF5 file, with every step readable at any moment.

        Raises:
            OSError: There is no room for it; all steps stay where they are.
        """
        files = {self.heavy.name, *(stored.file for stored in self.stored)}
        # HDF5 fails badly on a full disk: see `replace_hdf5`. The whole may not fit in memory.
        if shutil.disk_usage(self.folder).free < sum((self.folder / file).stat().st_size for file in files):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        gathered = [
            dataclasses.replace(stored, file=self.heavy.name, group=f"/steps/{number:04d}")
            for number, stored in enumerate(self.stored)
        ]
        whole = self.heavy, self._shapes, self.stored, gathered
        try:
            replace(self.heavy, lambda path: formats.write_gathered(path, *whole))
        except (OSError, RuntimeError) as error:
            raise OSError(errno.EIO, hdf5_reason(error)) from error
        self.stored = gathered
        self.write_light(gathered=True)
        remove_steps(self.steps)

    def write_light(self, gathered: bool = False) -> None:
        """Write ``path.csv``, the XDMF and the light VTKHDF anew; ``gathered`` is whether the HDF5 file has all steps."""
        formats.write_light(self.heavy, self._shapes, self.stored, gathered)


# ----------------------------------------------------------------------------------------------------------------------
# The states of a run: fields on one mesh, and which of them to show.


STILLS = 4
"""Maximum number of states shown side by side."""


type NodalGrid = tuple[Array, npt.NDArray[np.int64], str]
"""Undeformed nodes in m, shape (n, 3); cells in VTK's order, shape (c, 6 or 10); XDMF's name of the cells."""


class States:
    """States on one mesh, for pictures, tables and what is solved from them.

    Args:
        case: What was run.
        rows: Their rows of ``path.csv``.
        grid: Their mesh.
        read: Returns a nodal field of a state by its number and the field's name; KeyError where there is none.

    Attributes:
        points: Undeformed nodes in device coordinates, m, shape (n, 3).
        cells: Node numbers in VTK's order, shape (c, 10 or 6).
        cell_name: XDMF's name of the cells.
        others: Rows of the silicone's other sources by name; empty where they were not asked for.
        branch: Rows of the branch followed from the first bifurcation; empty if none was.
        made: Where they come from.
    """

    def __init__(self, case: Case, rows: Sequence[Row], grid: NodalGrid, read: Callable[[int, str], Array]):
        self.case, self.rows, self._read = case, list(rows), read
        self.points, self.cells, self.cell_name = grid
        self.others: SourceRows = {}
        self.branch: Sequence[Row] = ()
        self.made = Provenance()

    @property
    def name(self) -> str:
        return self.case.name

    def fields(self, step: int, names: Sequence[str] | None = None) -> Mapping[str, Array]:
        """Return nodal fields of a state by name, all of them for None."""
        raise NotImplementedError

    def restart(self, step: int) -> formats.Restart:
        """Return the numbers that a restart needs beside the fields."""
        raise NotImplementedError

    def mesh(self) -> bytes:
        """Return the device's mesh as a Gmsh file."""
        raise NotImplementedError

    @property
    def actuator(self) -> Actuator:
        return self.case.actuator

    @functools.cached_property
    def words(self) -> StateLabels:
        """Labels of its states."""
        return state_labels(self.case)

    @functools.cached_property
    def skin(self) -> Surface:
        """The surface of the mesh."""
        return surface_of(self.points, self.cells, self.cell_name, self.actuator)

    @property
    def bifurcation(self) -> int | None:
        """The first bifurcation of the path; None if there is none."""
        return next((step for step, row in enumerate(self.rows) if row.get("bifurcation")), None)

    @functools.cached_property
    def sources(self) -> dict[str, Sequence[Row]]:
        """Rows of each source of the silicone, the run's own among them; none where no others were solved."""
        return in_order(self.case, self.rows, self.others)

    def field(self, step: float, name: str) -> Array:
        """Return a nodal field of a state, shape (n,) or (n, 3), SI units; of step 2.5 the mean of steps 2 and 3."""
        begin, share = int(step), step - int(step)
        if not share:
            return np.asarray(self._read(begin, name))
        return (1 - share) * np.asarray(self._read(begin, name)) + share * np.asarray(self._read(begin + 1, name))

    def moved(self, step: float) -> Array:
        """Return the deformed nodes of a state in m, shape (n, 3)."""
        return self.points + self.field(step, "displacement")

    def row(self, step: float) -> Row:
        """Return the row of a state; see `row_at`."""
        return row_at(self.rows, step)

    @functools.cached_property
    def loaded(self) -> list[int]:
        """Steps that are not at rest."""
        return [k for k, row in enumerate(self.rows) if self.words.loaded(row)]

    @functools.cached_property
    def main(self) -> int:
        """The last requested state under load, or the last of all if there is none."""
        asked = [k for k in self.loaded if self.rows[k]["requested"]]
        return asked[-1] if asked else len(self.rows) - 1

    @functools.cached_property
    def along(self) -> Array:
        """Position of each step along the path, from 0 to 1, shape (steps,).

        Of a program by its steps. Else by the pressure where it only rises; past a limit point by the arc length of
        pressure and volume.
        """
        if self.case.program:
            steps = np.array([row["load_step"] for row in self.rows])
            return steps / (steps[-1] or 1.0)
        # Of a dead load its magnitude stands for the pressure, and what it moves for the volume.
        raised, moved = self.words.along
        pressure = np.array([row[raised] for row in self.rows])
        if len(pressure) == 1:
            return np.zeros(1)
        if (np.diff(pressure) > 0).all():
            return np.asarray((pressure - pressure[0]) / (pressure[-1] - pressure[0]))
        path = np.column_stack([pressure, [row[moved] for row in self.rows]])
        size = np.ptp(path, axis=0)
        lengths = np.linalg.norm(np.diff(path, axis=0) / np.where(size > 0, size, 1.0), axis=1)
        along = np.concatenate([[0.0], np.cumsum(lengths)])
        return np.asarray(along / (along[-1] or 1.0))

    def shown(self, most: int = STILLS) -> list[float]:
        """The states to show: the requested ones under load, or some spread over the path, the last included.

        Args:
            most: At most this many; of more requested ones, some are chosen evenly, with the last.

        Returns:
            Their steps. A round pressure between two steps is a fraction: the state there is interpolated.
        """
        asked = [k for k in self.loaded if self.rows[k]["requested"]]
        if len(asked) > most:
            asked = [asked[round(k)] for k in np.linspace(0, len(asked) - 1, most + 1)[1:]]
        if len(asked) >= 2:
            return list[float](asked)
        if not self.loaded:
            return [len(self.rows) - 1]
        if even := [] if self.case.program else round_steps(self.rows[: self.main + 1], self.case.column, most):
            return even
        wanted = np.linspace(0.0, 1.0, most + 1)[1:]
        places = self.along[self.loaded]
        found = {self.loaded[int(np.argmin(np.abs(places - value)))] for value in wanted}
        return list[float](sorted(found | set(asked))[-most:])


class StoredStates(States):
    """The states of a folder of results.

    Args:
        folder: Results with their ``case.toml``.
        name: Stem of the result files; None for the case's own.
        home: Where the mesh is; the same folder if None.

    Raises:
        ResultsError: No results, or none that can be read.
        CaseError: No case file, or a wrong one.
    """

    def __init__(self, folder: Path, name: str | None = None, home: Path | None = None):
        try:
            folder = folder.absolute()  # the caller may change the working directory
        except OSError:
            raise ResultsError(
                f"{folder} is relative to the working directory, which no longer exists; change the working "
                f"directory, or give an absolute path"
            ) from None
        case = Case.from_file(folder / "case.toml") if name is None else None
        self.folder, self.results = folder, Results(folder, name or (case.name if case else ""))
        if not self.results.heavy.exists():
            raise ResultsError(f"{folder} holds no {self.results.heavy.name}, so there is nothing to draw")
        self.results.load()
        if not self.results.rows:
            raise ResultsError(f"the results in {folder} hold no step yet, so there is nothing to draw")
        case = case or Case.from_file(folder / "case.toml")
        with opened(self.results.heavy) as file:
            points, cells = (np.asarray(read_values(file, f"mesh/{name}")) for name in ("points", "cells"))
            grid = points, cells, str(file["mesh"].attrs["cell_name"])
        read = functools.lru_cache(maxsize=24)(lambda step, field: self.fields(step, (field,))[field])
        super().__init__(case, self.results.rows, grid, read)
        self._mesh = (home or folder) / f"{case.name}.msh"
        self.others = read_sources(folder) if isinstance(case.band, SourceBand) else {}
        aside = self.results.branch()
        if aside.heavy.exists():
            aside.load()
        self.branch = aside.rows
        self.made = Provenance.from_table(self.results.own.about.get("made"))

    def branch_states(self) -> StoredStates | None:
        """Return the states of the followed branch; None if there is none."""
        return StoredStates(self.results.branch().folder, None, self.folder) if self.branch else None

    def fields(self, step: int, names: Sequence[str] | None = None) -> Mapping[str, Array]:
        there = self.results.stored[step].shapes
        if missing := [name for name in names or () if name not in there]:
            raise KeyError(missing[0])
        with self._readable():
            found = self.results.fields(step, tuple(there if names is None else names))
        return {name: values.astype(float) for name, values in found.items()}

    def restart(self, step: int) -> formats.Restart:
        return self.results.stored[step].restart

    def mesh(self) -> bytes:
        with self._readable():
            return self._mesh.read_bytes()

    @contextlib.contextmanager
    def _readable(self) -> Iterator[None]:
        """Raise `ResultsError` if the folder has changed since it was loaded."""
        try:
            yield
        except (OSError, KeyError, ResultsError) as error:
            reason = error.strerror if isinstance(error, OSError) and error.strerror else hdf5_reason(error)
            raise ResultsError(
                f"the states in {self.folder} can no longer be read ({reason}); restore the folder, or "
                f"load it from its new place"
            ) from None


def row_at(rows: Sequence[Row], step: float) -> Row:
    """Return the row of a state, of step 2.5 the mean of the numbers of steps 2 and 3."""
    begin, share = int(step), step - int(step)
    if not share:
        return rows[begin]
    pairs = [(name, value, rows[begin + 1].cells.get(name)) for name, value in rows[begin].cells.items()]
    both = [(name, a, b) for name, a, b in pairs if isinstance(a, int | float) and isinstance(b, int | float)]
    return Row((name, (1 - share) * a + share * b) for name, a, b in both)


def round_steps(rows: Sequence[Row], column: str, most: int) -> list[float]:
    """Return where a column has round values, at most ``most``, and the last step; empty unless it only rises, or only falls
    from 0.

    Fractions are between two steps, where the column is taken as straight.
    """
    values = np.array([row[column] for row in rows])
    values = values * np.sign(values[-1])
    if len(values) < 2 or not values[-1] or not (np.diff(values) > 0).all():
        return []
    wide = values[-1] / most
    unit = 10.0 ** np.floor(np.log10(wide))
    wide = next(unit * k for k in (1.0, 2.0, 2.5, 5.0, 10.0) if unit * k >= wide * (1 - 1e-9))
    wanted = wide * np.arange(1, most + 1)
    places = np.interp(wanted[wanted < values[-1] - 0.35 * wide], values, np.arange(len(values)))
    near = places.round()
    return [*np.where(np.abs(places - near) < 1e-6, near, places).tolist(), len(rows) - 1]


# ----------------------------------------------------------------------------------------------------------------------
# Section of a device's outer surface by a plane: the undeformed line and its deformed shape.


BESIDE = 1e-7
"""Offset of the cut from the plane, relative to the device's size, so that vertices in the plane do no harm."""


def cut_line(skin: Surface, points: Array, displacement: Array, normal: Vector, at: float, size: float) -> Array:
    """Return the pieces of the deformed section of the outer surface, in device coordinates (m), shape (k, 2, 3).

    Args:
        skin: The device's surface.
        points: Undeformed nodes, m, shape (n, 3).
        displacement: Of the nodes, m, shape (n, 3).
        normal: Unit normal of the plane that cuts the undeformed device.
        at: Its distance from the origin in m.
        size: Of the device in m.
    """
    rest, moved = (skin.device(skin.points(nodal)) for nodal in (points, points + displacement))
    triangles = skin.device_triangles(skin.part == OUTSIDE)
    height = rest @ np.asarray(normal) - at - BESIDE * size
    above = height[triangles] > 0.0
    hit = triangles[above.any(axis=1) & ~above.all(axis=1)]
    pieces = np.empty((len(hit), 2, 3))
    count = np.zeros(len(hit), dtype=int)
    for a, b in ((0, 1), (1, 2), (2, 0)):
        one, two = hit[:, a], hit[:, b]
        rows = np.flatnonzero((height[one] > 0.0) != (height[two] > 0.0))
        one, two = one[rows], two[rows]
        share = (height[one] / (height[one] - height[two]))[:, None]
        pieces[rows, count[rows]] = moved[one] + share * (moved[two] - moved[one])
        count[rows] += 1
    return pieces


def axes_of(normal: Vector, lift: Vector) -> Array:
    """Return two unit vectors in a plane, shape (2, 3): to the right, mostly along x or y, and upwards along the lift or y."""
    n = np.asarray(normal)
    for up in (np.asarray(lift), np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])):
        across = up - (up @ n) * n
        if np.linalg.norm(across) > 0.1:
            break
    across = across / np.linalg.norm(across)
    right = np.cross(across, n)
    return np.array([right if right[np.argmax(np.abs(right))] > 0.0 else -right, across])
