"""`Actuator`, the base class of devices: symmetry, supports, closed-form volumes and a mesh.

Device coordinates are x, y, z with z = lift, the direction in which the membrane rises. A three-dimensional mesh uses
them as they are. An axisymmetric mesh lies in the plane (x, y) = (radius, height); `Actuator.device_points` brings its
points to device coordinates. Directions, probes and profiles are in device coordinates for both.
"""

from __future__ import annotations

import dataclasses
import hashlib
import math
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar, NoReturn, Self

import numpy as np
import numpy.typing as npt
from numpy.typing import ArrayLike, NDArray

from geometries import meshing
from softmodels.common import arrays, errors, files, schema, units
from softmodels.common.errors import GeometryError, MeshingError
from softmodels.common.lazy import gmsh

__all__ = ["Actuator", "CutPlane", "GeometryError", "Hold", "MeshingError", "Vector"]


# ----------------------------------------------------------------------------------------------------------------------
# Interface of a device for designs: parameters a mesh can follow, boundary motion, minimum dimensions.
#
# A mesh that was made of one device is moved to another of the same kind: its nodes on the boundary move to the places that
# `carried` returns, those inside follow. So a quantity is a smooth function of the parameters, free of the noise of new meshes.
# The parameters by name are below.


class Designable:
    """The part of `geometries.Actuator` that a design asks for; a device without it cannot be designed."""

    @property
    def movable(self) -> tuple[str, ...]:
        """Names of the parameters that `carried` can follow, among those of `parameter_names`."""
        return ()

    def why_not_movable(self, name: str) -> str:
        """Return the sentence on a parameter of the shape that is not among `movable`."""
        known = f"it follows {', '.join(self.movable)}" if self.movable else "it can follow none"
        return f"the mesh of this {type(self).__name__} cannot follow {name}; {known}"

    def carried(self, other: Self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return where points on the boundary of this device lie on another one.

        Corners go to corners, edges to edges, faces to faces and probes to probes; points on a cut plane stay on it. The
        places are smooth functions of the other's parameters, and the same points again if it is this device.

        Args:
            other: A device of the same class whose choices and numbers of parts are this one's.
            points: Points on the undeformed boundary in device coordinates, m, shape (n, 3); none from inside the solid.

        Returns:
            Shape (n, 3): on the other's boundary, to rounding wherever a face is given in closed form.

        Raises:
            GeometryError: This kind of device does not know it, or not between these two.
        """
        raise GeometryError(
            f"the mesh of {type(self).__name__} cannot follow its parameters: it defines no motion of its faces"
        )

    def entries(self, field: str) -> tuple[float, ...]:
        """Return the values of a list of numbers; a device may know them where none are given."""
        return tuple(getattr(self, field))

    carries_interfaces: ClassVar[bool] = False
    """Whether `carried` also takes points where regions meet inside the solid."""

    @property
    def ratio_parameters(self) -> tuple[str, ...]:
        """Names of the parameters that decide `Actuator.ratios` and not the shape, among those of `parameter_names`."""
        return ()

    @property
    def clearances(self) -> Mapping[str, float]:
        """Return every dimension in m with a minimum, geometric or of the workshop, by description.

        Each is a smooth function of the parameters; walls that could each be the thinnest are entries of their own. Empty if
        the device names none.
        """
        return {}


# ----------------------------------------------------------------------------------------------------------------------
# Names and texts of a device in commands and messages.


class DeviceLabels:
    """Names and texts of a device for commands and messages."""

    stem: ClassVar[str] = "device"
    """Name of its result files and default folder where a case has no name."""

    pressures: ClassVar[str] = "0:20"
    """Pressures in cm of water that the default device can take, for the help's examples."""

    silicone: ClassVar[str | None] = None
    """Default silicone of a command; None for the default law."""

    stiffer: ClassVar[str] = "thicker walls"
    """A design that takes more pressure before it balloons, with the options; a clause for messages."""

    unbonded: ClassVar[tuple[str, ...] | None] = None
    """Faces of the mesh beyond `Actuator.faces`, cavities, supports and cut planes; None if they are known only from a mesh."""

    examples: ClassVar[tuple[str, ...]] = ()
    """Options worth showing in a command's help."""

    plated: ClassVar[tuple[str, ...]] = ()
    """Faces that stand for something stiff on a bench, such as a plate, until a case sets its material."""


# ----------------------------------------------------------------------------------------------------------------------
# A soft body around one air-filled cavity.


class Castable:
    """Data of a device for its mould; a base of `geometries.Actuator`."""

    regions: ClassVar[tuple[str, ...]] = ()
    """Physical groups of cells beside "solid" that can be of another material."""

    @property
    def recipe(self) -> Recipe:
        """How it is cast; GeometryError if it names no recipe."""
        raise GeometryError(
            f"a {type(self).__name__} names no casting recipe; give its class a property recipe, which returns the pieces to "
            "cast, and a method build_whole, which draws it (docs/pages/howto/extending.md)"
        )

    def cast_along(self, pull: Vector | None, level: float | None) -> Recipe:
        """Return the recipe for a pull and a height of the parting plane along it, in m, both None if not given.

        Raises:
            GeometryError: It has no recipe, or one of its own that takes neither.
        """
        if pull is not None or level is not None:
            raise GeometryError(
                f"pull and split apply only to imported parts; a {type(self).__name__} defines its own parting plane"
            )
        return self.recipe

    def build_whole(self) -> None:
        """Fill the current Gmsh model with the whole device in mm, one solid, its cavities shut; name and mesh nothing.

        Raises:
            GeometryError: Its whole is not known.
            MeshingError: The CAD kernel cannot make it.
        """
        raise GeometryError(f"the whole of a {type(self).__name__} is not known as one solid (build_whole)")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Actuator(Designable, Castable, DeviceLabels, ABC):
    """A soft body around one air-filled cavity.

    Subclasses are frozen dataclasses whose fields come from `softmodels.common.schema`.

    Raises:
        GeometryError: From the constructor, if the parameters make no device.
    """

    finer: float = schema.number_field(
        1.0, "how many times smaller all cells are than the other settings say", shape=False, last=True
    )

    variants: ClassVar[Mapping[str, Mapping[str, Any]]] = {"default": {}}
    """Named sets of parameters; each maps field names to SI values that replace the defaults."""

    lift: ClassVar[Vector] = (0.0, 0.0, 1.0)
    """Direction in which the membrane rises."""

    axial: ClassVar[bool] = False
    """Whether it is a body of revolution around z, so that pictures may omit any part of the circle."""

    faces: ClassVar[tuple[str, ...]] = ()
    """Physical groups on the outside for bonding a thin sheet."""

    standing: ClassVar[str] = ""
    """Role of a held face that only stands there: it presses on what holds it, and lifts off where it would be pulled."""

    plate: ClassVar[Vector] = (0.0, 0.0, 0.0)
    """A place (m) in the plane in which the cavity's walls may end; the origin, where cut planes meet, unless a plate elsewhere
    closes the cavity."""
    foreign: ClassVar[bool] = False
    """Whether its shape is from a file, on which Gmsh may end its process."""
    meshed: ClassVar[bool] = False
    """Whether `build` creates the mesh itself, which is used unchanged."""
    bodies: ClassVar[tuple[tuple[str, ...], ...]] = ()
    """Regions of each of several bodies, which share no face; empty for one body."""

    @property
    def meeting(self) -> tuple[str, ...] | None:
        """Faces that may touch, with self-contact by default.

        One text for each group of faces that may meet each other and themselves, with commas between them; empty where no
        walls meet; None where only the mesh shows which do.
        """
        return ()

    def __post_init__(self) -> None:
        schema.settle(self)
        if not 1.0 / MOST_REFINED <= self.finer <= MOST_REFINED:
            self.reject(
                "finer",
                f"it must be from {1.0 / MOST_REFINED:g} to {MOST_REFINED:g}; for larger or smaller cells change the cell size",
            )
        if self.finer != 1.0 and not self.refinable:
            self.reject("finer", meshing.NOT_REFINED)
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
            raise GeometryError(f"{cls.__name__} has no variant {units.brief(name)}; {errors.known_are(name, cls.variants)}")
        return cls(**{**cls.variants[name], **changes})

    def told(self, name: str) -> str:
        """Return a length with its value for a message, such as ``radius, 20 mm``; of one that is no field, with an article."""
        what = name if name in schema.about(self) else f"the {name.replace('_', ' ')}"
        return f"{what}, {schema.shown(getattr(self, name), 'm')}"

    def given(self, *names: str) -> str:
        """Return parameters with their values for a message, such as ``radius 20 mm and wall 2 mm``."""
        return " and ".join(self.told(name).replace(",", "") for name in names)

    def reject(self, name: str, why: str) -> NoReturn:
        """Raise `GeometryError` on a parameter: its value, and why it makes no device."""
        raise GeometryError(f"{name} is {schema.shown(getattr(self, name), schema.about(self)[name].kind.unit)}; {why}")

    def check_most(self, names: str, factor: float, of: str, why: str = "it must be at most {}") -> None:
        """Reject lengths above a factor times another one; the reason has ``{}`` for these."""
        for name in names.split():
            if getattr(self, name) > factor * getattr(self, of):
                times = "" if factor == 1.0 else f"{factor:g} times "
                self.reject(name, why.format(times + self.told(of)))

    def check_below(self, name: str, of: str) -> None:
        """Reject a length that is not smaller than another one."""
        if getattr(self, name) >= getattr(self, of):
            self.reject(name, f"it must be smaller than {self.told(of)}")

    def check_size(self, name: str, *lengths: float, given: str = "") -> None:
        """Reject lengths of the whole device that suggest a wrong unit, such as of a parameter; ``given`` is said with it."""
        if max(lengths) > schema.MAX_LENGTH:
            self.reject(name, f"{given}the device passes {schema.MAX_LENGTH:g} m, which suggests a wrong unit")

    def check_least(self, names: str, share: float, of: str) -> None:
        """Reject lengths below a share of another one, but 0."""
        for name in names.split():
            if 0.0 < getattr(self, name) < share * getattr(self, of):
                self.reject(name, f"it must be at least {share:g} of {self.told(of)}")

    def check_count(self, more: str = "") -> None:
        """Reject a mesh that is larger than anyone means: a typing mistake far more often than a wish.

        Args:
            more: What else decides the number of cells, a clause behind the cell size.
        """
        if (expected := meshing.expected_cells(self)) > self.most_cells:
            finer = f" with finer {self.finer:g}" if self.finer != 1.0 else ""
            raise GeometryError(
                f"cell_size is {schema.shown(getattr(self, 'cell_size', 0.0), 'm')}{more}{finer}; about {expected:.2g} "
                f"cells are expected, but at most {self.most_cells:,} are allowed; use larger cells"
            )

    @property
    def key(self) -> str:
        """Twelve hexadecimal digits that stay the same as long as every parameter does."""
        parameters = [(field.name, getattr(self, field.name)) for field in dataclasses.fields(self)]
        return hashlib.sha256(repr((MESH_KEY_VERSION, type(self).__name__, parameters)).encode()).hexdigest()[:12]

    @property
    def files(self) -> Mapping[str, str]:
        """Files that the device is made from, by the parameter that names them; their contents determine its shape."""
        return {}

    def digest(self) -> str:
        """Return SHA-256 of the contents of its `files`, empty without one; GeometryError for one that cannot be read."""
        return "-".join(_digest(name, file) for name, file in self.files.items())

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
        """Number of slices in the device; 1 for an axisymmetric mesh, which represents all of it."""

    @property
    def portion(self) -> str:
        """What part of the device is meshed; a clause for messages."""
        return f"1/{self.copies}"

    @property
    def fuller(self) -> str:
        """Options that model the whole device; a clause for messages."""
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
        """Supports in addition to the symmetry on `cut_planes`, which prevent rigid motions."""

    @property
    def mirrors(self) -> tuple[meshing.Mirror, ...]:
        """Planes on which the mesh of what `build` makes is mirrored, one after the other; none by default."""
        return ()

    @property
    @abstractmethod
    def probes(self) -> Mapping[str, Vector]:
        """Named material points in device coordinates (m); each is a vertex of the mesh."""

    @property
    def gauge(self) -> str:
        """Name of the probe whose rise along `lift` represents the device's motion: the first one."""
        return next(iter(self.probes))

    @property
    def blocked(self) -> str | None:
        """Role held along the lift, where the blocked force acts; None if free."""
        return None

    @property
    def pushed(self) -> str | None:
        """Face loaded along the lift to compute the device's stiffness; None if not defined."""
        return None

    def device_figures(self, places: Mapping[str, Vector]) -> dict[str, float]:
        """Return the device's own figures, besides the rise of its probes; empty by default.

        Args:
            places: Where the `probes` are now, in device coordinates (m).

        Returns:
            Figures in SI by name: ``{"tip_x": 0.0691}``.
        """
        return {}

    headline: ClassVar[tuple[str, ...]] = ()
    """Variables of a run's table that its last line and its report state beside the gauge's rise."""

    figure_texts: ClassVar[Mapping[str, tuple[str, str, str]]] = {}
    """Descriptions of `device_figures`: the unit in ``path.csv`` as their columns end in it ("mm"; "" for a number), short
    name, and a sentence without full stop."""

    @property
    def figure_columns(self) -> dict[str, str]:
        """Columns of ``path.csv`` with the device's own figures, by their names."""
        return {name: f"{name}_{self.figure_texts[name][0]}".rstrip("_") for name in self.device_figures(self.probes)}

    @property
    def ratios(self) -> tuple[float, ...]:
        """Pressure in each cavity ("cavity", "cavity2", ...) over the cavity pressure; one cavity by default."""
        return (1.0,)

    @property
    @abstractmethod
    def cavity_volume(self) -> float:
        """Volume in m3 of the whole device's undeformed cavity, in closed form; NaN if there is none."""

    @property
    @abstractmethod
    def solid_volume(self) -> float:
        """Volume in m3 of the whole device's undeformed solid, in closed form."""

    @property
    def chamber_volume(self) -> float:
        """The part of `cavity_volume` in m3 enclosed by rigid parts around the device, not by its walls."""
        return 0.0

    @abstractmethod
    def on_profile(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which undeformed points are on the outline seen from the side.

        Args:
            points: Device coordinates in m, shape (n, 3).

        Returns:
            Mask of shape (n,).
        """

    def along_profile(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the numbers (n,) that rise along the outline, of points on it: the distance from the axis unless a device
        overhangs."""
        return np.asarray(np.hypot(points[:, 0], points[:, 1]))

    deviations: ClassVar[Mapping[str, str]] = {}
    """Fabrication deviations in m, zero nominally, with a description of each as a clause."""

    def made(self, values: Mapping[str, float]) -> Actuator:
        """Return the device with other values of parameters, and with `deviations`; GeometryError if they are invalid."""
        return dataclasses.replace(self, **values)

    variable: ClassVar[tuple[str, ...]] = ()
    """Lengths that a fit may take as free parameters."""

    @abstractmethod
    def check(self) -> None:
        """Check the parameters against each other; each one is already valid by itself.

        Raises:
            GeometryError: The parameters make no device.
        """

    @abstractmethod
    def build(self) -> None:
        """Fill the current Gmsh model (m) with the shape, the physical groups and the cell sizes; do not mesh."""

    def curve(self) -> None:
        """Move nodes of the mesh in the current Gmsh model onto curved walls that no CAD face knows; none by default."""

    remarks: ClassVar[tuple[str, ...]] = ()
    """Sentences on what was changed to simulate it, which belong to each of its results."""

    @property
    def mesh_order(self) -> int:
        """Polynomial order of the cells' geometry: of a field ``order`` if the device has one, else 2."""
        return getattr(self, "order", 2)

    most_cells: ClassVar[int] = 3_000_000
    """Maximum expected number of cells; larger meshes are mostly typing errors."""

    @property
    def expected_cells(self) -> float:
        """Estimated number of cells where ``finer`` is 1, within a factor of about two; infinite if unknown."""
        return math.inf

    @property
    def refinable(self) -> bool:
        """Whether its cells can be made smaller; those of a mesh file are used as they are."""
        return not self.meshed

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

    def replaced(self, **fields: Any) -> Self:
        """Return the device with other values of fields; GeometryError if they are invalid."""
        return dataclasses.replace(self, **fields)

    def refined(self, times: float) -> Self:
        """Return the device with all cells a number of times smaller. GeometryError for more cells than are solved for, or a
        part whose file is a mesh."""
        return self.replaced(finer=self.finer * times)

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

        return meshing.write_mesh(self, Path(path), stopped)


def _digest(name: str, file: str) -> str:
    try:
        return files.file_digest(file)
    except OSError as error:
        raise GeometryError(f"{name} {file} cannot be read ({errors.reason(error)})") from None
    except ValueError:  # a zero byte in its name
        raise GeometryError(f"{name} {file!r} is not a file name") from None


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
    """A zero displacement component.

    Attributes:
        role: Physical group that is held.
        direction: Unit vector along which the displacement is zero; None for all components.
        point: True if the role is a single mesh vertex, False if it is a curve or a surface.
        together: True if the displacement along the direction is not zero but the same all over a plane face, which travels.
    """

    role: str
    direction: Vector | None
    point: bool = False
    together: bool = False


# ----------------------------------------------------------------------------------------------------------------------
# Interface of a device for moulds: the whole solid, the pieces it is cast in, and the tube's inlet.


Vector = tuple[float, float, float]
AXES = ("x", "y", "z")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Pour:
    """A piece of a device that is cast in one go, and how its mould comes apart.

    A lid closes the mould in a plane and carries the core; a cup beyond it forms everything else.

    Attributes:
        name: Of the piece, such as ``"chambers"``.
        up: Unit vector from the lid's plane into the piece.
        level: Height of the lid's plane along ``up``, in m; None: in the middle of the cavities.
        end: Height along ``up`` where the piece ends, in m; None: where the device does.
        lid: Whether there is a lid; without one the cup is an open tray, scraped flat.
        floor: Height along ``up`` at which the cup is cut into a floor and a frame around the piece, in m; None: in one.
        sideways: Unit vector along which the cup opens in two halves; None: it leaves along ``up`` in one.
        lost: Whether the core cannot be pulled and is dissolved or melted out.
        gate: Height along ``up`` of the flat face with the pour opening, in m; None: in the lid's plane, through the lid.
        vented: The same of the face with the vents; None: beside the pour opening.
        squeezed: Whether its edge is too narrow for openings: the cup is filled, and the lid presses out what is too much.
        wax: Whether it is a lost core, cast of wax through its peg.
    """

    name: str
    up: Vector
    level: float | None
    end: float | None = None
    lid: bool = True
    floor: float | None = None
    sideways: Vector | None = None
    lost: bool = False
    gate: float | None = None
    vented: float | None = None
    squeezed: bool = False
    wax: bool = False

    @property
    def filled_open(self) -> bool:
        """Whether its cup is filled before the lid comes on; else the closed mould is filled through its opening."""
        return self.lid and self.gate is None

    def part(self, body: str) -> str:
        """Return what a body of its mould is by its name, such as ``" cup left"``: the piece itself may be called a cup."""
        return body.removeprefix(self.name)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Recipe:
    """How a device is cast.

    Attributes:
        pours: Its pieces; several are bonded.
        why: Sentences why so.
        inlets: From where outside of the device to where in its cavity each tube runs, m.
        steps: Sentences on what is particular of it for the bench, before its pieces are bonded.
        seamless: How it is cast instead where cores are lost, if that needs no bond.
        wound: Of a tube around z: radius, and heights between which fibres on its face "outer" lie, m.
    """

    pours: tuple[Pour, ...]
    why: str
    inlets: tuple[tuple[Vector, Vector], ...] = ()
    steps: tuple[str, ...] = ()
    seamless: Recipe | None = None
    wound: tuple[float, float, float] | None = None


def in_halves(up: Vector, level: float | None, why: str, *inlets: tuple[Vector, Vector]) -> Recipe:
    """Return the recipe of a device cast in two halves that are bonded in a plane across ``up``; see `Pour`."""
    x, y, z = up
    down = (-x + 0.0, -y + 0.0, -z + 0.0)
    lower = None if level is None else -level
    pours = Pour(name="upper", up=up, level=level), Pour(name="lower", up=down, level=lower)
    return Recipe(pours=pours, why=why, inlets=inlets)


MOST_REFINED = 20.0
"""Most times that all cells may be smaller, or larger, than a device's other settings say."""

MESH_KEY_VERSION = 5
"""Version in every key: increase it when the same parameters give another mesh, to invalidate cached meshes."""


# ----------------------------------------------------------------------------------------------------------------------
# Reflections on the planes where a slice was cut out of a body: how many images of the slice make the whole, and which.


MIN_PLANE_ANGLE = np.pi / 90
SAME_ANGLE = 1e-5
"""How far from 180/n degrees the angle between two planes may be, in rad: drawings are rounded."""
SAME_IMAGE = 1e-2
"""How far the entries of two matrices may differ for one image: above what `SAME_ANGLE` adds up to, below `MIN_PLANE_ANGLE`."""


def reflected(normals: ArrayLike, count: int | None = None, dimension: int = 3) -> NDArray[np.float64]:
    """Return the first products of reflections on planes through the origin, whose unit normals have the shape (k,
    dimension): matrices that take a slice to its places, its neighbours, their neighbours and so on, shape (m, dimension,
    dimension), the identity first. All of them, which must be finitely many, if no count is given."""
    identity = np.eye(dimension)
    mirrors = [identity - 2 * np.outer(normal, normal) for normal in np.reshape(normals, (-1, dimension))]
    corners_and_copies = [identity]
    for image in corners_and_copies:
        for mirror in mirrors:
            if len(corners_and_copies) == count:
                return np.array(corners_and_copies)
            new = image @ mirror
            if np.abs(np.array(corners_and_copies) - new).max(axis=(1, 2)).min() > SAME_IMAGE:
                corners_and_copies.append(new)
    return np.array(corners_and_copies)


def check_slice(normals: ArrayLike, texts: tuple[str, ...]) -> None:
    """Check that images of a slice fill the space around it once, by the outward unit normals of its planes, shape (k, 3), and
    what was written for each. GeometryError if two do not meet at 180/n degrees inside the slice, or three meet in one line."""
    outward = np.reshape(normals, (-1, 3))
    for i in range(len(outward)):
        for j in range(i):
            angle = float(np.arccos(np.clip(-outward[i] @ outward[j], -1.0, 1.0)))
            parts = round(np.pi / max(angle, MIN_PLANE_ANGLE))
            if parts < 2 or abs(angle - np.pi / parts) > SAME_ANGLE:
                raise GeometryError(
                    f"planes has {texts[j]!r} and {texts[i]!r}, {np.degrees(angle):.6g} degrees apart in the part; "
                    f"its images fill the whole only at 180/n degrees, such as 90, 60, 45 or 30"
                )
    if len(outward) and np.linalg.svd(outward, compute_uv=False)[-1] < 1e-6:
        raise GeometryError(f"planes has {', '.join(map(repr, texts))}, which meet in one line; only two of them can")


# ----------------------------------------------------------------------------------------------------------------------
# The continuous parameters of a device by name: what decides its shape and may be varied by any small amount.
#
# An entry of a list has the field's name and its place, counted from 1: ``profile[2]``. Values are in SI units, angles in
# degrees.


def parameter_names(device: Actuator) -> tuple[str, ...]:
    """Return the names of the continuous parameters that decide a device's shape, in the order of its fields.

    Sizes of cells, limits of the workshop and other fields declared with ``shape=False`` are not among them, nor are fields
    that have no effect with the others.
    """
    return tuple(name for name, _, _ in _places(device))


def parameter(device: Actuator, name: str) -> float:
    """Return the value of a continuous parameter, one of `parameter_names`, in m, degrees or as a pure number; GeometryError
    if the device has none such."""
    field, place = _place(device, name)
    return float(getattr(device, field) if place is None else device.entries(field)[place])


def changed[Device: Actuator](device: Device, values: Mapping[str, float]) -> Device:
    """Return the device with other SI values of continuous parameters by the names of `parameter_names`; GeometryError if it
    has none such, or the values make no device."""
    fields: dict[str, object] = {}
    for name, value in values.items():
        field, place = _place(device, name)
        if place is None:
            fields[field] = value
        else:
            entries = list(fields.get(field, device.entries(field)))  # type: ignore[call-overload]
            entries[place] = value
            fields[field] = tuple(entries)
    return device.replaced(**fields)


def _places(device: Actuator) -> Iterator[tuple[str, str, int | None]]:
    """Name, field and place in the field's list of every continuous parameter."""
    for field, known in schema.about(device).items():
        if not known.shape or known.idle(device):
            continue
        if isinstance(known.kind, schema.Quantity):
            yield field, field, None
        elif isinstance(known.kind, schema.Several) and isinstance(known.kind.of, schema.Quantity):
            for place in range(len(device.entries(field))):
                yield f"{field}[{place + 1}]", field, place


def _place(device: Actuator, name: str) -> tuple[str, int | None]:
    places = {known: (field, place) for known, field, place in _places(device)}
    if name in places:
        return places[name]
    words = f"{name} is not a continuous parameter of this {type(device).__name__}"
    if entry := re.fullmatch(r"(\w+)\[\d+\]", name):
        length = sum(field == entry[1] for field, _ in places.values())
        if length:
            raise GeometryError(f"{words}; {entry[1]} has {length} entries, counted from 1")
    raise GeometryError(f"{words}; it has {', '.join(places) or 'none'}")


def is_length(device: Actuator, name: str) -> bool:
    """Return whether a continuous parameter is a length in m, and not an angle or a pure number; GeometryError as
    `parameter`."""
    field, place = _place(device, name)
    kind = schema.about(device)[field].kind
    return isinstance(kind if place is None or not isinstance(kind, schema.Several) else kind.of, schema.Length)


# ----------------------------------------------------------------------------------------------------------------------
# Devices that may be modelled by an axisymmetric section instead of a solid, and those whose solid is a wedge.


NARROWEST_WEDGE = 5.0
"""Smallest angle in degrees; a thinner wedge has needles for cells along the axis."""


class Sectioned(Actuator):
    """A device of which an axisymmetric section may be modelled; a device is a dataclass of it with the field below."""

    section: str

    @property
    def dimension(self) -> int:
        return 2 if self.section == "axisymmetric" else 3

    @property
    def movable(self) -> tuple[str, ...]:
        """All but those that are 0: a corner has no faces of a rounding that a mesh could follow."""
        return tuple(name for name in parameter_names(self) if parameter(self, name) != 0.0)

    @property
    def axis_holds(self) -> tuple[Hold, ...]:
        """Among `holds`: the axis of a section, whose points stay on it; empty for a solid."""
        return (Hold("axis", (1.0, 0.0, 0.0)),) if self.dimension == 2 else ()


class Wedged(Sectioned):
    """A device whose solid is a wedge; a device is a dataclass of it with ``section`` and ``angle``, in degrees."""

    angle: float

    def check_angle(self) -> None:
        """Reject an angle that does not divide the circle, or leaves needles for cells along the axis."""
        if self.dimension == 2:
            return
        if not NARROWEST_WEDGE <= self.angle <= 360.0:
            self.reject("angle", f"it must be between {NARROWEST_WEDGE:g} and 360 deg")
        turns = 360.0 / self.angle
        if abs(turns - round(turns)) > 1e-9 * turns:
            self.reject("angle", "it must divide 360 deg evenly, such as 30, 45, 90, 180 or 360 deg")

    @property
    def copies(self) -> int:
        return 1 if self.dimension == 2 else round(360.0 / self.angle)

    @property
    def fuller(self) -> str:
        return "--section wedge --angle 360deg" if self.dimension == 2 else "--angle 360deg"


# ----------------------------------------------------------------------------------------------------------------------
# Devices with one mirror plane, y = 0, of which a half or the whole is modelled.


def part_field(device: str) -> Any:
    """Return a dataclass field: how much of a device is modelled; the text is the device in a word."""
    return schema.choice_field("half", ("half", "full"), f"half up to the mirror plane, or the full {device}")


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
    @abstractmethod
    def length(self) -> float:
        """Length from the clamp to the tip in m."""

    @property
    def halved(self) -> bool:
        return self.part == "half"

    def on_profile(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Report which points lie on the line in the mirror plane at the height of the gauge, from the clamp to the tip."""
        points, near = np.asarray(points, dtype=float), 1e-9 * self.length
        return (np.abs(points[:, 2] - self.probes[self.gauge][2]) < near) & (np.abs(points[:, 1]) < near)

    @property
    def fuller(self) -> str:
        return "--part full"

    @property
    def mirrors(self) -> tuple[meshing.Mirror, ...]:
        return (meshing.Mirror("plane0", 1, {}),) if self.part == "full" else ()


# ----------------------------------------------------------------------------------------------------------------------
# A support at one end, and a tip that is free to move or held along the lift, as in a test of blocked force.


ENDS = ("tip", "end")
"""What devices call the face at their free end."""


def tip_field(free: str = "tip", held: str = "its face") -> Any:
    """Return a dataclass field for the tip; the texts say what is free to move and the support."""
    return schema.choice_field("free", ("free", "held"), f"{free} free to move, or {held} held along z (blocked force)")


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


# ----------------------------------------------------------------------------------------------------------------------
# Fingers on a base: checks that they share, and figures of how they bend from the position of the tip.


MAX_CELL_SIZE_RATIO = 10.0
"""Largest ratio of the cell size to the thinnest part: flatter cells are poor, and the size grades too steeply."""


class Finger(MirroredHalf, HeldTip):
    """A device that lies along x from its clamp at x = 0 and bends down, with probes ``tip`` and ``tip_above``.

    A device is a dataclass of it with ``least_wall`` and ``cell_size``.
    """

    least_wall: float
    cell_size: float

    figure_texts: ClassVar[Mapping[str, tuple[str, str, str]]] = {
        "bend_angle": ("deg", "bend angle", "rotation of the tip's face, positive towards the base"),
        "tip_x": ("mm", "tip place x", "x of the middle of the tip's lower edge, deformed, from the clamp"),
        "tip_z": ("mm", "tip place z", "z of the middle of the tip's lower edge, deformed, from the middle of the base"),
    }

    def device_figures(self, places: Mapping[str, Vector]) -> dict[str, float]:
        """Return how the device is bent; see `Actuator.device_figures`."""
        low, high = (np.asarray(places[name]) for name in ("tip", "tip_above"))
        return {"bend_angle": bend_angle(low, high), "tip_x": float(low[0]), "tip_z": float(low[2])}

    def check_walls(self, names: Iterable[str], quantity: str, count: str) -> None:
        """Reject dimensions below `least_wall`, and a finger of impossible length: of one part's, times a number of parts."""
        for name in names:
            if getattr(self, name) < self.least_wall * (1 - schema.BOUND_TOLERANCE):
                length, least = (schema.shown(value, "m") for value in (getattr(self, name), self.least_wall))
                raise GeometryError(f"{name} is {length}, but least_wall requires {least}")
        if self.length > 0.1 * schema.MAX_LENGTH:
            self.reject(
                quantity,
                f"with {getattr(self, count)} {count} the device is {schema.shown(self.length, 'm')} long, and above "
                f"{0.1 * schema.MAX_LENGTH:g} m this suggests a wrong unit",
            )

    def check_cells(self, solid: Iterable[str]) -> None:
        """Reject cells that are too large for the thinnest of some parts, or too many."""
        thinnest = min(solid, key=lambda name: float(getattr(self, name)))
        limit = MAX_CELL_SIZE_RATIO * getattr(self, thinnest)
        if self.cell_size > limit:
            self.reject("cell_size", f"with {self.given(thinnest)} it must be at most {schema.shown(limit, 'm')}")
        self.check_count()


def bend_angle(low: NDArray[np.float64], high: NDArray[np.float64]) -> float:
    """Return the angle in rad by which the tip's face has turned towards -z, right up to a whole turn and more, from its
    deformed ends in m from the clamp, shape (3,); ``high`` lay above ``low``.

    The face gives it except for whole turns. The line from the clamp to the tip gives those: in a circle it has turned half
    as far.
    """
    face = high - low
    turned, line = math.atan2(face[0], face[2]), -math.atan2(low[2], low[0])
    return turned + math.tau * round((2.0 * line - turned) / math.tau)


# ----------------------------------------------------------------------------------------------------------------------
# Connected components from pairs.


Numbers = npt.NDArray[np.int64]


def joined(pairs: Numbers, count: int) -> Numbers:
    """Return the group of each of a count of things, from 0 in the order of their first members, shape (count,): pairs, shape
    (n, 2), are in one group. SciPy's `connected_components` gives the same; loading its sparse tree takes a third of a short
    run's time."""
    label = np.arange(count)
    ends, other = np.asarray(pairs, dtype=np.int64).reshape(-1, 2).T
    while (apart := label[ends] != label[other]).any():
        ends, other = ends[apart], other[apart]
        low, high = np.sort([label[ends], label[other]], axis=0)
        np.minimum.at(label, high, low)  # a group's head follows the lowest head that it is paired with
        while not np.array_equal(head := label[label], label):
            label = head
    return np.unique(label, return_inverse=True)[1]


def joined_by(shared: Numbers) -> Numbers:
    """Return the group of each row of a table, shape (n, k), such as of the nodes of edges, as `joined` does; rows with a
    value in common are in one group."""
    rows, width = shared.shape
    value = np.unique(shared, return_inverse=True)[1].ravel()
    row = np.repeat(np.arange(rows), width)
    group = joined(np.column_stack([row, rows + value]), rows + int(value.max(initial=-1)) + 1)[:rows]
    return np.unique(group, return_inverse=True)[1]


# ----------------------------------------------------------------------------------------------------------------------
# Where a cavity's walls end, and what closes it there.
#
# The air's volume is an integral over only the walls. That is right where they are closed, or end on cut planes, on the axis of
# a section, or in a plane through the origin along whose normal a support holds them: there the integral has nothing to add.
# Walls that end anywhere else have a face missing. Every edge of a closed surface belongs to two of its facets: that is exact.


POINT_TOLERANCE = 1e-6
"""What counts as the same place, in sizes of the device, and as the same direction."""
MAX_LISTED_NAMES = 6

Ints = NDArray[np.int64]


@dataclasses.dataclass(frozen=True)
class Opening:
    """A line (a point in a section) on which a cavity's walls end: its middle in m, device coordinates, and the unit normal
    of the plane through the origin that it lies in, if there is one. ``roles`` are physical groups that the line's nodes
    belong to, beside the walls': one set for all nodes alike; ``faces`` those that are faces or lines, without cut planes."""

    cavity: str
    place: Vector
    normal: Vector | None
    roles: frozenset[frozenset[str]]
    faces: tuple[str, ...]

    def closed_by(self, holds: Iterable[Hold]) -> bool:
        """Return whether its line stays in its plane, so that a plane closes it."""
        if self.normal is None:
            return False
        square = {
            role
            for hold in holds
            if hold.direction is None or abs(np.dot(hold.direction, self.normal)) > 1.0 - POINT_TOLERANCE
            for role in self._held_by(hold.role)
        }
        return all(roles & square for roles in self.roles)

    def _held_by(self, role: str) -> tuple[str, ...]:
        """Return the roles whose nodes on the line are held, by a role or by the edge of the walls and a face."""
        edge = EDGE.fullmatch(role)
        return (
            tuple(name for name in edge.groups() if name != self.cavity) if edge and self.cavity in edge.groups() else (role,)
        )


EDGE = re.compile(r"edge of (\S+) and (\S+)")
"""How the edge of two faces is written."""


def cavity_roles(actuator: Actuator) -> list[str]:
    """Return the roles of the walls of a device's cavities."""
    return ["cavity", *(f"cavity{i + 1}" for i in range(1, len(actuator.ratios)))][: len(actuator.ratios)]


def check_closed(actuator: Actuator, openings: Iterable[Opening], holds: Iterable[Hold]) -> None:
    """Reject cavities that nothing closes, from the openings of `find_openings` and what is held beside the cut planes.
    GeometryError names the first opening that no plane closes, with its place and the faces there."""
    for opening in openings:
        if opening.closed_by(holds):
            continue
        shown = ", ".join(opening.faces[:MAX_LISTED_NAMES]) or "without a name"
        place = ", ".join(f"{1e3 * x:.4g}" for x in opening.place)
        walls = f"the walls {opening.cavity!r} of {type(actuator).__name__}"
        where = f"{walls} end near {place} mm, where other faces are ({shown})"
        if opening.normal is None:
            raise GeometryError(
                f"{where}, so that the cavity is open there and has no volume; name every face around the air "
                f"{opening.cavity!r}. It may be open on cut planes, and in a plane through the origin whose normal is held"
            )
        along = ", ".join(f"{x:g}" for x in opening.normal)
        raise GeometryError(
            f"{where}; the cavity is open in a plane through the origin, and its volume is known only while nothing moves out "
            f"of that plane there: hold one of these faces along {along}, or name the face that closes it {opening.cavity!r}"
        )


def find_openings(actuator: Actuator) -> tuple[Opening, ...]:
    """Return where the cavities of the mesh in the current Gmsh model end, but on cut planes and on the axis of a section."""
    d = actuator.dimension
    groups = meshing.named_groups()
    walls = {name: (dimension, tag) for dimension, tag, name in groups if dimension == d - 1}
    members: dict[str, Ints] = {}

    def nodes(name: str) -> Ints:
        if name not in members:  # a region and a face may bear one name
            node_sets = [gmsh.model.mesh.getNodesForPhysicalGroup(*group)[0] for *group, known in groups if known == name]
            members[name] = np.unique(np.concatenate(node_sets).astype(np.int64))
        return members[name]

    symmetric = [*(plane.name for plane in actuator.cut_planes), *(["axis"] if d == 2 else [])]
    faces = {name for dimension, _, name in groups if dimension < d and name not in symmetric}
    openings = []
    for cavity in cavity_roles(actuator):
        if cavity not in walls:
            continue  # which is reported where the mesh is read
        rim = _boundary_edges(walls[cavity], d)
        for name in symmetric:
            if name in walls:
                rim = rim[~np.isin(rim, nodes(name)).all(axis=1)]
        others = dict.fromkeys(name for _, _, name in groups if name != cavity) if len(rim) else {}
        group = joined_by(rim)
        for piece in range(group.max(initial=-1) + 1):
            line = np.unique(rim[group == piece])
            places = actuator.device_points(np.array([gmsh.model.mesh.getNode(int(tag))[0] for tag in line]))
            kinds = frozenset(
                frozenset(name for name, there in zip(others, row, strict=True) if there)
                for row in np.array([np.isin(line, nodes(name)) for name in others]).T
            )
            beside = tuple(sorted(faces & frozenset().union(*kinds)))
            openings.append(Opening(cavity, arrays.triple(places.mean(axis=0)), _plane(actuator, places), kinds, beside))
    return tuple(openings)


def _boundary_edges(group: tuple[int, int], space: int) -> Ints:
    """Return the edges that an odd number of a group's triangles have (or ends, of its lines in a section), shape (n, space -
    1)."""
    sides = []
    for entity in gmsh.model.getEntitiesForPhysicalGroup(*group):
        for kind, _, nodes in zip(*gmsh.model.mesh.getElements(group[0], entity), strict=True):
            width = gmsh.model.mesh.getElementProperties(kind)[3]
            corners = nodes.astype(np.int64).reshape(-1, width)[:, :space]
            sides.append(np.concatenate([np.delete(corners, k, axis=1) for k in range(space)]))
    if not sides:
        return np.empty((0, space - 1), dtype=np.int64)
    edges, count = np.unique(np.sort(np.concatenate(sides), axis=1), axis=0, return_counts=True)
    return np.asarray(edges[count % 2 == 1])


def _plane(actuator: Actuator, places: NDArray[np.float64]) -> Vector | None:
    """Return the unit normal of the plane through the origin, or where a plate closes the air, that holds the places and their
    images by symmetry; None if there is none."""
    mirrors = [plane.normal for plane in actuator.cut_planes]
    if actuator.dimension == 2:
        mirrors += [(1.0, 0.0, 0.0), (np.sqrt(0.5), np.sqrt(0.5), 0.0)]  # a section's point is turned into a circle
    places = places - actuator.plate
    images = [places - 2.0 * np.outer(places @ normal, normal) for normal in mirrors]
    points = np.concatenate([places, *images])
    normal = np.linalg.svd(points)[2][2]
    if np.abs(points @ normal).max() > POINT_TOLERANCE * actuator.size:
        return None
    return arrays.triple(np.round(normal, 9) + 0.0)
