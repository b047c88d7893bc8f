"""What parts from files have in common, whether they are drawn or meshed: texts that say which of their faces do what."""

from __future__ import annotations

import abc
import dataclasses
import hashlib
from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from geometries.actuator import Actuator, CutPlane, Hold, Vector
from geometries.errors import GeometryError
from geometries.fields import choice_field, list_field, text_field
from geometries.symmetry import reflected
from measurement.user_file import file_digest

BONDED = "bonded"
"""Role of the faces that a sheet can be bonded to."""


def only_inner_shell[Shell](file: str, inner: Sequence[Shell], centre: Callable[[Shell], NDArray[np.float64]]) -> Shell:
    """The wall of a part's only cavity.

    Args:
        file: The part's file.
        inner: Walls of the part that are neither its outside nor joined to it.
        centre: Gives the middle of a wall's box in m, shape (3,).

    Raises:
        GeometryError: There is none, or there are several; the message lists where they are.
    """
    if not inner:
        raise GeometryError(
            f"cavities is empty, and file {file} has no closed inner shell that could be the cavity: close its inlet where "
            "it is drawn, or name the planes of a part that is cut"
        )
    if len(inner) > 1:
        middles = sorted(tuple(1e3 * centre(shell)) for shell in inner)
        places = "; ".join(", ".join(f"{value:.4g}" for value in middle) for middle in middles[:4])
        places += "; ..." if len(inner) > 4 else ""
        raise GeometryError(
            f"cavities is empty, and file {file} has {len(inner)} closed inner shells, with their middles at {places} mm; "
            "give a point in the air of each cavity, such as cavities = ['at 10, 0, 4 mm']"
        )
    return inner[0]


def cavity_role(number: int) -> str:
    """Role of a cavity's walls, counted from 0."""
    return "cavity" if number == 0 else f"cavity{number + 1}"


@dataclasses.dataclass(frozen=True)
class Reading:
    """What a file holds, in m and m3, of the part as drawn.

    Attributes:
        normals: Outward unit normals of the cut planes.
        gauge: The corner whose motion is told.
        solid_volume: Of the solid.
        cavity_volumes: Of each cavity.
        regions: Names of its solids, if there are several.
    """

    normals: tuple[Vector, ...]
    gauge: Vector
    solid_volume: float
    cavity_volumes: tuple[float, ...]
    regions: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True, kw_only=True)
class ImportedPart(Actuator):
    """A part from a file, with one or more closed cavities; without ``cavities`` its only closed inner shell is the cavity.

    A half, a quarter or a wedge of a part is cut on planes through the origin (``planes``), which meet at 180/n degrees, and
    its cavities may be open there and nowhere else. Physical groups: volume "solid", or several by their names; surfaces
    "cavity", "cavity2", ... in the order of ``cavities``, "support", "plane0", "plane1", ..., "bonded" if given, and "outer".
    `geometries.selections` tells how faces are picked.

    With several cavities, cavity i has the pressure ``pressure_ratios[i]`` times P. Then P works on the sum of the volumes
    times their ratios, and that is what `cavity_volume` and a run's added volume are. A load that gives each cavity a series
    of its own needs no ratios.
    """

    file: str = text_field("", "the part's file")
    cavities: tuple[str, ...] = list_field(
        (),
        "a point in the air of each cavity, such as 'at 10, 0, 4 mm', or faces of its wall, such as 'named chamber'; "
        "not needed where the part has exactly one closed inner shell",
    )
    support: str = text_field("", "held faces, such as 'x = 0 mm' or 'named flange'; three planes need none")
    bonded: str = text_field("", "faces that a sheet can be bonded to, such as 'coloured red'; none if not given")
    planes: tuple[str, ...] = list_field(
        (), "symmetry planes through the origin where the part is cut, such as 'y = 0 mm' or 'normal 1, -1, 0'"
    )
    pressure_ratios: tuple[float, ...] = list_field(
        (), "pressure in each cavity over the requested one; all 1 if not given", numbers=True, shape=False
    )
    gauge_point: str = text_field(
        "", "corner whose motion is told, such as 'at 70, 0, 4 mm'; the farthest if not given"
    )
    rise: str = choice_field("z", ("x", "y", "z"), "direction in which that motion is counted")

    stem: ClassVar = "part"
    unbonded: ClassVar = ("outer",)
    meeting: ClassVar = None
    kind: ClassVar[str] = "file"
    """What the file is, for messages."""

    def check(self) -> None:
        if not self.file:
            raise GeometryError(f"file is empty; name the part's {self.kind}")
        if not self.support and len(self.planes) < 3:
            raise GeometryError("support is empty; say which faces are held, such as 'x = 0 mm'")
        if len(set(self.planes)) != len(self.planes) or len(self.planes) > 3:
            raise GeometryError(f"planes is {', '.join(self.planes)}; at most three, each once")
        if self.pressure_ratios and len(self.pressure_ratios) != self.cavity_count:
            cavities = f"{self.cavity_count} cavit{'y' if self.cavity_count == 1 else 'ies'}"
            raise GeometryError(f"pressure_ratios has {len(self.pressure_ratios)} values for {cavities}; give one each")
        if any(ratio < 0.0 for ratio in self.pressure_ratios) or not any(self.ratios):
            raise GeometryError("pressure_ratios must be 0 or more, and one of them above 0; suction is not modelled")
        self.check_cells()
        _ = self.reading

    @abc.abstractmethod
    def check_cells(self) -> None:
        """Check what decides the mesh, before the file is opened."""

    @property
    @abc.abstractmethod
    def reading(self) -> Reading:
        """What the file holds; read once."""

    def digest(self) -> str:
        """SHA-256 of the file's content.

        Raises:
            GeometryError: It cannot be read.
        """
        try:
            return file_digest(self.file)
        except OSError as error:
            raise GeometryError(f"file {self.file} cannot be read ({error.strerror})") from None
        except ValueError:  # a zero byte in its name
            raise GeometryError(f"file {self.file!r} is no name of a file") from None

    @property
    def files(self) -> Mapping[str, str]:
        return {"file": self.file}

    @property
    def key(self) -> str:
        """Twelve digits that change with the parameters and with what the file holds, not with where it is."""
        parameters = [(f.name, getattr(self, f.name)) for f in dataclasses.fields(self) if f.name != "file"]
        return hashlib.sha256(repr((type(self).__name__, self.digest(), parameters)).encode()).hexdigest()[:12]

    @property
    def copies(self) -> int:
        return len(reflected(self.reading.normals))

    @property
    def faces(self) -> tuple[str, ...]:  # type: ignore[override]
        return (BONDED,) if self.bonded else ()

    @property
    def fuller(self) -> str:
        return "a drawing of the whole part, without planes,"

    @property
    def lift(self) -> Vector:  # type: ignore[override]
        return (float(self.rise == "x"), float(self.rise == "y"), float(self.rise == "z"))

    @property
    def ratios(self) -> tuple[float, ...]:
        return self.pressure_ratios or (1.0,) * self.cavity_count

    @property
    def cavity_count(self) -> int:
        """Number of cavities; 1 where none is named, because then the file's only closed inner shell is the cavity."""
        return max(len(self.cavities), 1)

    @property
    def size(self) -> float:
        return float(np.cbrt(max(self.reading.cavity_volumes)))

    @property
    def cut_planes(self) -> tuple[CutPlane, ...]:
        return tuple(CutPlane(f"plane{i}", normal) for i, normal in enumerate(self.reading.normals))

    @property
    def holds(self) -> tuple[Hold, ...]:
        return (Hold("support", None),) if self.support else ()

    @property
    def probes(self) -> Mapping[str, Vector]:
        return {"tip": self.reading.gauge}

    @property
    def cavity_volume(self) -> float:
        """Sum of the whole part's cavities in m3, each times its pressure ratio, from a mesh of their walls."""
        volumes = zip(self.ratios, self.reading.cavity_volumes, strict=True)
        return self.copies * sum(ratio * volume for ratio, volume in volumes)

    @property
    def solid_volume(self) -> float:
        """Volume in m3 of the whole part."""
        return self.copies * self.reading.solid_volume

    def on_profile(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """None: which line a camera would see is not known of a foreign part."""
        return np.zeros(len(points), dtype=bool)
