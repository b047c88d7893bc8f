"""The commands ``curve`` and ``score``, and the options of all commands that read tensile curves."""

from __future__ import annotations

import contextlib
import csv
import dataclasses
import math
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict, Unpack

import click
import numpy as np

from geometries.options import QuantityType
from softmodels.case.materials import material_from
from softmodels.cli.options import fail, write_into
from softmodels.common.commands import FolderType, open_folder
from softmodels.common.files import read_text, write_text
from softmodels.common.folders import OwnFolderError
from softmodels.common.pages import Fact, Page, Provenance, Table
from softmodels.common.processes import say
from softmodels.common.units import UnitError, brief, exact_text, number, quantity, with_prefix
from softmodels.fitting.curves.curve import EQUILIBRIUM, Specimen, TensileCurve, TensileError, read_curve
from softmodels.fitting.curves.fit import prepared
from softmodels.fitting.problem import HEIGHTS_FROM, FitError
from softmodels.fitting.scoring import Score, against_outlines, error_of, score_curve, write_scores
from softmodels.materials.laws import Material, MaterialError
from softmodels.materials.silicones import publications
from softmodels.materials.specimens import MODE_NAMES
from softmodels.materials.stability import MaterialCurves
from softmodels.mechanics.mpi import speaks

if TYPE_CHECKING:
    from measurement.outline.outline import Outline
    from softmodels.case.materials import MaterialErrors
    from softmodels.fitting.outlines.device import MeasuredDevice


class CurveFiles(TypedDict):
    """Values of the options of `tensile_option` and `specimen_options`."""

    tensile: tuple[str, ...]
    columns: str
    gauge_length: float | None
    cross_section: float | None


def tensile_option[Command: Callable[..., object]](
    text: str = "Curve of a test, FILE[:TEST][:RATE], CSV or Excel (.xlsx); may be given several times.",
) -> Callable[[Command], Command]:
    return click.option("--tensile", "tensile", multiple=True, metavar="FILE[:TEST][:RATE]", help=text)


def specimen_options[Command: Callable[..., object]](command: Command) -> Command:
    """Add the options for what a curve's file does not contain."""
    for flag, unit, text in (
        ("--gauge-length", "m", "Undeformed length, for files with extensions."),
        ("--cross-section", "m^2", "Undeformed cross-section, such as 18mm^2, for files with forces."),
    ):
        command = click.option(flag, type=QuantityType(unit), help=text)(command)
    text = "Columns of the files, if the headers do not name them: 'strain=1[%],stress=Load[kPa]'."
    return click.option("--columns", default="", metavar="KIND=COLUMN[UNIT],...", help=text)(command)


def check_curves_given(options: Mapping[str, object]) -> None:
    """Reject options about curves if no curve is given.

    Raises:
        TensileError: The first of them.
    """
    if options["tensile"]:
        return
    usual = {"columns": "", "gauge_length": None, "cross_section": None, "stretch": None, "radius": None, "thickness": None,
             "stress_error": "auto", "gauge_error": "auto"}  # fmt: skip
    for name, default in usual.items():
        if options.get(name, default) != default:
            raise TensileError(
                f"--{name.replace('_', '-')} applies to curves only; give one with --tensile, or leave it out"
            )


def read_curves(
    files: CurveFiles,
    radius: float | None,
    thickness: float | None,
    stretch: str | None = None,
    history: bool = False,
) -> list[TensileCurve]:
    """Read the curves of ``--tensile`` within ``--stretch``, and average dense ones (see `thinned`).

    Args:
        files: The curves.
        radius, thickness: Of a balloon, undeformed, in m.
        stretch: Range of stretch as typed; None for all.
        history: Whether the whole tests are needed, with their times.

    Raises:
        TensileError: A curve cannot be used, or they do not go together.
    """
    if not files["tensile"]:
        raise TensileError("nothing to fit to; give a curve with --tensile FILE")
    specimen = Specimen(files["cross_section"], files["gauge_length"], radius, thickness)
    curves = []
    for text in files["tensile"]:
        file, test, rate = parts(text)
        pace = rate_of(rate, files["gauge_length"])
        curves.append(read_curve(file, test, files["columns"], specimen, history=history, rate=pace))
    names = [curve.name for curve in curves]
    if len(set(names)) < len(names):  # files of one name in different folders
        texts = [text if names.count(name) > 1 else name for text, name in zip(files["tensile"], names, strict=True)]
        curves = [dataclasses.replace(curve, name=text) for curve, text in zip(curves, texts, strict=True)]
    return prepared(curves, stretch_range(stretch) if stretch else None, history)


def curve_file(text: str) -> Path:
    """Return the file of ``FILE[:TEST][:RATE]``."""
    return parts(text)[0]


def parts(text: str) -> tuple[Path, str, str]:
    """Return the parts of ``FILE[:TEST][:RATE]``; an empty rate where none is given."""
    name, test, rate = text, "uniaxial", ""
    while not Path(name).exists() and ":" in name:
        head, _, tail = name.rpartition(":")
        if not head:
            break
        if tail.lower() == _RELAXED or re.search(r"\d.*/", tail):
            rate = tail
        else:
            test = tail
        name = head
    return Path(name), test, rate


_RELAXED = "equilibrium"


def rate_of(text: str, length: float | None) -> float | None:
    """Return a rate in 1/s (see `read_curve`): of the stretch, or with the undeformed length in m of a speed."""
    if not text:
        return None
    if text.lower() == _RELAXED:
        return EQUILIBRIUM
    amount, _, unit = text.rpartition("/")
    try:
        time = quantity(f"1 {unit}", "s")
        try:
            rate = quantity(amount, "") / time
        except UnitError:
            speed = quantity(amount, "m") / time
            if length is None:
                raise TensileError(f"rate {brief(text)} is a speed; give the undeformed --gauge-length too") from None
            rate = speed / length
    except UnitError:
        raise TensileError(f"rate {brief(text)} is none; write 0.05/s, 5%/s or 50mm/min, or equilibrium") from None
    if not rate > 0.0:
        raise TensileError(f"rate {brief(text)} must be above zero; write 'equilibrium' for a relaxed test")
    return rate


def stretch_range(text: str) -> tuple[float, float]:
    """Read ``"1.02:6"``."""
    try:
        low, high = (number(part) for part in text.split(":"))
    except UnitError as error:
        raise TensileError(f"stretch {brief(text)} is not a range ({error}); write it like 1.02:3") from None
    except ValueError:
        raise TensileError(f"stretch {brief(text)} is not a range; write it like 1.02:3") from None
    if not 0.0 < low < high < 100.0:
        raise TensileError(f"stretch {text!r}: the range must rise, from above 0 to below 100")
    if high <= 1.0 <= low or low == high:
        raise TensileError(f"stretch {text!r} contains only the undeformed state; give a range such as 1.02:3")
    return low, high


height_datum_option = click.option(
    "--height-datum", type=click.Choice(HEIGHTS_FROM), default=None,
    help="Zero of the heights if the case has gravity or forces, or a top that is not flat (balloon, bellows): the "
    "upper edge of the shadow at zero pressure, the apex there, or the undeformed top.  [default: the shadow; if the "
    "undeformed top is not flat the apex, which outlines have to name]",
)  # fmt: skip


# ----------------------------------------------------------------------------------------------------------------------
# The command ``curve``: stress of a material in test specimens and its balloon's pressure, without a mesh.


POINTS = 201
TABLE_POINTS = 11


class CurveGiven(CurveFiles):
    """Values of the command's further options, by name."""

    radius: float
    thickness: float


@click.command("curve")
@click.option("--material", "names", multiple=True, metavar="NAME[:KEY=VALUE,...]",
              help="Silicone, TOML file, or law with numbers (yeoh:c1=8kPa,c2=90Pa); several are compared.")  # fmt: skip
@click.option("--stretch", default="1:4", show_default=True, metavar="FROM:TO", help="Range of stretch.")
@click.option("--incompressible", is_flag=True, help="Use a Poisson's ratio of 0.5 instead of the material's.")
@click.option(
    "--radius", type=QuantityType("m"), default=0.02, help="The balloon's undeformed radius.  [default: 20mm]"
)
@click.option("--thickness", type=QuantityType("m"), default=0.001, help="Its undeformed thickness.  [default: 1mm]")
@tensile_option("Measured curve to plot for comparison, FILE[:TEST].")
@specimen_options
@click.option("--no-pictures", is_flag=True, help="Do not draw the picture.")
@click.option("--quiet", is_flag=True, help="Print only errors.")
@click.option("-o", "--output", type=FolderType(), help="Folder for the results.  [default: results/curve; "
              "results/curve-2 and so on if that holds other curves]")  # fmt: skip
def curve(names: tuple[str, ...], stretch: str, incompressible: bool, output: Path | None, no_pictures: bool, quiet: bool,
          **options: Unpack[CurveGiven]) -> None:  # fmt: skip
    """Show materials in uniaxial tension, pure shear and equibiaxial tension, and as a balloon.

    Each is drawn with its own Poisson's ratio. Where a law stops being stable, is said. Ogden's factors take commas:
    ogden:mu=0.63MPa,0.0012MPa,-0.01MPa,alpha=1.3,5,-2 and perhaps convention=2mu/alpha^2.

    \b
    Examples:
      softmodels curve --material ecoflex-00-30 --material ecoflex-00-30/marechal-2021 --stretch 1:3
      softmodels curve --material results/fit/fitted.toml --tensile curve.csv --stretch 0.5:6
      softmodels curve --material gent:shear_modulus=20kPa,limit=30 --radius 20mm --thickness 1mm

    \b
    Exit status: 0 done; 2 bad input.
    """
    try:
        low, high = stretch_range(stretch)
        if not names:
            raise MaterialError("nothing to show; give a material with --material NAME")
        materials = [read_material(text, incompressible) for text in names]
        check_curves_given({name: value for name, value in options.items() if name not in ("radius", "thickness")})
        asked = {**options, "names": names, "stretch": stretch, "incompressible": incompressible}
        files = [*map(Path, names), *map(curve_file, options["tensile"])]
        folder = open_folder(output, Path("results/curve"), "curves", asked, files) if speaks() else None
        measured = []
        if options["tensile"]:
            measured = read_curves(options, options["radius"], options["thickness"])
        if min(options["radius"], options["thickness"]) <= 0.0 or options["thickness"] > options["radius"]:
            raise TensileError(
                "the balloon's radius and thickness must be above zero, and the thickness less than the radius"
            )
    except (MaterialError, OwnFolderError, TensileError) as error:
        fail(str(error))
    stretches = np.linspace(low, high, POINTS)
    many = [MaterialCurves.of(name, material, stretches) for name, material in zip(names, materials, strict=True)]
    ratio = options["thickness"] / options["radius"]
    if folder is None:
        return

    def write(place: Path) -> None:
        _write_curves(place / "curves.csv", many, ratio)
        if not no_pictures:
            from softmodels.pictures.fits import draw

            (place / "curves.png").write_bytes(draw(many, measured, options["radius"], options["thickness"]))

    write_into(folder, write, "the results")
    if not quiet:
        for one in many:
            say(table_of(one, ratio))
        say(f"written to {folder.path}")


def read_material(text: str, incompressible: bool = False) -> Material:
    """Read ``"ecoflex-00-30"``, a TOML file's name or ``"yeoh:c1=8kPa,c2=90Pa"``."""
    name, _, numbers = text.partition(":")
    values: dict[str, str] = {}
    for part in re.split(r",(?=\s*\w+=)", numbers) if numbers else []:
        key, found, value = part.partition("=")
        if not found:
            raise MaterialError(f"material {text!r}: {part!r} is not KEY=VALUE")
        values[key.strip().replace("-", "_")] = value.strip()
    if incompressible:
        values["poisson"] = "0.5"
    return material_from(name, values)


def table_of(one: MaterialCurves, thickness_over_radius: float) -> str:
    """Return a material's table for the terminal."""
    modulus, unit = with_prefix(one.material.shear_modulus_0, "Pa")
    nu = one.material.poisson
    lines = [f"{one.name}: {one.material.name}, shear modulus {modulus} {unit}, Poisson's ratio {nu:g}"]
    lines.append("  stretch   nominal stress (kPa)                      balloon (kPa)")
    lines.append("            uniaxial     planar       equibiaxial")
    columns = [*(one.responses[mode].stress for mode in MODE_NAMES), one.balloon(thickness_over_radius)]
    for i in np.linspace(0, len(one.stretch) - 1, TABLE_POINTS).astype(int):
        lines.append(f"  {one.stretch[i]:7.3f} " + "".join(f"  {column[i] / 1e3:11.5g}" for column in columns))
    lines += [f"  warning: {text}" for text in one.verdict.flags]
    lines += [f"  {text}" for text in one.verdict.notes]
    return "\n".join(lines) + "\n"


def _write_curves(path: Path, many: list[MaterialCurves], thickness_over_radius: float) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        stresses = [f"{mode}_{kind}_Pa" for mode in MODE_NAMES for kind in ("nominal", "true")]
        rows.writerow(["material", "poisson", "stretch", *stresses, "balloon_Pa", "thickness_over_radius"])
        for one in many:
            columns = [c for mode in MODE_NAMES for c in (one.responses[mode].stress, one.true_stress(mode))]
            columns.append(one.balloon(thickness_over_radius))
            for i, stretch in enumerate(one.stretch):
                numbers = [f"{column[i]:.9g}" for column in columns]
                nu = exact_text(one.material.poisson, "")
                rows.writerow([one.name, nu, f"{stretch:.9g}", *numbers, f"{thickness_over_radius:.6g}"])


# ----------------------------------------------------------------------------------------------------------------------
# The command ``score``: compare materials with measurements they were not fitted to.


class ScoreGiven(CurveFiles):
    """Values of the command's further options, by name."""

    stretch: str | None
    stress_error: str
    untrusted: bool
    height_datum: str | None
    radius: float | None
    thickness: float | None


@click.command("score")
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

    def write(place: Path) -> None:
        write_scores(place / "scores.csv", scores)
        write_text(place / "report.html", score_page(scores, materials, read_text(place / "scores.csv")))

    write_into(folder, write, "the results")
    if not quiet:
        say(score_table(scores))
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


def score_page(scores: list[Score], materials: Mapping[str, Material], table: str) -> str:
    """Return the report; ``table`` is the text of ``scores.csv``."""
    sections, facts = [], []
    head = (
        "material",
        "values",
        "rms",
        "chi squared per value",
        "of measurement",
        "of material",
        "in 95 % band",
        "furthest off",
    )
    for data in dict.fromkeys(one.data for one in scores):
        ranked = sorted((one for one in scores if one.data == data), key=lambda one: one.chi2)
        rows = [
            (one.material, str(one.count), _rms(one), f"{one.chi2:.4g}", f"{one.chi2_measurement:.3g}",
             f"{one.chi2_material:.3g}" if math.isfinite(one.chi2_material) else "unknown", f"{one.coverage:.1%}", one.worst)
            for one in ranked
        ]  # fmt: skip
        sections.append((data, [Table(rows, head)]))
        facts.append(Fact(f"Best for {data}", ranked[0].material, f"chi squared per value {ranked[0].chi2:.4g} (1: as exact as "
                          f"the measurement), rms {_rms(ranked[0])}"))  # fmt: skip
    sources = [f"{name}: {text}" for name, material in materials.items() for text in publications(material)]
    answer = "Materials against measurements they were not fitted to, the best one first."
    return Page("Scores", answer, sections, Provenance.now(), facts, (), sources, {"scores.csv": table}).html()


def _rms(one: Score) -> str:
    return f"{one.rms / 1e3:.3g} kPa" if one.unit == "Pa" else f"{one.rms * 1e3:.3g} mm"


def score_table(scores: list[Score]) -> str:
    """Return the table for a terminal, the best material of each measurement first."""
    lines = []
    for data in dict.fromkeys(one.data for one in scores):
        lines.append(f"{data}:")
        lines.append(
            f"  {'material':34s} {'values':>6s} {'rms':>11s} {'chi2/value':>11s} {'of measurement':>15s} "
            f"{'of material':>12s} {'in 95 % band':>13s}  furthest off"
        )
        for one in sorted((s for s in scores if s.data == data), key=lambda s: s.chi2):
            material = f"{one.chi2_material:.3g}" if math.isfinite(one.chi2_material) else "unknown"
            chi2 = f"{one.chi2:11.4g} {one.chi2_measurement:15.3g} {material:>12s}"
            numbers = f"{one.count:6d} {_rms(one):>11s} {chi2} {100 * one.coverage:11.1f} %"
            lines.append(f"  {one.material:34s} {numbers}  {one.worst}")
    return "\n".join(lines)
