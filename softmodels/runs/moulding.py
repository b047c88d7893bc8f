"""The call of a notebook for a mould: a device, a case or a case file, and a folder."""

from __future__ import annotations

from pathlib import Path

from geometries import Actuator
from measurement.arguments import checked, place
from measurement.result_folder import ResultFolder
from softmodels.case.case import Case
from softmodels.design.mould.asked import asked_of
from softmodels.design.mould.files import write_bodies
from softmodels.design.mould.make import Made, made
from softmodels.pictures.mould_sheet import write_sheet


@checked
def mould(
    device: Actuator | Case | str | Path,
    folder: str | Path | None = None,
    silicone: str | None = None,
    *,
    wall: float | str | None = None,
    rim: float | str | None = None,
    draft: float | str | None = None,
    shrinkage: float | str | None = None,
    clearance: float | str | None = None,
    least_wall: float | str | None = None,
    least_gap: float | str | None = None,
    pin: float | str | None = None,
    pour: float | str | None = None,
    vent: float | str | None = None,
    vents: int | None = None,
    tube: float | str | None = None,
    chord: float | str | None = None,
    surplus: float | str | None = None,
    pull: str | None = None,
    split: str | None = None,
) -> Made:
    """Make the mould of a device, and write it if a folder is given.

    Args:
        device: A device, a case, or a case file.
        folder: Where STEP and STL of each body, the sheet and the pictures go: empty, not there, or an earlier mould's.
        silicone: Product that is cast, such as ``"ecoflex-00-30"``; the case's if not given.
        wall, rim, draft, shrinkage, clearance, least_wall, least_gap, pin, pour, vent, vents, tube, chord, surplus, pull,
            split: Fields of `softmodels.design.mould.settings.Workshop`: numbers in SI units (angles in degrees), or texts
            with a unit, such as ``draft="2 deg"``; the case file's, or that class' own, if None.

    Returns:
        The bodies, what they cast, and what was checked.

    Raises:
        MouldError, CaseError, GeometryError: What cannot be made so.
        OwnFolderError: A folder that holds something else.
        MeshingError: The CAD kernel fails, or a body fails a check.
    """
    asked = asked_of(
        device, silicone, wall=wall, rim=rim, draft=draft, shrinkage=shrinkage, clearance=clearance, least_wall=least_wall,
        least_gap=least_gap, pin=pin, pour=pour, vent=vent, vents=vents, tube=tube, chord=chord, surplus=surplus, pull=pull,
        split=split,
    )  # fmt: skip
    if folder is None:
        return made(asked.device, asked.workshop)
    output = place("folder", folder, "a folder")
    options = {"silicone": asked.silicone, "workshop": asked.workshop}
    own = ResultFolder(output, output, "mould", options)
    try:
        found = made(asked.device, asked.workshop)
        with own.writing() as inside:
            write_bodies(inside, asked, found)
            write_sheet(inside, asked, found)
    finally:
        own.leave()
    return found
