"""A support at one end, and a tip that is free to move or held along the lift, as in a test of blocked force."""

from __future__ import annotations

from typing import Any

from geometries.actuator import Actuator, Hold
from geometries.fields import choice_field


def tip_field(free: str = "tip", held: str = "its face") -> Any:
    """Return a dataclass field for the tip; the texts say what is free to move and what is held."""
    return choice_field("free", ("free", "held"), f"{free} free to move, or {held} held along z (blocked force)")


class HeldTip(Actuator):
    """A device with the faces "support", which is clamped, and "tip"; a device is a dataclass of it with a `tip_field`."""

    tip: str

    @property
    def holds(self) -> tuple[Hold, ...]:
        held = (Hold("tip", self.lift),) if self.tip == "held" else ()
        return (Hold("support", None), *held)

    @property
    def blocked(self) -> str | None:
        return "tip" if self.tip == "held" else None

    @property
    def pushed(self) -> str | None:
        return "tip" if self.tip == "free" else None
