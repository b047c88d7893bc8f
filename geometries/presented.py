"""How commands and messages speak of a device: names, words, and what is worth showing of it."""

from __future__ import annotations

from typing import ClassVar


class Presented:
    """The part of `geometries.Actuator` that people read."""

    stem: ClassVar[str] = "device"
    """Name of its result files and default folder where a case has no name."""

    pressures: ClassVar[str] = "0:20"
    """Pressures in cm of water that its default bears, for the examples in a command's help."""

    silicone: ClassVar[str | None] = None
    """What a command takes it to be made of where no material is given; None for the default law."""

    stiffer: ClassVar[str] = "thicker walls"
    """What bears more pressure before it balloons, with the options; a clause for messages."""

    unbonded: ClassVar[tuple[str, ...] | None] = None
    """Faces of the mesh beyond `Actuator.faces`, cavities, supports and cut planes; None if only a mesh tells them."""

    examples: ClassVar[tuple[str, ...]] = ()
    """Options worth showing in a command's help."""

    plated: ClassVar[tuple[str, ...]] = ()
    """Faces that stand for something stiff on a bench, such as a plate, until a case says what it is of."""
