"""Is the screen, near the outline, where the setup has it?

`movement.py` asks whether the picture of the whole screen has moved. A screen that bulges, or hot air before it, moves only a
part of it, and the shadow's edge with it. So each printed line is looked at piece by piece, in the light and inside of the
shadow, and what a piece lies off beyond the whole screen's movement counts for the outline near it.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from measurement.robust import deviation, robust_fit
from measurement.screen.grid_look import GridLook

Array = npt.NDArray[np.float64]

PIECE = 5
"""Places along a line that are taken together; their median does not see dust on one or two of them."""

NOISES = 6.0
"""Standard errors of such a median up to which a piece may lie where it should: the largest of some hundreds do."""

DOUBTED, DOUBTED_NOISES = 25e-6, 8.0
"""Distance of a piece of line from where it should be, in m and in standard errors, from which the outline beside it is not
trusted."""

NEAR = 1.0
"""Distance of a piece from the outline in pitches up to which it tells of it."""

FADES = 0.5
"""Distance in pitches over which what a piece lies off fades to 1/e."""


@dataclasses.dataclass(frozen=True, eq=False)
class Pieces:
    """Pieces of the printed lines.

    Attributes:
        place: Their middles in m on the screen, shape (n, 2).
        off: Distance in m across the line from where each should be, the whole screen's movement taken out, shape (n,).
        error: Standard error of each in m, shape (n,).
        pitch: Distance of the lines in m.
    """

    place: Array
    off: Array
    error: Array
    pitch: float


def pieces_of(looks: list[GridLook]) -> Pieces:
    """The pieces of all lines that any of the looks has seen; the first look tells the whole screen's movement."""
    pitch = looks[0].pitch
    places, offs, errors = [np.zeros((0, 2))], [np.zeros(0)], [np.zeros(0)]
    whole = [_affine(looks[0], axis) for axis in (0, 1)]
    for look in looks:
        every = np.ones(len(look.shift), dtype=bool)
        found = [
            _medians(look, axis, look.shift - look.affine_terms(every) @ movement)
            for axis, movement in enumerate(whole)
            if movement is not None
        ]
        if not sum(len(part[1]) for part in found):
            continue
        scatter = deviation(np.concatenate([part[2] for part in found]))
        # The median of n values has pi/2 times the variance of their mean; values about their own median scatter less.
        # A shadow's faint lines are read less well than the lit screen's, so each look has an error of its own.
        error = scatter * np.sqrt(np.pi / 2.0 / PIECE) * 1.25
        for place, off, _ in found:
            places.append(place)
            offs.append(off)
            errors.append(np.full(len(off), error))
    return Pieces(np.concatenate(places), np.concatenate(offs), np.concatenate(errors), pitch)


def _medians(look: GridLook, axis: int, shift: Array) -> tuple[Array, Array, Array]:
    """Middles (n, 2) of pieces of the lines of one axis, their medians (n,), and how far their values lie from these (n, k)."""
    places, medians, rests = [np.zeros((0, 2))], [np.zeros(0)], [np.zeros((0, PIECE))]
    number = np.where(look.axis == axis, np.rint(look.place[:, axis] / look.pitch), np.nan)
    for line in np.unique(number[np.isfinite(number)]):
        on = np.flatnonzero(number == line)
        on = on[np.argsort(look.place[on, 1 - axis])]
        if len(on) < PIECE:
            continue
        window = np.lib.stride_tricks.sliding_window_view(on, PIECE)
        # A piece that reaches over a part where the line is not seen tells of neither end.
        window = window[np.ptp(look.place[window, 1 - axis], axis=1) < 1.2 * look.pitch]
        median = np.median(shift[window], axis=1)
        places.append(look.place[window[:, PIECE // 2]])
        medians.append(median)
        rests.append(np.abs(shift[window] - median[:, None]))
    return np.concatenate(places), np.concatenate(medians), np.concatenate(rests).ravel()


def flatness(pieces: Pieces, points: Array) -> tuple[Array, str | None]:
    """What the screen's own shape makes uncertain of an edge, and what speaks against trusting it.

    Args:
        pieces: The pieces of the printed lines.
        points: The edge in m on the screen, shape (n, 2).

    Returns:
        Standard errors (n,) in m, and a sentence or None.
    """
    if not len(pieces.off):
        return np.zeros(len(points)), None
    # What the pieces have in common beyond their noise is the screen's own; far from all of them a point has more of it.
    best = pieces.error <= pieces.error.min()
    common2 = deviation(pieces.off[best]) ** 2 - float(pieces.error.min()) ** 2
    far = cKDTree(pieces.place).query(points)[0] / (FADES * pieces.pitch)
    error = np.sqrt(max(0.0, common2)) * np.minimum(1.0, far)
    near, _ = cKDTree(points).query(pieces.place, distance_upper_bound=NEAR * pieces.pitch)
    beside = np.isfinite(near)
    beyond = np.abs(pieces.off) * (np.abs(pieces.off) > NOISES * pieces.error)
    for number in np.flatnonzero(beyond > 0.0):
        far = np.linalg.norm(points - pieces.place[number], axis=1) / (FADES * pieces.pitch)
        error = np.maximum(error, beyond[number] * np.exp(-far))
    doubted = beyond * beside * (beyond >= np.maximum(DOUBTED, DOUBTED_NOISES * pieces.error))
    worst = int(np.argmax(doubted))
    if not doubted[worst]:
        return error, None
    return error, (
        f"{near[worst] * 1e3:.1f} mm beside the edge the printed grid lies {beyond[worst] * 1e6:.0f} um off: the screen bulges "
        "or slides there, hot air or a drop on the lens bends the light, or the lens' correction is wrong"
    )


def _affine(look: GridLook, axis: int) -> Array | None:
    """Movement (3,) of the whole screen along one axis: a constant and its growth along X and Z; None if too little is seen."""
    mine = look.axis == axis
    if mine.sum() < 4 * PIECE:
        return None
    return robust_fit(look.affine_terms(mine), look.shift[mine], 8).coefficients
