"""Where a fit to outlines starts: volumes from the heights, then the law's numbers from the pressures, without a search.

How a device bulges at a given volume hardly depends on how stiff it is: one path of the law at any modulus gives the added
volume of each measured height. At given volumes the pressure is linear in those numbers of a law that are stresses, up to
the small change of shape (virtual work), so that they follow from the readings by linear least squares.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from softmodels.fitting.outlines.device_model import DeviceModel
from softmodels.fitting.outlines.reading import OutlineFitError
from softmodels.fitting.problem import CannotEvaluate
from softmodels.mechanics.newton import NoConvergence
from softmodels.path.continuation import LARGEST_GROWTH, Continuation, trace
from softmodels.path.points import PathEnd
from softmodels.path.quantities import AddedVolume

Array = npt.NDArray[np.float64]

MODULUS = 30e3
"""Shear modulus in Pa of the path that only serves its shapes."""


def starts(
    model: DeviceModel, heights: Array, pressures: Array, errors: Array, modulus: float = MODULUS
) -> tuple[list[dict[str, float]], Array]:
    """Starting values of the law, best first, and the added volumes in m3.

    Args:
        model: The device and its law.
        heights: Heights of the top in m.
        pressures: Readings in Pa.
        errors: Their standard errors in Pa, or anything in proportion.
        modulus: Shear modulus in Pa of the path that only serves its shapes.

    Raises:
        OutlineFitError: The device cannot rise as high as was measured.
    """
    plain = model.choice.from_modulus(modulus)
    volumes = volumes_of(model, plain, heights)
    states = model.states(plain, volumes)
    model.set_parameters(plain)
    target = pressures / errors
    simulated = np.array([model.pressure(state) for state in states]) / errors
    factor = max(float(simulated @ target / (simulated @ simulated)), 1e-6)
    scaled = {name: value * factor if model.choice.unit(name) == "Pa" else value for name, value in plain.items()}
    if not model.choice.law.linear or len(heights) < len(plain):
        return [scaled], volumes
    names = model.choice.names
    A = np.array([[model.slopes(state, names).pressure[name] for name in names] for state in states]) / errors[:, None]
    size = np.linalg.norm(A, axis=0)
    found, *_ = np.linalg.lstsq(A / size, target, rcond=1e-6)
    linear = dict(zip(names, (found / size).tolist(), strict=True))
    first = names[0]
    if linear[first] <= 0.1 * scaled[first]:
        return [scaled], volumes
    return [linear, scaled], volumes


def volumes_of(model: DeviceModel, values: dict[str, float], heights: Array) -> Array:
    """Added volumes in m3 at which the device, with these values, is as high as measured (m).

    Raises:
        OutlineFitError: It does not rise so high.
    """
    from scipy.interpolate import PchipInterpolator

    eq = model.system
    lengths = model.set_parameters(values)
    rest = model.rest_volume
    goals = rest * np.concatenate([np.linspace(0.05, 1.0, 12), np.geomspace(1.2, 0.95 * LARGEST_GROWTH, 30)])
    rises, volumes = [0.0], [0.0]
    highest = float(heights.max())
    model.paths += 1
    why = ""
    try:
        for point in trace(Continuation(model.solver, AddedVolume()), goals.tolist()):
            rise = float(model.curve(point.state, lengths).nodes[0, 0, 1])
            if rise > rises[-1]:
                rises.append(rise)
                volumes.append((point.state.V - rest) * eq.volume_unit)
            if rise > 1.02 * highest:
                break
    except (PathEnd, NoConvergence, CannotEvaluate) as end:
        why = f" ({end})"
    if rises[-1] < highest:
        raise OutlineFitError(
            f"the device of the case does not rise above {rises[-1] * 1e3:.4g} mm{why}, but an outline is "
            f"{highest * 1e3:.4g} mm high: check the geometry and the photographs' scale"
        )
    found = np.asarray(PchipInterpolator(rises, volumes)(np.maximum(heights, 0.0)))
    if not math.isfinite(found.sum()) or found.min() <= 0.0:
        raise OutlineFitError("an outline has no height to tell the cavity's volume by")
    return found
