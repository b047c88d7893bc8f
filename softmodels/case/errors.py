"""What can be wrong with a case: each is a sentence for the user, found before anything is solved."""

from __future__ import annotations

from geometries.errors import FieldError, GeometryError
from measurement.wording import Spoken
from softmodels.case.gauges import GaugeError
from softmodels.case.ranges import SeriesError
from softmodels.materials.laws import MaterialError
from softmodels.mechanics.contact import ObstacleError
from softmodels.mechanics.parts import PartError
from softmodels.path.air_supply import SupplyError
from softmodels.path.program import ProgramError


class CaseError(Spoken, ValueError):
    """Bad input, found before anything is solved; the message is a sentence for the user."""


PART_ERRORS = (
    FieldError, GaugeError, GeometryError, MaterialError, ObstacleError, PartError, ProgramError, SeriesError,
    SupplyError,
)  # fmt: skip
"""What the parts of a case raise."""
INPUT_ERRORS = (CaseError, *PART_ERRORS)
