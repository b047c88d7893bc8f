"""What a fit had to correct on the bench, in words: reported where it is much, refused where no bench is so."""

from __future__ import annotations

import math
from collections.abc import Callable

from softmodels.fitting.problem import Parameter
from softmodels.fitting.result import LeastSquaresFit

REPORTED = 1.0
"""Corrections beyond this many standard errors of their prior are reported."""
PLAIN = 0.01
"""So are shares beyond this."""
BELIEVED = 5.0
"""Corrections of pressures beyond this many standard errors of their prior are refused: outlines do not show them."""


def _share(what: str) -> Callable[[float], str]:
    return lambda value: f"{what} too {'large' if value > 0.0 else 'small'} by {abs(value):.2%}".replace("%", " %")


def _zero(value: float) -> str:
    where = (
        "below the undeformed top, so that heights are too large"
        if value > 0.0
        else "above the undeformed top: it has sunk"
    )
    return f"the zero plane {abs(value) * 1e3:.3g} mm {where}"


WORDS: dict[str, tuple[Callable[[float], str], str]] = {
    "scale": (
        _share("all lengths in the photographs"),
        "check the pitch of the grid or board and the distances of lamp and screen",
    ),
    "zero": (_zero, "check that the part did not move after the photograph at rest"),
    "pressure_offset": (
        lambda value: f"all pressures too {'high' if value > 0.0 else 'low'} by {abs(value):.3g} Pa",
        "check the column's level at rest",
    ),
    "pressure_scale": (_share("all pressures"), "check the density of the column's liquid"),
    "leak": (
        lambda value: f"{_share('the highest pressure')(value)}, as by a leak,",
        "check the hose for leaks, and the highest readings",
    ),
}  # fmt: skip


def corrections(fit: LeastSquaresFit) -> list[str]:
    """A sentence on each correction that is larger than expected."""
    said = []
    for p, away in _away(fit):
        value = fit.values[p.name]
        if abs(away) > REPORTED or (p.unit == "" and abs(value) > PLAIN):
            says, advice = WORDS[p.own_name]
            of = f"{p.device}: " if p.device else ""
            said.append(
                f"{of}corrected: the fit takes {says(value)} ({abs(away):.1f} times what is expected of a bench); {advice}"
            )
    return said


def unbelievable(fit: LeastSquaresFit) -> list[str]:
    """A sentence on each correction of the pressures that no bench needs."""
    said = []
    for p, away in _away(fit):
        if p.own_name not in ("scale", "zero") and abs(away) > BELIEVED:
            says, advice = WORDS[p.own_name]
            of = f"{p.device}: " if p.device else ""
            said.append(
                f"{of}to follow the outlines the fit takes {says(fit.values[p.name])} {abs(away):.0f} times what is "
                f"believable: pressures and outlines contradict each other; {advice}, or fix it (--fix {p.name})"
            )
    return said


def _away(fit: LeastSquaresFit) -> list[tuple[Parameter, float]]:
    """Corrections with how many standard errors of their prior they are."""
    return [
        (p, (fit.values[p.name] - p.prior.mean) / p.prior.error)
        for p in fit.free
        if p.own_name in WORDS and p.prior and math.isfinite(fit.values[p.name])
    ]
