"""``report.html``: a run on a single self-contained page.

Pictures, film, curves and the 3-D view are inside the file. Whatever columns ``path.csv`` has are shown.
"""

from __future__ import annotations

import base64
import dataclasses
import gzip
import json
import math
import shlex
from collections.abc import Iterable, Iterator
from pathlib import Path

import matplotlib
import numpy as np
import numpy.typing as npt
from markupsafe import Markup
from matplotlib.colors import to_hex
from PIL import Image

from geometries import registry as geometry_table
from softmodels.case import materials
from softmodels.common import commands, files, pages, schema, units
from softmodels.common.arrays import Array
from softmodels.components import contact
from softmodels.materials import silicones
from softmodels.materials.laws import parameter_fields
from softmodels.mechanics import newton
from softmodels.path import steps
from softmodels.pictures import curves, offscreen, style
from softmodels.runs import columns, grid, labels, table
from softmodels.runs.notes import ending, left_out, notes_of, stability_text
from softmodels.runs.states import StoredStates

CAPTIONS = {
    "undeformed.png": "The device at rest",
    "stress.png": "Von Mises stress on the deformed device: same camera, same colour scale",
    "film.webp": "Film over the path; shapes are interpolated linearly between computed steps",
    "cut.png": "Cut open; the cut is made in the undeformed material",
    "hot-spots.png": "Regions of largest stretch",
    "slice.png": "The modelled part; thin lines: undeformed",
    "mode.png": "The buckling mode at the first bifurcation; its amplitude is arbitrary",
    "profile.png": "Outline from the side",
    "mesh.png": "The mesh",
}
"""Pictures in the order of the report, with their captions."""
REPORT = "report.html"


class Report:
    """The report of a results folder without its pictures, which may still be in progress."""

    def __init__(self, look: offscreen.Look, folder: Path, name: str):
        self.folder = folder
        states, told = look.states, summary(folder)
        viewer = Markup(files.render("web_view.html", "softmodels.pictures", view=view(look)))
        asked = states.rows.where("requested") or states.rows[-1:]
        terms = [(name, columns.term(name, states.actuator, states.case.load.driver)) for name in states.rows.columns]
        warnings = told.get("notes")
        if warnings is None:
            warnings = [*states.mesh_notes, *notes_of(states.budget)]
        self._head: list[pages.Section] = [
            *_errors(states),
            ("3-D view", [pages.Program(viewer)]),
            ("The path", [pages.Charts(_curves(states)), pages.Text(_contact(states))]),
        ]
        case = [pages.Table(rows, numbers=False, caption=heading) for heading, rows in case_tables(states)]
        self._tail: list[pages.Section] = [
            ("Requested values", [_lines(asked, states)]),
            ("The case", [*case, pages.Folded("case.toml", [pages.Listing(states.case.to_toml())])]),
            ("Convergence", [pages.Bullets(convergence(states))]),
            ("Notes", [pages.Bullets(_notes(states))]),
            ("All steps", [
                pages.Folded("Columns", [pages.Terms([(str(meaning), name, meaning.text) for name,
                meaning in terms if meaning.text])]),
                pages.Folded("Every state", [_lines(states.rows, states)]),
            ]),
        ]  # fmt: skip
        made = states.made
        if made.date and not made.command:  # run by a Python program
            made = dataclasses.replace(made, command=shlex.join(["softmodels", "run", f"{folder}/case.toml"]))
        self._page = pages.Page(
            name, ending(states.rows, states.rows[states.main], states.words, told), (), made,
            facts(states, told), warnings if isinstance(warnings, list) else [], silicones.publications(states.case.material),
            {"path.csv": files.read_text(folder / "path.csv")} if (folder / "path.csv").exists() else {}, states.case.column,
        )  # fmt: skip

    def write(self) -> Path:
        """Write the report with the pictures that are in the folder; return its file."""
        shown = [self.folder / name for name in CAPTIONS if (self.folder / name).exists()]
        pictures = [pages.Picture(files.image_uri(file), CAPTIONS[file.name], _last_frame(file)) for file in shown]
        page = dataclasses.replace(self._page, sections=[*self._head, ("Pictures", pictures), *self._tail])
        files.write_text(self.folder / REPORT, page.html())
        return self.folder / REPORT


ROUNDING_TOLERANCE = 1e-12
"""Values below this, in the columns' units, are rounding errors."""


# ----------------------------------------------------------------------------------------------------------------------
# The case of a report: device, material, load and solver as tables with units.


type CaseTable = tuple[str, list[tuple[str, str, str]]]
"""A heading, and for each parameter its name, value and description."""


def case_tables(states: StoredStates) -> list[CaseTable]:
    """Return all tables of a case."""
    device, material = states.actuator, states.case.material
    fields, laws = schema.about(device), {field.name: field.metadata["help"] for field in parameter_fields(material)}
    laws["fitted_stretch"] = "fitted range of stretch"
    shown, law = geometry_table.to_table(device, units.readable), materials.to_table(material, units.readable)
    initial = f"{material.shear_modulus_0 / 1e3:.4g} kPa"
    silicone = [(name, value, laws.get(name, "")) for name, value in law.items() if name != "law"]
    tables: list[tuple[str, Iterable[tuple[str, object, str]]]] = [
        (f"Device: {type(device).__name__}",
         [(name, value, fields[name].help) for name, value in shown.items() if name != "device"]),
        (f"Material: {material.name}", [*silicone, ("initial shear modulus", initial, "of all terms together")]),
        ("Load and solver", _load(states)),
    ]  # fmt: skip
    return [(title, [(name.replace("_", " "), _text(value), words) for name, value, words in rows]) for title, rows in tables]


def _load(states: StoredStates) -> Iterator[tuple[str, object, str]]:
    case = states.case
    asked = [] if case.program else [(case.load.requested.words, ", ".join(map(units.written, case.values)))]
    for course in steps.courses(case.steps) if case.program else ():
        added = " added" if course.quantity == steps.VOLUME else ""
        asked.append((course.name, ", ".join(f"{units.written(value)}{added}" for value in course.values)))
    if case.timed:
        asked.append(("time", ", ".join(f"{time:g} s" for time in steps.times_of(case.steps))))
    for what, text in asked:
        yield what, text, "requested"
    if case.load.has_pressure:
        pascal = case.column.pascal
        yield "water density", f"{case.water_density:g} kg/m^3", f"{case.column.text(pascal)} is {pascal:.4g} Pa"
    yield "control", case.control, "control of the continuation"
    yield "formulation", case.formulation, "unknowns of the equations"
    for part in case.components:
        for name, value in part.write_table(units.readable).items():
            yield f"{part.where.strip('[]')} {name}", str(value), part.explained.get(name, "")
    if case.supply is not None:
        texts = {field.key or name: field.help for name, field in schema.about(case.supply).items()}
        for name, value in schema.to_table(case.supply, units.readable).items():
            yield name, value, texts[name]


def _text(value: object) -> str:
    if isinstance(value, list | tuple):
        return ", ".join(map(_text, value))
    return f"{value:.6g}" if isinstance(value, float) else str(value)


# ----------------------------------------------------------------------------------------------------------------------
# The interactive 3-D view of a report: the packed surface of all steps, and the WebGL program that draws it.
#
# A WebGL program of 13 kB instead of a library: Plotly's would add 4.8 MB to every report and hold each
# step's whole device as numbers of 8 bytes; three.js and vtk.js come from servers or from another language's packages. This
# one needs neither network nor installation, keeps one slice and its images, and 10 bytes per vertex and step before packing.


MAX_VIEW_VALUES = 2_500_000
"""Maximum vertices times steps of a view; with more, some steps are skipped."""
MAX_UINT16 = 65535


def view(look: offscreen.Look) -> dict[str, object]:
    """Return the data of the template ``web_view.html``: the controls' ranges, the data and their description."""
    states = look.states
    steps = _steps(states)
    meta, data = packed(look, steps)
    colours, count = style.colormap(look.colours)(np.linspace(0, 1, 52))[:, :3], len(states.rows)
    left = count - len(steps)
    return {
        "last": len(steps) - 1, "begin": steps.index(states.main), "axial": states.actuator.axial,
        "fields": [scale.what for scale in look.scales.values()],
        "left_out": f"{left} of {count} steps are omitted here." if left else "",
        "gradient": ",".join(map(to_hex, colours)),
        "meta": Markup(json.dumps(meta).replace("</", "<\\/")), "data": base64.b64encode(data).decode(),
    }  # fmt: skip


def _steps(states: StoredStates) -> list[int]:
    """Return the steps of the view: all, or as many as possible, preferring the requested ones."""
    count = len(states.rows)
    most = max(MAX_VIEW_VALUES // max(len(states.points), 1), 2)
    if count <= most:
        return list(range(count))
    spread = {int(k) for k in np.linspace(0, count - 1, most).round()}
    return sorted(spread | {0, states.main, *(round(step) for step in states.shown())})


SUBTETRAHEDRA = ((0, 4, 6, 7), (1, 5, 4, 8), (2, 6, 5, 9), (3, 7, 9, 8), (4, 9, 5, 6), (4, 9, 6, 7), (4, 9, 7, 8), (4, 9, 8, 5))
"""A tetrahedron of ten nodes, in VTK's order, as eight of four nodes, whose faces are those of `QUARTERS`."""


def solid_cells(states: StoredStates) -> tuple[grid.Cells, grid.Cells]:
    """Return cells of a solid, shape (c, k), and the tetrahedra that each is cut as, of k nodes, shape (p, 4).

    Those of a half section are prisms between its nodes and the turned ones, each quarter of which is three tetrahedra.
    """
    if states.actuator.dimension == 3:
        return states.cells, np.array(SUBTETRAHEDRA)
    parts = [((a, b, c, a + 6), (b, c, a + 6, b + 6), (c, a + 6, b + 6, c + 6)) for a, b, c in grid.QUARTERS]
    return np.concatenate([states.cells, states.cells + len(states.points)], axis=1), np.reshape(parts, (-1, 4))


def packed(look: offscreen.Look, steps: list[int]) -> tuple[dict[str, object], bytes]:
    """Return the packed data of the view's program at some steps: the description (lengths in m; each cell, of as many nodes
    as ``split`` names, is cut as the tetrahedra in it), and the packed numbers: triangles, edges and cells, then for each
    step places and fields of the nodes; of a half section of its nodes, and of these turned to the end of the wedge that is
    drawn."""
    states, skin, count = look.states, look.states.skin, len(look.states.points)
    flat = states.actuator.dimension == 2
    node = skin.nodes + count * skin.turned
    order = np.argsort(skin.part[skin.part != grid.CUT_LABEL], kind="stable")  # the outside first
    triangles, edges = node[skin.triangles[skin.part != grid.CUT_LABEL][order]], node[skin.edges]
    cells, split = solid_cells(states)

    def whole(nodal: Array, turned: Array) -> Array:
        return np.concatenate([nodal, turned]) if flat else nodal

    places = [whole(moved, moved @ grid.turn(grid.SECTOR_DEGREES).T) for moved in map(states.moved, steps)]
    low = np.min([place.min(axis=0) for place in places], axis=0)
    span = float(max(np.max([place.max(axis=0) for place in places], axis=0) - low))
    pieces = [
        _bytes(half) for numbers in (triangles, edges, cells) for half in (numbers.ravel() & 0xFFFF, numbers.ravel() >> 16)
    ]
    before: list[Array | float] = [0] * (1 + len(look.scales))
    for step, place in zip(steps, places, strict=True):
        columns = [np.round((place - low) / span * MAX_UINT16).ravel()]
        for name, scale in look.scales.items():
            values = scale.share(states.field(step, name))
            columns.append(np.round(whole(values, values) * MAX_UINT16))
        for k, column in enumerate(columns):
            pieces.append(_bytes(column - before[k]))
            before[k] = column
    rest = look.rest(everything := np.arange(len(skin.images)))
    camera = offscreen.ViewCamera.around([rest, look.points(states.main, everything)], look.direction, look.up)
    colours = (style.colormap(look.colours)(np.linspace(0, 1, 256))[:, :3] * 255).round().astype(int)
    meta = {
        "subject": style.subject(states.case), "vertices": len(places[0]), "triangles": len(triangles),
        "outside": int((skin.part == grid.OUTSIDE_LABEL).sum()), "edges": len(edges), "cells": len(cells),
        "split": split.tolist(),
        "low": low.tolist(), "span": span, "planes": skin.planes.tolist(),
        "images": skin.images.reshape(-1, 9).round(12).tolist(),
        "box": [rest.min(axis=0).tolist(), rest.max(axis=0).tolist()],
        "direction": list(camera.direction), "up": list(camera.up), "focus": list(camera.focus),
        "scale": 1.1 * camera.scale, "aspect": camera.size[0] / camera.size[1], "colours": colours.tolist(),
        "fields": [
            {"what": shades.what, "label": f"{shades.what}, {shades.kind}", "unit": shades.unit, "low": shades.low,
             "power": shades.power, "top": shades.top} for shades in look.scales.values()
        ],
        "steps": [{"step": step, "label": labels.headline(states.rows[step], states.words)} for step in steps],
    }  # fmt: skip
    return meta, gzip.compress(b"".join(pieces), 6, mtime=0)


def _bytes(column: npt.NDArray[np.number]) -> bytes:
    """Return the whole numbers modulo 65536, low bytes before high bytes: neighbours differ little, which packs well."""
    return np.asarray(column).astype(np.int64).astype("<u2").view(np.uint8).reshape(-1, 2).T.tobytes()


# ----------------------------------------------------------------------------------------------------------------------
# The answer, and what it rests on.


def facts(states: StoredStates, told: dict[str, object]) -> list[pages.Fact]:
    """Return the figures that a run was made for: rise, limit, largest stretch."""
    row, words = states.rows[states.main], states.words
    overlap = labels.overlap_text(row)
    under = labels.load(row, words).removesuffix(f" - {overlap}") if overlap else labels.load(row, words)
    error = states.budget.half_text(row, words.gauge)
    note = overlap or f"at {under}{f'; {error}' if error else ''}"
    rise = pages.Fact(f"Rise of the {words.gauge}", row.told(words.gauge), note, bool(overlap))
    device = states.case.actuator
    further = ((columns.term(row.column(name), device).name.capitalize(), row.told(name)) for name in device.headline)
    return [rise, *(pages.Fact(*fact) for fact in further), _limit(states, told), *_stretch(states)]


def _errors(states: StoredStates) -> Iterator[pages.Section]:
    """Yield the section on the error of the gauge's rise and its contributions; nothing if none is known."""
    known, gauge = states.budget, states.words.gauge
    row = next((row for row in known.stated if not row.get("limit")), None)
    if row is not None and (told := known.contributions(row, gauge)):
        drawn = []
        if len(told) > 1:
            with matplotlib.rc_context(style.STYLE):
                figure = curves.contributions(row, gauge, told)
            drawn = [pages.Charts([(f"{states.name}-errors.svg", curves.drawing(figure, states.case.column))])]
        yield f"Error of the {gauge} rise", [*drawn, pages.Bullets([*known.lines(), known.next_step(row, gauge)])]


def _limit(states: StoredStates, told: dict[str, object]) -> pages.Fact:
    """Return the limit point that was met and the margin to it, or how far none was."""
    rows, words, row = states.rows, states.words, states.rows[states.main]
    name, raised = f"Limit point of the {words.kept[0]}", words.along[0]
    if states.case.program:
        name = "Limit point of the loads"
    if limit_points := curves.limits(rows):
        beyond = told.get("status") == commands.EXIT_NO_EQUILIBRIUM
        note = "there is no equilibrium at what was requested beyond it" if beyond else ""
        if not beyond and not states.case.program and row["requested"] and row[raised]:
            note = f"{limit_points[0][raised] / row[raised]:.3g} times the last requested {words.kept[0]}"
        return pages.Fact(name, labels.load(limit_points[0], words), note, beyond)
    highest = rows[int(np.abs(rows[raised]).argmax())]
    way = "up" if highest[raised] >= 0.0 else "down"
    note = "the margin is not known from this run: softmodels limit case.toml finds it"
    return pages.Fact(name, f"none {way} to {labels.load(highest, words)}", note if words.kept[0] == "pressure" else "")


def _stretch(states: StoredStates) -> list[pages.Fact]:
    """Return the largest stretch beside those that the material was fitted to and breaks at."""
    if "max_stretch" not in states.rows:
        return []
    most, material = float(states.rows["max_stretch"].max()), states.case.material
    fitted, breaks = silicones.stretches_of(material), silicones.stretch_at_break(material)
    known = [f"fitted up to {fitted[1]:.4g}"] if fitted else ["the range of the material's fit is unknown"]
    known += [silicones.break_words(material)] if breaks else []
    beyond = most > min(fitted[1] if fitted else math.inf, breaks or math.inf)
    return [pages.Fact("Largest stretch", f"{most:.4g}", "; ".join(known), beyond)]


def convergence(states: StoredStates) -> list[str]:
    """Return what is known of the errors of a run's numbers, in sentences."""
    rows = states.rows.where(lambda row: not row.get("bifurcation"))
    text = f"Newton's method converged in every state: residual below {newton.RESIDUAL_TOLERANCE:g} of the pressure's load"
    if "newton_iterations" in states.rows:
        text += f", {rows['newton_iterations'].sum():.0f} iterations in {len(rows)} states"
    count = f"{len(states.cells)} cells of second order, {len(states.points)} nodes"
    return [
        f"{text}.",
        f"Mesh: {count}. {states.budget.mesh.text()}",
        "The largest stress and stretch converge only at rounded corners; at sharp ones they grow with mesh refinement.",
    ]


def summary(folder: Path) -> dict[str, object]:
    """Return ``summary.json``'s data on the end of the run; empty if it was interrupted."""
    try:
        values = files.read_json(folder / "summary.json")
    except (OSError, ValueError):
        return {}
    return values if isinstance(values, dict) else {}


def _curves(states: StoredStates) -> list[tuple[str, str]]:
    """Return the curves of a path: names of files and drawings."""
    with matplotlib.rc_context(style.STYLE):
        rows, words = states.rows, states.words
        if states.case.program:
            looped = states.case.timed and curves.notes.cycles(rows)
            drawn = {"steps": curves.steps(rows, words), **({"loop": curves.loop(rows, words)} if looped else {})}
            figures = list(drawn.items())
        else:
            drawings = curves.curves(rows, words, states.branch, curves.over_of(states.case), states.sources)
            figures = [(f"path-{number}", figure) for number, figure in enumerate(drawings, 1)]
        return [(f"{states.name}-{name}.svg", curves.drawing(figure, states.case.column)) for name, figure in figures]


def _contact(states: StoredStates) -> str:
    """The rigid plane of a run, and the force on it, in a sentence."""
    obstacle = contact.obstacle_of(states.case.components)
    if obstacle is None:
        return ""
    text = f"The rigid plane {obstacle.plane} is in frictionless contact with {obstacle.faces} (red in the pictures)."
    pressed = states.rows.where(lambda row: row.get("contact_force") > ROUNDING_TOLERANCE)
    if not pressed:
        return f"{text} No contact occurred."
    first, row, words = pressed[0], states.rows[states.main], states.words
    force, depth = row.told("contact_force"), row.told("contact_depth", ".2g")
    text += f" Contact starts at {labels.load(first, words)}; at {labels.load(row, words)} the force is {force}"
    return f"{text}, the penetration {depth}."


def _lines(rows: table.PathTable, states: StoredStates) -> pages.Table:
    """Return the rows of ``path.csv`` side by side: one line per column of the file, with exact and displayed values."""
    lines = []
    for name in states.rows.columns:
        if name == "requested" or states.words.hides(name):
            continue
        meaning = columns.term(name, states.actuator, states.case.load.driver)
        pressed = meaning.unit == pages.HEIGHT
        cells = [(row.cells.get(name, ""), _shown_value(row.cells.get(name))) for row in rows]
        values = [
            pages.Cell(shown, str(exact), states.case.column.pascal * exact if pressed and isinstance(exact, float) else None)
            for exact, shown in cells
        ]
        lines.append([pages.Cell(str(meaning), meaning.text, unit=meaning.unit if pressed else ""), *values])
    return pages.Table(lines)


def _shown_value(value: table.Cell) -> str:
    if isinstance(value, float):
        return f"{value:.6g}" if abs(value) > ROUNDING_TOLERANCE else "0"
    return "" if value is None else str(value)


def _last_frame(path: Path) -> str:
    """Return the last frame of a film as embedded in the page; empty for a picture."""
    if path.suffix != ".webp":
        return ""
    with Image.open(path) as film:
        film.seek(getattr(film, "n_frames", 1) - 1)
        return files.data_uri(style.encoded(film.convert("RGB"), style.DPI), "image/png")


def _notes(states: StoredStates) -> list[str]:
    actuator, words = states.actuator, states.words
    kept = words.kept[0]
    notes = [stability_text(states.rows, actuator, words, states.branch)]
    for limit in curves.limits(states.rows):
        at = words.under(limit, f"{limit.told('pressure', '.5g')} ({limit['pressure'] / 1e3:.4g} kPa)")
        notes.append(f"limit point of the {kept} at {at}: under {kept} control the device snaps through there")
    if actuator.copies > 1:
        notes.append(f"one of {actuator.copies} equal parts was computed, the others are mirror images")
    notes.append(left_out(states.case))
    return [note for note in notes if note]
