"""What the bench and the device may have got wrong, as parameters with what is believable of each."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from measurement.series.column import DENSITY_ERROR
from measurement.units import WATER_DENSITY
from measurement.wording import known_are
from softmodels.fitting.options import BENCH
from softmodels.fitting.outlines.outline_residuals import OutlineResiduals
from softmodels.fitting.outlines.reading import OutlineFitError
from softmodels.fitting.problem import Parameter, Prior

Array = npt.NDArray[np.float64]

LEAK_ERROR = 0.02
"""Prior of the leak: share of the largest pressure lost there."""

SCALE_ERROR = 0.005
"""Prior of the unit of length (a board's pitch, a magnification) where the outlines state no error of it."""

ZERO_ERROR = 20e-6
"""Prior of the zero plane's height in m, or the outlines' error of the level where that is more."""

PRESSURE_SCALE_ERROR = DENSITY_ERROR / WATER_DENSITY
"""Prior of the unit of pressure: a column's density is one number for all readings."""

LENGTH_ERROR = 0.02
"""Prior of a length of the device, relative, where it is freed."""

POISSON_BOUNDS = (0.3, 0.5)


@dataclasses.dataclass(frozen=True)
class Bench:
    """Which uncertainties of device and bench are fitted; the others keep their nominal value.

    By default those that any bench has. Free ones have priors (`nuisances`), but for the centre, which outlines show by
    themselves.

    Attributes:
        free: Names among ``pressure_offset``, ``pressure_scale``, ``leak``, ``scale``, ``zero``, ``centre``, ``poisson`` and
            the device's own variable lengths, such as ``membrane``.
    """

    free: tuple[str, ...] = BENCH


DEFAULT_BENCH = Bench()


def nuisances(source: OutlineResiduals, bench: Bench) -> list[Parameter]:
    """Parameters of bench and device with their default priors; those that are not free are fixed.

    Raises:
        OutlineFitError: A name that is none of them.
    """
    model, shapes = source.model, source.shapes
    known = (*BENCH, "poisson", *model.lengths)
    for name in bench.free:
        if name not in known:
            raise OutlineFitError(f"nothing of the bench or the device is called {name!r}; {known_are(name, known)}")
    reading = min(shape.pressure_error for shape in shapes)
    width = model.silhouette.width
    centre = float(np.median([shape.centre for shape in shapes]))
    tops = source.most
    scale = max(shape.scale_error for shape in shapes) or SCALE_ERROR
    level = max(ZERO_ERROR, *(shape.level_error for shape in shapes))
    made = {
        "pressure_offset": Parameter("pressure_offset", "Pa", 0.0, -tops, tops, Prior(0.0, reading)),
        "pressure_scale": Parameter("pressure_scale", "", 0.0, -0.5, 0.5, Prior(0.0, PRESSURE_SCALE_ERROR)),
        "leak": Parameter("leak", "", 0.0, -0.5, 0.5, Prior(0.0, LEAK_ERROR)),
        "scale": Parameter("scale", "", 0.0, -0.2, 0.2, Prior(0.0, scale)),
        "zero": Parameter("zero", "m", 0.0, -width, width, Prior(0.0, level)),
        "centre": Parameter("centre", "m", centre, centre - width, centre + width),
        "poisson": Parameter("poisson", "", model.choice.poisson, *POISSON_BOUNDS, answers=POISSON_BOUNDS[1:]),
        **{
            name: Parameter(name, "m", value, 0.7 * value, 1.3 * value, Prior(value, LENGTH_ERROR * value))
            for name, value in model.lengths.items()
        },
    }
    return [
        dataclasses.replace(
            p,
            name=source.named(name),
            fixed=name not in bench.free,
            device="" if source.named(name) == name else source.device,
        )
        for name, p in made.items()
    ]


def all_nuisances(sources: Sequence[OutlineResiduals], bench: Bench) -> list[Parameter]:
    """Those of all devices of a fit: what is free is so for each device that has it, or by its full name for one.

    Raises:
        OutlineFitError: A name that no device has.
    """
    found: dict[str, Parameter] = {}
    known = [(*BENCH, "poisson", *source.model.lengths) for source in sources]
    for name in bench.free:
        if not any(
            name in (own, source.named(own)) for source, names in zip(sources, known, strict=True) for own in names
        ):
            nuisances(sources[0], Bench((name,)))
    for source, names in zip(sources, known, strict=True):
        free = tuple(name for name in names if {name, source.named(name)} & set(bench.free))
        for p in nuisances(source, Bench(free)):
            found.setdefault(p.name, p)
    return list(found.values())
