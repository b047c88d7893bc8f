"""``report.html``: one run on one page that needs no network and nothing installed.

Pictures, film, curves and the 3-D view are inside the file. Whatever columns ``path.csv`` has are shown.
"""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib
from markupsafe import Markup
from matplotlib.figure import Figure
from PIL import Image as Picture

from measurement.page import data_uri, image_uri, render
from measurement.user_file import check_file, read_text
from softmodels.pictures import path_curves, program_curves
from softmodels.pictures.report_case import case_tables
from softmodels.pictures.style import STYLE, load
from softmodels.pictures.viewpoint import Look
from softmodels.pictures.web_view import view
from softmodels.results.columns import term
from softmodels.results.notes import left_out, notes_of
from softmodels.results.outcomes import DONE, NO_EQUILIBRIUM
from softmodels.results.row import Cell, Row
from softmodels.results.stability_report import stability_text
from softmodels.results.state_words import StateWords
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


class Report:
    """The report of a folder of results but for its pictures, which may still be in the making.

    Args:
        look: The device.
        folder: Where its pictures are going to be.
        name: Stem of the result files.
    """

    def __init__(self, look: Look, folder: Path, name: str):
        self.folder = folder
        states, told = look.states, summary(folder)
        asked = [row for row in states.rows if row["requested"]] or [states.rows[-1]]
        terms = [(name, term(name, states.actuator, states.case.load.driver)) for name in states.rows[0]]
        self._values: dict[str, object] = {
            "title": name,
            "ending": ending(states, told),
            "warnings": told["notes"] if "notes" in told else notes_of(states.case, states.rows, states.sources),
            "view": view(look),
            "curves": _curves(states),
            "contact": _contact(states),
            "requested": _lines(asked, states),
            "every": _lines(states.rows, states),
            "case": case_tables(states),
            "notes": _notes(states),
            "toml": states.case.to_toml(),
            "columns": [(name, meaning) for name, meaning in terms if meaning.text],
        }

    def write(self, ready: Mapping[str, str]) -> Path:
        """Write it with the pictures that are there.

        Args:
            ready: Some of them as `shrunk` makes them, by the names of their files.

        Returns:
            The file.
        """
        shown = [file for file in CAPTIONS if (self.folder / file).exists()]
        pictures = [(ready.get(file) or _source(self.folder / file), CAPTIONS[file]) for file in shown]
        page = render("report.html", "softmodels.pictures", pictures=pictures, **self._values)
        write_text(self.folder / REPORT, page)
        return self.folder / REPORT


def summary(folder: Path) -> dict[str, object]:
    """What ``summary.json`` tells of how the run ended; nothing if it has not ended by itself."""
    try:
        found = json.loads(read_text(folder / "summary.json"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def ending(states: States, told: dict[str, object]) -> str:
    """How the run ended, in a sentence or two; ``told`` is its `summary`."""
    row, words = states.rows[states.main], states.words
    stroke = f"{row['stroke_ml']:.4g} ml of stroke and " if "stroke_ml" in row else ""
    reached = f"At {stroke}{load(row, words)} the {words.gauge} has risen {row[f'{words.gauge}_mm']:.4g} mm{_taken(row, words)}"
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


def _taken(row: Row, words: StateWords) -> str:
    count = len(words.volumes(row))
    taker = "the cavities have together" if count > 1 else "the cavity has"
    return f" and {taker} taken {row['added_volume_ml']:.4g} ml" if count else ""


def _curves(states: States) -> list[Markup]:
    with matplotlib.rc_context({**STYLE, "svg.hashsalt": "softmodels"}):
        rows, words = states.rows, states.words
        if states.case.program:
            return [_svg(program_curves.steps(rows, words))]
        over = path_curves.over_of(states.case)
        return [_svg(figure) for figure in path_curves.curves(rows, words, states.branch, over, states.sources)]


def _svg(figure: Figure) -> Markup:
    stream = io.StringIO()
    figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    text = stream.getvalue()
    return Markup(text[text.index("<svg") :])


def _contact(states: States) -> str:
    """The rigid plane of a run, and the force on it, in a sentence."""
    obstacle = states.case.obstacle
    if obstacle is None:
        return ""
    text = f"The rigid plane {obstacle.plane} stops {obstacle.faces} without friction (red in the pictures)."
    pressed = [row for row in states.rows if row.get("contact_force_N", 0.0) > ROUNDING]
    if not pressed:
        return f"{text} Nothing reached it."
    first, row, words = pressed[0], states.rows[states.main], states.words
    text += (
        f" The device pressed on it from the state at {load(first, words)} on; at {load(row, words)} with "
        f"{row['contact_force_N']:.4g} N, sunk in by {row['contact_depth_mm']:.2g} mm."
    )
    return text


def _lines(rows: Sequence[Row], states: States) -> list[dict[str, object]]:
    """Rows of ``path.csv`` side by side: one line per column of the file, with the exact and the shown values."""
    return [
        {
            "term": term(name, states.actuator, states.case.load.driver),
            "cells": [(row.cells.get(name, ""), _shown(row.cells.get(name))) for row in rows],
        }
        for name in states.rows[0]
        if name != "requested" and not states.words.hides(name)
    ]


def _shown(value: Cell) -> str:
    if isinstance(value, float):
        return f"{value:.6g}" if abs(value) > ROUNDING else "0"
    return "" if value is None else str(value)


def _source(path: Path) -> str:
    """A picture's file as the page holds it."""
    if path.suffix == ".webp":
        return image_uri(path)
    check_file(path)
    with Picture.open(path) as image:
        return shrunk(image)


def shrunk(image: Picture.Image) -> str:
    """A picture as the page holds it, no wider than `WIDEST`."""
    small = image.convert("RGB")
    if small.width > WIDEST:
        small = small.resize((WIDEST, round(small.height * WIDEST / small.width)), Picture.Resampling.HAMMING)
    stream = io.BytesIO()
    small.save(stream, "WEBP", quality=88, method=2)  # 4 takes three times as long for a twentieth
    return data_uri(stream.getvalue(), "image/webp")


def _pressure(row: Row) -> str:
    return f"{row['pressure_cm']:.5g} cm ({row['pressure_Pa'] / 1e3:.4g} kPa)"


def _notes(states: States) -> list[str]:
    """What a reader has to know before trusting a number."""
    actuator = states.actuator
    words = states.words
    kept = words.kept[0]
    notes = [stability_text(states.rows, actuator, words, states.branch)]
    notes += [
        f"limit point of the {kept} at {words.under(limit, _pressure(limit))}: under {kept} alone the device jumps there"
        for limit in path_curves.limits(states.rows)
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
    return [note for note in notes if note]
