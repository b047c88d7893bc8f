"""Measure outlines in metres from photographs of a shadow.

    import measurement

    found = measurement.outlines("photos.csv", setup="setup.toml")
    found.outlines, found.refused

Every name is loaded when it is first used. Numbers are in SI units. Nothing is printed; errors are exceptions, with the
sentence that the command line prints.

A photograph goes through `pictures` (files as light), `camera` (the lens), `screen` (pixels to metres) and `outline` (the
shadow's edge, heights above the zero plane); `series` measures a whole run. `film`: photographs of a film and a log of its
pressures. `robust`: fits that outliers do not move.
`photographer`: photographs whose truth is known. `cli`: the commands.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from softmodels.common.names import lazy_names

if TYPE_CHECKING:
    from measurement.camera import Camera as Camera, CameraError as CameraError
    from measurement.outline.outline import Outline as Outline, OutlineError as OutlineError
    from measurement.screen.calibration import calibrate as calibrate, setup_from_grid as setup_from_grid
    from measurement.screen.grid import GridError as GridError
    from measurement.screen.setup import Setup as Setup, SetupError as SetupError
    from measurement.series.checks import (
        CourseEvidence as CourseEvidence,
        Doubt as Doubt,
        EdgeEvidence as EdgeEvidence,
        ListEvidence as ListEvidence,
        OutlineEvidence as OutlineEvidence,
        RunEvidence as RunEvidence,
        ToneEvidence as ToneEvidence,
        ZeroEvidence as ZeroEvidence,
        register_check as register_check,
    )
    from measurement.series.measuring import Measurement as Measurement, NoZero as NoZero, outlines as outlines
    from measurement.series.photo_list import (
        Column as Column,
        ColumnError as ColumnError,
        Photograph as Photograph,
        PhotoListError as PhotoListError,
        read_photos as read_photos,
    )
    from measurement.series.witness import Refusal as Refusal, Result as Result


_NAMES, __getattr__, __dir__ = lazy_names(__name__)

__all__ = [*_NAMES]
