"""What of a body of revolution's outer curve is seen from the side: a trough behind a higher rim is not.

The shadow reaches, at each height, as far as the body does: its edge is the curve's upper envelope from outside in. Where the
curve dips behind something higher and farther out, the edge runs level from that rim to where the curve comes up again.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from softmodels.results.quadratic_curve import QuadraticCurve, shapes

Array = npt.NDArray[np.float64]

SAMPLES = 17  # places per piece at which heights are compared
DEEPEST = 1e-7
"""Dips in m that are left alone."""


@dataclasses.dataclass(frozen=True, eq=False)
class Shadow:
    """The visible edge as pieces of a curve.

    Attributes:
        curve: The edge, as a curve of its own.
        source: Piece of the whole curve that each of its pieces is a part of, or hangs on, shape (m,).
        weights: Shape functions of that piece at the new piece's three nodes, shape (m, 3, 3).
    """

    curve: QuadraticCurve
    source: npt.NDArray[np.int64]
    weights: Array

    def rate(self, rate: Array) -> Array:
        """Derivative of the edge's nodes from that of the whole curve's, shape (n, 3, 2) to (m, 3, 2).

        Where pieces were cut they slide along the curve, and level parts along themselves: neither moves the edge.
        """
        return np.einsum("mab,mbi->mai", self.weights, rate[self.source])


def shadow_of(curve: QuadraticCurve) -> Shadow:
    """The visible edge of a curve that runs from the axis outwards and down."""
    s, count = np.linspace(-1.0, 1.0, SAMPLES), len(curve.nodes)
    places, above = edge_heights(curve)
    hidden = above - places[:, 1] > DEEPEST
    if not hidden.any():
        return _assembled(curve, [_Part(k, -1.0, 1.0) for k in range(count)])
    parts: list[_Part] = []
    for k, seen in enumerate(~hidden.reshape(count, SAMPLES)):
        edges = np.flatnonzero(np.diff(np.r_[False, seen, False].astype(int)))
        for first, end in edges.reshape(-1, 2).tolist():
            place, begin = k * SAMPLES + first, float(s[first])
            if place and hidden[place - 1]:  # going outwards, a trough ends here at its rim
                before = np.flatnonzero(~hidden[:place])
                begin = _summit(curve, k, begin)
                parts.append(_Part(k, begin, begin, float(places[before[-1], 0]) if len(before) else 0.0))
            if s[end - 1] > begin:
                parts.append(_Part(k, begin, float(s[end - 1])))
    return _assembled(curve, parts)


@dataclasses.dataclass(frozen=True)
class _Part:
    """The stretch of a piece between two parameters; or, from the place x in m, the level edge up to one of it, the rim."""

    piece: int
    begin: float
    end: float
    level_from: float | None = None


def edge_heights(curve: QuadraticCurve) -> tuple[Array, Array]:
    """Places of a curve, shape (n, 2), `SAMPLES` of each piece, and the height of the visible edge there, shape (n,)."""
    s, count = np.linspace(-1.0, 1.0, SAMPLES), len(curve.nodes)
    places = curve.at(np.repeat(np.arange(count), SAMPLES), np.tile(s, count))[0]
    return places, np.maximum.accumulate(places[::-1, 1])[::-1]  # the highest from here outwards


def crest(curve: QuadraticCurve) -> tuple[int, float]:
    """The highest place of a curve: its piece and the parameter there."""
    piece, place = divmod(int(np.argmax(edge_heights(curve)[0][:, 1])), SAMPLES)
    return piece, _summit(curve, piece, float(np.linspace(-1.0, 1.0, SAMPLES)[place]))


def _summit(curve: QuadraticCurve, piece: int, s: float) -> float:
    """The highest place of a piece near a parameter."""
    slope, bend = (vectors[1] for vectors in curve.at(piece, s)[1:])
    return float(np.clip(s - slope / bend, -1.0, 1.0)) if bend < 0.0 else s


def _assembled(curve: QuadraticCurve, parts: list[_Part]) -> Shadow:
    """The edge of its parts in order, from the axis outwards."""
    source = np.array([part.piece for part in parts])
    weights = shapes(np.array([[part.begin, part.end, (part.begin + part.end) / 2] for part in parts]))
    nodes = np.einsum("mab,mbi->mai", weights, curve.nodes[source])
    for row, part in enumerate(parts):
        if part.level_from is not None:
            x = nodes[row, 0, 0]
            nodes[row, :, 0] = part.level_from, x, (part.level_from + x) / 2
    return Shadow(QuadraticCurve(nodes), source, weights)
