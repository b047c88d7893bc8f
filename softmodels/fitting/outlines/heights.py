"""The thesis' own objective: the mean square deviation of the largest deflections at the measured pressures.

Heights are held against states at the readings as they are, all with the same weight. It has no place for states past a limit
point, and what the bench gets wrong in all photographs alike (a leak, an offset, a unit, the zero plane) it can neither see nor
correct: the scatter about the fitted law does not show it. What is believable of each is carried into the error bars to first
order (considered parameters: Schmidt 1966; Tapley, Schutz & Born 2004, Statistical Orbit Determination, chapter 6).
`softmodels.fitting.outlines.outline_residuals` has both, and sees the whole outline.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from measurement.reasons import reason
from measurement.units import UnitError, number
from measurement.user_table import Line, pick, read_sheets, records
from softmodels.fitting.least_squares import fit_parameters
from softmodels.fitting.outlines.bench import LEAK_ERROR, PRESSURE_SCALE_ERROR, SCALE_ERROR, ZERO_ERROR
from softmodels.fitting.outlines.device_model import DeviceModel
from softmodels.fitting.outlines.reading import OutlineFitError, kept
from softmodels.fitting.outlines.shapes import FLOOR, TALLEST
from softmodels.fitting.outlines.start import starts
from softmodels.fitting.problem import CannotEvaluate, Changes, FitError, Parameter
from softmodels.fitting.result import LeastSquaresFit
from softmodels.mechanics.system import State

Array = npt.NDArray[np.float64]

STIFFER = (1.0, 1.1, 1.3, 2.0)
"""Factors on the starting stresses, tried until every pressure has a state."""


@dataclasses.dataclass(frozen=True)
class Height:
    """A measured height of the top: source, pressure in Pa, height in m, and their standard errors."""

    source: str
    pressure: float
    height: float
    pressure_error: float = 10.0
    height_error: float = 1e-5


def read_heights(path: Path, untrusted: bool = False, without: Sequence[str] = ()) -> list[Height]:
    """Read the ``heights.csv`` that ``python -m measurement photos`` writes; refused photographs are left out.

    Args:
        path: The table.
        untrusted: Take heights that the measurement does not trust.
        without: Names of photographs to leave out.

    Raises:
        OutlineFitError: No such table; a number that is none; a height that is not trusted, unless ``untrusted``.
    """
    try:
        chosen = pick(path, read_sheets(path), lambda sheet: sheet.rows if _has_heights(sheet.rows) else None)
    except OSError as error:
        raise OutlineFitError(f"{path} cannot be read: {reason(error)}") from None
    if chosen is None or len(chosen[1]) < 2:
        raise OutlineFitError(f"{path} is no table of heights; it needs the columns pressure_Pa and height_m")
    sheet, rows = chosen[0], records(chosen[1])
    found = []
    keep = set(kept([(row.get("file") or sheet.place(number), None) for number, row in rows], without))
    for place, (line, row) in enumerate(rows):
        if place not in keep:
            continue
        where = sheet.place(line)
        trusted = (row.get("trusted") or "yes").strip()
        if trusted == "refused":
            continue
        if trusted != "yes" and not untrusted:
            raise OutlineFitError(
                f"{path}, {where}: this height is not to be trusted ({row.get('remarks') or 'no reason given'}); "
                "leave it out, or take it with --untrusted"
            )
        try:
            pressure, height = number(row["pressure_Pa"]), number(row["height_m"])
            errors = [number(row[key]) if row.get(key) else 0.0 for key in ("pressure_error_Pa", "height_error_m")]
        except UnitError as error:
            raise OutlineFitError(f"{path}, {where}: pressure or height is not a number ({error})") from None
        known = {
            name: value for name, value in zip(("pressure_error", "height_error"), errors, strict=True) if value > 0.0
        }
        found.append(Height(row.get("file") or where, pressure, height, **known))
    return sorted(found, key=lambda one: one.pressure)


def _has_heights(rows: Sequence[Line]) -> bool:
    return bool(rows) and {"pressure_Pa", "height_m"} <= {name.strip() for name in rows[0][1]}


def check_heights(heights: Sequence[Height], width: float) -> list[Height]:
    """The heights that say something, those at rest left out.

    Raises:
        OutlineFitError: None is left, two have one pressure, or the unit is mistaken.
    """
    for one in heights:
        if one.pressure < 0.0 and one.height > FLOOR:
            raise OutlineFitError(
                f"{one.source} rises {one.height * 1e3:.4g} mm at a pressure below zero, {one.pressure:.5g} Pa: is its sign "
                f"wrong, or are its tubes exchanged? Correct it, or fit without: --without {one.source}"
            )
    risen = [one for one in heights if one.pressure > 0.0 and one.height > 0.0]
    if not risen:
        raise OutlineFitError("no height is above zero at a pressure above zero, so there is nothing to fit to")
    highest = max(one.height for one in risen)
    if highest > TALLEST * width or highest < 1e-4 * width:
        raise OutlineFitError(
            f"the largest height is {highest * 1e3:.4g} mm, for a device {width * 2e3:.4g} mm across: check the unit "
            "(heights are in metres)"
        )
    for one, two in itertools.pairwise(risen):
        if two.pressure - one.pressure <= 1e-6 * two.pressure:
            raise OutlineFitError(
                f"{one.source} and {two.source} have the same pressure, {two.pressure:.5g} Pa; give one"
            )
    return risen


class HeightResiduals:
    """Residuals of heights in mm; see `softmodels.fitting.problem.Residuals`.

    Args:
        model: The device and its law.
        heights: Measured heights, checked.
    """

    unit, errors, device = "mm", 1.0, ""

    def __init__(self, model: DeviceModel, heights: Sequence[Height], label: str = "heights"):
        self.model, self.heights, self.label = model, tuple(heights), label
        self.parameters = model.names
        self.fixed: frozenset[str] = frozenset()
        self.pressures = np.array([one.pressure for one in heights])
        self.measured = np.array([one.height for one in heights])
        self.height_errors = np.array([one.height_error for one in heights])

    @property
    def in_words(self) -> str:
        """How much was measured."""
        top = float(self.measured.max())
        return f"{len(self.heights)} heights to {top * 1e3:.4g} mm at {self.pressures[-1] / 1e3:.4g} kPa"

    def own(self, values: Mapping[str, float]) -> Mapping[str, float]:
        """The fit's values by the names that they have in this device: the same."""
        return values

    def largest_state(self, values: Mapping[str, float]) -> State:
        """The state of the largest pressure at parameter values."""
        return self.model.states(values, self.pressures, "pressure")[-1]

    def evaluate(self, values: Mapping[str, float], derivatives: bool) -> tuple[Array, Array | None, list[str]]:
        """See `softmodels.fitting.problem.Residuals`.

        Raises:
            CannotEvaluate: One of the pressures has no state on the first branch.
        """
        states = self.model.states(values, self.pressures, "pressure")
        lengths = self.model.set_parameters(values)
        tops = np.array([self.model.curve(state, lengths).nodes[0, 0, 1] for state in states])
        residuals = 1e3 * (tops - self.measured)
        labels = [self.label] * len(residuals)
        if not derivatives:
            return residuals, None, labels
        J = np.zeros((len(states), len(self.parameters)))
        names = [name for name in self.parameters if name not in self.fixed]
        for row, state in enumerate(states):
            slopes = self.model.slopes(state, names, "pressure")
            for name in names:
                J[row, self.parameters.index(name)] = 1e3 * slopes.nodes[name][0, 0, 1]
        return residuals, J, labels

    def shared(self, values: Mapping[str, float]) -> Array:
        """Change of the residuals by one standard error of each thing that the bench gets wrong alike in all, shape (n, 5)."""
        states = self.model.states(values, self.pressures, "pressure")
        self.model.set_parameters(values)
        rise = 1e3 * np.array(
            [self.model.slopes(state, (), "pressure").along_nodes[0, 0, 1] for state in states]
        )  # mm per Pa
        offset = min(one.pressure_error for one in self.heights)
        columns = (
            -rise * offset,
            -rise * self.pressures * PRESSURE_SCALE_ERROR,
            -rise * self.pressures**2 / self.pressures.max() * LEAK_ERROR,
            1e3 * self.measured * SCALE_ERROR,
            np.full(len(rise), 1e3 * ZERO_ERROR),
        )
        return np.column_stack(columns)


def fit_heights(
    source: HeightResiduals, *, changes: Changes = MappingProxyType({}), loss: str = "linear"
) -> LeastSquaresFit:
    """Fit a law to heights; the size of their errors follows from their scatter, and the bench's own errors are considered.

    Raises:
        FitError: See `softmodels.fitting.least_squares.fit_parameters`.
        OutlineFitError: The device does not rise so high.
    """
    model = source.model
    choice = model.choice
    begins, _ = starts(model, source.measured, source.pressures, np.ones(len(source.measured)))
    known = [Parameter("poisson", "", choice.poisson, fixed=True)]
    known += [Parameter(name, "m", value, fixed=True) for name, value in model.lengths.items()]
    troubles = []
    for begin, factor in ((begin, factor) for begin in begins for factor in STIFFER):
        stiffer = {name: value * (factor if choice.unit(name) == "Pa" else 1.0) for name, value in begin.items()}
        parameters = [p.changed(changes.get(p.name, {})) for p in (*choice.parameters(stiffer), *known)]
        source.fixed = frozenset(p.name for p in parameters if p.fixed)
        try:
            found = fit_parameters([source], parameters, loss=loss, errors="unknown", label=choice.name)
            return dataclasses.replace(found, shared=source.shared(found.values))
        except (FitError, CannotEvaluate) as error:
            troubles.append(str(error))
    raise FitError(f"{choice.name}: {troubles[0]}")
