"""What all tabs of one server share: the project, its photographs, the processes that answer."""

from __future__ import annotations

import asyncio
import contextlib
import csv
import dataclasses
import io
import math
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import tomli_w

from measurement.series.photo_list import ANYWAY, PICTURES, TIMES, Column, ColumnError, PhotoListError, read_photos
from softmodels.app.forms import page_words
from softmodels.app.jobs import Jobs
from softmodels.app.project import AUTO, OUTLINES, PHOTOGRAPHS, PHOTOS, SETUP, FileKind, Handles, Project
from softmodels.app.warm import AnswerError, Warm
from softmodels.common.files import read_text, replace_text
from softmodels.common.tables import TomlError, read_toml
from softmodels.common.units import pascal_per_cm

if TYPE_CHECKING:
    from softmodels.app.tracing import Plane, Preview, Traced

BENCH = "bench.toml"
"""How the screen was found: the photograph of its grid, the pitch, the lens; and how the photographs store light."""
COLUMNS = ("pressure", "error", *TIMES, "use")
"""Columns of the list beside the file's name."""
PHOTOGRAPH = FileKind("photographs", "JPEG, PNG, TIFF or HEIC", PICTURES, 80 << 20)


@dataclasses.dataclass
class Listed:
    """A photograph of the list.

    Attributes:
        file: Its file.
        row: Its row of the list, by `COLUMNS`.
        preview: As the page shows it.
        traced: Its edge.
        why: Why there is none.
    """

    file: Path
    row: dict[str, str] = dataclasses.field(default_factory=lambda: dict.fromkeys(COLUMNS, ""))
    preview: Preview | None = None
    traced: Traced | None = None
    why: str = ""

    @property
    def pressure(self) -> str:
        """As typed; empty until it is."""
        return self.row["pressure"]

    @property
    def anyway(self) -> bool:
        """Whether it shall be used in spite of doubts."""
        return self.row["use"].lower() == ANYWAY

    @property
    def doubts(self) -> str:
        """What speaks against it, in the page's words; empty if nothing does."""
        return page_words(self.why or "; ".join(self.traced.doubts if self.traced else ()))


class Photographs:
    """The photographs of a project, as all tabs see them.

    Args:
        project: The project.
        tracer: The process that traces them.
    """

    def __init__(self, project: Project, tracer: Warm):
        from nicegui import Event

        self.project, self.tracer = project, tracer
        self.changed: Event[str] = Event()
        self.grid, self.pitch, self.lens, self.tone = "", "9mm", "none", AUTO
        self.plane: Plane | None = None
        self.error = ""
        self.listed: dict[str, Listed] = {}
        self.rows: dict[str, dict[str, str]] = {}
        self.handles = Handles()
        self.read()

    # -- files --------------------------------------------------------------------------------------------------------

    def read(self) -> None:
        """Read what lies in the project's folder."""
        if (bench := self.project / BENCH).exists():
            try:
                table = read_toml(bench)
                for key in ("grid", "pitch", "lens", "tone"):
                    setattr(self, key, str(table.get(key, getattr(self, key))))
            except (OSError, TomlError) as error:
                self.error = f"{BENCH} {error}"
        for file in self.project.files(PHOTOGRAPHS, PICTURES):
            self.listed[file.name] = Listed(file)
        if (listing := self.project / PHOTOS).exists():
            try:
                self.take_list(listing)
            except PhotoListError as error:
                self.error = str(error)

    def take_list(self, listing: Path) -> None:
        """Take the rows of a list of photographs, for these and those that come, in its order.

        Raises:
            PhotoListError: It cannot be read.
        """
        for photo in read_photos(listing):
            row = dict(photo.row)
            row.setdefault("pressure", f"{photo.pressure / pascal_per_cm():.7g} cm")
            self.rows[photo.file.name] = {name: row.get(name, "") for name in COLUMNS}
        named = [name for name in self.rows if name in self.listed]
        self.listed = {name: self.listed[name] for name in (*named, *self.listed)}
        for name in named:
            self.listed[name].row = self.rows[name]

    @property
    def setup(self) -> str:
        """Text of the setup; empty where there is none."""
        try:
            return read_text(self.project / SETUP)
        except OSError:
            return ""

    @property
    def shadows(self) -> list[Listed]:
        """All photographs but that of the grid."""
        return [one for one in self.listed.values() if one.file.name != self.grid]

    @property
    def measured(self) -> dict[str, dict[str, str]]:
        """Rows of ``heights.csv`` of the measured photographs, by their files' names."""
        try:
            rows = csv.DictReader(io.StringIO(read_text(self.project / OUTLINES / "heights.csv")))
            return {row["file"]: row for row in rows if row["height_m"]}
        except (OSError, KeyError, ValueError):
            return {}

    async def change(self, one: Listed, **entries: str) -> None:
        """Change entries of a photograph's row, write the list, and trace it anew.

        Raises:
            ColumnError: Its pressure cannot be read; the row stays as it was.
            OSError: The list cannot be written; the same.
        """
        before, one.row = one.row, {**one.row, **entries}
        try:
            self.pressure_of(one)
            self.write_list()
        except (ColumnError, OSError):
            one.row = before
            raise
        await self.trace(one)

    def write_list(self) -> None:
        """Write ``photos.csv`` of the photographs with a pressure, with all columns that their rows have."""
        rows = [{**one.row, "file": f"{PHOTOGRAPHS}/{one.file.name}"} for one in self.shadows if one.pressure]
        text = io.StringIO()
        names = ("file", "pressure", *(name for name in COLUMNS[1:] if any(row[name] for row in rows)))
        table = csv.DictWriter(text, names, extrasaction="ignore", lineterminator="\n")
        table.writeheader()
        table.writerows(rows)
        replace_text(self.project / PHOTOS, text.getvalue())

    def pressure_of(self, one: Listed) -> float:
        """Return the pressure in Pa as typed; NaN where there is none.

        Raises:
            ColumnError: It cannot be read.
        """
        return Column().read(one.pressure)[0] if one.pressure else math.nan

    # -- work ---------------------------------------------------------------------------------------------------------

    async def add(self, name: str, data: bytes) -> None:
        """Keep a photograph that was dropped or taken, and find its edge; or take a list of them.

        Raises:
            AnswerError, FieldError: It is neither.
            OSError: It cannot be written.
        """
        if name.lower().endswith(".csv"):
            return self._add_list(name, data)
        file = self.project.keep(PHOTOGRAPHS, name, data, PHOTOGRAPH)
        one = Listed(file, self.rows.get(file.name, dict.fromkeys(COLUMNS, "")))
        try:
            one.preview = await self.tracer.ask("preview", str(file))
        except AnswerError as error:
            file.unlink(missing_ok=True)
            raise AnswerError(f"{name}: {error}") from None
        self.listed[file.name] = one
        self.changed.emit(file.name)
        await self.trace(one)

    def _add_list(self, name: str, data: bytes) -> None:
        with tempfile.TemporaryDirectory() as folder:
            listing = Path(folder) / PHOTOS
            listing.write_bytes(data)
            try:
                self.take_list(listing)
            except PhotoListError as error:
                raise AnswerError(f"{name}: {str(error).replace(str(listing), name)}") from None
        self.write_list()
        self.changed.emit("")

    async def show(self, one: Listed) -> None:
        """Make a photograph's preview, if there is none yet."""
        if one.preview is None:
            try:
                one.preview = await self.tracer.ask("preview", str(one.file))
            except AnswerError as error:
                one.why = str(error)

    async def find_plane(self, grid: str, pitch: str, lens: str) -> None:
        """Find the screen's plane in the photograph of its grid, and trace all photographs anew.

        Raises:
            AnswerError: There is no such grid.
        """
        found: Plane = await self.tracer.ask("plane", str(self.listed[grid].file), pitch, self._lens(lens))
        replace_text(self.project / SETUP, found.setup)
        self.plane, self.grid, self.pitch, self.lens = found, grid, pitch, lens
        self._write_bench()
        self.handles = Handles()
        self.write_list()
        self.changed.emit(grid)
        await self.trace_all()

    def _write_bench(self) -> None:
        known = {"grid": self.grid, "pitch": self.pitch, "lens": self.lens, "tone": self.tone}
        replace_text(self.project / BENCH, tomli_w.dumps(known))

    async def take_tone(self, tone: str) -> None:
        """Take how the photographs store light, and trace them anew.

        Raises:
            OSError: It cannot be written.
        """
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
        for one in self.shadows:
            await self.trace(one)

    async def trace(self, one: Listed) -> None:
        """Find the edge in a photograph."""
        if not self.setup or one.file.name == self.grid:
            return
        try:
            pressure = self.pressure_of(one)
            one.traced = await self.tracer.ask("trace", str(one.file), self.setup, pressure, self.tone, one.anyway)
            one.why = ""
        except (AnswerError, ColumnError) as error:
            one.traced, one.why = None, str(error)
        self.changed.emit(one.file.name)

    async def begin(self) -> None:
        """Read where the handles of the project's setup are."""
        if self.setup:
            with contextlib.suppress(AnswerError):  # an unusable setup is reported when a photograph is traced
                self.handles = await self.tracer.ask("handles", self.setup)
        await self.trace_all()

    async def move(self, handles: Handles) -> None:
        """Take handles that were dragged, and trace anew.

        Raises:
            AnswerError: They cannot be where they are; the old ones stay.
        """
        replace_text(self.project / SETUP, await self.tracer.ask("moved", self.setup, handles))
        self.handles = handles
        self.changed.emit("")
        await self.trace_all()


class Bench:
    """What all tabs of one server share.

    Args:
        project: The project.
        address: Under which other machines of the network connect, with the key; empty if they may not.

    Attributes:
        solver, tracer: The processes that answer about devices and about photographs.
        slower: Another for what takes longer about devices, so that no slider waits for it.
    """

    def __init__(self, project: Project, address: str = ""):
        self.project, self.address = project, address
        self.solver, self.slower = Warm("softmodels.app.answers"), Warm("softmodels.app.answers")
        self.tracer = Warm("softmodels.app.tracing")
        self.jobs, self.photographs = Jobs(project), Photographs(project, self.tracer)

    async def begin(self) -> None:
        """Load the solver while the user looks at the page, and resume interrupted jobs."""
        self._loading = [asyncio.create_task(asyncio.to_thread(warm.start)) for warm in (self.solver, self.tracer)]
        self._loading.append(asyncio.create_task(self.photographs.begin()))
        self.jobs.begin()

    def end(self) -> None:
        self.jobs.end()
        for warm in (self.solver, self.slower, self.tracer):
            warm.stop()
