"""The page of the material: measured curves and outlines to a fitted law with intervals, beside what others have published."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from softmodels.app.forms import page_words, upload_box
from softmodels.app.jobs import DONE, Command, Job, job_panel
from softmodels.app.project import CURVES, FITTED, OUTLINES, RESULTS, FileKind
from softmodels.case.entries import INPUT_ERRORS
from softmodels.case.materials import band_of, material_from
from softmodels.common.errors import FieldError, reason
from softmodels.common.files import read_text, replace_text
from softmodels.common.units import readable
from softmodels.materials.laws import LAWS
from softmodels.materials.silicones import PRODUCTS

if TYPE_CHECKING:
    from nicegui.elements.select import Select
    from nicegui.events import MultiUploadEventArguments

    from softmodels.app.bench import Bench

OUTPUT = f"{RESULTS}/fit"
TESTS = ("uniaxial", "planar", "equibiaxial", "balloon")
CURVE = FileKind("curves", "CSV or Excel (.xlsx)", (".csv", ".txt", ".tsv", ".xlsx"), 40 << 20)


class MaterialPage:
    """One tab's page of the material.

    Args:
        bench: What all tabs share.
    """

    def __init__(self, bench: Bench):
        from nicegui import ui

        self.bench, self.project = bench, bench.project
        with ui.element("div").classes("two-columns"):
            with ui.card().classes("w-full"):
                kinds = ",".join(CURVE.endings)
                self.upload = upload_box(
                    "Drop curves of a test machine", CURVE, kinds, "curves", self._uploaded, self._say
                )
                self.curves = ui.refreshable(self._curves)
                self.curves()
                self.with_outlines = ui.switch("Outlines of the photographs", value=(self.project / OUTLINES).is_dir())
                self.with_outlines.props('data-name="with-outlines"')
                self.with_outlines.tooltip("Without those that are not trusted, unless they shall be used anyway")
                self.laws = ui.select(sorted(LAWS), value=["yeoh"], label="Laws to compare", multiple=True)
                self.laws.classes("w-full").props('dense use-chips data-name="laws"')
                self.fixed = ui.input("Fixed parameters", placeholder="c3=0, leak=0").classes("w-full").props("dense")
                self.fixed.props('data-name="fixed"')
                self.poisson = (
                    ui.input("Poisson's ratio", value="0.49").classes("w-full").props('dense data-name="poisson"')
                )
                products = ["any", *sorted(PRODUCTS)]
                self.product = ui.select(products, value="any", label="Cast from", with_input=True)
                self.product.classes("w-full").props('dense data-name="product"')
            with ui.column().classes("w-full min-w-0"):
                self.message = ui.label().classes("text-negative").props('data-name="material-message"')
                self.answer = ui.column().classes("gap-1")
                job_panel(bench.jobs, OUTPUT, "Fit", self._command, f"{OUTPUT}/report.html")
        bench.jobs.changed.subscribe(self._ended)
        self._show()

    def _say(self, sentence: str) -> None:
        self.message.set_text(sentence)

    def _curves(self) -> None:
        from nicegui import ui

        self.tests: dict[str, Select] = {}
        for file in self.project.files(CURVES, CURVE.endings):
            with ui.row().classes("w-full items-center no-wrap gap-2"):
                ui.label(file.name).classes("grow truncate")
                self.tests[file.name] = ui.select(["not used", *TESTS], value=TESTS[0]).props("dense").classes("w-32")

    async def _uploaded(self, event: MultiUploadEventArguments) -> None:
        for given in event.files:
            try:
                self.project.keep(CURVES, given.name, await given.read(), CURVE)
            except (FieldError, OSError) as error:
                self._say(page_words(reason(error)))
        self.upload.reset()
        self.curves.refresh()

    def _command(self) -> Command:
        words = ["softmodels", "fit"]
        if self.with_outlines.value:
            if not (self.project / OUTLINES).is_dir():
                return "there are no outlines yet: measure the photographs first, or switch the outlines off"
            words += [self.project.case_file(), f"{OUTLINES}/"]
            for name, row in self.bench.photographs.measured.items():
                words += ["--exclude", name] if row["trusted"] == "no" else []
        for name, test in self.tests.items():
            if test.value != "not used":
                words += ["--tensile", f"{CURVES}/{name}:{test.value}"]
        if len(words) == 2:
            return "there is nothing to fit yet: drop a curve of a test machine here, or measure photographs"
        if not self.laws.value:
            return "choose at least one law"
        words += ["--material", ",".join(self.laws.value), "--poisson", str(self.poisson.value)]
        if self.product.value:
            words += ["--silicone", str(self.product.value)]
        for text in str(self.fixed.value or "").replace(";", ",").split(","):
            if text.strip():
                words += ["--fix", text.strip()]
        return [*words, "-o", OUTPUT], OUTPUT, False

    async def _ended(self, job: Job) -> None:
        if job.output == OUTLINES and not job.active:
            self.with_outlines.set_value((self.project / OUTLINES).is_dir())
        elif job.output == OUTPUT and job.state == DONE:
            self._show()

    def _show(self) -> None:
        """Show the answer of the last fit."""
        from nicegui import ui

        self.answer.clear()
        try:
            found = json.loads(read_text(self.project / OUTPUT / "fit.json"))
            law = next(one for one in found["laws"] if one["law"] == found["chosen"])
        except (OSError, ValueError, KeyError, StopIteration):
            return
        with self.answer:
            with ui.grid(columns="auto auto auto").classes("gap-x-6 gap-y-0"):
                for one in law["parameters"]:
                    ends, unit = one["interval_95"], one["unit"]
                    value, *between = (readable(float(f"{end:.4g}"), unit) for end in (one["value"], *(ends or ())))
                    about = "fixed" if one["fixed"] else f"95 %: {' to '.join(between)}" if between else ""
                    ui.label(one["name"].replace("_", " ")).classes("quiet")
                    ui.label(value).props(f'data-name="fitted-{one["name"]}"')
                    ui.label(about)
            ui.label(page_words(found["verdict"])).classes("text-sm")
            ui.button("Use it for the device", on_click=self._use).props('outline data-name="use-material"')

    def _use(self) -> None:
        try:
            text = read_text(self.project / OUTPUT / FITTED)
            replace_text(self.project / FITTED, text)
            file = str(self.project / FITTED)
            self.project.change(material=material_from(file, {}), band=band_of(file))
            self._say("")
        except (*INPUT_ERRORS, OSError) as error:
            self._say(page_words(reason(error)))
