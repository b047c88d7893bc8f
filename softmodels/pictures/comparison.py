"""Results side by side: what differs in their cases, their figures at common loads, and their paths and outlines overlaid."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
import re
import tomllib
from collections import Counter
from collections.abc import Callable, Mapping, Sequence, Set
from pathlib import Path

import matplotlib
import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from softmodels.case.case import Case
from softmodels.common import cards, commands, errors, files, pages
from softmodels.common.arrays import Array
from softmodels.common.lazy import scipy
from softmodels.materials import silicones
from softmodels.pictures import curves
from softmodels.pictures.style import LINE_COLOURS, STYLE, WIDTH_INCHES, chart
from softmodels.runs import columns, mesh_error, table
from softmodels.runs.budget import FORM, MATERIAL, Budget
from softmodels.runs.states import FolderStates
from softmodels.runs.store import ResultsError


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Comparison(cards.ResultCard):
    """Results side by side; the others are compared with the first.

    Attributes:
        results: At least two.
        differences: What differs in their cases.
        figures: Their main figures.
        common: The highest load that all of them reach, in the unit in which it is shown; None without a common one.
    """

    results: tuple[ComparedResult, ...]
    differences: tuple[Difference, ...]
    figures: tuple[Figures, ...]
    common: float | None

    def __str__(self) -> str:
        """The comparison for a terminal."""
        names = [result.name for result in self.results]
        cases = [["", *names], *([difference.field, *difference.values] for difference in self.differences)]
        told = ["cases:", *_aligned_lines(cases)] if self.differences else ["the cases are the same"]
        rows = [["", *names], *([figure.what, *figure.texts] for figure in self.figures)]
        return "\n".join([*told, "figures:", *_aligned_lines(rows)])

    def _line(self) -> str:
        count, rows = len(self.differences), self._figures()
        first = f"; {rows[0][0]}: {rows[0][1]}" if rows else ""
        names = " and ".join(result.name for result in self.results)
        return f"of {names}: {count} field{'s' * (count != 1)} of the cases differ{'s' * (count == 1)}{first}"

    def _figures(self) -> cards.Table:
        return [(figure.what, "; ".join(figure.texts)) for figure in self.figures]

    def _remarks(self) -> list[str]:
        return [f"{difference.field}: {'; '.join(difference.values)}" for difference in self.differences]

    @matplotlib.rc_context(STYLE)
    def plot(self) -> Figure:
        """Plot the paths over each other: the rise of the gauge over the load."""
        figure, axes = chart(4.6, 0.6 * WIDTH_INCHES)
        for result, colour in zip(self.results, itertools.cycle(LINE_COLOURS), strict=False):
            over = curves.over_of(result.case)[0]
            path = np.column_stack([result.loads, result.rows.shown(result.gauge)])
            axes.plot(*curves.smooth(path).T, color=colour, label=result.name)
            axes.plot(*path.T, "o", color=colour, markersize=3.5)
            for row in curves.limits(result.rows):
                axes.plot(row.shown(over), row.shown(result.gauge), "D", color=colour, markersize=8)
        gauges = dict.fromkeys(f"rise of the {result.case.actuator.gauge}" for result in self.results)
        axes.set(xlabel=curves.over_of(self.results[0].case)[1], ylabel=f"{' and '.join(gauges)} in mm")
        axes.set_title("Paths; a diamond is a limit point")
        axes.legend(loc="best")
        return figure

    @matplotlib.rc_context(STYLE)
    def outlines(self) -> Figure | None:
        """Plot the outlines at rest and at the highest load that all have a state at; None where there is none."""
        steps = [None if self.common is None else _step_at(result, abs(self.common)) for result in self.results]
        if not all(result.case.actuator.on_profile(result.points).any() for result in self.results):
            return None
        figure, axes = chart(4.6, 0.6 * WIDTH_INCHES)
        for result, step, colour in zip(self.results, steps, itertools.cycle(LINE_COLOURS), strict=False):
            if step is None:
                return None
            states = ((np.zeros_like(result.points), ":", ", undeformed"), (result.displacement(step), "-", ""))
            for moved, style, label in states:
                line = curves.profile(result.points, moved, result.case.actuator) * 1e3
                axes.plot(*line.T, style, color=colour, label=f"{result.name}{label}")
        axes.margins(0.05)
        if np.ptp(axes.get_ylim()) > MAX_FLAT_RATIO * np.ptp(axes.get_xlim()):
            axes.set_aspect("equal")
        axes.set(xlabel="distance in mm", ylabel="height in mm")
        figure.legend(loc="outside lower center", ncols=2, fontsize=10)
        return figure

    def html(self) -> str:
        """Return the report as one self-contained page."""
        names, first = [result.name for result in self.results], self.results[0]
        outlines = self.outlines()
        drawings = [("paths.svg", curves.drawing(self.plot(), first.case.column))]
        drawings += [("outlines.svg", curves.drawing(outlines, first.case.column))] if outlines else []
        same: list[pages.Part | None] = [pages.Text("The cases are the same.")]
        rows = [[difference.field, *difference.values] for difference in self.differences]
        head = ["", *names[:1], *itertools.chain(*((name, "difference") for name in names[1:]))]
        figures = self.figures[:1] if self.common is not None else ()
        where = f"The outlines are those {figures[0].what.removeprefix('rise ')}." if outlines else ""
        facts = [
            pages.Fact(f"{figure.what}: {name}", f"{_value(value)} {figure.unit}", change)
            for figure in figures
            for name, value, change in zip(names, figure.values, ("", *figure.told), strict=True)
        ]
        made = [
            pages.Bullets([f"{result.name}: {', '.join(f'{a} {b}' for a, b in result.made.rows)}" for result in self.results])
        ]
        sources = dict.fromkeys(text for result in self.results for text in silicones.publications(result.case.material))
        return pages.Page(
            " and ".join(names), f"{len(self.differences)} fields of the cases differ." if rows else "The cases are the same.",
            [
                ("Paths and outlines", [pages.Charts(drawings), pages.Text(where)]),
                ("Figures", [pages.Table([_cells(figure) for figure in self.figures], head)]),
                ("What differs in the cases", [pages.Table(rows, ["", *names], numbers=False)] if rows else same),
                ("Where the results come from", made),
            ],
            commands.Provenance.now(), facts, (), list(sources), {}, first.case.column,
        ).html()  # fmt: skip

    def save(self, path: str | Path) -> None:
        """Write the report to an HTML file."""
        files.write_text(Path(path), self.html())


COMPARED_COLUMNS = ("added_volume", "max_stretch", "peak_stretch", "max_von_mises", "blocked_force", "contact_force")
"""Variables compared at the highest common load, beside the rise."""
MOST_LOADS = 6
"""Common loads at most whose rises are compared."""
MISSING_TEXT = "not given"
MAX_FLAT_RATIO = 0.3
"""Height of outlines over their width below which both axes have scales of their own."""


class ComparisonError(errors.OptionMessage, ValueError):
    """What cannot be compared; the message is for the user."""


@dataclasses.dataclass(frozen=True, eq=False)
class ComparedResult:
    """One of the results: its name in the comparison, its table with its case and what is known of their errors, undeformed
    nodes in device coordinates, m, shape (n, 3), the number of cells, the displacement of a state's nodes in m, shape (n, 3),
    and where it comes from."""

    name: str
    budget: Budget
    points: Array
    cells: int
    displacement: Callable[[int], Array]
    made: commands.Provenance = dataclasses.field(default_factory=commands.Provenance)

    @classmethod
    def from_folder(cls, folder: Path) -> ComparedResult:
        """Return the results of a folder; ResultsError if it holds none that can be read, CaseError if its case file is
        wrong."""
        if not (folder / "case.toml").is_file():
            raise ResultsError(f"{folder} holds no results of a run ({errors.no_case(folder)})")
        states = FolderStates(folder)

        def displacement(step: int) -> Array:
            return states.field(step, "displacement")

        name, count = folder.resolve().name, len(states.cells)
        return cls(name, states.budget, states.points, count, displacement, states.made)

    @property
    def case(self) -> Case:
        return self.budget.case

    @property
    def rows(self) -> table.PathTable:
        return self.budget.rows

    @property
    def gauge(self) -> str:
        """Variable that stands for the device's motion."""
        return self.case.actuator.gauge

    @property
    def loads(self) -> Array:
        """The loads in the unit in which they are shown, shape (states,)."""
        return self.rows.shown(curves.over_of(self.case)[0])

    @functools.cached_property
    def sign(self) -> float:
        """-1 if the largest load is a negative one, such as a vacuum; else 1."""
        return -1.0 if -self.loads.min() > self.loads.max() else 1.0

    @functools.cached_property
    def rising(self) -> tuple[Array, table.PathTable]:
        """Sizes of the loads, and states, up to the highest one of the first part of the path, where it only rises."""
        loads = self.sign * self.loads
        falls = np.flatnonzero(np.diff(loads) <= 0.0)
        end = int(falls[0]) + 1 if len(falls) else len(loads)
        return loads[:end], self.rows[:end]


@dataclasses.dataclass(frozen=True)
class Difference:
    """A field of the case files that differs: its dotted name, and its text in each."""

    field: str
    values: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class Figures:
    """A figure of each of the results, nan where one has none, in a unit that is ``""`` for pure numbers. ``pascal`` is Pa in
    one of its unit for a height of the column; 0 for all else. ``errors`` are half the 95 % intervals of the differences to the
    first, nan where unknown."""

    what: str
    unit: str
    values: tuple[float, ...]
    pascal: float = 0.0
    errors: tuple[float, ...] = ()

    @property
    def changes(self) -> tuple[float, ...]:
        """Differences to the first, as shares of it; nan where there is none."""
        first = self.values[0]
        return tuple(value / first - 1.0 if first else math.nan for value in self.values[1:])

    @property
    def texts(self) -> list[str]:
        """The values with their unit, and with their differences in brackets."""
        changes = ["", *(f" ({text})" if text else "" for text in self.told)]
        return [f"{_value(value)} {self.unit}".strip() + change for value, change in zip(self.values, changes, strict=True)]

    @property
    def told(self) -> list[str]:
        """The differences in percent, with their errors; "" where there is none."""
        errors = self.errors or (math.nan,) * len(self.changes)
        away = [value - self.values[0] for value in self.values[1:]]
        return [self._told(*of) for of in zip(self.changes, away, errors, strict=True)]

    def _told(self, change: float, away: float, error: float) -> str:
        if not math.isfinite(change) or not error > 0.0:
            return _change(change)
        verdict = "below the error of both" if abs(away) < error else "error of both"
        return f"{_change(change)}; {verdict}, +- {error:.2g} {self.unit}"


def _cells(figures: Figures) -> list[str | pages.Cell]:
    """Return a row of the table of figures: each value, and behind all but the first its difference."""
    name = f"{figures.what} ({figures.unit})" if figures.unit else figures.what
    cells: list[str | pages.Cell] = [pages.Cell(name, unit=pages.HEIGHT if figures.pascal else "")]
    for value, change in zip(figures.values, (None, *figures.told), strict=True):
        exact = value * figures.pascal if figures.pascal and math.isfinite(value) else None
        cells += [pages.Cell(_value(value), str(value), exact), *([] if change is None else [change])]
    return cells


def _value(value: float) -> str:
    return f"{value:.5g}" if math.isfinite(value) else "none"


def _change(share: float) -> str:
    return f"{100 * share:+.3g} %" if math.isfinite(share) else ""


def _aligned_lines(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return the rows of a table as lines, each column as wide as its widest text."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    padded = ("".join(f"  {text:{width}}" for text, width in zip(row, widths, strict=True)) for row in rows)
    return [line.rstrip() for line in padded]


def compared(results: Sequence[ComparedResult]) -> Comparison:
    """Compare results; names that are the same get numbers. ComparisonError for fewer than two, or loads that cannot be
    compared."""
    if len(results) < 2:
        raise ComparisonError("nothing to compare; give two results or more")
    counted, seen = Counter(result.name for result in results), Counter[str]()
    unique = []
    for result in results:
        seen[result.name] += 1
        name = result.name if counted[result.name] == 1 else f"{result.name} ({seen[result.name]})"
        unique.append(dataclasses.replace(result, name=name))
    loaded = {curves.over_of(other.case) for other in unique}
    if len(loaded) > 1:
        loads = f"different loads ({' and '.join(sorted(label for _, label in loaded))})"
        raise ComparisonError(f"the results are over {loads}; compare runs with the same kind of load")
    return Comparison(tuple(unique), tuple(_differences(unique)), *_figures(unique, next(iter(loaded))[0]))


def _differences(results: Sequence[ComparedResult]) -> list[Difference]:
    """Return the fields of the case files that differ, in the files' order; files count by their content."""
    tables = [_flat(tomllib.loads(result.case.to_toml())) for result in results]
    differences = []
    for field in dict.fromkeys(itertools.chain(*tables)):
        texts = tuple(table.get(field, MISSING_TEXT) for table in tables)
        if field != "name" and len(set(texts)) > 1:
            short = tuple(re.sub(r"\d+\.\d{7,}", lambda digits: f"{float(digits[0]):.6g}", text) for text in texts)
            differences.append(Difference(field, short if len(set(short)) == len(set(texts)) else texts))
    return differences


def _flat(table: Mapping[str, object], where: str = "") -> dict[str, str]:
    """Return the texts of a table's fields by dotted names."""
    flat: dict[str, str] = {}
    for key, value in table.items():
        if isinstance(value, dict):
            flat |= _flat(value, f"{where}{key}.")
        else:
            flat[f"{where}{key}"] = _text(value)
    return flat


def _text(value: object) -> str:
    if isinstance(value, list):
        return ", ".join(map(_text, value)) or "none"
    if isinstance(value, str) and len(value) < 1000 and "/" in value and Path(value).is_file():
        return f"{Path(value).name} (SHA-256 {files.fingerprint(Path(value))[:12]})"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _figures(results: Sequence[ComparedResult], over: str) -> tuple[tuple[Figures, ...], float | None]:
    """Return the main figures, and the highest common load; see `Comparison`."""
    first_row = results[0].rows[0]
    meaning = columns.term(first_row.column(over))
    figures, common, sign = [], min(float(result.rising[0][-1]) for result in results), results[0].sign
    common = common if len({result.sign for result in results}) == 1 else 0.0
    if common > 0.0:
        stored = all(_step_at(result, common) is not None for result in results)
        where = f"at {sign * common:.5g} {meaning.unit}{'' if stored else ', interpolated'}"
        figures.append(_at_load(results, f"rise {where}", "mm", common))
        for name in COMPARED_COLUMNS:
            if any(name in result.rows for result in results):
                known = columns.term(next(result.rows[0].column(name) for result in results if name in result.rows))
                figures.append(_at_load(results, f"{known.name} {where}", known.unit, common, name))
        for value in _common_loads(results, common):
            figures.append(_at_load(results, f"rise at {sign * value:.5g} {meaning.unit}", "mm", value))
    pascal = results[0].case.column.pascal if meaning.unit == pages.HEIGHT else 0.0
    first = [next(iter(curves.limits(result.rows)), None) for result in results]
    if any(first):
        values = tuple(math.nan if row is None else row.shown(over) for row in first)
        errors = _errors(results, [_halves(*pair, over) for pair in zip(results, first, strict=True)])
        figures.append(Figures("limit point", meaning.unit, values, pascal, errors))
    highest = tuple(result.sign * float((result.sign * result.loads).max()) for result in results)
    figures.append(Figures(f"highest {meaning.name}", meaning.unit, highest, pascal))
    figures.append(Figures("cells", "", tuple(float(result.cells) for result in results)))
    if all(result.made.seconds is not None for result in results):
        figures.append(Figures("wall time", "s", tuple(result.made.seconds or 0.0 for result in results)))
    return tuple(figures), sign * common if common > 0.0 else None


def _at_load(results: Sequence[ComparedResult], what: str, unit: str, size: float, variable: str = "") -> Figures:
    """Return a variable of the results, else each one's gauge, at a load of the rising part of their paths."""
    names = [variable or result.gauge for result in results]
    pairs = list(zip(results, names, strict=True))
    values = tuple(_value_at_load(result, name, size) for result, name in pairs)
    return Figures(what, unit, values, errors=_errors(results, [_halves_at_load(*pair, size) for pair in pairs]))


def _errors(results: Sequence[ComparedResult], halves: Sequence[Mapping[str, float]]) -> tuple[float, ...]:
    """Return half the 95 % intervals of the differences to the first result from half widths by cause; nan where those of one
    of both are not known."""
    first = results[0]
    return tuple(
        _of_difference(halves[0], other, _shared(first.case, result.case))
        for result, other in zip(results[1:], halves[1:], strict=True)
    )


def _halves(result: ComparedResult, row: table.Row | None, variable: str) -> dict[str, float]:
    """Return half the 95 % intervals of a state's variable by cause, in the unit in which it is shown; empty if unknown."""
    if row is None or variable not in row:
        return {}
    return {part.name: mesh_error.in_unit(row, variable, part.half) for part in result.budget.contributions(row, variable)}


def _shared(first: Case, second: Case) -> set[str]:
    """Return the causes of errors that two cases have in common: those of one cast, and of one device on one bench."""
    same_cast = first.material == second.material and first.band == second.band
    same_device = first.actuator.refined(1.0 / first.actuator.finer) == second.actuator.refined(1.0 / second.actuator.finer)
    causes = {deviation.name for deviation in first.deviations if deviation in second.deviations} if same_device else set()
    return {*causes, *([MATERIAL, FORM] if same_cast else [])}


def _of_difference(first: Mapping[str, float], second: Mapping[str, float], shared: Set[str]) -> float:
    """Return half the 95 % interval of a difference, of half widths by cause: what both share enters with its difference."""
    if not first or not second:
        return math.nan
    common = [first.get(cause, 0.0) - second.get(cause, 0.0) for cause in shared]
    own = [half for halves in (first, second) for cause, half in halves.items() if cause not in shared]
    return math.hypot(*common, *own)


def _common_loads(results: Sequence[ComparedResult], common: float) -> list[float]:
    """Return loads below the highest common one that all were asked to stop at, evenly chosen if there are many."""
    asked = [
        {round(float(load), 9) for load, row in zip(*result.rising, strict=True) if row["requested"]} for result in results
    ]
    shared = sorted(value for value in set.intersection(*asked) if 0.0 < value < common * (1 - 1e-9))
    if len(shared) <= MOST_LOADS:
        return shared
    return [shared[round(k)] for k in np.linspace(0, len(shared) - 1, MOST_LOADS)]


def _step_at(result: ComparedResult, size: float) -> int | None:
    """Return the state at a load of the first, rising part of the path; None if there is none."""
    loads: npt.NDArray[np.float64] = result.rising[0]
    nearest = int(np.argmin(np.abs(loads - size)))
    return nearest if math.isclose(loads[nearest], size, rel_tol=1e-6) else None


def _value_at_load(result: ComparedResult, variable: str, size: float) -> float:
    """Return a variable at a load of the rising part, in the unit in which it is shown: of the state there, else between its
    neighbours (monotone cubic); nan if the results have none of this name."""
    loads, rows = result.rising
    if variable not in rows:
        return math.nan
    if (step := _step_at(result, size)) is not None:
        return rows[step].shown(variable)
    if size < loads[0]:
        return math.nan
    return float(scipy.interpolate.PchipInterpolator(loads, rows.shown(variable))(size))


def _halves_at_load(result: ComparedResult, variable: str, size: float) -> dict[str, float]:
    """Return half the 95 % intervals of a variable by cause at a load of the rising part, up to the last state at which each
    is known: as a share of the variable it is linear between such states, and below the first what it is there."""
    loads, rows = result.rising
    shares: dict[str, list[tuple[float, float]]] = {}
    for load, row in zip(loads.tolist(), rows, strict=True):
        if variable not in row or not (size_there := abs(row.shown(variable))):
            continue
        for cause, half in _halves(result, row, variable).items():
            shares.setdefault(cause, []).append((load, half / size_there))
    value, lines = abs(_value_at_load(result, variable, size)), {cause: np.array(own).T for cause, own in shares.items()}
    return {cause: value * float(np.interp(size, *line)) for cause, line in lines.items() if size <= line[0, -1] * (1.0 + 1e-9)}
