"""The page of making: a better device within limits, and the mould to cast one in."""

from __future__ import annotations

from typing import TYPE_CHECKING
from urllib.parse import quote

import tomli_w

from geometries.actuator import is_length, parameter, parameter_names
from softmodels.app.forms import page_words, stored_picture
from softmodels.app.jobs import DONE, Command, Job, job_panel
from softmodels.app.project import RESULTS
from softmodels.case.case import Case
from softmodels.case.entries import INPUT_ERRORS
from softmodels.common.errors import reason
from softmodels.common.files import replace_text
from softmodels.common.units import UnitError, number, readable
from softmodels.materials.silicones import PRODUCTS

if TYPE_CHECKING:
    from softmodels.app.bench import Bench

MOULD, DESIGN = f"{RESULTS}/mould", f"{RESULTS}/design"
PROBLEM = "problem.toml"
OBJECTIVES = {
    "most rise": ("maximise", "rise"),
    "greatest height": ("maximise", "height"),
    "least silicone": ("minimise", "mass"),
    "least peak stretch": ("minimise", "peak_stretch"),
    "least peak stress": ("minimise", "peak_von_mises"),
    "greatest limit pressure": ("maximise", "limit_pressure"),
}
"""Objectives by what the page calls them: their table and quantity."""
LIMITS = {
    "limit pressure over working pressure, at least": ("limit_margin", "at_least"),
    "peak stretch, at most": ("peak_stretch", "at_most"),
    "mass, at most": ("mass", "at_most"),
    "added volume, at most": ("added_volume", "at_most"),
    "every wall and channel, at least": ("clearances", "at_least"),
}
"""Limits by what the page calls them: their quantity and side."""
OF_PROBE = ("rise", "height")
AT_PRESSURE = (*OF_PROBE, "peak_stretch", "peak_von_mises", "added_volume")
REACH = 1.5
"""Bounds of a varied length, as a factor of the present one both ways."""
FILES = (".3mf", ".stl", ".step", ".html", ".md")
"""Endings of the files to download."""


class MouldPage:
    """One tab's page of the mould.

    Args:
        bench: What all tabs share.
    """

    def __init__(self, bench: Bench):
        from nicegui import ui

        self.bench, self.project = bench, bench.project
        with ui.element("div").classes("two-columns"):
            with ui.card().classes("w-full"):
                ui.label("Mould").classes("font-bold")
                self.silicone = ui.select(
                    ["as simulated", *sorted(PRODUCTS)], value="as simulated", label="Silicone to cast"
                )
                self.silicone.classes("w-full").props('dense data-name="cast-silicone"')
                self.settings = {}
                for name, field, default in workshop_fields():
                    self.settings[name] = (
                        ui.input(name.replace("_", " "), placeholder=default)
                        .props("dense stack-label")
                        .classes("w-full")
                    )
                    self.settings[name].tooltip(field).props(f'data-name="mould-{name}"')
                ui.label("Files").classes("font-bold")
                self.files = ui.column().classes("gap-1").props('data-name="mould-files"')
            with ui.column().classes("w-full min-w-0"):
                self.exploded = ui.html("", sanitize=False).classes("w-full").props('data-name="exploded"')
                job_panel(bench.jobs, MOULD, "Make the mould", self._command, f"{MOULD}/sheet.html")
        bench.jobs.changed.subscribe(self._ended)
        self._show()

    def _command(self) -> Command:
        words = ["softmodels", "mould", self.project.case_file(), "-o", MOULD]
        if self.silicone.value != "as simulated":
            words += ["--silicone", str(self.silicone.value)]
        for name, box in self.settings.items():
            if text := str(box.value or "").strip():
                words += [f"--{name.replace('_', '-')}", text]
        return words, MOULD, False

    async def _ended(self, job: Job) -> None:
        if job.output == MOULD and job.state == DONE:
            self._show()

    def _show(self) -> None:
        from nicegui import ui

        self.files.clear()
        self.exploded.set_content(
            stored_picture(self.project, f"{MOULD}/exploded.png", "the mould, its bodies apart along the pull")
        )
        if not (self.project / MOULD).is_dir():
            return
        with self.files:
            for file in sorted(self.project.files(MOULD, FILES), key=lambda file: FILES.index(file.suffix)):
                ui.link(file.name, f"/files/{quote(f'{MOULD}/{file.name}')}").props(f'download="{file.name}"')


class DesignPage:
    """One tab's page of designs.

    Args:
        bench: What all tabs share.
    """

    def __init__(self, bench: Bench):
        from nicegui import ui

        self.bench, self.project = bench, bench.project
        with ui.element("div").classes("two-columns"):
            with ui.card().classes("w-full"):
                self.controls = ui.refreshable(self._controls)
                self.controls()
            with ui.column().classes("w-full min-w-0"):
                self.message = ui.label().classes("text-negative").props('data-name="design-message"')
                job_panel(bench.jobs, DESIGN, "Search", self._command, f"{DESIGN}/report.html")
                ui.button("Use this device", on_click=self._use).props('outline data-name="use-design"')
        self.project.changed.subscribe(lambda file: self.controls.refresh())

    def _controls(self) -> None:
        from nicegui import ui

        device = self.project.case.actuator
        ui.label("What may change").classes("font-bold")
        names = [name for name in parameter_names(device) if is_length(device, name)]
        self.varied = ui.select(names, value=names[:1], label="lengths", multiple=True).props("dense use-chips")
        self.varied.classes("w-full").props('data-name="varied"')
        self.reach = ui.input("from and to, as a factor both ways", value=f"{REACH:g}").props("dense").classes("w-full")
        self.reach.props('data-name="reach"')
        ui.label("What it should do").classes("font-bold")
        self.objective = (
            ui.select(list(OBJECTIVES), value="most rise", label="objective").props("dense").classes("w-full")
        )
        self.objective.props('data-name="objective"')
        self.probe = (
            ui.select(list(device.probes), value=next(iter(device.probes)), label="of").props("dense").classes("w-full")
        )
        highest = max(self.project.case.pressures_cm, default=0.0)
        self.at = (
            ui.input("at", value=f"{highest:g} cm")
            .props("dense")
            .classes("w-full")
            .props('data-name="design-pressure"')
        )
        ui.label("Limits that it keeps").classes("font-bold")
        defaults = {"limit_margin": "1.25", "clearances": "0.8 mm"}
        self.limits = {
            name: ui.input(name, value=defaults.get(quantity, ""))
            .props("dense")
            .classes("w-full")
            .props(f'data-name="keep-{quantity}"')
            for name, (quantity, _) in LIMITS.items()
        }

    def _command(self) -> Command:
        try:
            text = tomli_w.dumps(self._problem())
        except (UnitError, ValueError) as error:
            return str(error)
        replace_text(self.project / PROBLEM, text)
        return ["softmodels", "design", PROBLEM, "-o", DESIGN], DESIGN, True

    def _problem(self) -> dict[str, object]:
        """Return the problem as its file has it."""
        device, reach = self.project.case.actuator, number(str(self.reach.value))
        if not self.varied.value:
            raise ValueError("choose at least one length that may change")
        if not reach > 1.0:
            raise ValueError(f"the factor is {reach:g}; it must be above 1, such as {REACH:g}")
        bounds = {
            name: {
                "from": readable(parameter(device, name) / reach, "m"),
                "to": readable(parameter(device, name) * reach, "m"),
            }
            for name in self.varied.value
        }
        table, quantity = OBJECTIVES[str(self.objective.value)]
        kept = [
            self._asked(LIMITS[name][0]) | {LIMITS[name][1]: _entry(str(box.value))}
            for name, box in self.limits.items()
            if str(box.value or "").strip()
        ]
        return {
            "name": "design",
            "case": self.project.case_file(),
            "parameters": bounds,
            table: self._asked(quantity),
            "keep": kept,
        }

    def _asked(self, quantity: str) -> dict[str, object]:
        asked: dict[str, object] = {"quantity": quantity}
        if quantity in OF_PROBE:
            asked["of"] = self.probe.value
        if quantity in AT_PRESSURE:
            asked["at"] = str(self.at.value)
        return asked

    def _use(self) -> None:
        file = self.project / DESIGN / "design.toml"
        if not file.exists():
            self.message.set_text("there is no design yet: start the search first")
            return
        try:
            self.project.change(actuator=Case.from_file(file).actuator)
            self.message.set_text("")
        except (*INPUT_ERRORS, OSError) as error:
            self.message.set_text(page_words(reason(error)))


def _entry(text: str) -> object:
    """Return a plain number as such, and a text with a unit as it is."""
    try:
        return float(text)
    except ValueError:
        return text


def workshop_fields() -> list[tuple[str, str, str]]:
    """Return name, help and default of each setting of a mould, as texts."""
    from softmodels.casting.settings import Workshop
    from softmodels.common.schema import about, shown

    found = []
    for name, field in about(Workshop).items():
        default = getattr(Workshop, name)
        text = shown(default, field.kind.unit) if isinstance(default, float) else str(default)
        found.append((name, field.help, "" if default is None else text))
    return found
