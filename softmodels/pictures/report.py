"""``report.html``: one run on one page that needs no network and nothing installed.

Pictures, film, curves and the 3-D view are inside the file. Whatever columns ``path.csv`` has are shown.
"""

from __future__ import annotations

import base64
import html
import io
import json
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import matplotlib
from PIL import Image as Picture

from softmodels.pictures import plots, program_plots
from softmodels.pictures.pages import STYLE, load
from softmodels.pictures.report_case import case_tables
from softmodels.pictures.viewer import view
from softmodels.pictures.views import Look
from softmodels.results.columns import cavity_columns, term
from softmodels.results.notes import left_out, notes_of
from softmodels.results.outcomes import DONE, NO_EQUILIBRIUM
from softmodels.results.row import Cell, Row
from softmodels.results.stability_report import stability_text
from softmodels.results.stored import States
from softmodels.results.writing import write_text

WIDEST = 1200
"""Pictures are made smaller than this many pixels wide inside the page; the files keep their own size."""
CAPTIONS = {
    "undeformed.png": "The device at rest",
    "stress.png": "Von Mises stress on the deformed device: one camera, one colour scale",
    "film.webp": "Film over the path; between the computed steps the shape goes straight from one to the next",
    "cut.png": "Cut open; the cut is made in the undeformed material",
    "hot-spots.png": "Where the silicone is stretched most",
    "slice.png": "The modelled part; thin lines: undeformed",
    "mode.png": "The mode at the first bifurcation: how the device can leave its shape there; its size is arbitrary",
    "profile.png": "Outline from the side",
    "mesh.png": "The mesh",
}
"""Pictures in the order of the page, with what they show."""
ROUNDING = 1e-12
"""What is smaller, in the columns' units, is nothing but rounding errors."""
REPORT = "report.html"


def write(look: Look, folder: Path, name: str) -> Path:
    """Write the report of a folder whose pictures are drawn already; those that are missing are left out.

    Returns:
        The file.
    """
    states = look.states
    told = summary(folder)
    parts = [
        f"<h1>{html.escape(name)}</h1>",
        f'<p class="lead">{html.escape(ending(states, told))}</p>',
        _warnings(told["notes"] if "notes" in told else notes_of(states.case, states.rows)),
        '<h2 class="screen">In 3-D</h2>', view(look),
        "<h2>The path</h2>", _curves(states), _contact(states),
        _requested(states),
        "<h2>Pictures</h2>", *(_picture(folder / stem, text) for stem, text in CAPTIONS.items()),
        "<h2>The case</h2>", case_tables(states),
        "<h2>What to know</h2>", _notes(states),
        "<h2>What the columns are</h2>", _glossary(states),
        "<details><summary>All steps</summary>", _table(states.rows, states.rows, states), "</details>",
        f"<details><summary>case.toml</summary><pre>{html.escape(states.case.to_toml())}</pre></details>",
    ]  # fmt: skip
    style = resources.files("softmodels.pictures.draw").joinpath("report.css").read_text()
    page = (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{html.escape(name)}</title>'
        '<meta name="viewport" content="width=device-width, initial-scale=1"><link rel="icon" href="data:,">'
        f"<style>{style}</style></head><body><main>\n" + "\n".join(parts) + "\n</main></body></html>\n"
    )
    write_text(folder / REPORT, page)
    return folder / REPORT


def summary(folder: Path) -> dict[str, Any]:
    """What ``summary.json`` tells of how the run ended; nothing if it has not ended by itself."""
    try:
        found = json.loads((folder / "summary.json").read_text())
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def ending(states: States, told: dict[str, Any]) -> str:
    """How the run ended, in a sentence or two; ``told`` is its `summary`."""
    row, gauge = states.rows[states.main], states.actuator.gauge
    stroke = f"{row['stroke_ml']:.4g} ml of stroke and " if "stroke_ml" in row else ""
    reached = (
        f"At {stroke}{load(row)} the {gauge} has risen {row[f'{gauge}_mm']:.4g} mm and "
        f"{_taker(row)} taken {row['added_volume_ml']:.4g} ml"
    )
    if "max_stretch" in row:
        reached += f"; the largest stretch is {row['max_stretch']:.4g}"
    for name in ("blocked_force_N", "contact_force_N"):
        if name in row:
            reached += f"; the {term(name).name} is {row[name]:.4g} N"
    if not told:
        return f"The run has not ended by itself; {len(states.rows)} states are stored. {reached}."
    if told.get("status") == DONE:
        return f"All requested values were reached in {len(states.rows)} states. {reached}."
    start = "The run stopped at a limit point" if told.get("status") == NO_EQUILIBRIUM else "The run failed"
    return f"{start}: {told.get('message', '')}. {reached}."


def _warnings(notes: Sequence[str]) -> str:
    """What the run warned of, where nobody overlooks it."""
    if not notes:
        return ""
    lines = "".join(f"<li>{html.escape(note)}</li>" for note in notes)
    return f'<section class="warn"><p>The run warned:</p><ul>{lines}</ul></section>'


def _taker(row: Row) -> str:
    return "the cavities have together" if len(cavity_columns(row, "added_volume", "ml")) > 1 else "the cavity has"


def _curves(states: States) -> str:
    with matplotlib.rc_context({**STYLE, "svg.hashsalt": "softmodels"}):
        rows, gauge = states.rows, states.actuator.gauge
        if states.case.program:
            return f'<figure class="wide">{_svg(program_plots.steps(rows, gauge))}</figure>'
        found = [f"<figure>{_svg(figure)}</figure>" for figure in plots.curves(rows, gauge, states.branch)]
        return f'<div class="curves">{"".join(found)}</div>'


def _svg(figure: Any) -> str:
    stream = io.StringIO()
    figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    text = stream.getvalue()
    return text[text.index("<svg") :]


def _contact(states: States) -> str:
    """The rigid plane of a run, and the force on it, in a sentence."""
    obstacle = states.case.obstacle
    if obstacle is None:
        return ""
    text = f"The rigid plane {obstacle.plane} stops {obstacle.faces} without friction (red in the pictures)."
    pressed = [row for row in states.rows if row.get("contact_force_N", 0.0) > ROUNDING]
    if not pressed:
        return f"<p>{html.escape(text)} Nothing reached it.</p>"
    first, row = pressed[0], states.rows[states.main]
    text += (
        f" The device pressed on it from the state at {load(first)} on; at {load(row)} with {row['contact_force_N']:.4g} N, "
        f"sunk in by {row['contact_depth_mm']:.2g} mm."
    )
    return f"<p>{html.escape(text)}</p>"


def _requested(states: States) -> str:
    asked = [row for row in states.rows if row["requested"]] or [states.rows[-1]]
    return f"<h2>Requested values</h2>{_table(asked, states.rows, states)}"


def _table(rows: Sequence[Row], every: Sequence[Row], states: States) -> str:
    """Rows of ``path.csv`` side by side: one line per column of the file. The exact value is each cell's title."""
    lines = []
    for name in (name for name in every[0] if name != "requested"):
        cells = "".join(
            f'<td title="{html.escape(str(cells.get(name, "")))}">{_shown(cells.get(name))}</td>'
            for cells in (row.cells for row in rows)
        )
        meaning = term(name, states.actuator)
        lines.append(f'<tr><th title="{html.escape(meaning.text)}">{html.escape(str(meaning))}</th>{cells}</tr>')
    return f'<div class="wide"><table class="path">{"".join(lines)}</table></div>'


def _glossary(states: States) -> str:
    """What each column of the tables is."""
    lines = []
    for name in states.rows[0]:
        if (meaning := term(name, states.actuator)).text:
            lines.append(
                f"<dt>{html.escape(str(meaning))} <code>{html.escape(name)}</code></dt>"
                f"<dd>{html.escape(meaning.text)}</dd>"
            )
    return f"<dl>{''.join(lines)}</dl>"


def _shown(value: Cell) -> str:
    if isinstance(value, float):
        return f"{value:.6g}" if abs(value) > ROUNDING else "0"
    return html.escape("" if value is None else str(value))


def _picture(path: Path, text: str) -> str:
    if not path.exists():
        return ""
    if path.suffix == ".webp":
        return _figure("image/webp", path.read_bytes(), text)
    with Picture.open(path) as image:
        small = image.convert("RGB")
        if small.width > WIDEST:
            small = small.resize((WIDEST, round(small.height * WIDEST / small.width)), Picture.Resampling.LANCZOS)
        stream = io.BytesIO()
        small.save(stream, "WEBP", quality=88, method=4)
    return _figure("image/webp", stream.getvalue(), text)


def _figure(kind: str, data: bytes, text: str) -> str:
    source = f"data:{kind};base64,{base64.b64encode(data).decode()}"
    words = html.escape(text)
    return f'<figure><img src="{source}" alt="{words}" loading="lazy"><figcaption>{words}</figcaption></figure>'


def _notes(states: States) -> str:
    """What a reader has to know before trusting a number."""
    actuator = states.actuator
    notes = [stability_text(states.rows, actuator, states.branch)]
    notes += [
        f"limit point of the pressure at {limit['pressure_cm']:.5g} cm ({limit['pressure_Pa'] / 1e3:.4g} kPa): under "
        "pressure alone the device jumps there"
        for limit in plots.limits(states.rows)
    ]
    notes.append(
        f"{len(states.cells)} cells of second order, {len(states.points)} nodes"
        + (
            f"; one of {actuator.copies} equal parts was computed, the others are its images"
            if actuator.copies > 1
            else ""
        )
    )
    notes.append(
        "the largest stress and stretch converge only at rounded corners; at sharp ones they grow with a finer mesh"
    )
    notes.append(left_out(states.case))
    return "<ul>" + "".join(f"<li>{html.escape(note)}</li>" for note in notes if note) + "</ul>"
