"""Dead loads of a measured device: constants of the bench, which act in every photograph, that at zero pressure too."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geometries import Actuator
from softmodels.fitting.problem import FitError
from softmodels.materials.material import Material
from softmodels.mechanics.dead_loads import LoadPart
from softmodels.mechanics.load_directions import ALONG
from softmodels.mechanics.loads import DirectedLoad, FaceLoad, weighed
from softmodels.mechanics.parts import Part, PartError


def measured_parts(parts: Sequence[Part], actuator: Actuator, material: Material | None) -> tuple[Part, ...]:
    """A case's parts as a fit takes them: the weight that of the case's silicone, whatever the fitted law is called.

    Args:
        parts: Of the case.
        actuator: The device as it is fitted.
        material: The case's; None if nothing is known of it.

    Raises:
        FitError: A load that tilts the outline, or one of which nobody says how large it was.
    """
    for load in (part for part in parts if isinstance(part, LoadPart)):
        _check(load, actuator)
    return tuple(parts) if material is None else weighed(parts, material)


def _check(load: LoadPart, actuator: Actuator) -> None:
    if not (
        isinstance(load, DirectedLoad)
        and load.arm == 2
        and abs(float(np.asarray(load.vector) @ np.asarray(actuator.lift))) > 1 - ALONG
    ):
        raise FitError(
            f"the case has a {load.where} that does not act along the device's axis; a fit takes outlines to be the same on "
            "both sides of it, so photograph the device upright, or leave the load out if it is small"
        )
    if isinstance(load, FaceLoad) and not load.kept:
        raise FitError(
            f"the case has a {load.where} whose size is requested; a fit takes loads that stay the same in all photographs, so "
            'give it an amount (amount = "0.2 N"), or leave it out'
        )
    try:
        load.check_on(actuator)
    except PartError as error:
        raise FitError(str(error)) from None
