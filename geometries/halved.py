"""Devices with one mirror plane, y = 0, of which a half or the whole is modelled."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

from geometries.actuator import Actuator, CutPlane
from geometries.fields import choice_field
from geometries.mirroring import Mirror


def part_field(device: str) -> Any:
    """Return a dataclass field: how much of a device is modelled; the text is the device in a word."""
    return choice_field("half", ("half", "full"), f"half up to the mirror plane, or the full {device}")


class Halved(Actuator):
    """A device of which the half y > 0 may be modelled; the cut is "plane0"."""

    @property
    @abstractmethod
    def halved(self) -> bool:
        """Whether a half is modelled."""

    @property
    def copies(self) -> int:
        return 2 if self.halved else 1

    @property
    def cut_planes(self) -> tuple[CutPlane, ...]:
        return (CutPlane("plane0", (0.0, -1.0, 0.0)),) if self.halved else ()


class MirroredHalf(Halved):
    """A device whose full mesh is that of its half, mirrored; a device is a dataclass of it with a `part_field`."""

    part: str

    @property
    def halved(self) -> bool:
        return self.part == "half"

    @property
    def fuller(self) -> str:
        return "--part full"

    @property
    def mirrors(self) -> tuple[Mirror, ...]:
        return (Mirror("plane0", 1, {}),) if self.part == "full" else ()
