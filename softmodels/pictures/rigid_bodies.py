"""Rigid shapes that stop a device, in its pictures: their surfaces in the rendered ones, their outlines in sections."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from softmodels.mechanics.rigid_shapes import RigidShape
from softmodels.mechanics.stl_shapes import surface_of
from softmodels.pictures.offscreen import Layer, Style, surface
from softmodels.pictures.style import WARNING
from softmodels.results.stored import States
from softmodels.results.triangles import Array, Cells

if TYPE_CHECKING:
    from matplotlib.axes import Axes

AROUND, ALONG = 48, 16
"""Facets around a shape, and from an end to its middle."""


def profile(shape: RigidShape, reach: float) -> Array:
    """Half the outline of a shape by its axis: distance along it and radius in m, shape (n, 2).

    Args:
        shape: The shape.
        reach: Half the length in m of which a cylinder without ends is drawn, and the radius of a plane's disk.
    """
    if shape.shape == "plane":
        return np.array([[0.0, 0.0], [0.0, reach]])
    if shape.shape == "cylinder":
        return np.array([[-reach, shape.radius], [reach, shape.radius]])
    angle = np.linspace(0.0, np.pi / 2, ALONG)
    end = shape.radius * np.column_stack([np.sin(angle), np.cos(angle)])
    shift = np.array([shape.length / 2, 0.0])
    return np.concatenate([end[::-1] * (-1, 1) - shift, end + shift])


def shape_surface(shape: RigidShape, reach: float) -> tuple[Array, Cells]:
    """Points in m, shape (n, 3), and triangles of a shape."""
    if shape.file:
        return surface_of(shape)
    axis = shape.direction
    first = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    first /= np.linalg.norm(first)
    angle = np.linspace(0.0, 2 * np.pi, AROUND + 1)[:-1]
    spokes = np.outer(np.cos(angle), first) + np.outer(np.sin(angle), np.cross(axis, first))
    line = profile(shape, reach)
    points = np.asarray(shape.at) + line[:, 0, None, None] * axis + line[:, 1, None, None] * spokes
    here = np.arange(AROUND) + AROUND * np.arange(len(line) - 1)[:, None]
    side = np.roll(np.arange(AROUND), -1) + AROUND * np.arange(len(line) - 1)[:, None]
    quads = np.stack([here, side, side + AROUND, here + AROUND], axis=-1).reshape(-1, 4)
    return points.reshape(-1, 3), np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def shapes_of(states: States) -> list[RigidShape]:
    return [part for part in states.case.parts if isinstance(part, RigidShape)]


def way(states: States, shape: RigidShape, step: float) -> Array:
    """How far a shape has given way at a step or between two, in m, shape (3,)."""
    if not shape.guide:
        return np.zeros(3)
    ways = [row[f"{shape.label}_way_mm"] for row in states.rows]
    return 1e-3 * float(np.interp(step, np.arange(len(ways)), ways)) * shape.gives_way


def shape_layers(states: States, step: float) -> list[Layer]:
    """Translucent surfaces of the shapes beside a device at a step; a cylinder and a plane overtop it a little."""
    style: Style = {"color": WARNING, "opacity": 0.25, "smooth_shading": True}
    skin, shapes, found = states.skin, shapes_of(states), list[Layer]()
    if not shapes:
        return found
    device = skin.device(skin.points(states.moved(states.main)))
    for shape in shapes:
        drawn, reach = shape, 1.1 * float(np.abs((device - np.asarray(shape.at)) @ shape.direction).max())
        if shape.shape == "plane":
            drawn, reach = below(shape, device)
        points, triangles = shape_surface(drawn, reach)
        found.append((surface(points + way(states, shape, step), triangles), style))
    return found


def below(plane: RigidShape, device: Array) -> tuple[RigidShape, float]:
    """A plane with its point next to the middle of a device, points of shape (n, 3), and the radius of what is drawn of it."""
    middle, normal = (device.min(axis=0) + device.max(axis=0)) / 2, plane.direction
    foot = middle - ((middle - np.asarray(plane.at)) @ normal) * normal
    beside = device - foot
    beside = beside - np.outer(beside @ normal, normal)
    return dataclasses.replace(plane, at=tuple(map(float, foot))), 1.1 * float(np.linalg.norm(beside, axis=1).max())


def draw_outlines(axes: Axes, states: States, step: int) -> None:
    """Draw the outlines of shapes at a step into an axisymmetric section in millimetres, whose limits stay."""
    limits = axes.get_xlim(), axes.get_ylim()
    for shape in shapes_of(states):
        line = profile(shape, 10.0)
        side = np.sign(shape.direction[2]) if shape.shape != "sphere" else 1.0
        middle = shape.at[2] + way(states, shape, step)[2]
        axes.plot(1e3 * line[:, 1], 1e3 * (middle + side * line[:, 0]), color=WARNING, linewidth=1.5, linestyle="--")
    axes.set(xlim=limits[0], ylim=limits[1])
