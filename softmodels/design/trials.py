"""Loads at which designs are judged, and evaluated designs.

A load is a pressure, or an added volume where pressures are ambiguous.
"""

from __future__ import annotations

import dataclasses
import functools
import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Self

import numpy as np

from geometries import Actuator
from softmodels.common import files, names, units
from softmodels.common.arrays import Array


@dataclasses.dataclass(frozen=True, eq=False)
class Trial:
    """A design with its values, of a start and a mesh; numbers count from 1, and the same design may be evaluated again on
    another mesh. Values, gradients and squares are as of `Evaluation`, by the problem's `names` in SI units. Values are empty
    of a failure, which is a sentence, empty for none."""

    number: int
    start: int
    theta: tuple[float, ...]
    mesh: int = 1
    values: Mapping[str, float] = dataclasses.field(default_factory=dict)
    gradients: Mapping[str, Sequence[float]] = dataclasses.field(default_factory=dict)
    material_gradients: Mapping[str, Mapping[str, float]] = dataclasses.field(default_factory=dict)
    newton: int = 0
    seconds: float = 0.0
    quality: float = 1.0
    remeshed: bool = False
    squares: Mapping[str, Squares] = dataclasses.field(default_factory=dict)
    notes: tuple[str, ...] = ()
    failure: str = ""

    @property
    def failed(self) -> bool:
        return bool(self.failure)

    def to_json(self) -> str:
        """Return the trial as JSON, with exact numbers."""
        squares = {key: residual.to_table() for key, residual in self.squares.items()}
        return json.dumps({**dataclasses.asdict(self), "squares": squares}, indent=1)

    @classmethod
    def from_json(cls, text: str) -> Trial:
        """Return the trial of `to_json`'s text; ValueError if it is something else."""
        told = files.parse_json(text)
        try:
            squares = {key: Squares.from_table(table) for key, table in told.get("squares", {}).items()}
            theta, notes = tuple(map(float, told["theta"])), tuple(told["notes"])
            return cls(**{**told, "theta": theta, "notes": notes, "squares": squares})
        except (TypeError, KeyError, AttributeError) as error:
            raise ValueError(str(error)) from None

    @classmethod
    def of(cls, place: tuple[int, int, tuple[float, ...], int], evaluated: Evaluation, seconds: float) -> Trial:
        """Return the trial of an `Evaluation`; ``place`` has the number, start, values and mesh."""
        return cls(
            *place,
            {key: float(value) for key, value in evaluated.values.items()},
            {key: [float(slope) for slope in slopes] for key, slopes in (evaluated.gradients or {}).items()},
            {key: {name: float(slope) for name, slope in slopes.items()}
             for key, slopes in evaluated.material_gradients.items()},
            int(evaluated.newton), seconds, float(evaluated.quality), bool(evaluated.remeshed),
            dict(evaluated.squares), tuple(evaluated.notes),
        )  # fmt: skip


class Trials:
    """All trials of a run, in memory; see `softmodels.design.model` for those on disk."""

    def __init__(self) -> None:
        self.all: list[Trial] = []
        self._known: dict[tuple[int, bytes], Trial] = {}

    def add(self, trial: Trial) -> None:
        self.all.append(trial)
        self._known[trial.mesh, _bits(trial.theta)] = trial

    def find(self, theta: Sequence[float] | Array, mesh: int = 1) -> Trial | None:
        """Return the trial of these values to the last bit on a mesh; None if there was none."""
        return self._known.get((mesh, _bits(theta)))


def _bits(theta: Sequence[float] | Array) -> bytes:
    return (np.asarray(theta, dtype=float) + 0.0).tobytes()  # + 0.0: -0.0 is 0.0


PRESSURE, VOLUME = "pressure", "volume"


@dataclasses.dataclass(frozen=True, order=True)
class EvaluatedLoad:
    """A state of a device by its load: "pressure" (the first state at it, Pa) or "volume" (added to the cavity of the whole
    device, m3), and how the user wrote it, such as "30 kPa" or "177 cm"; empty where it was a number."""

    kind: str
    value: float
    text: str = dataclasses.field(default="", compare=False)

    def __post_init__(self) -> None:
        if self.kind not in (PRESSURE, VOLUME):
            raise ValueError(f"load {self.kind!r} is not one of {PRESSURE}, {VOLUME}")

    @classmethod
    def of(cls, value: float | EvaluatedLoad) -> EvaluatedLoad:
        """Return a load unchanged; a number is a pressure in Pa."""
        return value if isinstance(value, EvaluatedLoad) else cls(PRESSURE, float(value))

    def __str__(self) -> str:
        return units.readable(self.value, "Pa") if self.kind == PRESSURE else f"{self.value * 1e6:.6g} ml"


# ----------------------------------------------------------------------------------------------------------------------
# Errors of a design before anything is solved, and stops by the user.


class DesignError(ValueError):
    """Invalid input, detected before anything is solved; the message is for the user."""


class DesignStopped(Exception):
    """The user stopped the search; all evaluations are kept."""


# ----------------------------------------------------------------------------------------------------------------------
# Units of quantities: reading limits and showing values.


UNIT_SPELLINGS = {"1": "", "tolerances": "", "m2": "m^2", "m3": "m^3", "deg": "degree", "kg/m3": "kg/m^3"}
"""Units in Pint's spelling, where it differs."""


def spelled(unit: str) -> str:
    """Return a unit as `softmodels.common.units.quantity` takes it."""
    return UNIT_SPELLINGS.get(unit, unit)


def read(what: str, value: object, unit: str, bare: bool = True) -> float:
    """Return a value in SI units from a text with a unit, or from a number where these are ``bare``; in files a unit is
    needed. DesignError names what it is of."""
    try:
        value = units.plain(value)
        if isinstance(value, bool) or not isinstance(value, str | int | float):
            kind = "text with a unit" if spelled(unit) else "number"
            raise DesignError(f"{what} is {units.brief(value)}; it must be a {kind}")
        return units.quantity(value, "" if bare and not isinstance(value, str) else spelled(unit))
    except units.UnitError as error:
        raise DesignError(f"{what}: {error}") from None


def dotted(table: Mapping[str, object], before: str = "") -> Iterator[tuple[str, object]]:
    """Yield the entries of a table and of tables in it, by their names with dots: TOML reads ``fibres.angle`` so."""
    for name, value in table.items():
        if isinstance(value, Mapping):
            yield from dotted(value, f"{before}{name}.")
        else:
            yield f"{before}{name}", value


@functools.cache
def factor(shown: str, unit: str) -> float:
    """Return the SI value of a display unit: 0.001 for mm and m."""
    return units.quantity(f"1 {spelled(shown)}", spelled(unit)) if spelled(shown) else 1.0


def text(value: float, shown: str, unit: str, digits: int = 4) -> str:
    """Return a value as text, such as ``"12.3 mm"``."""
    return f"{value / factor(shown, unit):.{digits}g} {'' if shown == '1' else shown}".strip()


def shown_unit(unit: str) -> str:
    """Return the display unit of a parameter or quantity."""
    return {"m": "mm", "Pa": "kPa", "m3": "ml", "m^3": "ml", "degree": "deg", "kg": "g", "J": "mJ"}.get(unit, unit)


# ----------------------------------------------------------------------------------------------------------------------
# Evaluated designs: none twice, each stored at once.
#
# Residuals of a target with their derivatives, compressed for least squares.
#
# Gauss and Newton's method and the covariance of its end use residuals r and their Jacobian J only through J^T J, J^T r and r^T
# r. The triangle of the QR decomposition of [J r] has all three, however many residuals there are.


@dataclasses.dataclass(frozen=True, eq=False)
class Squares:
    """Residuals and their derivatives by the parameters, SI units: their count, the correlation length of the errors in
    points (``run``), the standard error of one (``sigma``, 0 where it is not known), and the triangle of [J r], shape (m + 1,
    m + 1)."""

    count: int
    run: float
    sigma: float
    triangle: Array

    def __post_init__(self) -> None:
        names.keep_arrays(self)

    @classmethod
    def of(cls, residuals: Array, jacobian: Array, run: float = 1.0, sigma: float = 0.0) -> Self:
        """Of residuals (n,) with their Jacobian (n, m)."""
        both = np.column_stack([jacobian, residuals])
        columns = both.shape[1]
        padded = np.vstack([both, np.zeros((max(columns - len(both), 0), columns))])
        return cls(len(residuals), run, sigma, np.linalg.qr(padded, mode="r"))

    @property
    def residuals(self) -> Array:
        """A vector of the residuals' length, shape (m + 1,)."""
        return self.triangle[:, -1]

    @property
    def jacobian(self) -> Array:
        """Its derivatives, shape (m + 1, m)."""
        return self.triangle[:, :-1]

    def to_table(self) -> dict[str, object]:
        """Return the value as plain numbers."""
        return {**dataclasses.asdict(self), "triangle": self.triangle.tolist()}

    @classmethod
    def from_table(cls, table: dict[str, object]) -> Self:
        """Return the residuals of `to_table`'s table; TypeError, ValueError or KeyError if it is something else."""
        return cls(
            int(str(table["count"])), float(str(table["run"])), float(str(table["sigma"])),
            np.array(table["triangle"], dtype=float),
        )  # fmt: skip


# ----------------------------------------------------------------------------------------------------------------------
# Evaluation of a design: values and gradients of all quantities at one set of parameters.


class DesignFailure(RuntimeError):
    """A design cannot be evaluated: it is not a valid device, or has no state at a load; the message is a sentence. ``limit``
    is the pressure in Pa at which its path ends, if that is why."""

    def __init__(self, message: str, limit: float | None = None):
        super().__init__(message)
        self.limit = limit


@dataclasses.dataclass(frozen=True, eq=False)
class Evaluation:
    """An evaluated design: its parameters, and the values of the quantities by key, in SI units; their gradients by theta,
    empty if none were asked for, and by the material's numbers, by key and name; the squares of those that are distances from
    a target. ``quality`` is the least Jacobian of a cell over its own where the mesh was made; notes say how far the values
    can be trusted."""

    theta: Array
    device: Actuator
    values: dict[str, float]
    gradients: dict[str, Array]
    material_gradients: dict[str, dict[str, float]] = dataclasses.field(default_factory=dict)
    quality: float = 1.0
    newton: int = 0
    remeshed: bool = False
    notes: tuple[str, ...] = ()
    squares: dict[str, Squares] = dataclasses.field(default_factory=dict)
