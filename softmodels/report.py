"""``report.html``: one run on one page that needs no network and nothing installed.

Pictures, film, curves and the 3-D view are inside the file. Whatever columns ``path.csv`` has are shown.
"""

from __future__ import annotations

import base64
import dataclasses
import html
import io
import json
from pathlib import Path
from typing import Any

import matplotlib
from PIL import Image as Picture

from geometries import table as geometry_table
from softmodels import material_table, plots, program_plots
from softmodels.closing import volume_note
from softmodels.outcomes import DONE, NO_EQUILIBRIUM
from softmodels.pages import STYLE, load
from softmodels.results import write_text
from softmodels.rows import cavity_columns
from softmodels.states import States
from softmodels.viewer import view
from softmodels.views import Look

WIDEST = 1200
"""Pictures are made smaller than this many pixels wide inside the page; the files keep their own size."""
CAPTIONS = {
    "undeformed.png": "The device at rest",
    "stress.png": "Von Mises stress on the deformed device: one camera, one colour scale",
    "film.gif": "Film over the path; between the computed steps the shape goes straight from one to the next",
    "cut.png": "Cut open; the cut is made in the undeformed material",
    "hot-spots.png": "Where the silicone is stretched most",
    "slice.png": "The modelled part; thin lines: undeformed",
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
    parts = [
        f"<h1>{html.escape(name)}</h1>",
        f'<p class="lead">{html.escape(ending(states, folder))}</p>',
        "<h2>In 3-D</h2>", view(look),
        "<h2>The path</h2>", _curves(states),
        _requested(states),
        "<h2>Pictures</h2>", *(_picture(folder / stem, text) for stem, text in CAPTIONS.items()),
        "<h2>The case</h2>", _device(states), _material(states), _load(states),
        "<h2>What to know</h2>", _notes(states),
        "<details><summary>All steps</summary>", _table(states.rows, states.rows), "</details>",
        f"<details><summary>case.toml</summary><pre>{html.escape(states.case.to_toml())}</pre></details>",
    ]  # fmt: skip
    page = (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{html.escape(name)}</title>'
        '<meta name="viewport" content="width=device-width, initial-scale=1"><link rel="icon" href="data:,">'
        f"<style>{CSS}</style></head><body><main>\n" + "\n".join(parts) + "\n</main></body></html>\n"
    )
    write_text(folder / REPORT, page)
    return folder / REPORT


def ending(states: States, folder: Path) -> str:
    """How the run ended, in a sentence or two."""
    row, gauge = states.rows[states.main], states.actuator.gauge
    reached = (
        f"At {load(row)} the {gauge} has moved {row[f'{gauge}_mm']:+.4g} mm and "
        f"{_taker(row)} taken {row['added_volume_ml']:.4g} ml"
    )
    if "max_stretch" in row:
        reached += f"; the largest stretch is {row['max_stretch']:.3g}"
    try:
        summary = json.loads((folder / "summary.json").read_text())
    except (OSError, ValueError):
        return f"The run has not ended by itself; {len(states.rows)} states are stored. {reached}."
    if summary.get("status") == DONE:
        return f"All requested values were reached in {len(states.rows)} states. {reached}."
    start = "The run stopped at a limit point" if summary.get("status") == NO_EQUILIBRIUM else "The run failed"
    return f"{start}: {summary.get('message', '')}. {reached}."


def _taker(row: dict[str, Any]) -> str:
    return "the cavities have together" if len(cavity_columns(row, "added_volume", "ml")) > 1 else "the cavity has"


def _curves(states: States) -> str:
    stream = io.StringIO()
    with matplotlib.rc_context({**STYLE, "svg.hashsalt": "softmodels"}):
        gauge = states.actuator.gauge
        program = states.case.program
        figure = program_plots.steps(states.rows, gauge) if program else plots.curves(states.rows, gauge, states.branch)
        figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    text = stream.getvalue()
    return f'<figure class="curves">{text[text.index("<svg") :]}</figure>'


def _requested(states: States) -> str:
    asked = [row for row in states.rows if row["requested"]] or [states.rows[-1]]
    return f"<h2>Requested values</h2>{_table(asked, states.rows)}"


def _table(rows: list[dict[str, Any]], every: list[dict[str, Any]]) -> str:
    """Rows of ``path.csv`` side by side: one line per column of the file. The exact value is each cell's title."""
    names = [name for name in every[0] if name != "requested"]
    lines = []
    for name in names:
        cells = "".join(
            f'<td title="{html.escape(str(row.get(name, "")))}">{_shown(row.get(name))}</td>' for row in rows
        )
        lines.append(f"<tr><th>{html.escape(_words(name))}</th>{cells}</tr>")
    return f'<div class="wide"><table class="path">{"".join(lines)}</table></div>'


def _words(column: str) -> str:
    """A column's name with its unit in brackets: ``apex_mm`` is "apex (mm)"."""
    stem, _, unit = column.rpartition("_")
    units = {"cm", "mm", "ml", "Pa", "kPa", "mJ", "N", "deg"}
    if column.endswith("_N_per_m"):
        stem, unit = column.removesuffix("_N_per_m"), "N/m"
    elif column.endswith("_Pa_per_mm2"):
        stem, unit = column.removesuffix("_Pa_per_mm2"), "Pa/mm²"
    elif column.endswith("_per_m"):
        stem, unit = column.removesuffix("_per_m"), "1/m"
    elif unit not in units:
        return column.replace("_", " ")
    return f"{stem.replace('_', ' ')} ({unit})"


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}" if abs(value) > ROUNDING else "0"
    return html.escape("" if value is None else str(value))


def _picture(path: Path, text: str) -> str:
    if not path.exists():
        return ""
    if path.suffix == ".gif":
        return _figure("image/gif", path.read_bytes(), text)
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


def _device(states: States) -> str:
    device = states.actuator
    table = geometry_table.to_table(device)
    texts = {field.name: field.metadata["help"] for field in dataclasses.fields(device)}
    rows = [(name, value, texts.get(name, "")) for name, value in table.items() if name != "device"]
    return _parameters(f"Device: {type(device).__name__}", rows)


def _material(states: States) -> str:
    material = states.case.material
    table = material_table.to_table(material)
    texts = {field.name: field.metadata["help"] for field in dataclasses.fields(material)}
    rows = [(name, value, texts.get(name, "")) for name, value in table.items() if name != "law"]
    initial = f"{material.shear_modulus_0 / 1e3:.4g} kPa"
    return _parameters(
        f"Material: {material.name}", [*rows, ("initial shear modulus", initial, "of all terms together")]
    )


def _load(states: States) -> str:
    case = states.case
    asked = [
        ({"pressure": "pressures", "volume": "added volumes"}.get(case.quantity, "strokes"), case.values, case.unit)
    ]
    if case.program:
        asked = [
            (f"cavity{i}", series.values, f"{series.unit}{' added' if series.is_volume else ''}")
            for i, series in enumerate(case.program, 1)
        ]
    rows = [
        *(
            (what, ", ".join(f"{value:g}" for value in values) + f" {unit}", "requested")
            for what, values, unit in asked
        ),
        ("water density", f"{case.water_density:g} kg/m^3", f"1 cm is {case.cm:.4g} Pa"),
        ("control", case.control, "what the path follows"),
        ("formulation", case.formulation, "unknowns of the equations"),
    ]
    if case.sheet is not None:
        rows.append(("sheet", f"{case.sheet.face}, {case.sheet.stiffness:g} N/m", "bonded thin sheet"))
    if case.obstacle is not None:
        rows.append(("contact", f"{case.obstacle.faces} on {case.obstacle.plane}", "rigid plane without friction"))
    return _parameters("Load and solver", rows)


def _parameters(title: str, rows: list[tuple[str, Any, str]]) -> str:
    def text(value: Any) -> str:
        return ", ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)

    lines = "".join(
        f"<tr><th>{html.escape(name.replace('_', ' '))}</th><td>{html.escape(text(value))}</td>"
        f"<td>{html.escape(words)}</td></tr>"
        for name, value, words in rows
    )
    return f"<h3>{html.escape(title)}</h3><table>{lines}</table>"


def _notes(states: States) -> str:
    """What a reader has to know before trusting a number."""
    row, actuator = states.rows[states.main], states.actuator
    notes = [volume_note(row)] if "J_min" in row else []
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
    notes.append("the silicone is elastic; weight, viscosity and contact of walls are not in the model")
    return "<ul>" + "".join(f"<li>{html.escape(note)}</li>" for note in notes if note) + "</ul>"


CSS = """
body{font:16px/1.5 system-ui,sans-serif;color:#102a43;background:#f5f7fa;margin:0}
main{max-width:1100px;margin:0 auto;padding:1.5rem;background:#fff}
h1{margin:.2em 0}h2{margin:1.6em 0 .5em;border-bottom:1px solid #d9e2ec}h3{margin:1.2em 0 .3em}
.lead{font-size:1.1em}.note{color:#627d98;font-size:.9em;margin:.3em 0}
figure{margin:1.2em 0;text-align:center}img{max-width:100%;height:auto}figcaption{color:#627d98;font-size:.9em}
.curves svg{width:100%;height:auto}
table{border-collapse:collapse;font-size:.92em}th,td{padding:.15em .7em;border-bottom:1px solid #e4e7eb;text-align:left}
th{font-weight:500}.wide{overflow-x:auto}.path td{text-align:right;font-variant-numeric:tabular-nums}
.path th{position:sticky;left:0;background:#fff;white-space:nowrap}
details{margin:1em 0}summary{cursor:pointer}pre{background:#f5f7fa;padding:1em;overflow-x:auto}
#viewer canvas{width:100%;height:520px;display:block;border:1px solid #d9e2ec;touch-action:none;cursor:grab}
#viewer.off canvas,#viewer.off .bar{display:none}
.bar{display:flex;flex-wrap:wrap;gap:.7em;align-items:center;padding:.4em 0}.bar #viewer-step{flex:1;min-width:10em}
.colours{margin-left:auto;display:flex;gap:.5em;align-items:center;font-size:.9em}
.colours i{display:inline-block;width:10em;height:.8em}
"""
