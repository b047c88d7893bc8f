"""The page of photographs: dropped or taken, their pressures, the grid and the edges drawn on them, with handles."""

from __future__ import annotations

import base64
import copy
import math
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from measurement.series.photo_list import ANYWAY, PICTURES, ColumnError, PhotoListError, read_photos
from softmodels.app.bench import PHOTOGRAPH
from softmodels.app.forms import page_words, upload_box
from softmodels.app.jobs import Command, Job, job_panel
from softmodels.app.project import AUTO, BOARDS, LENS, OUTLINES, PHOTOS, PREVIEW, SETUP, Handles
from softmodels.app.warm import AnswerError
from softmodels.common.arrays import Array
from softmodels.common.errors import FieldError, reason

if TYPE_CHECKING:
    from nicegui.elements.icon import Icon
    from nicegui.elements.input import Input
    from nicegui.elements.row import Row
    from nicegui.elements.tooltip import Tooltip
    from nicegui.events import MouseEventArguments, MultiUploadEventArguments

    from softmodels.app.bench import Bench, Listed
    from softmodels.app.tracing import Preview, Traced

TONE_WORDS = {"srgb": "sRGB, as a camera's JPEG", "linear": "linear, in proportion to the light"}
REACH = 40.0
"""Pixels of a preview within which a press takes hold of a handle."""


class PhotographsPage:
    """One tab's page of the photographs.

    Args:
        bench: What all tabs share.
    """

    def __init__(self, bench: Bench):
        from nicegui import ui

        self.bench, self.photos = bench, bench.photographs
        self.shown = next(iter(self.photos.listed), "")
        self.held: tuple[str, int, int] | None = None
        self.handles = copy.deepcopy(self.photos.handles)
        self.scale = 1.0
        with ui.element("div").classes("two-columns"):
            with ui.column().classes("w-full min-w-0"):
                self.upload = upload_box(
                    "Drop photographs here, or take them", PHOTOGRAPH, "image/*,.heic,.tif,.tiff,.csv", "drop",
                    self._uploaded, self._say,
                )  # fmt: skip
                with ui.card().classes("w-full"):
                    self._table()
            with ui.column().classes("w-full min-w-0"):
                self.message = ui.label().classes("text-negative").props('data-name="photo-message"')
                self.image = (
                    ui.interactive_image(
                        on_mouse=self._mouse, events=["pointerdown", "pointermove", "pointerup"], sanitize=False
                    )
                    .classes("w-full photograph")
                    .props('data-name="photograph" aria-label="the photograph with its edge"')
                )
                self.image.set_visibility(False)  # until there is one
                with ui.row().classes("w-full items-center no-wrap gap-3") as self.doubt:
                    ui.icon("report_problem", size="sm").props("color=warning")
                    self.doubt_words = ui.label().classes("grow").props('data-name="doubts"')
                    self.anyway = ui.switch("Use it anyway").props('data-name="use-anyway"').classes("shrink-0")
                    self.anyway.tooltip("The doubts stay in the record of the measurement and of the fit")
                    self.doubt.set_visibility(False)
                    self.anyway.on("update:model-value", lambda _: self._use())
                with ui.row().classes("gap-4 items-center"):
                    self.with_zero = ui.switch("Zero line", value=self.photos.handles.zero is not None)
                    self.with_zero.tooltip("Two points on the undeformed surface; drag them").props(
                        'data-name="zero-line"'
                    )
                    self.with_zero.on("update:model-value", lambda _: self._toggle())
                    self.with_roi = ui.switch("Region", value=self.photos.handles.roi is not None)
                    self.with_roi.tooltip("The shadow is searched only inside; drag its corners").props(
                        'data-name="region"'
                    )
                    self.with_roi.on("update:model-value", lambda _: self._toggle())
                    mask = ui.button("Mask", icon="add", on_click=lambda: self._mask(True)).props("flat dense")
                    mask.tooltip("A region in which no edge is looked for, such as a label; drag its corners")
                    self.cures = {"the Zero line": self.with_zero, "the Region": self.with_roi, "a Mask": mask}
                    ui.button(icon="remove", on_click=lambda: self._mask(False)).props(
                        'flat dense aria-label="remove the last mask"'
                    )
                self.about = ui.label().props('data-name="about-photograph"')
                job_panel(bench.jobs, OUTLINES, "Measure all outlines", self._measure, f"{OUTLINES}/overview.html")
        self.photos.changed.subscribe(self._changed)
        bench.jobs.changed.subscribe(self._job_changed)
        self._say(self.photos.error)
        ui.timer(0.05, self._show, once=True)

    # -- the list -----------------------------------------------------------------------------------------------------

    def _table(self) -> None:
        """Build the list; what is in it changes in place, so that nobody is interrupted while typing."""
        from nicegui import ui

        ui.label("Screen").classes("font-bold")
        with ui.row().classes("w-full items-end no-wrap gap-2"):
            self.grid = ui.select([], label="photograph of the grid").classes("grow").props('data-name="grid"')
            self.pitch = ui.input("pitch", value=self.photos.pitch).classes("w-20").props('data-name="pitch"')
        self.lens = ui.select([], label="lens correction").classes("w-full").props('dense data-name="lens"')
        with ui.expansion("Lens from photographs of a board").classes("w-full").props("dense"):
            kinds = "image/*,.heic,.tif,.tiff"
            upload_box("Drop ten photographs of a chessboard", PHOTOGRAPH, kinds, "boards", self._boards, self._say)
            self.boards = ui.label().props('data-name="boards-given"')
            self.pattern = ui.input("inner corners", value="9x6").props('dense data-name="pattern"')
            self.square = ui.input("side of a square", value="25mm").props('dense data-name="square"')
            job_panel(self.bench.jobs, LENS, "Calibrate", self._calibrate)
        tones = {AUTO: "tone: as the edge shows", **{name: f"tone: {words}" for name, words in TONE_WORDS.items()}}
        self.tone = ui.select(tones, value=self.photos.tone, label="how the photographs store light")
        self.tone.classes("w-full").props('dense data-name="tone"')
        self.tone.on_value_change(self._tone)
        self.find = ui.button("Find the grid", on_click=self._find).props('dense data-name="find-grid"')
        ui.label("Photographs").classes("font-bold")
        self.rows: dict[str, tuple[Row, Input, Icon, Tooltip]] = {}
        self.listing = ui.column().classes("w-full gap-1")
        self._update()

    def _update(self) -> None:
        """Show what the list is now."""
        from nicegui import ui

        names = list(self.photos.listed)
        if self.grid.options != names:
            self.grid.set_options(names)
        self.grid.set_value(self.grid.value or self.photos.grid or None)
        files = self.photos.project.files(".", (".toml",))
        lenses = ["none", "auto", *(file.name for file in files if file.name.startswith("lens"))]
        if self.lens.options != lenses:
            self.lens.set_options(lenses, value=self.photos.lens if self.photos.lens in lenses else "none")
        count = len(self.photos.project.files(BOARDS, PICTURES))
        self.boards.set_text(f"{count} photographs of the board" if count else "")
        shown = {one.file.name: one for one in self.photos.shadows}
        for name in [name for name in self.rows if name not in shown]:
            self.rows.pop(name)[0].delete()
        for name, one in shown.items():
            if name not in self.rows:
                with self.listing, ui.row().classes("w-full items-center no-wrap gap-2") as row:
                    ui.button(name, on_click=lambda _, name=name: self._choose(name)).props(
                        "flat dense no-caps align=left"
                    ).classes("grow truncate")
                    box = ui.input(value=one.pressure, placeholder="12.5 cm").props("dense").classes("w-24")
                    box.props(f'aria-label="pressure of {_attribute(name)}"')
                    box.on("change", lambda _, one=one, box=box: self._pressure(one, str(box.value)))
                    icon = ui.icon("hourglass_empty")
                    with icon:
                        tooltip = ui.tooltip("")
                self.rows[name] = row, box, icon, tooltip
            _, box, icon, tooltip = self.rows[name]
            name_of_icon, colour = _mark(one)
            icon.set_name(name_of_icon)
            box.set_value(one.pressure)
            icon.props(f"color={colour}")
            tooltip.set_text(one.doubts or "edge found")

    async def _boards(self, event: MultiUploadEventArguments) -> None:
        for given in event.files:
            try:
                self.photos.project.keep(BOARDS, given.name, await given.read(), PHOTOGRAPH)
            except (FieldError, OSError) as error:
                self._say(reason(error))
        self._update()

    def _calibrate(self) -> Command:
        files = [f"{BOARDS}/{file.name}" for file in self.photos.project.files(BOARDS, PICTURES)]
        if not files:
            return "drop photographs of the board first"
        words = [
            "measurement",
            "calibrate",
            *files,
            "--pattern",
            str(self.pattern.value),
            "--pitch",
            str(self.square.value),
        ]
        return [*words, "-o", LENS], LENS, False

    async def _find(self) -> None:
        if not self.grid.value:
            return self._say("choose the photograph that shows the grid")
        self.find.props("loading")
        try:
            await self.photos.find_plane(str(self.grid.value), str(self.pitch.value), str(self.lens.value))
            self._say("")
        except (AnswerError, OSError) as error:
            self._say(reason(error))
        finally:
            self.find.props(remove="loading")

    async def _pressure(self, one: Listed, text: str) -> None:
        await self._change(one, pressure=text.strip(), error="")

    async def _change(self, one: Listed, **entries: str) -> None:
        try:
            await self.photos.change(one, **entries)
            self._say("")
        except (ColumnError, OSError) as error:
            self._say(f"{one.file.name}: {reason(error)}")

    async def _use(self) -> None:
        if (one := self.photos.listed.get(self.shown)) is not None:
            await self._change(one, use=ANYWAY if self.anyway.value else "")

    async def _tone(self) -> None:
        if self.tone.value != self.photos.tone:
            try:
                await self.photos.take_tone(str(self.tone.value))
            except OSError as error:
                self._say(reason(error))

    async def _uploaded(self, event: MultiUploadEventArguments) -> None:
        for file in event.files:
            try:
                await self.photos.add(file.name, await file.read())
            except (AnswerError, FieldError, OSError) as error:
                self._say(reason(error))
        self.upload.reset()
        if not self.shown:
            self.shown = next(iter(self.photos.listed), "")
        await self._show()

    async def _job_changed(self, job: Job) -> None:
        if job.output == LENS:
            self._update()
        elif job.output == OUTLINES:
            await self._show()

    def _say(self, sentence: str) -> None:
        self.message.set_text(page_words(sentence))

    async def _choose(self, name: str) -> None:
        self.shown = name
        await self._show()

    async def _changed(self, name: str) -> None:
        self._update()
        self._settled()
        if name in ("", self.shown):
            await self._show()
        else:
            self._draw()

    # -- the picture --------------------------------------------------------------------------------------------------

    async def _show(self) -> None:
        one = self.photos.listed.get(self.shown)
        if one is None:
            return
        await self.photos.show(one)
        if one.preview is None:
            return self._say(one.why)
        source, self.scale = picture_of(one.preview)
        self.image.set_source(source)
        self.image.set_visibility(True)
        self._draw()
        traced = one.traced
        words = [one.file.name, f"{one.preview.width} x {one.preview.height} px"]
        if one.file.name == self.photos.grid and self.photos.plane is not None:
            plane = self.photos.plane
            words.append(f"{len(plane.crossings)} crossings, residual to the plane {plane.residual * 1e6:.3g} um (rms)")
        height, error = (None, None) if traced is None else (traced.height, traced.height_error)
        if (row := self.photos.measured.get(one.file.name)) is not None:
            height, error = float(row["height_m"]), float(row["height_error_m"])
        if height is not None and error is not None:
            words.append(f"height {height * 1e3:.4f} mm ± {error * 1e6:.1f} um")
        if traced is not None:
            wide = f", drawn {traced.enlarged} times as wide" if traced.enlarged > 1 else ""
            words.append(f"band: its standard error{wide}")
        self.about.set_text("; ".join(words))
        self._doubt(one)

    def _doubt(self, one: Listed) -> None:
        """Show what speaks against a photograph, which handle may cure it, and whether it shall be used anyway."""
        doubts = one.doubts
        verdict = "refused" if one.why else "not trusted, used anyway" if one.anyway else "not trusted"
        self.doubt_words.set_text(f"{verdict}: {doubts}" if doubts else "")
        self.doubt.set_visibility(bool(doubts) or one.anyway)
        self.anyway.set_value(one.anyway)
        for name, control in self.cures.items():
            control.classes("cures") if name in doubts else control.classes(remove="cures")

    def _draw(self) -> None:
        one = self.photos.listed.get(self.shown)
        if one is None or one.preview is None:
            return
        scale = self.scale
        drawn: list[str] = []
        if one.file.name == self.photos.grid and self.photos.plane is not None:
            drawn += [
                f'<circle cx="{x / scale:.1f}" cy="{y / scale:.1f}" r="4"/>' for x, y in self.photos.plane.crossings
            ]
        if one.traced is not None:
            drawn += [f'<polygon class="band" points="{piece}"/>' for piece in _bands(one.traced, scale)]
            drawn += [f'<polyline class="traced" points="{piece}"/>' for piece in _pieces(one.traced.edge, scale)]
            if one.traced.zero is not None and self.handles.zero is None:
                drawn.append(f'<polyline class="zero" points="{points_text(one.traced.zero, scale)}"/>')
        handles = self.handles
        if handles.zero is not None:
            drawn.append(f'<polyline class="zero" points="{points_text(np.array(handles.zero), scale)}"/>')
        for name, box in (("roi", handles.roi), *(("mask", mask) for mask in handles.masks)):
            if box is not None:
                x0, y0, x1, y1 = (value / scale for value in box)
                left, top, wide, tall = min(x0, x1), min(y0, y1), abs(x1 - x0), abs(y1 - y0)
                drawn.append(
                    f'<rect class="{name}" x="{left:.1f}" y="{top:.1f}" width="{wide:.1f}" height="{tall:.1f}"/>'
                )
        places = [(x / scale, y / scale) for x, y in handles.corners.values()]
        drawn += [f'<circle class="handle" cx="{x:.1f}" cy="{y:.1f}" r="12"/>' for x, y in places]
        self.image.set_content("".join(drawn))

    # -- handles ------------------------------------------------------------------------------------------------------

    async def _toggle(self) -> None:
        """Show or remove the zero line and the region."""
        preview, handles = self._preview(), copy.deepcopy(self.photos.handles)
        if preview is None:
            return
        w, h = preview.width, preview.height
        if self.with_zero.value and handles.zero is None:
            traced = self.photos.listed[self.shown].traced
            seen = None if traced is None or traced.zero is None else traced.zero.tolist()
            handles.zero = seen or [[0.2 * w, 0.6 * h], [0.8 * w, 0.6 * h]]
        elif not self.with_zero.value:
            handles.zero = None
        if self.with_roi.value and handles.roi is None:
            handles.roi = [0.05 * w, 0.05 * h, 0.95 * w, 0.95 * h]
        elif not self.with_roi.value:
            handles.roi = None
        await self._move(handles)

    async def _mask(self, more: bool) -> None:
        """Add a mask in the middle, or remove the last one."""
        preview, handles = self._preview(), copy.deepcopy(self.photos.handles)
        if preview is None:
            return
        if more:
            w, h = preview.width, preview.height
            handles.masks.append([0.45 * w, 0.45 * h, 0.55 * w, 0.55 * h])
        else:
            del handles.masks[-1:]
        await self._move(handles)

    def _preview(self) -> Preview | None:
        one = self.photos.listed.get(self.shown)
        if not self.photos.setup:
            self._say("find the grid first")
            return None
        return None if one is None else one.preview

    async def _move(self, handles: Handles) -> None:
        handles.settle()
        try:
            await self.photos.move(handles)
            self._say("")
        except (AnswerError, OSError) as error:
            self._say(reason(error))
        self._settled()
        self._draw()

    def _settled(self) -> None:
        """Show the handles where they are now, for all tabs."""
        if self.held is None:
            self.handles = copy.deepcopy(self.photos.handles)
            self.with_zero.set_value(self.handles.zero is not None)
            self.with_roi.set_value(self.handles.roi is not None)

    async def _mouse(self, event: MouseEventArguments) -> None:
        x, y = event.image_x * self.scale, event.image_y * self.scale
        corners = self.handles.corners
        if event.type == "pointerdown":
            near = min(corners, key=lambda corner: math.dist((x, y), corners[corner]), default=None)
            self.held = near if near is not None and math.dist((x, y), corners[near]) < REACH * self.scale else None
        elif self.held is not None:
            self.handles.drag(self.held, x, y)
            self._draw()
            if event.type == "pointerup":
                self.held = None
                await self._move(self.handles)

    # -- all of them --------------------------------------------------------------------------------------------------

    def _measure(self) -> Command:
        """Return the command that measures all; a sentence where it cannot be given yet."""
        if not self.photos.setup:
            return "choose the photograph that shows the grid, and find the grid first"
        try:
            self.photos.write_list()
            listed = read_photos(self.photos.project / PHOTOS)
        except (PhotoListError, OSError) as error:
            return f"{error}; type the pressures beside the photographs"
        if not any(photo.is_zero for photo in listed) and self.handles.zero is None:
            return "none of the photographs is at zero pressure: type 0 cm beside it, or drag the zero line"
        words = ["measurement", "photos", PHOTOS, "--setup", SETUP, "-o", OUTLINES]
        words += ["--tone", self.photos.tone] if self.photos.tone != AUTO else []
        return words, OUTLINES, False


def _attribute(name: str) -> str:
    """Return a file's name as it can stand between quotes of an element's properties."""
    return name.replace('"', "").replace("\\", "")


def _mark(one: Listed) -> tuple[str, str]:
    if one.why:
        return "block", "negative"
    if one.traced is None:
        return "hourglass_empty", "grey"
    return ("help", "warning") if one.traced.doubts else ("check_circle", "positive")


def picture_of(preview: Preview) -> tuple[str, float]:
    """Return a preview as a source for the page, and how many pixels of the photograph one of it spans."""
    longest = max(preview.width, preview.height)
    return "data:image/jpeg;base64," + base64.b64encode(preview.jpeg).decode(), longest / min(PREVIEW, longest)


def points_text(px: Array, scale: float) -> str:
    """Return points in px of a photograph as SVG has them in its preview."""
    return " ".join(f"{x / scale:.2f},{y / scale:.2f}" for x, y in px if math.isfinite(x + y))


def _pieces(px: Array, scale: float) -> list[str]:
    """Return the points of an edge in pieces without gaps."""
    return [points_text(px[part], scale) for part in _parts(px)]


def _bands(traced: Traced, scale: float) -> list[str]:
    """Return the outlines of the band of an edge's error, piece by piece."""
    one, other = traced.band
    return [points_text(np.concatenate([one[part], other[part][::-1]]), scale) for part in _parts(traced.edge)]


def _parts(px: Array) -> list[npt.NDArray[np.intp]]:
    """Return the numbers of an edge's points in pieces without gaps, at most a thousand of them."""
    chosen = np.arange(0, len(px), max(1, len(px) // 1000))
    gaps = np.linalg.norm(np.diff(px[chosen], axis=0), axis=1)
    cut = np.flatnonzero(gaps > 10 * max(float(np.median(gaps)), 1e-9)) + 1
    return [piece for piece in np.split(chosen, cut) if len(piece) > 1]
