"""The call of a notebook for a mould: a device, a case or a case file, and a folder."""

from __future__ import annotations

from pathlib import Path

from geometries import Actuator
from measurement.result_folder import ResultFolder
from softmodels.case.case import Case
from softmodels.design.mould.asked import asked_of
from softmodels.design.mould.files import write_bodies
from softmodels.design.mould.make import Made, made
from softmodels.pictures.mould_sheet import write_sheet


def mould(
    device: Actuator | Case | str | Path,
    folder: str | Path | None = None,
    silicone: str | None = None,
    **settings: object,
) -> Made:
    """Make the mould of a device, and write it if a folder is given.

    Args:
        device: A device, a case, or a case file.
        folder: Where STEP and STL of each body, the sheet and the pictures go: empty, not there, or an earlier mould's.
        silicone: Product that is cast, such as ``"ecoflex-00-30"``; the case's if not given.
        settings: Fields of `softmodels.design.mould.settings.Workshop`: numbers in SI units (angles in degrees), or
            texts with a unit, such as ``draft="2 deg"``.

    Returns:
        The bodies, what they cast, and what was checked.

    Raises:
        MouldError, CaseError, GeometryError: What cannot be made so.
        OwnFolderError: A folder that holds something else.
        MeshingError: The CAD kernel fails, or a body fails a check.
    """
    asked = asked_of(device, silicone, **settings)
    if folder is None:
        return made(asked.device, asked.workshop)
    options = {"silicone": asked.silicone, "workshop": asked.workshop}
    place = ResultFolder(Path(folder), Path(folder), "mould", options)
    try:
        found = made(asked.device, asked.workshop)
        with place.writing() as inside:
            write_bodies(inside, asked, found)
            write_sheet(inside, asked, found)
    finally:
        place.leave()
    return found
