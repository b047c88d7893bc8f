"""The pages of the material, of optimised devices, and of the mould."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING
from urllib.parse import quote

import tomli_w
from nicegui import ui

from geometries import actuator
from softmodels.app import forms, jobs, kept
from softmodels.app.bench import CASE, CURVES, DESIGN_CASE, FIT_CASE, FITTED, MOULD_CASE, OUTLINES, RESULTS, Bench, FileKind
from softmodels.case import materials
from softmodels.case.case import Case
from softmodels.casting import settings
from softmodels.common import errors, files, schema, tables, units
from softmodels.materials import silicones
from softmodels.materials.laws import DEFAULT_POISSON_RATIO, LAWS
from softmodels.path import steps

if TYPE_CHECKING:
    from pathlib import Path

    from nicegui.events import MultiUploadEventArguments


FIT, MOULD, DESIGN = f"{RESULTS}/fit", f"{RESULTS}/mould", f"{RESULTS}/design"
ABOUT_FIT = (
    "Drop a table of a test machine on the left, or measure photographs. Here come the law that fits best, its numbers with "
    "95 % intervals, and their report."
)
ABOUT_MOULD = "Here come the bodies to print, an exploded view, and the sheet for the bench: what to print, mix, pour and open."
ABOUT_DESIGN = (
    "Choose on the left what may change, what the device should do and which limits it keeps. Here come every trial and the "
    "best device."
)


# ----------------------------------------------------------------------------------------------------------------------
# The material: measured curves and outlines to a fitted law with intervals.


TESTS = ("uniaxial", "compression", "planar", "equibiaxial", "balloon")
CURVE = FileKind("curves", "CSV or Excel (.xlsx)", (".csv", ".txt", ".tsv", ".xlsx"), 40 << 20)


class MaterialPage(forms.TabPage):
    """One tab's page of the material."""

    def __init__(self, bench: Bench):
        super().__init__(bench)
        last = bench.jobs.latest(FIT)
        given = last.options if last else lambda name: []
        self.given_tests = dict(text.removeprefix(f"{CURVES}/").rpartition(":")[::2] for text in given("--tensile"))
        with ui.element("div").classes("two-columns"):
            with ui.card().classes("w-full"):
                kinds = ",".join(CURVE.endings)
                self.upload_box("Drop curves of a test machine", CURVE, kinds, "curves", self._uploaded)
                self.tests: dict[str, ui.select] = {}
                self.curves = ui.refreshable(self._curves)
                self.curves()
                self.with_outlines = ui.switch("Outlines of the photographs", value=(self.project / OUTLINES).is_dir())
                forms.tagged(self.with_outlines, "with-outlines", "", "")
                self.with_outlines.tooltip("Without those that are not trusted, unless they shall be used anyway")
                chosen = [law for law in ",".join(given("--material")).split(",") if law in LAWS]
                laws = ui.select(sorted(LAWS), value=chosen or ["yeoh"], label="Laws to compare", multiple=True)
                self.laws = forms.tagged(laws, "laws", props="dense use-chips")
                self.fixed = forms.tagged(
                    ui.input("Fixed parameters", value=", ".join(given("--fix")), placeholder="c3=0, leak=0"), "fixed"
                )
                ratio = next(iter(given("--poisson")), f"{DEFAULT_POISSON_RATIO:g}")
                self.poisson = forms.tagged(ui.input("Poisson's ratio", value=ratio), "poisson")
                products = ["any", *sorted(silicones.PRODUCTS)]
                product = forms.known(given("--silicone"), products, "any")
                self.product = forms.tagged(ui.select(products, value=product, label="Cast from", with_input=True), "product")
            with ui.column().classes("w-full min-w-0"):
                self.message = forms.tagged(ui.label(), "material-message", "text-negative", "")
                self.answer = ui.column().classes("gap-1")
                panel = forms.JobPanel(bench, FIT, "Fit", self._command, f"{FIT}/report.html", ABOUT_FIT)
                panel.shown = [self.answer]
                kept.KeptResults(bench, FIT)
        bench.jobs.changed.subscribe(self._ended)
        self.project.changed.subscribe(lambda place: self.curves.refresh() if place in (CURVES, CASE) else None)
        self._show()

    def _curves(self) -> None:
        self.given_tests.update((name, str(test.value)) for name, test in self.tests.items())
        self.tests.clear()
        for file in self.project.files(CURVES, CURVE.endings):
            with ui.row().classes("w-full items-center no-wrap gap-2"):
                ui.label(file.name).classes("grow truncate")
                options = ["not used", *TESTS]
                test = forms.known([self.given_tests.get(file.name, "")], options, TESTS[0])
                self.tests[file.name] = ui.select(options, value=test).props("dense").classes("w-32")
                self.remove_button(file.name, functools.partial(self.project.remove, file))

    async def _uploaded(self, event: MultiUploadEventArguments) -> None:
        await self.keep(event, CURVES, CURVE)

    def _command(self) -> jobs.Command | str:
        words = ["softmodels", "fit"]
        if self.with_outlines.value:
            if not (self.project / OUTLINES).is_dir():
                return "there are no outlines yet: measure the photographs first, or switch the outlines off"
            words += [FIT_CASE, f"{OUTLINES}/"]
            for name, row in self.bench.photographs.measured.items():
                words += ["--exclude", name] if row["trusted"] == "no" else []
        for name, test in self.tests.items():
            words += ["--tensile", f"{CURVES}/{name}:{test.value}"] if test.value != "not used" else []
        if len(words) == 2:
            return "there is nothing to fit yet: drop a curve of a test machine here, or measure photographs"
        if not self.laws.value:
            return "choose at least one law"
        words += ["--material", ",".join(self.laws.value), "--poisson", str(self.poisson.value)]
        words += ["--silicone", str(self.product.value)] if self.product.value else []
        for text in str(self.fixed.value or "").replace(";", ",").split(","):
            words += ["--fix", text.strip()] if text.strip() else []
        return jobs.Command([*words, "-o", FIT], FIT, written=self.project.case_for(FIT_CASE))

    async def _ended(self, job: jobs.Job) -> None:
        if job.output == OUTLINES and not job.active:
            self.with_outlines.set_value((self.project / OUTLINES).is_dir())
        elif job.output == FIT and job.state == jobs.DONE:
            self._show()

    def _show(self) -> None:
        """Show the answer of the last fit."""
        self.answer.clear()
        if (fitted := fitted_law(self.project / FIT / "fit.json")) is None:
            return
        parameters, verdict = fitted
        with self.answer:
            with ui.grid(columns="auto auto auto").classes("gap-x-6 gap-y-0"):
                for name, value, about in parameters:
                    ui.label(forms.spelled(name)).classes("quiet")
                    forms.with_attribute(ui.label(value), "data-name", f"fitted-{name}")
                    ui.label(about)
            ui.label(forms.page_words(verdict)).classes("text-sm")
            ui.button("Use it for the device", on_click=self._use).props('outline data-name="use-material"')

    def _use(self) -> None:
        with self.saying():
            files.write_text(self.project / FITTED, files.read_text(self.project / FIT / FITTED))
            file = str(self.project / FITTED)
            self.project.change(material=materials.material_from(file, {}), band=materials.band_of(file))
            self.say("")


def fitted_law(file: Path) -> tuple[list[tuple[str, str, str]], str] | None:
    """Return the parameters of the chosen law of a ``fit.json``, each its name, value and interval, and the fit's verdict;
    None if there is no such file, or something else in it."""
    shown = []
    try:
        report = files.read_json(file)
        law = next(law for law in report["laws"] if law["law"] == report["chosen"])
        for parameter in law["parameters"]:
            ends, unit = parameter["interval_95"], parameter["unit"]
            value, *between = (units.readable(float(f"{end:.4g}"), unit) for end in (parameter["value"], *(ends or ())))
            about = "fixed" if parameter["fixed"] else f"95 %: {' to '.join(between)}" if between else ""
            shown.append((str(parameter["name"]), value, about))
        return shown, str(report["verdict"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError, StopIteration):
        return None


# ----------------------------------------------------------------------------------------------------------------------
# The mould.


FIRST_SETTINGS = ("inlet", "tube", "bolt", "least_wall")
"""What differs between workshops; the other settings are folded away."""
FILES = (".3mf", ".stl", ".step", ".html", ".md")
"""Endings of the files to download."""


class MouldPage(forms.TabPage):
    """One tab's page of the mould."""

    def __init__(self, bench: Bench):
        super().__init__(bench)
        with ui.element("div").classes("two-columns"):
            with ui.card().classes("w-full"):
                ui.label("Mould").classes("font-bold")
                last = bench.jobs.latest(MOULD)
                self.given = last.options if last else lambda name: []
                products = ["as simulated", *sorted(silicones.PRODUCTS)]
                product = forms.known(self.given("--silicone"), products, products[0])
                self.silicone = forms.tagged(ui.select(products, value=product, label="Silicone to cast"), "cast-silicone")
                self.settings: dict[str, ui.input] = {}
                for name in FIRST_SETTINGS:
                    self._setting(name)
                with ui.expansion("More").classes("w-full").props("dense"):
                    for name in schema.about(settings.Workshop):
                        if name not in FIRST_SETTINGS:
                            self._setting(name)
                self.files = forms.tagged(ui.column(), "mould-files", "gap-1", "")
            with ui.column().classes("w-full min-w-0"):
                self.exploded = forms.tagged(ui.html("", sanitize=False), "exploded", props="")
                panel = forms.JobPanel(bench, MOULD, "Make the mould", self._command, f"{MOULD}/sheet.html", ABOUT_MOULD)
                panel.shown = [self.exploded, self.files]
                kept.KeptResults(bench, MOULD, "sheet.html")
        bench.jobs.changed.subscribe(self._ended)
        self._show()

    def _setting(self, name: str) -> None:
        """Add a box; empty it means the default, which it shows."""
        field, default = schema.about(settings.Workshop)[name], getattr(settings.Workshop, name)
        text = schema.shown(default, field.kind.unit) if isinstance(default, float) else str(default)
        given = next(iter(self.given(f"--{name.replace('_', '-')}")), "")
        box = ui.input(forms.spelled(name), value=given, placeholder="" if default is None else text)
        forms.with_attribute(box, "hint", field.help) if name in FIRST_SETTINGS else box.tooltip(field.help)
        self.settings[name] = forms.tagged(box, f"mould-{name}", props="dense stack-label")

    def _command(self) -> jobs.Command:
        words = ["softmodels", "mould", MOULD_CASE, "-o", MOULD]
        words += ["--silicone", str(self.silicone.value)] if self.silicone.value != "as simulated" else []
        for name, box in self.settings.items():
            if text := str(box.value or "").strip():
                words += [f"--{name.replace('_', '-')}", text]
        return jobs.Command(words, MOULD, written=self.project.case_for(MOULD_CASE))

    async def _ended(self, job: jobs.Job) -> None:
        if job.output == MOULD and job.state == jobs.DONE:
            self._show()

    def _show(self) -> None:
        self.files.clear()
        self.exploded.set_content(
            forms.stored_picture(self.project, f"{MOULD}/exploded.png", "the mould, its bodies apart along the pull")
        )
        if not (self.project / MOULD).is_dir():
            return
        with self.files:
            ui.label("Files").classes("font-bold")
            for file in sorted(self.project.files(MOULD, FILES), key=lambda file: FILES.index(file.suffix)):
                link = ui.link(file.name, f"/files/{quote(f'{MOULD}/{file.name}')}")
                forms.with_attribute(link, "download", file.name)


# ----------------------------------------------------------------------------------------------------------------------
# A better device within limits.


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
LENGTH_FACTOR = 1.5
"""Bounds of a varied length, as a factor of the present one both ways."""


FIRST_LIMITS = MappingProxyType({"limit_margin": "1.25", "clearances": "0.8 mm"})
"""Limits until they are given, by their quantities."""


@dataclasses.dataclass(frozen=True)
class ProblemChoices:
    """What the page's problem asks: lengths that may change, and by which factor both ways, the objective, its probe and its
    pressure ("" for none), and the limits by their quantities."""

    lengths: Sequence[str] = ()
    factor: float = LENGTH_FACTOR
    objective: str = "most rise"
    of: str = ""
    at: str = ""
    limits: Mapping[str, str] = FIRST_LIMITS


class DesignPage(forms.TabPage):
    """One tab's page of designs."""

    def __init__(self, bench: Bench):
        super().__init__(bench)
        with ui.element("div").classes("two-columns"):
            with ui.card().classes("w-full"):
                self.controls = ui.refreshable(self._controls)
                self.controls()
            with ui.column().classes("w-full min-w-0"):
                self.message = forms.tagged(ui.label(), "design-message", "text-negative", "")
                panel = forms.JobPanel(bench, DESIGN, "Search", self._command, f"{DESIGN}/report.html", ABOUT_DESIGN)
                panel.kept = self._in_use
                kept.KeptResults(bench, DESIGN)
                forms.tagged(ui.button("Use this device", on_click=self._use), "use-design", "", "outline")
        self.project.changed.subscribe(lambda file: self.controls.refresh())

    def _controls(self) -> None:
        device = self.project.case.actuator
        names = [name for name in actuator.parameter_names(device) if actuator.is_length(device, name)]
        probes = list(device.probes)
        column = self.project.case.column
        highest = column.text(max(self.project.case.load.of(steps.PRESSURE), default=0.0), "g")
        last = last_problem(self.project / PROBLEM) or ProblemChoices()
        ui.label("What may change").classes("font-bold")
        varied = [name for name in last.lengths if name in names] or names[:1]
        self.varied = forms.tagged(
            ui.select(forms.options(names), value=varied, label="lengths", multiple=True), "varied", props="dense use-chips"
        )
        self.reach = forms.tagged(ui.input("from and to, as a factor both ways", value=f"{last.factor:.4g}"), "reach")
        ui.label("What it should do").classes("font-bold")
        objective = ui.select(list(OBJECTIVES), value=last.objective, label="objective")
        self.objective = forms.tagged(objective, "objective")
        probe = forms.known([last.of], probes, probes[0])
        self.probe = forms.tagged(ui.select(probes, value=probe, label="of"), "probe")
        at = ui.input(f"at a pressure ({column.unit}), or in kPa", value=last.at or highest)
        self.at = forms.tagged(at, "design-pressure")
        ui.label("Limits that it keeps").classes("font-bold")
        self.limits = {
            name: forms.tagged(ui.input(name, value=last.limits.get(quantity, "")), f"keep-{quantity}")
            for name, (quantity, _) in LIMITS.items()
        }

    def _command(self) -> jobs.Command:
        written = {PROBLEM: tomli_w.dumps(self._problem()), **self.project.case_for(DESIGN_CASE)}
        return jobs.Command(["softmodels", "design", PROBLEM, "-o", DESIGN], DESIGN, True, written)

    def _in_use(self) -> bool:
        """Return whether the project's device is the design already."""
        try:
            return Case.from_file(self.project / DESIGN / "design.toml").actuator == self.project.case.actuator
        except (*forms.ERRORS, ValueError):
            return False

    def _problem(self) -> dict[str, object]:
        """Return the problem as its file has it."""
        device, reach = self.project.case.actuator, units.number(str(self.reach.value))
        if not self.varied.value:
            raise errors.FieldError("choose at least one length that may change")
        if not reach > 1.0:
            raise errors.FieldError(f"the factor is {reach:g}; it must be above 1, such as {LENGTH_FACTOR:g}")
        bounds = {}
        for name in self.varied.value:
            now = actuator.parameter(device, name)
            low, high = sorted((now / reach, now * reach))
            bounds[name] = {"from": units.readable(low, "m"), "to": units.readable(high, "m")}
        table, quantity = OBJECTIVES[str(self.objective.value)]
        kept = [
            self._asked(LIMITS[name][0]) | {LIMITS[name][1]: _entry(str(box.value))}
            for name, box in self.limits.items()
            if str(box.value or "").strip()
        ]
        asked = self._asked(quantity)
        return {"name": "design", "case": DESIGN_CASE, "parameters": bounds, table: asked, "keep": kept}

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
            return self.say("there is no design yet: start the search first")
        with self.saying():
            self.project.change(actuator=Case.from_file(file).actuator)
            self.say("")
        return None


def last_problem(file: Path) -> ProblemChoices | None:
    """Return what was asked last; None without a problem that the page has written."""
    try:
        problem = tables.read_toml(file)
        if problem["case"] != DESIGN_CASE:
            return None
        bounds = problem["parameters"]
        first, *_ = bounds.values()
        low, high = (units.quantity(first[end], "m") for end in ("from", "to"))
        goals = [(name, problem[table]) for name, (table, quantity) in OBJECTIVES.items()
                 if problem.get(table, {}).get("quantity") == quantity]  # fmt: skip
        ((objective, goal),) = goals
        sides = dict(LIMITS.values())
        limits = {entry["quantity"]: str(entry[sides[entry["quantity"]]]) for entry in problem["keep"]}
        factor = math.sqrt(high / low)
        return ProblemChoices([*bounds], factor, objective, str(goal.get("of", "")), str(goal.get("at", "")), limits)
    except (OSError, tables.TomlError, units.UnitError, KeyError, TypeError, ValueError, AttributeError,
            ZeroDivisionError):  # fmt: skip
        return None


def _entry(text: str) -> object:
    try:
        return float(text)
    except ValueError:
        return text
