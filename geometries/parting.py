"""What a workshop has to know of a device to cast it: the whole of it, where it is parted, and where its tube enters."""

from __future__ import annotations

import dataclasses
from typing import ClassVar

from geometries.errors import GeometryError

Vector = tuple[float, float, float]


@dataclasses.dataclass(frozen=True)
class Parting:
    """The plane in which a device is cast in two, to be bonded there.

    Attributes:
        pull: Unit vector across the plane, along which the mould opens.
        height: Of the plane along the pull, in m.
        inlet: From where outside of the device to where in its cavity a tube runs, in m; None if it has no place of its own.
        why: Why here: a sentence.
    """

    pull: Vector
    height: float
    inlet: tuple[Vector, Vector] | None
    why: str


class Castable:
    """What a device tells about how it is cast; a base of `geometries.Actuator`."""

    regions: ClassVar[tuple[str, ...]] = ()
    """Physical groups of cells beside "solid" that can be of another material."""

    @property
    def parting(self) -> Parting | None:
        """Where it is parted to be cast; None if that has to be asked for."""
        return None

    def build_whole(self) -> None:
        """Fill the current Gmsh model with the whole device in mm, one solid, its cavities shut; name and mesh nothing.

        Raises:
            GeometryError: Its whole is not known.
            MeshingError: The CAD kernel cannot make it.
        """
        raise GeometryError(f"the whole of a {type(self).__name__} is not known as one solid (build_whole)")
