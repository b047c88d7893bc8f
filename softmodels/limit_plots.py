"""The picture of ``softmodels limit --vary``: how fabrication scatters the limit pressure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from softmodels.pages import CURVE, DPI, FAINT, INK, STYLE, WARNING, WIDTH


def scatter_figure(
    limits: Sequence[tuple[Mapping[str, float], float]], nominal: float, working: float | None
) -> Figure:
    """Distribution of the limit, and the limit over each parameter.

    Args:
        limits: Parameters (m) and limit pressure (cm of water) of each device.
        nominal: Limit of the device as drawn, in cm.
        working: Working pressure in cm, or None.
    """
    names = list(limits[0][0])
    pressures = np.sort([pressure for _, pressure in limits])
    with matplotlib.rc_context(STYLE):
        figure = Figure((WIDTH, 4.8 if len(names) < 3 else 4.4), dpi=DPI, layout="constrained")
        axes = figure.subplots(1, 1 + len(names))
        share = (np.arange(len(pressures)) + 0.5) / len(pressures) * 100
        axes[0].step(pressures, share, where="mid", color=CURVE)
        for percent in (5, 50, 95):
            axes[0].plot(np.percentile(pressures, percent), percent, "o", color=INK, markersize=5)
        axes[0].axvline(nominal, color=FAINT, linestyle="--", label=f"as drawn: {nominal:.3g} cm")
        if working is not None:
            axes[0].axvline(working, color=WARNING, label=f"working: {working:.3g} cm")
        axes[0].set(xlabel="limit pressure in cm of water", ylabel="devices with a lower limit, %", ylim=(0, 100))
        axes[0].legend(loc="best", fontsize=9)
        for place, name in zip(axes[1:], names, strict=True):
            values = [changes[name] * 1e3 for changes, _ in limits]
            place.plot(values, [pressure for _, pressure in limits], "o", color=CURVE, markersize=4)
            place.set(xlabel=f"{name.replace('_', ' ')} in mm", ylabel="limit pressure in cm of water")
    return figure
