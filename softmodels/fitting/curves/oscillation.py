"""Tests of a memory at frequencies: storage and loss moduli, or tan delta; read from tables, and as residuals."""

from __future__ import annotations

import abc
import dataclasses
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Self

import numpy as np

from softmodels.common import columns as machine
from softmodels.common.arrays import Array
from softmodels.common.columns import CurveTable, TensileError, in_si
from softmodels.common.names import keep_arrays
from softmodels.common.units import UnitError, quantity
from softmodels.fitting import problem
from softmodels.fitting.curves import residuals
from softmodels.fitting.curves.curve import SOFTEST_TEST
from softmodels.materials import specimens
from softmodels.materials.laws import Material, MaterialError

TESTS = {"oscillation": False, "shear-oscillation": True}
"""Tests, and whether their moduli are those of shear (G' and G''); else of tension or compression (E' and E'')."""
QUANTITIES = {"storage-modulus": "Pa", "loss-modulus": "Pa", "tan-delta": ""}


class FrequencyTest(abc.ABC):
    """A test that shows a silicone's memory at some frequencies: by the names of its quantities what was ``measured`` at each
    ``frequency`` in Hz."""

    name: str
    frequency: Array
    measured: Mapping[str, Array]

    @property
    @abc.abstractmethod
    def start_modulus(self) -> float:
        """A shear modulus in Pa for a fit to start from, near the relaxed one; infinite where the test shows none."""

    @property
    @abc.abstractmethod
    def sentence(self) -> str:
        """What is fitted, in words."""

    @abc.abstractmethod
    def predicted(self, material: Material) -> dict[str, Array]:
        """Return what a material has in place of what was measured."""

    @abc.abstractmethod
    def sources(
        self, choice: problem.LawChoice, error: residuals.StressError, spectrum: residuals.Spectrum, gauge: str
    ) -> Sequence[FrequencyResiduals[FrequencyTest]]:
        """Return its residuals, with the name of a factor on its moduli, empty for none."""


@dataclasses.dataclass(frozen=True, eq=False)
class FrequencyResiduals[Test: FrequencyTest](abc.ABC):
    """Residuals of a law with branches against a `FrequencyTest`, with exact derivatives; see
    `softmodels.fitting.problem.Residuals`.

    Attributes:
        errors: Standard errors in their unit, shape (n,).
        gauge: Name of the test's own factor on its moduli, or empty.
    """

    test: Test
    choice: problem.LawChoice
    spectrum: residuals.Spectrum
    errors: Array
    gauge: str

    @property
    @abc.abstractmethod
    def label(self) -> str: ...
    @property
    @abc.abstractmethod
    def unit(self) -> str: ...
    @abc.abstractmethod
    def evaluate(self, values: Mapping[str, float], derivatives: bool) -> tuple[Array, Array | None, list[str]]: ...
    def form_slopes(self, values: Mapping[str, float], name: str) -> Array:
        """Return zeros, shape (n,): at small strain the form of a law changes nothing."""
        return np.zeros(len(self.evaluate(values, False)[0]))

    @property
    def parameters(self) -> tuple[str, ...]:
        return (*self.choice.names, *self.spectrum.all_names, *([self.gauge] if self.gauge else []))

    def on_yardstick(self) -> Self:
        """Return itself: it does not distinguish laws."""
        return self

    def scaled(self, by: float) -> Self:
        """Return it with its errors scaled."""
        return dataclasses.replace(self, errors=self.errors * by)


@dataclasses.dataclass(frozen=True, eq=False)
class Oscillation(FrequencyTest):
    """Oscillations of small amplitude at several frequencies.

    Attributes:
        name: Where it comes from.
        shear: Whether the moduli are of shear; else of tension.
        frequency: In Hz, above 0, shape (n,).
        measured: By the names of `QUANTITIES` what was measured, moduli in Pa, above 0, shape (n,).
        remarks: Sentences on what was left out.
        source: What was read from which columns of its file.
    """

    name: str
    shear: bool
    frequency: Array
    measured: Mapping[str, Array]
    remarks: tuple[str, ...] = ()
    source: str = ""

    def __post_init__(self) -> None:
        values = [self.frequency, *self.measured.values()]
        if not self.measured or not set(self.measured) <= set(QUANTITIES):
            raise TensileError(f"{self.name}: give at least one of {', '.join(QUANTITIES)}")
        if any(np.shape(column) != (len(self.frequency),) for column in values) or not len(self.frequency):
            raise TensileError(f"{self.name}: give as many values of each quantity as frequencies, and at least one")
        for what, column in (("frequency", self.frequency), *self.measured.items()):
            if not (np.isfinite(column) & (np.asarray(column) > 0.0)).all():
                least = f"{np.min(column):.4g} {QUANTITIES.get(what, 'Hz')}".rstrip()
                raise TensileError(f"{self.name}: every {what.replace('-', ' ')} must be above 0; the smallest is {least}")
        if self.start_modulus < SOFTEST_TEST:
            raise TensileError(
                f"{self.name}: a storage modulus of {self.start_modulus / 1e3:.3g} kPa in shear is below that of any silicone "
                f"({SOFTEST_TEST / 1e3:g} kPa); check its unit (a factor 1000?)"
            )
        keep_arrays(self)

    @property
    def factor(self) -> float:
        """Its moduli over those of shear, of an incompressible silicone."""
        return 1.0 if self.shear else 3.0

    @property
    def start_modulus(self) -> float:
        return float(np.min(self.measured.get("storage-modulus", math.inf))) / self.factor

    @property
    def sentence(self) -> str:
        kinds = ", ".join(kind.replace("-", " ") for kind in self.measured)
        low, high = self.frequency.min(), self.frequency.max()
        about = "".join(f"; {remark}" for remark in (*filter(None, [self.source]), *self.remarks))
        return (
            f"{self.name} ({'shear' if self.shear else 'tension'}): {kinds} at {len(self.frequency)} frequencies from "
            f"{low:.4g} to {high:.4g} Hz{about}"
        )

    def predicted(self, material: Material) -> dict[str, Array]:
        own = material.memory
        added = [own.stiffening(s) if own else 0.0 for s in 2j * math.pi * self.frequency]
        modulus = self.factor * material.shear_modulus_0 * (1.0 + np.array(added))
        return {kind: _part(kind, modulus) for kind in self.measured}

    def sources(
        self, choice: problem.LawChoice, error: residuals.StressError, spectrum: residuals.Spectrum, gauge: str
    ) -> list[FrequencyResiduals[FrequencyTest]]:
        made: list[FrequencyResiduals[FrequencyTest]] = []
        for kind, values in self.measured.items():
            absolute: float | Array = 0.0 if error.absolute is None or not QUANTITIES[kind] else error.absolute
            if not error.stated and kind != "storage-modulus":
                absolute = LOSS_RESOLUTION * (self.measured.get("storage-modulus", 0.0) if QUANTITIES[kind] else 1.0)
            relative = error.relative or (0.0 if QUANTITIES[kind] else residuals.DEFAULT_RELATIVE_ERROR)
            errors = np.hypot(relative * values, absolute)
            made.append(OscillationResiduals(self, choice, spectrum, errors, gauge if QUANTITIES[kind] else "", kind))
        return made


def _part(kind: str, modulus: Array) -> Array:
    """Return one of `QUANTITIES` of complex moduli."""
    if kind == "tan-delta":
        return np.asarray(modulus.imag / modulus.real)
    return np.asarray(modulus.real if kind == "storage-modulus" else modulus.imag)


@dataclasses.dataclass(frozen=True, eq=False)
class OscillationResiduals(FrequencyResiduals[Oscillation]):
    """Residuals against one quantity of an oscillation.

    Attributes:
        kind: One of `QUANTITIES`.
    """

    kind: str

    @property
    def label(self) -> str:
        return f"{self.test.name} ({self.kind.replace('-', ' ')})"

    @property
    def unit(self) -> str:
        return QUANTITIES[self.kind]

    def evaluate(self, values: Mapping[str, float], derivatives: bool) -> tuple[Array, Array | None, list[str]]:
        """See `softmodels.fitting.problem.Residuals`."""
        try:
            material = self.choice.material(values)
        except MaterialError as error:
            raise problem.CannotEvaluate(str(error)) from None
        times = np.array(self.spectrum.times_at(values))
        shares = np.array([values[name] for name in self.spectrum.names])
        turn = 2j * math.pi * self.test.frequency[:, None]
        size = self.test.factor * (values[self.gauge] if self.gauge else 1.0)
        branches = turn * times / (1.0 + turn * times)
        relative, modulus = 1.0 + branches @ shares, material.shear_modulus_0
        whole = size * modulus * relative
        labels = [self.label] * len(whole)
        off = (_part(self.kind, whole) - self.test.measured[self.kind]) / self.errors
        if not derivatives:
            return off, None, labels
        columns = [size * slope * relative for slope in specimens.modulus_slopes(material, self.choice.names)]
        columns += list(size * modulus * branches.T)
        if self.spectrum.fitted:
            columns += list(size * modulus * shares[:, None] * (turn / (1.0 + turn * times) ** 2).T)
        if self.gauge:
            columns.append(whole / values[self.gauge])
        slopes = np.column_stack([self._slope(whole, column) for column in columns]) / self.errors[:, None]
        return off, slopes, labels

    def _slope(self, whole: Array, change: Array) -> Array:
        if self.kind != "tan-delta":
            return _part(self.kind, change)
        return np.asarray((change.imag - whole.imag / whole.real * change.real) / whole.real)


LOSS_RESOLUTION = 0.002
"""Absolute error of tan delta, as of an angle in rad, and of the loss over the storage modulus, unless errors are stated."""


def residuals_of(
    tests: Sequence[FrequencyTest],
    choice: problem.LawChoice,
    error: residuals.StressError,
    gauge_error: float,
    spectrum: residuals.Spectrum,
    first: int = 1,
) -> problem.Extra:
    """Return the sources for tests, each with a factor on its moduli of relative error ``gauge_error``, numbered from
    ``first``."""
    sources: list[FrequencyResiduals[FrequencyTest]] = []
    own = []
    for number, test in enumerate(tests, first):
        gauge = f"gauge{number}" if gauge_error and set(test.measured) != {"tan-delta"} else ""
        if gauge:
            own.append(problem.Parameter(gauge, "", 1.0, 0.2, 5.0, problem.Prior(1.0, gauge_error)))
        sources += test.sources(choice, error, spectrum, gauge)
    return problem.Extra(sources, own)


# ----------------------------------------------------------------------------------------------------------------------
# Tables of dynamic mechanical analysers and rheometers.


MAX_TEMPERATURE_RANGE = 3.0
"""Range in K of the temperatures of one fit."""
TEMPERATURE_TOLERANCE = 1.0
"""Distance in K of a row from the temperature that is chosen."""
_OF_SHEAR = re.compile(r"\bG\s*['\"\u2019\u2032\u2033]|\b(shear|schub\w*|scher\w*|cisaillement)\b", re.IGNORECASE)
_OF_TENSION = re.compile(r"\bE\s*['\"\u2019\u2032\u2033]|\b(tensile|tension|zug|young\w*)\b", re.IGNORECASE)


def read(path: Path, test: str, columns: str = "", temperature: str = "") -> list[Oscillation]:
    """Read the oscillations of a table with a column of frequencies (Hz or rad/s), and of moduli or tan delta.

    Args:
        test: One of `TESTS`.
        columns: Which columns to take, such as ``"frequency=1[Hz],storage-modulus=2[MPa]"``; empty to go by the headers.
        temperature: Which one to take of several, such as ``"23 °C"``.

    Raises:
        TensileError: The file cannot be used.
    """
    told = machine.columns_of_text(columns, machine.OSCILLATION) if columns else {}
    try:
        wanted = None if not temperature else quantity(temperature.replace("°C", "degC"), "K") - 273.15
        tables = machine.read_tables(path, told, machine.OSCILLATION)
        read = [(_columns(table, TESTS[test], test), table) for table in tables]
        every = [values["temperature"] for values, _ in read if "temperature" in values]
        _check_temperatures(path, test, np.concatenate(every) if every else np.empty(0), wanted)
        made = [_oscillation(path, values, table, TESTS[test], wanted) for values, table in read]
    except (TensileError, UnitError) as error:
        raise TensileError(f"{path}: {error}") from None
    return [oscillation for oscillation in made if oscillation is not None]


def _columns(table: CurveTable, shear: bool, test: str) -> dict[str, Array]:
    """Return the columns of a table in SI units, temperatures in degrees Celsius."""
    frequency = in_si(table.x, table.deformation)
    made = {"frequency": frequency / (2 * math.pi) if table.deformation.kind == "angular-frequency" else frequency}
    for part in (table, *(further() for further in table.others)):
        column, values = part.load, part.y
        if column.kind == "temperature":
            made[column.kind] = values - 273.15 if column.unit in ("K", "kelvin") else values
            continue
        said = bool(_OF_SHEAR.search(column.header)), bool(_OF_TENSION.search(column.header))
        if said[0] != said[1] and said[0] != shear and column.kind in ("storage-modulus", "loss-modulus"):
            other = next(name for name, of_shear in TESTS.items() if of_shear != shear)
            raise TensileError(
                f"the column {column.header!r} is not of the test {test!r}; write :{other} behind the file's name"
            )
        made[column.kind] = in_si(values, column)
    if len(set(made) & set(QUANTITIES)) == len(QUANTITIES):
        del made["tan-delta"]  # the quotient of the other two
    return made


def _check_temperatures(path: Path, test: str, temperatures: Array, wanted: float | None) -> None:
    """Raise `TensileError` for several temperatures of which none is chosen, or one that is not there."""
    if not len(temperatures):
        if wanted is not None:
            raise TensileError("it has no column of temperatures to choose from; leave the temperature out")
        return
    levels = list(dict.fromkeys(np.round(np.sort(temperatures)).tolist()))
    shown = ", ".join(f"{level:g}" for level in levels[:10]) + (" ..." if len(levels) > 10 else "") + " °C"
    if wanted is None and np.ptp(temperatures) > MAX_TEMPERATURE_RANGE:
        raise TensileError(
            f"it has several temperatures ({shown}), and a memory is that of one; choose it, such as "
            f"{path.name}:{test}:{levels[len(levels) // 2]:g}°C"
        )
    if wanted is not None and not (np.abs(temperatures - wanted) <= TEMPERATURE_TOLERANCE).any():
        raise TensileError(f"it has no row within {TEMPERATURE_TOLERANCE:g} K of {wanted:g} °C; its temperatures are {shown}")


def _oscillation(
    path: Path, values: Mapping[str, Array], table: CurveTable, shear: bool, wanted: float | None
) -> Oscillation | None:
    """Return the rows of a table at the chosen temperature; None if it has none."""
    kept, remarks = np.full(len(table.x), True), []
    if (temperature := values.get("temperature")) is not None:
        if wanted is not None:
            kept = np.abs(temperature - wanted) <= TEMPERATURE_TOLERANCE
        if not kept.any():
            return None
        remarks.append(f"at {temperature[kept].mean():.3g} °C")
        if not kept.all():
            remarks.append(f"{int((~kept).sum())} rows at other temperatures are left out")
    source = ", ".join([table.deformation.sentence, *(part().load.sentence for part in (lambda: table, *table.others))])
    measured = {kind: values[kind][kept] for kind in QUANTITIES if kind in values}
    name = f"{path.name} {table.label}".strip()
    return Oscillation(name, shear, values["frequency"][kept], measured, tuple(remarks), source)


def of_test(text: str) -> bool:
    """Return whether a test's name is one of `TESTS`; `TensileError` with the right one for a synonym."""
    if text.lower() in ("dma", "dmta", "rheometer", "frequency-sweep"):
        raise TensileError(
            f"test {text!r}: write oscillation for moduli E' of tension or compression, shear-oscillation for G' of shear"
        )
    return text.lower() in TESTS
