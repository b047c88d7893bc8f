"""Where a fit to outlines starts: volumes from the heights, then the law's numbers from the pressures, without a search.

How a device bulges at a given volume hardly depends on how stiff it is: one path of the law at any modulus gives the added
volume of each measured height. At given volumes the pressure is linear in those numbers of a law that are stresses, up to
the small change of shape (virtual work), so that they follow from the readings by linear least squares.

Dead loads bear a share of the pressure that the law's numbers do not change, to first order: at a given volume the pressure is
homogeneous in stresses and loads together (Euler). How a loaded device hangs does depend on how stiff it is, so its path is
followed again with the modulus that the readings lead to, until that settles.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from softmodels.fitting.outlines.device_model import DeviceModel
from softmodels.fitting.outlines.reading import OutlineFitError
from softmodels.fitting.problem import CannotEvaluate
from softmodels.mechanics.newton import NoConvergence
from softmodels.mechanics.system import State
from softmodels.path.continuation import LARGEST_GROWTH, trace
from softmodels.path.points import PathEnd

Array = npt.NDArray[np.float64]

SETTLED = 0.03
"""Relative change of the modulus below which the shapes of a loaded device are those of the readings."""
ROUNDS = 12
MOST_BORNE = 0.7
"""Pressure that dead loads may take, as a share of what the silicone takes, where a reading tells of the silicone."""
FARTHEST = 3.0
"""Largest factor on the modulus in one round."""


@dataclasses.dataclass(frozen=True, eq=False)
class Plain:
    """A device under the plainest material that is as stiff as its readings, at the measured heights.

    Attributes:
        values: The law's numbers, of one modulus alone.
        volumes: Added volumes in m3, shape (n,).
        hangs: Added volume in m3 at zero pressure; 0 without loads.
        states: The states there.
        borne: Pressures in Pa that the dead loads take, whatever the modulus, shape (n,).
        elastic: Pressures in Pa that the silicone takes, shape (n,).
    """

    values: dict[str, float]
    volumes: Array
    hangs: float
    states: list[State]
    borne: Array
    elastic: Array

    @property
    def silent(self) -> npt.NDArray[np.bool_]:
        """Where the loads take so much of the pressure that a reading tells nothing of the silicone, shape (n,)."""
        return np.abs(self.borne) > MOST_BORNE * self.elastic


def plain_path(model: DeviceModel, heights: Array, pressures: Array) -> Plain:
    """Follow the device to the measured heights.

    Args:
        model: The device and its law.
        heights: Heights of the top in m.
        pressures: Readings in Pa, by which the modulus of a loaded device settles.

    Raises:
        OutlineFitError: The device cannot rise as high as was measured, or does not bear its loads however stiff it is.
    """
    why = ""
    for _ in range(ROUNDS):
        try:
            found = _plain_at(model, heights)
        except CannotEvaluate as error:
            if not model.loaded:
                raise
            model.modulus, why = 2.0 * model.modulus, str(error)
            continue
        if not model.loaded:
            return found
        told = ~found.silent if not found.silent.all() else found.elastic == found.elastic.max()
        # A median: one wrong reading must not change the shapes.
        factor = float(np.median((pressures[told] - found.borne[told]) / found.elastic[told]))
        if not abs(factor - 1.0) > SETTLED:
            return found
        model.modulus *= min(max(factor, 1 / FARTHEST), FARTHEST)
        why = f"the modulus does not settle near {model.modulus / 1e3:.4g} kPa"
    raise OutlineFitError(
        f"the loads of the case and the measured pressures lead to no stiffness ({why}); check masses, density and forces, and "
        "which way gravity pulls"
    )


def _plain_at(model: DeviceModel, heights: Array) -> Plain:
    values = model.choice.from_modulus(model.modulus)
    volumes, hangs = volumes_of(model, values, heights)
    states = model.states(values, volumes)
    model.set_parameters(values)
    whole = np.array([model.pressure(state) for state in states])
    elastic = whole
    if model.loaded:
        names = [name for name in model.choice.names if model.choice.unit(name) == "Pa"]
        slopes = [model.slopes(state, names).pressure for state in states]
        elastic = np.array([sum(values[name] * slope[name] for name in names) for slope in slopes])
    return Plain(values, volumes, hangs, states, whole - elastic, elastic)


def starts(
    model: DeviceModel,
    heights: Array,
    pressures: Array,
    errors: Array,
    held: Mapping[str, float] = MappingProxyType({}),
) -> tuple[list[dict[str, float]], Plain]:
    """Starting values of the law, best first, and the path that they come from.

    Args:
        model: The device and its law.
        heights: Heights of the top in m.
        pressures: Readings in Pa.
        errors: Their standard errors in Pa, or anything in proportion.
        held: Numbers of the law that are given.

    Raises:
        OutlineFitError: See `plain_path`; or its shadow at zero pressure is not straight, see `Hanging.check`.
    """
    found = plain_path(model, heights, pressures)
    plain = found.values
    target, simulated = (pressures - found.borne) / errors, found.elastic / errors
    factor = max(float(simulated @ target / (simulated @ simulated)), 1e-6)
    scaled = {name: value * factor if model.choice.unit(name) == "Pa" else value for name, value in plain.items()}
    scaled |= held
    names, free = model.choice.names, [name for name in model.choice.names if name not in held]
    if not (model.choice.law.linear and free) or len(heights) < len(plain):
        return [scaled], found
    A = np.array([[model.slopes(state, names).pressure[name] for name in names] for state in found.states])
    A /= errors[:, None]
    given = A @ [held.get(name, 0.0) for name in names]
    A = A[:, [name not in held for name in names]]
    size = np.linalg.norm(A, axis=0)
    solution, *_ = np.linalg.lstsq(A / size, target - given, rcond=1e-6)
    linear = {**held, **dict(zip(free, (solution / size).tolist(), strict=True))}
    first = names[0]
    if linear[first] <= 0.1 * scaled[first]:
        return [scaled], found
    return [linear, scaled], found


def volumes_of(model: DeviceModel, values: dict[str, float], heights: Array) -> tuple[Array, float]:
    """Added volumes in m3 at which the device, with these values, is as high as measured (m), and that at which it hangs.

    Raises:
        CannotEvaluate: It does not bear its loads.
        OutlineFitError: It does not rise so high.
    """
    from scipy.interpolate import PchipInterpolator

    eq, rest = model.system, model.rest_volume
    lengths = model.set_parameters(values)
    model.hanging.check(values, lengths)
    goals = rest * np.concatenate([np.linspace(0.05, 1.0, 12), np.geomspace(1.2, 0.95 * LARGEST_GROWTH, 30)])
    rises, volumes = list[float](), list[float]()
    highest = float(heights.max())
    path, why = model.path("volume"), ""
    try:
        for point in trace(path, (model.begins(path) + goals).tolist()):
            rise = model.height(point.state)
            if not rises or rise > rises[-1]:
                rises.append(rise)
                volumes.append((point.state.V - rest) * eq.volume_unit)
            if rise > 1.02 * highest:
                break
    except (PathEnd, NoConvergence, CannotEvaluate) as end:
        why = f" ({end})"
    if not rises or rises[-1] < highest:
        raise OutlineFitError(
            f"the device of the case does not rise above {max(rises, default=0.0) * 1e3:.4g} mm{why}, but an outline is "
            f"{highest * 1e3:.4g} mm high: check the geometry and the photographs' scale"
        )
    found = np.asarray(PchipInterpolator(rises, volumes)(np.maximum(heights, 0.0)))
    if not math.isfinite(found.sum()) or found.min() <= volumes[0]:
        raise OutlineFitError("an outline has no height to tell the cavity's volume by")
    return found, volumes[0]
