"""The page of a device: its lengths, its silicone, its path and a state, as sliders move."""

from __future__ import annotations

import bisect
import contextlib
import csv
import dataclasses
import io
import shlex
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from geometries import ACTUATORS, Actuator, registry
from geometries.actuator import changed, parameter
from softmodels.app.drawing import Section, colour_bar, section_svg
from softmodels.app.forms import field_controls, page_words, python_lines, stored_picture, with_field
from softmodels.app.jobs import Command, Job, job_panel
from softmodels.app.project import CASE, RESULTS
from softmodels.app.warm import AnswerError, SupersededError
from softmodels.case.case import Case, in_unit
from softmodels.case.entries import INPUT_ERRORS
from softmodels.common.errors import GeometryError, reason
from softmodels.common.files import read_text
from softmodels.materials.silicones import PRODUCTS, named, silicone

if TYPE_CHECKING:
    from softmodels.app.answers import LinearAnswer, PathAnswer, StateAnswer
    from softmodels.app.bench import Bench
    from softmodels.app.project import Project

GREY = "#808080"
"""Is read on white and on black."""
FAINT = {"splitLine": {"lineStyle": {"opacity": 0.25}}, "axisLabel": {"color": GREY}}
OUTPUT = f"{RESULTS}/device"


class DevicePage:
    """One tab's page of the project's device.

    Args:
        bench: What all tabs share.
    """

    def __init__(self, bench: Bench):
        from nicegui import ui

        self.bench, self.project = bench, bench.project
        self.answer: PathAnswer | None = None
        self.linear: LinearAnswer | None = None
        self.own = False
        with ui.element("div").classes("two-columns"):
            with ui.card().classes("w-full"):
                self.controls = ui.refreshable(self._controls)
                self.controls()
            with ui.column().classes("w-full min-w-0"):
                self.message = ui.label().classes("text-negative").props('data-name="message"')
                self.picture = ui.html("", sanitize=False).classes("w-full")
                self.scale = ui.html("", sanitize=False).classes("w-full")
                with ui.row().classes("w-full items-center no-wrap gap-3"):
                    self.slider = ui.slider(min=0.0, max=1.0, step=0.01, value=0.0).classes("grow")
                    self.slider.props('aria-label="pressure" data-name="pressure"')
                    self.reading = ui.label().classes("w-28 text-right").props('data-name="pressure-shown"')
                self.slider.on_value_change(lambda _: self._show_between())
                self.slider.on("change", lambda _: self._solve_between())
                self.about = ui.label().classes("text-sm").props('data-name="linear"')
                self.numbers = ui.grid(columns="auto auto").classes("gap-x-6 gap-y-0")
                self.chart = ui.echart(_chart([], "")).classes("w-full h-64")
                self.limit = ui.label().props('data-name="limit"')
                self.spread = ui.label().classes("text-sm").props('data-name="spread"')
                self.notes = ui.column().classes("gap-1")
                job_panel(bench.jobs, OUTPUT, "Run with all pictures", self._run, f"{OUTPUT}/report.html")
                self.whole = WholeCase(self.project, self._say)
                with ui.expansion("The same in a terminal, and in Python").classes("w-full").props("dense"):
                    self.terminal = ui.code("", language="bash").classes("w-full").props('data-name="terminal"')
                    self.python = ui.code("", language="python").classes("w-full").props('data-name="python"')
        self.project.changed.subscribe(self._changed)
        bench.jobs.changed.subscribe(self._ended)
        ui.timer(0.05, self._solve, once=True)
        ui.timer(1.0, self._follow)

    def _run(self) -> Command:
        return ["softmodels", "run", self.project.case_file(), "-o", OUTPUT], OUTPUT, True

    # -- controls -----------------------------------------------------------------------------------------------------

    def _controls(self) -> None:
        from nicegui import ui

        case = self.project.case
        kinds = sorted(name for name, kind in ACTUATORS.items() if not kind.__dataclass_fields__.get("file"))
        ui.select(kinds, value=type(case.actuator).__name__, label="Device").classes("w-full").props(
            'dense data-name="device"'
        ).on_value_change(lambda event: self._take_device(event.value))
        field_controls(case.actuator, self._take_field, self._move_field)
        ui.separator()
        known = named(case.material)
        names = sorted(PRODUCTS)
        own = None if known else f"{case.material.name} of case.toml"
        ui.select(
            ([own] if own else []) + names, value=own or str(known).partition("/")[0], label="Silicone", with_input=True
        ).classes("w-full").props('dense data-name="silicone"').on_value_change(
            lambda event: self._take(material=silicone(event.value), band=None) if event.value in PRODUCTS else None
        )
        values = case.pressures_cm
        box = ui.input("Pressures", value=f"{values[0]:g}:{values[-1]:g} cm" if values else "").props("dense")
        box.classes("w-full").props('data-name="pressures"').tooltip("such as 0:60 cm of water, or 0:6 kPa")
        box.on("change", lambda _: self._take_pressures(str(box.value)))

    async def _take_device(self, name: str) -> None:
        kind = ACTUATORS[name]
        section = {"section": "axisymmetric"} if "section" in kind.__dataclass_fields__ else {}
        pressures = in_unit("cm", f"{kind.pressures} cm", "pressure", self.project.case.cm)
        await self._take(actuator=registry.device_from(kind, section), pressures_cm=pressures)

    async def _take_field(self, name: str, value: object) -> None:
        device = self.project.case.actuator
        try:
            made = with_field(device, name, value)
        except INPUT_ERRORS as error:
            return self._say(reason(error))
        await self._take(actuator=made)

    def _move_field(self, name: str, value: float) -> None:
        """Show the linear answer of a solid while a slider moves."""
        device = self.project.case.actuator
        if self.linear is not None and name in device.movable:
            with contextlib.suppress(GeometryError):
                self._show_linear(changed(device, {name: value}))

    async def _take_pressures(self, text: str) -> None:
        try:
            values = in_unit("cm", text, "pressure", self.project.case.cm)
        except INPUT_ERRORS as error:
            return self._say(reason(error))
        await self._take(pressures_cm=values)

    async def _take(self, **fields: object) -> None:
        try:
            self.own = "actuator" in fields and type(fields["actuator"]) is type(self.project.case.actuator)
            self.project.change(**fields)
        except (*INPUT_ERRORS, OSError) as error:
            self.own = False
            self._say(reason(error))

    def _say(self, sentence: str) -> None:
        self.message.set_text(page_words(sentence))

    # -- answers ------------------------------------------------------------------------------------------------------

    async def _changed(self, file: str) -> None:
        if not self.own:  # the controls of this tab show its own change already
            self.controls.refresh()
        self.own = False
        self.whole.show()
        await self._solve()

    async def _ended(self, job: Job) -> None:
        if job.output == OUTPUT and not job.active and not is_section(self.project.case.actuator):
            await self._solve()

    async def _solve(self) -> None:
        case, text = self.project.case, self.project.case.to_toml()
        self._say(f"{CASE} cannot be used: {self.project.case_error}" if self.project.case_error else "")
        if not is_section(case.actuator):
            return await self._solve_solid()
        self.linear = None
        self.about.set_text("")
        try:
            answer: PathAnswer = await self.bench.solver.ask("path", text, kind="path")
        except SupersededError:
            return
        except AnswerError as error:
            return self._say(str(error))
        self.answer, self.text = answer, text
        self.tops = max(float(state.section.values.max()) for state in answer.states)
        both = [curve for state in answer.states for curve in (state.section.edges, state.section.rest)]
        self.box = (
            0.0,
            min(float(curve[..., 1].min()) for curve in both),
            max(float(curve[..., 0].max()) for curve in both),
            max(float(curve[..., 1].max()) for curve in both),
        )
        self.pressures = [float(state.row["pressure_cm"]) for state in answer.states]  # type: ignore[arg-type]
        self.scale.set_content(colour_bar(self.tops, answer.colours, "kPa, von Mises stress"))
        top = max(self.pressures)
        self.slider.props(f"max={top} step={top / 500}")
        self.slider.set_value(top)
        self._show(answer.states[self.pressures.index(top)])
        self._plot([one.row for one in answer.states])
        self._report(answer)
        for label in (self.limit, self.spread):
            label.set_text("")
        for function, label in (("limit", self.limit), ("spread", self.spread)):
            try:
                sentence = await self.bench.slower.ask(function, text, kind=function)
            except SupersededError:
                return
            except AnswerError as error:
                sentence = str(error)
            if self.text != text:  # another device is shown by now
                return
            label.set_text(sentence)

    # -- solids -------------------------------------------------------------------------------------------------------

    async def _solve_solid(self) -> None:
        """Show what the last run of this solid has solved, and what follows from it to first order."""
        self.answer = None
        for place in (self.picture, self.scale):
            place.set_content("")
        for label in (self.limit, self.spread, self.about):
            label.set_text("")
        self.numbers.clear()
        (stored, rows), job = stored_run(self.project), self.bench.jobs.latest(OUTPUT)
        if stored is None or not rows or (job is not None and job.active):
            self.linear = None
            return self._say("this device is a solid: start a run below, its path appears as it is solved")
        self._plot(rows)
        top = max(float(row["pressure_cm"]) for row in rows)
        whole = f"von Mises stress of the run's device at {top:.4g} cm"
        self.picture.set_content(stored_picture(self.project, f"{OUTPUT}/cut.png", f"{whole}, cut open"))
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
            self.linear = await self.bench.slower.ask("linear", folder, pressure * self.project.case.cm, kind="linear")
        except SupersededError:
            return
        except AnswerError as error:
            self.linear = None
            return self._say(str(error))
        self._show_linear(self.project.case.actuator)

    def _show_linear(self, device: Actuator) -> None:
        """Show the first-order answer of a solid with other lengths at the slider's pressure."""
        linear, cm = self.linear, self.project.case.cm
        if linear is None:
            return
        base, wanted = Case.from_toml(linear.case).actuator, float(self.slider.value or 0.0) * cm
        changes = {name: parameter(device, name) - parameter(base, name) for name in linear.by_length}
        solved = device == base and abs(wanted - linear.pressure) <= 1e-3 * cm
        self.reading.set_text(f"{wanted / cm:.4g} cm")
        mark = "" if solved else "  (linear)"
        found = linear.at(wanted, changes)
        labels = [("pressure", f"{wanted / cm:.4g} cm ({wanted / 1e3:.4g} kPa)")]
        labels += [
            (f"rise of the {name.removesuffix('_mm')}" if name.endswith("_mm") else "added volume",
             f"{value:.4g} {name.rpartition('_')[2]}{mark}")
            for name, value in found.items()
        ]  # fmt: skip
        self._table(labels)
        self.about.set_text(
            "" if solved else f"linear answer from the state solved at {linear.pressure / cm:.4g} cm, by its exact "
            "derivatives; start a run for the solved one"
        )  # fmt: skip

    def _follow(self) -> None:
        """Show the path of a solid while its job solves it."""
        job = self.bench.jobs.latest(OUTPUT)
        if job is None or not job.active or is_section(self.project.case.actuator):
            return
        try:
            self._plot(path_rows(self.project / OUTPUT))
        except (OSError, ValueError, KeyError, TypeError):  # not there yet, or a row half written
            return

    def _plot(self, rows: Sequence[Mapping[str, object]]) -> None:
        """Plot the rise of the device's main point over the pressure."""
        main = f"{self.project.case.actuator.gauge}_mm"
        if main not in rows[0]:
            return
        points = [(float(str(row["pressure_cm"])), float(str(row[main]))) for row in rows]
        self.chart.options.update(_chart(points, main.removesuffix("_mm")))
        self.chart.update()

    def _report(self, answer: PathAnswer) -> None:
        from nicegui import ui

        case = self.project.case
        self.notes.clear()
        with self.notes:
            for text in (answer.end, *answer.notes):
                if text:
                    ui.label(page_words(text)).classes("text-sm")
        case_file = self.project / CASE
        file = str(case_file.relative_to(Path.cwd()) if case_file.is_relative_to(Path.cwd()) else case_file)
        self.terminal.set_content(f"uv run softmodels run {shlex.quote(file)}")
        self.python.set_content(python_lines(case, file))

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
        except SupersededError:
            return
        except AnswerError as error:
            return self._say(str(error))
        self._show(state)

    def _show(self, state: StateAnswer) -> None:
        row = state.row
        self._draw(state.section, float(row["pressure_cm"]))  # type: ignore[arg-type]
        self._table(self._figures(row))

    def _table(self, figures: Sequence[tuple[str, str]]) -> None:
        from nicegui import ui

        self.numbers.clear()
        with self.numbers:
            for name, text in figures:
                ui.label(name).classes("quiet")
                ui.label(text).props(f'data-name="{name}"')

    def _figures(self, row: dict[str, object]) -> list[tuple[str, str]]:
        bands = {name.replace("_ci95", ""): f" ± {row[name]:.2g}" for name in row if "_ci95_" in name}
        probes = [(name.removesuffix("_mm"), f"{row[name]:.4g}{bands.get(name, '')} mm") for name in row
                  if name.removesuffix("_mm") in self.project.case.actuator.probes and name.endswith("_mm")]  # fmt: skip
        found = [
            ("pressure", f"{row['pressure_cm']:.4g} cm ({float(row['pressure_Pa']) / 1e3:.4g} kPa)"),  # type: ignore[arg-type]
            *((f"rise of the {name}", text) for name, text in probes),
            ("added volume", f"{row['added_volume_ml']:.4g} ml"),
            ("largest stretch", f"{row['max_stretch']:.4g}"),
            ("largest von Mises stress", f"{row['max_von_mises_kPa']:.4g} kPa"),
        ]
        assert self.answer is not None
        if self.answer.breaks_at:
            share = (float(row["max_stretch"]) - 1.0) / (self.answer.breaks_at - 1.0)  # type: ignore[arg-type]
            found.append(("of the strain at break", f"{share:.0%}"))
        return found

    def _draw(self, section: Section, pressure: float) -> None:
        text = f"section at {pressure:.4g} cm, von Mises stress from 0 to {self.tops:.3g} kPa"
        assert self.answer is not None
        self.picture.set_content(section_svg(section, self.box, self.tops, self.answer.colours, text))
        self.reading.set_text(f"{pressure:.4g} cm")


class WholeCase:
    """The case's file as text, for what has no control: components, regions, programs of loads; in the current place of a page.

    Args:
        project: The project.
        say: Takes the sentence why a text cannot be taken.
    """

    def __init__(self, project: Project, say: Callable[[str], None]):
        from nicegui import ui

        self.project, self.say = project, say
        with ui.expansion("The whole case").classes("w-full").props('dense data-name="whole-case"'):
            ui.label(f"All that {CASE} can say, components too; the documentation has its tables").classes("text-sm")
            self.box = (
                ui.textarea(label=CASE)
                .classes("w-full font-mono")
                .props('outlined input-class="case-text" input-style="min-height: 18rem" data-name="case-text"')
            )
            self.why = ui.label().classes("text-negative").props('data-name="case-why"')
            with ui.row():
                ui.button("Take it", on_click=self._take).props('outline data-name="take-case"')
                self.aside = ui.button("Set it aside, start anew", on_click=self._set_aside)
                self.aside.props('outline data-name="set-aside"')
        self.show()

    def show(self) -> None:
        """Show the file as it is."""
        self.box.set_value(self.project.case_text)
        self.why.set_text(self.project.case_error)
        self.aside.set_visibility(bool(self.project.case_error))

    def _take(self) -> None:
        try:
            self.project.change_text(str(self.box.value or ""))
        except (*INPUT_ERRORS, OSError) as error:
            self.why.set_text(page_words(reason(error)))

    def _set_aside(self) -> None:
        try:
            self.project.set_aside()
        except OSError as error:
            self.why.set_text(reason(error))


def stored_run(project: Project) -> tuple[Case | None, list[dict[str, float]]]:
    """Return the case of the stored run of a project's device and its path, if it differs from the present case in lengths and
    pressures at most."""
    case, folder = project.case, project / OUTPUT
    try:
        stored = Case.from_file(folder / CASE)
        rows = path_rows(folder)
        same = {name: parameter(case.actuator, name) for name in stored.actuator.movable}
        like = dataclasses.replace(
            stored,
            name=case.name,
            actuator=changed(stored.actuator, same),
            pressures_cm=case.pressures_cm,
            band=case.band,
        )
    except (*INPUT_ERRORS, GeometryError, OSError, ValueError, TypeError, KeyError):
        return None, []
    return (stored, rows) if like == case else (None, [])


def path_rows(folder: Path) -> list[dict[str, float]]:
    """Return the lengths and pressures of a path that is stored, row by row.

    Raises:
        OSError, ValueError, TypeError: There is none yet, or a row is half written.
    """
    rows = csv.DictReader(io.StringIO(read_text(folder / "path.csv")))
    return [{name: float(row[name]) for name in row if name.endswith(("_mm", "_cm"))} for row in rows]


def is_section(device: Actuator) -> bool:
    return device.dimension == 2


def _chart(points: Sequence[tuple[float, float]], name: str) -> dict[str, object]:
    return {
        "animation": False,
        "grid": {"left": 55, "right": 20, "top": 30, "bottom": 45},
        "xAxis": {
            "name": "pressure in cm",
            "nameLocation": "middle",
            "nameGap": 26,
            "nameTextStyle": {"color": GREY},
            **FAINT,
        },
        "yAxis": {
            "name": f"rise of the {name} in mm" if name else "",
            "nameTextStyle": {"align": "left", "color": GREY},
            **FAINT,
        },
        "series": [{"type": "line", "data": list(points), "symbolSize": 5}],
        "tooltip": {"trigger": "axis"},
    }
