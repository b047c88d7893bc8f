"""Controls for the fields of a device: a slider and a box with the unit for each number, lists for choices; the page's words
for options of the command line."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Awaitable, Callable, Mapping
from html import escape
from typing import TYPE_CHECKING

from geometries import Actuator
from softmodels.case.case import Case
from softmodels.common.schema import About, Choice, Flag, Kind, Open, Quantity, about
from softmodels.common.units import UnitError, quantity, readable
from softmodels.materials.silicones import named

if TYPE_CHECKING:
    from nicegui.elements.mixins.value_element import ValueElement
    from nicegui.elements.upload import Upload

    from softmodels.app.project import FileKind, Project

Take = Callable[[str, object], Awaitable[None]]
"""Takes a field's name and its new value: a number in SI units, or a text."""
Moved = Callable[[str, float], None]
"""Takes the name of a number whose slider moves, and its value there in SI units."""
WORDS = {
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


def page_words(sentence: str) -> str:
    """Return a sentence that names options of the command line with the page's controls instead."""
    for option, control in WORDS.items():
        sentence = re.sub(option, control, sentence)
    return sentence


SPAN = 3.0
"""A slider reaches from the default over this factor to the default times it."""
STEPS = 200


def upload_box(
    label: str,
    kind: FileKind,
    endings: str,
    name: str,
    take: Callable[..., Awaitable[None]],
    say: Callable[[str], None],
) -> Upload:
    """Add a place to drop files in the current place of the page, with a name for those who do not see it.

    Args:
        label: What to drop.
        kind: Of the files; others are rejected by the browser.
        endings: For the browser's choice of files.
        name: For tests.
        take: Takes the event with the files.
        say: Takes the sentence for files that the browser does not send.
    """
    from nicegui import ui

    made = ui.upload(
        multiple=True, auto_upload=True, max_file_size=kind.largest, on_multi_upload=take,
        on_rejected=lambda: say(kind.rejected),
    )  # fmt: skip
    made.classes("w-full").props(f'accept="{endings}" data-name="{name}"')
    made.add_slot("header", UPLOAD.replace("LABEL", label))
    return made


UPLOAD = """<div class="row items-center no-wrap q-pa-sm">
<label class="col relative-position cursor-pointer text-weight-bold">LABEL<q-uploader-add-trigger /></label>
<q-btn icon="add" flat round dense aria-label="choose files" @click="props.pickFiles" /></div>"""
"""Head of a place to drop files."""


def field_controls(device: Actuator, take: Take, moved: Moved) -> None:
    """Add controls for a device's fields in the current place of the page.

    Lengths and angles that shape the device come first; the others are folded away.

    Args:
        device: The device as it is.
        take: Is called when a slider is let go, a box left, or a choice made.
        moved: Is called while a slider moves.
    """
    from nicegui import ui

    fields = {name: field for name, field in about(device).items() if not field.idle(device)}
    first = {name: field for name, field in fields.items() if _is_shape(field)}
    for name, field in first.items():
        _control(device, name, field, take, moved)
    with ui.expansion("More").classes("w-full").props("dense"):
        for name, field in fields.items():
            if name not in first:
                _control(device, name, field, take, moved)


def _is_shape(field: About) -> bool:
    return isinstance(field.kind, Quantity) and field.shape and bool(field.kind.unit)


def _control(device: Actuator, name: str, field: About, take: Take, moved: Moved) -> None:
    from nicegui import ui

    made: ValueElement
    value, label, kind = getattr(device, name), name.replace("_", " "), field.kind
    if isinstance(kind, Choice):
        made = ui.select(list(kind.choices), value=value, label=label)
        made.on_value_change(lambda event: take(name, event.value))
    elif isinstance(kind, Flag):
        made = ui.switch(label, value=value)
        made.on_value_change(lambda event: take(name, event.value))
    elif isinstance(kind, Quantity):
        return _number(device, name, field, take, moved)
    else:
        made = ui.input(label, value=_text(kind, value))
        made.on("change", lambda _: take(name, _read(kind, str(made.value))))
    made.classes("w-full").props("dense").tooltip(field.help).props(f'data-name="{name}"')
    return None


def _number(device: Actuator, name: str, field: About, take: Take, moved: Moved) -> None:
    from nicegui import ui

    unit, value = field.kind.unit, float(getattr(device, name))
    usual = float(default_of(device, name) or value or 1.0)  # type: ignore[arg-type]
    reach = sorted((min(usual / SPAN, value), max(usual * SPAN, value)))
    with ui.row().classes("w-full items-center no-wrap gap-2"):
        box = ui.input(name.replace("_", " "), value=readable(value, unit)).props("dense").classes("w-32 shrink-0")
        slider = ui.slider(min=reach[0], max=reach[1], step=(reach[1] - reach[0]) / STEPS, value=value)
        slider.classes("grow").props(f'aria-label="{name.replace("_", " ")}"').props(f'data-name="{name}-slider"')
    box.tooltip(field.help).props(f'data-name="{name}"')

    def shown(value: float) -> None:
        box.set_value(readable(float(f"{value:.4g}"), unit))
        moved(name, float(f"{value:.4g}"))

    slider.on_value_change(lambda event: shown(event.value))
    slider.on("change", lambda _: take(name, float(f"{slider.value:.4g}")))

    async def typed() -> None:
        text = str(box.value)
        with contextlib.suppress(UnitError):
            slider.set_value(quantity(text, unit))
            box.set_value(text)  # with all its digits
        await take(name, text)

    box.on("change", typed)


def _text(kind: Kind, value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, tuple):
        return ", ".join(readable(item, kind.unit) if isinstance(item, float) else str(item) for item in value)
    return readable(value, kind.unit) if isinstance(value, float) else str(value)


def _read(kind: Kind, text: str) -> object:
    """Return what a text means: nothing, a list, or the text."""
    if kind.several:
        words = [word.strip() for word in text.replace(";", ",").split(",") if word.strip()]
        return tuple(quantity(word, kind.unit) for word in words)
    return None if isinstance(kind, Open) and not text.strip() else text


def python_lines(case: Case, file: str) -> str:
    """Return the Python lines that inflate a case's device as the page does; a case of more than a named silicone and pressures
    by its file."""
    device, silicone = case.actuator, named(case.material)
    if silicone is None or Case(case.name, device, case.material, case.pressures_cm) != case:
        return f"import softmodels as sm\n\nrun = sm.run({file!r})\nrun.pressure, run.rise, run.limit"
    changed = ", ".join(f"{name}={value!r}" for name, value in changed_fields(device).items())
    values = ", ".join(f"{value:g}" for value in case.pressures_cm)
    asked = f"{case.pressures_cm[0]:g}:{case.pressures_cm[-1]:g}" if len(case.pressures_cm) == 2 else values
    return (
        "import softmodels as sm\n\n"
        f"device = sm.{type(device).__name__}({changed})\n"
        f'run = sm.inflate(device, "{silicone}", "{asked} cm")\n'
        "run.pressure, run.rise, run.limit"
    )


def default_of(device: Actuator, name: str) -> object:
    """Return the default of a device's field."""
    return type(device).__dataclass_fields__[name].default


def changed_fields(device: Actuator) -> Mapping[str, object]:
    """Return the fields of a device that are not at their default."""
    return {name: getattr(device, name) for name in about(device) if getattr(device, name) != default_of(device, name)}


def with_field(device: Actuator, name: str, value: object) -> Actuator:
    """Return a device with one field changed, which may be a text with a unit; errors as of its class."""
    return type(device)(**{**changed_fields(device), name: value})


def stored_picture(project: Project, place: str, words: str) -> str:
    """Return a picture of the project's folder as HTML; nothing where there is none.

    Args:
        project: The project.
        place: Of the file, in its folder.
        words: What it shows, for those who do not see it.
    """
    file = project / place
    if not file.is_file():
        return ""
    return f'<img class="stored" src="/files/{place}?{int(file.stat().st_mtime)}" alt="{escape(words)}">'
