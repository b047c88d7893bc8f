"""Pictures and report of a fit."""

from __future__ import annotations

import dataclasses
import itertools
import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from measurement.outline import outline
from softmodels.case import materials
from softmodels.common import commands, pages, processes, units
from softmodels.common.arrays import Array
from softmodels.common.pages import Page
from softmodels.fitting import comparison, least_squares
from softmodels.fitting.curves.curve import TensileCurve
from softmodels.fitting.curves.oscillation import Oscillation
from softmodels.fitting.curves.residuals import predicted
from softmodels.fitting.outlines import residuals, shapes, views
from softmodels.fitting.outlines.inflations import MatchedInflation
from softmodels.fitting.outlines.shapes import Shape
from softmodels.materials import specimens
from softmodels.pictures import curves, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes


# ----------------------------------------------------------------------------------------------------------------------
# Plots of a fit to outlines: measured and simulated ones overlaid, and the residuals of each photograph.


MAX_POINTS_SHOWN = 400
"""Number of measured points drawn per photograph."""
GRID_COLUMNS = 3


def draw_outlines(matches: Sequence[residuals.MatchedPhotograph], law: str) -> Figure:
    """Plot all outlines in device coordinates: measured points, simulated lines, a colour per pressure."""
    figure, axes = style.chart(0.55 * style.WIDTH_INCHES)
    for fitting, colour in zip(matches, style.shades(len(matches)), strict=True):
        stride = max(len(fitting.points) // MAX_POINTS_SHOWN, 1)
        measured = 1e3 * (fitting.points * np.column_stack([fitting.side, np.ones_like(fitting.side)]))[::stride]
        axes.plot(measured[:, 0], measured[:, 1], ".", ms=2.5, color=style.INK, alpha=0.5)
        lowest = [float(fitting.points[:, 1].min())] if fitting.shape.whole else []
        half = 1e3 * shapes.half_outline(fitting.shadow.curve, 2e-5, *lowest)[0]
        label = _name(fitting.shape)
        whole = np.concatenate([half[:0:-1] * (-1.0, 1.0), half])
        axes.plot(*whole.T, color=colour, lw=1.4, label=label)
    axes.axhline(0.0, color=style.FAINT, linewidth=0.8)
    reach = 1e3 * max(float(fitting.points[:, 0].max()) for fitting in matches)
    top = 1e3 * max(float(fitting.points[:, 1].max()) for fitting in matches)
    axes.set_xlim(-1.15 * reach, 1.15 * reach)
    foot = 1e3 * min(float(fitting.points[:, 1].min()) for fitting in matches)
    axes.set_ylim(min(-0.04 * top, 1.06 * foot), 1.06 * top)
    if top - foot > reach / 2:  # flatter plots would be thin strips
        axes.set_aspect("equal")
    axes.set(xlabel="distance from the axis (mm)", ylabel="height (mm)")
    axes.set_title(f"{law}: measured (points) and simulated (lines) outlines")
    _legend_beside(axes)
    return figure


def _legend_beside(axes: Axes) -> None:
    """Add a legend to the right of the axes, the highest pressure on top."""
    handles, labels = axes.get_legend_handles_labels()
    axes.legend(handles[::-1], labels[::-1], loc="center left", bbox_to_anchor=(1.0, 0.5), title="read")


def draw_photographs(matches: Sequence[residuals.MatchedPhotograph], law: str) -> Figure:
    """Plot the residuals (simulated - measured) along the outline, one panel per photograph, with a band of two standard
    errors."""
    rows = -(-len(matches) // GRID_COLUMNS)
    figure, panels = _panels(len(matches), 2.3 + 0.5 / rows, sharex=True, whole=True)
    for k, (axes, fitting) in enumerate(zip(panels, matches, strict=True)):
        _panel(axes, fitting)
        if k // GRID_COLUMNS == rows - 1:
            axes.set_xlabel(f"{'along the outline' if fitting.shape.whole else 'distance from the axis'} (mm)")
        if k % GRID_COLUMNS == 0:
            axes.set_ylabel("residual (um)\nsimulated - measured")
    figure.suptitle(f"{law}: residuals of each photograph; grey: two standard errors of a bin's mean")
    return figure


def _name(shape: Shape) -> str:
    held = f", {shape.hold:.3g} s" if shape.history else ""
    return f"{shape.pressure / 1e3:.3g} kPa{held}"


def draw_creep(matches: Sequence[residuals.MatchedPhotograph], law: str) -> Figure:
    """Plot the heights of photographs with times over their hold times, a colour per level of the pressure."""
    figure, axes = style.chart(0.5 * style.WIDTH_INCHES, 0.75 * style.WIDTH_INCHES)
    levels: dict[tuple[object, ...], list[residuals.MatchedPhotograph]] = {}
    for match in matches:
        history, device = match.shape.history, match.shape.source.rpartition("/")[0]
        levels.setdefault((device, *history[: outline.reached(history) + 1]), []).append(match)
    for part, colour in zip(levels.values(), style.shades(len(levels)), strict=True):
        part = sorted(part, key=lambda photograph: photograph.shape.hold)
        holds = [photograph.shape.hold for photograph in part]
        measured = [1e3 * (photograph.shape.height - photograph.values["zero"]) / photograph.factor for photograph in part]
        computed = [1e3 * float(photograph.shadow.curve.nodes[:, :, 1].max()) for photograph in part]
        axes.plot(holds, measured, "o", mfc="none", mec=style.INK, ms=6)
        axes.plot(holds, computed, ".-", color=colour, lw=1.4, label=f"{part[0].shape.pressure / 1e3:.3g} kPa")
    axes.set(xscale="log", xlabel="time held (s)", ylabel="height (mm)")
    axes.set_title(f"{law}: measured (circles) and simulated (lines) heights")
    _legend_beside(axes)
    return figure


def _panel(axes: Axes, fitting: residuals.MatchedPhotograph) -> None:
    shape = fitting.shape
    count = np.bincount(shape.bins)
    away, height = fitting.points.T
    x, z = (1e3 * np.bincount(shape.bins, along) / count for along in (fitting.side * away, height))
    place = np.r_[0.0, np.cumsum(np.hypot(np.diff(x), np.diff(z)))] if shape.whole else x
    error = 1e6 * np.bincount(shape.bins, shape.error) / count / shape.weight
    axes.fill_between(place, -2 * error, 2 * error, color=style.FAINT, alpha=0.35, lw=0)
    axes.axhline(0.0, color=style.FAINT, linewidth=0.8)
    axes.plot(place, fitting.residuals * error, ".-", ms=4, lw=0.8, color=style.INK)
    chi2 = float((fitting.residuals**2).sum())
    read = f"{_name(shape)} ({fitting.reading * shape.pressure_error:+.0f} Pa)"
    axes.set_title(f"{read}: $\\chi^2$ {chi2:.0f} of {len(fitting.residuals)}", fontsize=9)


STYLES = ("-", "--", "-.", ":")
NAMES = {"uniaxial": "uniaxial tension", "planar": "pure shear", "equibiaxial": "equibiaxial tension"}
NAMES_OF_BOTH = {**NAMES, "uniaxial": "uniaxial tension and compression"}


def _plot_law(axes: Axes, i: int, x: Array, y: Array, label: str = "", marker: str = "") -> None:
    """Plot the i-th law in its colour and dashes."""
    colour, dashes = style.LINE_COLOURS[i % len(style.LINE_COLOURS)], STYLES[i % len(STYLES)]
    axes.plot(x, y, color=colour, linestyle=dashes, linewidth=1.8, label=label, marker=marker, markersize=4)


def draw_curves(report: comparison.FitReport) -> Figure:
    """Plot measured and fitted nominal stress, one panel per test; for a history in time two, against stretch and time."""
    timed = any(curve.time is not None for curve in report.curves)
    shown = [(curve, against) for curve in report.curves for against in ("stretch", "time")[: 1 + timed]]
    figure, panels = _panels(len(shown), 4.6, 2 if timed else 3)
    for axes, (curve, against) in zip(panels, shown, strict=True):
        along = curve.stretch if against == "stretch" else curve.time
        if along is None:
            axes.set_visible(False)
            continue
        axes.plot(along, curve.stress / 1e3, "o", ms=4, mfc="none", mec=style.INK, mew=0.8, label="measured")
        drawn = curve
        if curve.time is None:
            along = np.linspace(min(curve.stretch[0], 1.0), curve.stretch[-1], 300)
            drawn = dataclasses.replace(curve, stretch=along, stress=np.zeros_like(along))
        for i, law in enumerate(report.laws):
            stress = _gauge(law, report, curve) * predicted(law.material, drawn)
            _plot_law(axes, i, along, stress / 1e3, label=law.choice.name)
        names = NAMES_OF_BOTH if curve.stretch.min() < 0.99 else NAMES
        axes.set_title(f"{names[curve.mode]}\n{processes.plain(curve.name)}")
        axes.set(xlabel="stretch" if against == "stretch" else "time (s)", ylabel="nominal stress (kPa)")
        measured = curve.stress / 1e3
        room = 0.08 * float(np.ptp(measured))
        axes.set_ylim(float(measured.min()) - room, float(measured.max()) + 2 * room)
    panels[0].legend(loc="upper left")
    return figure


def draw_oscillations(report: comparison.FitReport) -> Figure:
    """Plot measured and fitted moduli and tan delta over frequency, one panel per quantity of a test."""
    shown = [(test, kind) for test in report.oscillations if isinstance(test, Oscillation) for kind in test.measured]
    figure, panels = _panels(len(shown), 4.0)
    for axes, (test, kind) in zip(panels, shown, strict=True):
        factor = 1.0 if kind == "tan-delta" else 1e-3
        axes.plot(test.frequency, factor * test.measured[kind], "o", ms=4, mfc="none", mec=style.INK, mew=0.8, label="measured")
        along = dataclasses.replace(
            test, frequency=np.geomspace(test.frequency.min(), test.frequency.max(), 200), measured={kind: np.ones(200) * 1e9}
        )
        for i, law in enumerate(report.laws):
            size = factor if kind == "tan-delta" else factor * _gauge(law, report, test)
            _plot_law(axes, i, along.frequency, size * along.predicted(law.material)[kind], label=law.choice.name)
        symbol = {"storage-modulus": "'", "loss-modulus": "''"}.get(kind)
        name = "tan delta" if symbol is None else f"{'G' if test.shear else 'E'}{symbol} (kPa)"
        axes.set(xscale="log", title=processes.plain(test.name), xlabel="frequency (Hz)", ylabel=name)
    panels[0].legend(loc="best")
    return figure


def draw_inflation(matched: MatchedInflation) -> Figure:
    """Plot measured and fitted pressures of a device over its size, and the residuals."""
    figure, (whole, left) = _panels(2, 4.0)
    whole.plot(matched.size, matched.pressure / 1e3, "o", ms=4, mfc="none", mec=style.INK, mew=0.8, label="measured")
    left.axhline(0.0, color=style.FAINT, linewidth=1.0)
    for i, (law, pressure) in enumerate(matched.fitted.items()):
        _plot_law(whole, i, matched.size, pressure / 1e3, label=law)
        _plot_law(left, i, matched.size, (pressure - matched.pressure) / 1e3, marker=".")
    whole.set(title=processes.plain(matched.name), xlabel=matched.axis, ylabel="pressure (kPa)")
    left.set(xlabel=matched.axis, ylabel="residual (fit - measured) (kPa)")
    whole.legend(loc="best")
    return figure


MAX_READINGS_SHOWN = 2000


@matplotlib.rc_context({**style.STYLE, "font.size": 10, "axes.titlesize": 10, "legend.fontsize": 9})
def draw_measured(curves: Sequence[TensileCurve]) -> Figure | None:
    """Plot all readings of the curves' files, what of them is fitted, and what was read from where; None for curves from
    elsewhere."""
    read = [curve for curve in curves if curve.raw is not None]
    if not read:
        return None
    figure, panels = _panels(len(read), 4.6, 2, whole=True)
    for axes, curve in zip(panels, read, strict=True):
        assert curve.raw is not None
        stretch, stress = curve.raw[:, :: max(curve.raw.shape[1] // MAX_READINGS_SHOWN, 1)]
        slack, zero = (curve.origin.slack, curve.origin.zero) if curve.origin else (0.0, 0.0)
        axes.plot(stretch, stress / 1e3, ".", ms=4, color=style.FAINT, label="all readings")
        axes.plot(curve.stretch + slack, (curve.stress + zero) / 1e3, color=style.LINE_COLOURS[0], lw=1.6, label="fitted")
        about = [textwrap.fill(processes.plain(text), 62) for text in (curve.source, *curve.remarks) if text]
        axes.set_title("\n".join([processes.plain(curve.name), *about]))
        axes.set(xlabel="stretch", ylabel="nominal stress (kPa)")
    panels[0].legend(loc="best")
    return figure


def draw_law(report: comparison.FitReport) -> Figure:
    """Plot the laws in uniaxial tension with the 95 % band of the fit: solid over the stretches that were fitted, dashed
    beyond, and everywhere if they are not known, as of moduli over frequency."""
    figure, axes = style.chart(0.6 * style.WIDTH_INCHES)
    known = [law.material.fitted_stretch for law in report.laws if law.material.fitted_stretch]
    least, most = (min(low for low, _ in known), max(high for _, high in known)) if known else (1.0, 1.5)
    stretch = np.linspace(least, most + 0.35 * (most - 1.0), 300)
    for i, law in enumerate(report.laws):
        colour = style.LINE_COLOURS[i % len(style.LINE_COLOURS)]
        try:
            errors = law.errors
            response = specimens.respond(law.material, stretch, parameters=errors.names)
            half = units.HALF_WIDTH_95 * np.linalg.norm(response.slopes @ errors.roots, axis=1)
            axes.fill_between(
                stretch, (response.stress - half) / 1e3, (response.stress + half) / 1e3, color=colour, alpha=0.18, lw=0
            )
        except materials.MaterialError:  # none was free, or the data do not determine it
            response = specimens.respond(law.material, stretch)
        low, high = law.material.fitted_stretch or (1.0, 1.0)
        fitted = (low <= stretch) & (stretch <= high)
        for where, dashes, label in ((fitted, "-", law.choice.name), (~fitted | (stretch > high), "--", "")):
            axes.plot(stretch, np.where(where, response.stress / 1e3, np.nan), dashes, color=colour, lw=1.8, label=label)
    if known:
        axes.axvspan(least, most, color=style.SPAN, alpha=0.5, lw=0, label="fitted range")
    axes.set(xlabel="stretch", ylabel="nominal stress (kPa)", title="Uniaxial tension; bands: 95 % of the fit")
    axes.legend(loc="upper left")
    return figure


def _gauge(law: comparison.FittedLaw, report: comparison.FitReport, test: TensileCurve | Oscillation) -> float:
    number = next(i for i, other in enumerate((*report.curves, *report.oscillations), 1) if other is test)
    return law.fit.values.get(f"gauge{number}", 1.0)


def draw_residuals(report: comparison.FitReport) -> Figure:
    """Plot the residuals (fit - measured) of the nominal stress, one panel per test."""
    figure, panels = _panels(len(report.curves), 4.0)
    for axes, curve in zip(panels, report.curves, strict=True):
        along, label = (curve.stretch, "stretch") if curve.time is None else (curve.time, "time (s)")
        axes.axhline(0.0, color=style.FAINT, linewidth=1.0)
        for i, law in enumerate(report.laws):
            residuals = _gauge(law, report, curve) * predicted(law.material, curve) - curve.stress
            _plot_law(axes, i, along, residuals / 1e3, label=law.choice.name, marker=".")
        axes.set(title=processes.plain(curve.name), xlabel=label, ylabel="residual (fit - measured) (kPa)")
        # A poor law must not flatten the others' residuals.
        sizes = [np.abs(lines.get_ydata()).max() for lines in axes.lines[1:]]
        reach = 1.15 * min(max(sizes), 8 * min(sizes))
        if max(sizes) * 1.15 > reach:
            axes.set_ylim(-reach, reach)
            axes.set_title(f"{processes.plain(curve.name)}\n(the worst laws exceed the axes)")
    panels[0].legend(loc="best")
    return figure


def draw_profiles(law: comparison.FittedLaw) -> Figure:
    """Return the rise of the deviance along every free parameter, the limit of the 95 % interval, and the quadratic
    approximation."""
    figure, grid = _panels(len(law.profiles), 3.6 + 0.3 / -(-len(law.profiles) // GRID_COLUMNS), whole=True)
    for axes, profile in zip(grid, law.profiles.values(), strict=True):
        best = law.fit.values[profile.name]
        _, unit = units.with_prefix(best, profile.unit)
        factor = {"MPa": 1e-6, "kPa": 1e-3}.get(unit, 1.0)
        axes.plot(profile.values * factor, profile.rises, "o-", ms=4, color=style.LINE_COLOURS[0], label="profile")
        error = law.fit.error(profile.name)
        if np.isfinite(error) and error > 0.0:
            quadratic = ((profile.values - best) / error) ** 2
            axes.plot(profile.values * factor, quadratic, ":", color=style.FAINT, label="quadratic")
        axes.axhline(profile.limit, color=style.WARNING, linewidth=1.2, label="95 %")
        axes.set_ylim(-0.05 * profile.limit, 2.5 * profile.limit)
        axes.set(xlabel=f"{profile.name} ({unit})" if unit else profile.name, ylabel="rise of the deviance")
        axes.tick_params(axis="x", labelrotation=25)
        if profile.values[0] > 0.0 and profile.values[-1] > 50 * profile.values[0]:
            axes.set_xscale("log")
    grid[0].legend(loc="upper center", fontsize=9)
    figure.suptitle(f"{law.choice.name}: profile likelihoods")
    return figure


def _panels(
    count: int, height: float, most: int = GRID_COLUMNS, sharex: bool = False, whole: bool = False
) -> tuple[Figure, Sequence[Axes]]:
    """Return a figure of panels side by side, ``height`` inches each; a single one is narrower unless ``whole``."""
    columns = min(count, most)
    rows = -(-count // columns)
    figure = Figure(
        (style.WIDTH_INCHES if columns > 1 or whole else 0.75 * style.WIDTH_INCHES, height * rows),
        dpi=style.DPI,
        layout="constrained",
    )
    grid = figure.subplots(rows, columns, squeeze=False, sharex=sharex).ravel()
    for axes in grid[count:]:
        axes.set_visible(False)
    return figure, list(grid[:count])


def draw_views(matches: Sequence[views.MatchedView], law: str) -> Figure:
    """Plot the tips of all side views in the picture, their angles over the readings, and the residuals in standard errors; a
    colour per photograph."""
    figure, (there, turned, left) = _panels(3, 3.6, whole=True)
    readings = np.array([match.shape.pressure / 1e3 for match in matches])
    measured = 1e3 * np.array([match.shape.points[0] for match in matches])
    simulated = 1e3 * np.array([match.seen for match in matches])
    angles = np.degrees(np.unwrap([match.seen_angle for match in matches]))
    off = np.array([np.remainder(match.seen_angle - match.shape.angle + np.pi, 2.0 * np.pi) - np.pi for match in matches])
    reach = 0.12 * 1e3 * matches[0].shape.arm
    there.plot(*simulated.T, color=style.FAINT, lw=1.0)
    turned.plot(readings, angles, color=style.FAINT, lw=1.0)
    for k, colour in enumerate(style.shades(len(matches))):
        way = reach * np.array([np.cos(np.radians(angles[k])), np.sin(np.radians(angles[k]))])
        there.plot(*np.array([simulated[k], simulated[k] + way]).T, color=colour, lw=1.6)
        there.plot(*measured[k], "x", color=style.INK, ms=6)
        turned.plot(readings[k], angles[k], "o", color=colour, ms=4)
        match, aside = matches[k], 0.05 * (k - 0.5 * len(matches))
        kinds = np.r_[np.arange(3) if match.shape.counts_tip else (), np.full(match.shape.places.size, 4), 3]
        left.plot(kinds + aside, [*match.residuals, match.reading], "o", color=colour, ms=4)
        there.plot(*1e3 * match.seen_markers.T, "o", color=colour, ms=3)
        there.plot(*1e3 * match.shape.places.T, "x", color=style.INK, ms=4)
    turned.plot(readings, angles - np.degrees(off), "x", color=style.INK, ms=6)
    there.plot(0.0, 0.0, "s", color=style.FAINT, ms=6)
    there.set(xlabel="x (mm)", ylabel="z (mm)", title="tips from the base; crosses: measured")
    there.set_aspect("equal", adjustable="datalim")
    turned.set(xlabel="reading (kPa)", ylabel="angle of the tip (deg)")
    left.axhspan(-2.0, 2.0, color=style.FAINT, alpha=0.25, lw=0)
    left.set(ylabel="residual (standard errors)\nsimulated - measured", xticks=range(5))
    left.set_xticklabels(["x", "z", "angle", "pressure", "markers"])
    figure.suptitle(f"{law}: side views, measured and simulated")
    return figure


SMALL_STYLE = {**style.STYLE, "font.size": 10, "axes.titlesize": 11, "legend.fontsize": 9}


@matplotlib.rc_context(SMALL_STYLE)
def figures(report: comparison.FitReport) -> dict[str, Figure]:
    """Return all pictures by the stem of their file's name."""
    figures = {"law": draw_law(report)}
    if (measured := draw_measured(report.curves)) is not None:
        figures["measured"] = measured
    if report.curves:
        figures |= {"curves": draw_curves(report), "residuals": draw_residuals(report)}
    if any(isinstance(test, Oscillation) for test in report.oscillations):
        figures["oscillations"] = draw_oscillations(report)
    if report.inflation is not None:
        figures["pressures"] = draw_inflation(report.inflation)
    for law, states in report.photographs.items():
        if of_sides := [match for match in states if isinstance(match, views.MatchedView)]:
            figures[f"views-{law}"] = draw_views(of_sides, law)
        if outlines := [match for match in states if not isinstance(match, views.MatchedView)]:
            figures[f"outlines-{law}"] = draw_outlines(outlines, law)
            figures[f"photographs-{law}"] = draw_photographs(outlines, law)
            if all(match.shape.history for match in outlines):
                figures[f"creep-{law}"] = draw_creep(outlines, law)
    for fit_states in report.laws:
        if fit_states.profiles:
            figures[f"profiles-{fit_states.choice.name}"] = draw_profiles(fit_states)
    return figures


def page(report: comparison.FitReport, figures: Mapping[str, Figure], tables: Mapping[str, str]) -> str:
    """Return the report as one self-contained page, with pictures by the stem of their file's name, and texts of CSV files to
    download by file name."""
    charts = {
        name: pages.Charts([(f"{name}.svg", curves.drawing(figure, units.COLUMN))], _caption(name))
        for name, figure in figures.items()
    }
    ranked = [
        (rank.fit.label, str(len(rank.fit.free)), f"+{rank.aicc:.4g}", f"{rank.bic:+.4g}") for rank in report.comparison.ranked
    ] if len(report.laws) > 1 else []  # fmt: skip
    chosen = report.chosen
    known = {law.choice.name: law.material.source for law in report.laws}
    return Page(
        "Fitted material", f"{report.verdict}.",
        [
            ("Pictures", [chart for name, chart in charts.items() if not name.startswith("profiles-")]),
            ("Laws compared", [pages.Table(ranked, ("law", "parameters", "AICc", "BIC")) if ranked else None]),
            *((law.choice.name, _law(law, charts)) for law in report.laws),
            ("Measurements", [pages.Bullets([*report.ranges, report.how])]),
        ],
        commands.Provenance.now(), _facts(chosen),
        [*([] if chosen.sound else [f"Unreliable fit: {chosen.warnings[0]}"]),
         *(report.separate.sentences if report.separate else ())],
        [f"{name}: {source}" for name, source in known.items() if source], tables,
    ).html()  # fmt: skip


CAPTIONS = {
    "law": "Stress over stretch; dashed beyond the fitted range",
    "measured": "All readings of the files, and what was read of them",
    "curves": "Measured curves and the fitted laws",
    "residuals": "Residuals of the curves (fit - measured)",
    "oscillations": "Measured moduli and tan delta over frequency, and the fitted laws",
    "pressures": "Pressures of the device, measured and fitted",
    "outlines": "Outlines, measured and simulated",
    "photographs": "Residuals of the outlines (simulated - measured)",
    "creep": "Heights over the time held",
    "views": "Tips and angles from the side, measured and simulated",
    "profiles": "Profile likelihoods of the parameters",
}
"""Captions of the pictures, by the beginning of their names."""


def _caption(name: str) -> str:
    kind, _, law = name.partition("-")
    return f"{CAPTIONS[kind]}{f': {law}' if law else ''}"


def _facts(law: comparison.FittedLaw) -> list[pages.Fact]:
    """Return the answer of a fit: the chosen law, its stiffness and its parameters with their intervals."""
    values = [
        pages.Fact(name, f"{value} {unit}".strip(), f"95 %: {interval} {unit}".strip() if " to " in interval else interval)
        for name, value, unit, interval in comparison.parameter_rows(law)
    ]
    modulus = " ".join(units.with_prefix(law.material.shear_modulus_0, "Pa"))
    note = "" if law.sound else "the fit was rejected"
    return [
        pages.Fact("Law", law.choice.name, note, not law.sound),
        pages.Fact("Shear modulus at small strain", modulus),
        *values,
    ]


def _law(fitted: comparison.FittedLaw, charts: Mapping[str, pages.Charts]) -> list[pages.Part | None]:
    """Return the report's section on a law."""
    correlations = comparison.correlation_rows(fitted)
    width = max(map(len, correlations), default=0)
    seen = (*least_squares.unseen(fitted.fit), *fitted.verdict.notes, fitted.form_note)
    told = (fitted.material.remark, *fitted.judgement.notes, *seen)
    names = ["correlation", *(p.name for p in fitted.fit.free[: max(width - 1, 0)])]
    return [
        pages.Text(
            f"Shear modulus at small strain {' '.join(units.with_prefix(fitted.material.shear_modulus_0, 'Pa'))}. "
            f"The least squares {'converged' if fitted.fit.converged else 'did not converge'}."
        ),
        pages.Bullets(fitted.warnings, alarm=True),
        pages.Table(comparison.parameter_rows(fitted), ("parameter", "value", "unit", "95 % interval")),
        pages.Table([[*row, *[""] * (width - len(row))] for row in correlations], names),
        pages.Table(comparison.residual_rows(fitted), ("residuals", "rms", "mean", "largest", "correlation length")),
        pages.Bullets([text for text in told if text]),
        charts.get(f"profiles-{fitted.choice.name}"),
    ]


# ----------------------------------------------------------------------------------------------------------------------
# Plot materials in test specimens.


@matplotlib.rc_context(SMALL_STYLE)
def draw(many: Sequence[specimens.MaterialCurves], measured: Sequence[TensileCurve], radius: float, thickness: float) -> bytes:
    """Return three tests and the balloon of a radius and thickness in m, with measured curves beside them, as PNG; nominal
    stresses are solid, unstable parts marked."""
    figure = Figure((style.WIDTH_INCHES, 8.4), dpi=style.DPI, layout="constrained")
    panels = figure.subplots(2, 2).ravel()
    for axes, mode in zip(panels[:3], specimens.MODE_NAMES, strict=True):
        for i, law in enumerate(many):
            stress = law.responses[mode].stress / 1e3
            _plot_law(axes, i, law.stretch, stress, label=processes.plain(law.name))
            _mark(axes, law, mode, stress)
        for curve, marker in zip(measured, itertools.cycle("osd^v"), strict=False):
            if curve.mode == mode:
                label = processes.plain(curve.name)
                axes.plot(curve.stretch, curve.stress / 1e3, marker, ms=3.5, mfc="none", mec=style.INK, mew=0.7, label=label)
        names = NAMES_OF_BOTH if many[0].stretch[0] < 0.99 else NAMES
        axes.set(title=names[mode], xlabel="stretch", ylabel="nominal stress (kPa)")
        axes.set_xlim(many[0].stretch[0], many[0].stretch[-1])
        _limit(axes, many, measured, mode)
    axes = panels[3]
    for i, law in enumerate(many):
        out = law.stretch >= 1.0
        _plot_law(axes, i, law.stretch[out], law.balloon(thickness / radius)[out] / 1e3)
    axes.set_title(f"balloon, radius {radius * 1e3:g} mm, thickness {thickness * 1e3:g} mm")
    axes.set(xlabel="circumference over undeformed circumference", ylabel="pressure (kPa)")
    handles = {text: handle for axes in panels for handle, text in zip(*axes.get_legend_handles_labels(), strict=True)}
    figure.legend(list(handles.values()), list(handles), loc="outside lower center", ncols=2)
    return style.png(figure)


def _mark(axes: Axes, curves: specimens.MaterialCurves, mode: str, stress: Array) -> None:
    """Mark the first instability of the law in this mode by a cross."""
    for weak in specimens.instabilities(curves.material):
        if weak.mode == mode and curves.stretch[0] <= weak.stretch <= curves.stretch[-1]:
            height = float(np.interp(weak.stretch, curves.stretch, stress))
            axes.plot(weak.stretch, height, "x", ms=9, mew=2.2, color=style.WARNING, zorder=5)
            axes.annotate("not stable", (weak.stretch, height), (6, -14), textcoords="offset points", color=style.WARNING)


def _limit(axes: Axes, many: Sequence[specimens.MaterialCurves], measured: Sequence[TensileCurve], mode: str) -> None:
    """Limit the axes so that a law near locking, or in strong compression, does not flatten the others."""
    stresses = [curves.responses[mode].stress / 1e3 for curves in many]
    own = [curve.stress[curve.stretch <= many[0].stretch[-1]] / 1e3 for curve in measured if curve.mode == mode]
    tops = [*map(np.nanmax, stresses), *(stress.max(initial=0.0) for stress in own)]
    top = min(max(tops), 6 * float(np.median(tops)))
    low = max(min(map(np.nanmin, stresses)), -1.5 * top)
    room = 0.05 * (top - low)
    axes.set_ylim(low - room, top + room)
