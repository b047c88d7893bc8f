"""A reduced model in the words of other programs: tables, a MuJoCo model, an FMU."""

from __future__ import annotations

import csv
import dataclasses
import functools
import hashlib
import io
import itertools
import json
import math
import re
import sys
import tempfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import ClassVar
from xml.etree import ElementTree

import numpy as np
import scipy.linalg
from scipy.optimize import brentq, least_squares, linprog, lsq_linear
from scipy.spatial.transform import Rotation

from geometries import actuator
from softmodels.case.entries import CaseError
from softmodels.common import errors, files
from softmodels.common.arrays import Array
from softmodels.components.loads import Gravity
from softmodels.decks import deck, reduction
from softmodels.decks.reduction import PerPressure, ReducedModel
from softmodels.runs.outcomes import RunError

__all__ = ["WRITERS", "Chain", "chain_of", "is_own", "kind_of", "write"]


JOINTS = {
    "hinge": ("hinge", "0 0 1"), "side": ("hinge", "0 1 0"), "twist": ("hinge", "1 0 0"),
    "slide": ("slide", "1 0 0"), "shear": ("slide", "0 1 0"), "side_shear": ("slide", "0 0 1"),
}  # fmt: skip
"""The joints of a link in their order, each with MuJoCo's type and its axis."""
DRIVERS = ("bend", "uneven", "extension", "lean", "uneven_lean", "twisting")
JOINT_VARIABLES = {
    "hinge": ("bend", "uneven"),
    "slide": ("extension", ""),
    "side": ("lean", "uneven_lean"),
    "twist": ("twisting", ""),
}
"""The numbers that a joint of each kind follows: its share of the first, and of the second by its place along the chain."""


@dataclasses.dataclass(frozen=True, eq=False)
class Chain:
    """The chain of a device: links along the line of its bending stiffness, which is ``offset`` from that of the tip's centre.

    Attributes:
        base: Its beginning, m.
        axes: In columns its direction at rest, the one across it towards which it bends, and the normal of that plane.
        length: At rest, m.
        drive: How it follows the pressures.
        numbers: Its numbers (rad and m) by the terms of the drive, shape (3, terms), or (6, terms) where the tip leaves the
            plane.
        springs: The springs of the joints.
        stiffness: Of a spring of each kind in the middle of the chain, N m/rad and N/m, by the terms of the drive.
        cubics: Of the springs, beside what they yield to small loads.
        error: Largest distance of the tip from the table's over the length, and angle in degrees.
        yielding: Largest error at the table's states of the displacement by a force, and of the rotation by a moment, over
            their size; shape (6,), nan where they are not known.
    """

    base: Array
    axes: Array
    length: float
    drive: Drive
    numbers: Array
    springs: Springs
    stiffness: dict[str, Array]
    error: tuple[float, float] = (0.0, 0.0)
    yielding: Array = dataclasses.field(default_factory=lambda: np.full(6, math.nan))
    cubics: tuple[CubicSpring, ...] = ()

    def stiffest(self) -> dict[str, float]:
        """Return the largest of `stiffness` over the pressures."""
        terms = self.drive.terms(self.drive.samples())
        return {kind: float((terms @ coefficients).max()) for kind, coefficients in self.stiffness.items()}


@dataclasses.dataclass(frozen=True, eq=False)
class Drive:
    """What of the pressures the numbers and the stiffnesses of a chain are sums of.

    Each pressure's share of its highest is drawn out to its advance, by quartics after each other. The terms are 1, the
    advances, and powers of sums of these: every polynomial of the advances up to `TERM_DEGREE` is a sum of terms.

    Attributes:
        low, top: The lowest pressures, and those farthest from 0, Pa, shape (m,).
        advances: Coefficients of each of the last of `ADVANCES` over the one before, shape (m, advances, 5).
    """

    low: Array
    top: Array
    advances: Array

    @property
    def powers(self) -> list[tuple[int, Array]]:
        """See `powers_of`."""
        return powers_of(len(self.top))

    @property
    def advance_names(self) -> tuple[str, ...]:
        """Which of `ADVANCES` there are of each pressure."""
        return ADVANCES[-self.advances.shape[1] :]

    @property
    def degrees(self) -> Array:
        """Of each term."""
        return np.array([0, *[1] * len(self.top), *(power for power, _ in self.powers)])

    def terms(self, pressures: Array) -> Array:
        """Return the terms at pressures in Pa, shape (n, m); shape (n, terms)."""
        at = np.transpose([_advance(of, share) for of, share in zip(self.advances, (pressures / self.top).T, strict=True)])
        return np.column_stack([np.ones(len(at)), at, *((at @ way) ** power for power, way in self.powers)])

    def samples(self) -> Array:
        """Return pressures all over the range, Pa, shape (n, m)."""
        count = round(FIT_SAMPLES ** (1 / len(self.top)))
        return product([np.linspace(*ends, count) for ends in zip(self.low, self.top, strict=True)])


@functools.cache
def powers_of(count: int) -> list[tuple[int, Array]]:
    """Return each power with the share of each of so many advances in its sum, shape (count,), together 1 by their size."""
    powers = list[tuple[int, Array]]()
    ways = np.array(
        [way for way in itertools.product((0.0, 1.0, -1.0, 2.0), repeat=count) if next(filter(None, way), 0.0) > 0.0]
    )
    simplest = sorted(ways / np.abs(ways).sum(axis=1)[:, None], key=np.count_nonzero)
    places = product([np.linspace(0.0, 1.0, TERM_DEGREE + 1)] * count)
    for power in range(2, TERM_DEGREE + 1):
        kept = list[Array]()
        for way in simplest:
            if np.linalg.matrix_rank((places @ np.transpose([*kept, way])) ** power) > len(kept):
                kept.append(way)
        powers += [(power, way) for way in kept]
    return powers


def product(axes: Sequence[Array]) -> Array:
    """Return all combinations of values, shape (n, axes), the last changing fastest."""
    return np.array(list(itertools.product(*axes)))


@dataclasses.dataclass(frozen=True, eq=False)
class Springs:
    """Where along a chain its springs yield, and how its joints are coupled.

    The spring of the torsion also turns its link to the side and shifts it, because the line about which a section twists is
    neither that about which it bends nor parallel to it.

    Attributes:
        offset: Of the chain from the line of the tip's centre, towards the second axis, m.
        slant: Rotation to the side by that of the torsion.
        lever: Shift to the side in m by a torsion of one radian.
        growth: Of each kind: its compliance grows along the chain as exp(growth t), t from -1 to 1.
    """

    offset: float
    slant: float
    lever: float
    growth: dict[str, float]

    @property
    def kinds(self) -> list[str]:
        """The joints that yield."""
        return list(self.growth)

    def shares(self, kind: str) -> Array:
        """Return the compliances of the springs of a kind over that in the middle of the chain, shape (links,)."""
        return np.exp(self.growth[kind] * ALONG * 2 / DEFAULT_SEGMENTS)

    def length_of(self, kind: str) -> dict[str, float]:
        """Return how far a spring is stretched by each joint of its link."""
        coupled = {"side": self.slant, "side_shear": self.lever}.get(kind, 0.0)
        return {kind: 1.0, **({"twist": -coupled} if coupled else {})}

    def compliances(self, motion: Array) -> Array:
        """Return the compliance of the tip by each kind of spring at a compliance of 1 in the middle of the chain, shape
        (kinds, 6, 6), of the motions of the tip by the joints."""
        places = [list(JOINTS).index(kind) for kind in self.kinds]
        if "twist" in self.growth:
            motion = motion.copy()
            motion[:, 2] += self.slant * motion[:, 1] + self.lever * motion[:, 5]
        by = motion[:, places]
        return np.einsum("mk,kmi,kmj->mij", np.array([self.shares(kind) for kind in self.kinds]), by, by)


@dataclasses.dataclass(frozen=True, eq=False)
class CubicSpring:
    """Springs of all links without stiffness at rest, stretched by x, whose force is ``square`` x^2 + ``cube`` x^3.

    Attributes:
        kinds: The joints that stretch them, each with its factors, shape (links,).
    """

    kinds: dict[str, Array]
    square: float
    cube: float


DEFAULT_SEGMENTS = 8
ALONG = np.arange(DEFAULT_SEGMENTS) - (DEFAULT_SEGMENTS - 1) / 2
"""Places of the links along the chain, in links from its middle."""
MOST_TURN = math.radians(0.1)
"""Rotation up to which a device only extends."""
PLANE_TOLERANCE = 0.02
"""Distance of the tip from the plane of bending up to which a chain stays in it: in displacements of the tip, or in lengths
where its stiffness across the plane is not known."""
LEAST_MOTION = 0.01
"""Displacement of the tip in lengths below which that share of it is the rounding of the mesh."""
TIME_CONSTANT = 0.01
"""Time constant in s of the pressure behind its command."""
DRIVER_MASS = 5e-8
"""Mass of a driver in masses of the device."""
DRIVER_INERTIA = 1e-6
"""Moment of inertia of a driver in masses of the device times its length squared."""
DRIVER_TURN = 1000.0
"""Angle by which drivers turn over the range, rad."""
ADVANCES = ("onset", "rise", "advance")
"""What follows from the pressure, each from the one before, by a quartic from 0 at 0 to 1 at 1."""
TERM_DEGREE = 4
"""Of the polynomials of the advances."""
FIT_SAMPLES = 61
"""Places, of all pressures together, at which a chain is fitted to the table's curves, beside the table's own."""
SPRING_STATES = 6
"""States of the table by which the springs are placed."""
CROSS_WEIGHT = 0.3
"""Weight of the rotation by a force, and of the displacement by a moment, in the fit of the springs."""
LEAST_COUPLING = 0.01
"""Rotation by a force, or displacement by a moment, over the mean of those by their own loads, below which its relative error
does not matter: that of a straight device is the rounding of its mesh."""
MIN_COMPLIANCE_SHARE = 0.02
"""Least compliance of a kind of spring, over that which would make the whole compliance of the tip."""


@dataclasses.dataclass(frozen=True, eq=False)
class Posture:
    """A chain, along its axes at rest.

    Attributes:
        place: Of the tip, m.
        rotations: Of the links, shape (links, 3, 3).
        motion: Of the tip by each joint, shape (links, joints, 6).
        centres: Of the links, on the line of the tip's centre, m, shape (links, 3).
    """

    place: Array
    rotations: Array
    motion: Array
    centres: Array


def posture_of(numbers: Array, length: float, offset: float) -> Posture:
    """Return a chain by its numbers."""
    bend, uneven, extension, lean, uneven_lean, twist = np.append(numbers, np.zeros(len(DRIVERS) - len(numbers)))
    link, count = length / DEFAULT_SEGMENTS, DEFAULT_SEGMENTS
    angles = np.column_stack([bend / count + uneven * ALONG, lean / count + uneven_lean * ALONG, np.full(count, twist / count)])
    places, axes, rotations = np.empty((count, 1, 3)), np.empty((count, len(JOINTS), 3)), np.empty((count, 3, 3))
    lengths = np.full(count, link)
    lengths[-1] /= 2
    place, R = np.array([link / 2, offset, 0.0]), np.eye(3)
    for k, joint in enumerate(Rotation.from_euler("ZYX", angles).as_matrix()):
        places[k, 0], axes[k, 0] = place, R[:, 2]
        axes[k, 1] = R @ [-math.sin(angles[k, 0]), math.cos(angles[k, 0]), 0.0]
        R = rotations[k] = R @ joint
        axes[k, 2], axes[k, 3:] = R[:, 0], R.T
        place = place + (lengths[k] + extension / count) * R[:, 0]
    place = place - offset * R[:, 1]
    motion = np.zeros((count, len(JOINTS), 6))
    motion[:, :3, :3], motion[:, :3, 3:] = np.cross(axes[:, :3], place - places), axes[:, :3]
    motion[:, 3:, :3] = axes[:, 3:]
    within = np.column_stack([extension / count + lengths / 2, np.full(count, -offset), np.zeros(count)])
    return Posture(place, rotations, motion, places[:, 0] + np.einsum("kij,kj->ki", rotations, within))


def numbers_at(place: Array, R: Array, length: float, offset: float, guess: Array, hinges: bool) -> Array:
    """Return the numbers of the chain whose tip is closest to a pose, by Gauss and Newton; only the extension if it has no
    hinges."""
    numbers, free = np.array(guess), np.arange(len(guess)) if hinges else np.array([2])
    sizes = np.array([1.0, 1.0, length, 1.0, 1.0, 1.0])[free]
    for _ in range(NUMBER_STEPS):
        posture = posture_of(numbers, length, offset)
        motion = posture.motion
        by = np.array([
            motion[:, 0].mean(axis=0), ALONG @ motion[:, 0], motion[:, 3].mean(axis=0),
            motion[:, 1].mean(axis=0), ALONG @ motion[:, 1], motion[:, 2].mean(axis=0),
        ])[free].T * np.repeat([1 / length, 1.0], 3)[:, None]  # fmt: skip
        step = np.linalg.lstsq(by * sizes, _tip_error(posture, place, R, length), rcond=None)[0]
        numbers[free] -= step * sizes
        if np.abs(step).max() < NUMBER_TOLERANCE:
            break
    return numbers


NUMBER_STEPS = 30
NUMBER_TOLERANCE = 1e-10


def _tip_error(posture: Posture, place: Array, R: Array, length: float) -> Array:
    """Return how far the end of a chain is from a pose, in lengths and radians."""
    turn = Rotation.from_matrix(posture.rotations[-1] @ R.T).as_rotvec()
    return np.concatenate([(posture.place - place) / length, turn])


@dataclasses.dataclass(frozen=True, eq=False)
class TipPath:
    """The tip of a reduced model along the axes of its chain, at several pressures.

    Attributes:
        length: Of the chain at rest, m.
        hinges: Whether it bends.
        count: Numbers of the chain.
        places, rotations, compliances: Of the tip from the base, m; SI units.
    """

    length: float
    hinges: bool
    count: int
    places: Array
    rotations: Array
    compliances: Array

    def numbers(self, offset: float) -> Array:
        """Return the numbers of the chain, shape (pressures, count)."""
        numbers = [np.zeros(self.count)]
        for place, R in zip(self.places, self.rotations, strict=True):
            numbers.append(numbers_at(place, R, self.length, offset, numbers[-1], self.hinges))
        return np.array(numbers[1:])

    def some(self, count: int) -> TipPath:
        """Return the path at some of its pressures, the first and the last among them."""
        chosen = np.unique(np.linspace(0, len(self.places) - 1, count).round().astype(int))
        return dataclasses.replace(
            self, places=self.places[chosen], rotations=self.rotations[chosen], compliances=self.compliances[chosen]
        )

    def kinds(self) -> list[str]:
        """Return the joints whose stiffness the compliances tell."""
        known = np.isfinite(self.compliances) & (np.abs(self.compliances) > 0.0)
        told = {"slide": known[:, 0, 0], "hinge": known[:, 5, 5], "shear": known[:, 1, 1],
                "side": known[:, 4, 4], "twist": known[:, 3, 3], "side_shear": known[:, 2, 2]}  # fmt: skip
        return [kind for kind in JOINTS if told[kind].any()]


def chain_of(model: ReducedModel) -> Chain:
    """Return the chain that follows a reduced model; `RunError` if the tip's stiffness is not known in a direction in which it
    moves."""
    along = (model.states[0].position - model.base) / model.length
    turn = max(model.turns, key=lambda turn: float(np.linalg.norm(turn)))
    hinges = float(np.linalg.norm(turn)) > MOST_TURN
    normal = turn / np.linalg.norm(turn) if hinges else reduction.across(along)[1]
    normal = normal - (normal @ along) * along
    normal /= np.linalg.norm(normal)
    axes = np.column_stack([along, np.cross(normal, along), normal])
    ends = np.transpose([np.atleast_1d(end) for end in model.span])
    top = np.array([max(pair, key=abs) for pair in ends])
    drive = Drive(ends.sum(axis=1) - top, top, np.tile([0.0, 1.0, 0.0, 0.0, 0.0], (len(top), 1, 1)))
    sampled = product([*map(np.union1d, model.curves.axes, map(np.unique, drive.samples().T))])
    path = path_of(model, axes, hinges, sampled)
    out, kinds = float(np.abs(path.places[:, 2]).max()), path.kinds()
    if "slide" not in kinds or (hinges and "hinge" not in kinds):
        raise RunError("the stiffness of the tip is not known in the plane of bending; reduce a model of the whole device")
    if path.count > 3 and not {"side", "twist"} <= set(kinds):
        raise RunError(
            f"the tip leaves the plane of bending by {1e3 * out:.3g} mm, and its stiffness across that is not known; reduce a "
            f"model of the whole device, or write a table (.csv, .json)"
        )
    # Between few states over several pressures the compliance is less well known than pose and rates.
    exact = sampled if len(top) == 1 else model.pressures
    states = path_of(model, axes, hinges, exact, path.count)
    springs = springs_of(states.some(SPRING_STATES), kinds)
    drive, coefficients = _fitted_drive(drive, sampled, path.numbers(springs.offset))
    half_way = product([(x[1:] + x[:-1]) / 2 for x in map(np.unique, sampled.T)])
    between = path_of(model, axes, hinges, half_way, path.count)
    misses = np.array([
        _tip_error(posture_of(made, model.length, springs.offset), place, R, model.length)
        for at, of in ((sampled, path), (half_way, between))
        for made, place, R in zip(drive.terms(at) @ coefficients.T, of.places, of.rotations, strict=True)
    ])  # fmt: skip
    angles = np.linalg.norm(misses[:, 3:], axis=1) * hinges
    error = float(np.linalg.norm(misses[:, :3], axis=1).max()), math.degrees(float(angles.max()))
    stiffness, yielding = _stiffnesses(states, springs, drive, drive.terms(exact))
    chain = Chain(model.base, axes, model.length, drive, coefficients, springs, stiffness, error, yielding)
    return dataclasses.replace(chain, cubics=cubic_springs(model, chain))


def path_of(model: ReducedModel, axes: Array, hinges: bool, pressures: Array, count: int = 0) -> TipPath:
    """Return the tip of a model at pressures in Pa, shape (n, m); as many numbers as it needs there, or ``count``."""
    poses, both = (
        [model(*each) for each in pressures.reshape(len(pressures), -1)],
        np.asarray(np.kron(np.eye(2), axes), dtype=float),
    )
    places = np.array([pose.position - model.base for pose in poses]) @ axes
    path = TipPath(
        model.length, hinges, count, places, np.array([axes.T @ pose.rotation @ axes for pose in poses]),
        np.array([turned(pose.compliance, both) for pose in poses]),
    )  # fmt: skip
    if count:
        return path
    rest, out = np.array([model.length, 0.0, 0.0]), float(np.abs(places[:, 2]).max())
    moved = max(float(np.linalg.norm(places - rest, axis=1).max()), LEAST_MOTION * model.length)
    plane = moved if {"side", "twist"} <= set(path.kinds()) else model.length
    return dataclasses.replace(path, count=6 if out > PLANE_TOLERANCE * plane else 3)


def turned(C: Array, axes: Array) -> Array:
    """Return a compliance along other axes; nan where entries that are not known have a part in it."""
    unknown = np.abs(axes.T) @ np.isnan(C) @ np.abs(axes) > UNKNOWN_PART
    return np.where(unknown, math.nan, axes.T @ np.nan_to_num(C) @ axes)


UNKNOWN_PART = 1e-6


# ----------------------------------------------------------------------------------------------------------------------
# The springs: those with which the tip yields as the device's, at each pressure.
#
# A chain that holds a pose by springs without tension yields by the sum of the compliances of its springs, each times the
# motions of the tip by its joint. So the compliances follow from those of the tip by linear least squares.


def springs_of(path: TipPath, kinds: Sequence[str]) -> Springs:
    """Return the springs by which the tip yields as that of a path."""

    def springs(values: Array) -> Springs:
        offset, slant, lever, *growth = values
        return Springs(path.length * offset, slant, path.length * lever, dict(zip(kinds, growth, strict=True)))

    @functools.lru_cache(maxsize=2)
    def states(offset: float) -> list[tuple[Array, Array]]:
        return _states(path, offset, path.numbers(offset))

    def misses(values: Array) -> Array:
        made = springs(values)
        fitted = [_yielding(made, C, motion) for C, motion in states(made.offset)]
        return np.append(np.ravel([weighted for _, weighted, _ in fitted]), SHAPE_WEIGHT * values)

    start = np.full(3 + len(kinds), 0.01)
    return springs(least_squares(misses, start, diff_step=1e-4, max_nfev=30, bounds=(-MAX_GROWTH, MAX_GROWTH)).x)


SHAPE_WEIGHT = 0.01
"""Weight of the shape of the springs, beside that of relative errors of the compliance."""
MAX_GROWTH = 4.0


def _states(path: TipPath, offset: float, numbers: Array) -> list[tuple[Array, Array]]:
    """Return compliance and motions of the tip at each pressure."""
    motions = [posture_of(of_state, path.length, offset).motion for of_state in numbers]
    return list(zip(path.compliances, motions, strict=True))


def _yielding(springs: Springs, C: Array, motion: Array) -> tuple[Array, Array, Array]:
    """Return the compliance of the kinds of springs, shape (kinds,), that together are closest to that of the tip (nan where
    it does not tell), the weighted error of each of the tip's entries, shape (6, 6), and `deflection_errors`."""
    sizes, diagonal = np.zeros((6, 6)), np.sqrt(np.nan_to_num(np.diag(C)))
    for rows in slice(0, 3), slice(3, 6):
        sizes[rows] = np.linalg.norm(np.nan_to_num(C[rows]), axis=0)
    sizes = np.maximum(sizes, LEAST_COUPLING * np.outer(diagonal, diagonal))
    known = np.isfinite(C) & (sizes > 0.0)
    weights = np.kron(np.where(np.eye(2), 1.0, CROSS_WEIGHT), np.ones((3, 3)))[known] / sizes[known]
    parts = springs.compliances(motion)
    terms = (parts[:, known] * weights).T
    largest = np.abs(terms).max(axis=0, initial=0.0)
    used = largest > 0.0
    values = np.full(len(parts), math.nan)
    if used.any():
        bounded = lsq_linear(terms[:, used] / largest[used], C[known] * weights, (MIN_COMPLIANCE_SHARE, np.inf), method="bvls")
        values[used] = bounded.x / largest[used]
    made = np.tensordot(np.nan_to_num(values), parts, 1)
    weighted = np.zeros((6, 6))
    weighted[known] = (made - C)[known] * weights
    return values, weighted, deflection_errors(made, C)


def deflection_errors(made: Array, C: Array) -> Array:
    """Return the error of the displacement by each force and of the rotation by each moment, over their size, shape (6,); nan
    where they are not known."""
    errors = np.full(6, math.nan)
    for k in range(6):
        rows = slice(3 * (k // 3), 3 * (k // 3) + 3)
        if np.isfinite(C[k, k]) and C[k, k] > 0.0:
            errors[k] = np.linalg.norm(np.nan_to_num(made - C)[rows, k]) / np.linalg.norm(np.nan_to_num(C[rows, k]))
    return errors


def _stiffnesses(path: TipPath, springs: Springs, drive: Drive, terms: Array) -> tuple[dict[str, Array], Array]:
    """Return the stiffness of the springs of each kind in the middle of the chain by the terms of a drive, and the largest
    errors of the deflections with it."""
    states, stiffness = _states(path, springs.offset, path.numbers(springs.offset)), dict[str, Array]()
    compliances = np.array([_yielding(springs, C, motion)[0] for C, motion in states])
    for kind, values in zip(springs.kinds, compliances.T, strict=True):
        told = np.isfinite(values)
        stiffness[kind] = _stiffness_polynomial(drive, terms[told], 1 / values[told])
    made = np.array([1 / (terms @ coefficients) for coefficients in stiffness.values()])
    errors = np.array([
        deflection_errors(np.tensordot(values, springs.compliances(motion), 1), C)
        for values, (C, motion) in zip(made.T, states, strict=True)
    ])  # fmt: skip
    known = np.isfinite(errors).any(axis=0)
    return stiffness, np.where(known, np.where(np.isfinite(errors), errors, 0.0).max(axis=0), math.nan)


def _stiffness_polynomial(drive: Drive, terms: Array, stiffness: Array) -> Array:
    """Return the coefficients of the polynomial that is closest to a stiffness by its relative error, and stays within its
    range between the pressures; of a lower degree if that of the highest does not."""
    samples, coefficients = drive.terms(drive.samples()), np.zeros(terms.shape[1])
    for degree in range(TERM_DEGREE, 0, -1):
        used = drive.degrees <= degree
        if used.sum() <= len(stiffness):
            coefficients[:] = 0.0
            coefficients[used] = np.linalg.lstsq(terms[:, used] / stiffness[:, None], np.ones(len(stiffness)), rcond=None)[0]
            if (samples @ coefficients).min() > LEAST_STIFFNESS * stiffness.min():
                return coefficients
    coefficients[:] = 0.0
    coefficients[0] = 1 / np.mean(1 / stiffness)
    return coefficients


LEAST_STIFFNESS = 0.7
"""Least stiffness of a polynomial over that which it fits."""


def _advance(advances: Array, shares: Array) -> Array:
    """Return the advance at shares of the highest pressure."""
    for coefficients in advances:
        shares = np.polynomial.Polynomial(coefficients)(shares)
    return shares


def _fitted_drive(drive: Drive, pressures: Array, numbers: Array) -> tuple[Drive, Array]:
    """Return the drive of whose terms numbers (in columns) at pressures in Pa are sums best, each by its size; and the
    coefficients, shape (numbers, terms). Only the advance over a single pressure is fitted: over several there are too few
    places along each."""
    used = np.flatnonzero(drive.degrees >= (1 if (np.abs(pressures / drive.top) < 1e-9).all(axis=1).any() else 0))
    scaled = numbers / np.maximum(np.abs(numbers).max(axis=0), reduction.ZERO_LOAD_TOLERANCE)

    def drawn(inner: Array) -> Drive:
        a, b, c = inner.reshape(-1, 3).T  # x + x (x - 1) (a + b x + c x^2)
        return dataclasses.replace(drive, advances=np.column_stack([0.0 * a, 1.0 - a, a - b, b - c, c])[None])

    def solved(drive: Drive, of: Array) -> tuple[Array, Array]:
        terms = drive.terms(pressures)[:, used]
        coefficients = np.linalg.lstsq(terms, of, rcond=None)[0]
        return coefficients, (terms @ coefficients - of).ravel()

    if len(drive.top) == 1:
        drive = drawn(least_squares(lambda inner: solved(drawn(inner), scaled)[1], np.zeros(3 * len(ADVANCES))).x)
    coefficients = np.zeros((numbers.shape[1], len(drive.degrees)))
    coefficients[:, used] = solved(drive, numbers)[0].T
    return drive, coefficients


# ----------------------------------------------------------------------------------------------------------------------
# Larger loads: how the compliance of the tip changes by a force on it, to first order.
#
# Folds open and close, so a device is stiffer one way than the other: its energy has terms of third order in the deflection.
# Those of the chain are cubes of the joints' motions. Their coefficients follow from the rate of the device's compliance by
# linear least squares, because that of the chain is linear in them; what the links add by turning is exact.


class LinearChain:
    """A chain at a pressure, as linear equations of its joints.

    Attributes:
        joints: Their names, along the chain.
        posture: There.
        stiffness: Of the springs of each kind, shape (kinds, links).
        stretches: Of these by the joints, shape (kinds, links, joints).
        K: Stiffness of the joints.
    """

    joints: ClassVar = [f"{kind}{k}" for k in range(DEFAULT_SEGMENTS) for kind in JOINTS]

    def __init__(self, chain: Chain, pressures: PerPressure):
        terms, kinds = chain.drive.terms(np.atleast_2d(pressures))[0], chain.springs.kinds
        self.posture = posture_of(chain.numbers @ terms, chain.length, chain.springs.offset)
        self.stiffness = np.array([chain.stiffness[kind] @ terms / chain.springs.shares(kind) for kind in kinds])
        self.stretches = np.zeros((*self.stiffness.shape, len(self.joints)))
        for m, kind in enumerate(kinds):
            for k in range(DEFAULT_SEGMENTS):
                for joint, factor in chain.springs.length_of(kind).items():
                    self.stretches[m, k, self.joints.index(f"{joint}{k}")] = factor
        self.K = np.einsum("mk,mki,mkj->ij", self.stiffness, self.stretches, self.stretches)

    @functools.cached_property
    def moved(self) -> Array:
        """Motions of the joints by force and moment on the tip, shape (joints, 6)."""
        used, moved = np.flatnonzero(np.diag(self.K)), np.zeros((len(self.joints), 6))
        moved[used] = np.linalg.solve(self.K[np.ix_(used, used)], self.posture.motion.reshape(-1, 6)[used])
        return moved

    def compliance_rate(self) -> Array:
        """Return the derivative of the tip's compliance by a dead force on it, shape (6, 6, 3)."""
        motion, moved = self.posture.motion.reshape(-1, 6), self.moved
        i, j = np.indices((len(motion), len(motion)))
        # A joint moves and turns all that comes after it.
        by_both = np.cross(motion[np.minimum(i, j), 3:], motion[np.maximum(i, j), :3])
        turned = np.cross(motion[i, 3:], motion[j, 3:]) * (i < j)[:, :, None]
        rate = np.empty((6, 6, 3))
        for k in range(3):
            by_motion = moved.T @ np.tensordot(moved[:, k], np.concatenate([by_both, turned], axis=2), 1)
            rate[:, :, k] = by_motion + by_motion.T + moved.T @ by_both[:, :, k] @ moved
        return rate

    def rate_by_cube(self, stretches: Array) -> Array:
        """Return what springs of the energy x^3 / 3 add to that rate, stretched by the joints, shape (links, joints)."""
        x = stretches @ self.moved
        return -2.0 * np.einsum("li,lj,lk->ijk", x, x, x[:, :3])


CUBES = (
    ({"hinge": 1},), ({"slide": 1},), ({"hinge": 1, "slide": 1},), ({"hinge": 1, "slide": -1},),
    ({"hinge": 1, "side": 1}, {"hinge": 1, "side": -1}), ({"slide": 1, "side": 1}, {"slide": 1, "side": -1}),
)  # fmt: skip
"""Sums of the joints' motions, each over that by a unit of energy; the cubes of those in one group have one coefficient,
because the device is the same to both sides."""
MAX_SOFTENING = 2 / 3
"""Largest share of its stiffness that a link loses by any motion: forces of third order see to it."""
WEAKEST_CUBE = 0.02
"""Effect of the least known sum of cubes that is fitted, over that of the best known."""


def cubic_springs(model: ReducedModel, chain: Chain) -> tuple[CubicSpring, ...]:
    """Return the springs with which the compliance of the tip changes by a force as that of the device; none if that is not
    known."""
    state = next((state for state in model.states if state.compliance_rate is not None), None)
    if state is None or state.compliance_rate is None:
        return ()
    linear = LinearChain(chain, state.pressure)
    factors = dict(zip(chain.springs.kinds, np.sqrt(linear.stiffness), strict=True))
    stretches = dict(zip(factors, linear.stretches, strict=True))
    both, rate = np.asarray(np.kron(np.eye(2), chain.axes), dtype=float), state.compliance_rate
    along = functools.partial(np.einsum, "ia,jb,kc,ijk->abc")
    wanted = along(both, both, chain.axes, np.nan_to_num(rate)) - linear.compliance_rate()
    unknown = along(abs(both), abs(both), abs(chain.axes), 1.0 * np.isnan(rate)) > UNKNOWN_PART
    # Weights that make errors of deflections, by loads that move the tip by the length or turn it by one radian.
    C = np.diag(turned(state.compliance, both))
    weights = np.nan_to_num(np.cbrt(np.repeat([chain.length, 1.0], 3) / np.where(C > 0.0, C, math.nan) ** 2))
    weights = np.where(unknown, 0.0, np.einsum("i,j,k->ijk", weights, weights, weights[:3]))

    def effect(cube: dict[str, int]) -> Array:
        stretched = np.sum([sign * factors[kind][:, None] * stretches[kind] for kind, sign in cube.items()], axis=0)
        return np.asarray(linear.rate_by_cube(stretched) * weights).ravel()

    groups = [group for group in CUBES if set(group[0]) <= set(factors)]
    terms = np.column_stack([np.sum([effect(cube) for cube in group], axis=0) for group in groups])
    values = np.linalg.lstsq(terms, (wanted * weights).ravel(), rcond=WEAKEST_CUBE)[0]
    cubes = [(cube, float(value)) for value, group in zip(values, groups, strict=True) for cube in group if value]
    D = np.array([[cube.get(kind, 0) for kind in ("hinge", "slide", "side")] for cube, _ in cubes], dtype=float)
    return tuple(
        CubicSpring({kind: sign * factors[kind] for kind, sign in cube.items()}, value, float(bound))
        for (cube, value), bound in zip(cubes, _third_order(D, np.array([value for _, value in cubes])), strict=True)
    )


def _third_order(D: Array, squares: Array) -> Array:
    """Return the least b with which springs of forces a x^2 + b x^3, stretched by three motions of stiffness 1, leave the share
    1 - `MAX_SOFTENING` of that in every deflection.

    Along u, by the deflection r u, that is 1 + 2 A r + 3 B r^2, which is 1 - A^2 / (3 B) at least; B is linear in the
    coefficients.
    """
    by, size = _directions() @ D.T, np.abs(squares).max()
    A, B = np.einsum("ui,vi,i->uv", by**2, by, squares / size), np.einsum("ui,vi->uvi", by**2, by**2)
    least = -(A.ravel() ** 2) / (3.0 * MAX_SOFTENING)
    return np.asarray(size**2 * linprog((D**2).sum(axis=1) ** 2, A_ub=-B.reshape(-1, len(D)), b_ub=least).x)


def mjcf(model: ReducedModel) -> str:
    """Return a chain as MJCF: ``ctrl`` are the pressures in kPa; the site ``tip`` has the tip's pose."""
    return as_text(element(model, chain_of(model)))


def as_text(root: ElementTree.Element) -> str:
    """Return MJCF as a file has it."""
    ElementTree.indent(root, " ")
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def element(model: ReducedModel, chain: Chain) -> ElementTree.Element:
    """Return a chain as MJCF; see `mjcf`."""
    link, motion = model.length / DEFAULT_SEGMENTS, motion_by_mass(model, chain)
    # A weight that is in the table must not act once more in a scene with gravity.
    links = {"gravcomp": "1"} if any(isinstance(part, Gravity) for part in model.case.components) else {}
    root = ElementTree.Element("mujoco", model=model.case.name)
    root.append(ElementTree.Comment("\n".join(["", *remarks(model, chain, motion), ""])))
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="true")
    ElementTree.SubElement(root, "option", timestep="0.001", integrator="implicitfast", gravity="0 0 0")
    world = ElementTree.SubElement(root, "worldbody")
    quaternion = reduction.quaternion(chain.axes)
    body = ElementTree.SubElement(world, "body", links, name="base", pos=words(chain.base), quat=words(quaternion))
    _drivers(body, model, chain)
    _link(body, model, motion.masses[0], link / 2, 0.0)
    for k, mass in enumerate(motion.masses[1:]):
        place = [link / 2, chain.springs.offset, 0.0] if k == 0 else [link, 0.0, 0.0]
        body = ElementTree.SubElement(body, "body", links, name=f"link{k}", pos=words(place))
        for kind in chain.springs.kinds:
            sort, axis = JOINTS[kind]
            damping, armature = (of[kind] / chain.springs.shares(kind)[k] for of in (motion.damping, motion.armature))
            ElementTree.SubElement(
                body, "joint", name=f"{kind}{k}", type=sort, axis=axis, damping=f"{damping:.9g}", armature=f"{armature:.9g}"
            )
        _link(body, model, mass, link * (0.5 if k == DEFAULT_SEGMENTS - 1 else 1.0), -chain.springs.offset)
    at_rest = reduction.quaternion(chain.axes.T)
    ElementTree.SubElement(
        body, "site", name="tip", pos=words([link / 2, -chain.springs.offset, 0]), quat=words(at_rest),
        size=f"{LINK_RADIUS * model.length / 3:.6g}",
    )  # fmt: skip
    _shapes(root, model, chain)
    _springs(root, model, chain)
    actuator = ElementTree.SubElement(root, "actuator")
    for name, low, top in zip(model.names, chain.drive.low, chain.drive.top, strict=True):
        ElementTree.SubElement(
            actuator, "general", name=f"{name}_kPa", joint=name, ctrlrange=words(np.sort([low, top]) / 1e3), biastype="affine",
            gainprm=words([1e3 / TIME_CONSTANT**2 / top]), biasprm=words([0, -1 / TIME_CONSTANT**2, -2 / TIME_CONSTANT]),
        )  # fmt: skip
    return root


def remarks(model: ReducedModel, chain: Chain, motion: MotionByMass) -> list[str]:
    """Return what the file says of its chain, line by line."""
    low, high = map(reduction.in_kPa, model.span)
    yields = ", ".join(f"{load} {100 * error:.2g} %" for load, error in zip(LOADS, chain.yielding, strict=True)
                       if math.isfinite(error))  # fmt: skip
    return [
        f"{deck.WRITTEN_BY}: {model.case.name}, {low} to {high} kPa",
        f"tip within {100 * chain.error[0]:.2g} % of the length and {chain.error[1]:.2g} degrees of the table",
        f"largest error of the deflection of the tip by a small load on it, x along it, y towards its bending: {yields}",
        *model.contact_notes,
        motion.remark,
        "links touch other bodies with the convex hull of the device at rest around them, and not each other",
        "their friction holds, whatever that of the other body",
        "its springs, which stiffen with the pressure, need a MuJoCo with polynomial stiffness; tested with 4.0",
    ]


def _drivers(base: ElementTree.Element, model: ReducedModel, chain: Chain) -> None:
    """Add the joints of the pressures, of the advances, of the terms, of the numbers and of the stiffnesses."""
    mass, inertia = DRIVER_MASS * model.mass, DRIVER_INERTIA * model.mass * model.length**2
    advances = [f"{of}{name.removeprefix('pressure')}" for name in model.names for of in chain.drive.advance_names]
    powers = [f"power{k}" for k, _ in enumerate(chain.drive.powers)]
    sums = [*DRIVERS[: len(chain.numbers)], *(f"{kind}_stiffness" for kind in chain.stiffness)]
    for name in (*model.names, *advances, *powers, *sums):
        body = ElementTree.SubElement(base, "body", name=name)
        armature = {"armature": "1"} if name in model.names else {}
        ElementTree.SubElement(body, "inertial", pos="0 0 0", mass=f"{mass:.9g}", diaginertia=words([inertia] * 3))
        ElementTree.SubElement(body, "joint", armature, name=name, type="hinge", axis="1 0 0")


def _link(body: ElementTree.Element, model: ReducedModel, mass: float, length: float, height: float) -> None:
    """Add inertia and shape of a link to its body."""
    name = body.get("name", "")
    ElementTree.SubElement(
        body, "inertial", pos=words([length / 2, height, 0]), mass=f"{mass:.9g}",
        diaginertia=words(mass * link_inertia(length, LINK_RADIUS * model.length)),
    )  # fmt: skip
    ElementTree.SubElement(body, "geom", CONTACT, name=name, type="mesh", mesh=name, rgba="0.18 0.44 0.62 1")


def _shapes(root: ElementTree.Element, model: ReducedModel, chain: Chain) -> None:
    """Add the convex hulls of the device at rest around its links, in the links' coordinates; links do not touch each other."""
    assets, contact = ElementTree.SubElement(root, "asset"), ElementTree.SubElement(root, "contact")
    names = ["base", *(f"link{k}" for k in range(DEFAULT_SEGMENTS))]
    points, link = (model.points - chain.base) @ chain.axes, model.length / DEFAULT_SEGMENTS
    for k, name in enumerate(names):
        start, end = max(k - 0.5, 0.0) * link, (min(k + 0.5, DEFAULT_SEGMENTS)) * link
        low, high = -math.inf if k == 0 else start, math.inf if k == DEFAULT_SEGMENTS else end
        # Those of the neighbours, moved to the link's ends, too: cells may be longer than links.
        near = points[(points[:, 0] > low - link) & (points[:, 0] < high + link)]
        near = np.column_stack([np.clip(near[:, 0], low, high), near[:, 1:]])
        hull = np.unique(near[np.argmax(near @ _directions().T, axis=0)], axis=0)
        hull = hull - [start, chain.springs.offset if k else 0.0, 0.0]
        ElementTree.SubElement(assets, "mesh", name=name, vertex=words(hull.ravel()))
    for body, other in itertools.combinations(names, 2):
        ElementTree.SubElement(contact, "exclude", body1=body, body2=other)


HULL_DIRECTIONS = 96
"""Directions in which a hull reaches as far as the device: its corners are at most as many."""


def _directions() -> Array:
    """Return directions evenly over the sphere, on a spiral of the golden angle, shape (n, 3), with those of the axes."""
    k = np.arange(HULL_DIRECTIONS) + 0.5
    polar, turn = np.arccos(1 - 2 * k / HULL_DIRECTIONS), math.pi * (1 + math.sqrt(5)) * k
    spiral = np.column_stack([np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)])
    return np.concatenate([spiral, np.eye(3), -np.eye(3)])


def _springs(root: ElementTree.Element, model: ReducedModel, chain: Chain) -> None:
    """Add the springs of the chain, and what ties the terms to the pressures, and numbers and stiffnesses to the terms.

    Each spring is two tendons that are stretched by s + e and by s - e, where e is its joint's and s is proportional to the
    stiffness; with forces -c x^2 their energy is 2 c (s^3/3 + s e^2), so that the stiffness for e is 4 c s.
    """
    tendon, equality = ElementTree.SubElement(root, "tendon"), ElementTree.SubElement(root, "equality")
    largest = np.abs(chain.drive.terms(chain.drive.samples()) @ chain.numbers.T).max(axis=0)
    numbers = dict(zip(DRIVERS, np.where(largest > 0.0, largest, 1.0) / DRIVER_TURN, strict=False))
    stiffest = chain.stiffest()
    for kind in chain.springs.kinds:
        reach = STIFFNESS_REACH * (1.0 if JOINTS[kind][0] == "hinge" else chain.length)
        for k, share in enumerate(chain.springs.shares(kind)):
            stretched = _stretched_by(chain, kind, k, numbers)
            for name, sign in (("up", 1.0), ("down", -1.0)):
                coefficients = {
                    f"{kind}_stiffness": reach / DRIVER_TURN,
                    **{joint: sign * by for joint, by in stretched.items()},
                }
                _tendon(tendon, f"{kind}{k}_{name}", coefficients, stiffest[kind] / share / (4 * reach))
    for number, cubic in enumerate(chain.cubics):
        for k in range(DEFAULT_SEGMENTS):
            parts = [(of[k], _stretched_by(chain, kind, k, numbers)) for kind, of in cubic.kinds.items()]
            joints = dict.fromkeys(itertools.chain(*(by for _, by in parts)))
            stretched = {joint: sum(factor * by.get(joint, 0.0) for factor, by in parts) for joint in joints}
            _tendon(tendon, f"cube{number}_{k}", stretched, cubic.square, cubic.cube)

    def tie(sort: str, polynomial: Iterable[float], **names: str) -> None:
        ElementTree.SubElement(equality, sort, names, polycoef=words(polynomial), solref="0.002 1", solimp="0.999 0.9999 0.001")

    of_turn, ends = DRIVER_TURN ** -np.arange(5.0), list[str]()
    for name, advances in zip(model.names, chain.drive.advances, strict=True):
        chained = [name, *(f"{of}{name.removeprefix('pressure')}" for of in chain.drive.advance_names)]
        for before, after, quartic in zip(chained, chained[1:], advances, strict=False):
            # The pressure's joint turns by its share of the highest, the others by DRIVER_TURN times that.
            tie("joint", DRIVER_TURN * quartic * (1.0 if before == name else of_turn), joint1=after, joint2=before)
        ends.append(chained[-1])
    for k, (power, way) in enumerate(chain.drive.powers):
        _tendon(tendon, f"power{k}", {f"power{k}": 1.0})
        _tendon(tendon, f"sum{k}", {end: share for end, share in zip(ends, way, strict=True) if share})
        tie("tendon", DRIVER_TURN * of_turn * (np.arange(5) == power), tendon1=f"power{k}", tendon2=f"sum{k}")
    terms = [*ends, *(f"power{k}" for k, _ in enumerate(chain.drive.powers))]
    sums = {name: coefficients / numbers[name] / DRIVER_TURN for name, coefficients in zip(numbers, chain.numbers, strict=True)}
    sums |= {f"{kind}_stiffness": coefficients / stiffest[kind] for kind, coefficients in chain.stiffness.items()}
    for name, (constant, *shares) in sums.items():
        _tendon(tendon, name, {name: 1.0, **{term: -share for term, share in zip(terms, shares, strict=True) if share}})
        tie("tendon", [DRIVER_TURN * constant, 0, 0, 0, 0], tendon1=name)


def _tendon(tendon: ElementTree.Element, name: str, joints: dict[str, float], square: float = 0.0, cube: float = 0.0) -> None:
    """Add a spring that is stretched by joints, times factors, and whose force is ``square`` x^2 + ``cube`` x^3."""
    spring = ElementTree.SubElement(tendon, "fixed", name=name, springlength="0", stiffness=words([0.0, square, cube]))
    for joint, factor in joints.items():
        ElementTree.SubElement(spring, "joint", joint=joint, coef=f"{factor:.9g}")


STIFFNESS_REACH = 0.01
"""Stretch of a spring's tendons by its largest stiffness, rad and lengths of the chain."""


def _stretched_by(chain: Chain, kind: str, k: int, numbers: dict[str, float]) -> dict[str, float]:
    """Return how far a spring of a link is stretched by each joint, and by the numbers, by which its joints are at rest."""
    stretched = dict[str, float]()
    for joint, factor in chain.springs.length_of(kind).items():
        stretched[f"{joint}{k}"] = factor
        first, second = JOINT_VARIABLES.get(joint, ("", ""))
        for name, share in (first, 1 / DEFAULT_SEGMENTS), (second, ALONG[k]):
            if name in numbers:
                stretched[name] = stretched.get(name, 0.0) - factor * share * numbers[name]
    return stretched


# ----------------------------------------------------------------------------------------------------------------------
# Masses and damping: those with which the chain has the device's first mode.


@dataclasses.dataclass(frozen=True, eq=False)
class MotionByMass:
    """What gives a chain its first mode.

    Attributes:
        masses: Of the base and the links, kg.
        armature, damping: Of the joints of each kind in the middle of the chain, kg m2 or kg, and N m s/rad or N s/m.
        remark: Their first mode beside the device's, a sentence.
    """

    masses: Array
    armature: dict[str, float]
    damping: dict[str, float]
    remark: str


CONTACT = {"friction": "1", "priority": "1", "solref": "0.002 1", "solimp": "0.98 0.999 0.001"}
"""Friction of a link with other bodies, and a contact that yields less than the finger: MuJoCo's own gives way by half a
millimetre to 0.1 N on links of some grams."""
LINK_RADIUS = 0.12
"""Radius of the links in lengths of the chain."""
LARGEST_STEP = 3e-3
"""Time step in s with which joints without coupling are stable; with it, the whole chain is with 2 ms."""
DEFAULT_DAMPING = 0.1
"""Damping ratio of the first mode where that of the silicone is not known."""
MAX_TILT = 3.0


def link_inertia(length: float, radius: float) -> Array:
    """Return the moments of inertia of a cylinder of mass 1 about its axis and across it, m2."""
    across = radius**2 / 4 + length**2 / 12
    return np.array([radius**2 / 2, across, across])


def motion_by_mass(model: ReducedModel, chain: Chain) -> MotionByMass:
    """Return masses, armature and damping of a chain; the masses grow or fall exponentially along it, so that its first mode
    has the frequency of the device's."""
    device, vibrating = model.first_mode, VibratingChain(model, chain)
    wanted = math.nan if device is None else device.frequency

    ratio = device.damping if device is not None and device.damping > 0.0 else DEFAULT_DAMPING
    # A damping of t times the stiffness of all joints has the ratio t w/2 at the angular frequency w. With steps h, damping
    # implicit and springs explicit, a mass m is stable up to a stiffness k with h^2 k = 4 m + 2 h t k.
    time = ratio / (math.pi * (wanted if math.isfinite(wanted) else vibrating.mode(vibrating.masses(0.0))[0]))
    vibrating.armature_time = max(LARGEST_STEP * (LARGEST_STEP - 2 * time) / 4, 0.0)

    def miss(tilt: float) -> float:
        return vibrating.mode(vibrating.masses(tilt))[0] - wanted

    tilt, low, high = 0.0, miss(-MAX_TILT), miss(MAX_TILT)
    if math.isfinite(wanted):
        tilt = float(brentq(miss, -MAX_TILT, MAX_TILT, xtol=1e-4)) if low * high < 0.0 else \
               -MAX_TILT if abs(low) < abs(high) else MAX_TILT  # fmt: skip
    masses = vibrating.masses(tilt)
    frequency, shares = vibrating.mode(masses)
    time = ratio / (math.pi * frequency) / sum(shares.values())
    damping = {kind: time * vibrating.stiffness[kind] for kind in chain.springs.kinds}
    armature = {kind: vibrating.armature_time * stiffest for kind, stiffest in vibrating.stiffest.items()}
    remark = f"first mode at {reduction.in_kPa(vibrating.pressure)} kPa: {frequency:.4g} Hz, damping ratio {ratio:.3g}"
    if device is None:
        remark += "; that of the device is not known"
    else:
        known = f"{device.damping:.3g}" if device.damping > 0.0 else f"not known, so {DEFAULT_DAMPING:g} is assumed"
        remark += f"; of the device: {wanted:.4g} Hz, damping ratio {known}"
    return MotionByMass(masses, armature, damping, remark)


class VibratingChain:
    """The chain at the pressure of the device's known first mode, as linear equations of its joints.

    Attributes:
        pressure: Pa; over several that of each.
        stiffness, stiffest: Of the springs of each kind in the middle of the chain, at this pressure and its largest.
        armature_time: Armature of the joints over their largest stiffness, s2.
    """

    def __init__(self, model: ReducedModel, chain: Chain):
        self._model, self._chain = model, chain
        self.pressure = model.first_mode.pressure if model.first_mode else sum(model.span) / 2
        linear, kinds = LinearChain(chain, self.pressure), chain.springs.kinds
        self._posture, self._K = linear.posture, linear.K
        self.stiffest, self.armature_time = chain.stiffest(), 0.0
        self.stiffness = {
            kind: float(of[0] * chain.springs.shares(kind)[0]) for kind, of in zip(kinds, linear.stiffness, strict=True)
        }
        half = bool(model.case.actuator.cut_planes) and model.case.actuator.dimension != 2
        moving = [kind for kind in kinds if not half or kind in ("hinge", "slide", "shear")]
        self._used = [linear.joints.index(f"{kind}{k}") for k in range(DEFAULT_SEGMENTS) for kind in moving]
        self._diagonal, self._stiffest = np.zeros(len(self._K)), np.zeros(len(self._K))
        for kind, stiffness in zip(kinds, linear.stiffness, strict=True):
            own = [linear.joints.index(f"{kind}{k}") for k in range(DEFAULT_SEGMENTS)]
            self._diagonal[own], self._stiffest[own] = stiffness, self.stiffest[kind] / chain.springs.shares(kind)

    def masses(self, tilt: float) -> Array:
        """Return masses of base and links that together are the device's, kg."""
        lengths = np.array([0.5, *[1.0] * (DEFAULT_SEGMENTS - 1), 0.5])
        masses = lengths * np.exp(tilt * np.linspace(-1.0, 1.0, DEFAULT_SEGMENTS + 1))
        return np.asarray(self._model.mass * masses / masses.sum())

    def mode(self, masses: Array) -> tuple[float, dict[str, float]]:
        """Return the frequency in Hz of the first mode, and the share of each kind of joint in a damping of all joints in
        proportion to their stiffness."""
        M, posture = np.diag(self.armature_time * self._stiffest), self._posture
        link = self._chain.length / DEFAULT_SEGMENTS
        for k, mass in enumerate(masses[1:]):
            turned, R = posture.motion[: k + 1, :, 3:].reshape(-1, 3), posture.rotations[k]
            moved = posture.motion[: k + 1, :, :3].reshape(-1, 3) + np.cross(turned, posture.centres[k] - posture.place)
            inertia = R * link_inertia(link * (0.5 if k == len(masses) - 2 else 1.0), LINK_RADIUS * self._chain.length) @ R.T
            n = len(moved)
            M[:n, :n] += mass * (moved @ moved.T + turned @ inertia @ turned.T)
        used = np.ix_(self._used, self._used)
        values, shapes = scipy.linalg.eigh(self._K[used], M[used], subset_by_index=[0, 0])
        shape = np.zeros(len(self._K))
        shape[self._used] = shapes[:, 0]
        by_joint = (self._diagonal * shape**2 / values[0]).reshape(DEFAULT_SEGMENTS, -1).sum(axis=0)
        return math.sqrt(values[0]) / (2 * math.pi), dict(zip(JOINTS, by_joint.tolist(), strict=True))


def words(values: Iterable[float]) -> str:
    """Return numbers as an attribute of MJCF."""
    return " ".join(f"{value:.9g}" for value in values)


MOTIONS = (*actuator.AXES, *(f"turn_{axis}" for axis in actuator.AXES))
LOADS = (*(f"f{axis}" for axis in actuator.AXES), *(f"m{axis}" for axis in actuator.AXES))


# ----------------------------------------------------------------------------------------------------------------------
# Tables: units in the heads of the columns, or beside the values.


def columns(model: ReducedModel) -> dict[str, Array]:
    """Return the columns of the table, each over its states, by their heads, which end in the unit."""
    states, ratios, m = model.states, model.case.actuator.ratios, len(model.names)

    def of(name: str, *shape: int) -> Array:
        return np.array([getattr(state, name) for state in states]).reshape(-1, *shape)

    own = [f"_cavity{k + 1}" for k in range(len(ratios))] if m > 1 else [""]
    by = [f"_by_cavity{k + 1}" for k in range(len(ratios))] if len(ratios) > 1 else [""]
    by_table = by if m > 1 else [""]
    columns = {f"{name}_Pa": values for name, values in zip(model.names, of("pressure", m).T, strict=True)}
    if m < len(ratios):
        columns |= {f"pressure_cavity{k}_Pa": ratio * of("pressure") for k, ratio in enumerate(ratios, 1)}
    columns |= {f"tip_{axis}_m": of("position", 3)[:, i] for i, axis in enumerate(actuator.AXES)}
    turned = np.array([reduction.quaternion(state.rotation) for state in states])
    columns |= {f"tip_q{axis}_1": turned[:, i] for i, axis in enumerate("wxyz")}
    columns |= {f"added_volume{cavity}_m3": of("volume", m)[:, i] for i, cavity in enumerate(own)}
    for (i, cavity), (k, other) in itertools.product(enumerate(own), enumerate(by_table)):
        columns[f"volume_rate{cavity}{other}_m3_per_Pa"] = of("volume_rate", m, m)[:, i, k]
    for (i, motion), (k, other) in itertools.product(enumerate(MOTIONS), enumerate(by)):
        columns[f"rate_{motion}{other}_{'m' if i < 3 else 'rad'}_per_Pa"] = of("jacobian", 6, len(ratios))[:, i, k]
    for i, motion in enumerate(MOTIONS):
        for j, load in enumerate(LOADS[: i + 1]):
            unit = f"{'m' if i < 3 else 'rad'}_per_{'N' if j < 3 else 'Nm'}"
            columns[f"compliance_{motion}_{load}_{unit}"] = of("compliance", 6, 6)[:, i, j]
    blocked = np.array([model.blocked(state) for state in states]).reshape(-1, 6, m)
    for (i, load), (k, other) in itertools.product(enumerate(LOADS), enumerate(by_table)):
        columns[f"blocked_{load}{other}_{'N' if i < 3 else 'Nm'}_per_Pa"] = blocked[:, i, k]
    areas = np.array([model.effective_area(state) for state in states]).reshape(-1, m)
    columns |= {f"effective_area{cavity}_m2": areas[:, k] for k, cavity in enumerate(own)}
    arcs = np.array([model.constant_curvature(state) for state in states])
    arc_heads = ("curvature_per_m", "arc_length_m", "bending_direction_rad")
    columns |= {head: arcs[:, i] for i, head in enumerate(arc_heads)} | {"max_stretch_1": of("stretch")}
    if np.isfinite(states[-1].spread).all():
        heads = (
            *(f"tip_{axis}_ci95_m" for axis in actuator.AXES), *(f"turn_{axis}_ci95_rad" for axis in actuator.AXES),
            *(f"added_volume{cavity}_ci95_m3" for cavity in own),
        )  # fmt: skip
        columns |= {head: of("spread", 6 + m)[:, i] for i, head in enumerate(heads)}
    return columns


def table_csv(model: ReducedModel) -> str:
    """Return the table as CSV; empty cells where a value is not known."""
    out = io.StringIO(newline="")
    writer = csv.writer(out, lineterminator="\n")
    known = columns(model)
    writer.writerow(known)
    for row in np.column_stack([*known.values()]).tolist():
        writer.writerow([f"{value:.12g}" if math.isfinite(value) else "" for value in row])
    return out.getvalue()


def table_json(model: ReducedModel) -> str:
    """Return the table as JSON, with what it is of, where it ends and its errors in between."""
    known, (low, high) = columns(model), (np.array(end).tolist() for end in model.span)
    rows = {head: [files.json_number(value) for value in values.tolist()] for head, values in known.items()}
    about = {
        "written_by": deck.WRITTEN_BY, "case": model.case.name, "device": type(model.case.actuator).__name__, "tip": model.face,
        "support_m": model.base.tolist(), "length_m": model.length, "from_Pa": low, "to_Pa": high,
        "not_reached_Pa": model.not_reached.tolist(), "notes": model.notes,
        "errors_between_states": {
            "position_per_length": model.errors["position"], "angle_deg": model.errors["angle_deg"],
            "volume_relative": model.errors["volume"], "compliance_relative": model.errors["compliance"],
        },
        "interpolation": "position, rotation vector, volume: cubic Hermite with the rates; compliance: cubic spline",
        "table": rows,
    }  # fmt: skip
    return json.dumps(about, indent=1) + "\n"


# ----------------------------------------------------------------------------------------------------------------------
# A unit for co-simulation (FMI 2.0, by pythonfmu): the interpolant, and loads on the tip by its compliance.


EXTRA = "fmu"
"""The extra of this project that brings pythonfmu."""
PROGRAM = Path(__file__).with_name("tip_unit.py")


def fmu(model: ReducedModel) -> bytes:
    """Return a unit for co-simulation; loads in directions of unknown compliance do not move it."""
    from pythonfmu import FmuBuilder

    low, high = map(reduction.in_kPa, model.span)
    program, curves = PROGRAM.read_bytes(), model.curves
    text = f"{deck.WRITTEN_BY}: the tip of {model.case.name}, {low} to {high} kPa; SI units"
    # A row for each derivative at each node, the last pressure changing fastest in both; 0 where a compliance is not known.
    knots = np.nan_to_num(curves.knots).reshape(-1, 2 ** len(curves.axes), curves.knots.shape[-1])
    table = {"description": text, "pressures": model.names, "axes": [x.tolist() for x in curves.axes], "knots": knots.tolist()}
    # Units of one name in a process would share a module, so the name follows from what the unit holds.
    digest = hashlib.sha256(program + json.dumps(table).encode()).hexdigest()[:12]
    name = re.sub(r"[^A-Za-z0-9_]", "_", f"softmodels_{model.case.name[:40]}_{digest}")
    before = list(sys.path)
    with tempfile.TemporaryDirectory() as folder:
        script, data, made = (Path(folder) / file for file in (f"{name}.py", "table.json", "made.fmu"))
        script.write_bytes(program)
        data.write_text(json.dumps({"identifier": name, **table}), encoding="utf-8")
        try:
            FmuBuilder.build_FMU(script, made, project_files=[data])
        finally:
            sys.path[:] = before
            sys.modules.pop(name, None)
        return made.read_bytes()


# ----------------------------------------------------------------------------------------------------------------------
# Which file is which.


WRITERS: dict[str, Callable[[ReducedModel], str | bytes]] = {"csv": table_csv, "json": table_json, "mjcf": mjcf, "fmu": fmu}
ENDINGS = {".csv": "csv", ".json": "json", ".xml": "mjcf", ".fmu": "fmu"}
"""What a file is by its ending."""


def write(model: ReducedModel, file: Path, kind: str = "") -> Path:
    """Write a reduced model for another program, as one of `WRITERS`; by the file's ending if the kind is empty.

    Raises:
        CaseError: Another kind or ending, or a file that this program has not written.
        RunError, ImportError: The model cannot be written as that, or what writes it is not installed.
    """
    made = WRITERS[kind_of(file, kind)](model)
    files.write_bytes(file, made if isinstance(made, bytes) else made.encode())
    return file


def is_own(file: Path) -> bool:
    """Return whether a file is a reduced model of this program, which may be replaced."""
    try:
        content = files.read_file(file)
    except OSError:
        return False
    if content.startswith(b"PK"):
        return re.search(rb"resources/softmodels_\w+\.py", content) is not None
    head = content[:4000].decode(errors="replace")
    return deck.WRITTEN_BY in head or head.startswith(("pressure_Pa,", "pressure_cavity1_Pa,"))


def kind_of(file: Path, kind: str = "") -> str:
    """Return the kind of a file; `CaseError` or `ImportError` as `write`."""
    chosen = kind or ENDINGS.get(file.suffix.lower(), "")
    if kind and kind not in WRITERS:
        raise CaseError(f"as {kind!r} no reduced model is written; {errors.known_are(kind, WRITERS)}")
    if not chosen:
        named = ", ".join(f"{ending} ({name})" for ending, name in ENDINGS.items())
        raise CaseError(f"{file} has no ending of a reduced model; take {named}, or name the kind (kind=..., --as)")
    if file.is_dir():
        raise CaseError(f"{file} is a folder; name a file")
    if chosen == "fmu":
        errors.required("pythonfmu", EXTRA)
    return chosen
