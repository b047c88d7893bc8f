"""Side views as a photograph of a simulated finger would show them, by nodes of its end and none of the fit's code."""

from __future__ import annotations

import csv
import dataclasses
import math

import numpy as np

import softmodels as sm
from measurement.series.markers import COLUMNS
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


FAR, FOOT = 0.6, np.array([0.03, -0.02])
"""Distance of the camera from the plane of motion, and its place above it from the middle of the base, in m."""


def front_nodes(state, count):
    """Numbers of nodes along a half finger's face towards the camera, and the depth of that face in m."""
    x, y, _ = np.abs(state.points.T)
    front = np.flatnonzero(y > y.max() - 1e-9)
    wanted = np.linspace(0.3, 0.95, count) * x.max()
    return list(dict.fromkeys(int(front[np.argmin(np.abs(x[front] - at))]) for at in wanted)), float(y.max())


def marker_rows(device, states, views, camera, count, seed=0, error=1e-5):
    """Rows of a ``markers.csv`` of points on the front face in perspective, beside the rows of the views of their states."""
    rng, rows = np.random.default_rng(seed), []
    nodes, depth = front_nodes(states[0], count)
    held = states[0].points[np.abs(states[0].points[:, 0]) < 1e-9, 2]
    c, s = math.cos(camera.tilt), math.sin(camera.tilt)
    for view, state in zip(views, states, strict=True):
        for number, node in enumerate(nodes):
            x, y, z = state.points[node] + state.displacement[node]
            there = np.array([[c, -s], [s, c]]) @ [camera.side * x, z - (held.max() + held.min()) / 2]
            seen = FOOT + (there - FOOT) * (FAR - depth) / (FAR - abs(y))
            seen = (1 + camera.scale) * seen + camera.base
            slope = (seen - FOOT) / (FAR - depth)
            seen = seen + error * rng.standard_normal(2)
            numbers = seen[0], error, seen[1], error, error, *slope
            rows.append((*view[:3], number + 1, *map(repr, map(float, numbers)), "", "", "yes", "", ""))
    return rows


def write_markers(file, rows):
    """Write rows as a table of markers."""
    with file.open("w", newline="", encoding="utf-8") as lines:
        csv.writer(lines).writerows([COLUMNS, *rows])


def rows_of(device, material, pressures, camera=Camera(), seed=0, **how):
    """Rows of a ``views.csv`` of a finger at pressures (Pa) that are the true ones, from 0 on, with noise."""
    return views_of(device, material, pressures, camera, seed, **how)[0]


def views_of(device, material, pressures, camera, seed=0, **how):
    """The same, and the states."""
    run, rng = sm.inflate(device, material, f"{', '.join(map(str, pressures))} Pa", **how), np.random.default_rng(seed)
    rows, states = [], []
    for number, pressure in enumerate(pressures):
        states.append(run.at(f"{pressure} Pa"))
        place, angle = tip_of(device, states[-1])
        c, s = math.cos(camera.tilt), math.sin(camera.tilt)
        seen = (1 + camera.scale) * np.array([[c, -s], [s, c]]) @ (place * [camera.side, 1.0]) + camera.base
        looks = camera.tilt + (angle if camera.side > 0 else math.pi - angle)
        seen, looks = seen + camera.place_error * rng.standard_normal(2), looks + camera.angle_error * rng.standard_normal()
        reading = 0.0 if pressure == 0 else pressure + camera.offset + camera.pressure_error * rng.standard_normal()
        errors = camera.place_error, math.degrees(camera.angle_error)
        numbers = reading, camera.pressure_error, seen[0], errors[0], seen[1], errors[0], math.degrees(looks), errors[1]
        rows.append((f"{number}.jpg", *map(repr, map(float, numbers)), "", "", "", "", "yes", ""))
    return rows, states


def write_views(file, rows):
    """Write rows as a table of side views."""
    with file.open("w", newline="", encoding="utf-8") as lines:
        csv.writer(lines).writerows([VIEW_COLUMNS, *rows])
