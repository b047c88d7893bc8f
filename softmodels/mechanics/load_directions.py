"""Directions of loads, as they are written, and those that a device's model can follow."""

from __future__ import annotations

import re

import numpy as np

from geometries import Actuator
from geometries.actuator import Vector
from softmodels.mechanics.parts import PartError

ALONG = 1e-9
"""Cosine up to which a direction lies in a plane."""


def direction(text: str, where: str) -> Vector:
    """Unit vector of a text such as ``"-z"`` or ``"0.6, 0, -0.8"``, in device coordinates.

    Raises:
        PartError: It is none.
    """
    if found := re.fullmatch(r"\s*([+-]?)\s*([xyz])\s*", text):
        sign, axis = (-1.0 if found[1] == "-" else 1.0), "xyz".index(found[2])
        vector = sign * np.eye(3)[axis]
    else:
        try:
            vector = np.array([float(part) for part in text.split(",")])
        except ValueError:
            vector = np.zeros(0)
        length = float(np.linalg.norm(vector)) if len(vector) == 3 else 0.0
        if not (0.0 < length < np.inf):
            raise PartError(f"{where}: {text!r} is no direction; write one like -z, or three numbers like 0.6, 0, -0.8")
        vector = vector / length
    return float(vector[0]), float(vector[1]), float(vector[2])


def check_direction(vector: Vector, actuator: Actuator, where: str) -> None:
    """Refuse a direction that the device's model cannot follow.

    Raises:
        PartError: Across the axis of a section, or out of a cut plane.
    """
    if actuator.dimension == 2 and abs(vector[2]) < 1 - ALONG:
        raise PartError(
            f"{where}: an axisymmetric section takes loads along its axis, z or -z; for others use {actuator.fuller}"
        )
    for plane in actuator.cut_planes if actuator.dimension == 3 else ():
        if abs(float(np.dot(vector, plane.normal))) > ALONG:
            across = ", ".join(f"{x:g}" for x in plane.normal)
            raise PartError(
                f"{where}: its direction leaves the plane square to ({across}) on which the device is cut in two equal sides; "
                f"take one in that plane, or use {actuator.fuller}"
            )
