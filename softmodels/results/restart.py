"""What a restart needs of a state, beside its fields."""

from __future__ import annotations

from typing import TYPE_CHECKING, NotRequired, TypedDict

if TYPE_CHECKING:
    from softmodels.path.points import Point


class StoredSignature(TypedDict):
    """A `Signature` as it is stored."""

    negative_eigenvalues: int
    lowest: float
    exact: bool


class Restart(TypedDict):
    """What a `Point` needs to be made again, beside its fields; see there.

    Attributes:
        P, V: The state's pressure and volume, dimensionless.
        tangent: Changes of P and V along the path; left out where none is known.
        iterations: Newton iterations that led to the state.
    """

    P: float
    V: float
    requested: bool
    limit: bool
    jump: bool
    turn: bool
    step: float
    line: str
    factorised: bool
    age: int
    stiffest: float
    worn: bool
    largest: float
    tangent: NotRequired[list[float]]
    iterations: int
    signature: StoredSignature


def restart_of(point: Point) -> Restart:
    """What a point's step stores for a restart."""
    signature = point.signature
    return {
        "P": point.state.P, "V": point.state.V, "requested": point.requested, "limit": point.limit, "jump": point.jump,
        "turn": point.turn, "step": point.step,
        "line": point.line, "factorised": point.factorised, "age": point.age, "stiffest": point.stiffest,
        "worn": point.worn, "largest": point.largest, "tangent": [point.tangent.P, point.tangent.V],
        "iterations": point.state.iterations,
        "signature": {
            "negative_eigenvalues": signature.negative_eigenvalues, "lowest": signature.lowest, "exact": signature.exact,
        },
    }  # fmt: skip
