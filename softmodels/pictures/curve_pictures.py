"""The picture of materials in their tests."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from measurement.plain_text import plain
from softmodels.fitting.curves.curve import TensileCurve
from softmodels.materials.specimens import MODE_NAMES
from softmodels.pictures.fit_pictures import BOTH, NAMES, as_png, line
from softmodels.pictures.style import DPI, INK, STYLE, WARNING, WIDTH

if TYPE_CHECKING:
    from softmodels.materials.curves import MaterialCurves


def draw(many: Sequence[MaterialCurves], measured: Sequence[TensileCurve], radius: float, thickness: float) -> bytes:
    """Three tests and the balloon, nominal stresses solid and unstable parts marked, as PNG.

    Args:
        many: The materials.
        measured: Curves to draw beside them.
        radius: The balloon's undeformed radius in m.
        thickness: Its undeformed thickness in m.
    """
    with matplotlib.rc_context({**STYLE, "font.size": 10, "axes.titlesize": 11, "legend.fontsize": 9}):
        figure = Figure((WIDTH, 8.4), dpi=DPI, layout="constrained")
        panels = figure.subplots(2, 2).ravel()
        for axes, mode in zip(panels[:3], MODE_NAMES, strict=True):
            for i, one in enumerate(many):
                stress = one.responses[mode].stress / 1e3
                axes.plot(one.stretch, stress, label=plain(one.name), **line(i))
                _mark(axes, one, mode, stress)
            for curve, marker in zip(measured, itertools.cycle("osd^v"), strict=False):
                if curve.mode == mode:
                    axes.plot(
                        curve.stretch,
                        curve.stress / 1e3,
                        marker,
                        ms=3.5,
                        mfc="none",
                        mec=INK,
                        mew=0.7,
                        label=plain(curve.name),
                    )
            axes.set_xlim(many[0].stretch[0], many[0].stretch[-1])
            names = BOTH if many[0].stretch[0] < 0.99 else NAMES
            axes.set_title(names[mode])
            axes.set_xlabel("stretch")
            axes.set_ylabel("nominal stress (kPa)")
        axes = panels[3]
        for i, one in enumerate(many):
            out = one.stretch >= 1.0
            axes.plot(one.stretch[out], one.balloon(thickness / radius)[out] / 1e3, **line(i))
        axes.set_title(f"balloon, radius {radius * 1e3:g} mm, thickness {thickness * 1e3:g} mm")
        axes.set_xlabel("circumference over undeformed circumference")
        axes.set_ylabel("pressure (kPa)")
        for axes, mode in zip(panels[:3], MODE_NAMES, strict=True):
            _limit(axes, many, measured, mode)
        handles = {
            text: handle for axes in panels for handle, text in zip(*axes.get_legend_handles_labels(), strict=True)
        }
        figure.legend(list(handles.values()), list(handles), loc="outside lower center", ncols=2)
        return as_png(figure)


def _mark(axes: object, one: MaterialCurves, mode: str, stress: np.ndarray) -> None:
    """A cross where the law first stops being stable in this mode."""
    from softmodels.materials.stability import instabilities

    for weak in instabilities(one.material):
        if weak.mode == mode and one.stretch[0] <= weak.stretch <= one.stretch[-1]:
            height = float(np.interp(weak.stretch, one.stretch, stress))
            axes.plot(weak.stretch, height, "x", ms=9, mew=2.2, color=WARNING, zorder=5)  # type: ignore[attr-defined]
            axes.annotate("not stable", (weak.stretch, height), (6, -14), textcoords="offset points", color=WARNING)  # type: ignore[attr-defined]


def _limit(axes: object, many: Sequence[MaterialCurves], measured: Sequence[TensileCurve], mode: str) -> None:
    """Keep a law near its taut chains, or in strong compression, from flattening the others."""
    stresses = [one.responses[mode].stress / 1e3 for one in many]
    tops = [np.nanmax(s) for s in stresses] + [
        c.stress[c.stretch <= many[0].stretch[-1]].max(initial=0.0) / 1e3 for c in measured if c.mode == mode
    ]
    lows = [np.nanmin(s) for s in stresses]
    top = min(max(tops), 6 * float(np.median(tops)))
    low = max(min(lows), -1.5 * top)
    room = 0.05 * (top - low)
    axes.set_ylim(low - room, top + room)  # type: ignore[attr-defined]
