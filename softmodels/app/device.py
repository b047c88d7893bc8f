"""The page of a device: its lengths, its silicone, its path and a state, as sliders move."""

from __future__ import annotations

import bisect
import contextlib
import csv
import dataclasses
import io
import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from nicegui import ui

from geometries import ACTUATORS, Actuator, actuator, registry
from softmodels.app import bench, forms, jobs, kept
from softmodels.app.bench import Bench
from softmodels.case import load
from softmodels.case.case import Case
from softmodels.common import errors, files, units
from softmodels.materials import silicones
from softmodels.path import steps
from softmodels.runs import table

if TYPE_CHECKING:
    from softmodels.app import replies


OUTPUT = f"{bench.RESULTS}/device"
ABOUT = "Here comes the report of the whole path: pictures, tables, the 3-D view, files for ParaView."


class DevicePage(forms.TabPage):
    """One tab's page of the project's device."""

    def __init__(self, bench: Bench):
        super().__init__(bench)
        self.answer: replies.PathAnswer | None = None
        self.linear: replies.LinearAnswer | None = None
        self.own = False
        with ui.element("div").classes("two-columns picture-first"):
            with ui.column().classes("w-full min-w-0"):
                self.message = forms.tagged(ui.label(), "message", "text-negative", "")
                self.busy = forms.tagged(ui.linear_progress(show_value=False), "busy", "w-full", "indeterminate")
                self.busy.set_visibility(False)
                self.picture = ui.html("", sanitize=False).classes("w-full")
                self.scale = ui.html("", sanitize=False).classes("w-full")
                with ui.row().classes("w-full items-center no-wrap gap-3"):
                    self.slider = ui.slider(min=0.0, max=1.0, step=0.01, value=0.0)
                    forms.tagged(self.slider, "pressure", "grow", 'aria-label="pressure"')
                    self.reading = forms.tagged(ui.label(), "pressure-shown", "w-40 text-right whitespace-nowrap", "")
                self.slider.on_value_change(lambda _: self._show_between())
                self.slider.on("change", lambda _: self._solve_between())
            with ui.card().classes("w-full"):
                self.controls = ui.refreshable(self._controls)
                self.controls()
                kept.KeptDevices(bench)
            with ui.column().classes("w-full min-w-0"):
                self.about = forms.tagged(ui.label(), "linear", "text-sm", "")
                self.error = forms.tagged(ui.label(), "error", "text-sm", "")
                self.numbers = ui.grid(columns="auto auto").classes("gap-x-6 gap-y-0")
                self.chart = ui.echart(_chart([], "", bench.project.case.column.unit)).classes("w-full h-64")
                self.limit = forms.tagged(ui.label(), "limit", "", "")
                self.spread = forms.tagged(ui.label(), "spread", "text-sm", "")
                self.notes = ui.column().classes("gap-1")
                forms.JobPanel(bench, OUTPUT, "Run with all pictures", self._run, f"{OUTPUT}/report.html", ABOUT)
                kept.KeptResults(bench, OUTPUT)
                self._whole_case()
                with ui.expansion("The same in a terminal, and in Python").classes("w-full").props("dense"):
                    self.terminal = forms.tagged(ui.code("", language="bash"), "terminal", props="")
                    self.python = forms.tagged(ui.code("", language="python"), "python", props="")
        self.project.changed.subscribe(self._changed)
        bench.jobs.changed.subscribe(self._ended)
        ui.timer(0.05, self._solve, once=True)
        ui.timer(1.0, self._follow)

    def _run(self) -> jobs.Command:
        return jobs.Command(["softmodels", "run", self.project.case_file(), "-o", OUTPUT], OUTPUT, True)

    # -- controls -----------------------------------------------------------------------------------------------------

    def _controls(self) -> None:
        case = self.project.case
        own_kind = type(case.actuator).__name__
        kinds = sorted(
            name for name, kind in ACTUATORS.items() if name == own_kind or not kind.__dataclass_fields__.get("file")
        )
        device = forms.tagged(ui.select(forms.options(kinds), value=own_kind, label="Device"), "device")
        device.on_value_change(lambda event: self._take_device(event.value))
        forms.field_controls(case.actuator, self._take_field, self._move_field)
        ui.separator()
        known = silicones.named(case.material)
        own = [] if known else [f"{case.material.name.title()} with its own numbers"]
        value = own[0] if own else str(known).partition("/")[0]
        products = ui.select([*own, *sorted(silicones.PRODUCTS)], value=value, label="Silicone", with_input=True)
        forms.tagged(products, "silicone").on_value_change(
            lambda event: (
                self._take(material=silicones.silicone(event.value), band=None) if event.value in silicones.PRODUCTS else None
            )
        )
        values = case.load.of(steps.PRESSURE)
        text = f"{values[0] / case.column.pascal:g}:{case.column.text(values[-1], 'g')}" if values else ""
        box = forms.tagged(ui.input(f"Pressures ({case.column.unit}), or in kPa", value=text), "pressures")
        box.tooltip("such as 0:60 cm, or 0:6 kPa")
        box.on("change", lambda _: self._take_pressures(str(box.value)))
        liquid = forms.tagged(ui.input("Liquid of the column", value=units.exact_text(case.water_density, "kg/m^3")), "liquid")
        liquid.tooltip(f"Its density: centimetres here and on the photographs are of it. 970 kg/m^3 is {units.DENSITY_NOTE}")
        liquid.on("change", lambda _: self._take_liquid(str(liquid.value)))

    def _take_device(self, name: str) -> None:
        kind = ACTUATORS[name]
        section = {"section": "axisymmetric"} if "section" in kind.__dataclass_fields__ else {}
        steps = load.steps_of(pressure_cm=kind.pressures, water_density=self.project.case.water_density)
        self._take(actuator=registry.device_from(kind, section), steps=steps)

    def _take_field(self, name: str, value: object) -> None:
        with self.saying():
            self._take(actuator=forms.with_field(self.project.case.actuator, name, value))

    def _move_field(self, name: str, value: float) -> None:
        """Show the linear answer of a solid while a slider moves."""
        device = self.project.case.actuator
        if self.linear is not None and name in device.movable:
            with contextlib.suppress(errors.GeometryError):
                self._show_linear(actuator.changed(device, {name: value}))

    def _take_pressures(self, text: str) -> None:
        with self.saying():
            self._take(steps=load.steps_of(pressure=text, water_density=self.project.case.water_density))

    def _take_liquid(self, text: str) -> None:
        with self.saying():
            self._take(water_density=text)

    def _take(self, **fields: object) -> None:
        try:
            self.own = "actuator" in fields and type(fields["actuator"]) is type(self.project.case.actuator)
            self.project.change(**fields)
        except forms.ERRORS as error:
            self.own = False
            self.say(errors.reason(error))

    # -- answers ------------------------------------------------------------------------------------------------------

    async def _changed(self, file: str) -> None:
        if file != bench.CASE:
            return
        if not self.own:  # the controls of this tab show its own change already
            self.controls.refresh()
        self.own = False
        self._show_case()
        await self._solve()

    async def _ended(self, job: jobs.Job) -> None:
        if job.output == OUTPUT and not job.active and not is_section(self.project.case.actuator):
            await self._solve()

    async def _solve(self) -> None:
        case, text = self.project.case, self.project.case.to_toml()
        self.say(f"{bench.CASE} cannot be used: {self.project.case_error}" if self.project.case_error else "")
        if not is_section(case.actuator):
            self._wait(False)
            return await self._solve_solid()
        self.linear = None
        self.about.set_text("")
        self._wait(True)
        try:
            answer: replies.PathAnswer = await self.bench.solver.ask("path", text, kind="path")
        except jobs.SupersededError:
            return  # the newer question ends the waiting
        except jobs.AnswerError as error:
            self._wait(False)
            return self.say(str(error))
        self._wait(text != self.project.case.to_toml())
        self.answer, self.text = answer, text
        self.tops = max(state.row.shown("max_von_mises") for state in answer.states)
        both = [curve for state in answer.states for curve in (state.section.edges, state.section.rest)]
        places = np.concatenate([curve.reshape(-1, 2) for curve in both])
        self.box = np.array([places.min(axis=0), places.max(axis=0)])
        self.pressures = [state.row.shown("pressure") for state in answer.states]
        self.scale.set_content(forms.colour_bar(self.tops, answer.colours, "kPa, von Mises stress"))
        top = max(self.pressures)
        self.slider.props(f"max={top} step={top / 500}")
        self.slider.set_value(top)
        self._show(answer.states[self.pressures.index(top)])
        self._plot(table.PathTable(solved.row for solved in answer.states))
        self._report(answer)
        for label in (self.limit, self.error, self.spread):
            label.set_text("")
        for function, labels in (("limit", (self.limit,)), ("errors", (self.error, self.spread))):
            try:
                sentences = await self.bench.slower.ask(function, text, kind=function)
            except jobs.SupersededError:
                return
            except jobs.AnswerError as error:
                sentences = [str(error)]
            if self.text != text:  # another device is shown by now
                return
            for label, sentence in zip(labels, sentences, strict=False):
                label.set_text(sentence)

    def _wait(self, waits: bool) -> None:
        """Show that what is drawn belongs to an older question, until the newest is answered."""
        self.busy.set_visibility(waits)
        for element in (self.picture, self.numbers, self.chart):
            element.classes("outdated") if waits else element.classes(remove="outdated")

    # -- solids -------------------------------------------------------------------------------------------------------

    async def _solve_solid(self) -> None:
        """Show what the last run of this solid has solved, and what follows from it to first order."""
        self.answer = None
        for place in (self.picture, self.scale):
            place.set_content("")
        for label in (self.limit, self.error, self.spread, self.about):
            label.set_text("")
        self.numbers.clear()
        (stored, rows), job = stored_run(self.project), self.bench.jobs.latest(OUTPUT)
        if stored is None or not rows or (job is not None and job.active):
            self.linear = None
            return self.say("this device is a solid: start a run below, its path appears as it is solved")
        self._plot(rows)
        top = float(rows.shown("pressure").max())
        whole = f"von Mises stress of the run's device at {top:.4g} {self.project.case.column.unit}"
        self.picture.set_content(forms.stored_picture(self.project, f"{OUTPUT}/cut.png", f"{whole}, cut open"))
        if self.linear is None or self.linear.case != stored.to_toml():
            self.slider.props(f"max={top} step={top / 500}")
            self.slider.set_value(top)
            await self._linear_at(top)
        elif self.linear is not None:
            self._show_linear(self.project.case.actuator)

    async def _linear_at(self, pressure: float) -> None:
        """Ask for the state of the stored run at a pressure in cm, with its derivatives, and show it."""
        folder = str(self.project / OUTPUT)
        try:
            wanted = pressure * self.project.case.column.pascal
            self.linear = await self.bench.slower.ask("linear", folder, wanted, kind="linear")
        except jobs.SupersededError:
            return
        except jobs.AnswerError as error:
            self.linear = None
            return self.say(str(error))
        self._show_linear(self.project.case.actuator)

    def _show_linear(self, device: Actuator) -> None:
        """Show the first-order answer of a solid with other lengths at the slider's pressure."""
        linear, column = self.linear, self.project.case.column
        if linear is None:
            return
        base, wanted = Case.from_toml(linear.case).actuator, float(self.slider.value or 0.0) * column.pascal
        changes = {name: actuator.parameter(device, name) - actuator.parameter(base, name) for name in linear.by_length}
        solved = device == base and abs(wanted - linear.pressure) <= 1e-3 * column.pascal
        self.reading.set_text(column.full(wanted))
        mark = "" if solved else "  (linear)"
        answer = linear.at(wanted, changes)
        labels = [("pressure", f"{column.full(wanted)} ({wanted / 1e3:.4g} kPa)")]
        labels += [
            (f"rise of the {name.removesuffix('_mm')}" if name.endswith("_mm") else "added volume",
             f"{value:.4g} {name.rpartition('_')[2]}{mark}")
            for name, value in answer.items()
        ]  # fmt: skip
        self._table(labels)
        self.about.set_text(
            "" if solved else f"linear answer from the state solved at {column.full(linear.pressure)}, by its "
            "exact derivatives; start a run for the solved one"
        )  # fmt: skip

    def _follow(self) -> None:
        """Show the path of a solid while its job solves it."""
        job = self.bench.jobs.latest(OUTPUT)
        if job is None or not job.active or is_section(self.project.case.actuator):
            return
        try:
            self._plot(path_rows(self.project / OUTPUT, self.project.case.column.pascal))
        except (OSError, ValueError, KeyError, TypeError):  # not there yet, or a row half written
            return

    def _plot(self, rows: table.PathTable) -> None:
        gauge = self.project.case.actuator.gauge
        if gauge not in rows:
            return
        points = [(row.shown("pressure"), row.shown(gauge)) for row in rows]
        self.chart.options.update(_chart(points, gauge, self.project.case.column.unit))
        self.chart.update()

    def _report(self, answer: replies.PathAnswer) -> None:
        case = self.project.case
        self.notes.clear()
        with self.notes:
            for text in (answer.end, *answer.notes):
                if text:
                    ui.label(forms.page_words(text)).classes("text-sm")
        case_file = self.project / bench.CASE
        file = str(case_file.relative_to(Path.cwd()) if case_file.is_relative_to(Path.cwd()) else case_file)
        self.terminal.set_content(f"uv run softmodels run {shlex.quote(file)}")
        self.python.set_content(forms.python_lines(case, file))

    def _show_between(self) -> None:
        """Show the section at the slider, between the states of the path, while it moves; of a solid its linear answer."""
        if self.answer is None:
            return self._show_linear(self.project.case.actuator)
        wanted, at = float(self.slider.value or 0.0), self.pressures
        rising = at.index(max(at)) + 1
        k = min(max(bisect.bisect_left(at, wanted, hi=rising), 1), rising - 1)
        low, high = self.answer.states[k - 1], self.answer.states[k]
        share = (wanted - at[k - 1]) / (at[k] - at[k - 1]) if at[k] > at[k - 1] else 1.0
        self._draw(low.section.between(high.section, share), wanted)

    async def _solve_between(self) -> None:
        """Show the state at the slider, solved."""
        if self.answer is None:
            return await self._linear_at(float(self.slider.value)) if self.linear is not None else None
        try:
            state = await self.bench.solver.ask("state", self.text, f"{self.slider.value} cm", kind="state")
        except jobs.SupersededError:
            return
        except jobs.AnswerError as error:
            return self.say(str(error))
        self._show(state)

    def _show(self, state: replies.StateAnswer) -> None:
        row = state.row
        self._draw(state.section, row.shown("pressure"))
        self._table(self._figures(row))

    def _table(self, figures: Sequence[tuple[str, str]]) -> None:
        self.numbers.clear()
        with self.numbers:
            for name, text in figures:
                ui.label(name).classes("quiet")
                forms.with_attribute(ui.label(text), "data-name", name)

    def _figures(self, row: table.Row) -> list[tuple[str, str]]:
        probes = [(name, row.told_with_error(name)) for name in row if name in self.project.case.actuator.probes]
        unit = self.project.case.column.unit
        figures = [
            ("pressure", f"{row.shown('pressure'):.4g} {unit} ({row['pressure'] / 1e3:.4g} kPa)"),
            *((f"rise of the {name}", text) for name, text in probes),
            ("added volume", row.told("added_volume")),
            ("largest stretch", row.told("max_stretch")),
            ("largest von Mises stress", row.told("max_von_mises")),
        ]
        assert self.answer is not None
        if self.answer.breaks_at:
            share = (row["max_stretch"] - 1.0) / (self.answer.breaks_at - 1.0)
            figures.append(("share of the strain at break", f"{share:.0%}; {self.answer.breaks}"))
        return figures

    def _draw(self, section: replies.Section, pressure: float) -> None:
        shown = f"{pressure:.4g} {self.project.case.column.unit}"
        text = f"section at {shown}, von Mises stress from 0 to {self.tops:.4g} kPa"
        assert self.answer is not None
        self.picture.set_content(forms.section_svg(section, self.box, self.tops, self.answer.colours, text))
        self.reading.set_text(shown)

    # -- the case's file ----------------------------------------------------------------------------------------------

    def _whole_case(self) -> None:
        """Add the case's file as text, for what has no control: components, regions, programs of loads."""
        with forms.tagged(ui.expansion("The whole case"), "whole-case"):
            ui.label(f"All that {bench.CASE} can say, components too; the documentation has its tables").classes("text-sm")
            looks = 'outlined input-class="case-text" input-style="min-height: 18rem"'
            self.case_text = forms.tagged(ui.textarea(label=bench.CASE), "case-text", "w-full font-mono", looks)
            self.case_why = forms.tagged(ui.label(), "case-why", "text-negative", "")
            with ui.row():
                for title, name, take in (
                    ("Take it", "take-case", lambda: self.project.change_text(str(self.case_text.value or ""))),
                    ("Set it aside, start anew", "set-aside", self.project.set_aside),
                ):
                    self.aside = ui.button(title, on_click=lambda take=take: self._take_case(take))
                    forms.tagged(self.aside, name, "", "outline")
        self._show_case()

    def _show_case(self) -> None:
        self.case_text.set_value(self.project.case_text)
        self.case_why.set_text(self.project.case_error)
        self.aside.set_visibility(bool(self.project.case_error))

    def _take_case(self, take: Callable[[], None]) -> None:
        try:
            take()
        except forms.ERRORS as error:
            self.case_why.set_text(forms.page_words(errors.reason(error)))


GREY = "#808080"
"""Is read on white and on black."""
FAINT_AXES = {"splitLine": {"lineStyle": {"opacity": 0.25}}, "axisLabel": {"color": GREY}}


def stored_run(project: bench.Project) -> tuple[Case | None, table.PathTable]:
    """Return the case of the stored run of a project's device and its path, if it differs from the present case in lengths and
    pressures at most."""
    case, folder = project.case, project / OUTPUT
    try:
        stored = Case.from_file(folder / bench.CASE)
        rows = path_rows(folder, stored.column.pascal)
        same = {name: actuator.parameter(case.actuator, name) for name in stored.actuator.movable}
        like = dataclasses.replace(
            stored, name=case.name, actuator=actuator.changed(stored.actuator, same), steps=case.steps, band=case.band
        )
    except (*forms.ERRORS, ValueError, TypeError, KeyError):
        return None, table.PathTable()
    return (stored, rows) if like == case else (None, table.PathTable())


def path_rows(folder: Path, cm: float) -> table.PathTable:
    """Return the lengths and pressures of a path that is stored, ``cm`` being Pa in one cm of the case's column; OSError,
    ValueError or TypeError if there is none yet, or a row is half written."""
    rows = csv.DictReader(io.StringIO(files.read_text(folder / "path.csv")))
    # A cell is empty where its column has no value, and missing in a row that is half written.
    return table.PathTable.read(
        ({name: float(row[name]) for name in row if name.endswith(("_mm", "_cm")) and row[name] != ""} for row in rows), cm
    )


def is_section(device: Actuator) -> bool:
    return device.dimension == 2


def _chart(points: Sequence[tuple[float, float]], name: str, unit: str) -> dict[str, object]:
    return {
        "animation": False,
        "grid": {"left": 55, "right": 20, "top": 30, "bottom": 45},
        "xAxis": {
            "name": f"pressure in {unit}",
            "nameLocation": "middle",
            "nameGap": 26,
            "nameTextStyle": {"color": GREY},
            **FAINT_AXES,
        },
        "yAxis": {
            "name": f"rise of the {name} in mm" if name else "",
            "nameTextStyle": {"align": "left", "color": GREY},
            **FAINT_AXES,
        },
        "series": [{"type": "line", "data": list(points), "symbolSize": 5}],
        "tooltip": {"trigger": "axis"},
    }
