"""The camera that the options ``--lens``, ``--camera`` and ``--focal`` of the setup command mean."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from measurement.camera.camera import Camera, CameraError
from measurement.camera.lens import Exif, lens_profile, read_exif
from measurement.cli import option_texts as texts
from measurement.toml_file import TomlError, read_toml


@dataclasses.dataclass(frozen=True)
class LensOptions:
    """The options' texts.

    Attributes:
        lens: ``auto``, ``none``, a lens' name, a camera file or a profile.
        body: Name of the camera; None for what EXIF names.
        focal: Focal length with its unit; None for what EXIF tells.
    """

    lens: str
    body: str | None
    focal: str | None

    def camera(self, photograph: Path, width: int, height: int) -> Camera:
        """The camera of a photograph of this size in px.

        Raises:
            CameraError, UnitError: There is no such camera.
        """
        length = None if self.focal is None else texts.length(self.focal) * 1e3
        if self.lens == "none":
            return Camera.ideal(width, height)
        if self.lens.endswith(".toml"):
            camera = _camera_file(Path(self.lens))
            if (camera.width, camera.height) != (width, height):
                raise CameraError(
                    f"{self.lens} is for pictures of {camera.width} x {camera.height} px, {photograph} has {width} x "
                    f"{height}; calibrate with the same settings"
                )
            return camera
        names = self._names(photograph)
        if self.lens.endswith(".xml"):
            return lens_profile(names, width, height, focal_mm=length, database=Path(self.lens))
        return lens_profile(names, width, height, lens=None if self.lens == "auto" else self.lens, focal_mm=length)

    def _names(self, photograph: Path) -> Exif:
        try:
            seen = read_exif(photograph)
        except CameraError as error:
            if self.body is None:
                raise CameraError(f"{error}, or use --lens none") from None
            return Exif("", self.body, "")
        return seen if self.body is None else Exif("", self.body, seen.lens, seen.focal_mm)


def _camera_file(path: Path) -> Camera:
    try:
        table = read_toml(path)
    except TomlError as error:
        raise CameraError(f"the camera {path} {error}") from None
    if not isinstance(table.get("camera"), dict):
        raise CameraError(f"{path} holds no camera; make it with python -m measurement calibrate")
    return Camera.from_table(table["camera"])
