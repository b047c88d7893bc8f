"""Materials held against measurements that they were not fitted to: one call from laws and data to a list of scores."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from geometries import Actuator
from measurement.arguments import checked, flag, several, span
from measurement.one_at_a_time import one_at_a_time
from measurement.outline.outline import Outline
from measurement.wording import known_are
from softmodels.case.case import Case
from softmodels.case.material_errors import MaterialErrors
from softmodels.fitting.curves.columns import TensileError
from softmodels.fitting.curves.curve import TensileCurve
from softmodels.fitting.curves.fit_curves import Curves, prepared
from softmodels.fitting.curves.stress_error import RELATIVE, StressError
from softmodels.fitting.problem import FitError
from softmodels.fitting.scoring import Score, score_curve, score_outlines
from softmodels.materials.material import Material
from softmodels.materials.silicones import material_of, named
from softmodels.materials.stability import described
from softmodels.mechanics.mpi import start

if TYPE_CHECKING:
    from mpi4py import MPI

    from softmodels.fitting.outlines.measured_device import MeasuredDevice

type Materials = Material | str | Sequence[Material | str] | Mapping[str, Material | str]
type Outlines = Path | str | Sequence[Outline | Path | str]


@checked
@one_at_a_time
def score(
    materials: Materials,
    curves: Curves = (),
    *,
    device: Actuator | Case | MeasuredDevice | None = None,
    outlines: Outlines = (),
    errors: Mapping[str, MaterialErrors | Path | str] = MappingProxyType({}),
    stretch: tuple[float, float] | None = None,
    stress_error: str = "auto",
    untrusted: bool = False,
) -> list[Score]:
    """Score materials against tensile curves, and against outlines of a device; nothing of the materials is fitted.

    With outlines, what the bench may have got wrong (an offset of the pressure, a leak, the zero plane) is fitted along, as in
    a fit. Under MPI all ranks call it.

    Args:
        materials: One, several, or by name, each a material or a silicone's name; without a name each is called by its law and
            numbers, or as the silicone it is.
        curves: Measured curves, or files with uniaxial ones (see `read_curve` for other tests).
        device: What was inflated, with ``outlines``.
        outlines: Outlines of it, or the files or folders that a measurement has written.
        errors: Of fitted materials, by their names: ``report.chosen.errors``, or the ``fitted.toml`` that ``fit`` has written.
            Scores then report how much of the misfit they explain.
        stretch: Range of stretch of the curves; None for the whole curves.
        stress_error: Standard error of the measured stress, such as ``"2%+0.5kPa"``; ``"auto"`` is 2 % and the curve's noise.
        untrusted: Whether outlines are taken that the measurement does not trust.

    Returns:
        A score for each measurement and material, for each measurement the best first.

    Raises:
        TensileError: A curve cannot be used, or a material has no stress somewhere on it.
        FitError: Outlines cannot be used, or the device has no such states under a material.
        MaterialError: Errors that are none, or those of another material.
    """
    known = _named(materials)
    uncertain = _errors(errors, known)
    measured = several("curves", curves, (TensileCurve, Path, str), "a curve or its file")
    ready = prepared(measured, span("stretch", stretch)) if measured else []
    given = several("outlines", outlines, (Outline, Path, str), "an outline, or a file or folder of outlines")
    flag("untrusted", untrusted)
    if (device is None) != (not given):
        raise FitError("a device and its outlines belong together; give both, or neither")
    if not ready and not given:
        raise FitError("there is nothing to score against; give a tensile curve, or a device with its outlines")
    error = error_of(stress_error)
    scores = [
        score_curve(name, one, curve, error, uncertain.get(name)) for curve in ready for name, one in known.items()
    ]
    if device is not None:
        scores += against_outlines(known, device, outlines_of(given, untrusted), start(), uncertain)
    places = {data: place for place, data in enumerate(dict.fromkeys(one.data for one in scores))}
    return sorted(scores, key=lambda one: (places[one.data], one.chi2))


def error_of(text: str) -> StressError:
    """The standard error of stresses that a score needs the size of.

    Raises:
        TensileError: No size, or not a size.
    """
    if text == "auto":
        return StressError(RELATIVE, None, True)
    if text == "constant":
        raise TensileError("a score needs the size of the error: write 2%+0.5kPa, or auto")
    return StressError.from_text(text)


def outlines_of(given: Iterable[Outline | Path | str], untrusted: bool) -> list[Outline]:
    """Outlines, those of files after the others."""
    from softmodels.fitting.outlines.reading import read_outlines

    given = list(given)
    files = [Path(one) for one in given if not isinstance(one, Outline)]
    found = [one for one in given if isinstance(one, Outline)]
    return [*found, *(read_outlines(files, untrusted) if files else [])]


def against_outlines(
    materials: Mapping[str, Material],
    device: Actuator | Case | MeasuredDevice,
    outlines: Sequence[Outline],
    comm: MPI.Comm,
    errors: Mapping[str, MaterialErrors] = MappingProxyType({}),
) -> list[Score]:
    """Scores of materials against outlines of a device, with their errors by name; see `score_outlines`.

    Raises:
        FitError: The device has no such states under a material, which is named.
    """
    scores = []
    for name, material in materials.items():
        try:
            scores.append(score_outlines(name, material, device, outlines, comm, errors.get(name)))
        except FitError as error:
            raise FitError(f"{name}: {error}") from error
    return scores


def _errors(
    errors: Mapping[str, MaterialErrors | Path | str], materials: Mapping[str, Material]
) -> dict[str, MaterialErrors]:
    found = {}
    for name, given in errors.items():
        if name not in materials:
            raise FitError(f"errors of {name!r} are given, which is not scored; {known_are(name, list(materials))}")
        found[name] = given if isinstance(given, MaterialErrors) else MaterialErrors.from_file(Path(given))
        found[name].check(materials[name])
    return found


def _named(materials: Materials) -> dict[str, Material]:
    """Materials by what they are called in the scores.

    Raises:
        FitError: None, or one twice.
    """
    if isinstance(materials, Mapping):
        found = {str(name): material_of(f"material {name}", one) for name, one in materials.items()}
    else:
        wanted = "a material, or the name of a silicone"
        given = [material_of("material", one) for one in several("materials", materials, (Material, str), wanted)]
        found = {named(one) or described(one): one for one in given}
        if len(found) < len(given):
            raise FitError("a material is given twice")
    if not found:
        raise FitError("there is nothing to score; give a material")
    return found
