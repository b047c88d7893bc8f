"""Names of faces and regions, as parts are told where they are: split, and looked up on a device."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

from geometries import Actuator
from geometries.openings import cavity_roles
from softmodels.mechanics.parts import PartError


def names_in(text: str) -> list[str]:
    """Names with commas between."""
    return [name.strip() for name in text.split(",") if name.strip()]


def faces_of(actuator: Actuator) -> tuple[str, ...]:
    """Faces of a device that can be reinforced."""
    return (*actuator.faces, "cavity")


def check_faces(where: str, actuator: Actuator, names: Sequence[str]) -> None:
    """Raise `PartError` for names that are no faces of the device."""
    for name in names:
        if name not in faces_of(actuator):
            raise PartError(
                f"{where}: {name!r} is no face of {type(actuator).__name__}; it has {', '.join(faces_of(actuator))}"
            )


def check_on_mesh(where: str, actuator: Actuator, names: Sequence[str]) -> None:
    """Raise `PartError` for names that the device's mesh will have no face of, as far as that is known before it is made."""
    if actuator.unbonded is None:
        return
    others = (hold.role for hold in actuator.holds), (plane.name for plane in actuator.cut_planes), actuator.unbonded
    known = list(dict.fromkeys([*actuator.faces, *cavity_roles(actuator), *itertools.chain(*others)]))
    for name in names:
        if name not in known:
            raise PartError(f"{where}: {type(actuator).__name__} has no face {name!r}; it has {', '.join(known)}")


def check_regions(where: str, actuator: Actuator, names: Sequence[str]) -> None:
    """Raise `PartError` for names that are no regions of the device."""
    for name in names:
        if name not in actuator.regions:
            known = f"its regions are {', '.join(actuator.regions)}" if actuator.regions else "it is of one piece"
            raise PartError(f"{where}: {type(actuator).__name__} has no region {name!r}; {known}")
