"""The end of a run: results gathered, pictures drawn, and one sentence for the user."""

from __future__ import annotations

import math

from measurement.own_folder import OwnFolderError
from measurement.terminal import say
from softmodels.case.case import Case
from softmodels.cli.drawing import Drawing
from softmodels.materials.silicones import stretch_at_break
from softmodels.results.columns import term
from softmodels.results.notes import notes_of
from softmodels.results.outcomes import BAD_INPUT, DONE, FAILED, NO_EQUILIBRIUM
from softmodels.results.row import Row
from softmodels.results.stability_report import stability_text
from softmodels.results.state_words import StateWords, overlap_text, state_words
from softmodels.results.store import Results
from softmodels.results.terms import at_rise, split
from softmodels.runs.gathering import branch_rows, gather, not_gathered


def close(case: Case, results: Results, status: int, message: str, quiet: bool, drawing: Drawing | None) -> int:
    """Gather the results, draw them if ``drawing`` is given, say how it ended."""
    stored, took = results.stored, None
    notes = notes_of(case, results.rows, results.sources(case)) if stored and status != BAD_INPUT else []
    if stored and status != BAD_INPUT:
        try:
            gather(case, results, status, message, notes)
            results.own.forget_unwritten()
            if drawing is not None and status in (DONE, NO_EQUILIBRIUM):
                if not quiet:
                    say(drawing.begins, err=True)
                took = drawing.draw(results, quiet)
        except (OSError, OwnFolderError) as error:
            status = status or FAILED
            message = message or not_gathered(error)
    if message:
        states = "1 state" if len(stored) == 1 else f"{len(stored)} states"
        where = (
            f". The results up to there ({states}) are in {results.own.path}" if stored and status != BAD_INPUT else ""
        )
        if drawing is not None and took is not None and not quiet:
            where += f": {drawing.made}, in {took:.1f} s"
        say(f"softmodels: {message}{where}", err=True)
    for note in notes if not quiet else []:
        say(f"softmodels: note: {note}", err=True)
    if not message and not quiet:
        row, words = results.rows[-1], state_words(case)
        gauge = words.gauge
        volume = (
            f"added volume {row['added_volume_ml']:.5g}{_band(row, 'added_volume_95_ml')} ml" if words.volume else ""
        )
        say(
            f"{_loaded(row, words)}: {gauge} rise {row[f'{gauge}_mm']:+.5g}{_band(row, f'{gauge}_95_mm')} mm"
            f"{f', {volume}' if volume else ''}{pressed(row)}, "
            f"largest stretch {row['max_stretch']:.4g}{_bears(case)} and von Mises stress {row['max_von_mises_kPa']:.4g} kPa "
            f"(at integration points), J {row['J_min']:.4f} to {row['J_max']:.4f} (at vertices)"
            f"{f'; {overlap}' if (overlap := overlap_text(row)) else ''}"
        )
        if text := _sideways(row, gauge):
            print(text)
        if case.gauges.columns():
            say(", ".join(_gauge(name, row) for name in case.gauges.columns()))
        if told := stability_text(results.rows, case.actuator, words, branch_rows(results)):
            say(told)
        pictures = "" if drawing is None or took is None else f"; {drawing.made}, in {took:.1f} s"
        say(
            f"{len(stored)} states in {results.folder}: path.csv, {results.name}.vtkhdf for ParaView{pictures}{_solved_on()}"
        )
    return status


def _solved_on() -> str:
    """On how many ranks, where they are several."""
    from mpi4py import MPI

    ranks = MPI.COMM_WORLD.size
    return f"; solved on {ranks} ranks" if ranks > 1 else ""


def _gauge(column: str, row: Row) -> str:
    """A named place or angle with its unit."""
    name, unit = split(column)
    return f"{name.replace('_', ' ')} {row[column]:.5g}{unit if unit == '°' else f' {unit}'}"


def _band(row: Row, column: str) -> str:
    """Half the 95 % interval of the material's errors, behind a value; nothing where it is not known."""
    width = row.get(column, math.nan)
    return "" if math.isnan(width) or not width else f" +- {width:.3g} (95 %)"


def _sideways(row: Row, gauge: str) -> str:
    """What the bands behind the values are, and the pressure's own, which is another one at equal rise and at equal volume."""
    at_volume, rising = (row.get(column, math.nan) for column in ("pressure_95_cm", at_rise(gauge)))
    if math.isnan(at_volume) or not at_volume:
        return ""
    same = "" if math.isnan(rising) else f"+- {rising:.3g} cm at equal rise of the {gauge}, "
    return (
        f"95 % by the material's errors: rise and volume at the requested value; the pressure {same}+- {at_volume:.3g} cm at "
        "equal added volume"
    )


def _loaded(row: Row, words: StateWords) -> str:
    cavities, pressure = words.pressures(row), f"{row['pressure_cm']:.6g} cm ({row['pressure_Pa'] / 1e3:.5g} kPa)"
    if "load_step" in row and len(cavities) > 1:
        pressure = ", ".join(f"cavity{i} {row[name]:.6g} cm" for i, name in enumerate(cavities, 1))
    return words.under(row, pressure)


def pressed(row: Row) -> str:
    """The forces of the device on what stops it, as a part of the closing line."""
    forces = ("blocked_force_N", "contact_force_N")
    return "".join(f", {term(name).name} {row[name]:.4g} N" for name in forces if name in row)


def _bears(case: Case) -> str:
    breaks = stretch_at_break(case.material)
    return "" if breaks is None else f" (broke at {breaks:.4g})"
