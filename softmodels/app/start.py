"""The page of the start: ways to begin, and the steps from photographs to the mould with the state of each."""

from __future__ import annotations

import asyncio
import dataclasses
import io
from collections.abc import Callable
from typing import TYPE_CHECKING

from nicegui import ui

from geometries import faces, registry
from softmodels.app import device, forms, jobs, making, packing
from softmodels.app.bench import OUTLINES, PARTS, Bench, FileKind
from softmodels.case import load
from softmodels.common import errors

if TYPE_CHECKING:
    from nicegui.events import MultiUploadEventArguments


@dataclasses.dataclass(frozen=True)
class Step:
    """A step of the project: its page, its folder of results, and what to do there, and after it."""

    page: str
    output: str
    first: str
    then: str


STEPS = (
    Step("Photographs", OUTLINES, "Drop photographs of the shadow, and measure them.", "Fit the material to the outlines."),
    Step("Material", making.FIT, "Fit a law to outlines or to a table of a test machine; or take a named silicone in Device.",
         "Use the fitted law for the device."),
    Step("Device", device.OUTPUT, "Choose a device and move its lengths; run it with all pictures.", "See how it moves."),
    Step("Overlay", "", "Lay the simulated outline over your own photograph.", ""),
    Step("Design", making.DESIGN, "Let a search change lengths within limits.", "Use the device that was found."),
    Step("Mould", making.MOULD, "Make the bodies to print and the sheet for the bench.", "Print, mix, pour."),
)  # fmt: skip
PART = FileKind("parts", "STEP, STL, MSH, VTK, SVG or DXF", tuple(faces.FILE_DEVICES), 80 << 20)
COLOURS = {jobs.DONE: "positive", jobs.FAILED: "negative", forms.OUTDATED: "warning", jobs.RUNNING: "primary"}


class StartPage(forms.TabPage):
    """One tab's page of the start; ``go`` shows another page by its name."""

    def __init__(self, bench: Bench, go: Callable[[str], None]):
        super().__init__(bench)
        self.go = go
        with ui.column().classes("w-full max-w-5xl mx-auto gap-4"):
            ui.label("From photograph to mould").classes("text-xl font-bold")
            with ui.row().classes("w-full gap-3 items-stretch"):
                samples, *_ = (_beginning(*about) for about in (
                    ("auto_awesome", "Try it with sample photographs", "Everything is filled in; a minute.", self._samples),
                    ("photo_camera", "My photographs", "Shadows of a body on a grid, with pressures.",
                     lambda: go("Photographs")),
                    ("science", "My test curves", "Tables of a test machine, as they are.", lambda: go("Material")),
                    ("tune", "A device from the shelf", "Disk, finger, bellows, balloon, cup and more.", lambda: go("Device")),
                ))  # fmt: skip
            with ui.expansion("My own part (STEP, STL), or a drawing of channels (SVG, DXF)").classes("w-full").props("dense"):
                self.support = forms.tagged(ui.input("where it is held", value="x = 0 mm"), "part-support", "w-56", "")
                self.support.tooltip("A plane, or a face as documented: named flange, normal 1, 0, 0 at 5 mm")
                self.upload_box("Drop your part or drawing", PART, ",".join(PART.endings), "part", self._part)
            with ui.expansion("A project as one file (ZIP), to send or to keep").classes("w-full").props("dense"):
                link = ui.link("Download the whole project", forms.zip_address(""))
                forms.tagged(link, "zip-project", "", "download")
                sent = self.upload_box("Drop a project that was sent", packing.ARCHIVE, ".zip", "project", self._sent)
            self.while_working(FILLING, "filling this project", samples, sent)
            self.told = forms.tagged(ui.label(), "start-told", "", "")
            self.message = forms.tagged(ui.label(), "start-message", "text-negative", "")
            self.steps = ui.refreshable(self._steps)
            self.steps()
        for changed in (self.project.changed, bench.photographs.changed, bench.jobs.changed):
            changed.subscribe(lambda _: self.steps.refresh())

    def _steps(self) -> None:
        with ui.element("div").classes("steps"):
            for number, step in enumerate(STEPS, 1):
                state, words = self._state(step)
                with ui.card().classes("cursor-pointer gap-1").on("click", lambda step=step: self.go(step.page)):
                    with ui.row().classes("w-full items-center justify-between no-wrap"):
                        ui.label(f"{number}  {step.page}").classes("font-bold")
                        if state:
                            badge = ui.badge(state, color=COLOURS.get(state, "grey-8"))
                            forms.with_attribute(badge, "data-name", f"step-{step.page}")
                    ui.label(words).classes("text-sm")

    def _state(self, step: Step) -> tuple[str, str]:
        """Return the state of a step, and what comes next."""
        job = self.bench.jobs.shown(step.output) if step.output else None
        if job is None:
            listed = self.bench.photographs.shadows if step.output == OUTLINES else []
            typed = sum(bool(photograph.pressure) for photograph in listed)
            return (
                ("to do", f"{typed} of {len(listed)} photographs have a pressure: measure them.")
                if listed
                else ("", step.first)
            )
        if job.state == jobs.DONE and forms.is_outdated(self.bench, job):
            return forms.OUTDATED, "What it was made of has changed: start it again."
        if job.state == jobs.DONE and step.output == OUTLINES:
            measured = self.bench.photographs.measured.values()
            trusted = sum(row["trusted"] != "no" for row in measured)
            return job.state, f"{len(measured)} measured, {trusted} trusted. {step.then}"
        return job.state, step.then if job.state == jobs.DONE else "" if job.active else "Its page says why."

    async def _samples(self) -> None:
        with self.saying(), self.bench.work(FILLING):
            self.say("")
            await self.bench.take_samples(self.told.set_text)

    async def _sent(self, event: MultiUploadEventArguments) -> None:
        for given in event.files:
            with self.saying(f"{given.name}: "), self.bench.work(FILLING):
                self.say("")
                left_out = await asyncio.to_thread(packing.unpack, io.BytesIO(await given.read()), self.project)
                await self.bench.read_again()
                self.bench.jobs.read()
                others = f"; {left_out} files that are none of a project were left out" if left_out else ""
                self.told.set_text(f"{given.name} is open{others}")

    async def _part(self, event: MultiUploadEventArguments) -> None:
        for given in event.files:
            with self.saying():
                file = self.project.keep(PARTS, given.name, await given.read(), PART)
                device, field = faces.FILE_DEVICES[file.suffix.lower()]
                kind, values = registry.ACTUATORS[device], {field: str(file), "support": str(self.support.value)}
                try:
                    actuator = registry.device_from(kind, values)
                    water = self.project.case.water_density
                    pressures = load.steps_of(pressure_cm=kind.pressures, water_density=water)
                    self.project.change(actuator=actuator, steps=pressures)
                except forms.ERRORS as error:
                    file.unlink(missing_ok=True)
                    raise errors.FieldError(f"{given.name}: {errors.reason(error)}") from None
                self.go("Device")


FILLING = "filling"
"""Work that fills a project: with the samples, or with one that was sent."""


def _beginning(icon: str, title: str, words: str, take: Callable[[], object]) -> ui.button:
    """Add a way to begin in the current place of the page."""
    button = ui.button(on_click=take).props("outline no-caps").classes("p-3 w-full sm:w-56")
    forms.with_attribute(button, "aria-label", title)
    with button, ui.column().classes("items-center gap-1"):
        ui.icon(icon, size="md")
        ui.label(title).classes("font-bold")
        ui.label(words).classes("text-sm quiet")
    return button
