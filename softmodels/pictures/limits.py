"""Plots of ``softmodels limit --vary``: scatter of the limit pressure by fabrication tolerances."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from softmodels.pictures.style import CURVE, DPI, FAINT, INK, STYLE, WARNING, WIDTH
from softmodels.runs.limits import Tolerance

SHOWN = {"m": (1e3, ", mm"), "degree": (1.0, ", degrees"), "": (1.0, "")}
"""Factor and text of each unit on an axis."""


def scatter_figure(
    limits: Sequence[tuple[Mapping[str, float], float]],
    tolerances: Sequence[Tolerance],
    what: str,
    nominal: float,
    working: float | None,
) -> Figure:
    """Plot the distribution of the limit, and the limit over each parameter.

    Args:
        limits: Parameters (SI) and limit pressure (cm of water) of each device.
        tolerances: The parameters, in the order of their panels.
        what: What the pressure is, such as ``"limit pressure"``; for the axes.
        nominal: Limit of the device as drawn, in cm.
        working: Working pressure in cm, or None.
    """
    label = f"{what}, cm of water"
    pressures = np.sort([pressure for _, pressure in limits])
    with matplotlib.rc_context(STYLE):
        figure = Figure((WIDTH, 4.8 if len(tolerances) < 3 else 4.4), dpi=DPI, layout="constrained")
        axes = figure.subplots(1, 1 + len(tolerances))
        share = (np.arange(len(pressures)) + 0.5) / len(pressures) * 100
        axes[0].step(pressures, share, where="mid", color=CURVE)
        for percent in (5, 50, 95):
            axes[0].plot(np.percentile(pressures, percent), percent, "o", color=INK, markersize=5)
        axes[0].axvline(nominal, color=FAINT, linestyle="--", label=f"nominal: {nominal:.3g} cm")
        if working is not None:
            axes[0].axvline(working, color=WARNING, label=f"working: {working:.3g} cm")
        axes[0].set(xlabel=label, ylabel="devices below it, %", ylim=(0, 100))
        axes[0].legend(loc="best", fontsize=9)
        for place, tolerance in zip(axes[1:], tolerances, strict=True):
            factor, unit = SHOWN[tolerance.unit]
            values = [changes[tolerance.name] * factor for changes, _ in limits]
            place.plot(values, [pressure for _, pressure in limits], "o", color=CURVE, markersize=4)
            place.set(xlabel=f"{tolerance.name.replace('_', ' ')}{unit}", ylabel=label)
    return figure
