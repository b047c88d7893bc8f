"""What every device offers: its symmetry, its supports, its closed-form volumes and a mesh.

Device coordinates are x, y, z with z = lift, the direction in which the membrane rises. A three-dimensional mesh uses
them as they are. An axisymmetric mesh lies in the plane (x, y) = (radius, height); `Actuator.device_points` brings its
points to device coordinates. Directions, probes and profiles are in device coordinates for both.
"""

from __future__ import annotations

import dataclasses
import hashlib
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from geometries.designable import Designable
from geometries.errors import GeometryError, MeshingError
from geometries.fields import settle
from geometries.mirroring import Mirror
from geometries.parting import Castable
from geometries.presented import Presented
from measurement.units import brief
from measurement.wording import known_are

__all__ = ["Actuator", "CutPlane", "GeometryError", "Hold", "MeshingError", "Vector"]

Vector = tuple[float, float, float]

RECIPE = 3
"""Part of every key: raise it when the same parameters give another mesh, so that stored meshes are made anew."""


@dataclasses.dataclass(frozen=True)
class CutPlane:
    """A plane through the origin where the modelled slice was cut out of the device.

    Attributes:
        name: Physical group of the facets on the plane.
        normal: Unit normal pointing out of the slice.
    """

    name: str
    normal: Vector


@dataclasses.dataclass(frozen=True)
class Hold:
    """A displacement that is zero.

    Attributes:
        role: Physical group that is held.
        direction: Unit vector along which the displacement is zero; None for all components.
        point: True if the role is a single mesh vertex, False if it is a curve or a surface.
    """

    role: str
    direction: Vector | None
    point: bool = False


@dataclasses.dataclass(frozen=True, kw_only=True)
class Actuator(Designable, Castable, Presented, ABC):
    """A soft body around one air-filled cavity.

    Subclasses are frozen dataclasses whose fields come from `geometries.fields`.

    Raises:
        GeometryError: From the constructor, if the parameters make no device.
    """

    variants: ClassVar[Mapping[str, Mapping[str, Any]]] = {"default": {}}
    """Named sets of parameters; each maps field names to SI values that replace the defaults."""

    lift: ClassVar[Vector] = (0.0, 0.0, 1.0)
    """Direction in which the membrane rises."""

    axial: ClassVar[bool] = False
    """Whether it is a body of revolution around z, of which pictures may leave out any part of the circle."""

    faces: ClassVar[tuple[str, ...]] = ()
    """Physical groups on the outside that a thin sheet can be bonded to."""

    meshed: ClassVar[bool] = False
    """Whether `build` leaves a mesh, which is taken as it is."""

    @property
    def meeting(self) -> tuple[str, ...] | None:
        """Faces whose walls meet as the device moves, and press on each other unless a case says otherwise.

        One text for each group of faces that may meet each other and themselves, with commas between them; empty where no
        walls meet; None where only the mesh shows which do.
        """
        return ()

    def __post_init__(self) -> None:
        settle(self)
        self.check()

    @classmethod
    def variant(cls, name: str = "default", **changes: Any) -> Actuator:
        """Return a named variant, with single parameters changed.

        Args:
            name: One of `variants`.
            changes: Fields of the device that replace the variant's.

        Raises:
            ArgumentError: A field that the device does not have.
            GeometryError: A name not in `variants`, or parameters that make no device.
        """
        if not isinstance(name, str) or name not in cls.variants:
            raise GeometryError(f"{cls.__name__} has no variant {brief(name)}; {known_are(name, cls.variants)}")
        return cls(**{**cls.variants[name], **changes})

    @property
    def key(self) -> str:
        """Twelve hexadecimal digits that stay the same as long as every parameter does."""
        parameters = [(field.name, getattr(self, field.name)) for field in dataclasses.fields(self)]
        return hashlib.sha256(repr((RECIPE, type(self).__name__, parameters)).encode()).hexdigest()[:12]

    @property
    def files(self) -> Mapping[str, str]:
        """Files that the device is made from, by the parameter that names them; their contents decide its shape."""
        return {}

    @property
    def name(self) -> str:
        """Default name for files: the device and its key."""
        return f"{type(self).__name__}-{self.key}"

    @property
    def dimension(self) -> int:
        """2 for an axisymmetric mesh, 3 for a solid one."""
        return 3

    @property
    @abstractmethod
    def copies(self) -> int:
        """How many copies of the slice make the device; 1 for an axisymmetric mesh, which stands for all of it."""

    @property
    def fuller(self) -> str:
        """What models all of a device that symmetry has cut down, with the options; a clause for messages."""
        return "a model of the whole device"

    @property
    @abstractmethod
    def size(self) -> float:
        """Characteristic length in m."""

    @property
    @abstractmethod
    def cut_planes(self) -> tuple[CutPlane, ...]:
        """Symmetry planes that bound the slice, in order; empty if nothing was cut."""

    @property
    @abstractmethod
    def holds(self) -> tuple[Hold, ...]:
        """Supports, beyond the symmetry on `cut_planes`, that leave no rigid motion."""

    @property
    def mirrors(self) -> tuple[Mirror, ...]:
        """Planes on which the mesh of what `build` makes is mirrored, one after the other; none unless a device says so."""
        return ()

    @property
    @abstractmethod
    def probes(self) -> Mapping[str, Vector]:
        """Named material points in device coordinates (m); each is a vertex of the mesh."""

    @property
    def gauge(self) -> str:
        """Name of the probe whose rise along `lift` stands for the device's motion: the first one."""
        return next(iter(self.probes))

    @property
    def blocked(self) -> str | None:
        """Role that is held along the lift, so that the device pushes on it with its blocked force; None if it is free."""
        return None

    @property
    def pushed(self) -> str | None:
        """Face that a load along the lift is spread over to tell the device's stiffness; None if nothing is asked of it."""
        return None

    def device_figures(self, places: Mapping[str, Vector]) -> dict[str, float]:
        """What this kind of device is judged by, beyond the rise of its probes; nothing unless a device says so.

        Args:
            places: Where the `probes` are now, in device coordinates (m).

        Returns:
            Figures by their column's name, which ends in the unit: ``{"tip_x_mm": 69.1}``.
        """
        return {}

    figure_texts: ClassVar[Mapping[str, tuple[str, str]]] = {}
    """What the columns of `device_figures` are: short name, and a sentence without its stop."""

    @property
    def ratios(self) -> tuple[float, ...]:
        """Pressure in each cavity ("cavity", "cavity2", ...) over the cavity pressure; one cavity unless a device has more."""
        return (1.0,)

    @property
    @abstractmethod
    def cavity_volume(self) -> float:
        """Volume in m3 of the whole device's undeformed cavity, in closed form; NaN where there is none."""

    @property
    @abstractmethod
    def solid_volume(self) -> float:
        """Volume in m3 of the whole device's undeformed solid, in closed form."""

    @property
    def chamber_volume(self) -> float:
        """The part of `cavity_volume` in m3 that rigid things around the device enclose, beyond what its own walls do."""
        return 0.0

    @abstractmethod
    def on_profile(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Tell which undeformed points lie on the outline that a camera sees from the side.

        Args:
            points: Device coordinates in m, shape (n, 3).

        Returns:
            Mask of shape (n,).
        """

    def along_profile(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Numbers (n,) that rise along the outline, of points on it: the distance from the axis unless a device overhangs."""
        return np.asarray(np.hypot(points[:, 0], points[:, 1]))

    deviations: ClassVar[Mapping[str, str]] = {}
    """Ways in m, zero as drawn, in which a workshop makes another device than its parameters say: what each is, a clause."""

    def made(self, values: Mapping[str, float]) -> Actuator:
        """The device with other values of parameters, and with `deviations`; GeometryError if that is none."""
        return dataclasses.replace(self, **values)

    variable: ClassVar[tuple[str, ...]] = ()
    """Lengths that `velocity` knows: those a mesh can follow by moving its nodes."""

    def velocity(self, name: str, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Motion of undeformed points as a length of the device changes, in m per m.

        Points on the boundary stay on it; the motion is linear in the length.

        Args:
            name: One of `variable`.
            points: Device coordinates in m, shape (n, 3).

        Returns:
            Shape (n, 3), device coordinates.

        Raises:
            GeometryError: A length whose motion this device does not know.
        """
        known = f"only with {', '.join(self.variable)}" if self.variable else "with none of its lengths"
        raise GeometryError(f"the mesh of {type(self).__name__} does not move with {name}, {known}")

    @abstractmethod
    def check(self) -> None:
        """Check the parameters against each other; each one alone is known to be of the right kind.

        Raises:
            GeometryError: The parameters make no device.
        """

    @abstractmethod
    def build(self) -> None:
        """Fill the current Gmsh model (m) with the shape, the physical groups and the cell sizes; mesh nothing."""

    @property
    @abstractmethod
    def mesh_order(self) -> int:
        """Polynomial order of the cells' geometry."""

    @property
    def expected_cells(self) -> float:
        """Roughly how many cells the mesh will have, within a factor of two or so; infinite where that is not known."""
        return math.inf

    def device_points(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points of the mesh in device coordinates.

        Args:
            points: Mesh coordinates in m, shape (n, 3); the third column of an axisymmetric mesh is ignored.

        Returns:
            Device coordinates in m, shape (n, 3).
        """
        points = np.asarray(points, dtype=float)
        if self.dimension == 3:
            return points
        return np.column_stack([points[:, 0], np.zeros(len(points)), points[:, 1]])

    def write(self, path: str | Path, stopped: Callable[[], bool] = bool) -> Path:
        """Mesh the device and write it as a Gmsh file (MSH 4.1, m).

        Args:
            path: File ending in ``.msh`` in an existing folder; it is replaced only once the new mesh is complete.
            stopped: Asked several times a second while a mesh that takes longer is made; once true, the mesher is killed.

        Returns:
            The path.

        Raises:
            GeometryError: The name does not end in ``.msh``.
            MeshingError: Gmsh failed or made cells that are turned inside out.
            MeshingStopped: ``stopped`` was true.
            OSError: The folder is missing or cannot be written.
        """
        from geometries.meshing import write_mesh

        return write_mesh(self, Path(path), stopped)
