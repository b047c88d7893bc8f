"""The commands about materials: ``fit``, ``curve``, ``score`` and ``silicones``, and the options with which they read tests."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import math
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np

from geometries import registry
from softmodels.case.case import Case
from softmodels.case.materials import MaterialErrors, material_from
from softmodels.cli import ending, options
from softmodels.common import commands, errors, pages, processes
from softmodels.common.files import csv_text, read_text, write_text
from softmodels.common.pages import Page
from softmodels.common.units import UnitError, brief, exact_text, number, quantity, with_prefix
from softmodels.fitting import comparison, problem, scoring, vibration
from softmodels.fitting.curves import oscillation, residuals
from softmodels.fitting.curves.curve import EQUILIBRIUM_RATE, Specimen, TensileCurve, TensileError, read_curves
from softmodels.fitting.curves.fit import fit_curves, prepared
from softmodels.fitting.outlines import fit, shapes, views
from softmodels.fitting.outlines.device import MeasuredDevice
from softmodels.fitting.outlines.inflations import Inflation
from softmodels.fitting.outlines.views import SideView
from softmodels.fitting.problem import FitError, FitOptions
from softmodels.fitting.scoring import Score
from softmodels.materials import specimens
from softmodels.materials.laws import DEFAULT_POISSON_RATIO, Material, MaterialError
from softmodels.materials.memory import MOST_BRANCHES
from softmodels.materials.silicones import (
    MAKERS_ELONGATION,
    PRODUCTS,
    SILICONE_DENSITY,
    SILICONES,
    Silicone,
    break_words,
    casting_of,
    full_name,
    product_of,
    publications,
    spread_sentence,
)
from softmodels.mechanics import mpi
from softmodels.runs import labels, notes, outcomes

if TYPE_CHECKING:
    from measurement.outline.outline import Outline


# ----------------------------------------------------------------------------------------------------------------------
# Options of several of these commands.


TENSILE = "FILE[:TEST][:RATE]"
MATERIAL = "NAME[:KEY=VALUE,...]"


@dataclasses.dataclass(frozen=True)
class CurveFiles:
    """Tests, and what their files do not contain."""

    tensile: tuple[str, ...] = commands.option(multiple=True, metavar=TENSILE,
    help="Curve of a test, FILE[:TEST][:RATE], CSV or Excel "
                                      "(.xlsx); may be given several times.")  # fmt: skip
    columns: str = commands.option(default="", metavar="KIND=COLUMN[UNIT],...",
    help="Columns of the files, if the headers do not name "
                          "them: 'strain=1[%],stress=Load[kPa]'.")  # fmt: skip
    gauge_length: float | None = commands.option(
        type=registry.QuantityType("m"), help="Undeformed length, for files with extensions."
    )
    cross_section: float | None = commands.option(
        type=registry.QuantityType("m^2"), help="Undeformed cross-section, such as 18mm^2, for files with forces."
    )
    radius: float | None = commands.option(type=registry.QuantityType("m"), help="A balloon's undeformed radius.")
    thickness: float | None = commands.option(type=registry.QuantityType("m"), help="Its undeformed thickness.")

    def check_given(self, *more: str) -> None:
        """Raise `TensileError` for the first option about curves, ``more`` of a command's own among them, if no curve is
        given."""
        for field in () if self.tensile else dataclasses.fields(self):
            named = field.name in ("columns", "gauge_length", "cross_section", *more)
            if named and getattr(self, field.name) != field.default:
                name = field.name.replace("_", "-")
                raise TensileError(f"--{name} applies to curves only; give one with --tensile, or leave it out")

    def read(self, stretch: str | None = None, history: bool = False, beside: bool = False) -> list[TensileCurve]:
        """Read the curves within a range of stretch as typed (None for all), or the whole tests with their times, and average
        dense ones (see `thinned`), perhaps beside tests of `at_frequencies`; `TensileError` if one cannot be used, or they do
        not go together."""
        if not self.tensile:
            raise TensileError("nothing to fit to; give a curve with --tensile FILE")
        specimen = Specimen(self.cross_section, self.gauge_length, self.radius, self.thickness)
        curves: list[tuple[str, TensileCurve]] = []
        for text in self.tensile:
            file, test, rate = parts(text)
            if oscillation.of_test(test) or test.lower() == vibration.TEST:
                if not beside:
                    raise TensileError(f"{text}: moduli over frequency and vibrations are data of softmodels fit --memory only")
                continue
            pace = rate_of(rate, self.gauge_length)
            curves += [(text, curve) for curve in read_curves(file, test, self.columns, specimen, history=history, rate=pace)]
        names = [curve.name for _, curve in curves]
        own = [  # files of one name in different folders
            dataclasses.replace(c, name=c.name.replace(parts(text)[0].name, text, 1)) if names.count(c.name) > 1 else c
            for text, c in curves
        ]
        return prepared(own, stretch_range(stretch) if stretch else None, history)

    def at_frequencies(self, poisson: float) -> list[oscillation.FrequencyTest]:
        """Read the tests of moduli or tan delta over frequency, and vibrations; `TensileError` if one cannot be used."""
        made: list[oscillation.FrequencyTest] = []
        for file, test, lacking in map(parts, self.tensile):
            columns = self.columns if "frequency=" in self.columns else ""
            if oscillation.of_test(test):
                made += oscillation.read(file, test.lower(), columns, lacking)
            elif test.lower() == vibration.TEST:
                if not lacking:
                    raise TensileError(
                        f"{file}: a vibration needs its device; add the case file, such as {file.name}:vibration:beam.toml"
                    )
                made += vibration.read(file, Path(lacking), poisson=poisson)
        return made

    @property
    def files_read(self) -> list[Path]:
        return [parts(text)[0] for text in self.tensile]


def parts(text: str) -> tuple[Path, str, str]:
    """Return the parts of ``FILE[:TEST][:RATE]``; an empty rate where none is given; of an oscillation a temperature, of a
    vibration a case file."""
    name, test, rate = text, "uniaxial", ""
    while not Path(name).exists() and ":" in name:
        head, _, tail = name.rpartition(":")
        if not head:
            break
        if tail.lower() == _RELAXED or re.search(r"\d.*/", tail) or _LACKING.fullmatch(tail):
            rate = tail
        else:
            test = tail
        name = head
    return Path(name), test, rate


_RELAXED, _LACKING = "equilibrium", re.compile(r"-?\d[\d.,]* ?(°C|degC|K)|.+\.toml")


def rate_of(text: str, length: float | None) -> float | None:
    """Return a rate in 1/s (see `read_curves`): of the stretch, or with the undeformed length in m of a speed."""
    if not text:
        return None
    if text.lower() == _RELAXED:
        return EQUILIBRIUM_RATE
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
    except ValueError as error:
        why = f" ({error})" if isinstance(error, UnitError) else ""
        raise TensileError(f"stretch {brief(text)} is not a range{why}; write it like 1.02:3") from None
    if not 0.0 < low < high < 100.0:
        raise TensileError(f"stretch {text!r}: the range must rise, from above 0 to below 100")
    if high <= 1.0 <= low or low == high:
        raise TensileError(f"stretch {text!r} contains only the undeformed state; give a range such as 1.02:3")
    return low, high


@dataclasses.dataclass(frozen=True)
class OutlineOptions:
    """How outlines are read."""

    changes: tuple[str, ...] = options.set_field()
    untrusted: bool = commands.flag_option("Also use outlines that the measurement flags as untrusted.")
    height_datum: str | None = commands.option(
        type=commands.Choice(problem.HEIGHTS_FROM),
        help="Zero of the heights if the case has gravity or forces, or a top that is not flat (balloon, bellows): the "
        "upper edge of the shadow at zero pressure, the apex there, or the undeformed top.  [default: the shadow; if the "
        "undeformed top is not flat the apex, which outlines have to name]",
    )


# ----------------------------------------------------------------------------------------------------------------------
# The command ``fit``: read the measurements, fit the laws, write the result files.


BENCH_UNITS = {"pressure_offset": "Pa", "zero": "m", "centre": "m", problem.TILT: "degree"}
"""Units of the bench corrections that have one."""


@dataclasses.dataclass(frozen=True)
class FitGiven(OutlineOptions, CurveFiles):
    """The options of `fit_material`."""

    heights: Path | None = commands.option(  # noqa: RUF009
        type=click.Path(path_type=Path), metavar="HEIGHTS.csv",
        help="Fit the largest deflections at each pressure, as in the thesis, instead of outlines.",
    )  # fmt: skip
    free: tuple[str, ...] = commands.option(multiple=True, metavar="NAME", help="With a case: free poisson too.")
    exclude: tuple[str, ...] = commands.option(
        multiple=True, metavar="PHOTOGRAPH", help="Exclude a photograph, such as 4.jpg; may be repeated."
    )
    silicone: str | None = commands.option(
        metavar="NAME", help="Silicone the part was cast from, such as ecoflex-00-30: its published moduli reveal pressures in "
        "a wrong unit. any: unlisted.  [default: the case's material]",
    )  # fmt: skip
    laws: str = commands.option("--material", default="yeoh", show_default=True, metavar="LAW,...",
                       help=f"Laws to compare: {problem.known_laws()}, or all.")  # fmt: skip
    memory: bool = commands.flag_option(
        "Fit relaxation too, and softening where the data show it, to tests with a column of times, or a RATE such as 0.05/s, "
        "50mm/min or equilibrium."
    )
    branches: int = commands.option(
        default=0, type=click.IntRange(0, MOST_BRANCHES), metavar="COUNT",
        help="With --memory: fit so many branches with their relaxation times.  [default: one per decade that the data show]",
    )  # fmt: skip
    stretch: str | None = commands.option(metavar="FROM:TO", help="Range of stretch to fit over.  [default: the whole curves]")
    stress_error: str = commands.option(
        default="auto", show_default=True, metavar="ERROR", help="2%+0.5kPa; constant (unweighted); auto weights by 2 % and "
        "the curve's noise. The last two are scaled by the scatter.",
    )  # fmt: skip
    gauge_error: str = commands.option(
        default="auto", show_default=True, metavar="SHARE", help="Standard error of a factor on each test (cross-section, load "
        "cell), such as 5%; auto takes 3 % and 1 %, 3.2 % together; none omits it, which makes the intervals much too narrow.",
    )  # fmt: skip
    poisson: float = commands.option(
        type=registry.QuantityType(""),
        default=DEFAULT_POISSON_RATIO,
        show_default=True,
        help="Poisson's ratio of the fitted material.",
    )
    fix: tuple[str, ...] = commands.option(multiple=True, metavar="NAME=VALUE", help="Fix a parameter, such as c3=0.")
    bounds: tuple[str, ...] = commands.option(
        multiple=True, metavar="NAME=FROM:TO", help="Bound a parameter; an end may be empty."
    )
    prior: tuple[str, ...] = commands.option(multiple=True, metavar="NAME=VALUE+-ERROR", help="Prior knowledge of a parameter.")
    robust: bool = commands.flag_option("Robust loss: outliers count by their size, not its square.")
    no_profiles: bool = commands.flag_option("Skip the profile likelihoods: intervals from the covariance only.")
    no_pictures: bool = commands.flag_option("Skip the pictures and the report.")
    quiet: bool = commands.quiet_option()
    output: Path | None = commands.output_option(  # noqa: RUF009
        "Folder for the results.  [default: results/fit; results/fit-2 and so on if that holds another fit]"
    )

    def fit_options(self, changes: Mapping[str, problem.Change]) -> FitOptions:
        """Return them as `FitOptions`; `FitError` for a gauge error that is no share, or a parameter that is to be both free
        and fixed."""
        gauge = {"auto": problem.USUAL_GAUGE_ERROR, "none": 0.0}
        return FitOptions(
            poisson=self.poisson, changes=changes, robust=self.robust, profiles=not self.no_profiles,
            silicone=self.silicone, stress_error=self.stress_error,
            gauge_error=gauge[self.gauge_error] if self.gauge_error in gauge else quantity(self.gauge_error, ""),
            free=self.free_of_bench, exclude=self.exclude, untrusted=self.untrusted,
            height_datum=self.height_datum or "", memory=self.memory, branches=self.branches,
        )  # fmt: skip

    @property
    def free_of_bench(self) -> tuple[str, ...]:
        """The free bench and device parameters: the defaults plus ``--free`` minus ``--fix``; `OutlineFitError` for one that is
        to be both."""
        fixed = {text.partition("=")[0].strip() for text in self.fix}
        if both := [name for name in self.free if name in fixed]:
            raise shapes.OutlineFitError(f"{both[0]} cannot be both free (--free) and fixed (--fix)")
        return tuple(dict.fromkeys(name for name in (*problem.FREE, *self.free) if name not in fixed))


def curve_changes(options: FitGiven, choices: Sequence[problem.LawChoice]) -> dict[str, problem.Change]:
    """Return the changes that ``--fix``, ``--bounds`` and ``--prior`` make to parameters of laws fitted to curves; `FitError`
    for a text that is none, or an unknown name."""
    units = {name: choice.unit(name) for choice in choices for name in choice.names}
    laws, known = ", ".join(choice.name for choice in choices), ", ".join(units)
    return _changes(options, units, lambda name: f"{laws}: no parameter {name!r}; there is {known}", value_needed=True)


def device_changes(options: FitGiven, lengths: Mapping[str, Sequence[str]]) -> dict[str, problem.Change]:
    """Return the same for devices, with variable lengths by name; ``--fix leak`` keeps its nominal value. Of several devices
    ``leak`` is that of each, and ``NAME.leak`` that of one. `FitError` as of `curve_changes`."""
    bench = {name: BENCH_UNITS.get(name, "") for name in (*problem.BENCH, problem.TILT)}
    of = {device: {**bench, **dict.fromkeys(names, "m")} for device, names in lengths.items()}
    own = {"poisson": "", **{name: unit for units in of.values() for name, unit in units.items()}}
    known = ", ".join(own)
    if len(of) > 1:
        own |= {f"{device}.{name}": unit for device, units in of.items() for name, unit in units.items()}
        known += f", each of them also of one device, such as {next(reversed(of))}.leak"
    return _changes(
        options,
        {**problem.all_parameters(), **own},
        lambda name: f"there is no parameter {name!r}; the bench and the device have {known}",
        value_needed=False,
    )


def _changes(
    options: FitGiven, units: Mapping[str, str], unknown: Callable[[str], str], value_needed: bool
) -> dict[str, problem.Change]:
    """Return the changes by parameter; the curves' own ``gauge1``, ``slack1`` and so on are known to all laws, and with
    ``--memory`` the weights of its branches, its softening and what its viscosity depends on."""
    changes: dict[str, problem.Change] = {}
    remembered = ("share", "time", *specimens.SOFTENING, *specimens.FLOW) if options.memory else ()
    if remembered:
        units = {**units, specimens.SOFTENING[1]: "Pa"}
    of_tests = ("gauge", *residuals.ORIGIN)
    kinds: tuple[tuple[tuple[str, ...], Callable[[str, str], problem.Change]], ...] = (
        (options.fix, _read_fixed), (options.bounds, read_bounds), (options.prior, read_prior),
    )  # fmt: skip
    for texts, read in kinds:
        for text in texts:
            name, equals, value = (part.strip() for part in text.partition("="))
            if name not in units and not name.startswith((*of_tests, *remembered)):
                raise FitError(unknown(name))
            if value_needed and not equals:
                raise FitError(f"{text!r} is not NAME=VALUE")
            own = "Pa" if name.startswith(residuals.ORIGIN[1]) else "s" if remembered and name.startswith("time") else ""
            unit = units.get(name, own)
            try:
                changes.setdefault(name, {}).update(read(value, unit) if equals or read is not _read_fixed else {"fixed": True})
            except (UnitError, FitError) as error:
                raise FitError(f"{text!r}: {error}") from None
    return changes


def _read_fixed(value: str, unit: str) -> problem.Change:
    return {"start": quantity(value, unit), "fixed": True}


def read_bounds(value: str, unit: str) -> problem.Change:
    """Read ``FROM:TO``; an end may be empty."""
    low, colon, high = value.partition(":")
    if not colon:
        raise FitError(f"{value!r} is not FROM:TO")
    change: problem.Change = {}
    if low.strip():
        change["lower"] = quantity(low, unit)
    if high.strip():
        change["upper"] = quantity(high, unit)
    return change


def read_prior(value: str, unit: str) -> problem.Change:
    """Read ``VALUE+-ERROR``."""
    mean, separator, error = value.partition("+-")
    if not separator:
        raise FitError(f"{value!r} is not VALUE+-ERROR")
    return {"prior": problem.Prior(quantity(mean, unit), quantity(error, unit))}


@options.command("fit")
@click.argument("files", metavar="[CASE.toml [OUTLINES...]]...", nargs=-1, type=click.Path(path_type=Path))
@commands.options(FitGiven)
def fit_material(files: tuple[Path, ...], how: FitGiven) -> None:
    """Fit laws to measurements, with 95 % intervals.

    The result is a material file for simulations. With --tensile laws are fitted to curves of test machines. With a CASE (such
    as the case.toml in a folder of results), to outlines of that device at all pressures (files or folders that softmodels
    measure photos has made), or to its side views (the folder of softmodels measure view), alone or together with curves; or to
    a table of its pressure over its volume, radius, diameter or rise ('volume (ml)' and 'pressure (kPa)'), past a limit point
    too, by itself.
    Systematic errors of the bench are fitted too, within plausible
    bounds: an offset and a unit of pressure, a leak, a unit of length, the zero plane, the axis; and the thickness of the part
    (membrane of a disk), by default to 2 %. --fix leak keeps one of them at its nominal value, --prior 'leak=0+-5%' or --prior
    membrane=6mm+-0.2mm sets an expected error. Gravity, masses and forces of the case are taken as known; they act in every
    photograph, also at zero pressure.

    With several CASEs, each followed by its OUTLINES, one material is fitted to all of them, as to parts of one cast. The
    errors of the bench are fitted per device: --fix leak applies to all of them, --fix disk.leak to the one whose case is
    named disk. For each device the misfit is reported.

    TEST is uniaxial (default), compression, planar (pure shear), equibiaxial or balloon (pressure against stretch or radius);
    with --memory also oscillation and shear-oscillation (moduli or tan delta over frequency, of tension or shear; a
    temperature, such as 23°C, may stand in place of a RATE) and vibration (displacement or acceleration over time of a device
    that rings in its first mode; its case file stands in place of a RATE). A file's headers name its columns, such as 'strain
    (%)' and 'stress (kPa)'; only the loading ramp up to the break is used.
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
      softmodels fit --tensile hold.csv --tensile dma.csv:oscillation --memory
      softmodels fit --tensile hold.csv --tensile decay.csv:vibration:beam.toml --memory
      softmodels fit --tensile pull.csv --columns 'extension=1[mm],force=2[N]' --gauge-length 33mm --cross-section 18mm^2
      softmodels fit results/disk/case.toml outlines/ --material yeoh --fix c3=0Pa
      softmodels fit results/disk/case.toml outlines/ --tensile curve.csv --material neo-hookean,yeoh
      softmodels fit finger.toml views/ --material neo-hookean
      softmodels fit balloon.toml volumes.csv --material yeoh
      softmodels fit a/case.toml outlines_a/ b/case.toml outlines_b/ --material yeoh
      softmodels fit results/disk/case.toml --heights outlines/heights.csv --material neo-hookean
      python -m softmodels.disk --material results/fit/fitted.toml

    \b
    Exit status: 0 done; 1 no law was accepted: the reason is reported, and the rejected fit is in unsound.toml, not
    in fitted.toml; 2 bad input.
    """
    comm = mpi.start() if files else None
    read = [*files, *how.files_read, *([how.heights] if how.heights else [])]
    given = how.output, Path("results/fit"), "fit", {**vars(how), "files": files}, read
    opened = functools.partial(commands.open_folder, *given)
    folder = mpi.kept_on_root(comm, opened) if comm is not None else opened() if mpi.speaks() else None
    try:
        with notes.sentences() if files else contextlib.nullcontext():
            report = _device_report(files, how) if files else _curves_report(how)
    except (problem.UnsoundError, problem.CannotEvaluate) as error:
        if folder is not None:  # the files of an earlier fit are not mistaken for this one's
            with contextlib.suppress(OSError):
                comparison.retire(folder.path)
        ending.fail(str(error), commands.EXIT_FAILED)
    if folder is None:
        sys.exit(commands.EXIT_DONE if report.chosen.sound else commands.EXIT_FAILED)
    ending.write_into(folder, lambda place: _write_fit(report, folder.path, place, how), "the results")
    if not how.quiet:
        processes.say(comparison.as_text(report))
    if report.separate:
        processes.say(f"softmodels: {report.separate.pairs[0].sentence}; {report.separate.spread}", err=True)
    if not how.quiet:
        for text in [*report.chosen.judgement.notes, _closing(report, folder.path)]:
            processes.say(text)
    if not report.chosen.sound:
        processes.say(f"softmodels: {report.chosen.choice.name}: {report.chosen.warnings[0]}", err=True)
    sys.exit(commands.EXIT_DONE if report.chosen.sound else commands.EXIT_FAILED)


def _closing(report: comparison.FitReport, folder: Path) -> str:
    file = folder / comparison.name_of(report.chosen)
    if report.chosen.sound:
        return f"written to {folder}; use it with --material {file}"
    return f"written to {folder}; no fitted.toml, because the fit was rejected: inspect {file}, do not simulate with it"


def _curves_report(how: FitGiven) -> comparison.FitReport:
    if how.heights or how.free or how.untrusted or how.exclude or how.height_datum:
        raise FitError("--heights, --free, --untrusted, --exclude and --height-datum need a device; give its case file first")
    tests: list[TensileCurve | oscillation.FrequencyTest] = [
        *how.read(how.stretch, how.memory, beside=how.memory), *how.at_frequencies(how.poisson)
    ]  # fmt: skip
    choices = problem.law_choices(how.laws, how.poisson)
    residuals.StressError.from_text(how.stress_error)
    progress = outcomes.Progress(labels.StateLabels(""), how.quiet or not mpi.speaks())
    return fit_curves(tests, how.laws, how.fit_options(curve_changes(how, choices)), progress=progress.say)


def _device_report(files: Sequence[Path], how: FitGiven) -> comparison.FitReport:
    pairs = _devices(files)
    table = fit.table_in(pairs, how.exclude, how.columns)  # type: ignore[arg-type]
    if table is not None:
        how = dataclasses.replace(how, columns="")
    how.check_given("stretch", "radius", "thickness", "stress_error", "gauge_error")
    if how.branches or any(oscillation.of_test(test) or test == vibration.TEST for _, test, _ in map(parts, how.tensile)):
        raise FitError(
            "outlines are fitted without moduli over frequency, vibrations and --branches; leave them out, or fit curves only"
        )
    curves = how.read(how.stretch, how.memory) if how.tensile else []
    residuals.StressError.from_text(how.stress_error)
    if how.heights is not None and (len(pairs) > 1 or pairs[0][1]):
        raise shapes.OutlineFitError("fit either outlines or --heights, not both: the same data would count twice")
    if how.heights is not None and how.tensile:
        raise shapes.OutlineFitError(
            "heights without outlines have no errors to weigh tensile curves with; add outlines, or fit the two separately"
        )
    devices = []
    for file, outlines in pairs:
        devices.append((Case.from_file(file, changes=how.changes), outlines if table is None else [table]))
        if how.heights is None and not outlines:
            raise shapes.OutlineFitError(
                f"{file} describes only the device; add its outlines, a table of its pressures, or --heights heights.csv"
            )
    cases = [case for case, _ in devices]
    lengths = {
        name: case.actuator.variable for name, case in zip(fit.device_names([case.name for case in cases]), cases, strict=True)
    }
    chosen = how.fit_options(device_changes(how, lengths))
    comm = mpi.start()
    if how.heights is not None:
        return fit.fit_heights(cases[0], how.heights, how.laws, chosen, comm=comm)
    return fit.fit(devices, material=how.laws, options=chosen, curves=curves, comm=comm)


def _devices(files: Sequence[Path]) -> list[tuple[Path, list[Path]]]:
    """Return the case files, each with the outlines that follow it."""
    pairs: list[tuple[Path, list[Path]]] = []
    for file in files:
        if not pairs or file.suffix == ".toml":
            pairs.append((file, []))
        else:
            pairs[-1][1].append(file)
    return pairs


def _write_fit(report: comparison.FitReport, folder: Path, place: Path, how: FitGiven) -> None:
    """Write the material files, every number, the curves, the pictures and the page; put away those of an earlier fit."""
    own: dict[str, str] = {}
    if report.separate:
        for curve, fitted in zip(report.separate.curves, report.separate.own, strict=True):
            alone = dataclasses.replace(report, curves=(curve,), separate=None)
            own[comparison.separate_file(report.separate, curve)] = comparison.material_toml(fitted, alone)
    comparison.write_materials(report, place, own)
    (place / "fit.json").write_text(comparison.as_json(report), encoding="utf-8")
    comparison.write_curves(place / "curves.csv", report.laws, report.curves)
    if report.oscillations:
        comparison.write_oscillations(place / "oscillations.csv", report)
    if not how.no_pictures:
        from softmodels.pictures import fits, style

        drawn = fits.figures(report)
        for name, figure in drawn.items():
            (place / f"{name}.png").write_bytes(style.png(figure))
        tables = {file.name: read_text(file) for file in [place / "curves.csv", place / "oscillations.csv"] if file.exists()}
        (place / "report.html").write_text(fits.page(report, drawn, tables), encoding="utf-8")
    comparison.retire(folder, {file.name for file in place.iterdir()})


# ----------------------------------------------------------------------------------------------------------------------
# The command ``curve``: stress of a material in test specimens and its balloon's pressure, without a mesh.


CURVE_POINTS = 201
TABLE_POINTS = 11


@dataclasses.dataclass(frozen=True)
class CurveOptions(CurveFiles):
    """The options of `curve`."""

    tensile: tuple[str, ...] = commands.option(
        multiple=True, metavar=TENSILE, help="Measured curve to plot for comparison, FILE[:TEST]."
    )
    radius: float = commands.option(
        type=registry.QuantityType("m"), default=0.02, help="The balloon's undeformed radius.  [default: 20mm]"
    )
    thickness: float = commands.option(
        type=registry.QuantityType("m"), default=0.001, help="Its undeformed thickness.  [default: 1mm]"
    )
    material: tuple[str, ...] = commands.option(multiple=True, metavar=MATERIAL,
    help="Silicone, TOML file, or law with numbers "
                                       "(yeoh:c1=8kPa,c2=90Pa); several are compared.")  # fmt: skip
    stretch: str = commands.option(default="1:4", show_default=True, metavar="FROM:TO", help="Range of stretch.")
    incompressible: bool = commands.flag_option("Use a Poisson's ratio of 0.5 instead of the material's.")
    no_pictures: bool = commands.flag_option("Do not draw the picture.")
    quiet: bool = commands.quiet_option()
    output: Path | None = commands.output_option(  # noqa: RUF009
        "Folder for the results.  [default: results/curve; results/curve-2 and so on if that holds other curves]"
    )


@options.command("curve")
@commands.options(CurveOptions)
def curve(how: CurveOptions) -> None:
    """Show the curves of materials in standard tests.

    The tests are uniaxial tension, pure shear and equibiaxial tension; with them comes the inflation of a balloon. Each is
    drawn with its own Poisson's ratio. Where a law stops being stable, is said. Ogden's factors take commas:
    ogden:mu=0.63MPa,0.0012MPa,-0.01MPa,alpha=1.3,5,-2 and perhaps convention=2mu/alpha^2.

    \b
    Examples:
      softmodels curve --material ecoflex-00-30 --material ecoflex-00-30/marechal-2021 --stretch 1:3
      softmodels curve --material results/fit/fitted.toml --tensile curve.csv --stretch 0.5:6
      softmodels curve --material gent:shear_modulus=20kPa,limit=30 --radius 20mm --thickness 1mm

    \b
    Exit status: 0 done; 2 bad input.
    """
    low, high = stretch_range(how.stretch)
    if not how.material:
        raise MaterialError("nothing to show; give a material with --material NAME")
    beside = {"poisson": "0.5"} if how.incompressible else {}
    materials = [material_from(text, beside) for text in how.material]
    how.check_given()
    files = [*map(Path, how.material), *how.files_read]
    folder = commands.open_folder(how.output, Path("results/curve"), "curves", vars(how), files) if mpi.speaks() else None
    measured = how.read() if how.tensile else []
    if min(how.radius, how.thickness) <= 0.0 or how.thickness > how.radius:
        raise TensileError("the balloon's radius and thickness must be above zero, and the thickness less than the radius")
    stretches = np.linspace(low, high, CURVE_POINTS)
    many = [specimens.MaterialCurves.of(name, law, stretches) for name, law in zip(how.material, materials, strict=True)]
    ratio = how.thickness / how.radius
    if folder is None:
        return

    def write(place: Path) -> None:
        write_text(place / "curves.csv", _curves_csv(many, ratio))
        if not how.no_pictures:
            from softmodels.pictures import fits

            (place / "curves.png").write_bytes(fits.draw(many, measured, how.radius, how.thickness))

    ending.write_into(folder, write, "the results")
    if not how.quiet:
        for curves in many:
            processes.say(table_of(curves, ratio))
        processes.say(f"written to {folder.path}")


def table_of(curves: specimens.MaterialCurves, thickness_over_radius: float) -> str:
    """Return a material's table for the terminal."""
    modulus, unit = with_prefix(curves.material.shear_modulus_0, "Pa")
    nu = curves.material.poisson
    lines = [f"{curves.name}: {curves.material.name}, shear modulus {modulus} {unit}, Poisson's ratio {nu:g}"]
    lines.append("  stretch   nominal stress (kPa)                      balloon (kPa)")
    lines.append("            uniaxial     planar       equibiaxial")
    columns = [*(curves.responses[mode].stress for mode in specimens.MODE_NAMES), curves.balloon(thickness_over_radius)]
    for i in np.linspace(0, len(curves.stretch) - 1, TABLE_POINTS).astype(int):
        lines.append(f"  {curves.stretch[i]:7.3f} " + "".join(f"  {column[i] / 1e3:11.5g}" for column in columns))
    lines += [f"  warning: {text}" for text in curves.verdict.flags]
    lines += [f"  {text}" for text in curves.verdict.notes]
    return "\n".join(lines) + "\n"


def _curves_csv(many: list[specimens.MaterialCurves], thickness_over_radius: float) -> str:
    stresses = [f"{mode}_{kind}_Pa" for mode in specimens.MODE_NAMES for kind in ("nominal", "true")]
    rows = []
    for curves in many:
        columns = [c for mode in specimens.MODE_NAMES for c in (curves.responses[mode].stress, curves.true_stress(mode))]
        columns.append(curves.balloon(thickness_over_radius))
        nu = exact_text(curves.material.poisson, "")
        for i, stretch in enumerate(curves.stretch):
            numbers = [f"{column[i]:.9g}" for column in columns]
            rows.append([curves.name, nu, f"{stretch:.9g}", *numbers, f"{thickness_over_radius:.6g}"])
    return csv_text(["material", "poisson", "stretch", *stresses, "balloon_Pa", "thickness_over_radius"], rows)


# ----------------------------------------------------------------------------------------------------------------------
# The command ``score``: compare materials with measurements they were not fitted to.


@dataclasses.dataclass(frozen=True)
class ScoreOptions(OutlineOptions, CurveFiles):
    """The options of `score`."""

    material: tuple[str, ...] = commands.option(multiple=True, metavar=MATERIAL,
    help="Silicone, TOML file such as fitted.toml, or law "
                                       "with numbers; several are compared.")  # fmt: skip
    stretch: str | None = commands.option(
        metavar="FROM:TO", help="Range of stretch of the curves.  [default: the whole curves]"
    )
    stress_error: str = commands.option(default="auto", show_default=True, metavar="ERROR",
    help="Standard error of the measured "
                               "stress, 2%+0.5kPa; auto is 2 % and the curve's noise.")  # fmt: skip
    quiet: bool = commands.quiet_option()
    output: Path | None = commands.output_option(  # noqa: RUF009
        "Folder for scores.csv and curves.csv.  [default: results/score; results/score-2 and so on if that holds other scores]"
    )


@options.command("score")
@click.argument("files", metavar="[CASE.toml OUTLINES...]", nargs=-1, type=click.Path(path_type=Path))
@commands.options(ScoreOptions)
def score(files: tuple[Path, ...], how: ScoreOptions) -> None:
    """Score materials against measurements held out of a fit.

    The measurements are tensile curves, or outlines, side views or a table of pressures of a device. The material is not
    fitted. For each of them
    these are reported: the root mean square of predicted minus measured; chi squared per value (1: within the measurement's
    error; 100: a law that is 10 standard errors off); the parts of it explained by the errors of the measurement and of the
    material (from a fitted.toml: the 95 % region of its covariance, as in the band of a run); the number of values within the
    95 % band of the measurement's error; and the largest deviation. With outlines, systematic errors of the bench (offset of
    the pressure, leak, zero plane) are fitted too, as in a fit. A material with a memory is followed through the times of the
    whole test; FILE:TEST:RATE gives a rate if there are none.

    \b
    Examples:
      softmodels score --material ecoflex-00-30 --material ecoflex-00-30/marechal-2021 --tensile pull.csv --stretch 1.02:3
      softmodels score --material results/fit/fitted.toml --tensile other.csv --stress-error 2%+0.5kPa
      softmodels score results/disk/case.toml outlines/ --material results/fit/fitted.toml --material yeoh:c1=14kPa

    \b
    Exit status: 0 done; 1 a material has no states to compare; 2 bad input.
    """
    materials = _materials(how.material)
    if not files and not how.tensile:
        raise TensileError("nothing to score against; give a curve with --tensile FILE, or a case with its outlines")
    if len(files) == 1:
        raise TensileError(f"{files[0]} describes only the device; add its outlines")
    error = scoring.error_of(how.stress_error)
    curves = []
    if how.tensile:
        curves = how.read(how.stretch, any(material.memory is not None for material in materials.values()))
    device, outlines = _device(files, how) if files else (None, [])
    read = [*files, *map(Path, how.material), *how.files_read]
    asked = {**vars(how), "files": [str(file) for file in files]}
    folder = commands.open_folder(how.output, Path("results/score"), "scores", asked, read) if mpi.speaks() else None
    errors = _errors(how.material)
    scores = [
        scoring.score_curve(name, material, curve, error, errors.get(name))
        for curve in curves
        for name, material in materials.items()
    ]
    if device is not None:
        comm = mpi.start()
        try:
            scores += scoring.against_outlines(materials, device, outlines, comm, errors, error)
        except FitError as trouble:
            ending.fail(str(trouble), commands.EXIT_FAILED)
    if folder is None:
        return

    def write(place: Path) -> None:
        scoring.write_scores(place / "scores.csv", scores)
        if curves:
            scoring.write_readings(place / "curves.csv", materials, curves, error, errors)
        write_text(place / "report.html", score_page(scores, materials, read_text(place / "scores.csv")))

    ending.write_into(folder, write, "the results")
    if not how.quiet:
        processes.say(score_table(scores))
        processes.say(f"written to {folder.path}")


def _materials(names: tuple[str, ...]) -> dict[str, Material]:
    if not names:
        raise MaterialError("nothing to score; give a material with --material NAME")
    if len(set(names)) < len(names):
        raise MaterialError("a material is named twice")
    return {name: material_from(name, {}) for name in names}


def _device(files: tuple[Path, ...], how: ScoreOptions) -> tuple[MeasuredDevice, Sequence[Outline | SideView] | Inflation]:
    case = Case.from_file(files[0], changes=how.changes)
    device = MeasuredDevice.of(case, views.seen_in(files[1:])).counting_from(how.height_datum or "")
    table = fit.table_in([(case, files[1:])], (), how.columns)
    return device, fit.outlines_of(files[1:], how.untrusted) if table is None else table


def _errors(names: tuple[str, ...]) -> dict[str, MaterialErrors]:
    """Return the errors of those materials that are files of a fit."""
    errors = {}
    for name in names:
        if name.endswith(".toml"):
            with contextlib.suppress(MaterialError):  # a material without a fit, or a fit without intervals
                errors[name] = MaterialErrors.from_file(Path(name))
    return errors


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
    for data in dict.fromkeys(score.data for score in scores):
        ranked = sorted((score for score in scores if score.data == data), key=lambda score: score.chi2)
        rows = [
            (score.material, str(score.count), _rms(score), f"{score.chi2:.4g}", f"{score.chi2_measurement:.3g}",
             f"{score.chi2_material:.3g}" if math.isfinite(score.chi2_material) else "unknown", f"{score.coverage:.1%}",
             score.worst)
            for score in ranked
        ]  # fmt: skip
        sections.append((data, [pages.Table(rows, head)]))
        facts.append(pages.Fact(f"Best for {data}", ranked[0].material,
        f"chi squared per value {ranked[0].chi2:.4g} (1: as exact as "
                          f"the measurement), rms {_rms(ranked[0])}"))  # fmt: skip
    sources = [f"{name}: {text}" for name, material in materials.items() for text in publications(material)]
    answer = "Materials against measurements they were not fitted to, the best one first."
    return Page("Scores", answer, sections, commands.Provenance.now(), facts, (), sources, {"scores.csv": table}).html()


def _rms(score: Score) -> str:
    return f"{score.rms / 1e3:.3g} kPa" if score.unit == "Pa" else f"{score.rms * 1e3:.3g} mm"


def score_table(scores: list[Score]) -> str:
    """Return the table for a terminal, the best material of each measurement first."""
    lines = []
    for data in dict.fromkeys(score.data for score in scores):
        lines.append(f"{data}:")
        lines.append(
            f"  {'material':34s} {'values':>6s} {'rms':>11s} {'chi2/value':>11s} {'of measurement':>15s} "
            f"{'of material':>12s} {'in 95 % band':>13s}  furthest off"
        )
        for score in sorted((s for s in scores if s.data == data), key=lambda s: s.chi2):
            material = f"{score.chi2_material:.3g}" if math.isfinite(score.chi2_material) else "unknown"
            chi2 = f"{score.chi2:11.4g} {score.chi2_measurement:15.3g} {material:>12s}"
            numbers = f"{score.count:6d} {_rms(score):>11s} {chi2} {100 * score.coverage:11.1f} %"
            lines.append(f"  {score.material:34s} {numbers}  {score.worst}")
    return "\n".join(lines)


# ----------------------------------------------------------------------------------------------------------------------
# The command ``silicones``: every named silicone with all its sources.


HEAD = f"  {'--material':42s} {'modulus':>10s} {'stress at stretch 1.5, 2':>26s}   {'fitted over stretch':20s}"
PLAIN = "*"
"""Mark of the source used for the plain name."""


@options.command("silicones")
@click.argument("products", nargs=-1, metavar="[PRODUCT...]")
def silicones(products: tuple[str, ...]) -> None:
    """List the named silicones with all their sources.

    The list has the shear modulus at small strain, stresses in uniaxial tension, and range. With a PRODUCT, such as
    ecoflex-00-30, where and how each of its sources was measured, and its density. A product's plain name means the source with
    a star: of its sources in tension, from the softest to the stiffest by their secant modulus at stretch 1.5, the middle one,
    and of an even number the stiffer of the two in the middle.

    \b
    Exit status: 0 done; 2 no such silicone.
    """
    names = [product_of(name) for name in products]
    for name in names:
        if name not in PRODUCTS:
            ending.fail(f"{name!r} is not a silicone of the library; {errors.known_are(name, PRODUCTS)}")
    processes.say(HEAD)
    for name in names or PRODUCTS:
        for silicone in PRODUCTS[name]:
            processes.say(_silicone_line(name, silicone))
            if names:
                processes.say(_origin(silicone))
        if names:
            processes.say(f"  {spread_sentence(name)}")
            processes.say(f"  {_weight(name)}")
            processes.say(f"  {_break(name)}")
    if not names:
        processes.say(f"{PLAIN} source used for the plain name: the median one by tensile stress at stretch "
                   "1.5 (the stiffer of the middle two)")  # fmt: skip
        processes.say("softmodels silicones PRODUCT prints how each source was measured")


def _silicone_line(product: str, silicone: Silicone) -> str:
    stresses = "only in compression"
    if silicone.pulled:
        stresses = (
            ", ".join(f"{stress / 1e3:.4g}" for stress in specimens.nominal_stress(silicone.material, [1.5, 2.0])) + " kPa"
        )
    span = "not published" if silicone.stretches is None else f"{silicone.stretches[0]:g} to {silicone.stretches[1]:g}"
    modulus = f"{silicone.material.shear_modulus_0 / 1e3:.4g} kPa"
    mark = PLAIN if silicone is SILICONES[product] else " "
    return f"{mark} {full_name(product, silicone):42s} {modulus:>10s} {stresses:>26s}   {span:20s}"


def _weight(product: str) -> str:
    sheet = casting_of(product)
    return (
        f"density {sheet.density:g} kg/m^3: {sheet.source}"
        if sheet
        else f"density not published, {SILICONE_DENSITY:g} kg/m^3 assumed"
    )


def _break(product: str) -> str:
    """Return the stretches at break, of which the least is used, and the maker's sheet."""
    words = break_words(SILICONES[product].material) or "stretch at break not published"
    sheet = f"; maker's: {MAKERS_ELONGATION[product][1]}" if product in MAKERS_ELONGATION else ""
    return words + sheet


def _origin(silicone: Silicone) -> str:
    o = silicone.origin
    return "\n".join(f"      {text}" for text in (o.text, f"laboratory: {o.laboratory}", f"test: {o.test}", o.history, o.made))
