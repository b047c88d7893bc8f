"""The fit of one law to outlines, from starts in closed form."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from measurement.wording import known_are
from softmodels.fitting.least_squares import fit_parameters
from softmodels.fitting.outlines.bench import DEFAULT_BENCH, Bench, all_nuisances
from softmodels.fitting.outlines.outline_residuals import OutlineResiduals
from softmodels.fitting.outlines.start import starts
from softmodels.fitting.problem import NOTHING_ELSE, Change, Changes, Extra, FitError, Parameter
from softmodels.fitting.result import LeastSquaresFit

Array = npt.NDArray[np.float64]

UNHEARD = 1e6
"""Factor on the error of a pressure that does not count."""


def volume_parameters(
    source: OutlineResiduals, volumes: Sequence[float] | Array, hangs: float = 0.0
) -> list[Parameter]:
    """The hidden added volumes with a start for each, m3; ``hangs`` is that of the device at zero pressure."""
    return [
        Parameter(
            name, "m^3", start, hangs + 0.05 * (start - hangs), hangs + 4.0 * (start - hangs), hidden=True,
            title=f"the added volume at {shape.name}", device=source.device,
        )
        for name, start, shape in zip(source.volumes, volumes, source.shapes, strict=True)
    ]  # fmt: skip


def fit_law_to_outlines(
    *sources: OutlineResiduals,
    bench: Bench = DEFAULT_BENCH,
    extra: Extra = NOTHING_ELSE,
    changes: Changes = MappingProxyType({}),
    loss: str = "linear",
    doubted: Collection[str] = (),
) -> LeastSquaresFit:
    """Fit a law to outlines from starts in closed form.

    Args:
        sources: Devices of one material, each with its outlines.
        bench: What is free beside the law.
        extra: Further sources that depend on the law's parameters, such as tensile curves.
        changes: Fields of parameters to replace; what every device has is so for all, or by its full name for one.
        loss: See `softmodels.fitting.least_squares.fit_parameters`.
        doubted: Names of photographs whose pressures do not count where the fit starts.

    Raises:
        FitError: See `softmodels.fitting.least_squares.fit_parameters`; or a change names no parameter.
        OutlineFitError: The device cannot be the one in the photographs.
    """
    choice = sources[0].model.choice
    known = all_nuisances(sources, bench)
    names = {*choice.names, *(name for p in (*known, *extra.parameters) for name in (p.name, p.own_name))}
    for name in changes:
        if name not in names:
            raise FitError(f"there is no parameter {name!r}; {known_are(name, sorted(names))}")
    held = {name: change["start"] for name, change in changes.items() if _held(change) and name in choice.names}
    begins: list[dict[str, float]] = []
    volumes: list[Parameter] = []
    for source in sources:
        measured = [
            (shape.height, shape.pressure, shape.pressure_error * (UNHEARD if shape.source in doubted else 1.0))
            for shape in source.shapes
        ]
        heights, pressures, errors = np.array(measured).T
        more, plain = starts(source.model, heights, pressures, errors, held)
        begins += more
        volumes += volume_parameters(source, plain.volumes, plain.hangs)
    troubles = []
    for begin in begins:
        parameters = [
            p.changed({**changes.get(p.own_name, {}), **changes.get(p.name, {})})
            for p in (*choice.parameters(begin), *known, *extra.parameters)
        ] + volumes
        for source in sources:
            source.fixed = frozenset(p.name for p in parameters if p.fixed)
        try:
            return fit_parameters([*sources, *extra.sources], parameters, loss=loss, label=choice.name)
        except FitError as error:
            troubles.append(str(error))
    raise FitError(f"{choice.name}: {troubles[0]}")


def _held(change: Change) -> bool:
    return change.get("fixed", False) and "start" in change
