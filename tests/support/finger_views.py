"""Side views as a photograph of a simulated finger would show them, by nodes of its end and none of the fit's code."""

from __future__ import annotations

import csv
import dataclasses
import math

import numpy as np

import softmodels as sm
from measurement.series.views import VIEW_COLUMNS


@dataclasses.dataclass(frozen=True)
class Camera:
    """How a finger is seen: from the other side or not (-1, 1), turned (rad), its base out of place (m), lengths too large by a
    share, readings too high (Pa), and standard errors of a place (m), an angle (rad) and a reading (Pa)."""

    side: float = 1.0
    tilt: float = 0.0
    base: tuple[float, float] = (0.0, 0.0)
    scale: float = 0.0
    offset: float = 0.0
    place_error: float = 5e-5
    angle_error: float = 2e-3
    pressure_error: float = 10.0


def tip_of(device, state):
    """The tip's place (2,) in m from the middle of the base, and the direction in rad in which its end looks: a straight line
    through the middle of the end's silhouette, as in a photograph."""
    X, x = state.points, state.points + state.displacement
    end = np.abs(X[:, 0] - device.length) < 1e-9
    at, seen = X[end, 2], x[end][:, [0, 2]]
    middle, half = (at.max() + at.min()) / 2, (at.max() - at.min()) / 2
    near = np.abs(at - middle) < 0.65 * half
    lines = np.polyfit(at[near] - middle, seen[near], 1)
    held = X[np.abs(X[:, 0]) < 1e-9, 2]
    along = lines[0] / np.linalg.norm(lines[0])
    return lines[1] - [0.0, (held.max() + held.min()) / 2], math.atan2(-along[0], along[1])


def rows_of(device, material, pressures, camera=Camera(), seed=0, **how):
    """Rows of a ``views.csv`` of a finger at pressures (Pa) that are the true ones, from 0 on, with noise."""
    run, rng = sm.inflate(device, material, f"{', '.join(map(str, pressures))} Pa", **how), np.random.default_rng(seed)
    rows = []
    for number, pressure in enumerate(pressures):
        place, angle = tip_of(device, run.at(f"{pressure} Pa"))
        c, s = math.cos(camera.tilt), math.sin(camera.tilt)
        seen = (1 + camera.scale) * np.array([[c, -s], [s, c]]) @ (place * [camera.side, 1.0]) + camera.base
        looks = camera.tilt + (angle if camera.side > 0 else math.pi - angle)
        seen, looks = seen + camera.place_error * rng.standard_normal(2), looks + camera.angle_error * rng.standard_normal()
        reading = 0.0 if pressure == 0 else pressure + camera.offset + camera.pressure_error * rng.standard_normal()
        errors = camera.place_error, math.degrees(camera.angle_error)
        numbers = reading, camera.pressure_error, seen[0], errors[0], seen[1], errors[0], math.degrees(looks), errors[1]
        rows.append((f"{number}.jpg", *map(repr, map(float, numbers)), "", "", "", "", "yes", ""))
    return rows


def write_views(file, rows):
    """Write rows as a table of side views."""
    with file.open("w", newline="", encoding="utf-8") as lines:
        csv.writer(lines).writerows([VIEW_COLUMNS, *rows])
