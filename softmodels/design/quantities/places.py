"""Positions of named points: rises, coordinates, and figures of a device derived from them."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from softmodels.common.arrays import Array
from softmodels.design.quantities.base import DesignQuantity, Measure, Slopes, register_quantity

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from softmodels.design.body import DesignedBody
    from softmodels.mechanics.system import State


AXES = ("x", "y", "z")
STEP = 1e-5
"""Step of the central differences of a device's figures by probe positions, relative to the size."""


class PlacesMeasure(Measure):
    """A function of probe positions.

    Args:
        design: The meshed device.
        function: Of the probes' places and displacements by name, device coordinates in m, each shape (3,).
        names: The probes it depends on.
    """

    def __init__(
        self, design: DesignedBody, names: tuple[str, ...],
        function: Callable[[Mapping[str, Array], Mapping[str, Array]], float],
    ):  # fmt: skip
        self.design, self.names, self.function = design, names, function

    def slopes(self, state: State | None) -> Slopes:
        probes = self.design.probes
        rest = {name: probes.place(name) for name in self.names}
        moved = {name: probes.displacement(name) for name in self.names}
        by_w = np.zeros(self.design.system.n)
        by_X = np.zeros(self.design.motion.entries)
        step = STEP * self.design.system.length_unit
        for name in self.names:
            by_place, by_displacement = np.zeros(3), np.zeros(3)
            for axis in range(3):
                shift = step * np.eye(3)[axis]
                by_place[axis], by_displacement[axis] = (
                    (
                        self.function(*_shifted(rest, moved, which, name, shift))
                        - self.function(*_shifted(rest, moved, which, name, -shift))
                    )
                    / (2 * step)
                    for which in (0, 1)
                )
            probes.add(by_w, by_X, name, by_place, by_displacement)
        return Slopes(self.function(rest, moved), self.design.system.by_unknowns(by_w).copy(), 0.0, by_X)


def _shifted(
    rest: dict[str, Array], moved: dict[str, Array], which: int, name: str, shift: Array
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Return the places and displacements with one probe's place (0) or displacement (1) shifted."""
    found = [dict(rest), dict(moved)]
    found[which][name] = found[which][name] + shift
    return found[0], found[1]


def _probe(design: DesignedBody, name: str) -> str:
    """Return the probe's name; the device's own first one if empty."""
    known = design.system.body.actuator.probes
    if not name:
        return design.system.body.actuator.gauge
    if name not in known:
        raise ValueError(f"the device has no probe {name!r}; it has {', '.join(known)}")
    return name


@register_quantity
@dataclasses.dataclass(frozen=True, kw_only=True)
class Rise(DesignQuantity):
    """Displacement of a probe along the lift.

    Attributes:
        of: The probe; the device's first one if empty.
    """

    name: ClassVar = "rise"
    unit: ClassVar = "m"
    help: ClassVar = "displacement of a probe along the lift"

    of: str = ""

    @property
    def title(self) -> str:
        return f"rise of {self.of}" if self.of else "rise"

    def measure(self, design: DesignedBody) -> Measure:
        name, lift = _probe(design, self.of), np.asarray(design.system.body.actuator.lift)
        return PlacesMeasure(design, (name,), lambda rest, moved: float(moved[name] @ lift))


@register_quantity
@dataclasses.dataclass(frozen=True, kw_only=True)
class Height(DesignQuantity):
    """Height of a probe under pressure: undeformed height plus rise.

    A design changes both, so the device whose top is highest is not the one whose top rises most.

    Attributes:
        of: The probe; the device's first one if empty.
    """

    name: ClassVar = "height"
    unit: ClassVar = "m"
    help: ClassVar = "height of a probe under pressure, along the lift from the origin of the device's axes"

    of: str = ""

    @property
    def title(self) -> str:
        return f"height of {self.of}" if self.of else "height"

    def measure(self, design: DesignedBody) -> Measure:
        name, lift = _probe(design, self.of), np.asarray(design.system.body.actuator.lift)
        return PlacesMeasure(design, (name,), lambda rest, moved: float((rest[name] + moved[name]) @ lift))


@register_quantity
@dataclasses.dataclass(frozen=True, kw_only=True)
class Place(DesignQuantity):
    """Coordinate of a probe.

    Attributes:
        of: The probe; the device's first one if empty.
        axis: "x", "y" or "z" of the device.
    """

    name: ClassVar = "place"
    unit: ClassVar = "m"
    help: ClassVar = "coordinate of a probe in the device's axes"

    of: str = ""
    axis: str = "z"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.axis not in AXES:
            raise ValueError(f"axis is {self.axis!r}; it is one of {', '.join(AXES)}")

    @property
    def title(self) -> str:
        return f"place {self.axis} of {self.of}" if self.of else f"place {self.axis}"

    def measure(self, design: DesignedBody) -> Measure:
        name, axis = _probe(design, self.of), AXES.index(self.axis)
        return PlacesMeasure(design, (name,), lambda rest, moved: float(rest[name][axis] + moved[name][axis]))


@register_quantity
@dataclasses.dataclass(frozen=True, kw_only=True)
class DeviceFigure(DesignQuantity):
    """A figure of this kind of device derived from its probes, such as a slab's lift angle.

    Attributes:
        of: Its column, such as ``lift_angle_deg``; the unit is the column's.
    """

    name: ClassVar = "figure"
    unit: ClassVar = "1"
    help: ClassVar = "a figure of this kind of device derived from its probes, in its column's unit"

    of: str = ""

    @property
    def title(self) -> str:
        return self.of

    def measure(self, design: DesignedBody) -> Measure:
        actuator = design.system.body.actuator
        places = {name: np.asarray(place) for name, place in actuator.probes.items()}
        known = actuator.device_figures({name: (p[0], p[1], p[2]) for name, p in places.items()})
        if self.of not in known:
            raise ValueError(
                f"figure {self.of!r} is not defined for this device; "
                + (f"it has {', '.join(known)}" if known else "it has none")
            )

        def value(rest: Mapping[str, Array], moved: Mapping[str, Array]) -> float:
            now = {name: rest[name] + moved[name] for name in rest}
            return actuator.device_figures({name: (p[0], p[1], p[2]) for name, p in now.items()})[self.of]

        return PlacesMeasure(design, tuple(places), value)
