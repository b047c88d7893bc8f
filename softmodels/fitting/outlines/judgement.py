"""Whether a fit to outlines or heights may be used: chi squared, what the device and the bench can be, and wrong rows."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from softmodels.fitting.outlines.corrections import corrections, unbelievable
from softmodels.fitting.outlines.heights import HeightResiduals
from softmodels.fitting.outlines.outline_residuals import OutlineResiduals, fits_badly, misfits, residuals_by_source
from softmodels.fitting.outlines.pressure_course import Row
from softmodels.fitting.outlines.wrong_rows import by_course, by_fit, reading
from softmodels.fitting.result import LeastSquaresFit
from softmodels.fitting.soundness import Judgement

MODEL_SHAPE = 0.03
"""Root mean square distance from an outline, over its height, that a law and a mesh may leave."""
MODEL_PRESSURE = 0.05
"""The same of a reading."""
ERRORS = 5.0
"""Misfits below this many standard errors are none, however small the height."""


def judge_outlines(
    sources: Sequence[OutlineResiduals],
    fit: LeastSquaresFit,
    rows: Sequence[Sequence[Row]],
    good: Callable[[Sequence[str]], bool],
) -> Judgement:
    """Hold a fit to outlines against chance, and against what a device and a bench can be.

    Args:
        sources: The outlines of each device.
        fit: Their fit.
        rows: Of each device the series of its pressures over its heights.
        good: Whether a fit without photographs of these names is within chance.
    """
    bad: list[int] = []
    warnings: list[str] = []
    for k, (source, residuals) in enumerate(zip(sources, residuals_by_source(sources, fit.residuals), strict=True)):
        found = {name: pair for name, pair in misfits(source, residuals).items() if fits_badly(*pair)}
        bad += [k] if found else []
        of = f" of {source.device}" if source.device else ""
        warnings += [
            f"{f'the pressures{of}' if name == source.readings else name}: the law cannot follow "
            f"{'them' if name == source.readings else 'it'} (chi squared {chi2:.0f} of {count} values)"
            for name, (chi2, count) in found.items()
        ]
    for k in bad:
        wrong = by_course(rows[k]) or by_fit(fit, _photographs(sources, k, fit), rows[k], good)
        if wrong:  # what the fit has bent to follow it means nothing
            return Judgement((wrong.whole,), tuple(warnings))
    objections = (*(text for k in bad for text in _beyond(sources[k], fit)), *unbelievable(fit))
    return Judgement(objections, tuple(warnings), () if objections else tuple(corrections(fit)))


def judge_heights(source: HeightResiduals, fit: LeastSquaresFit) -> Judgement:
    """Hold a fit to heights against what a law and a mesh may leave."""
    left = np.abs(fit.residuals[: fit.count]) / 1e3
    i = int(np.argmax(left / source.measured))
    if left[i] > MODEL_PRESSURE * source.measured[i] + ERRORS * source.height_errors[i]:
        one = source.heights[i]
        return Judgement(
            (
                f"the law does not follow the heights: {one.source} is {one.height * 1e3:.4g} mm high and would be "
                f"{left[i] * 1e3:.3g} mm off at {reading(one.pressure)}; check the pressures, the geometry of the case and "
                "whether it is the part in the photographs, or try another law",
            )
        )
    return Judgement()


def within_chance(sources: Sequence[OutlineResiduals], fit: LeastSquaresFit) -> bool:
    """Whether a fit follows every photograph and the readings within their errors, with a bench that can be."""
    parts = zip(sources, residuals_by_source(sources, fit.residuals), strict=True)
    return not any(fits_badly(*pair) for one in parts for pair in misfits(*one).values()) and not unbelievable(fit)


def _photographs(sources: Sequence[OutlineResiduals], k: int, fit: LeastSquaresFit) -> list[str]:
    """Name of the photograph of each measured residual of the k-th source; that of a reading is its photograph's."""
    source, before = sources[k], sum(one.count for one in sources[:k])
    outlines = source.groups.tolist()[: source.count - len(source.shapes)]
    names = [*[""] * before, *outlines, *(shape.source for shape in source.shapes)]
    return [*names, *[""] * (fit.count - len(names))]


def _beyond(source: OutlineResiduals, fit: LeastSquaresFit) -> list[str]:
    """What is beyond any law's and any mesh's error."""
    matches = source.matches(fit.values)
    away = [float(np.sqrt(np.mean(one.distances**2))) for one in matches]
    limits = [MODEL_SHAPE * one.shape.height + ERRORS * float(np.median(one.shape.error)) for one in matches]
    shapes = [i for i in range(len(matches)) if away[i] > limits[i]]
    if shapes:
        i = max(shapes, key=lambda k: away[k] / limits[k])
        return [
            f"{len(shapes)} of {len(matches)} outlines do not have the shape that the case's device takes: "
            f"{matches[i].shape.source} lies {away[i] * 1e3:.3g} mm (root mean square) off the closest state, at a height of "
            f"{matches[i].shape.height * 1e3:.4g} mm; are they of another device, or is the geometry of the case wrong?"
        ]
    off = [one.pressure - one.true_pressure for one in matches]
    share = [
        abs(by) / (MODEL_PRESSURE * abs(one.shape.pressure) + ERRORS * one.shape.pressure_error)
        for by, one in zip(off, matches, strict=True)
    ]
    i = int(np.argmax(share))
    if share[i] <= 1.0:
        return []
    shape = matches[i].shape
    return [
        f"the pressures do not go with the outlines: {shape.source} would take {reading(shape.pressure + off[i])}, its row "
        f"says {reading(shape.pressure)}, and no single row explains it; check the list of photographs, or try another law"
    ]
