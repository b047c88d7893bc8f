"""The tip in space of a device that leaves its plane: two side views of the same states, by cameras square to each other.

Each view shows two coordinates as if the tip lay in its own plane; how far it lies before that the other view shows. Three
coordinates are looked for with four numbers, by weighted least squares: what is left is the check. All places count from the
middle of the base: x to the right and z upwards in the first view's pictures, y away from its camera.
"""

from __future__ import annotations

import csv
import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from measurement.series.views import SPACE_COLUMNS, SPACE_TABLE
from softmodels.common import errors, tables, units
from softmodels.common.arrays import Array

FIRST = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""To the right and upwards in the first view's pictures, and towards its camera."""

SIDES = {
    "right": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    "left": np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]]),
    "above": np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
    "below": np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]),
}
"""The same of the second view, by where its camera stands as the first one sees it. From above the first camera's side is at
the lower rim of the pictures, from below at the upper one."""

TIPS = "tips.csv"
NUMBERS = (
    "pressure_Pa", "pressure_error_Pa", "seen_x_m", "seen_x_error_m", "seen_z_m", "seen_z_error_m", "angle_deg",
    "angle_error_deg", "parallax_x", "parallax_z", "parallax_error", "tip_radius_m",
)  # fmt: skip
"""Columns of a view that are read."""


class SpaceError(ValueError):
    """Views that cannot be joined; the message is for the user."""


@dataclasses.dataclass(frozen=True, eq=False)
class TipView:
    """What one view shows of the tip: its file, pressure and its error in Pa, place and error (2,) in m from the base's middle,
    direction and its error in rad, parallax (2,) and its error, half the width in m, whether it is round, whether it is
    trusted, remarks, and when it was taken in s (empty where the list does not say)."""

    file: str
    pressure: tuple[float, float]
    place: Array
    error: Array
    angle: tuple[float, float]
    parallax: Array
    parallax_error: float
    radius: float
    is_round: bool
    trust: str
    remarks: str
    time: str


@dataclasses.dataclass(frozen=True, eq=False)
class Tip:
    """A tip in space: the views of it, its place and error (3,) in m, by how much in m the coordinate that both see differs and
    the standard error of that, and what speaks against it."""

    views: tuple[TipView, TipView]
    place: Array
    error: Array
    apart: tuple[float, float]
    reasons: tuple[str, ...]

    @property
    def trust(self) -> str:
        """``"yes"`` or ``"no"``, or ``"anyway"`` where a view is used in spite of what speaks against it."""
        return "no" if self.reasons else "anyway" if any(view.trust == "anyway" for view in self.views) else "yes"


def read(folder: Path) -> list[TipView]:
    """Read the views that ``softmodels measure view --in-space`` wrote into a folder; without those that were refused. Raises
    `SpaceError`."""
    path = folder / SPACE_TABLE
    again = "make it with softmodels measure view --in-space"
    try:
        if not path.is_file():
            raise SpaceError(f"{folder} has no {SPACE_TABLE}; {again}")
        chosen = tables.pick(
            path, tables.read_sheets(path), lambda sheet: sheet.rows if SPACE_COLUMNS[-1] in sheet.rows[0][1] else None
        )
    except OSError as error:
        raise SpaceError(f"{path} cannot be read: {errors.reason(error)}; {again}") from None
    if chosen is None:
        raise SpaceError(f"{path} is no table of views; {again}")
    seen = []
    for line, row in tables.records(chosen[1]):
        if row.get("trusted") == "refused":
            continue
        try:
            value = {name: units.number(row[name]) for name in NUMBERS}
        except (KeyError, units.UnitError) as error:
            raise SpaceError(f"{path}, line {line}: {error}; {again}") from None
        seen.append(TipView(
            row["file"], (value["pressure_Pa"], value["pressure_error_Pa"]),
            np.array([value["seen_x_m"], value["seen_z_m"]]), np.array([value["seen_x_error_m"], value["seen_z_error_m"]]),
            (math.radians(value["angle_deg"]), math.radians(value["angle_error_deg"])),
            np.array([value["parallax_x"], value["parallax_z"]]), value["parallax_error"], value["tip_radius_m"],
            row["tip_shape"] == "round", row["trusted"], row["remarks"], row["time_s"],
        ))  # fmt: skip
    if not seen:
        raise SpaceError(f"{path} has no measured view")
    return seen


def pairs(first: Sequence[TipView], second: Sequence[TipView]) -> list[tuple[TipView, TipView]]:
    """Return the views of the same state: of the same pressure, in the order of both tables. Raises `SpaceError` for none."""
    made, left = [], list(second)
    for view in first:
        same = [
            other for other in left
            if abs(other.pressure[0] - view.pressure[0]) <= 2.0 * math.hypot(view.pressure[1], other.pressure[1])
        ]  # fmt: skip
        if same:
            # The nearest pressure; of several with the same one the first.
            made.append((view, min(same, key=lambda other: abs(other.pressure[0] - view.pressure[0]))))
            left.remove(made[-1][1])
    if not made:
        raise SpaceError("no two views have the same pressure; list both cameras' photographs with the pressure of each")
    return made


MAX_APART = 4.0
"""Standard errors by which both views may differ."""

SHARED_PART = 0.5
"""Correlation of the errors with which both views see the same coordinate."""

LEAST_SINE = 0.15
"""Sine of the angle between a tip's direction and a camera's line of sight below which its direction is not known."""


def joined(views: tuple[TipView, TipView], side: str) -> Tip:
    """Return the tip in space of two views, the second one from a side of `SIDES`."""
    axes = (FIRST, SIDES[side])
    # A place that lies t before the plane is seen beside its own by the parallax times t.
    seen_by = np.array([
        axis[k] + view.parallax[k] * axis[2] for view, axis in zip(views, axes, strict=True) for k in (0, 1)
    ])  # fmt: skip
    place = np.zeros(3)
    way, known = _direction(views, seen_by)
    for _ in range(3):  # the weights depend on the place
        seen, own_errors = [], []
        for number, (view, axis) in enumerate(zip(views, axes, strict=True)):
            shown = seen_by[2 * number : 2 * number + 2] @ way
            sine = abs(float(axis[2] @ way))
            length = float(np.linalg.norm(shown))
            # The silhouette of a round end goes on beyond its own tip, where that looks out of the plane.
            beyond = view.radius * (1.0 - length) * shown / max(length, 1e-9)
            own = view.radius * sine * (views[1 - number].angle[1] if view.is_round else 0.5)
            seen.append(view.place - (beyond if view.is_round else 0.0))
            own_errors.append(np.hypot(view.error, np.hypot(own, view.parallax_error * abs(float(axis[2] @ place)))))
        error = np.concatenate(own_errors)
        weighted = np.linalg.pinv(seen_by / error[:, None]) / error
        place = weighted @ np.concatenate(seen)
    # An edge that is taken too far out is so in both views.
    alike = seen_by @ seen_by.T / np.outer(*[np.linalg.norm(seen_by, axis=1)] * 2)
    covariance = (SHARED_PART * alike + (1.0 - SHARED_PART) * np.eye(4)) * np.outer(error, error)
    # One combination of the four numbers is left over.
    rest = np.linalg.svd(seen_by)[0][:, 3]
    rest = rest / np.abs(rest).max()
    apart = float(rest @ np.concatenate(seen)), float(np.linalg.norm(rest * error))
    reasons = [f"{view.file}: {view.remarks}" for view in views if view.trust not in ("yes", "anyway")]
    if abs(apart[0]) > MAX_APART * apart[1]:
        reasons.append(
            f"both views see the same coordinate {abs(apart[0]) * 1e3:.2f} mm apart, at an error of {apart[1] * 1e3:.2f} mm: "
            "compare both bases, scales and pressures, and --from; the cameras have to look square to each other"
        )
    if not known:
        reasons.append(
            "its tip looks along a camera's line of sight, which leaves its direction open; photograph it from other sides"
        )
    return Tip(views, place, np.sqrt(np.diag(weighted @ covariance @ weighted.T)), apart, tuple(reasons))


def _direction(views: tuple[TipView, TipView], seen_by: Array) -> tuple[Array, bool]:
    """Return the unit vector (3,) in which the tip looks, and whether it is known."""
    across = [
        math.sin(view.angle[0]) * seen_by[2 * k] - math.cos(view.angle[0]) * seen_by[2 * k + 1] for k, view in enumerate(views)
    ]
    way = np.cross(*across)
    size = float(np.linalg.norm(way))
    way = way / max(size, 1e-9)
    shown = [
        float(seen_by[2 * k : 2 * k + 2] @ way @ [math.cos(view.angle[0]), math.sin(view.angle[0])])
        for k, view in enumerate(views)
    ]
    return way * math.copysign(1.0, sum(shown)), size > LEAST_SINE and min(map(abs, shown)) > LEAST_SINE


def write(path: Path, tips: Sequence[Tip]) -> None:
    """Write a table of tips."""
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow((
            "file", "second_file", "pressure_Pa", "pressure_error_Pa",
            *(f"tip_{axis}_{name}" for axis in "xyz" for name in ("m", "error_m")), "apart_m", "apart_error_m", "trusted",
            "remarks", "time_s",
        ))  # fmt: skip
        for tip in tips:
            first, second = tip.views
            numbers = (*np.column_stack([tip.place, tip.error]).ravel(), *tip.apart)
            rows.writerow((
                first.file, second.file, *map(repr, first.pressure), *(f"{value:.7g}" for value in numbers), tip.trust,
                "; ".join(tip.reasons), first.time,
            ))  # fmt: skip
