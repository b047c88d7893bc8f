"""The command ``fit``: parse its options, read the measurements, fit the laws, write the result files."""

from __future__ import annotations

import contextlib
import dataclasses
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Unpack

import click

from geometries.options import QuantityType
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.cli.material_commands import (
    CurveFiles,
    check_curves_given,
    curve_file,
    height_datum_option,
    read_curves,
    specimen_options,
    tensile_option,
)
from softmodels.cli.options import fail, write_into
from softmodels.common.commands import FolderType, open_folder, status_of
from softmodels.common.files import read_text
from softmodels.common.folders import OwnFolderError, ResultFolder
from softmodels.common.processes import say
from softmodels.common.units import UnitError, quantity
from softmodels.fitting.comparison import FitReport, separate_file
from softmodels.fitting.curves.curve import TensileCurve, TensileError
from softmodels.fitting.curves.fit import fit_curves
from softmodels.fitting.curves.residuals import StressError
from softmodels.fitting.outlines.fit import device_names, fit, fit_heights
from softmodels.fitting.outlines.shapes import OutlineFitError
from softmodels.fitting.problem import (
    BENCH,
    USUAL_GAUGE_ERROR,
    CannotEvaluate,
    Change,
    FitError,
    FitOptions,
    LawChoice,
    Prior,
    UnsoundError,
    all_parameters,
    known_laws,
    law_choices,
)
from softmodels.fitting.tables import as_json, as_text, material_toml, name_of, retire, write_curves, write_materials
from softmodels.materials.specimens import FLOW, SOFTENING
from softmodels.mechanics.mpi import abort_on_error, on_root, speaks, start
from softmodels.runs.columns import StateLabels
from softmodels.runs.outcomes import DONE, FAILED, Progress

BENCH_UNITS = {"pressure_offset": "Pa", "zero": "m", "centre": "m"}
"""Units of the bench corrections that have one."""


class FitGiven(CurveFiles):
    """Option values of the command, by name."""

    files: tuple[Path, ...]
    heights: Path | None
    free: tuple[str, ...]
    untrusted: bool
    height_datum: str | None
    exclude: tuple[str, ...]
    silicone: str | None
    laws: str
    stretch: str | None
    stress_error: str
    gauge_error: str
    poisson: float
    fixes: tuple[str, ...]
    bounds: tuple[str, ...]
    priors: tuple[str, ...]
    robust: bool
    radius: float | None
    thickness: float | None
    no_profiles: bool
    no_pictures: bool
    memory: bool
    quiet: bool
    output: Path | None


def fit_options(options: FitGiven, changes: Mapping[str, Change]) -> FitOptions:
    """Return the command's options as `FitOptions`.

    Raises:
        FitError: A gauge error that is no share, or a parameter that is to be both free and fixed.
    """
    return FitOptions(
        poisson=options["poisson"],
        changes=changes,
        robust=options["robust"],
        profiles=not options["no_profiles"],
        silicone=options["silicone"],
        stress_error=options["stress_error"],
        gauge_error=_gauge_error(options["gauge_error"]),
        free=free_of_bench(options),
        exclude=options["exclude"],
        untrusted=options["untrusted"],
        height_datum=options["height_datum"] or "",
        memory=options["memory"],
    )


def _gauge_error(text: str) -> float:
    """Return the gauge error as a fraction, or the usual one."""
    words = {"auto": USUAL_GAUGE_ERROR, "none": 0.0}
    return words[text] if text in words else quantity(text, "")


def free_of_bench(options: FitGiven) -> tuple[str, ...]:
    """Return the free bench and device parameters: the defaults plus ``--free`` minus ``--fix``.

    Raises:
        OutlineFitError: A parameter is to be both.
    """
    fixed = {text.partition("=")[0].strip() for text in options["fixes"]}
    for name in options["free"]:
        if name in fixed:
            raise OutlineFitError(f"{name} cannot be both free (--free) and fixed (--fix)")
    return tuple(dict.fromkeys(name for name in (*BENCH, *options["free"]) if name not in fixed))


def curve_changes(options: FitGiven, choices: Sequence[LawChoice]) -> dict[str, Change]:
    """Return the changes that ``--fix``, ``--bounds`` and ``--prior`` make to parameters of laws fitted to curves.

    Raises:
        FitError: A text that is no such change, or a name that none of the laws has.
    """
    units = {name: choice.unit(name) for choice in choices for name in choice.names}
    laws, known = ", ".join(choice.name for choice in choices), ", ".join(units)
    return _changes(options, units, lambda name: f"{laws}: no parameter {name!r}; there is {known}", value_needed=True)


def device_changes(options: FitGiven, lengths: Mapping[str, Sequence[str]]) -> dict[str, Change]:
    """Return the same for devices, with variable lengths by name; ``--fix leak`` keeps its nominal value.

    Of several devices ``leak`` is that of each, and ``NAME.leak`` that of one.

    Raises:
        FitError: A text that is no such change, or a name that nothing has.
    """
    bench = {name: BENCH_UNITS.get(name, "") for name in BENCH}
    of = {device: {**bench, **dict.fromkeys(names, "m")} for device, names in lengths.items()}
    own = {"poisson": "", **{name: unit for units in of.values() for name, unit in units.items()}}
    known = ", ".join(own)
    if len(of) > 1:
        own |= {f"{device}.{name}": unit for device, units in of.items() for name, unit in units.items()}
        known += f", each of them also of one device, such as {next(reversed(of))}.leak"
    return _changes(
        options,
        {**all_parameters(), **own},
        lambda name: f"there is no parameter {name!r}; the bench and the device have {known}",
        value_needed=False,
    )


def _changes(
    options: FitGiven, units: Mapping[str, str], unknown: Callable[[str], str], value_needed: bool
) -> dict[str, Change]:
    """Return the changes by parameter; the curves' factors ``gauge1`` and so on are known to all laws, and with ``--memory``
    the weights of its branches, its softening and what its viscosity depends on."""
    changes: dict[str, Change] = {}
    remembered = ("share_", *SOFTENING, *FLOW) if options["memory"] else ()
    if remembered:
        units = {**units, SOFTENING[1]: "Pa"}
    kinds: tuple[tuple[tuple[str, ...], Callable[[str, str], Change]], ...] = (
        (options["fixes"], _read_fixed), (options["bounds"], read_bounds), (options["priors"], read_prior),
    )  # fmt: skip
    for texts, read in kinds:
        for text in texts:
            name, equals, value = (part.strip() for part in text.partition("="))
            if name not in units and not name.startswith(("gauge", *remembered)):
                raise FitError(unknown(name))
            if value_needed and not equals:
                raise FitError(f"{text!r} is not NAME=VALUE")
            try:
                changes.setdefault(name, {}).update(read(value, units.get(name, "")) if equals or read is not _read_fixed
                                                    else {"fixed": True})  # fmt: skip
            except (UnitError, FitError) as error:
                raise FitError(f"{text!r}: {error}") from None
    return changes


def _read_fixed(value: str, unit: str) -> Change:
    return {"start": quantity(value, unit), "fixed": True}


def read_bounds(value: str, unit: str) -> Change:
    """Read ``FROM:TO``; an end may be empty."""
    low, colon, high = value.partition(":")
    if not colon:
        raise FitError(f"{value!r} is not FROM:TO")
    change: Change = {}
    if low.strip():
        change["lower"] = quantity(low, unit)
    if high.strip():
        change["upper"] = quantity(high, unit)
    return change


def read_prior(value: str, unit: str) -> Change:
    """Read ``VALUE+-ERROR``."""
    mean, separator, error = value.partition("+-")
    if not separator:
        raise FitError(f"{value!r} is not VALUE+-ERROR")
    return {"prior": Prior(quantity(mean, unit), quantity(error, unit))}


# ----------------------------------------------------------------------------------------------------------------------
# The command, its report and its files.


@click.command("fit")
@click.argument("files", metavar="[CASE.toml [OUTLINES...]]...", nargs=-1, type=click.Path(path_type=Path))
@tensile_option()
@click.option("--heights", type=click.Path(path_type=Path), metavar="HEIGHTS.csv",
              help="Fit the largest deflections at each pressure, as in the thesis, instead of outlines.")  # fmt: skip
@click.option("--free", multiple=True, metavar="NAME", help="With a case: free poisson, or a length such as membrane.")
@click.option("--untrusted", is_flag=True, help="Also use outlines that the measurement flags as untrusted.")
@height_datum_option
@click.option(
    "--exclude", multiple=True, metavar="PHOTOGRAPH", help="Exclude a photograph, such as 4.jpg; may be repeated."
)
@click.option("--silicone", metavar="NAME", help="Silicone the part was cast from, such as ecoflex-00-30: its published "
              "moduli reveal pressures in a wrong unit. any: unlisted.  [default: the case's material]")  # fmt: skip
@click.option("--material", "laws", default="yeoh", show_default=True, metavar="LAW,...",
              help=f"Laws to compare: {known_laws()}, or all.")  # fmt: skip
@click.option("--memory", is_flag=True, help="Fit relaxation too, and softening where the data show it, to tests with a column "
              "of times, or a RATE such as 0.05/s, 50mm/min or equilibrium.")  # fmt: skip
@click.option("--stretch", metavar="FROM:TO", help="Range of stretch to fit over.  [default: the whole curves]")
@click.option("--stress-error", default="auto", show_default=True, metavar="ERROR",
              help="2%+0.5kPa; constant (unweighted); auto weights by 2 % and the curve's noise. The last two are "
              "scaled by the scatter.")  # fmt: skip
@click.option("--gauge-error", default="auto", show_default=True, metavar="SHARE",
              help="Standard error of a factor on each test (cross-section, load cell), such as 5%; auto takes 3 % and 1 %, "
              "3.2 % together; none omits it, which makes the intervals much too narrow.")  # fmt: skip
@click.option(
    "--poisson", type=QuantityType(""), default=0.5, show_default=True, help="Poisson's ratio of the fitted material."
)
@click.option("--fix", "fixes", multiple=True, metavar="NAME=VALUE", help="Fix a parameter, such as c3=0.")
@click.option(
    "--bounds", "bounds", multiple=True, metavar="NAME=FROM:TO", help="Bound a parameter; an end may be empty."
)
@click.option("--prior", "priors", multiple=True, metavar="NAME=VALUE+-ERROR", help="Prior knowledge of a parameter.")
@click.option("--robust", is_flag=True, help="Robust loss: outliers count by their size, not its square.")
@specimen_options
@click.option("--radius", type=QuantityType("m"), help="A balloon's undeformed radius.")
@click.option("--thickness", type=QuantityType("m"), help="Its undeformed thickness.")
@click.option("--no-profiles", is_flag=True, help="Skip the profile likelihoods: intervals from the covariance only.")
@click.option("--no-pictures", is_flag=True, help="Skip the pictures and the report.")
@click.option("--quiet", is_flag=True, help="Print only errors.")
@click.option("-o", "--output", type=FolderType(), help="Folder for the results.  [default: results/fit; results/fit-2 "
              "and so on if that holds another fit]")  # fmt: skip
def fit_material(**options: Unpack[FitGiven]) -> None:
    """Fit laws to measurements: parameters with 95 % intervals, and a material file for a simulation.

    With --tensile, to curves of test machines. With a CASE (such as the case.toml in a folder of results), to outlines of that
    device at all pressures (files or folders that python -m measurement photos has made), alone or together with curves.
    Systematic
    errors of the bench are fitted too, within plausible bounds: an offset and a unit of pressure, a leak, a unit of
    length, the zero plane, the axis. --fix leak keeps one of them at its nominal value, --prior 'leak=0+-5%' sets an expected
    error. Gravity, masses and forces of the case are taken as known; they act in every photograph, also at zero pressure.

    With several CASEs, each followed by its OUTLINES, one material is fitted to all of them, as to parts of one cast. The
    errors
    of the bench are fitted per device: --fix leak applies to all of them, --fix disk.leak to the one whose case is named disk.
    For each device the misfit is reported.

    TEST is uniaxial (default), planar (pure shear), equibiaxial or balloon (pressure against stretch or radius). A file's
    headers name its columns, such as 'strain (%)' and 'stress (kPa)'; only the loading ramp up to the break is used.
    A modulus is valid only in its fit range: choose the stretches of the device with --stretch.

    With --memory the whole tests are used: cycles, holds, several rates at once. The law is then that of equilibrium, and
    fitted.toml has [material.memory]: relaxing branches, one per decade of time that the data cover, and Mullins softening
    where a second loading, or a hold after an unloading, shows it. --bounds onset=0.01:10 also fits a viscosity that
    depends on stress. Without --memory the law is that of the tests' rate.

    \b
    Examples:
      softmodels fit --tensile curve.csv --material yeoh --stretch 1.02:3
      softmodels fit --tensile ut.csv --tensile ps.csv:planar --tensile et.csv:equibiaxial --material all
      softmodels fit --tensile cycle.csv --tensile slow.csv:uniaxial:equilibrium --memory
      softmodels fit --tensile pull.csv --columns 'extension=1[mm],force=2[N]' --gauge-length 33mm --cross-section 18mm^2
      softmodels fit results/disk/case.toml outlines/ --material yeoh --fix c3=0Pa
      softmodels fit results/disk/case.toml outlines/ --tensile curve.csv --material neo-hookean,yeoh --poisson 0.49
      softmodels fit a/case.toml outlines_a/ b/case.toml outlines_b/ --material yeoh
      softmodels fit results/disk/case.toml --heights outlines/heights.csv --material neo-hookean
      python -m softmodels.disk --material results/fit/fitted.toml

    \b
    Exit status: 0 done; 1 no law was accepted: the reason is reported, and the rejected fit is in unsound.toml, not
    in fitted.toml; 2 bad input.
    """
    comm = start() if options["files"] else None
    folder: list[ResultFolder] = []  # of rank 0
    try:
        if comm is not None:
            on_root(comm, lambda: folder.append(_folder(options)))
        elif speaks():
            folder.append(_folder(options))
        report = _report(options)
        if folder:
            write_into(folder[0], lambda place: _write_all(report, folder[0], place, options), "the results")
    except (UnsoundError, CannotEvaluate) as error:
        _put_away(folder)
        fail(str(error), FAILED)
    except (FitError, TensileError, UnitError, OwnFolderError) as error:
        fail(str(error))
    except OSError as error:  # the mesh is made in the temporary folder
        fail(f"the mesh cannot be written ({error.strerror or error})", status_of(error))
    if speaks():
        if not options["quiet"]:
            say(as_text(report))
        if report.separate:
            say(f"softmodels: {report.separate.pairs[0].sentence}; {report.separate.spread}", err=True)
        if not options["quiet"]:
            for text in report.chosen.judgement.notes:
                say(text)
            say(_closing(report, folder[0].path))
    if speaks() and not report.chosen.sound:
        say(f"softmodels: {report.chosen.choice.name}: {report.chosen.warnings[0]}", err=True)
    sys.exit(DONE if report.chosen.sound else FAILED)


def _write_all(report: FitReport, folder: ResultFolder, place: Path, options: FitGiven) -> None:
    write(report, place, not options["no_pictures"])
    retire(folder.path, {file.name for file in place.iterdir()})


def _closing(report: FitReport, folder: Path) -> str:
    file = folder / name_of(report.chosen)
    if report.chosen.sound:
        return f"written to {folder}; use it with --material {file}"
    return f"written to {folder}; no fitted.toml, because the fit was rejected: inspect {file}, do not simulate with it"


def _put_away(folders: Sequence[ResultFolder]) -> None:
    """Rename the files of an earlier fit, so that they are not mistaken for this one's."""
    for folder in folders:
        with contextlib.suppress(OSError):
            retire(folder.path)


def _folder(options: FitGiven) -> ResultFolder:
    """Open the results folder before anything is computed."""
    named = [curve_file(text) for text in options["tensile"]]
    files = [*options["files"], *named, *([options["heights"]] if options["heights"] else [])]
    return open_folder(options["output"], Path("results/fit"), "fit", options, files)


def _report(options: FitGiven) -> FitReport:
    if options["files"]:
        return _device_report(options)
    if any(options[name] for name in ("heights", "free", "untrusted", "exclude", "height_datum")):  # type: ignore[literal-required]
        raise FitError(
            "--heights, --free, --untrusted, --exclude and --height-datum need a device; give its case file first"
        )
    check_curves_given({**options, "tensile": True})
    curves = _curves(options)
    choices = law_choices(options["laws"], options["poisson"])
    StressError.from_text(options["stress_error"])
    how = fit_options(options, curve_changes(options, choices))
    progress = Progress(len(choices), "laws", StateLabels(""), options["quiet"] or not speaks())
    return fit_curves(curves, options["laws"], how, progress=progress.say)


def _curves(options: FitGiven) -> list[TensileCurve]:
    return read_curves(options, options["radius"], options["thickness"], options["stretch"], options["memory"])


def _device_report(options: FitGiven) -> FitReport:
    check_curves_given(options)
    curves = _curves(options) if options["tensile"] else []
    StressError.from_text(options["stress_error"])
    pairs = _devices(options["files"])
    if options["heights"] is not None and (len(pairs) > 1 or pairs[0][1]):
        raise OutlineFitError("fit either outlines or --heights, not both: the same data would count twice")
    if options["heights"] is not None and options["tensile"]:
        raise OutlineFitError(
            "heights without outlines have no errors to weigh tensile curves with; add outlines, or fit the two separately"
        )
    cases = []
    for file, files in pairs:
        try:
            cases.append(Case.from_file(file))
        except CaseError as error:
            raise FitError(str(error)) from None
        if options["heights"] is None and not files:
            raise OutlineFitError(f"{file} describes only the device; add its outlines, or --heights heights.csv")
    lengths = {
        name: case.actuator.variable
        for name, case in zip(device_names([case.name for case in cases]), cases, strict=True)
    }
    how = fit_options(options, device_changes(options, lengths))
    comm = start()
    abort_on_error(comm)
    if options["heights"] is not None:
        return fit_heights(cases[0], options["heights"], options["laws"], how, comm=comm)
    devices = [(case, files) for case, (_, files) in zip(cases, pairs, strict=True)]
    return fit(devices, material=options["laws"], options=how, curves=curves, comm=comm)


def _devices(files: Sequence[Path]) -> list[tuple[Path, list[Path]]]:
    """Return the case files, each with the outlines that follow it."""
    pairs: list[tuple[Path, list[Path]]] = []
    for file in files:
        if not pairs or file.suffix == ".toml":
            pairs.append((file, []))
        else:
            pairs[-1][1].append(file)
    return pairs


def write(report: FitReport, folder: Path, draw: bool) -> None:
    """Write the material files, every number, the curves, the pictures and the page."""
    own: dict[str, str] = {}
    if report.separate:
        for curve, one in zip(report.separate.curves, report.separate.own, strict=True):
            alone = dataclasses.replace(report, curves=(curve,), separate=None)
            own[separate_file(report.separate, curve)] = material_toml(one, alone)
    write_materials(report, folder, own)
    (folder / "fit.json").write_text(as_json(report), encoding="utf-8")
    write_curves(folder / "curves.csv", report.laws, report.curves)
    if draw:
        from softmodels.pictures.fits import as_png, figures, page

        drawn = figures(report)
        for name, figure in drawn.items():
            (folder / f"{name}.png").write_bytes(as_png(figure))
        tables = {file.name: read_text(file) for file in [folder / "curves.csv"] if file.exists()}
        (folder / "report.html").write_text(page(report, drawn, tables), encoding="utf-8")
