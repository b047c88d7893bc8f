"""How far a finger is bent, from where its tip is: what all devices that bend have in common."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

Vector = tuple[float, float, float]


class Bending:
    """Figures of a device that lies along x from its clamp at x = 0 and bends down, with probes ``tip`` and ``tip_above``."""

    figure_texts: ClassVar[Mapping[str, tuple[str, str]]] = {
        "bend_angle_deg": ("bend angle", "by which the face of the tip has turned, towards the base positive"),
        "tip_x_mm": ("tip place x", "x of the middle of the tip's lower edge, deformed, from the clamp"),
        "tip_z_mm": ("tip place z", "z of the middle of the tip's lower edge, deformed, from the middle of the base"),
    }

    def device_figures(self, places: Mapping[str, Vector]) -> dict[str, float]:
        """How the device is bent; see `Actuator.device_figures`."""
        low, high = (np.asarray(places[name]) for name in ("tip", "tip_above"))
        x, _, z = (1e3 * float(value) for value in low)
        return {"bend_angle_deg": bend_angle(low, high), "tip_x_mm": x, "tip_z_mm": z}


def bend_angle(low: NDArray[np.float64], high: NDArray[np.float64]) -> float:
    """Angle in degrees by which the tip's face has turned towards -z, right up to a whole turn and more.

    The face tells it but for whole turns. The line from the clamp to the tip tells those: in a circle it has turned half
    as far.

    Args:
        low: Lower end of the face, deformed, in m from the clamp, shape (3,).
        high: Its upper end, which lay above the lower one.
    """
    face = high - low
    turned = math.degrees(math.atan2(face[0], face[2]))
    line = -math.degrees(math.atan2(low[2], low[0]))
    return turned + 360.0 * round((2.0 * line - turned) / 360.0)
