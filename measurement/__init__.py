"""From photographs of a shadow to outlines in metres.

    import measurement

    found = measurement.outlines("photos.csv", setup="setup.toml")
    found.outlines, found.refused

Every name is loaded when it is first used. Numbers are in SI units. Nothing is printed; errors are exceptions, with the
sentence that the command line prints.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from measurement.lazy_names import lazy_names

_PLACES = {
    "measurement.camera.camera": ("Camera", "CameraError"),
    "measurement.outline.outline": ("Outline", "OutlineError"),
    "measurement.screen.calibration": ("calibrate",),
    "measurement.screen.grid": ("GridError",),
    "measurement.screen.setup": ("Setup", "SetupError"),
    "measurement.screen.seen": ("setup_from_grid",),
    "measurement.series.column": ("Column", "ColumnError"),
    "measurement.series.measurement": ("Measurement", "outlines"),
    "measurement.series.measuring": ("NoZero", "Result"),
    "measurement.series.photo": ("Refusal",),
    "measurement.series.photo_list": ("Photograph", "PhotoListError", "read_photos"),
}
_NAMES, __getattr__, __dir__ = lazy_names(__name__, _PLACES)

__all__ = [*_NAMES]

if TYPE_CHECKING:
    from measurement.camera.camera import Camera as Camera
    from measurement.camera.camera import CameraError as CameraError
    from measurement.outline.outline import Outline as Outline
    from measurement.outline.outline import OutlineError as OutlineError
    from measurement.screen.calibration import calibrate as calibrate
    from measurement.screen.grid import GridError as GridError
    from measurement.screen.seen import setup_from_grid as setup_from_grid
    from measurement.screen.setup import Setup as Setup
    from measurement.screen.setup import SetupError as SetupError
    from measurement.series.column import Column as Column
    from measurement.series.column import ColumnError as ColumnError
    from measurement.series.measurement import Measurement as Measurement
    from measurement.series.measurement import outlines as outlines
    from measurement.series.measuring import NoZero as NoZero
    from measurement.series.measuring import Result as Result
    from measurement.series.photo import Refusal as Refusal
    from measurement.series.photo_list import Photograph as Photograph
    from measurement.series.photo_list import PhotoListError as PhotoListError
    from measurement.series.photo_list import read_photos as read_photos
