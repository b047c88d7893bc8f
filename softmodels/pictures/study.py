"""Pictures and report of a study: parallel coordinates, response surfaces, shares of the variance, and a page with all."""

from __future__ import annotations

import csv
import io
import math
from typing import TYPE_CHECKING

import matplotlib
import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from softmodels.common.arrays import Array
from softmodels.common.errors import MissingPackageError
from softmodels.common.pages import Bullets, Charts, Fact, Folded, Listing, Page, Provenance, Table, Text
from softmodels.design.study import Indices, Input, Study, StudyError
from softmodels.materials.silicones import publications
from softmodels.pictures.curves import drawing
from softmodels.pictures.style import CURVE, DPI, FAINT, LINES, STYLE, WARNING, WIDTH
from softmodels.runs.fields import split

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FINE = 41
"""Points of a response surface along each input."""
PERCENTILES = (5, 50, 95)


def label(one: Input | str) -> str:
    """Return an input's or a column's name with its unit."""
    name, unit = (one.key.rpartition(".")[2], one.unit) if isinstance(one, Input) else split(one)
    words = name.replace("_", " ")
    return f"{words}, {unit}" if unit else words


def parallel(study: Study) -> Figure:
    """Return the samples as lines over the inputs and responses, coloured by the first response."""
    inputs, responses = study.plan.inputs, study.responses
    points, values = study.plan.points, [study.values(name) for name in responses]
    columns = [*points.T, *values]
    places: list[Input | str] = [*inputs, *responses]
    with matplotlib.rc_context({**STYLE, "axes.grid": False}):
        figure = Figure((WIDTH, 4.4), dpi=DPI, layout="constrained")
        axes = figure.subplots()
        shares = []
        for one, column in zip(places, columns, strict=True):
            low, high = float(np.nanmin(column)), float(np.nanmax(column))
            if isinstance(one, Input) and one.values:
                low, high = 0.0, max(len(one.values) - 1.0, 1.0)
            width = high - low or 1.0
            shares.append((column - low) / width)
            _scale(axes, len(shares) - 1, one, (low, low + width))
        lines = np.stack(
            [np.broadcast_to(np.arange(len(shares)), (len(points), len(shares))), np.transpose(shares)], axis=-1
        )
        whole = np.isfinite(lines[..., 1]).all(axis=1)
        order = np.argsort(values[0][whole])
        bundle = LineCollection(
            list(lines[whole][order]), array=values[0][whole][order], cmap=LINES, linewidths=1.0, alpha=0.7
        )
        axes.add_collection(bundle)
        figure.colorbar(bundle, ax=axes, label=label(responses[0]), pad=0.02)
        axes.set(xlim=(-0.15, len(shares) - 0.85), ylim=(-0.05, 1.05), yticks=[])
        axes.set_xticks(range(len(shares)), [label(one).replace(", ", "\n") for one in places])
        for side in ("left", "right", "top", "bottom"):
            axes.spines[side].set_visible(False)
        axes.tick_params(length=0)
    return figure


def _scale(axes: Axes, place: int, one: Input | str, ends: tuple[float, float]) -> None:
    """Draw the axis of an input or a response, with the values at its ends or of its texts."""
    axes.axvline(place, color=FAINT, linewidth=1.0, zorder=0)
    low, high = ends
    marks = [(0.0, low), (0.5, (low + high) / 2), (1.0, high)]
    texts = [(share, f"{value:.4g}") for share, value in marks]
    if isinstance(one, Input) and one.values:
        listed = one.values[:: max(len(one.values) // 6, 1)]
        texts = [((one.values.index(value) - low) / (high - low), f"{value}") for value in listed]
    for share, text in texts:
        axes.annotate(text, (place, share), xytext=(4, 0), textcoords="offset points", fontsize=9, va="center", zorder=3,
                      bbox={"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.7})  # fmt: skip


def surface(study: Study, response: str, strongest: tuple[int, int]) -> Figure:
    """Return a response over the two strongest inputs, the others in their middle: its surrogate, and the samples."""
    inputs, model = study.plan.inputs, study.surrogate(response)
    shares = (np.arange(FINE) + 0.5) / FINE
    across, up = (_along(inputs[k], shares) for k in strongest)
    middle = np.array([float(one.ppf(np.array([0.5]))[0]) for one in inputs])
    points = np.tile(middle, (len(across) * len(up), 1))
    points[:, strongest[0]] = np.repeat(across, len(up))
    points[:, strongest[1]] = np.tile(up, len(across))
    values = model(points).reshape(len(across), len(up)).T
    first, second = (inputs[k] for k in strongest)
    with matplotlib.rc_context({**STYLE, "axes.grid": False}):
        figure = Figure((WIDTH * 0.72, 4.8), dpi=DPI, layout="constrained")
        axes = figure.subplots()
        x, y = _shown(first, across), _shown(second, up)
        low, high = float(values.min()), float(values.max())
        levels = np.linspace(low, high if high > low else low + 1.0, 15)
        filled = axes.contourf(x, y, values, levels=levels, cmap=LINES)
        own = study.values(response)
        known = np.isfinite(own)
        at = study.plan.points
        axes.scatter(
            _shown(first, at[known, strongest[0]]), _shown(second, at[known, strongest[1]]), c=own[known], cmap=LINES,
            vmin=levels[0], vmax=levels[-1], edgecolors="white", s=36, label="samples",
        )  # fmt: skip
        if not known.all():
            gone = ~known
            axes.plot(_shown(first, at[gone, strongest[0]]), _shown(second, at[gone, strongest[1]]), "x", color=WARNING,
                      label="no result")  # fmt: skip
            axes.legend(loc="best", fontsize=9)
        figure.colorbar(filled, ax=axes, label=label(response), format="%.4g")
        axes.set(xlabel=label(first), ylabel=label(second))
        for one, ticks in ((first, axes.set_xticks), (second, axes.set_yticks)):
            if one.named:
                ticks(range(len(one.values)), [str(value) for value in one.values])  # type: ignore[operator]
    return figure


def _along(one: Input, shares: Array) -> Array:
    """Return values of an input over its range; of a normal distribution up to its 95 % interval."""
    if one.values:
        return np.arange(len(one.values), dtype=float)
    return one.low + (one.high - one.low) * shares if one.normal else one.ppf(shares)


def _shown(one: Input, points: Array) -> Array:
    """Return values as they stand on an axis; of texts their places."""
    if one.named or not one.values:
        return points
    return np.array(one.values, dtype=float)[points.astype(int)]


def shares_figure(found: dict[str, Indices]) -> Figure:
    """Return the Sobol indices of each response as bars with their 95 % intervals."""
    with matplotlib.rc_context(STYLE):
        names = next(iter(found.values())).inputs
        figure = Figure((WIDTH, 1.3 + 0.45 * len(names)), dpi=DPI, layout="constrained")
        for axes, (response, one) in zip(
            np.ravel(figure.subplots(1, len(found), sharey=True)), found.items(), strict=True
        ):
            places = np.arange(len(names))
            axes.barh(
                places - 0.2, one.first, 0.38, xerr=one.first_half, color=CURVE, ecolor=FAINT, label="first order"
            )
            axes.barh(places + 0.2, one.total, 0.38, xerr=one.total_half, color=FAINT, ecolor=CURVE, label="total")
            axes.set(xlim=(0, None), xlabel="share of the variance", title=label(response))
            axes.set_yticks(places, [name.rpartition(".")[2].replace("_", " ") for name in names])
            axes.grid(axis="y", visible=False)
        axes.invert_yaxis()
        axes.legend(loc="best", fontsize=9)
    return figure


# ----------------------------------------------------------------------------------------------------------------------
# The table and the page.


def table(study: Study) -> str:
    """Return ``study.csv``: a row for each sample, units in the heads of the columns."""
    out = io.StringIO(newline="")
    rows = csv.writer(out, lineterminator="\n")
    inputs, responses = study.plan.inputs, study.responses
    heads = [f"{one.key} ({one.unit})" if one.unit else one.key for one in inputs]
    rows.writerow(["sample", *heads, *responses, "failure"])
    for k, point in enumerate(study.plan.points):
        values = [study.values(name)[k] for name in responses]
        own = [one.value(float(x)) for one, x in zip(inputs, point, strict=True)]
        rows.writerow([k, *own, *(f"{x:.9g}" if math.isfinite(x) else "" for x in values), study.failures.get(k, "")])
    return out.getvalue()


def page(study: Study, seconds: float) -> tuple[str, dict[str, Figure]]:
    """Return the report, and its figures by their names."""
    plan, cm = study.plan, study.plan.case.cm
    figures = {"parallel": parallel(study)}
    indices, errors, notes = _analysed(study, figures)
    failures = study.failures
    spread = [[name, *(f"{x:.5g}" for x in _figures(study.values(name)))] for name in study.responses]
    rows = [
        [f"{name}: {key}", f"{a:.3f} ± {c:.2g}", f"{b:.3f} ± {d:.2g}"]
        for name, one in indices.items()
        for key, a, b, c, d in zip(one.inputs, one.first, one.total, one.first_half, one.total_half, strict=True)
    ]
    facts = [Fact("samples", str(len(plan.points)), f"{plan.sampling}, seed {plan.seed}")]
    facts += [Fact("without a result", str(len(failures)), "see below", True)] if failures else []
    for name in study.responses:
        note = f"surrogate's error {errors[name]}" if name in errors else ""
        facts.append(Fact(label(name), f"{np.nanmedian(study.values(name)):.4g} {split(name)[1]}".strip(), note))

    def charts(start: str) -> Charts:
        return Charts([(f"{name}.svg", drawing(one, cm)) for name, one in figures.items() if name.startswith(start)])

    answer = f"{len(plan.points) - len(failures)} of {len(plan.points)} samples of {plan.case.name} have a result."
    report = Page(
        f"Study {plan.name}", answer,
        [
            ("Samples", [charts("parallel")]),
            ("Responses", [Table(spread, ["response", "mean", "standard deviation", *(f"{p} %" for p in PERCENTILES)])]),
            ("Response surfaces", [
                Text("The surrogate over the two strongest inputs, the others in their middle. Points: the samples."),
                charts("surface"),
                Bullets([f"{name}: cross-validated error {text} (rms)" for name, text in errors.items()]),
            ]),
            ("Sobol indices", [
                Text("Shares of the variance by each input: by itself (first order), with all interactions (total); "
                     + _of_what(indices)) if indices else None,
                charts("indices"), Table(rows, ["input", "first order", "total"]) if rows else None,
            ]),
            ("Samples without a result", [Bullets([f"sample {k}: {text}" for k, text in failures.items()])]),
            ("Inputs", [Table([[one.key, _range(one)] for one in plan.inputs], numbers=False)]),
            ("The case", [Folded("case.toml", [Listing(plan.case.to_toml())])]),
        ],
        Provenance.now(seconds), facts, notes, publications(plan.case.material), {"study.csv": table(study)}, cm,
    )  # fmt: skip
    return report.html(), figures


def _analysed(study: Study, figures: dict[str, Figure]) -> tuple[dict[str, Indices], dict[str, str], list[str]]:
    """Return indices and errors of the surrogates by response, and why others have none; add their figures."""
    indices, errors, notes = dict[str, Indices](), dict[str, str](), list[str]()
    for name in study.responses:
        try:
            found, made = study.indices(name), study.surrogate(name)
        except (StudyError, MissingPackageError) as error:
            notes.append(f"{name}: {error}")
            continue
        indices[name] = found
        share = made.error / made.spread if made.spread else 0.0
        size = f"{made.error:.3g} {split(name)[1]}".strip()
        errors[name] = f"{size}, {100 * share:.2g} % of the standard deviation"
        order = np.argsort(found.total)[::-1]
        if len(order) > 1:
            figures[f"surface-{name}"] = surface(study, name, (int(order[0]), int(order[1])))
    if indices and len(study.plan.inputs) > 1:
        figures["indices"] = shares_figure(indices)
    return indices, errors, notes


def _of_what(indices: dict[str, Indices]) -> str:
    worst = max(one.surrogate_error for one in indices.values())
    return "of the samples themselves." if worst == 0.0 else "of the surrogate, whose error adds to the intervals."


def _figures(values: Array) -> list[float]:
    return [float(np.nanmean(values)), float(np.nanstd(values)), *map(float, np.nanpercentile(values, PERCENTILES))]


def _range(one: Input) -> str:
    if one.values:
        return ", ".join(f"{value}" for value in one.values) + (f" {one.unit}" if one.unit else "")
    if one.normal:
        return f"{(one.low + one.high) / 2:.6g} ± {(one.high - one.low) / 2:.6g} {one.unit} (normal, 95 %)".replace(
            " (", " ("
        )
    return f"{one.low:.6g} to {one.high:.6g} {one.unit} (uniform)"
