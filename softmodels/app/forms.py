"""What the pages are made of: their words, controls for a device's fields, panels of commands, sections drawn as SVG."""

from __future__ import annotations

import contextlib
import inspect
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING
from urllib.parse import quote

import numpy as np
from nicegui import ui

from geometries import ACTUATORS, Actuator
from measurement.series.photo_list import ColumnError, PhotoListError
from softmodels.app import jobs
from softmodels.case import entries
from softmodels.case.case import Case
from softmodels.common import errors, files, schema, units
from softmodels.common.arrays import Array
from softmodels.materials import silicones
from softmodels.path import steps

if TYPE_CHECKING:
    from nicegui.element import Element
    from nicegui.elements.mixins.value_element import ValueElement
    from nicegui.events import MultiUploadEventArguments

    from softmodels.app import bench, replies
    from softmodels.app.bench import Bench


class TabPage:
    """One tab's page."""

    message: ui.label
    """Where the page shows what is wrong."""

    def __init__(self, bench: Bench):
        self.bench, self.project = bench, bench.project

    def say(self, sentence: str) -> None:
        """Show a sentence; none clears the place."""
        self.message.set_text(page_words(sentence))

    @contextlib.contextmanager
    def saying(self, about: str = "") -> Iterator[None]:
        """Show the sentence of an error, with what it is about before it."""
        try:
            yield
        except ERRORS as error:
            self.say(f"{about}{errors.reason(error)}")

    def while_working(self, name: object, words: str, *starting: ui.button | ui.upload) -> None:
        """Add a place that shows words while a piece of work is under way in any tab (`Bench.work`); what would start it again
        is disabled until then."""
        with ui.row().classes("items-center no-wrap gap-2") as shown:
            ui.spinner()
            ui.label(words)

        def show() -> None:
            shown.set_visibility(working := self.bench.at_work[name] > 0)
            for control in starting:
                control.set_enabled(not working)

        self.bench.worked.subscribe(lambda changed: show() if changed == name else None)
        show()

    def upload_box(self, label: str, kind: bench.FileKind, endings: str, name: str, take: Callable[..., object]) -> ui.upload:
        """Add a place to drop files in the current place of the page, with a name for tests and those who do not see it. The
        browser offers the endings and rejects other kinds; ``take`` takes the event with the files.

        The browser itself takes files off the list once they are here: a reset from the server would abort what was dropped
        since.
        """
        made = ui.upload(
            multiple=True, auto_upload=True, max_file_size=kind.largest, on_multi_upload=take,
            on_rejected=lambda: self.say(kind.rejected),
        )  # fmt: skip
        made.add_slot("header", UPLOAD.replace("LABEL", label))
        made.on("uploaded", js_handler=f"() => getElement({made.id}).$refs.qRef.removeUploadedFiles()")
        return tagged(made, name, props=f'accept="{endings}"')

    async def keep(self, event: MultiUploadEventArguments, folder: str, kind: bench.FileKind) -> None:
        """Write files that were dropped into a folder of the project."""
        with self.project.history.one_step():
            for given in event.files:
                with self.saying():
                    self.project.keep(folder, given.name, await given.read(), kind)

    def remove_button(self, name: str, remove: Callable[[], object]) -> None:
        """Add a button in the current place of the page that takes a user's file out of the project."""

        async def pressed() -> None:
            with self.saying(f"{name}: "):
                if inspect.isawaitable(removing := remove()):
                    await removing

        button = ui.button(icon="close", on_click=pressed).props("flat dense round size=sm").classes("shrink-0")
        with_attribute(button.tooltip("Take it away; Undo brings it back"), "aria-label", f"take away {name}")


ERRORS = (
    *entries.INPUT_ERRORS,
    jobs.AnswerError,
    ColumnError,
    errors.FieldError,
    errors.GeometryError,
    PhotoListError,
    units.UnitError,
    OSError,
)
"""What the pages show as a sentence."""
Take = Callable[[str, object], None]
"""Takes a field's name and its new value: a number in SI units, or a text."""
Moved = Callable[[str, float], None]
"""Takes the name of a number whose slider moves, and its value there in SI units."""
PAGE_WORDING = {
    "give setup --mask smaller ones": "make them smaller",
    "give setup --roi a larger one": "make it larger",
    r"give two points of (its|the) surface to setup --zero": r"drag the Zero line onto \1 surface",
    r"give two points of it to the setup \(--zero\)": "drag the Zero line onto it",
    "setup --roi": "the Region",
    "setup --mask": "a Mask",
    "setup --zero": "the Zero line",
    "give --tone srgb for": "choose sRGB as the tone for",
    "--tone linear": "linear",
    "with --tone": "as the tone",
    r"or skip the correction with --lens none": "or choose no lens correction",
    "and rerun setup": "and find it again",
    "before setup and photos": "before dropping it",
    "use --material all to compare laws": "choose more laws to compare them",
    r"use (--band \S+|band=.*) to compute all of them, or": "the page computes all of them;",
    r"; use it with --material \S+": "",
}
"""What the page calls options of the command line in sentences: patterns, in the order in which they are replaced."""
CLASS_NAME = re.compile(r"\b[A-Z][a-z]+[A-Z]\w*")


def page_words(sentence: str) -> str:
    """Return a sentence that names options of the command line and classes with the page's words instead."""
    for option, control in PAGE_WORDING.items():
        sentence = re.sub(option, control, sentence)
    return CLASS_NAME.sub(lambda name: spelled(name[0]).lower() if name[0] in ACTUATORS else name[0], sentence)


def options(names: Iterable[str]) -> dict[str, str]:
    """Return names in the code with their words, as a list of choices shows them."""
    return {name: spelled(name) for name in names}


def spelled(name: str) -> str:
    """Return the words of a name in the code: "Hollow disk" of a class, "cavity radius" of a field."""
    if name in OWN_SPELLINGS:
        return name
    return re.sub(r"(?<=[a-z])[A-Z]", lambda letter: f" {letter[0].lower()}", name).replace("_", " ")


OWN_SPELLINGS = ("PneuNet",)
"""Names in the code that are words of the field as they are."""


UPLOAD = """<div class="row items-center no-wrap q-pa-sm">
<label class="col relative-position cursor-pointer text-weight-bold">LABEL<q-uploader-add-trigger /></label>
<q-btn icon="add" flat round dense aria-label="choose files" @click="props.pickFiles" /></div>"""
"""Head of a place to drop files."""


def tagged[Shown: Element](element: Shown, name: str, classes: str = "w-full", props: str = "dense") -> Shown:
    """Return an element with its looks and its name for tests."""
    return with_attribute(element.classes(classes).props(props), "data-name", name)


ZIP = "/zip"
"""Where the project and its folders of results are served as ZIP files."""


def zip_address(place: str) -> str:
    """Return the address of a folder of results, or of the whole project for "", as a ZIP file."""
    return f"{ZIP}?place={quote(place)}"


def known(values: Iterable[str], options: Collection[str], default: str) -> str:
    """Return the first of some values that is an option; records of a foreign project may hold any."""
    return next((value for value in values if value in options), default)


def with_attribute[Shown: Element](element: Shown, name: str, value: str) -> Shown:
    """Return an element with an attribute as it is: in the text that ``props`` takes, a name from a foreign project could end
    its quotes and go on with an ``onclick``."""
    element.props[name] = value
    return element


def stored_picture(project: bench.Project, place: str, words: str) -> str:
    """Return a picture's file in the project's folder as HTML with words for those who do not see it; nothing without it."""
    if not (file := project / place).is_file():
        return ""
    return f'<img class="stored" src="/files/{place}?{int(file.stat().st_mtime)}" alt="{escape(words)}">'


# ----------------------------------------------------------------------------------------------------------------------
# Commands.


ALLOWED = "allow-scripts allow-popups allow-downloads allow-modals"
"""What a report may do inside the page: its 3-D view, and saving and printing what it shows."""


OUTDATED = "out of date"
"""What is said of results that are not those of today's inputs."""


class JobPanel:
    """A button that starts a command, in the current place of a page, with what it prints, its folder of results, and their
    ``report``, a page from the project's folder; empty for none.

    ``command`` returns it, or the sentence why it cannot be given yet. ``about`` says what will stand there. Results that are
    not those of today's inputs are marked, what is ``shown`` of them elsewhere too, unless ``kept`` says that they are in use;
    both may be set later.
    """

    def __init__(
        self,
        bench: Bench,
        output: str,
        title: str,
        command: Callable[[], jobs.Command | str],
        report: str = "",
        about: str = "",
    ):
        self.bench, self.output, self.title, self.command = bench, output, title, command
        self.report, self.about = report, about
        self.shown: Sequence[Element] = ()
        self.kept: Callable[[], bool] = bool
        with ui.card().classes("w-full"):
            with ui.row().classes("items-center gap-3"):
                self.start_button = tagged(ui.button(title, on_click=self._start), f"start-{output}", "", "")
                self.stop_button = tagged(ui.button("Stop", on_click=self._stop), f"stop-{output}", "", "outline")
                self.spinner, self.state = ui.spinner(), tagged(ui.label(), f"state-{output}", "", "")
                self.zip = tagged(ui.link("all files (ZIP)", zip_address(output)), f"zip-{output}", "", "download")
            self.sentence = tagged(ui.label(), f"why-{output}", "text-negative", "")
            self.empty = tagged(ui.label(about), f"about-{output}", "quiet", "")
            self.line = tagged(ui.label(), f"line-{output}", "text-sm font-mono whitespace-pre-wrap break-words", "")
            with ui.expansion("Log").classes("w-full").props("dense") as self.log:
                self.whole = ui.code("", language="text").classes("w-full")
            self.frame = ui.html("", sanitize=False).classes("w-full")
        bench.commands[output] = self._asked
        bench.jobs.changed.subscribe(lambda job: self._show() if job.output == output else None)
        ui.timer(1.0, self._follow)
        self._show()

    def _asked(self) -> jobs.Command | str:
        try:
            return self.command()
        except ERRORS as error:
            return page_words(errors.reason(error))

    def _start(self) -> None:
        made = self._asked()
        self.sentence.set_text(made if isinstance(made, str) else "")
        if isinstance(made, str):
            return
        try:
            for name, text in made.written.items():
                files.write_text(self.bench.project / name, text)
        except OSError as error:
            self.sentence.set_text(errors.reason(error))
        else:
            self.bench.jobs.start(made.words, made.output, resumable=made.resumable)

    def _stop(self) -> None:
        if (job := self.bench.jobs.shown(self.output)) is not None:
            self.bench.jobs.stop(job)
            self._show()

    def _follow(self) -> None:
        job = self.bench.jobs.shown(self.output)
        if job is not None and job.active:
            self._show()
        else:
            self._mark()

    def _show(self) -> None:
        """Show the newest job, what it has printed, and its report once it has ended."""
        job, file = self.bench.jobs.shown(self.output), self.bench.project / self.report
        active = job is not None and job.active
        self.start_button.set_enabled(not active)
        self.stop_button.set_enabled(job is None or not self.bench.jobs.is_stopping(job))
        for element in (self.stop_button, self.spinner):
            element.set_visibility(active)
        self.log.set_visibility(job is not None)
        self.empty.set_visibility(job is None and bool(self.about))
        self.zip.set_visibility(not active and (self.bench.project / self.output).is_dir())
        if job is None:
            self.state.set_text("")
            self.line.set_text("")
            self.frame.set_content("")
            return
        text = self.bench.jobs.log(job)
        lines = [text_line for text_line in text.splitlines() if text_line.strip()]
        self.state.set_text(self.bench.jobs.state_words(job))
        self._mark()
        self.line.set_text(page_words(lines[-1]) if lines else "")
        self.whole.set_content(f"$ {job.command}\n{text}")
        if self.report and not active and file.is_file():
            address = f"/files/{quote(self.report)}?{int(file.stat().st_mtime)}"
            self.frame.set_content(f'<iframe src="{address}" title="{self.title}" sandbox="{ALLOWED}"></iframe>')

    def _mark(self) -> None:
        """Mark results that are not those of today's inputs."""
        if (job := self.bench.jobs.shown(self.output)) is None or job.active:
            return
        outdated = job.state == jobs.DONE and not self.kept() and is_outdated(self.bench, job, self._asked())
        self.state.set_text(f"{OUTDATED}: what it was made of has changed; start it again" if outdated else job.state)
        for element in (self.frame, self.line, *self.shown):
            element.classes("outdated") if outdated else element.classes(remove="outdated")


def is_outdated(bench: Bench, job: jobs.Job, made: jobs.Command | str = "") -> bool:
    """Return whether a job's results are not those of the project's files as they are now and of the command that would be
    started now: the given one, or that of the newest tab."""
    if job.state != jobs.DONE:
        return False
    if not made and job.output in bench.commands:
        made = bench.commands[job.output]()
    words, written = ([], {}) if isinstance(made, str) else (made.words, made.written)
    return bench.jobs.is_outdated(job, words, {**bench.project.task_cases, **written})


# ----------------------------------------------------------------------------------------------------------------------
# The fields of a device: a slider and a box with the unit for each number, lists for choices.


SLIDER_FACTOR, SLIDER_STEPS = 3.0, 200
"""A slider reaches from the default over this factor to the default times it, in so many steps."""


def field_controls(device: Actuator, take: Take, moved: Moved) -> None:
    """Add controls for a device's fields in the current place of the page: lengths and angles that shape the device, then the
    others, folded away. ``take`` is called when a slider is let go, a box left, or a choice made; ``moved`` while a slider
    moves."""
    fields = {name: field for name, field in schema.about(device).items() if not field.idle(device)}
    first = [name for name, field in fields.items()
             if isinstance(field.kind, schema.Quantity) and field.shape and field.kind.unit]  # fmt: skip
    for name in first:
        _control(device, name, fields[name], take, moved)
    with ui.expansion("More").classes("w-full").props("dense"):
        for name, field in fields.items():
            if name not in first:
                _control(device, name, field, take, moved)


def _control(device: Actuator, name: str, field: schema.About, take: Take, moved: Moved) -> None:
    made: ValueElement
    value, label, kind = getattr(device, name), spelled(name), field.kind
    if isinstance(kind, schema.Quantity):
        return _number(device, name, field, take, moved)
    if isinstance(kind, schema.Choice | schema.Flag):
        made = ui.switch(label, value=value) if isinstance(kind, schema.Flag) else ui.select(
            list(kind.choices), value=value, label=label
        )  # fmt: skip
        made.on_value_change(lambda event: take(name, event.value))
    else:
        made = ui.input(label, value=_text(kind, value))
        made.on("change", lambda _: take(name, _read(kind, str(made.value))))
    tagged(made.tooltip(field.help), name)
    return None


def _number(device: Actuator, name: str, field: schema.About, take: Take, moved: Moved) -> None:
    unit, value, label = field.kind.unit, float(getattr(device, name)), spelled(name)
    usual = float(default_of(device, name) or value or 1.0)  # type: ignore[arg-type]
    low, high = min(usual / SLIDER_FACTOR, value), max(usual * SLIDER_FACTOR, value)
    with ui.row().classes("w-full items-center no-wrap gap-2"):
        box = tagged(ui.input(label, value=units.readable(value, unit)), name, "w-32 shrink-0").tooltip(field.help)
        slider = ui.slider(min=low, max=high, step=(high - low) / SLIDER_STEPS, value=value)
        tagged(slider, f"{name}-slider", "grow", f'aria-label="{label}"')

    def shown(value: float) -> None:
        box.set_value(units.readable(float(f"{value:.4g}"), unit))
        moved(name, float(f"{value:.4g}"))

    def typed() -> None:
        text = str(box.value)
        with contextlib.suppress(units.UnitError):
            slider.set_value(units.quantity(text, unit))
            box.set_value(text)  # with all its digits
        take(name, text)

    slider.on_value_change(lambda event: shown(event.value))
    slider.on("change", lambda _: take(name, float(f"{slider.value:.4g}")))
    box.on("change", typed)


def _text(kind: schema.Kind, value: object) -> str:
    if isinstance(value, tuple):
        return ", ".join(_text(kind, item) for item in value)
    return "" if value is None else units.readable(value, kind.unit) if isinstance(value, float) else str(value)


def _read(kind: schema.Kind, text: str) -> object:
    """Return what a text means: nothing, a list, or the text."""
    if kind.several:
        words = [word.strip() for word in text.replace(";", ",").split(",") if word.strip()]
        return tuple(units.quantity(word, kind.unit) for word in words)
    return None if isinstance(kind, schema.Open) and not text.strip() else text


def python_lines(case: Case, file: str) -> str:
    """Return the Python lines that inflate a case's device as the page does; a case of more than a named silicone and pressures
    by its file."""
    device, silicone = case.actuator, silicones.named(case.material)
    pressures = [value / case.column.pascal for value in case.load.of(steps.PRESSURE)]
    if silicone is None or not pressures or Case(case.name, device, case.material, case.steps) != case:
        return f"import softmodels as sm\n\nrun = sm.run({file!r})\nrun.pressure, run.rise, run.limit"
    changed = ", ".join(f"{name}={value!r}" for name, value in changed_fields(device).items())
    values = ", ".join(f"{value:g}" for value in pressures)
    asked = f"{pressures[0]:g}:{pressures[-1]:g}" if len(pressures) == 2 else values
    return (
        f"import softmodels as sm\n\ndevice = sm.{type(device).__name__}({changed})\n"
        f'run = sm.inflate(device, "{silicone}", "{asked} cm")\n'
        "run.pressure, run.rise, run.limit"
    )


def default_of(device: Actuator, name: str) -> object:
    """Return the default of a device's field."""
    return type(device).__dataclass_fields__[name].default


def changed_fields(device: Actuator) -> Mapping[str, object]:
    """Return the fields of a device that are not at their default."""
    return {name: getattr(device, name) for name in schema.about(device) if getattr(device, name) != default_of(device, name)}


def with_field(device: Actuator, name: str, value: object) -> Actuator:
    """Return a device with one field changed, which may be a text with a unit; errors as of its class."""
    return device.replaced(**{name: value})


# ----------------------------------------------------------------------------------------------------------------------
# Sections as SVG: the whole profile with a field in colours, over its undeformed outline.


def section_svg(section: replies.Section, box: Array, top: float, colours: list[str], text: str) -> str:
    """Return a section as SVG, mirrored to the whole profile, in a box of least and largest radius and height in mm, shape
    (2, 2), and colours from 0 to ``top``. The text says what it shows to those who do not see it."""
    (_, low), (radius, high) = box
    margin = 0.06 * radius
    wide, tall = 2 * (radius + margin), high - low + 2 * margin
    places = np.clip((section.values / top * len(colours)).astype(int), 0, len(colours) - 1)
    half = [
        f'<path d="{_paths(section.corners[places == k], "Z")}" fill="{colours[k]}" stroke="{colours[k]}" '
        f'stroke-width="{wide / 1500:.4f}"/>'
        for k in np.unique(places)
    ]
    half += [
        f'<path d="{_paths(curves)}" class="{name}" fill="none" {stroke} stroke-width="{wide / 700:.4f}"/>'
        for curves, name, stroke in (
            (section.rest, "rest", 'stroke="#8a8a8a" stroke-dasharray="0.6 0.4"'),
            (section.edges, "edge", 'stroke="currentColor"'),
        )  # as attributes: no rule of the page reaches the mirrored half
    ]
    drawn = f'<g id="half-section">{"".join(half)}</g><use href="#half-section" transform="scale(-1 1)"/>'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" role="img" aria-label="{escape(text)}" class="section" '
        f'viewBox="{-wide / 2:.4f} {-(high + margin):.4f} {wide:.4f} {tall:.4f}">{drawn}'
        f"{_scale_bar(wide, -(low - margin))}</svg>"
    )


def _paths(curves: Array, end: str = "") -> str:
    """Return curves of k points each, shape (n, k, 2), as the path of an SVG, whose y points downwards."""
    path = "M" + "L".join(["%.3f %.3f"] * curves.shape[1]) + end
    return path * len(curves) % tuple((curves * (1.0, -1.0)).ravel().tolist())


def _scale_bar(wide: float, foot: float) -> str:
    """Return a bar of a round length near an eighth of the width, in the lower left corner."""
    power = 10.0 ** np.floor(np.log10(wide / 8))
    length = max(k * power for k in (1, 2, 5) if k * power <= wide / 8)
    x, y, size = -0.48 * wide, foot - 0.012 * wide, 0.018 * wide
    return (
        f'<g class="scale-bar"><path d="M{x:.3f} {y:.3f}h{length:g}" stroke-width="{wide / 400:.3f}"/>'
        f'<text x="{x:.3f}" y="{y - size / 3:.3f}" font-size="{size:.3f}">{length:g} mm</text></g>'
    )


def colour_bar(top: float, colours: list[str], what: str) -> str:
    """Return the scale from 0 to a value as HTML, with its words."""
    return (
        f'<div class="colour-bar"><span>0</span><div style="background:linear-gradient(90deg,{",".join(colours)})"></div>'
        f"<span>{top:.4g} {escape(what)}</span></div>"
    )
