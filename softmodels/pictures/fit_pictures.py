"""Pictures of a fit and the page that holds them."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, TypedDict

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from measurement.page import data_uri, render
from measurement.plain_text import plain
from softmodels.fitting.curves.curve import TensileCurve
from softmodels.fitting.fit_report import FitReport
from softmodels.fitting.fitted_law import FittedLaw
from softmodels.fitting.identifiability import unseen
from softmodels.fitting.tables import (
    correlation_rows,
    parameter_rows,
    residual_rows,
)
from softmodels.materials.quantities import with_prefix
from softmodels.materials.specimens import respond
from softmodels.pictures.outline_pictures import draw_outlines, draw_photographs
from softmodels.pictures.style import DPI, FAINT, INK, STYLE, WARNING, WIDTH

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = ("#2f6f9f", "#c0392b", "#2e8b57", "#8e5ea2", "#d98b1f", "#5d6d7e", "#16a3a3")
STYLES = ("-", "--", "-.", ":")
NAMES = {"uniaxial": "uniaxial tension", "planar": "pure shear", "equibiaxial": "equibiaxial tension"}
BOTH = {**NAMES, "uniaxial": "uniaxial tension and compression"}
PROFILE_COLUMNS = 3


class LineStyle(TypedDict):
    """Keywords of ``Axes.plot``."""

    color: str
    linestyle: str
    linewidth: float


def line(i: int) -> LineStyle:
    """Colour and dashes of the i-th law."""
    return {"color": COLOURS[i % len(COLOURS)], "linestyle": STYLES[i % len(STYLES)], "linewidth": 1.8}


def draw_curves(report: FitReport) -> Figure:
    """Measured and fitted nominal stress, one panel per test."""
    figure, panels = _panels(len(report.curves), 4.6)
    for axes, curve in zip(panels, report.curves, strict=True):
        axes.plot(curve.stretch, curve.stress / 1e3, "o", ms=4, mfc="none", mec=INK, mew=0.8, label="measured")
        stretch = np.linspace(min(curve.stretch[0], 1.0), curve.stretch[-1], 300)
        for i, one in enumerate(report.laws):
            gauge = _gauge(one, report, curve)
            stress = gauge * respond(one.material, stretch, curve.mode).stress
            axes.plot(stretch, stress / 1e3, label=one.choice.name, **line(i))
        names = BOTH if curve.stretch[0] < 0.99 else NAMES
        axes.set_title(f"{names[curve.mode]}\n{plain(curve.name)}")
        axes.set_xlabel("stretch")
        axes.set_ylabel("nominal stress (kPa)")
        measured = curve.stress / 1e3
        room = 0.08 * float(np.ptp(measured))
        axes.set_ylim(float(measured.min()) - room, float(measured.max()) + 2 * room)
    panels[0].legend(loc="upper left")
    return figure


def _gauge(one: FittedLaw, report: FitReport, curve: TensileCurve) -> float:
    number = next(i for i, c in enumerate(report.curves, 1) if c is curve)
    return one.fit.values.get(f"gauge{number}", 1.0)


def draw_residuals(report: FitReport) -> Figure:
    """Fitted less measured nominal stress, one panel per test."""
    figure, panels = _panels(len(report.curves), 4.0)
    for axes, curve in zip(panels, report.curves, strict=True):
        axes.axhline(0.0, color=FAINT, linewidth=1.0)
        for i, one in enumerate(report.laws):
            stress = _gauge(one, report, curve) * respond(one.material, curve.stretch, curve.mode).stress
            axes.plot(curve.stretch, (stress - curve.stress) / 1e3, label=one.choice.name, marker=".", ms=4, **line(i))
        axes.set_title(plain(curve.name))
        axes.set_xlabel("stretch")
        axes.set_ylabel("fitted less measured (kPa)")
        # A law that fits badly must not flatten the others' residuals to a line.
        sizes = [np.abs(lines.get_ydata()).max() for lines in axes.lines[1:]]
        reach = 1.15 * min(max(sizes), 8 * min(sizes))
        if max(sizes) * 1.15 > reach:
            axes.set_ylim(-reach, reach)
            axes.set_title(f"{plain(curve.name)}\n(the worst laws leave the picture)")
    panels[0].legend(loc="best")
    return figure


def draw_profiles(one: FittedLaw) -> Figure:
    """Rise of the deviance along every free parameter, the limit of the 95 % interval, and the quadratic it should be."""
    rows = -(-len(one.profiles) // PROFILE_COLUMNS)
    columns = min(len(one.profiles), PROFILE_COLUMNS)
    figure = Figure((WIDTH, 3.6 * rows + 0.3), dpi=DPI, layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, profile in zip(grid, one.profiles.values(), strict=False):
        best = one.fit.values[profile.name]
        _, unit = with_prefix(best, profile.unit)
        factor = {"MPa": 1e-6, "kPa": 1e-3}.get(unit, 1.0)
        axes.plot(profile.values * factor, profile.rises, "o-", ms=4, color=COLOURS[0], label="profile")
        error = one.fit.error(profile.name)
        if np.isfinite(error) and error > 0.0:
            axes.plot(
                profile.values * factor, ((profile.values - best) / error) ** 2, ":", color=FAINT, label="quadratic"
            )
        axes.axhline(profile.limit, color=WARNING, linewidth=1.2, label="95 %")
        axes.set_ylim(-0.05 * profile.limit, 2.5 * profile.limit)
        axes.set_xlabel(f"{profile.name} ({unit})" if unit else profile.name)
        axes.set_ylabel("rise of the deviance")
        axes.tick_params(axis="x", labelrotation=25)
        if profile.values[0] > 0.0 and profile.values[-1] > 50 * profile.values[0]:
            axes.set_xscale("log")
    for axes in grid[len(one.profiles) :]:
        axes.set_visible(False)
    grid[0].legend(loc="upper center", fontsize=9)
    figure.suptitle(f"{one.choice.name}: profile likelihoods")
    return figure


def _panels(count: int, height: float) -> tuple[Figure, Sequence[Axes]]:
    columns = min(count, 3)
    rows = -(-count // columns)
    figure = Figure((WIDTH if columns > 1 else 0.75 * WIDTH, height * rows), dpi=DPI, layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in grid[count:]:
        axes.set_visible(False)
    return figure, list(grid[:count])


def pictures(report: FitReport) -> dict[str, bytes]:
    """All pictures as PNG, by file name."""
    with matplotlib.rc_context({**STYLE, "font.size": 10, "axes.titlesize": 11, "legend.fontsize": 9}):
        figures = {}
        if report.curves:
            figures = {"curves.png": draw_curves(report), "residuals.png": draw_residuals(report)}
        for law, states in report.photographs.items():
            figures[f"outlines-{law}.png"] = draw_outlines(states, law)
            figures[f"photographs-{law}.png"] = draw_photographs(states, law)
        for one in report.laws:
            if one.profiles:
                figures[f"profiles-{one.choice.name}.png"] = draw_profiles(one)
        return {name: as_png(figure) for name, figure in figures.items()}


def as_png(figure: Figure) -> bytes:
    stream = io.BytesIO()
    figure.savefig(stream, format="png")
    return stream.getvalue()


def page(report: FitReport, images: dict[str, bytes]) -> str:
    """The report as one self-contained page."""
    sources = {name: data_uri(data, "image/png") for name, data in images.items()}
    ranked = [
        (one.fit.label, str(len(one.fit.free)), f"+{one.aicc:.4g}", f"{one.bic:+.4g}") for one in report.comparison.ranked
    ] if len(report.laws) > 1 else []  # fmt: skip
    return render(
        "fit.html", "softmodels.pictures", title="Fitted material", verdict=report.verdict,
        unsound="" if report.chosen.sound else report.chosen.warnings[0],
        separate=report.separate.sentences if report.separate else (), remarks=[*report.ranges, report.how],
        ranked=ranked, pictures=[(name, source) for name, source in sources.items() if not name.startswith("profiles-")],
        laws=[_law(one, sources) for one in report.laws],
    )  # fmt: skip


def _law(one: FittedLaw, sources: dict[str, str]) -> dict[str, object]:
    """What the page shows of one law."""
    correlations = correlation_rows(one)
    width = max(map(len, correlations), default=0)
    told = (one.material.remark, *one.judgement.notes, *unseen(one.fit), *one.verdict.notes)
    return {
        "name": one.choice.name, "modulus": " ".join(with_prefix(one.material.shear_modulus_0, "Pa")),
        "parameters": parameter_rows(one), "residuals": residual_rows(one),
        "correlated": ["correlation", *(p.name for p in one.fit.free[: max(width - 1, 0)])],
        "correlations": [[*row, *[""] * (width - len(row))] for row in correlations],
        "warnings": one.warnings, "remarks": [text for text in told if text],
        "profiles": sources.get(f"profiles-{one.choice.name}.png", ""),
    }  # fmt: skip
