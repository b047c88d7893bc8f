"""The pages of photographs: dropped or taken, their pressures, the grid and the edges drawn on them, with handles; and the
simulated outline over them, pressure by pressure."""

from __future__ import annotations

import base64
import contextlib
import copy
import dataclasses
import math
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from nicegui import ui

from measurement.series import photo_list
from softmodels.app import device, forms, jobs, replies
from softmodels.app.bench import (
    AUTO,
    BOARDS,
    LENS,
    OUTLINES,
    PHOTOGRAPH,
    PHOTOS,
    SETUP,
    SQUARE_SIDE,
    SQUARES,
    Bench,
    ListedPhotograph,
)  # fmt: skip
from softmodels.common import units
from softmodels.common.arrays import Array

if TYPE_CHECKING:
    from nicegui.events import MouseEventArguments, MultiUploadEventArguments


TONE_WORDS = {"srgb": "sRGB, as a camera's JPEG", "linear": "linear, in proportion to the light"}
ABOUT = (
    "Drop the photograph of the empty grid and those of the shadow on the left, type the pressure beside each (0 cm: the "
    "undeformed body), choose the grid's photograph and its pitch, and find the grid. Edges are drawn as they are found. "
    "Here come the measured outlines of all photographs."
)
FINDING, TRACING = "grid", "edges"
"""Work that several tabs share."""
HANDLE_REACH_PX = 40.0
"""Pixels of a preview within which a press takes hold of a handle."""


class PhotographsPage(forms.TabPage):
    """One tab's page of the photographs."""

    def __init__(self, bench: Bench):
        super().__init__(bench)
        self.photos = bench.photographs
        self.shown = next(iter(self.photos.listed), "")
        self.held: tuple[str, int, int] | None = None
        self.handles = copy.deepcopy(self.photos.handles)
        self.scale = 1.0
        with ui.element("div").classes("two-columns"):
            with ui.column().classes("w-full min-w-0"):
                kinds = "image/*,.heic,.tif,.tiff,.csv"
                drop = "Drop photographs here, or take some"
                self.upload_box(drop, PHOTOGRAPH, kinds, "drop", self._uploaded)
                with ui.card().classes("w-full"):
                    self._table()
            with ui.column().classes("w-full min-w-0"):
                self.message = forms.tagged(ui.label(), "photo-message", "text-negative", "")
                image = ui.interactive_image(
                    on_mouse=self._mouse, events=["pointerdown", "pointermove", "pointerup"], sanitize=False
                )
                self.image = forms.tagged(image, "photograph", "w-full photograph", 'aria-label="the photograph with its edge"')
                self.image.set_visibility(False)  # until there is one
                self._controls()
                self.while_working(TRACING, "finding the edges anew")
                self.about = forms.tagged(ui.label(), "about-photograph", "", "")
                forms.JobPanel(bench, OUTLINES, "Measure all outlines", self._measure, f"{OUTLINES}/overview.html", ABOUT)
        self.photos.changed.subscribe(self._changed)
        bench.jobs.changed.subscribe(self._job_changed)
        self.say(self.photos.error)
        ui.timer(0.05, self._show, once=True)

    def _controls(self) -> None:
        """Add what is below the photograph: its doubts, and the handles that cure them."""
        with ui.row().classes("w-full items-center no-wrap gap-3") as self.doubt:
            ui.icon("report_problem", size="sm").props("color=warning")
            self.doubt_words = forms.tagged(ui.label(), "doubts", "grow", "")
            self.anyway = forms.tagged(ui.switch("Use it anyway"), "use-anyway", "shrink-0", "")
            self.anyway.tooltip("The doubts stay in the record of the measurement and of the fit")
            self.doubt.set_visibility(False)
            self.anyway.on("update:model-value", lambda _: self._use())
        with ui.row().classes("gap-4 items-center"):
            switches = []
            for name, tag, value, words in (
                ("Zero line", "zero-line", self.photos.handles.zero, "Two points on the undeformed surface; drag them"),
                ("Region", "region", self.photos.handles.roi, "The shadow is searched only inside; drag its corners"),
            ):
                switch = forms.tagged(ui.switch(name, value=value is not None).tooltip(words), tag, "", "")
                switches.append(switch.on("update:model-value", lambda _: self._toggle()))
            self.with_zero, self.with_roi = switches
            mask = ui.button("Mask", icon="add", on_click=lambda: self._mask(True)).props("flat dense")
            mask.tooltip("A region in which no edge is looked for, such as a label; drag its corners")
            self.cures = {"the Zero line": self.with_zero, "the Region": self.with_roi, "a Mask": mask}
            fewer = ui.button(icon="remove", on_click=lambda: self._mask(False))
            fewer.props('flat dense aria-label="remove the last mask"')

    # -- the list -----------------------------------------------------------------------------------------------------

    def _table(self) -> None:
        """Build the list; what is in it changes in place, so that nobody is interrupted while typing."""
        ui.label("Screen").classes("font-bold")
        with ui.row().classes("w-full items-end no-wrap gap-2"):
            self.grid = forms.tagged(ui.select([], label="photograph of the grid"), "grid", "grow", "")
            self.pitch = forms.tagged(ui.input("pitch", value=self.photos.pitch), "pitch", "w-20", "")
        self.lens = forms.tagged(ui.select([], label="lens correction"), "lens")
        with ui.expansion("Lens from photographs of a board").classes("w-full").props("dense"):
            drop, kinds = "Drop ten photographs of a chessboard", "image/*,.heic,.tif,.tiff"
            self.upload_box(drop, PHOTOGRAPH, kinds, "boards", self._boards)
            self.boards = forms.tagged(ui.label(), "boards-given", "", "")
            self.pattern = forms.tagged(ui.input("inner corners", value=SQUARES), "pattern", "")
            self.square = forms.tagged(ui.input("side of a square", value=SQUARE_SIDE), "square", "")
            forms.JobPanel(self.bench, LENS, "Calibrate", self._calibrate)
        tones = {AUTO: "tone: as the edge shows", **{name: f"tone: {words}" for name, words in TONE_WORDS.items()}}
        tone = ui.select(tones, value=self.photos.tone, label="how the photographs store light")
        self.tone = forms.tagged(tone, "tone").on_value_change(self._tone)
        find = forms.tagged(ui.button("Find the grid", on_click=self._find), "find-grid", "")
        self.while_working(FINDING, "finding the grid, then the edges", find)
        ui.label("Photographs").classes("font-bold")
        self.liquid = forms.tagged(ui.label(), "liquid-shown", "text-sm", "")
        self.rows: dict[str, PhotographRow] = {}
        self.listing = ui.column().classes("w-full gap-1")
        self._update()

    def _update(self) -> None:
        """Show what the list is now."""
        names = list(self.photos.listed)
        if self.grid.options != names:
            self.grid.set_options(names)
        self.grid.set_value(self.grid.value or self.photos.grid or None)
        files = self.project.files(".", (".toml",))
        lenses = ["none", "auto", *(file.name for file in files if file.name.startswith("lens"))]
        if self.lens.options != lenses:
            self.lens.set_options(lenses, value=self.photos.lens if self.photos.lens in lenses else "none")
        count = len(self.project.files(BOARDS, photo_list.PICTURES))
        unit = self.project.case.column.unit
        self.liquid.set_text(f"Pressures in {unit} (the liquid is set beside the device's pressures), or in kPa")
        self.boards.set_text(f"{count} photographs of the board" if count else "")
        shown = {shadow.file.name: shadow for shadow in self.photos.shadows}
        for name in [name for name in self.rows if name not in shown]:
            self.rows.pop(name).whole.delete()
        for name, photograph in shown.items():
            if name not in self.rows:
                self.rows[name] = self._row(name)
            row = self.rows[name]
            icon, colour = _mark(photograph)
            row.mark.set_name(icon)
            row.mark.props(f"color={colour}")
            row.about.set_text(forms.page_words(photograph.doubts) or "edge found")
            row.pressure.set_value(photograph.pressure)
            if photograph.preview is not None:
                row.picture.set_source(jpeg_source(photograph.preview.small))
        if list(self.rows) != list(shown):
            self.rows = {name: self.rows[name] for name in shown}
            for place, row in enumerate(self.rows.values()):
                row.whole.move(target_index=place)

    def _row(self, name: str) -> PhotographRow:
        """Add a photograph to the list."""
        with self.listing, ui.row().classes("w-full items-center no-wrap gap-2") as whole:
            choose = ui.button(on_click=lambda: self._choose(name)).props("flat dense no-caps align=left")
            with choose.classes("grow min-w-0"), ui.row().classes("items-center no-wrap gap-2 min-w-0"):
                picture = ui.image().classes("w-12 h-9 shrink-0 rounded").props('fit=contain alt=""')
                ui.label(name).classes("truncate")
            box = ui.input(placeholder="12.5 cm").props("dense").classes("w-24 shrink-0")
            forms.with_attribute(box, "aria-label", f"pressure of {name}")
            box.on("change", lambda _: self._change(name, {name: {"pressure": str(box.value).strip(), "error": ""}}))
            box.on("paste", lambda event: self._paste(name, str(event.args)), js_handler=PASTED_LINES)
            mark = ui.icon("hourglass_empty")
            with mark:
                about = ui.tooltip("")
            self.remove_button(name, lambda: self.photos.remove(self.photos.listed[name]))
        return PhotographRow(whole, picture, box, mark, about)

    async def _paste(self, name: str, text: str) -> None:
        """Fill the boxes from one on with lines of a spreadsheet."""
        names = list(self.rows)[list(self.rows).index(name) :]
        pressures = pasted_pressures(text)
        if len(pressures) > len(names):
            return self.say(f"{len(pressures)} pressures were pasted for {len(names)} photographs: paste at the first of them")
        entries = zip(names, ({"pressure": pressure, "error": ""} for pressure in pressures), strict=False)
        return await self._change("pasted pressures", dict(entries))

    async def _boards(self, event: MultiUploadEventArguments) -> None:
        await self.keep(event, BOARDS, PHOTOGRAPH)
        self._update()

    def _calibrate(self) -> jobs.Command | str:
        files = [f"{BOARDS}/{file.name}" for file in self.project.files(BOARDS, photo_list.PICTURES)]
        if not files:
            return "drop photographs of the board first"
        options = ["--pattern", str(self.pattern.value), "--pitch", str(self.square.value), "-o", LENS]
        return jobs.Command(["measurement", "calibrate", *files, *options], LENS)

    async def _find(self) -> None:
        if not self.grid.value:
            return self.say("choose the photograph that shows the grid")
        with self.saying(), self.bench.work(FINDING):
            await self.photos.find_plane(str(self.grid.value), str(self.pitch.value), str(self.lens.value))
            self.say("")
        return None

    async def _change(self, about: str, entries: Mapping[str, Mapping[str, str]]) -> None:
        with self.saying(f"{about}: "):
            await self.photos.change(entries)
            self.say("")

    async def _use(self) -> None:
        if self.shown in self.photos.listed:
            await self._change(self.shown, {self.shown: {"use": photo_list.ANYWAY if self.anyway.value else ""}})

    async def _tone(self) -> None:
        if self.tone.value != self.photos.tone:
            with self.saying(), self.bench.work(TRACING):
                await self.photos.take_tone(str(self.tone.value))

    async def _uploaded(self, event: MultiUploadEventArguments) -> None:
        with self.project.history.one_step():
            for file in event.files:
                with self.saying():
                    await self.photos.add(file.name, await file.read())
        self.shown = self.shown or next(iter(self.photos.listed), "")
        await self._show()

    async def _job_changed(self, job: jobs.Job) -> None:
        if job.output == LENS:
            self._update()
        elif job.output == OUTLINES:
            await self._show()

    async def _choose(self, name: str) -> None:
        self.shown = name
        await self._show()

    async def _changed(self, name: str) -> None:
        if not self.shown and name:
            self.shown = name
        if name == self.photos.grid:  # the plane was found, perhaps by another tab
            self.lens.set_value(self.photos.lens)
            self.pitch.set_value(self.photos.pitch)
            self.grid.set_value(name)
        self._update()
        self._settled()
        if name in ("", self.shown):
            await self._show()
        else:
            self._draw()

    # -- the picture --------------------------------------------------------------------------------------------------

    async def _show(self) -> None:
        if self.shown not in self.photos.listed:  # it was taken away
            self.shown = next(iter(self.photos.listed), "")
        photograph = self.photos.listed.get(self.shown)
        if photograph is None:
            self.image.set_visibility(False)
            self.about.set_text("")
            return
        await self.photos.show(photograph)
        if photograph.preview is None:
            return self.say(photograph.why)
        source, self.scale = picture_of(photograph.preview)
        self.image.set_source(source)
        self.image.set_visibility(True)
        self._draw()
        traced = photograph.traced
        words = [photograph.file.name, f"{photograph.preview.width} x {photograph.preview.height} px"]
        if photograph.file.name == self.photos.grid and self.photos.plane is not None:
            plane = self.photos.plane
            words.append(f"{len(plane.crossings)} crossings, residual to the plane {plane.residual * 1e6:.3g} um (rms)")
        height, error = (None, None) if traced is None else (traced.height, traced.height_error)
        if (row := self.photos.measured.get(photograph.file.name)) is not None:
            height, error = float(row["height_m"]), float(row["height_error_m"])
        if height is not None and error is not None:
            words.append(f"height {units.with_error(height * 1e3, error * 1e3, 'mm', '±')}")
        if traced is not None:
            wide = f", drawn {traced.enlarged} times as wide" if traced.enlarged > 1 else ""
            words.append(f"band: its standard error{wide}")
        self.about.set_text("; ".join(words))
        self._doubt(photograph)

    def _doubt(self, photograph: ListedPhotograph) -> None:
        """Show what speaks against a photograph, which handle may cure it, and whether it shall be used anyway."""
        doubts = forms.page_words(photograph.doubts)
        verdict = "refused" if photograph.why else "not trusted, used anyway" if photograph.anyway else "not trusted"
        self.doubt_words.set_text(f"{verdict}: {doubts}" if doubts else "")
        self.doubt.set_visibility(bool(doubts) or photograph.anyway)
        self.anyway.set_value(photograph.anyway)
        for name, control in self.cures.items():
            control.classes("cures") if name in doubts else control.classes(remove="cures")

    def _draw(self) -> None:
        photograph = self.photos.listed.get(self.shown)
        if photograph is None or photograph.preview is None:
            return
        scale = self.scale
        drawn: list[str] = []
        if photograph.file.name == self.photos.grid and self.photos.plane is not None:
            crossings = self.photos.plane.crossings / scale
            drawn += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4"/>' for x, y in crossings]
        if photograph.traced is not None:
            edge, (inner, outer) = photograph.traced.edge, photograph.traced.band
            for part in _parts(edge):
                band = points_text(np.concatenate([inner[part], outer[part][::-1]]), scale)
                drawn += [f'<polygon class="band" points="{band}"/>',
                          f'<polyline class="traced" points="{points_text(edge[part], scale)}"/>']  # fmt: skip
            if photograph.traced.zero is not None and self.handles.zero is None:
                drawn.append(f'<polyline class="zero" points="{points_text(photograph.traced.zero, scale)}"/>')
        handles = self.handles
        if handles.zero is not None:
            drawn.append(f'<polyline class="zero" points="{points_text(np.array(handles.zero), scale)}"/>')
        for name, box in (("roi", handles.roi), *(("mask", mask) for mask in handles.masks)):
            if box is not None:
                x0, y0, x1, y1 = (value / scale for value in box)
                left, top, wide, tall = min(x0, x1), min(y0, y1), abs(x1 - x0), abs(y1 - y0)
                place = f'x="{left:.1f}" y="{top:.1f}" width="{wide:.1f}" height="{tall:.1f}"'
                drawn.append(f'<rect class="{name}" {place}/>')
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

    def _preview(self) -> replies.Preview | None:
        photograph = self.photos.listed.get(self.shown)
        if not self.photos.setup:
            self.say("find the grid first")
            return None
        return None if photograph is None else photograph.preview

    async def _move(self, handles: replies.Handles) -> None:
        handles.settle()
        with self.saying(), self.bench.work(TRACING):
            await self.photos.move(handles)
            self.say("")
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
            self.held = near if near is not None and math.dist((x, y), corners[near]) < HANDLE_REACH_PX * self.scale else None
        elif self.held is not None:
            self.handles.drag(self.held, x, y)
            self._draw()
            if event.type == "pointerup":
                self.held = None
                await self._move(self.handles)

    # -- all of them --------------------------------------------------------------------------------------------------

    def _measure(self) -> jobs.Command | str:
        """Return the command that measures all; a sentence where it cannot be given yet."""
        if not self.photos.setup:
            return "choose the photograph that shows the grid, and find the grid first"
        try:
            self.photos.write_list()
            listed = photo_list.read_photos(self.photos.project / PHOTOS, self.photos.column)
        except (photo_list.PhotoListError, OSError) as error:
            return f"{error}; type the pressures beside the photographs"
        if not any(photo.is_zero for photo in listed) and self.handles.zero is None:
            return "none of the photographs is at zero pressure: type 0 cm beside it, or drag the zero line"
        words = ["measurement", "photos", PHOTOS, "--setup", SETUP, "-o", OUTLINES]
        words += ["--tone", self.photos.tone] if self.photos.tone != AUTO else []
        density = self.photos.column.density
        words += ["--water-density", units.exact_text(density, "kg/m^3")] if density != units.WATER_DENSITY else []
        return jobs.Command(words, OUTLINES)


@dataclasses.dataclass(frozen=True)
class PhotographRow:
    """What the list shows of a photograph."""

    whole: ui.row
    picture: ui.image
    pressure: ui.input
    mark: ui.icon
    about: ui.tooltip


PASTED_LINES = """event => {
  const text = event.clipboardData.getData("text");
  if (/\\S[\\r\\n]+\\s*\\S/.test(text)) { event.preventDefault(); emit(text); }
}"""
"""Takes what is pasted if it has several lines; one line goes into the box."""


def pasted_pressures(text: str) -> list[str]:
    """Return the pressures in lines that were copied from a spreadsheet, the last cell of each, without a heading. A number
    without a unit has that of the line before."""
    cells = [cell for line in text.splitlines() if (cell := line.split("\t")[-1].strip())]
    pressures, unit = [], ""
    for cell in cells[1:] if cells and not re.search(r"\d", cells[0]) else cells:
        number, own = re.fullmatch(r"([-+\d.,]*(?:[eE][-+]?\d+)?)\s*(.*)", cell).groups()  # type: ignore[union-attr]
        unit = own or unit
        pressures.append(f"{number} {unit}".strip())
    return pressures


def _mark(photograph: ListedPhotograph) -> tuple[str, str]:
    if photograph.why:
        return "block", "negative"
    if photograph.traced is None:
        return "hourglass_empty", "grey"
    return ("help", "warning") if photograph.traced.doubts else ("check_circle", "positive")


def picture_of(preview: replies.Preview) -> tuple[str, float]:
    """Return a preview as a source for the page, and how many pixels of the photograph one of it spans."""
    longest = max(preview.width, preview.height)
    return jpeg_source(preview.jpeg), longest / min(replies.PREVIEW_SIDE_PX, longest)


def jpeg_source(jpeg: bytes) -> str:
    """Return a picture as a source for the page."""
    return "data:image/jpeg;base64," + base64.b64encode(jpeg).decode()


def points_text(px: Array, scale: float) -> str:
    """Return points in px of a photograph as SVG has them in its preview."""
    return " ".join(f"{x / scale:.2f},{y / scale:.2f}" for x, y in px if math.isfinite(x + y))


def _parts(px: Array) -> list[npt.NDArray[np.intp]]:
    """Return the numbers of an edge's points in pieces without gaps, at most a thousand of them."""
    chosen = np.arange(0, len(px), max(1, len(px) // 1000))
    gaps = np.linalg.norm(np.diff(px[chosen], axis=0), axis=1)
    cut = np.flatnonzero(gaps > 10 * max(float(np.median(gaps)), 1e-9)) + 1
    return [piece for piece in np.split(chosen, cut) if len(piece) > 1]


# ----------------------------------------------------------------------------------------------------------------------
# The simulated outline over the photographs.


class OverlayPage(forms.TabPage):
    """One tab's page of the simulated outline over the photographs."""

    def __init__(self, bench: Bench):
        super().__init__(bench)
        self.message = forms.tagged(ui.label(), "overlay-message", "text-negative", "")
        with ui.row().classes("w-full items-center gap-3"):
            chosen = ui.select([], label="Photograph", on_change=self._show)
            self.chosen = forms.tagged(chosen, "overlay-photograph", "w-72", "")
            draw = forms.tagged(ui.button("Draw", on_click=self._refresh), "overlay-draw", "", "outline")
            self.while_working(self, "computing the outline", draw)
            self.about = forms.tagged(ui.label(), "overlay-about", "", "")
        words = 'aria-label="the photograph with the simulated outline"'
        self.image = forms.tagged(ui.interactive_image(sanitize=False), "overlay", "w-full photograph", words)
        self.image.set_visibility(False)
        bench.jobs.changed.subscribe(lambda job: self._list() if job.output == OUTLINES else None)
        self._list()

    def _list(self) -> None:
        self.measured = {name: float(row["pressure_Pa"]) for name, row in self.bench.photographs.measured.items()}
        self.chosen.set_options(list(self.measured))

    async def _refresh(self) -> None:
        self._list()
        if not self.measured:
            self.say("there are no outlines yet: measure the photographs first")
        elif self.chosen.value is None:
            self.chosen.set_value(list(self.measured)[-1])
        else:
            await self._show()

    async def _show(self) -> None:
        name = self.chosen.value
        with contextlib.suppress(jobs.SupersededError), self.saying(), self.bench.work(self):
            self.say(await self._draw(name) if name else "")

    async def _draw(self, name: str) -> str:
        """Draw the outline over a photograph; return the sentence why it cannot be drawn."""
        photos, case = self.bench.photographs, self.project.case
        solid = "" if device.is_section(case.actuator) else str(self.project / device.OUTPUT)
        if solid and ((stored := device.stored_run(self.project)[0]) is None or stored.actuator != case.actuator):
            return "this device is a solid: run it first, on the page Device"
        photograph, pressure = photos.listed.get(name), self.measured[name]
        if photograph is None:
            return f"{name} is no longer among the photographs"
        curve = await self.bench.slower.ask("outline", case.to_toml(), pressure, solid, kind="outline")
        file, listing = self.project / OUTLINES / f"{photograph.file.stem}.csv", self.project / PHOTOS
        overlay: replies.Overlay = await self.bench.tracer.ask(
            "overlay", str(listing), photos.setup, str(file), curve, case.actuator.axial
        )
        await photos.show(photograph)
        if photograph.preview is None:
            return photograph.why
        source, scale = picture_of(photograph.preview)
        self.image.set_source(source)
        self.image.set_visibility(True)
        self.image.set_content(f'<polyline class="simulated" points="{points_text(overlay.curve, scale)}"/>')
        self.about.set_text(
            f"{case.column.full(pressure)}; measured and simulated heights differ by {overlay.difference * 1e6:.3g} um (rms)"
        )
        return ""
