"""A results folder that is readable at any moment, even if the run is interrupted.

New results are prepared in a subfolder, and replace those of an earlier run once their first step is stored. Each step is
written to its own file under a temporary name and renamed; the light files (XDMF, CSV) are rewritten after each step. A
finished run merges the steps into one HDF5 file. Used on rank 0 only, without MPI.

The formats of its files are in `softmodels.runs.formats`.
"""

from __future__ import annotations

import dataclasses
import errno
import json
import math
import os
import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path

import h5py
import numpy as np
import numpy.typing as npt

from softmodels.case import materials
from softmodels.case.case import Case
from softmodels.common import errors, files, folders
from softmodels.common.files import hdf5_reason, remove_steps, replace, replace_hdf5
from softmodels.runs import columns, formats, table
from softmodels.runs.budget import Budget
from softmodels.runs.formats import write_light

RUN, BRANCH = "run", "branch/"
"""Kind of a run in a folder's record; subfolder for the branch at its bifurcation."""


class Results:
    """Results of one run, in a folder that is made if missing, with files of the stem ``name``, and a picture of the device's
    `Actuator.gauge`.

    Attributes:
        own: The folder's record, of what kind the results are.
        folder: Where the files are: in ``own``, or aside of the earlier results until the first step is there.
        stored: The states, in their order.
        later: By number, those of the run that is resumed which are found again: each stays until a new one has come as far.
        started: When the run that writes them began (`time.monotonic`); None if unknown.
        cm: Pa in one cm of the case's column; None for the usual liquid.
    """

    def __init__(self, folder: Path, name: str, gauge: str = "apex", kind: str = RUN, cm: float | None = None):
        self.own = folders.OwnFolder(folder, kind)
        self.folder, self.name, self.gauge, self.cm = folder, name, gauge, cm
        self.stored: list[formats.StoredStep] = []
        self.later: dict[int, formats.StoredStep] = {}
        self._about: dict[str, object] = {}
        self.format = FORMAT_NUMBER
        self.started: float | None = None

    @property
    def heavy(self) -> Path:
        return self.folder / f"{self.name}.h5"

    @property
    def steps(self) -> Path:
        return self.folder / f"{self.name}.steps"

    @property
    def rows(self) -> table.PathTable:
        return table.PathTable(step.row for step in self.stored)

    def branch(self) -> Results:
        """Results of the branch at this path's bifurcation, in their own folder, which may not exist."""
        return Results(self.own.path / BRANCH.strip("/"), self.name, self.gauge, "branch", self.cm)

    @property
    def branch_rows(self) -> table.PathTable:
        """Rows of the followed branch; empty if there is none."""
        branch = self.branch()
        if branch.heavy.exists():
            branch.load()
        return branch.rows

    @property
    def mesh_notes(self) -> list[str]:
        """Recorded warnings about the mesh."""
        return list(self.own.about.get("mesh_notes", ()))

    def write_beside(self, sources: columns.SourceTables, meshes: columns.MeshTables) -> None:
        """Write the paths of the silicone's other sources, and those on other meshes, if any."""
        if sources:
            self.own.claim([columns.FILE])
            columns.write_sources(self.folder, sources)
        for name, rows in meshes.items():
            self.own.claim([columns.MESH_FILES[name]])
            files.write_text(self.folder / columns.MESH_FILES[name], rows.csv())

    def meshes(self, case: Case) -> columns.MeshTables:
        """Return the tables of the path on other meshes; empty if none was solved."""
        return columns.read_meshes(self.folder, case.column.pascal)

    def sources(self, case: Case) -> dict[str, table.PathTable]:
        """Return the table of each source of the silicone, the run's own included; empty if no others were solved."""
        return columns.in_order(
            case,
            self.rows,
            columns.read_sources(self.folder, case.column.pascal) if isinstance(case.band, materials.SourceBand) else {},
        )

    def budget(self, case: Case) -> Budget:
        """Return what is known of the errors of the run's numbers."""
        return Budget(case, self.rows, self.meshes(case), self.sources(case))

    @property
    def files(self) -> list[str]:
        """Names of the files of a run, pictures excluded."""
        own = (f"{self.name}{end}" for end in (".h5", ".xdmf", ".vtkhdf", ".msh", ".steps/"))
        return ["case.toml", *own, "path.csv", columns.FILE, *columns.MESH_FILES.values(), "summary.json", INPUTS]

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
        pictures.take(folders.DRAWING_TIMEOUT)  # a drawing process may be using them
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
            file.attrs["format"] = FORMAT_NUMBER

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
        """Load the results of an earlier run, to draw it or to ``go_on``, which needs a run of this version; `ResultsError` if
        that fails."""
        if not self.heavy.exists():
            raise ResultsError(f"{self.folder} holds no {self.heavy.name}, so there is no run to resume")
        if self.steps.is_symlink():
            raise ResultsError(f"{self.steps} is a link, but the steps of a run must be in its own folder; remove it")
        steps: dict[int, formats.StoredStep] = {}
        try:
            with formats.opened(self.heavy) as file:
                self.format = int(file.attrs.get("format", 0))
                if self.format > FORMAT_NUMBER or (go_on and self.format < FORMAT_NUMBER):
                    raise self.other_format()
                points, cells = formats.inside(file, "mesh/points").shape, formats.inside(file, "mesh/cells").shape
                self._shapes = (points[0], cells, str(formats.inside(file, "mesh").attrs["cell_name"]))
                for group in formats.inside(file, "steps") if "steps" in file else ():
                    step = formats.inside(file, f"steps/{group}")
                    steps[int(group)] = formats.read_step(step, self.heavy.name, f"/steps/{group}", self.cm)
            for path in sorted(self.steps.glob("*.h5")):
                with formats.opened(path) as file:
                    steps[int(path.stem)] = formats.read_step(file, f"{self.steps.name}/{path.name}", "", self.cm)
        except ResultsError:
            raise
        except (OSError, KeyError, ValueError, TypeError, AttributeError, RuntimeError) as error:
            raise ResultsError(f"the results in {self.folder} cannot be read ({hdf5_reason(error)})") from error
        self.stored, self.later = [steps[step] for step in not_passed(steps)], {}

    def other_format(self, missing: str = "") -> ResultsError:
        """Return the error of results in another format than this version's, perhaps with what they are missing."""
        later = self.format > FORMAT_NUMBER
        text = f"{self.folder} was written by {'a later' if later else 'an earlier'} version of softmodels"
        without = f" without {missing}" if missing else ""
        return ResultsError(
            f"{text} (format {self.format}, not {FORMAT_NUMBER}){without}; {'update softmodels' if later else RERUN_ADVICE}"
        )

    def add(self, record: formats.StateRecord) -> None:
        """Store one state."""
        row, restart, fields = record.row, record.restart, record.fields.items()
        flat = {name: values if values.ndim < 3 else values.reshape(-1, formats.TENSOR_COMPONENTS) for name, values in fields}
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
        known = dict(enumerate(self.stored))
        self.later = {step: self.later[step] for step in not_passed(self.later | known) if step not in known}
        self.write_light()
        if self.folder != self.own.path:
            self._bring_in()

    def fields(self, step: int, names: tuple[str, ...]) -> dict[str, npt.NDArray[np.float64]]:
        """Return the nodal fields of a stored step."""
        if not (self.folder / self.stored[step].file).exists():
            self.load()  # the run that wrote it has merged its steps meanwhile
        stored = self.stored[step]
        with formats.opened(self.folder / stored.file) as file:
            fields = {name: np.asarray(formats.read_values(file, f"{stored.group}/{name}")) for name in names}
        return {
            name: values.reshape(-1, 3, 3) if values.shape[1:] == (formats.TENSOR_COMPONENTS,) else values
            for name, values in fields.items()
        }

    def write_summary(self, summary: Mapping[str, object], made: Mapping[str, object]) -> None:
        """Write what there is to say of a run, with its number of states and its last one; ``made`` is how it was made."""
        self.own.claim(["summary.json"], {"made": made})
        text = json.dumps({**summary, "steps": len(self.stored), "last": self.stored[-1].row.cells}, indent=2)
        files.write_text(self.folder / "summary.json", f"{text}\n")

    def finish(self) -> None:
        """Merge all steps into one HDF5 file, with every step readable at any moment; without room (`OSError`) all steps stay
        where they are."""
        self.stored, self.later = [*self.stored, *self.later.values()], {}
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
        write_light(self.heavy, self._shapes, [*self.stored, *self.later.values()], gathered)


PICTURES = ("profile", "loop", "mesh", "slice", "mode", "undeformed", "cut", "hot-spots", "stress",
            *(f"stress-{k}" for k in range(1, 5)))  # fmt: skip
"""Stems of the pictures other than the one named after the gauge."""
PAGES = ("film.gif", "film.webp", "film.mp4", "report.html")
FORMAT_NUMBER = 5
"""Of the stored steps, in the HDF5 file's attribute ``format``. An older one is read, but not resumed."""
RERUN_ADVICE = "run its case.toml again into another folder (--output), without --resume"
INPUTS = "files/"
"""Subfolder for copies of a case's input files, such as a part's mesh."""


def picture_files(gauge: str) -> list[str]:
    """Return the file names of a run's pictures, film and report."""
    return [*(f"{picture}.png" for picture in (*PICTURES, gauge)), *PAGES]


def picture_folder(folder: Path) -> folders.OwnFolder:
    """Return the record of the pictures in a results folder, separate from the run's because they are also drawn during it."""
    return folders.OwnFolder(folder, "pictures", part="pictures")


def not_passed(steps: Mapping[int, formats.StoredStep]) -> list[int]:
    """Return the numbers of the states of one path, in order, without those of an interrupted program that the states of a
    resumed one have passed: it may take other steps in time, and fewer."""
    reached, numbers = -math.inf, []
    for number in sorted(steps):
        row = steps[number].row
        load_step = row.get("load_step", math.inf)
        if reached < load_step:
            numbers.append(number)
            reached = load_step if load_step < math.inf and (row["requested"] or "time" in row) else reached
    return numbers


class ResultsError(errors.OptionMessage, RuntimeError):
    """Results cannot be read or resumed; the message is for the user."""
