"""The command ``score``: compare materials with measurements they were not fitted to."""

from __future__ import annotations

import contextlib
import math
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

import click

from geometries.options import QuantityType
from softmodels.cli.curve_command import read_material
from softmodels.cli.options import fail
from softmodels.cli.tensile_options import (
    CurveFiles,
    curve_file,
    height_datum_option,
    read_curves,
    specimen_options,
    tensile_option,
)
from softmodels.common.commands import FolderType, open_folder, status_of
from softmodels.common.folders import OwnFolderError
from softmodels.common.terminal import say
from softmodels.common.units import UnitError
from softmodels.fitting.curves.curve import TensileError
from softmodels.fitting.problem import FitError
from softmodels.fitting.scoring import Score, against_outlines, error_of, score_curve, write_scores
from softmodels.materials.laws import Material, MaterialError
from softmodels.mechanics.mpi import speaks

if TYPE_CHECKING:
    from measurement.outline.outline import Outline
    from softmodels.case.materials import MaterialErrors
    from softmodels.fitting.outlines.device import MeasuredDevice


class ScoreGiven(CurveFiles):
    """Values of the command's further options, by name."""

    stretch: str | None
    stress_error: str
    untrusted: bool
    height_datum: str | None
    radius: float | None
    thickness: float | None


@click.command("score", context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("files", metavar="[CASE.toml OUTLINES...]", nargs=-1, type=click.Path(path_type=Path))
@click.option("--material", "names", multiple=True, metavar="NAME[:KEY=VALUE,...]",
              help="Silicone, TOML file such as fitted.toml, or law with numbers; several are compared.")  # fmt: skip
@tensile_option()
@click.option("--stretch", metavar="FROM:TO", help="Range of stretch of the curves.  [default: the whole curves]")
@click.option("--stress-error", default="auto", show_default=True, metavar="ERROR",
              help="Standard error of the measured stress, 2%+0.5kPa; auto is 2 % and the curve's noise.")  # fmt: skip
@click.option("--untrusted", is_flag=True, help="Also use outlines that the measurement flags as untrusted.")
@height_datum_option
@specimen_options
@click.option("--radius", type=QuantityType("m"), help="A balloon's undeformed radius.")
@click.option("--thickness", type=QuantityType("m"), help="Its undeformed thickness.")
@click.option("--quiet", is_flag=True, help="Print only errors.")
@click.option("-o", "--output", type=FolderType(), help="Folder for the table scores.csv.  [default: results/score; "
              "results/score-2 and so on if that holds other scores]")  # fmt: skip
def score(
    files: tuple[Path, ...], names: tuple[str, ...], output: Path | None, quiet: bool, **options: Unpack[ScoreGiven]
) -> None:
    """Score materials against held-out tensile curves, or against outlines of a device.

    The material is not fitted. For each measurement these are reported: the root mean square of predicted minus measured;
    chi squared per value (1: within the measurement's error; 100: a law that is 10 standard errors off); the parts of it
    explained by the errors of the measurement and of the material (from a fitted.toml: the 95 % region of its covariance, as in
    the band of a run); the number of values within the 95 % band of the measurement's error; and the largest deviation.
    With outlines, systematic errors of the bench (offset of the pressure, leak, zero plane) are fitted too, as in a fit.
    A material with a memory is followed through the times of the whole test; FILE:TEST:RATE gives a rate if there are none.

    \b
    Examples:
      softmodels score --material ecoflex-00-30 --material ecoflex-00-30/marechal-2021 --tensile pull.csv --stretch 1.02:3
      softmodels score --material results/fit/fitted.toml --tensile other.csv --stress-error 2%+0.5kPa
      softmodels score results/disk/case.toml outlines/ --material results/fit/fitted.toml --material yeoh:c1=14kPa

    \b
    Exit status: 0 done; 1 a material has no states to compare; 2 bad input.
    """
    try:
        materials = _materials(names)
        if not files and not options["tensile"]:
            raise TensileError(
                "nothing to score against; give a curve with --tensile FILE, or a case with its outlines"
            )
        if len(files) == 1:
            raise TensileError(f"{files[0]} describes only the device; add its outlines")
        error = error_of(options["stress_error"])
        curves = []
        if options["tensile"]:
            remembers = any(one.memory is not None for one in materials.values())
            curves = read_curves(options, options["radius"], options["thickness"], options["stretch"], remembers)
        device, outlines = _device(files, options) if files else (None, [])
        read = [*files, *map(Path, names), *map(curve_file, options["tensile"])]
        asked = {**options, "names": names, "files": [str(file) for file in files]}
        folder = open_folder(output, Path("results/score"), "scores", asked, read) if speaks() else None
        errors = _errors(names)
        scores = [
            score_curve(name, one, curve, error, errors.get(name))
            for curve in curves
            for name, one in materials.items()
        ]
    except (FitError, MaterialError, OwnFolderError, TensileError, UnitError) as trouble:
        fail(str(trouble))
    if device is not None:
        scores += _outline_scores(materials, device, outlines, errors)
    if folder is None:
        return
    try:
        with folder.writing() as place:
            write_scores(place / "scores.csv", scores)
    except OwnFolderError as trouble:
        fail(str(trouble))
    except OSError as trouble:
        fail(f"the results cannot be written ({trouble.strerror or trouble})", status_of(trouble))
    if not quiet:
        say(as_text(scores))
        say(f"written to {folder.path}")


def _materials(names: tuple[str, ...]) -> dict[str, Material]:
    if not names:
        raise MaterialError("nothing to score; give a material with --material NAME")
    if len(set(names)) < len(names):
        raise MaterialError("a material is named twice")
    return {name: read_material(name) for name in names}


def _device(files: tuple[Path, ...], options: ScoreGiven) -> tuple[MeasuredDevice, list[Outline]]:
    from softmodels.case.case import Case
    from softmodels.case.entries import CaseError
    from softmodels.fitting.outlines.device import MeasuredDevice
    from softmodels.fitting.outlines.shapes import read_outlines

    try:
        case = Case.from_file(files[0])
    except CaseError as error:
        raise FitError(str(error)) from None
    device = MeasuredDevice.of(case).counting_from(options["height_datum"] or "")
    return device, read_outlines(files[1:], options["untrusted"])


def _errors(names: tuple[str, ...]) -> dict[str, MaterialErrors]:
    """Return the errors of those materials that are files of a fit."""
    from softmodels.case.materials import MaterialErrors

    found = {}
    for name in names:
        if name.endswith(".toml"):
            with contextlib.suppress(MaterialError):  # a material without a fit, or a fit without intervals
                found[name] = MaterialErrors.from_file(Path(name))
    return found


def _outline_scores(
    materials: dict[str, Material],
    device: MeasuredDevice,
    outlines: list[Outline],
    errors: dict[str, MaterialErrors],
) -> list[Score]:
    from softmodels.mechanics.mpi import abort_on_error, start
    from softmodels.runs.outcomes import FAILED

    comm = start()
    abort_on_error(comm)
    try:
        return against_outlines(materials, device, outlines, comm, errors)
    except FitError as error:
        fail(str(error), FAILED)
        raise


def as_text(scores: list[Score]) -> str:
    """Return the table for a terminal, the best material of each measurement first."""
    lines = []
    for data in dict.fromkeys(one.data for one in scores):
        lines.append(f"{data}:")
        lines.append(
            f"  {'material':34s} {'values':>6s} {'rms':>11s} {'chi2/value':>11s} {'of measurement':>15s} "
            f"{'of material':>12s} {'in 95 % band':>13s}  furthest off"
        )
        for one in sorted((s for s in scores if s.data == data), key=lambda s: s.chi2):
            rms = f"{one.rms / 1e3:.3g} kPa" if one.unit == "Pa" else f"{one.rms * 1e3:.3g} mm"
            material = f"{one.chi2_material:.3g}" if math.isfinite(one.chi2_material) else "unknown"
            chi2 = f"{one.chi2:11.4g} {one.chi2_measurement:15.3g} {material:>12s}"
            numbers = f"{one.count:6d} {rms:>11s} {chi2} {100 * one.coverage:11.1f} %"
            lines.append(f"  {one.material:34s} {numbers}  {one.worst}")
    return "\n".join(lines)
