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

from measurement.series.photo_list import PICTURES, Column, ColumnError, PhotoListError, read_photos
from softmodels.app.jobs import Jobs
from softmodels.app.project import OUTLINES, PHOTOGRAPHS, PHOTOS, SETUP, Handles, Project
from softmodels.app.warm import AnswerError, Warm
from softmodels.common.files import read_text, replace_text, write_bytes
from softmodels.common.tables import TomlError, read_toml
from softmodels.common.units import pascal_per_cm

if TYPE_CHECKING:
    from softmodels.app.tracing import Plane, Preview, Traced

BENCH = "bench.toml"
"""How the screen was found: the photograph of its grid, the pitch, and the lens."""


@dataclasses.dataclass
class Listed:
    """A photograph of the list.

    Attributes:
        file: Its file.
        pressure: As typed; empty until it is.
        preview: As the page shows it.
        traced: Its edge.
        why: Why there is none.
    """

    file: Path
    pressure: str = ""
    preview: Preview | None = None
    traced: Traced | None = None
    why: str = ""


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
        self.grid, self.pitch, self.lens = "", "9mm", "none"
        self.plane: Plane | None = None
        self.error = ""
        self.listed: dict[str, Listed] = {}
        self.typed: dict[str, str] = {}
        self.handles = Handles()
        self.read()

    # -- files --------------------------------------------------------------------------------------------------------

    def read(self) -> None:
        """Read what lies in the project's folder."""
        pressures: dict[str, str] = {}
        if (listing := self.project / PHOTOS).exists():
            try:
                for row in csv.DictReader(io.StringIO(listing.read_text(encoding="utf-8-sig"))):
                    pressures[(row.get("file") or "").rpartition("/")[2]] = row.get("pressure") or ""
            except (OSError, ValueError, csv.Error) as error:
                self.error = f"{PHOTOS} cannot be read ({error})"
        for file in self.project.files(PHOTOGRAPHS, PICTURES):
            self.listed.setdefault(file.name, Listed(file, pressures.get(file.name, "")))
        if (bench := self.project / BENCH).exists():
            try:
                table = read_toml(bench)
                self.grid, self.pitch, self.lens = (str(table.get(key, "")) for key in ("grid", "pitch", "lens"))
            except (OSError, TomlError) as error:
                self.error = f"{BENCH} {error}"

    @property
    def setup(self) -> str:
        """Text of the setup; empty where there is none."""
        try:
            return (self.project / SETUP).read_text(encoding="utf-8")
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

    def write_list(self) -> None:
        """Write ``photos.csv`` of the photographs with a pressure."""
        text = io.StringIO()
        rows = csv.writer(text, lineterminator="\n")
        rows.writerow(("file", "pressure"))
        for one in self.shadows:
            if one.pressure:
                rows.writerow((f"{PHOTOGRAPHS}/{one.file.name}", one.pressure))
        replace_text(self.project / PHOTOS, text.getvalue())

    def pressure_of(self, one: Listed) -> float:
        """Return the pressure in Pa as typed; NaN where there is none.

        Raises:
            ColumnError: It cannot be read.
        """
        return Column().read(one.pressure)[0] if one.pressure else math.nan

    # -- work ---------------------------------------------------------------------------------------------------------

    async def add(self, name: str, data: bytes) -> None:
        """Keep a photograph that was dropped or taken, and find its edge."""
        file = self.project.new_file(PHOTOGRAPHS, name)
        if file.suffix.lower() == ".csv":
            return self.take_list(name, data)
        if file.suffix.lower() not in PICTURES:
            raise AnswerError(f"{name}: not a photograph that can be read; use JPEG, PNG, TIFF or HEIC")
        write_bytes(file, data)
        one = Listed(file, self.typed.get(file.name, ""))
        try:
            one.preview = await self.tracer.ask("preview", str(file))
        except AnswerError as error:
            file.unlink(missing_ok=True)
            raise AnswerError(f"{name}: {error}") from None
        self.listed[file.name] = one
        self.changed.emit(file.name)
        await self.trace(one)

    def take_list(self, name: str, data: bytes) -> None:
        """Take the pressures of a list of photographs that was dropped, for these and those that come.

        Raises:
            AnswerError: It cannot be read.
        """
        with tempfile.TemporaryDirectory() as folder:
            listing = Path(folder) / "photos.csv"
            listing.write_bytes(data)
            try:
                listed = read_photos(listing)
            except PhotoListError as error:
                raise AnswerError(f"{name}: {str(error).replace(str(listing), name)}") from None
        self.typed |= {one.file.name: f"{one.pressure / pascal_per_cm():.7g} cm" for one in listed}
        for one in self.listed.values():
            one.pressure = self.typed.get(one.file.name, one.pressure)
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
        self.plane, self.grid, self.pitch, self.lens = found, grid, pitch, lens
        replace_text(self.project / BENCH, tomli_w.dumps({"grid": grid, "pitch": pitch, "lens": lens}))
        replace_text(self.project / SETUP, found.setup)
        self.handles = Handles()
        self.write_list()
        self.changed.emit(grid)
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
            one.traced = await self.tracer.ask("trace", str(one.file), self.setup, pressure == 0.0, pressure)
            one.why = ""
        except (AnswerError, ColumnError) as error:
            one.traced, one.why = None, str(error)
        self.changed.emit(one.file.name)

    async def begin(self) -> None:
        """Read where the handles of the project's setup are."""
        if self.setup:
            with contextlib.suppress(AnswerError):  # an unusable setup is told when a photograph is traced
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
    """

    def __init__(self, project: Project, address: str = ""):
        self.project, self.address = project, address
        self.solver, self.tracer = Warm("softmodels.app.answers"), Warm("softmodels.app.tracing")
        self.jobs, self.photographs = Jobs(project), Photographs(project, self.tracer)

    async def begin(self) -> None:
        """Load the solver while the user looks at the page, and resume interrupted jobs."""
        self._loading = [asyncio.create_task(asyncio.to_thread(warm.start)) for warm in (self.solver, self.tracer)]
        self._loading.append(asyncio.create_task(self.photographs.begin()))
        self.jobs.begin()

    def end(self) -> None:
        self.jobs.end()
        self.solver.stop()
        self.tracer.stop()
