"""Predict every device of the open inflation benchmark, and write its page.

uv run python -m tests.validation                      # all of them, errors and coverage
uv run python -m tests.validation beam plain           # those whose name or group has one of the words
uv run python -m tests.validation --write              # also docs/pages/explanation/benchmark.md and its picture
uv run python -m tests.validation --cases FOLDER       # no solving: the cases as files, and as decks for CalculiX
"""

from __future__ import annotations

import argparse
import dataclasses
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

import softmodels as sm
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.case.load import steps_of
from softmodels.common.units import COLUMN
from softmodels.materials.laws import Material
from softmodels.pictures.style import CURVE, FAINT, INK, STYLE
from tests.validation.devices import HERE, Measured, beam, cylinder, membranes

PAGE = HERE.parents[1] / "docs" / "pages" / "explanation" / "benchmark.md"
PICTURE = PAGE.parents[1] / "img" / "benchmark.png"
BEGIN, END = "<!-- figures -->", "<!-- end of figures -->"


@dataclasses.dataclass(frozen=True)
class Predicted:
    """A device's points as predicted.

    Attributes:
        of: The measured ones.
        values: Predicted with its material; NaN where the run ends before.
        low, high: Least and largest prediction of the silicone's published sources; NaN where they were not solved.
        seconds: Wall time of the run.
    """

    of: Measured
    values: np.ndarray
    low: np.ndarray
    high: np.ndarray
    seconds: float

    @property
    def errors(self) -> np.ndarray:
        """Predicted over measured, less one, in percent."""
        return np.asarray(100.0 * (self.values / self.of.values - 1.0))

    @property
    def covered(self) -> np.ndarray:
        """Whether the sources' predictions span a point; of those that have several."""
        known = np.isfinite(self.low) & (self.high > self.low)
        return np.asarray((self.low <= self.of.values) & (self.of.values <= self.high))[known]


def predict(one: Measured, sources: bool = True) -> Predicted:
    """Solve a device with its material and, where it says so, with the other sources of its silicone."""
    started = time.perf_counter()
    values = one.predict(sm.run(one.case(one.material)), one.given)
    seconds = time.perf_counter() - started
    low = high = np.full(len(values), np.nan)
    if sources and one.spanned and (others := one.sources):
        found = [one.predict(sm.run(one.case(material)), one.given) for material in others]
        low, high = np.min([values, *found], axis=0), np.max([values, *found], axis=0)
    return Predicted(one, values, low, high, seconds)


def devices(words: Sequence[str], folder: Path) -> Iterator[Measured]:
    """Yield the devices whose name or group has one of the words; all without any."""
    for one in (*membranes(), *beam(), *cylinder(folder)):
        if not words or any(word in f"{one.name} {one.group}" for word in words):
            yield one


def rms(errors: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(errors**2)))


def table(found: Sequence[Predicted]) -> str:
    """Return the errors of each group as a table of Markdown."""
    lines = [
        "| device | silicone | points | error (rms) | mean | largest | in the span of the silicone's sources |",
        "|---|---|---|---|---|---|---|",
    ]
    for group in dict.fromkeys(one.of.group for one in found):
        mine = [one for one in found if one.of.group == group]
        errors = np.concatenate([one.errors for one in mine])
        covered = np.concatenate([one.covered for one in mine])
        reached = errors[np.isfinite(errors)]
        span = f"{covered.sum()} of {len(covered)}" if len(covered) else "not computed"
        lines.append(
            f"| {group} | {mine[0].of.product} | {len(reached)} of {len(errors)} | {rms(errors):.1f} % | "
            f"{reached.mean():+.1f} % | {reached[np.abs(reached).argmax()]:+.1f} % | {span} |"
        )
    return "\n".join(lines)


def draw(found: Sequence[Predicted]) -> Figure:
    """Draw each group: measured points, predictions, and the span of the sources."""
    groups = list(dict.fromkeys(one.of.group for one in found))
    with matplotlib.rc_context({**STYLE, "font.size": 9, "axes.titlesize": 10}):
        figure = Figure((10.0, 2.6 * ((len(groups) + 1) // 2) + 0.6), layout="constrained")
        panels = figure.subplots((len(groups) + 1) // 2, 2, squeeze=False).ravel()
        for axes, group in zip(panels, groups, strict=False):
            for one in (one for one in found if one.of.group == group):
                axes.fill_between(one.of.given, one.low, one.high, color=FAINT, alpha=0.18, lw=0)
                axes.plot(one.of.given, one.values, color=CURVE, lw=1.3)
                axes.plot(one.of.given, one.of.values, "o", mfc="none", mec=INK, ms=4)
            axes.set(title=group, xlabel=one.of.given_label, ylabel=one.of.label)
        for axes in panels[len(groups) :]:
            axes.set_visible(False)
        figure.suptitle("measured (circles), predicted (lines), span of the silicone's published sources (grey)", fontsize=10)
    return figure


def write(found: Sequence[Predicted]) -> None:
    """Put the table into the page, and the picture beside it."""
    text = PAGE.read_text(encoding="utf-8")
    before, rest = text.split(BEGIN)
    PAGE.write_text(f"{before}{BEGIN}\n{table(found)}\n{END}{rest.split(END)[1]}", encoding="utf-8")
    draw(found).savefig(PICTURE, dpi=100)


def deck_case(one: Measured) -> Case:
    """Return a device as decks take it: solid, driven by pressure up to the largest measured one, not quite incompressible."""
    case = one.case(_compressible(one.material))
    parts = tuple(
        dataclasses.replace(part, material=_compressible(part.material)) if isinstance(part, sm.Region) else part
        for part in case.components
    )
    device = case.actuator
    if "section" in {field.name for field in dataclasses.fields(device)}:
        device = dataclasses.replace(device, section="wedge")  # type: ignore[call-arg]
    if case.quantity == "volume":
        top = 1e3 * float(one.values.max()) / COLUMN.pascal
        case = dataclasses.replace(case, steps=steps_of(pressure_cm=tuple(np.linspace(0.0, top, 6).tolist())))
    return dataclasses.replace(case, actuator=device, components=parts)


def _compressible(material: Material) -> Material:
    return dataclasses.replace(material, poisson=min(material.poisson, 0.49))  # type: ignore[type-var]


def write_cases(chosen: Sequence[Measured], folder: Path) -> None:
    """Write each case, and its deck where that has all that is in it."""
    for one in chosen:
        case = one.case(one.material)
        (folder / f"{case.name}.toml").write_text(case.to_toml(), encoding="utf-8")
        case = deck_case(one)
        try:
            sm.export(case, folder / f"{case.name}.inp")
        except (CaseError, sm.GeometryError) as error:
            print(f"{case.name}.inp: {error}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("words", nargs="*")
    parser.add_argument("--write", action="store_true", help="write the page")
    parser.add_argument("--cases", type=Path, help="write cases and decks here instead of solving")
    given = parser.parse_args()
    found = []
    if given.cases:
        given.cases.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        chosen = list(devices(given.words, given.cases or Path(name)))
        if given.cases:
            return write_cases(chosen, given.cases)
        for one in chosen:
            found.append(predict(one))
            texts = [f"{at:g}: {value:+.1f} %" for at, value in zip(one.given, found[-1].errors, strict=True)]
            print(f"{one.group}, {one.name} ({found[-1].seconds:.0f} s): {', '.join(texts)}", flush=True)
    print(table(found))
    if given.write:
        write(found)


if __name__ == "__main__":
    main()
