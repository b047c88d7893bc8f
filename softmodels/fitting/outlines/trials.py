"""One law tried on a device's outlines or heights: its fit, and whether that may be used."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from types import MappingProxyType

import numpy as np

from softmodels.fitting.outlines.bench import Bench, all_nuisances
from softmodels.fitting.outlines.check import series_of, series_of_shapes
from softmodels.fitting.outlines.device_model import DeviceModel
from softmodels.fitting.outlines.heights import Height, HeightResiduals, fit_heights
from softmodels.fitting.outlines.judgement import judge_heights, judge_outlines, within_chance
from softmodels.fitting.outlines.law_fit import fit_law_to_outlines
from softmodels.fitting.outlines.outline_residuals import OutlineResiduals
from softmodels.fitting.outlines.pressure_course import Row
from softmodels.fitting.outlines.wrong_rows import by_course
from softmodels.fitting.problem import NOTHING_ELSE, CannotEvaluate, Changes, Extra, FitError, UnsoundError
from softmodels.fitting.result import LeastSquaresFit
from softmodels.fitting.soundness import Judgement


@dataclasses.dataclass(frozen=True, eq=False)
class Trial[Source: (OutlineResiduals, HeightResiduals)]:
    """A law's fit.

    Attributes:
        sources: What it was fitted to, one for each device.
        fit: The fit.
        judgement: What speaks against it.
        rows: Of each device the series of pressures over heights, of outlines.
    """

    sources: tuple[Source, ...]
    fit: LeastSquaresFit
    judgement: Judgement
    rows: tuple[tuple[Row, ...], ...] = ()


def try_outlines(
    sources: Sequence[OutlineResiduals],
    bench: Bench,
    extra: Extra = NOTHING_ELSE,
    changes: Changes = MappingProxyType({}),
    loss: str = "linear",
    rows: Sequence[Sequence[Row]] = (),
) -> Trial[OutlineResiduals]:
    """Fit a law to all outlines, and look for those that contradict the others where the fit is beyond chance.

    Args:
        sources: The devices under the law, each with its outlines.
        bench: What is free beside the law.
        extra: Further sources, such as tensile curves, and their parameters.
        changes: See `fit_law_to_outlines`.
        loss: See `fit_law_to_outlines`.
        rows: The series, if another law's trial has them already: all laws are then fitted to the same photographs.

    Raises:
        UnsoundError: The outlines are of another device; or the fit fails, and a photograph contradicts the others.
        FitError: The fit fails.
    """
    all_nuisances(sources, bench)  # names that nothing has, before anything is solved
    series = tuple(tuple(one) for one in rows or [series_of_shapes(one.model, one.shapes) for one in sources])
    wrong = [found for found in map(by_course, series) if found]
    doubted = [name for found in wrong for name in found.names]
    said = "; ".join(found.whole for found in wrong)

    def fitted(
        without: Sequence[str] = (), doubted: Sequence[str] = ()
    ) -> tuple[list[OutlineResiduals], LeastSquaresFit]:
        chosen = []
        for source in sources:
            shapes = [shape for shape in source.shapes if shape.source not in without]
            if shapes:
                chosen.append(OutlineResiduals(source.model, shapes, device=source.device))
        fit = fit_law_to_outlines(*chosen, bench=bench, extra=extra, changes=changes, loss=loss, doubted=doubted)
        return chosen, fit

    def good(without: Sequence[str]) -> bool:
        try:
            return within_chance(*fitted(without))
        except (FitError, CannotEvaluate):
            return False

    try:
        if any(
            found.gross for found in wrong
        ):  # a fit that bends to follow such a row takes a minute and means nothing
            chosen, fit = fitted(doubted)
            return Trial(tuple(chosen), fit, Judgement((f"{said} (the numbers reported are of such a fit)",)), series)
        chosen, fit = fitted((), doubted)
    except FitError as error:
        if wrong:
            raise UnsoundError(f"{said} (with all photographs: {error})") from None
        raise
    return Trial(tuple(chosen), fit, judge_outlines(chosen, fit, series, good), series)


def try_heights(
    device: DeviceModel,
    heights: Sequence[Height],
    changes: Changes = MappingProxyType({}),
    loss: str = "linear",
) -> Trial[HeightResiduals]:
    """Fit a law to heights whose series has no row that contradicts the others.

    Raises:
        UnsoundError: It has.
        FitError: The fit fails.
    """
    columns = [(one.height, one.pressure, one.pressure_error, one.height_error) for one in heights]
    rows, _ = series_of(device, [one.source for one in heights], *np.array(columns).T)
    wrong = by_course(rows)
    if wrong:
        raise UnsoundError(wrong.whole)
    source = HeightResiduals(device, heights)
    fit = fit_heights(source, changes=changes, loss=loss)
    return Trial((source,), fit, judge_heights(source, fit))
