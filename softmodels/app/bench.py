"""What all tabs of one server share: the project's folder, its photographs, the processes that answer.

The folder holds plain files, which the command line and Python read alike.
"""

from __future__ import annotations

import asyncio
import contextlib
import csv
import dataclasses
import io
import math
import os
import re
import tempfile
import tomllib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

import tomli_w
from nicegui import Event

from geometries import HollowDisk
from measurement.series import photo_list
from softmodels.app import history, jobs, replies
from softmodels.case import entries, load
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.common import errors, files, tables
from softmodels.materials import silicones


class Bench:
    """What all tabs of one server share: the project, the address (with the key) under which other machines of the network
    connect, empty if they may not, and the processes that answer about devices and photographs. ``slower`` is for what takes
    longer about devices, so that no slider waits for it. ``commands`` gives what the newest tab would start, by the folder of
    results."""

    def __init__(self, project: Project, address: str = ""):
        self.project, self.address = project, address
        self.solver, self.slower = jobs.WarmWorker("softmodels.app.answers"), jobs.WarmWorker("softmodels.app.answers")
        self.tracer = jobs.WarmWorker("softmodels.app.tracing")
        self.jobs, self.photographs = jobs.Jobs(project.folder), Photographs(project, self.tracer)
        self.commands: dict[str, Callable[[], jobs.Command | str]] = {}
        self.at_work: Counter[object] = Counter()
        self.worked: Event[object] = Event()
        for changed in (project.changed, self.photographs.changed):
            changed.subscribe(lambda _: project.record())

    async def begin(self) -> None:
        """Load the solver while the user looks at the page, and resume interrupted jobs."""
        self._loading = [asyncio.create_task(asyncio.to_thread(warm.start)) for warm in (self.solver, self.tracer)]
        self._loading.append(asyncio.create_task(self.photographs.begin()))
        self.jobs.begin()

    @contextlib.contextmanager
    def work(self, name: object) -> Iterator[None]:
        """Count a piece of work in ``at_work`` until it is done; all tabs hear of it."""
        self.at_work[name] += 1
        self.worked.emit(name)
        try:
            yield
        finally:
            self.at_work.subtract([name])
            self.at_work += Counter()  # only what is under way
            self.worked.emit(name)

    async def take_samples(self, tell: Callable[[str], object]) -> None:
        """Fill a project without photographs with the sample ones: lens, screen, pressures, device and a curve, as a user would
        by hand; ``tell`` gets a sentence at each step. FieldError for a project that has photographs, AnswerError if a step
        fails, OSError if a file cannot be written."""
        project, photographs = self.project, self.photographs
        if photographs.listed:
            raise errors.FieldError("this project has photographs already; start the page with another folder for the samples")
        made = SAMPLES / "made"
        for file in sorted((made / "boards").iterdir()):
            project.keep(BOARDS, file.name, file.read_bytes(), PHOTOGRAPH)
        files.write_bytes(project / CURVES / "pull.csv", (made / "pull.csv").read_bytes())
        if not (project / CASE).exists():
            project.change_text(files.read_text(SAMPLES / "cases" / "disk.toml"))
        boards = [f"{BOARDS}/{file.name}" for file in project.files(BOARDS, photo_list.PICTURES)]
        lens = self.jobs.start(
            ["measurement", "calibrate", *boards, "--pattern", SQUARES, "--pitch", SQUARE_SIDE, "-o", LENS], LENS
        )
        samples = sorted((made / "photographs").iterdir(), key=lambda file: (file.suffix != ".csv", file.name))
        with project.history.one_step():
            for number, file in enumerate(samples):
                tell(f"photograph {number} of {len(samples) - 1}")
                await photographs.add(file.name, file.read_bytes())
        while lens.active:
            tell("calibrating the lens by photographs of a chessboard")
            await asyncio.sleep(0.3)
        if lens.state != jobs.DONE:
            raise jobs.AnswerError(f"the lens was not calibrated: {self.jobs.log(lens).strip()}")
        tell("finding the grid, and the edge in each photograph")
        await photographs.find_plane(SAMPLE_GRID, photographs.pitch, LENS)
        tell("filled: look at the photographs, then measure all outlines")

    async def step(self, by: int) -> str:
        """Undo some changes of the project's inputs (negative), or redo them; return the sentence of what could not come back.
        OSError if a file cannot be written."""
        lost = self.project.history.go(by)
        await self.read_again()
        return f"another program has taken away {', '.join(lost)}, which cannot come back" if lost else ""

    async def read_again(self) -> None:
        """Show what lies in the project's folder now."""
        self.project.read_again()
        await self.photographs.read_again()

    def end(self) -> None:
        self.jobs.end()
        for warm in (self.solver, self.slower, self.tracer):
            warm.stop()


OUTLINES, LENS = "outlines", "lens.toml"
CASE, PHOTOS, SETUP, FITTED = "case.toml", "photos.csv", "setup.toml", "fitted.toml"
FIT_CASE, MOULD_CASE, DESIGN_CASE = "fit-case.toml", "mould-case.toml", "design-case.toml"
PHOTOGRAPHS, BOARDS, CURVES, PARTS, RESULTS = "photographs", "boards", "curves", "parts", "results"
DEVICES = "devices"
"""Cases under names of their own, as files."""
SAMPLES = Path(__file__).parents[1] / "cli" / "files"
"""The examples that come with the package: `softmodels.cli.examples`."""
SAMPLE_GRID = "grid.jpg"
SQUARES, SQUARE_SIDE = "9x6", "25mm"
"""Inner corners of a chessboard and the side of its squares, until they are given; those of the samples."""
AUTO = "auto"
"""How photographs store light: as their edges show; `measurement.series.measuring.AUTO`, which this process does not import."""
FIRST_PRESSURES = "0:60 cm"
FIRST_SCREEN = "", "9mm", "none", AUTO
"""Photograph of the grid, its pitch, lens and tone until they are given."""
BENCH = "bench.toml"
"""How the screen was found: the photograph of its grid, the pitch, the lens; and how the photographs store light."""
INPUT_TEXTS = {CASE: "device", PHOTOS: "pressures", SETUP: "screen", BENCH: "screen", FITTED: "fitted law"}
INPUT_FOLDERS = {PHOTOGRAPHS: "photograph", BOARDS: "board", CURVES: "curve", PARTS: "part", DEVICES: "kept device"}
"""What a project's results are made of, in words; its changes can be undone."""
COLUMNS = ("pressure", "error", *photo_list.TIMES, "use")
"""Columns of the list beside the file's name."""


@dataclasses.dataclass(frozen=True)
class FileKind:
    """Files that users bring: what they are, in the plural, their formats in words, endings of their names in small letters,
    and bytes of the largest."""

    what: str
    formats: str
    endings: tuple[str, ...]
    largest: int

    @property
    def rejected(self) -> str:
        """The sentence for files that the browser does not send."""
        return f"not taken: {self.what} are {self.formats}, of at most {self.largest >> 20} MB each"


class Project:
    """A project's folder, made where there is none. What several pages show comes from here, so that all tabs show the same.

    ``case`` is the device, its silicone and its load, as in ``case.toml``. While ``case_error`` says why that file cannot be
    used, nothing changes it.
    """

    def __init__(self, folder: Path):
        self.folder = folder.absolute()
        for name in (*INPUT_FOLDERS, RESULTS):
            (self.folder / name).mkdir(parents=True, exist_ok=True)
        self.changed: Event[str] = Event()
        self.case_error = ""
        self.case = self._read_case()
        self.history = history.History(self.folder, INPUT_TEXTS, INPUT_FOLDERS)

    def __truediv__(self, name: str) -> Path:
        return self.folder / name

    # -- the case -----------------------------------------------------------------------------------------------------

    def _read_case(self) -> Case:
        self._text = self.case_error = ""
        try:
            self._text = self._written()
        except OSError as error:
            self.case_error = f"it cannot be read: {errors.reason(error)}"
        if self._text:
            try:
                return Case.from_toml(self._text, self.folder)
            except entries.INPUT_ERRORS as error:
                self.case_error = str(error)
        device, material = HollowDisk(section="axisymmetric"), silicones.silicone("ecoflex-00-30")
        return Case("device", device, material, load.steps_of(pressure=FIRST_PRESSURES))

    def _written(self) -> str:
        """Return the text of ``case.toml``; empty where there is none."""
        file = self / CASE
        return files.read_file(file).decode("utf-8", "replace") if file.exists() else ""

    @property
    def case_text(self) -> str:
        """The case's text: that of its file, if there is one."""
        return self._text or self._text_of(self.case)

    def _text_of(self, case: Case) -> str:
        """Return a case's text in this folder, which may be moved: its files are named from here."""
        places = {file: Path(os.path.normpath(file)) for file in case.files}
        own = {file: place for file, place in places.items() if place.is_relative_to(self.folder)}
        return case.to_toml({file: place.relative_to(self.folder).as_posix() for file, place in own.items()})

    def change(self, **fields: object) -> None:
        """Change fields of the case and write it; all pages follow. It stays as it was after a CaseError or ArgumentError: it
        would be invalid, or what its file holds would be lost. OSError if it cannot be written."""
        self._check_file()
        if self.case_error:
            raise CaseError(f"{CASE} cannot be used ({self.case_error}); correct it under The whole case, or set it aside")
        self._take(changed := dataclasses.replace(self.case, **fields), self._text_of(changed))  # type: ignore[arg-type]

    def change_text(self, text: str) -> None:
        """Take another text of the case; errors as of `change`."""
        self._check_file()
        self._take(Case.from_toml(text, self.folder), text)

    def set_aside(self) -> None:
        """Give a case file that cannot be used another name, and start anew; OSError if it cannot be renamed."""
        (self / CASE).rename(self._free(".", "case-aside", ".toml"))
        self.read_again()

    def _check_file(self) -> None:
        """Read the case again, and say so, if another program has changed its file."""
        if self._written() != self._text:
            self.read_again()
            raise CaseError(f"another program has changed {CASE}, which is shown now; change it again")

    def _take(self, case: Case, text: str) -> None:
        files.write_text(self / CASE, text)
        self.case, self._text, self.case_error = case, text, ""
        self.changed.emit(CASE)

    def read_again(self) -> None:
        """Show the case as its file is now."""
        self.case = self._read_case()
        self.changed.emit(CASE)

    @property
    def task_cases(self) -> dict[str, str]:
        """Texts of the cases that fits, moulds and designs are given, by their files' names: without the load, for fits and
        moulds without the liquid of its column, and for a fit without the material. What does not matter there does not put
        their results out of date."""
        water = self.case.water_density
        designed = dataclasses.replace(self.case, steps=load.steps_of(pressure=FIRST_PRESSURES, water_density=water), band=None)
        usual = {"control": Case.control, "water_density": Case.water_density, "steps": load.steps_of(pressure=FIRST_PRESSURES)}
        made = self._text_of(dataclasses.replace(designed, **usual))  # type: ignore[arg-type]
        device = {name: table for name, table in tomllib.loads(made).items() if name != "material"}
        return {FIT_CASE: tomli_w.dumps(device), MOULD_CASE: made, DESIGN_CASE: self._text_of(designed)}

    def case_for(self, name: str) -> dict[str, str]:
        """Return one of `task_cases` by its file's name."""
        return {name: self.task_cases[name]}

    def case_file(self) -> str:
        """Return the name of the case's file, which is written if it is not there yet."""
        if not (self / CASE).exists():
            self.change()
        return CASE

    # -- files that users bring ---------------------------------------------------------------------------------------

    def keep(self, folder: str, name: str, data: bytes, kind: FileKind) -> Path:
        """Write a file that a user brings, under any name, to a free place in a folder, and return it; FieldError for another
        kind of file, OSError if it cannot be written."""
        wanted = _plain(name)
        stem, suffix = Path(wanted).stem[:80], Path(wanted).suffix[:12]
        if suffix.lower() not in kind.endings:
            raise errors.FieldError(f"{name}: {kind.what} are {kind.formats}")
        place = self._free(folder, stem, suffix)
        files.write_bytes(place, data)
        self.changed.emit(folder)
        return place

    def remove(self, file: Path) -> None:
        """Take a file that a user brought out of its folder, until it is undone; OSError if it cannot be moved."""
        self.history.remove(file)
        self.changed.emit(file.parent.name)

    # -- devices and results under names of their own -------------------------------------------------------------------

    @property
    def devices(self) -> list[Path]:
        """The kept devices."""
        return self.files(DEVICES, DEVICE_FILE.endings)

    def keep_device(self, name: str) -> None:
        """Keep the case under a name, as a file that finds its parts from its own folder; errors as of `keep`."""
        parts = {file: os.path.relpath(file, self / DEVICES) for file in self.case.files}
        text = self.case.to_toml(parts) if parts else self.case_text
        self.keep(DEVICES, f"{name}.toml", text.encode(), DEVICE_FILE)

    def rename_device(self, file: Path, name: str) -> None:
        """Give a kept device another name, or one like it where that is in use; errors as of `keep`."""
        if name != file.stem:
            with self.history.one_step():
                self.duplicate_device(file, name)
                self.remove(file)

    def duplicate_device(self, file: Path, name: str = "") -> None:
        """Keep a copy of a kept device under another name, or one like its own; errors as of `keep`."""
        self.keep(DEVICES, f"{name or file.stem}.toml", files.read_file(file), DEVICE_FILE)

    def open_device(self, file: Path) -> None:
        """Take a kept device as the project's; errors as of `change`."""
        self._check_file()
        case = Case.from_file(file)
        text = self._text_of(case) if case.files else files.read_text(file)
        self._take(Case.from_toml(text, self.folder), text)

    def copies(self, output: str) -> list[Path]:
        """Return the kept copies of a folder of results."""
        return sorted(path for path in self.folder.glob(f"{output}-*") if path.is_dir() and not path.is_symlink())

    def copy_place(self, output: str, name: str) -> Path:
        """Return a free place for a copy of a folder of results under a name."""
        return self._free(".", f"{output}-{_plain(name)[:80]}", "")

    def record(self) -> None:
        """Let the last changes be undone. Where that cannot be written, they stand all the same."""
        with contextlib.suppress(OSError):
            self.history.record()

    def _free(self, folder: str, stem: str, suffix: str) -> Path:
        place, number = self / folder / f"{stem}{suffix}", 2
        while place.exists():
            place, number = self / folder / f"{stem}-{number}{suffix}", number + 1
        return place

    def files(self, folder: str, endings: Iterable[str]) -> list[Path]:
        """Return the files in a folder with some endings, by name."""
        known = {ending.lower() for ending in endings}
        return sorted(path for path in (self / folder).iterdir() if path.suffix.lower() in known)


DEVICE_FILE = FileKind("kept devices", "TOML", (".toml",), 1 << 20)


def _plain(name: str) -> str:
    """Return a file's name for any text: without folders, spaces, and a dot at the beginning."""
    return re.sub(r"[^\w.+-]+", "_", Path(name.replace("\\", "/")).name).lstrip("._") or "file"


# ----------------------------------------------------------------------------------------------------------------------
# Photographs.


PHOTOGRAPH = FileKind("photographs", "JPEG, PNG, TIFF or HEIC", photo_list.PICTURES, 80 << 20)


@dataclasses.dataclass
class ListedPhotograph:
    """A photograph of the list, its row by `COLUMNS`, its preview, and its traced edge, or why there is none."""

    file: Path
    row: dict[str, str] = dataclasses.field(default_factory=lambda: dict.fromkeys(COLUMNS, ""))
    preview: replies.Preview | None = None
    traced: replies.Traced | None = None
    why: str = ""
    question: tuple[str, bool, str, bool] | None = None
    """What it was traced by: text of the setup, whether it shows the undeformed body, tone, whether it is used anyway."""

    @property
    def pressure(self) -> str:
        """As typed; empty until it is."""
        return self.row["pressure"]

    @property
    def anyway(self) -> bool:
        """Whether it shall be used in spite of doubts."""
        return self.row["use"].lower() == photo_list.ANYWAY

    @property
    def doubts(self) -> str:
        """What speaks against it; empty if nothing does."""
        return self.why or "; ".join(self.traced.doubts if self.traced else ())


class Photographs:
    """The photographs of a project, as all tabs see them, and the process that traces them."""

    def __init__(self, project: Project, tracer: jobs.WarmWorker):
        self.project, self.tracer = project, tracer
        self.changed: Event[str] = Event()
        self.grid, self.pitch, self.lens, self.tone = FIRST_SCREEN
        self.plane: replies.Plane | None = None
        self.error = ""
        self.listed: dict[str, ListedPhotograph] = {}
        self.rows: dict[str, dict[str, str]] = {}
        self.handles = replies.Handles()
        self.read()

    # -- files --------------------------------------------------------------------------------------------------------

    def read(self) -> None:
        """Read what lies in the project's folder."""
        if (bench := self.project / BENCH).exists():
            try:
                table = tables.read_toml(bench)
                for key in ("grid", "pitch", "lens", "tone"):
                    setattr(self, key, str(table.get(key, getattr(self, key))))
            except (OSError, tables.TomlError) as error:
                self.error = f"{BENCH} {error}"
        for file in self.project.files(PHOTOGRAPHS, photo_list.PICTURES):
            self.listed[file.name] = ListedPhotograph(file)
        if (listing := self.project / PHOTOS).exists():
            try:
                self.take_list(listing)
            except photo_list.PhotoListError as error:
                self.error = str(error)

    async def read_again(self) -> None:
        """Show what lies in the folder now; what was traced by the same setup stays."""
        before, grid = self.listed, self.grid
        self.listed, self.rows, self.error = {}, {}, ""
        self.grid, self.pitch, self.lens, self.tone = FIRST_SCREEN
        self.read()
        self.plane = self.plane if self.grid == grid else None
        for name in self.listed.keys() & before.keys():
            before[name].row = self.listed[name].row
            self.listed[name] = before[name]
        self.changed.emit("")
        await self.begin()

    async def remove(self, photograph: ListedPhotograph) -> None:
        """Take a photograph out of the project, until it is undone; OSError if it cannot be moved."""
        name = photograph.file.name
        with self.project.history.one_step():
            self.project.remove(photograph.file)
            self.listed.pop(name, None)
            self.rows.pop(name, None)
            self.write_list()
        self.changed.emit("")

    def take_list(self, listing: Path) -> None:
        """Take the rows of a list of photographs, for these and those that come, in its order; PhotoListError if it cannot be
        read."""
        for photo in photo_list.read_photos(listing, self.column):
            row = dict(photo.row)
            row.setdefault("pressure", f"{self.project.case.column.text(photo.pressure, '.7g')}")
            self.rows[photo.file.name] = {name: row.get(name, "") for name in COLUMNS}
        named = [name for name in self.rows if name in self.listed]
        self.listed = {name: self.listed[name] for name in (*named, *self.listed)}
        for name in named:
            self.listed[name].row = self.rows[name]

    @property
    def setup(self) -> str:
        """Text of the setup; empty where there is none."""
        try:
            return files.read_text(self.project / SETUP)
        except OSError:
            return ""

    @property
    def shadows(self) -> list[ListedPhotograph]:
        """All photographs but that of the grid."""
        return [photograph for photograph in self.listed.values() if photograph.file.name != self.grid]

    @property
    def measured(self) -> dict[str, dict[str, str]]:
        """Rows of ``heights.csv`` of the measured photographs, by their files' names."""
        try:
            rows = csv.DictReader(io.StringIO(files.read_text(self.project / OUTLINES / "heights.csv")))
            return {row["file"]: row for row in rows if row["height_m"]}
        except (OSError, KeyError, ValueError):
            return {}

    async def change(self, entries: Mapping[str, Mapping[str, str]]) -> None:
        """Change entries of photographs' rows by the files' names, write the list, and trace them anew. All rows stay as they
        were after a ColumnError (a pressure cannot be read) or OSError (the list cannot be written)."""
        changed = [self.listed[name] for name in entries]
        before = [photograph.row for photograph in changed]
        try:
            for photograph, given in zip(changed, entries.values(), strict=True):
                photograph.row = {**photograph.row, **given}
                self.pressure_of(photograph)
            self.write_list()
        except (photo_list.ColumnError, OSError):
            for photograph, row in zip(changed, before, strict=True):
                photograph.row = row
            raise
        for photograph in changed:
            await self.trace(photograph)

    def write_list(self) -> None:
        """Write ``photos.csv`` of the photographs with a pressure, with all columns that their rows have."""
        rows = [{**shadow.row, "file": f"{PHOTOGRAPHS}/{shadow.file.name}"} for shadow in self.shadows if shadow.pressure]
        text = io.StringIO()
        names = ("file", "pressure", *(name for name in COLUMNS[1:] if any(row[name] for row in rows)))
        table = csv.DictWriter(text, names, extrasaction="ignore", lineterminator="\n")
        table.writeheader()
        table.writerows(rows)
        listing = self.project / PHOTOS
        if not listing.exists() or files.read_file(listing) != text.getvalue().encode():
            files.write_text(listing, text.getvalue())

    def pressure_of(self, photograph: ListedPhotograph) -> float:
        """Return the pressure in Pa as typed; NaN where there is none. ColumnError if it cannot be read."""
        return self.column.read(photograph.pressure)[0] if photograph.pressure else math.nan

    @property
    def column(self) -> photo_list.Column:
        """The column that pressures in cm are read from; its liquid is the case's."""
        return photo_list.Column(self.project.case.water_density)

    # -- work ---------------------------------------------------------------------------------------------------------

    async def add(self, name: str, data: bytes) -> None:
        """Keep a photograph that was dropped or taken, and find its edge; or take a list of them. AnswerError or FieldError
        if it is neither, OSError if it cannot be written."""
        if name.lower().endswith(".csv"):
            return self._add_list(name, data)
        file = self.project.keep(PHOTOGRAPHS, name, data, PHOTOGRAPH)
        photograph = ListedPhotograph(file, self.rows.get(file.name, dict.fromkeys(COLUMNS, "")))
        try:
            photograph.preview = await self.tracer.ask("preview", str(file))
        except jobs.AnswerError as error:
            file.unlink(missing_ok=True)
            raise jobs.AnswerError(f"{name}: {error}") from None
        self.listed[file.name] = photograph
        self.changed.emit(file.name)
        await self.trace(photograph)

    def _add_list(self, name: str, data: bytes) -> None:
        with tempfile.TemporaryDirectory() as folder:
            listing = Path(folder) / PHOTOS
            listing.write_bytes(data)
            try:
                self.take_list(listing)
            except photo_list.PhotoListError as error:
                raise jobs.AnswerError(f"{name}: {str(error).replace(str(listing), name)}") from None
        self.write_list()
        self.changed.emit("")

    async def show(self, photograph: ListedPhotograph) -> None:
        """Make a photograph's preview, if there is none yet."""
        if photograph.preview is None:
            try:
                photograph.preview = await self.tracer.ask("preview", str(photograph.file))
            except jobs.AnswerError as error:
                photograph.why = str(error)

    async def find_plane(self, grid: str, pitch: str, lens: str) -> None:
        """Find the screen's plane in the photograph of its grid, and trace all anew; AnswerError if there is no such grid."""
        plane: replies.Plane = await self.tracer.ask("plane", str(self.listed[grid].file), pitch, self._lens(lens))
        files.write_text(self.project / SETUP, plane.setup)
        self.plane, self.grid, self.pitch, self.lens = plane, grid, pitch, lens
        self._write_bench()
        self.handles = replies.Handles()
        self.write_list()
        self.changed.emit(grid)
        await self.trace_all()

    def _write_bench(self) -> None:
        known = {"grid": self.grid, "pitch": self.pitch, "lens": self.lens, "tone": self.tone}
        files.write_text(self.project / BENCH, tomli_w.dumps(known))

    async def take_tone(self, tone: str) -> None:
        """Take how the photographs store light, and trace them anew; OSError if it cannot be written."""
        before, self.tone = self.tone, tone
        try:
            self._write_bench()
        except OSError:
            self.tone = before
            raise
        await self.trace_all()

    def _lens(self, lens: str) -> str:
        return str(self.project / lens) if lens.endswith(".toml") else lens

    async def trace_all(self) -> None:
        for photograph in self.shadows:
            await self.trace(photograph)

    async def trace(self, photograph: ListedPhotograph) -> None:
        """Find the edge in a photograph, unless it was found by the same question."""
        if not (setup := self.setup) or photograph.file.name == self.grid:
            return
        try:
            question = setup, self.pressure_of(photograph) == 0.0, self.tone, photograph.anyway
            if question != photograph.question:
                photograph.traced = await self.tracer.ask("trace", str(photograph.file), *question)
                photograph.question, photograph.why = question, ""
        except (jobs.AnswerError, photo_list.ColumnError) as error:
            photograph.traced, photograph.why, photograph.question = None, str(error), None
        self.changed.emit(photograph.file.name)

    async def begin(self) -> None:
        """Read where the handles of the project's setup are."""
        if self.setup:
            with contextlib.suppress(jobs.AnswerError):  # an unusable setup is reported when a photograph is traced
                self.handles = await self.tracer.ask("handles", self.setup)
        for photograph in [*self.listed.values()]:
            if photograph.preview is None:
                await self.show(photograph)
                self.changed.emit(photograph.file.name)
        await self.trace_all()

    async def move(self, handles: replies.Handles) -> None:
        """Take handles that were dragged, and trace anew; AnswerError if they cannot be where they are: the old ones stay."""
        files.write_text(self.project / SETUP, await self.tracer.ask("moved", self.setup, handles))
        self.handles = handles
        self.changed.emit("")
        await self.trace_all()
