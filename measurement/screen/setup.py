"""What stays the same over a run of photographs: camera, screen, light, region and zero line; kept in one TOML file."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from numpy.typing import ArrayLike

from measurement.camera.camera import Camera, CameraError, Points, as_points
from measurement.screen.plane import Plane
from softmodels.common.errors import known_are
from softmodels.common.tables import TomlError, numbers, parse_toml, read_toml
from softmodels.common.units import brief, number

VERSION = 1
"""Version of the setup file; one that means something else by its numbers gets another."""

FINEST_PITCH = 4.0
"""Pixels between two lines that can be told apart."""

HEADER = "# Setup of a run of photographs, lengths in m and pixels as (x, y); made by python -m measurement setup.\n"


class SetupError(ValueError):
    """An unusable setup; the message is for the user."""


PITCH_ERROR = 0.002
"""Standard error of a pitch as a share of it where none is given: printers scale by some tenths of a percent."""


@dataclasses.dataclass(frozen=True, eq=False)
class Setup:
    """Mapping from pixels to metres.

    Light that comes from a lamp at the distance a before the object throws a shadow (a + b) / a times as large as the
    object on a screen at the distance b behind it; lengths on the screen are divided by this magnification.

    Attributes:
        camera: The camera.
        plane: The screen.
        magnification: Size of the shadow over the size of the object.
        magnification_error: Its standard error.
        pitch_error: Standard error of the printed pitch, and so of all lengths on the screen, as a share of it.
        zero: Two points (2, 2) in m, as `to_metres` gives them, on the undeformed surface; None where unknown.
        roi: Region of interest as x0, y0, x1, y1 in px of the photograph; None for all of it.
        grid_pitch: Distance of the grid's lines in m; None where the screen's points were given.
        shadow_colour: Red, green, blue of the shadow, 0 to 255; None to find it in each photograph.
    """

    camera: Camera
    plane: Plane
    magnification: float = 1.0
    magnification_error: float = 0.0
    pitch_error: float = 0.0
    zero: Points | None = None
    roi: tuple[float, float, float, float] | None = None
    grid_pitch: float | None = None
    shadow_colour: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        if not (0.0 < self.magnification < math.inf and 0.0 <= self.magnification_error < math.inf):
            raise SetupError("the magnification must be positive and its error must not be negative")
        if self.magnification_error >= self.magnification:
            raise SetupError(
                f"the magnification {self.magnification:g} +- {self.magnification_error:g} is undetermined; its error "
                "must be smaller than the value"
            )
        if not 0.0 <= self.pitch_error < 1.0:
            raise SetupError(f"the pitch's error must be a share from 0 to 1 of the pitch, not {self.pitch_error:g}")
        if self.grid_pitch is not None:
            self._check_pitch(self.grid_pitch)
        if self.zero is not None:
            zero = np.array(self.zero, dtype=float)
            if zero.shape != (2, 2) or not np.isfinite(zero).all() or np.allclose(zero[0], zero[1], atol=1e-12):
                raise SetupError("the zero line needs two different points in m")
            object.__setattr__(self, "zero", zero)
        if self.roi is not None:
            x0, y0, x1, y1 = self.roi
            if not (0 <= x0 < x1 <= self.camera.width and 0 <= y0 < y1 <= self.camera.height):
                raise SetupError(
                    f"the region of interest {x0:g},{y0:g},{x1:g},{y1:g} is not x0,y0,x1,y1 inside of the picture of "
                    f"{self.camera.width} x {self.camera.height} px"
                )

    def _check_pitch(self, pitch: float) -> None:
        """Reject a pitch whose lines the picture cannot show: looking for them would take all memory, or for ever."""
        if not 0.0 < pitch < math.inf:
            raise SetupError("the grid's pitch must be a positive length in m")
        width, height = self.camera.width, self.camera.height
        columns, rows = np.meshgrid(np.linspace(0, width - 1, 9), np.linspace(0, height - 1, 9))
        places = self.plane.to_metres(self.camera.undistort(np.column_stack([columns.ravel(), rows.ravel()])))
        places = places[np.isfinite(places).all(axis=1)]
        if not len(places):
            raise SetupError("the lens correction or the screen's plane is defined nowhere in the picture")
        seen = float(np.ptp(places, axis=0).max())
        if not FINEST_PITCH * seen / max(width, height) <= pitch <= seen:
            raise SetupError(
                f"the grid's pitch of {pitch * 1e3:g} mm does not match a picture that shows {seen * 1e3:.3g} mm of the "
                f"screen in {max(width, height)} px; the setup is in m"
            )

    @property
    def scale_error(self) -> float:
        """Standard error of all lengths together, as a share of them: the magnification's and the pitch's."""
        return math.hypot(self.magnification_error / self.magnification, self.pitch_error)

    @property
    def exact_scale(self) -> Setup:
        """This setup with a scale that has no error, for errors of points against each other."""
        return dataclasses.replace(self, magnification_error=0.0, pitch_error=0.0)

    def to_metres(self, raw_px: ArrayLike) -> Points:
        """Return the points (n, 2) of the object's plane in m for pixels (n, 2) of the photograph."""
        return self.plane.to_metres(self.camera.undistort(raw_px)) / self.magnification

    def to_pixels(self, metres: ArrayLike) -> Points:
        """Return the pixels (n, 2) of the photograph for points (n, 2) of the object's plane in m."""
        return self.camera.distort(self.plane.to_pixels(as_points(metres) * self.magnification))

    def jacobian(self, raw_px: ArrayLike) -> Points:
        """Return the derivative (n, 2, 2) of `to_metres` in m per px; the last index is the pixel's."""
        raw, step = as_points(raw_px), 0.5
        lens = np.empty((len(raw), 2, 2))
        for axis in (0, 1):
            aside = step * np.eye(2)[axis]
            lens[:, :, axis] = (self.camera.undistort(raw + aside) - self.camera.undistort(raw - aside)) / (2 * step)
        return self.plane.jacobian(self.camera.undistort(raw)) @ lens / self.magnification

    def error(
        self,
        raw_px: ArrayLike,
        edge_sigma_px: ArrayLike,
        normal: ArrayLike | None = None,
        about: ArrayLike | None = None,
    ) -> Points:
        """Return the standard error (n,) in m of points on an edge: edge, lens, grid fit and scale together.

        Args:
            raw_px: Points (n, 2) in px of the photograph.
            edge_sigma_px: Standard error of the edge's place across the edge in px, one for all or one per point (n,).
            normal: Directions (n, 2) or (2,) across the edge in the plane of X and Z, of any length. Without them the
                result is the root mean square over all directions.
            about: Point (2,) in m from which lengths are measured, where a wrong magnification does no harm; the middle
                of the zero line, or (0, 0), unless given.
        """
        raw = as_points(raw_px)
        slope = self.jacobian(raw)
        sigma = np.broadcast_to(np.asarray(edge_sigma_px, dtype=float), (len(raw),))
        # An error e across the edge in the photograph moves it by |J^T n| e across the edge on the screen, so that the
        # edge may be treated as if it were uncertain in all directions.
        pixel = (sigma**2 + self.camera.error(raw) ** 2)[:, None, None]
        spread = pixel * (slope @ np.swapaxes(slope, 1, 2))
        spread += self.plane.covariances(self.camera.undistort(raw)) / self.magnification**2
        spread += (self.plane.systematic / self.magnification) ** 2 * np.eye(2)
        if about is None:
            about = np.zeros(2) if self.zero is None else self.zero.mean(axis=0)
        arm = (self.to_metres(raw) - np.asarray(about, dtype=float)) * self.scale_error
        spread += arm[:, :, None] * arm[:, None, :]
        if normal is None:
            return np.sqrt(np.trace(spread, axis1=1, axis2=2) / 2.0)
        across = np.broadcast_to(np.asarray(normal, dtype=float), (len(raw), 2))
        across = across / np.linalg.norm(across, axis=1, keepdims=True)
        return np.sqrt(np.einsum("ni,nij,nj->n", across, spread, across))

    def to_toml(self) -> str:
        """Return the setup as TOML; `from_toml` gives exactly the same numbers back."""
        table: dict[str, Any] = {
            "version": VERSION,
            "magnification": float(self.magnification),
            "magnification_error": float(self.magnification_error),
            "pitch_error": float(self.pitch_error),
        }
        if self.grid_pitch is not None:
            table["grid_pitch"] = float(self.grid_pitch)
        for name in ("zero", "roi", "shadow_colour"):
            if getattr(self, name) is not None:
                table[name] = np.asarray(getattr(self, name), dtype=float).tolist()
        table["camera"] = self.camera.as_table()
        table["plane"] = {
            field.name: np.asarray(getattr(self.plane, field.name)).tolist() for field in dataclasses.fields(Plane)
        }
        return HEADER + tomli_w.dumps(table)

    @classmethod
    def from_toml(cls, text: str) -> Setup:
        """Read what `to_toml` wrote.

        Raises:
            SetupError: No TOML, or a field that is missing, unknown or not what it should be.
        """
        try:
            return cls._from_toml(parse_toml(text))
        except TomlError as error:
            raise SetupError(f"the setup {error}") from None

    @classmethod
    def _from_toml(cls, table: Mapping[str, Any]) -> Setup:
        try:
            return cls._from_table(table)
        except KeyError as error:
            raise SetupError(f"the setup has no field {error}; recreate it with python -m measurement setup") from None
        except CameraError as error:
            raise SetupError(f"the setup's camera cannot be used: {error}") from None
        except SetupError:
            raise
        except (TypeError, ValueError, AttributeError, IndexError) as error:
            raise SetupError(f"the setup cannot be read: {error}") from None

    @classmethod
    def _from_table(cls, table: Mapping[str, Any]) -> Setup:
        if table.get("version", VERSION) != VERSION:
            raise SetupError(
                f"the setup is of version {brief(table['version'])}, this program reads version {VERSION}; recreate it "
                "with python -m measurement setup"
            )
        known = {"version"} | {field.name for field in dataclasses.fields(cls)}
        for name in table:
            if name not in known:
                raise SetupError(f"the setup has an unknown field {name!r}; {known_are(name, sorted(known))}")
        roi, colour = table.get("roi"), table.get("shadow_colour")
        if (roi is not None and len(roi) != 4) or (colour is not None and len(colour) != 3):
            raise SetupError("the setup's roi needs four numbers and its shadow_colour three")
        return cls(
            camera=Camera.from_table(table["camera"]),
            plane=_plane(table["plane"]),
            magnification=_float(table.get("magnification", 1.0)),
            magnification_error=_float(table.get("magnification_error", 0.0)),
            pitch_error=_float(table.get("pitch_error", 0.0)),
            zero=None if table.get("zero") is None else numbers(table["zero"]),
            roi=None if roi is None else (_float(roi[0]), _float(roi[1]), _float(roi[2]), _float(roi[3])),
            grid_pitch=None if table.get("grid_pitch") is None else _float(table["grid_pitch"]),
            shadow_colour=None if colour is None else (_float(colour[0]), _float(colour[1]), _float(colour[2])),
        )

    @classmethod
    def from_file(cls, path: Path | str) -> Setup:
        """Read a setup file.

        Raises:
            SetupError: The file cannot be read or holds no setup; the message names it.
        """
        try:
            return cls._from_toml(read_toml(Path(path)))
        except TomlError as error:
            raise SetupError(f"{path} {error}") from None
        except SetupError as error:
            raise SetupError(f"{path}: {error}") from None


def _float(value: Any) -> float:
    """Return a number of any kind; whether it is finite is asked by its name."""
    return value if isinstance(value, float) else number(value)


def _plane(table: Mapping[str, Any]) -> Plane:
    shapes = {"homography": (3, 3), "covariance": (9, 9), "points": (-1, 2), "targets": (-1, 2)}
    arrays = {name: numbers(table[name]).reshape(shape) for name, shape in shapes.items()}
    residual = _float(table["residual"])
    if not (all(np.isfinite(array).all() for array in arrays.values()) and math.isfinite(residual)):
        raise SetupError("the setup's plane holds numbers that are not finite")
    if abs(np.linalg.det(arrays["homography"] / np.abs(arrays["homography"]).max())) == 0.0:
        raise SetupError("the setup's homography cannot be inverted")
    return Plane(residual=residual, **arrays)


def magnification(
    lamp: float, screen: float, lamp_error: float = 0.0, screen_error: float = 0.0
) -> tuple[float, float]:
    """Return the magnification of a shadow and its standard error from the lamp's and the screen's distances.

    Args:
        lamp: Distance in m from the lamp to the object.
        screen: Distance in m from the object to the screen.
        lamp_error: Standard error of ``lamp`` in m.
        screen_error: Standard error of ``screen`` in m.
    """
    if not (lamp > 0.0 and screen >= 0.0 and lamp_error >= 0.0 and screen_error >= 0.0):
        raise SetupError("the lamp's distance must be positive, the screen's and all errors must not be negative")
    return (lamp + screen) / lamp, math.hypot(screen_error / lamp, screen * lamp_error / lamp**2)
