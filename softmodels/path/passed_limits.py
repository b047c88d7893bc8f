"""Limit points that a path has passed: they decide where it ends, and where a device would have jumped."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from softmodels.path.points import PathEnd, Point
from softmodels.path.quantities import Quantity


@dataclasses.dataclass
class PassedLimits:
    """What a path has passed so far.

    Attributes:
        limit: The first limit point of the pressure.
        turn: The last limit point of the requested quantity itself.
        jumping: Whether the path is between that one and where the device lands.
    """

    limit: Point | None = None
    turn: Point | None = None
    jumping: bool = False

    @classmethod
    def among(cls, points: Sequence[Point], requested: Quantity) -> PassedLimits:
        """Those among the points, in order, from which a path goes on."""
        limit = next((point for point in points if point.limit), None)
        turn = next((point for point in reversed(points) if point.turn), None)
        jumping = turn is not None and _value(requested, turn) > _value(requested, points[-1])
        return cls(limit, turn, jumping)

    def ended(self, end: PathEnd, requested: Quantity) -> PathEnd:
        """The end of a path, with the limit point that the requested quantity has met."""
        limit = requested.limit_met(self.limit, self.turn)
        return PathEnd(str(end), limit, end.cause if limit is None else None)


def _value(requested: Quantity, point: Point) -> float:
    return requested.value(point.state.V, point.state.P)
