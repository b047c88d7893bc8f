"""Outlines from a list of photographs, as one call: the zero plane, the shadow's size, every photograph, and their tables."""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypedDict, Unpack

from measurement.edge.tracing import AUTO
from measurement.outline.outline import Outline
from measurement.outline.scaling import with_known_body
from measurement.outline.zero import ZeroLine
from measurement.screen.setup import Setup
from measurement.series.column import Column
from measurement.series.measuring import Result, measure_all, zero_line
from measurement.series.photo import Refusal
from measurement.series.photo_list import Photograph, read_photos

HEIGHTS = ("file", "pressure_Pa", "pressure_error_Pa", "height_m", "height_error_m", "trusted", "remarks")


class How(TypedDict, total=False):
    """How a list is measured.

    Attributes:
        tone: How the files store light: ``"auto"``, ``"srgb"`` as a camera's JPEG, or ``"linear"``.
        width: True width of the body in m and its standard error, where the photographs show its sides: it tells the
            shadow's magnification.
        jobs: Processes at a time; more than one start Python anew, so a script needs its ``if __name__ == "__main__":``.
        edges: Folder for a picture of each photograph with its edge; none without it.
        done: Called with the `Result` of each photograph.
    """

    tone: str
    width: tuple[float, float] | None
    jobs: int
    edges: Path | None
    done: Callable[[Result], None]


@dataclasses.dataclass(frozen=True, eq=False)
class Measurement:
    """What a list of photographs gave.

    Attributes:
        results: One for each photograph, in the list's order.
        setup: The setup as it was used: with the magnification that the body's width tells.
        zero: The undeformed surface.
    """

    results: tuple[Result, ...]
    setup: Setup
    zero: ZeroLine

    @property
    def outlines(self) -> list[Outline]:
        """The outlines, in the list's order; those that are not `Outline.trusted` too."""
        return [result.outcome for result in self.results if isinstance(result.outcome, Outline)]

    @property
    def refused(self) -> dict[str, str]:
        """Photographs that gave none, and why."""
        return {
            result.photograph.file.name: result.outcome.reason
            for result in self.results
            if isinstance(result.outcome, Refusal)
        }

    def write(self, folder: Path) -> None:
        """Write ``heights.csv`` and a table of each outline into a folder.

        Raises:
            OSError: They cannot be written.
        """
        with (folder / "heights.csv").open("w", newline="", encoding="utf-8") as file:
            rows = csv.writer(file)
            rows.writerow(HEIGHTS)
            for result in self.results:
                rows.writerow(_row(result))
        for result in self.results:
            if isinstance(result.outcome, Outline):
                result.outcome.to_csv(folder / f"{result.name}.csv")


def _row(result: Result) -> tuple[str, ...]:
    """A photograph's line of ``heights.csv``."""
    photo, outcome = result.photograph, result.outcome
    first = (photo.file.name, repr(photo.pressure), repr(photo.pressure_error))
    if isinstance(outcome, Refusal):
        return (*first, "", "", "refused", outcome.reason)
    trusted = "yes" if outcome.trusted else "no"
    return (*first, f"{outcome.height:.9g}", f"{outcome.height_error:.4g}", trusted, "; ".join(outcome.reasons))


def measure(photographs: Sequence[Photograph], setup: Setup, **how: Unpack[How]) -> Measurement:
    """Measure every photograph of a list.

    Args:
        photographs: The list.
        setup: Camera and screen.
        how: See `How`.

    Raises:
        NoZero: No photograph, and nothing in the setup, shows the undeformed surface.
        SetupError: The body's width does not go with what the photographs show.
    """
    tone, jobs, edges = how.get("tone", AUTO), how.get("jobs", 1), how.get("edges")
    setup, zero = with_zero(photographs, setup, tone, how.get("width"))
    results = measure_all(photographs, setup, zero, tone, jobs, edges, how.get("done", lambda result: None))
    return Measurement(tuple(results), setup, zero)


def with_zero(
    photographs: Sequence[Photograph], setup: Setup, tone: str, width: tuple[float, float] | None
) -> tuple[Setup, ZeroLine]:
    """The setup, with the magnification that a body's width tells, and the undeformed surface. Errors as of `measure`."""
    zero = zero_line(photographs, setup, tone)
    if width is None:
        return setup, zero
    setup = with_known_body(setup, zero, *width)
    return setup, zero_line(photographs, setup, tone)


def outlines(
    photos: str | Path | Sequence[Photograph],
    setup: str | Path | Setup,
    column: Column | None = None,
    **how: Unpack[How],
) -> Measurement:
    """Outlines of a body's shadow in a list of photographs.

    Args:
        photos: The list, ``photos.csv``, or its rows.
        setup: Camera and screen, or the file ``setup.toml`` that ``python -m measurement setup`` writes.
        column: The water column that the list's lengths were read from.
        how: See `How`.

    Returns:
        The outlines, and why others were refused.

    Raises:
        PhotoListError: The list cannot be read.
        SetupError: The setup cannot be used.
        NoZero: Nothing shows the undeformed surface.
    """
    listed = read_photos(Path(photos), column) if isinstance(photos, str | Path) else photos
    known = Setup.from_file(setup) if isinstance(setup, str | Path) else setup
    return measure(listed, known, **how)
