"""What a restart needs of a state, beside its fields."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from softmodels.path.points import Point


def restart_of(point: Point) -> dict[str, Any]:
    """What a `Point` needs to be made again, beside its fields."""
    return {
        "P": point.state.P, "V": point.state.V, "requested": point.requested, "limit": point.limit, "jump": point.jump,
        "turn": point.turn, "step": point.step,
        "line": point.line, "factorised": point.factorised, "age": point.age, "stiffest": point.stiffest,
        "worn": point.worn, "largest": point.largest, "tangent": [point.tangent.P, point.tangent.V],
        "iterations": point.state.iterations, "signature": dataclasses.asdict(point.signature),
    }  # fmt: skip
