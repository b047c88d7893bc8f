"""The outline of a shadow in metres, each point with its standard error, and its file."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from pathlib import Path

import numpy as np
import numpy.typing as npt

from softmodels.common import errors, files, units
from softmodels.common.arrays import Array


@dataclasses.dataclass(frozen=True, eq=False)
class Outline:
    """The outline of the shadow at one pressure.

    Attributes:
        x: Places along the undeformed surface in m, shape (n,): rising, or of a ``whole`` outline in order along it.
        z: Heights above it in m, shape (n,).
        error: Standard error of each point across the outline in m, shape (n,): edge, grid fit, lens and zero line
            together. Neighbouring points share part of it.
        pressure: Pressure in Pa.
        pressure_error: Its standard error in Pa.
        source: Where it comes from, such as the photograph's file name.
        trusted: Whether nothing speaks against it.
        reasons: What speaks against it, one sentence each; empty if trusted.
        sunk: How far the surface beside the bulge lies below the zero plane in m, negative above it; 0 where that cannot be
            told from none.
        scale: Width of the body's sides over that at zero pressure; NaN where they are not seen.
        bridged: Which points were not measured but bridge a gap, their errors how far the true outline may lie off, (n,).
        scale_error: Standard error of all lengths of the run together, as a share of them: the pitch's, the magnification's.
        level_error: Standard error in m by which all heights of the run may be off together: a lamp or a body that is not
            level, as far as the photographs do not show it.
        history: Pressures up to the photograph; empty if the times are not known.
        anyway: Whether it shall be used in spite of what speaks against it.
        edge_error: Standard error in m across the outline that all its points share, and no other outline of the run: where
            in the penumbra half of the light is. A part of ``error``.
        whole: Of an outline that runs all around a body of revolution from one end of its base to the other and may overhang, x
            counted from the axis: what z counts from, the undeformed ``"top"`` or the ``"base"``; else empty.

    Raises:
        OutlineError: Arrays that do not fit, values that are not finite, errors that are not positive, points that are not in
            order, or times that run backwards.
    """

    x: Array
    z: Array
    error: Array
    pressure: float
    pressure_error: float
    source: str
    trusted: bool = True
    reasons: tuple[str, ...] = ()
    sunk: float = 0.0
    scale: float = math.nan
    bridged: npt.NDArray[np.bool_] = dataclasses.field(default_factory=lambda: np.zeros(0, dtype=bool))
    scale_error: float = 0.0
    level_error: float = 0.0
    history: History = ()
    anyway: bool = False
    edge_error: float = 0.0
    whole: str = ""

    def __post_init__(self) -> None:
        for name in ("x", "z", "error"):
            values = np.array(getattr(self, name), dtype=np.float64)  # a copy, so that nobody changes it from outside
            values.flags.writeable = False
            object.__setattr__(self, name, values)
        bridged = np.array(self.bridged if len(self.bridged) else np.zeros(len(self.x)), dtype=bool)
        bridged.flags.writeable = False
        object.__setattr__(self, "bridged", bridged)
        if self.x.ndim != 1 or len(self.x) == 0 or self.x.shape != self.z.shape or self.x.shape != self.error.shape:
            raise OutlineError(f"{self.source}: an outline needs as many x as z and errors, and at least one")
        shared = (self.scale_error, self.level_error, self.edge_error)
        for wrong, why in (
            (self.bridged.shape != self.x.shape, "an outline needs to know of each point whether it was measured"),
            (not np.isfinite([self.x, self.z, self.error]).all(), "a point of the outline is not finite"),
            (not (self.error > 0.0).all(), "a standard error is not positive"),
            (self.whole not in ("", "top", "base"), "whole_from must be top or base"),
            (not self.whole and (np.diff(self.x) < 0.0).any(), "the points are not sorted along x"),
            (bool(self.whole) and self._turns_back, "the points are not in order along the outline, from left to right"),
            (
                not math.isfinite(self.pressure) or not 0.0 <= self.pressure_error < math.inf,
                "the pressure or its standard error is not finite, or the error is negative",
            ),
            (
                not all(0.0 <= value < math.inf for value in shared),
                "an error of the scale, the level or the edge is not finite, or negative",
            ),
            (
                not np.isfinite(self.history).all() or any(b[0] < a[0] for a, b in itertools.pairwise(self.history)),
                "the times of its pressures run backwards, or a number is not finite",
            ),
            (self.trusted == bool(self.reasons), "an outline must have reasons if and only if it is untrusted"),
        ):
            if wrong:
                raise OutlineError(f"{self.source}: {why}")

    @property
    def _turns_back(self) -> bool:
        step = np.diff(np.column_stack([self.x, self.z]), axis=0)
        back = np.einsum("ni,ni->n", step[1:], step[:-1]) < 0.0
        return bool(self.x[0] > self.x[-1] or np.mean(back) > MAX_TURNING_BACK) if len(back) else True

    @property
    def trust(self) -> str:
        """``"yes"``, ``"no"``, or ``"anyway"`` where it shall be used in spite of what speaks against it."""
        return "yes" if self.trusted else "anyway" if self.anyway else "no"

    @property
    def apex(self) -> int:
        """Index of the highest point."""
        return int(np.argmax(self.z))

    @functools.cached_property
    def _top(self) -> slice:
        """The points next to the highest one that lie in the top 2 % of the height, or within their errors of it. Errors
        beyond `MIN_SHARED_ERROR` move all points alike (a moved camera, a sunk actuator), and tell of no neighbours."""
        low = self.z < self.z[self.apex] - max(
            6.0 * min(self.error[self.apex], MIN_SHARED_ERROR), 0.02 * abs(self.z[self.apex])
        )
        left, right = np.nonzero(low[: self.apex])[0], np.nonzero(low[self.apex :])[0]
        return slice(left[-1] + 1 if len(left) else 0, self.apex + right[0] if len(right) else len(self.x))

    @functools.cached_property
    def height(self) -> float:
        """Height of the top in m: that of the parabola through the points around it.

        The highest of many points is the one whose own error pointed up; its neighbours take that out.
        """
        x, z, weight = self.x[self._top] - self.x[self.apex], self.z[self._top], 1.0 / self.error[self._top]
        if len(np.unique(x)) < 3:
            return float(np.average(z, weights=weight**2))
        curve = np.polynomial.Polynomial.fit(x, z, 2, w=weight)
        summit = curve.deriv().roots()
        if curve.convert().coef[-1] < 0.0 and x[0] <= summit[0] <= x[-1]:
            return float(curve(summit[0]))
        return float(np.average(z, weights=weight**2))  # flat, or so nearly that its bend is noise

    @property
    def height_error(self) -> float:
        """Standard error of `height` in m; most of it is common to the points around the top."""
        usual = float(np.median(self.error[self._top]))
        return max(usual, float(self.error[self.apex])) if self.bridged[self._top].any() else usual

    def measured(self) -> Outline:
        """Return the outline without the points that were not measured; itself if there are none."""
        if not self.bridged.any():
            return self
        kept = ~self.bridged
        parts = {name: getattr(self, name)[kept] for name in ("x", "z", "error", "bridged")}
        return dataclasses.replace(self, **parts)

    def to_csv(self, path: Path) -> None:
        """Write the outline: comment lines with ``#``, a header, a row per point."""
        notes = [
            f"pressure_Pa = {self.pressure!r}",
            f"pressure_error_Pa = {self.pressure_error!r}",
            f"source = {' '.join(self.source.split())}",
            f"sunk_m = {self.sunk:.4g}",
            *([f"scale = {self.scale:.7g}"] if math.isfinite(self.scale) else []),
            f"scale_error = {self.scale_error:.4g}",
            f"level_error_m = {self.level_error:.4g}",
            f"edge_error_m = {self.edge_error:.4g}",
            *([f"whole_from = {self.whole}"] if self.whole else []),
            *([f"history_s_Pa = {history_text(self.history)}"] if self.history else []),
            f"trusted = {self.trust}",
            *(f"reason = {' '.join(reason.split())}" for reason in self.reasons),
        ]
        rows = [
            f"{x:.9g},{z:.9g},{error:.4g},{bridged:d}"
            for x, z, error, bridged in zip(self.x, self.z, self.error, self.bridged, strict=True)
        ]
        text = "\n".join([*(f"# {note}" for note in notes), COLUMNS, *rows]) + "\n"
        Path(path).write_text(text, encoding="utf-8")

    @classmethod
    def from_csv(cls, path: Path) -> Outline:
        """Read what `to_csv` wrote.

        Raises:
            OutlineError: No such file, a missing comment line, or a row that is not three numbers and perhaps a 0 or 1.
        """
        path = Path(path)
        try:
            lines = files.read_text(path).splitlines()
        except (OSError, UnicodeDecodeError) as error:
            raise OutlineError(f"{path} cannot be read: {errors.reason(error)}") from None
        notes: dict[str, str] = {}
        reasons: list[str] = []
        rows: list[list[float]] = []
        for place, line in enumerate(lines, 1):
            if line.startswith("#"):
                name, _, value = line[1:].partition("=")
                if name.strip() == "reason":
                    reasons.append(value.strip())
                notes[name.strip()] = value.strip()
            elif line.strip() and line.strip().replace(";", ",") not in (COLUMNS, MEASURED_ONLY):
                rows.append(_row(path, place, line))
        try:
            pressure, pressure_error = units.number(notes["pressure_Pa"]), units.number(notes["pressure_error_Pa"])
            sunk = units.number(notes.get("sunk_m", "0"))
            scale = units.number(notes["scale"]) if "scale" in notes else math.nan
            shared = ("scale_error", "level_error_m", "edge_error_m")
            scale_error, level_error, edge_error = (units.number(notes.get(name, "0")) for name in shared)
            history = read_history(str(path), notes.get("history_s_Pa", ""))
        except KeyError as error:
            raise OutlineError(f"{path} has no comment line '# {error.args[0]} = …'") from None
        except units.UnitError as error:
            raise OutlineError(f"{path}: pressure_Pa, pressure_error_Pa, sunk_m, scale, history or an error: {error}") from None
        points = np.array(rows, dtype=np.float64).reshape(-1, 4)
        trust = notes.get("trusted", "no")
        trusted = trust == "yes"
        if not trusted and not reasons:
            reasons = ["its file does not mark it as trusted"]
        return cls(
            points[:, 0],
            points[:, 1],
            points[:, 2],
            pressure,
            pressure_error,
            notes.get("source", path.name),
            trusted,
            tuple(reasons),
            sunk,
            scale,
            points[:, 3] > 0.0,
            scale_error,
            level_error,
            history,
            trust == "anyway",
            edge_error,
            notes.get("whole_from", ""),
        )


COLUMNS = "x_m,z_m,error_m,bridged"
MEASURED_ONLY = "x_m,z_m,error_m"
"""Header of files in which every point was measured."""

type History = tuple[tuple[float, float], ...]
"""Pressures through time: pairs of a time in s and a pressure in Pa, linear in between, from rest on."""

MAX_TURNING_BACK = 0.2
"""Share of the steps from point to point that may turn back by more than a right angle."""

MIN_SHARED_ERROR = 10e-6
"""Standard error in m above which it is no longer each point's own."""


def reached(history: History) -> int:
    """Return the index in a history of the moment at which its last pressure was reached."""
    last = len(history) - 1
    while last > 0 and history[last - 1][1] == history[-1][1]:
        last -= 1
    return last


def hold_of(history: History) -> float:
    """Return how long in s the last pressure of a history was held; nan for none."""
    return history[-1][0] - history[reached(history)][0] if history else math.nan


class OutlineError(ValueError):
    """Invalid points or file of an outline; the message is for the user."""


def history_text(history: History) -> str:
    """Return times in s and pressures in Pa as a text."""
    return "; ".join(f"{time!r} {pressure!r}" for time, pressure in history)


def read_history(place: str, text: str) -> History:
    """Return times in s and pressures in Pa from a text at a place; `OutlineError` for none, `UnitError` for no number."""
    pairs = [tuple(map(units.number, pair.split())) for pair in text.split(";") if pair]
    if any(len(pair) != 2 for pair in pairs):
        raise OutlineError(f"{place}: history_s_Pa is not pairs of time and pressure, such as 0 0; 2 1500; 12 1500")
    return tuple((time, pressure) for time, pressure in pairs)


def _row(path: Path, place: int, line: str) -> list[float]:
    words = line.split(";" if ";" in line else ",")
    try:
        values, why = [units.number(word) for word in words], ""
    except units.UnitError as error:
        values, why = [], f": {error}"
    if len(values) == 3:
        values.append(0.0)
    if len(values) != 4 or values[3] not in (0.0, 1.0):
        raise OutlineError(
            f"{path}, line {place}: {units.brief(line.strip())} is not three numbers and 0 or 1 ({COLUMNS}){why}"
        )
    return values
