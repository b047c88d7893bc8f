"""A hand for MuJoCo: equal fingers on a wrist, each the chain of one device with a pressure of its own."""

from __future__ import annotations

import copy
import dataclasses
import math
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from softmodels.case.entries import CaseError
from softmodels.common import files, schema
from softmodels.common.arrays import Array
from softmodels.decks import chains, reduction
from softmodels.decks.reduction import ReducedModel

WRIST = "wrist"
MAX_FINGERS = 12
NAMING = ("name", "joint", "joint1", "joint2", "tendon1", "tendon2", "body1", "body2")
"""Attributes that name what each finger has of its own; meshes are shared."""
OWN = ("contact", "tendon", "equality", "actuator")
"""Sections of which each finger has its own entries."""


@dataclasses.dataclass(frozen=True)
class Hand:
    """Fingers, from 2 to `MAX_FINGERS`, whose supports stand evenly on a circle about the wrist's z; they point along it at
    rest, and bend towards it. `CaseError` for another number, or no radius."""

    fingers: int
    radius: float = schema.length_field(0.0, "radius of the circle through the middles of the supports", zero=True)

    def __post_init__(self) -> None:
        schema.settle(self, CaseError)
        if not 2 <= self.fingers <= MAX_FINGERS:
            raise CaseError(f"a hand has from 2 to {MAX_FINGERS} fingers, not {self.fingers}")
        if not self.radius:
            raise CaseError("fingers stand on a circle about the wrist; give its radius, such as --radius 30mm")

    def check_room(self, points: Array) -> None:
        """Raise `CaseError` for fingers that stand in each other; each has these points (m, shape (n, 3)) at rest from the
        middle of its support, along the axes of `axes`."""
        _, inwards, sideways = points.T
        turn = math.pi / self.fingers
        # Each finger stays in its sector of the circle, whose sides it touches first with its inner corners.
        least = float(inwards.max() + np.abs(sideways).max() / math.tan(turn)) if self.fingers > 2 else float(inwards.max())
        if self.radius < least:
            shown = schema.shown(math.ceil(least * 1e4) / 1e4, "m")
            raise CaseError(f"{self.fingers} such fingers would stand in each other; their radius is {shown} at least")

    def axes(self, number: int) -> tuple[Array, Array]:
        """Return where the base of a finger stands (m), and in columns its directions: along it, towards which it bends, and
        the normal of that plane."""
        angle = math.tau * number / self.fingers
        outwards, along = np.array([math.cos(angle), math.sin(angle), 0.0]), np.array([0.0, 0.0, 1.0])
        return self.radius * outwards, np.column_stack([along, -outwards, np.cross(along, -outwards)])

    @property
    def remark(self) -> str:
        """What the file says of it."""
        away = schema.shown(self.radius, "m")
        return (
            f"{self.fingers} such fingers on the body {WRIST}, {away} from its z, along which they point; they bend towards it "
            "and touch each other and other bodies"
        )

    def of(self, finger: ElementTree.Element) -> None:
        """Make a hand of the MJCF of one finger, in place."""
        world = finger.find("worldbody")
        assert world is not None
        (base,) = world
        world.remove(base)
        wrist = ElementTree.SubElement(world, "body", name=WRIST)
        for number in range(self.fingers):
            own = _renamed(base, number)
            place, axes = self.axes(number)
            own.set("pos", chains.words(place))
            own.set("quat", chains.words(reduction.quaternion(axes)))
            wrist.append(own)
        for section in OWN:
            if (entries := finger.find(section)) is not None:
                of_finger = list(entries)
                for entry in of_finger:
                    entries.remove(entry)
                entries.extend(_renamed(entry, number) for number in range(self.fingers) for entry in of_finger)
        finger.insert(1, ElementTree.Comment(f" {self.remark} "))

    def write(self, model: ReducedModel, file: Path) -> Path:
        """Write the hand whose fingers are a reduced model, as MJCF; `CaseError` for fingers that stand in each other."""
        chain = chains.chain_of(model)
        self.check_room((model.points - chain.base) @ chain.axes)
        self.of(root := chains.element(model, chain))
        files.write_text(file, chains.as_text(root))
        return file


def check(file: Path | None, kind: str = "") -> None:
    """Raise `CaseError` unless a hand can be written to a file, as a kind or by its ending; see `chains.kind_of`."""
    if file is None:
        raise CaseError("several fingers need a file to be written to, such as hand.xml")
    if (chosen := chains.kind_of(file, kind)) != "mjcf":
        raise CaseError(f"several fingers are written as chains for MuJoCo (NAME.xml), not as {chosen}")


def _renamed(entry: ElementTree.Element, number: int) -> ElementTree.Element:
    """Return a copy of an element with the names of a finger, numbered from 0."""
    own = copy.deepcopy(entry)
    for element in own.iter():
        for name in NAMING:
            if given := element.get(name):
                element.set(name, f"finger{number + 1}_{given}")
    return own
