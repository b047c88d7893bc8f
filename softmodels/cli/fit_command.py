"""The command ``fit``: options to sources, sources to fits, fits to files."""

from __future__ import annotations

import contextlib
import dataclasses
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click

from geometries.options import QuantityType
from measurement.output_option import FolderType, open_folder
from measurement.output_place import status_of
from measurement.own_folder import OwnFolderError
from measurement.result_folder import ResultFolder
from measurement.units import UnitError, quantity
from softmodels.cli.options import fail
from softmodels.cli.tensile_options import check_curves_given, read_curves, specimen_options, tensile_option
from softmodels.fitting.believable import expected, hold_against, stretch_of
from softmodels.fitting.comparison import compare
from softmodels.fitting.curves.contradiction import fitted_alone, own_file, told_apart
from softmodels.fitting.curves.curve import TensileCurve, TensileError
from softmodels.fitting.curves.fit import StressError, fit_law, largest_strain, residuals_of, spread
from softmodels.fitting.curves.yardstick import on_yardstick
from softmodels.fitting.files import name_of, retire, write_materials
from softmodels.fitting.law_parameters import LawChoice, all_laws, known_laws
from softmodels.fitting.least_squares import Fit, FitError, Prior
from softmodels.fitting.problem import CannotEvaluate, UnsoundError
from softmodels.fitting.soundness import NOTHING
from softmodels.fitting.tables import Fitted, Report, as_json, as_text, material_toml, write_curves
from softmodels.materials.stability import judge
from softmodels.mechanics.mpi import on_root, speaks, start
from softmodels.results.outcomes import DONE, FAILED
from softmodels.runs.progress import Progress


@click.command("fit", context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("files", metavar="[CASE.toml [OUTLINES...]]", nargs=-1, type=click.Path(path_type=Path))
@tensile_option()
@click.option("--heights", type=click.Path(path_type=Path), metavar="HEIGHTS.csv",
              help="Fit the largest deflections at the pressures, as the thesis did, in place of outlines.")  # fmt: skip
@click.option("--free", multiple=True, metavar="NAME", help="With a case: free poisson, or a length such as membrane.")
@click.option("--untrusted", is_flag=True, help="Take outlines that the measurement does not trust, too.")
@click.option("--without", multiple=True, metavar="PHOTOGRAPH", help="Leave a photograph out, such as 4.jpg.")
@click.option("--silicone", metavar="NAME", help="What the part was cast of, such as ecoflex-00-30: its known moduli show "
              "pressures in a wrong unit. any: in no list.  [default: the case's material]")  # fmt: skip
@click.option("--material", "laws", default="yeoh", show_default=True, metavar="LAW,...",
              help=f"Laws to compare: {known_laws()}, or all.")  # fmt: skip
@click.option("--stretch", metavar="FROM:TO", help="Range of stretch to fit over.  [default: the whole curves]")
@click.option("--stress-error", default="auto", show_default=True, metavar="ERROR",
              help="2%+0.5kPa; constant (unweighted); auto weights by 2 % and the curve's noise. The last two take their "
              "size from the scatter.")  # fmt: skip
@click.option("--gauge-error", default="0%", show_default=True, metavar="SHARE",
              help="Standard error of a factor on each test (cross-section, load cell), such as 3%.")  # fmt: skip
@click.option(
    "--poisson", type=QuantityType(""), default=0.5, show_default=True, help="Poisson's ratio of the fitted material."
)
@click.option("--fix", "fixes", multiple=True, metavar="NAME=VALUE", help="Keep a parameter, such as c3=0.")
@click.option(
    "--bounds", "bounds", multiple=True, metavar="NAME=FROM:TO", help="Bound a parameter; an end may be empty."
)
@click.option("--prior", "priors", multiple=True, metavar="NAME=VALUE+-ERROR", help="What is known beforehand.")
@click.option("--robust", is_flag=True, help="Let outliers count by their size, not by its square.")
@specimen_options
@click.option("--radius", type=QuantityType("m"), help="A balloon's undeformed radius.")
@click.option("--thickness", type=QuantityType("m"), help="Its undeformed thickness.")
@click.option("--no-profiles", is_flag=True, help="Leave the profile likelihoods out: intervals from the covariance.")
@click.option("--no-pictures", is_flag=True, help="Leave the pictures and the page out.")
@click.option("--quiet", is_flag=True, help="Say nothing but errors.")
@click.option("-o", "--output", type=FolderType(), help="Folder for the results.  [default: results/fit; results/fit-2 "
              "and so on where that holds another fit]")  # fmt: skip
def fit_material(**options: Any) -> None:
    """Fit laws to measurements: parameters with 95 % intervals, and a material file for a simulation.

    With --tensile, to curves of test machines. With a CASE (such as the case.toml in a folder of results), to outlines of
    that device at all pressures (files or folders that python -m measurement photos has made), alone or together with curves.
    What the bench may have got wrong is fitted too, within what is believable: an offset and a unit of pressure, a leak, a
    unit of length, the zero plane, the axis. --fix leak keeps one of them at its nominal value, --prior 'leak=0+-5%' says more.

    TEST is uniaxial (default), planar (pure shear), equibiaxial or balloon (pressure against stretch or radius). A file's
    headers say what its columns are, such as 'strain (%)' and 'stress (kPa)'; only the loading ramp up to the break counts.
    A modulus without its fit range means nothing: choose the stretches of the device with --stretch.

    \b
    Examples:
      softmodels fit --tensile curve.csv --material yeoh --stretch 1.02:3
      softmodels fit --tensile ut.csv --tensile ps.csv:planar --tensile et.csv:equibiaxial --material all
      softmodels fit --tensile pull.csv --columns 'extension=1[mm],force=2[N]' --gauge-length 33mm --cross-section 18mm^2
      softmodels fit results/disk/case.toml outlines/ --material yeoh --fix c3=0Pa
      softmodels fit results/disk/case.toml outlines/ --tensile curve.csv --material neo-hookean,yeoh --poisson 0.49
      softmodels fit results/disk/case.toml --heights outlines/heights.csv --material neo-hookean
      python -m softmodels.disk --material results/fit/fitted.toml

    \b
    Exit status: 0 done; 1 no law could be fitted soundly: the reason is reported, and what was found is in unsound.toml, not in
    fitted.toml; 2 bad input.
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
            with folder[0].writing() as place:
                write(report, place, not options["no_pictures"])
                retire(folder[0].path, {file.name for file in place.iterdir()})
    except (UnsoundError, CannotEvaluate) as error:
        _put_away(folder)
        fail(str(error), FAILED)
    except (FitError, TensileError, UnitError, OwnFolderError) as error:
        fail(str(error))
    except OSError as error:
        fail(f"the results cannot be written ({error.strerror or error})", status_of(error))
    if speaks():
        if not options["quiet"]:
            click.echo(as_text(report))
        if report.apart:
            click.echo(f"softmodels: {report.apart.pairs[0].sentence}; {report.apart.spread}", err=True)
        if not options["quiet"]:
            for text in report.chosen.judgement.notes:
                click.echo(text)
            click.echo(_closing(report, folder[0].path))
    if speaks() and not report.chosen.sound:
        click.echo(f"softmodels: {report.chosen.choice.name}: {report.chosen.warnings[0]}", err=True)
    sys.exit(DONE if report.chosen.sound else FAILED)


def _closing(report: Report, folder: Path) -> str:
    file = folder / name_of(report.chosen)
    if report.chosen.sound:
        return f"written to {folder}; go on with --material {file}"
    return (
        f"written to {folder}; no fitted.toml, for the fit is not sound: {file} is for looking at, not for a simulation"
    )


def _put_away(folders: Sequence[ResultFolder]) -> None:
    """Rename what an earlier fit has left, so that nobody takes it for this one's."""
    for folder in folders:
        with contextlib.suppress(OSError):
            retire(folder.path)


def _folder(options: dict[str, Any]) -> ResultFolder:
    """Where the results go; taken before anything is computed."""
    named = [Path(text) if Path(text).exists() else Path(text.rpartition(":")[0]) for text in options["tensile"]]
    files = [*options["files"], *named, *([options["heights"]] if options["heights"] else [])]
    return open_folder(options["output"], Path("results/fit"), "fit", options, files)


def _report(options: dict[str, Any]) -> Report:
    device = bool(options["files"])
    if not device and (options["heights"] or options["free"] or options["untrusted"] or options["without"]):
        raise FitError("--heights, --free, --untrusted and --without are about a device; give its case file first")
    check_curves_given(options if device else {**options, "tensile": True})
    curves = read_curves(options) if options["tensile"] or not device else []
    choices = law_choices(options["laws"], options["poisson"])
    error = StressError.from_text(options["stress_error"])
    gauge_error = quantity(options["gauge_error"], "")
    if not 0.0 <= gauge_error < 1.0:
        raise FitError(f"a gauge error of {gauge_error:g} is not a share between 0 and 100 %")
    if device:
        from softmodels.cli.outline_command import device_report

        return device_report({**options, "stress": error, "gauge": gauge_error}, curves, choices)
    return _curve_report(options, curves, choices, error, gauge_error)


def _curve_report(
    options: dict[str, Any],
    curves: Sequence[TensileCurve],
    choices: Sequence[LawChoice],
    error: StressError,
    gauge: float,
) -> Report:
    """Fit every law to all curves together, and to each alone where they contradict each other."""
    _check_names(choices, options)
    known = expected(options["silicone"])
    changes = [changes_for(choice, options, alone=len(choices) == 1) for choice in choices]
    errors = "stated" if error.stated else "unknown"
    progress = Progress(len(choices), "laws", "", options["quiet"] or not speaks())

    def fit_all(**how: Any) -> list[Fit]:
        found = []
        for i, (choice, change) in enumerate(zip(choices, changes, strict=True), 1):
            if len(choices) > 1:
                progress.say(f"fitting {choice.name}, law {i} of {len(choices)}")
            sources, gauges = residuals_of(curves, choice, error, gauge, level=True)
            found.append(fit_law(choice, sources, gauges, changes=change, errors=errors, **how))
        return found

    fitted = fit_all()
    robust: dict[str, Any] = {}
    if options["robust"]:
        # What counts as an outlier is the closest law's to say, for all laws alike.
        robust = {"loss": "soft_l1", "scale": min(map(spread, fitted))}
        fitted = fit_all(**robust)
    comparison = compare(fitted, _judged(fitted, curves, choices, error, gauge))
    strain = largest_strain(curves)
    laws = []
    for ranked in comparison.ranked:
        choice = choices[fitted.index(ranked.fit)]
        if not options["no_profiles"] and len(ranked.fit.free) > 2:
            progress.say(f"intervals of {choice.name}")
        profiles = {} if options["no_profiles"] else {p.name: ranked.fit.profile(p.name) for p in ranked.fit.free}
        material = choice.material(ranked.fit.values)
        judgement = NOTHING
        if options["silicone"]:
            judgement = hold_against(material, stretch_of(strain), known, judgement)
        laws.append(Fitted(choice, ranked.fit, material, judge(material, strain), profiles, judgement))
    report = Report(tuple(laws), comparison, tuple(curves), _how(options))
    chosen = report.chosen.choice
    own_changes = {name: change for name, change in changes[choices.index(chosen)].items() if name in chosen.names}

    def fit_one(curve: TensileCurve) -> Fitted:
        sources, _ = residuals_of([curve], chosen, error)
        return fitted_alone(chosen, fit_law(chosen, sources, changes=own_changes, errors=errors, **robust), curve)

    return dataclasses.replace(report, apart=told_apart(curves, gauge, fit_one))


def _judged(
    fitted: Sequence[Fit],
    curves: Sequence[TensileCurve],
    choices: Sequence[LawChoice],
    error: StressError,
    gauge: float,
) -> list[Fit] | None:
    """The laws on the yardstick that they are compared by; None for one law alone, which nothing is compared with."""
    if len(fitted) < 2:
        return None
    return [
        on_yardstick(one, residuals_of(curves, choice, error, gauge)[0])
        for one, choice in zip(fitted, choices, strict=True)
    ]


def _how(options: dict[str, Any]) -> str:
    size = {
        "auto": "weighted by 2 % of the stress and the curve's noise, their size from the scatter",
        "constant": "unweighted least squares on the nominal stress, its error from the scatter",
    }.get(options["stress_error"], f"stress error {options['stress_error']}")
    robust = ", outliers counted by their size" if options["robust"] else ""
    gauge = "" if options["gauge_error"] in ("0", "0%") else f", a factor of 1 +- {options['gauge_error']} on each test"
    return f"{size}{robust}{gauge}; Poisson's ratio {options['poisson']:g} is given, not fitted"


def law_choices(text: str, poisson: float) -> list[LawChoice]:
    """Read ``"yeoh,ogden2"`` or ``"all"``."""
    if not -1.0 < poisson <= 0.5:
        raise FitError(f"poisson = {poisson:g} is outside -1 to 0.5")
    names = all_laws() if text.strip() == "all" else [part.strip() for part in text.split(",")]
    choices = [LawChoice.from_text(name, poisson) for name in names]
    if len({choice.name for choice in choices}) < len(choices):
        raise FitError(f"a law is named twice in {text!r}")
    return choices


def _check_names(choices: Sequence[LawChoice], options: dict[str, Any]) -> None:
    """Refuse a parameter that none of the laws has."""
    known = dict.fromkeys(name for choice in choices for name in choice.names)
    for text in (*options["fixes"], *options["bounds"], *options["priors"]):
        name = text.partition("=")[0]
        if name not in known and not name.startswith("gauge"):
            raise FitError(f"{', '.join(c.name for c in choices)}: no parameter {name!r}; there is {', '.join(known)}")


def changes_for(choice: LawChoice, options: dict[str, Any], alone: bool) -> dict[str, dict[str, Any]]:
    """What ``--fix``, ``--bounds`` and ``--prior`` say about a law's parameters.

    With several laws, each takes what names its own; with one alone, a foreign name is a mistake.
    """
    changes: dict[str, dict[str, Any]] = {}
    readers: tuple[tuple[str, Callable[[str, str], dict[str, Any]]], ...] = (
        ("fixes", lambda value, unit: {"start": quantity(value, unit), "fixed": True}),
        ("bounds", read_bounds),
        ("priors", read_prior),
    )
    for key, read in readers:
        for text in options[key]:
            name, found, value = text.partition("=")
            if not found:
                raise FitError(f"{text!r} is not NAME=VALUE")
            gauge = name.startswith("gauge")
            if name not in choice.names and not gauge:
                if alone:
                    raise FitError(f"{choice.name} has no parameter {name!r}; it has {', '.join(choice.names)}")
                continue
            try:
                changes.setdefault(name, {}).update(read(value, "" if gauge else choice.unit(name)))
            except (UnitError, FitError) as error:
                raise FitError(f"{text!r}: {error}") from None
    return changes


def read_bounds(value: str, unit: str) -> dict[str, float]:
    low, found, high = value.partition(":")
    if not found:
        raise FitError(f"{value!r} is not FROM:TO")
    made = {}
    for key, text in (("lower", low), ("upper", high)):
        if text.strip():
            made[key] = quantity(text, unit)
    return made


def read_prior(value: str, unit: str) -> dict[str, Prior]:
    mean, found, error = value.partition("+-")
    if not found:
        raise FitError(f"{value!r} is not VALUE+-ERROR")
    return {"prior": Prior(quantity(mean, unit), quantity(error, unit))}


def write(report: Report, folder: Path, draw: bool) -> None:
    """Write the material files, every number, the curves, the pictures and the page."""
    own: dict[str, str] = {}
    if report.apart:
        for curve, one in zip(report.apart.curves, report.apart.own, strict=True):
            alone = dataclasses.replace(report, curves=(curve,), apart=None)
            own[own_file(report.apart, curve)] = material_toml(one, alone)
    write_materials(report, folder, own)
    (folder / "fit.json").write_text(as_json(report), encoding="utf-8")
    write_curves(folder / "curves.csv", report.laws, report.curves)
    if draw:
        from softmodels.pictures.fit_pictures import page, pictures

        images = pictures(report)
        for name, data in images.items():
            (folder / name).write_bytes(data)
        (folder / "report.html").write_text(page(report, images), encoding="utf-8")
