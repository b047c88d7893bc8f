"""Fit laws to outlines, heights or pressures of a device, compare and check them: from measurements to a report."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np

from geometries import Actuator
from measurement.outline import outline
from measurement.outline.outline import Outline
from softmodels.case.case import Case
from softmodels.common import units
from softmodels.common.errors import known_are, spoken
from softmodels.common.lazy import MPI
from softmodels.common.names import checked, one_of, several, wrong
from softmodels.common.processes import one_at_a_time
from softmodels.fitting import comparison, problem
from softmodels.fitting.curves import residuals
from softmodels.fitting.curves.curve import TensileCurve, TensileError
from softmodels.fitting.curves.fit import Curves, loop_notes, loop_objections, prepared
from softmodels.fitting.least_squares import Judgement, LeastSquaresFit, fit_parameters, profile, settled
from softmodels.fitting.outlines import checks, creeping, inflations, views
from softmodels.fitting.outlines.device import DeviceModel, MeasuredDevice
from softmodels.fitting.outlines.inflations import Inflation
from softmodels.fitting.outlines.residuals import (
    Height,
    HeightResiduals,
    OutlineResiduals,
    all_nuisances,
    check_heights,
    is_length,
    least_squares_of_heights,
    length_words,
    read_heights,
    residuals_by_source,
)
from softmodels.fitting.outlines.shapes import OutlineFitError, kept, prepare, read_outlines
from softmodels.fitting.outlines.views import SideView
from softmodels.fitting.problem import FitError, FitOptions
from softmodels.materials import specimens
from softmodels.materials.laws import FORM, SHARE
from softmodels.mechanics import mpi
from softmodels.runs.fields import Fields

OF_COLUMNS = (
    f"heights of a column are {units.COLUMN.unit} ({units.DENSITY_NOTE}), also where photographs were measured by them without "
    "--water-density"
)


@dataclasses.dataclass(frozen=True, eq=False)
class _Task:
    """Devices of one material, laws, and how to fit them."""

    devices: tuple[MeasuredDevice, ...]
    choices: Sequence[problem.LawChoice]
    options: FitOptions
    curves: tuple[TensileCurve, ...]

    @property
    def known(self) -> comparison.Expected:
        return comparison.expected(
            self.options.silicone, next((device.material for device in self.devices if device.material), None)
        )

    def notes(self, more: Sequence[str] = ()) -> list[str]:
        """Return the warnings, and the excluded photographs."""
        left_out = [f"{name} is excluded by --exclude" for name in self.options.exclude]
        named = dict.fromkeys(device.material for device in self.devices if device.material)
        if len(named) > 1 and self.options.silicone is None:
            compared = f"the fit is compared with that of {self.devices[0].name}"
            more = [*more, f"the cases have {len(named)} materials; {compared}"]
        return [*filter(None, (comparison.caution(self.known), *more)), *left_out]

    def changes(self, choice: problem.LawChoice) -> problem.Changes:
        """Return the changes without those of other laws."""
        foreign = problem.all_parameters().keys() - set(choice.names)
        return {name: change for name, change in self.options.changes.items() if name not in foreign}

    def with_outlines(self, outlines: Sequence[Sequence[Outline | SideView]], comm: MPI.Comm) -> comparison.FitReport:
        notes, rows = [*self.notes(), OF_COLUMNS], tuple[tuple[checks.HeightRow, ...], ...]()
        notes += [
            f"{own_match.source} is used in spite of doubts: {'; '.join(own_match.reasons)}"
            for own in outlines for own_match in own if own_match.reasons
        ]  # fmt: skip
        error = residuals.StressError.from_text(self.options.stress_error)
        holds = [
            outline.hold_of(own_match.history)
            for own in outlines
            for own_match in own
            if own_match.history and own_match.pressure > 0.0
        ]
        branches = self._spectrum(holds)
        notes += hold_notes(holds) if branches is None else [branches.sentence]
        # No derivatives by lengths exist for a silicone with a memory.
        free = [name for name in self.options.free if branches is None or name != problem.LENGTHS]
        trials: dict[str, LawTrial[OutlineResiduals]] = {}
        for choice in self.choices:
            devices = []
            for device, own in zip(self.devices, outlines, strict=True):
                model = device.model(choice, comm, branches)
                source, more = source_of(device, model, own, device.name if len(self.devices) > 1 else "")
                notes += [note for note in more if note not in notes]
                devices.append(source)
            sources, extra = residuals.residuals_of(self.curves, choice, error, self.options.gauge_error, spectrum=branches)
            extra = dataclasses.replace(extra, sources=sources)
            trial = try_outlines(devices, free, extra, self.changes(choice), self.options.loss, rows)
            trials[choice.name], rows = trial, trial.rows
        notes += [pair.sentence for pair in comparison.contradictions(self.curves, self.options.gauge_error)]
        robust = ", outliers counted by their size" if self.options.robust else ""
        fitted = [p for p in next(iter(trials.values())).fit.free if not p.hidden]
        lengths = [p for p in fitted if is_length(p)]
        named = {problem.LENGTHS, *(name for p in lengths for name in (p.name, p.own_name))}
        seen = {what: None for source in next(iter(trials.values())).sources for what in (source.what,)}
        of_sides = views.ViewResiduals.what in seen
        said = [*(n for n in free if n not in named and (n != problem.TILT or of_sides)), *map(length_words, lengths)]
        law = "the law" if branches is None else "the law and its memory"
        tests = f"; curves with {self.options.gauge_words.removeprefix(', ')}" if self.curves else ""
        how = (
            f"{', '.join(seen)} and readings, weighted by their stated errors{robust}; free besides {law}: "
            f"{', '.join(said) or 'nothing'}{tests}"
        )
        report = self._report(trials, notes, how)
        # Solve again on all ranks if a profile was evaluated last.
        sources_of = {law: trials[law.choice.name].sources for law in report.laws}
        states = {
            law.choice.name: [match for source in sources for match in source.matches(law.fit.values)]
            for law, sources in sources_of.items()
        }
        return dataclasses.replace(report, photographs=states)

    def _spectrum(self, holds: Sequence[float]) -> residuals.Spectrum | None:
        """Return the branches to fit to photographs with these hold times in s; None without a memory."""
        if not self.options.memory:
            return None
        for name in self.options.free:
            if any(name.rpartition(".")[2] in device.actuator.variable for device in self.devices):
                raise OutlineFitError(f"{name} cannot be fitted together with a memory; measure it, or fit without --memory")
        try:
            return residuals.spectrum(self.curves, holds)
        except TensileError:
            shown = ", ".join(f"{hold:g} s" for hold in sorted(set(holds))) or "none"
            raise OutlineFitError(
                f"photographs show a memory only at two hold times or more, one at least {residuals.SEVERAL_HOLDS:g} times the "
                f"other; here there are {shown} (columns hold and rise of the list of photographs)"
            ) from None

    def with_heights(self, heights: Sequence[Height], comm: MPI.Comm) -> comparison.FitReport:
        trials: dict[str, LawTrial[HeightResiduals]] = {}
        for choice in self.choices:
            model = self.devices[0].model(choice, comm)
            usable = check_heights(heights, model.silhouette.width)
            columns = [(height.height, height.pressure, height.pressure_error, height.height_error) for height in usable]
            rows, _ = checks.series_of(model, [height.source for height in usable], *np.array(columns).T)
            if wrong := checks.by_course(rows):
                raise problem.UnsoundError(wrong.whole)
            source = HeightResiduals(model, usable)
            fit = least_squares_of_heights(source, changes=self.changes(choice), loss=self.options.loss)
            trials[choice.name] = LawTrial((source,), fit, checks.judge_heights(source, fit))
        how = (
            "mean square deviation of the largest deflections at the raw readings, errors from the "
            "scatter and from the bench's priors"
        )
        return self._report(trials, [*self.notes([HEIGHTS_ALONE]), OF_COLUMNS], how)

    def with_inflation(self, inflation: Inflation, comm: MPI.Comm) -> comparison.FitReport:
        trials: dict[str, LawTrial[HeightResiduals]] = {}
        for choice in self.choices:
            source = inflations.InflationResiduals(self.devices[0].model(choice, comm), inflation)
            fit = least_squares_of_heights(source, changes=self.changes(choice), loss=self.options.loss)
            trials[choice.name] = LawTrial((source,), fit, checks.judge_pressures(source, fit))
        how = "pressures at the measured sizes, all with the same weight, errors from the scatter and the bench's priors"
        report = self._report(trials, self.notes([*source.notes, PRESSURES_ALONE]), how)
        return dataclasses.replace(report, inflation=source.matched({law: trial.fit for law, trial in trials.items()}))

    def _report[Source: (OutlineResiduals, HeightResiduals)](
        self, trials: Mapping[str, LawTrial[Source]], notes: Sequence[str], how: str
    ) -> comparison.FitReport:
        compared = comparison.compare([trial.fit for trial in trials.values()])
        laws = [self._law(trials[ranked.fit.label], ranked.fit) for ranked in compared.ranked]
        first: LawTrial[Source] = next(iter(trials.values()))
        devices, notes = [], [*notes]
        for source in first.sources:
            kind = type(source.model.system.body.actuator).__name__
            told = source.model.told(source.own(first.fit.values))
            devices.append(f"{source.device or self.devices[0].name}: {kind}, {source.in_words}")
            of_device = list(source.model.system.mesh_notes) + ([told] if told else [])
            notes += [f"{source.device}: {note}" if source.device else note for note in of_device]
            notes += [exact] if (exact := checks.exact_lengths(source, first.fit)) else []
        report = comparison.FitReport(tuple(laws), compared, self.curves, how, devices=tuple(devices))
        curves = residuals.counted_from(self.curves, report.chosen.fit.values)
        notes += loop_notes(curves, report.chosen.material) if self.options.memory else []
        return dataclasses.replace(report, curves=tuple(curves), notes=tuple(map(spoken, notes)))

    def _law[Source: (OutlineResiduals, HeightResiduals)](
        self, trial: LawTrial[Source], fit: LeastSquaresFit
    ) -> comparison.FittedLaw:
        first = trial.sources[0].model
        choice: problem.LawChoice = first.choice
        stretch = max(_largest_stretch(source, fit) for source in trial.sources)
        strain = 2 * stretch**2 + stretch**-4 - 3  # assuming equibiaxial tension, the upper bound for this stretch
        low, high = residuals.stretches_of(self.curves) or (1.0, stretch)
        over = (min(low, 1.0), max(high, stretch))
        material = dataclasses.replace(first.law(fit.values), fitted_stretch=over)
        judgement = trial.judgement
        if first.spectrum is not None:
            material = residuals.remembering(material, first.spectrum, fit.values)
            of_loops = loop_objections(residuals.counted_from(self.curves, fit.values), material)
            judgement = dataclasses.replace(judgement, objections=judgement.objections + tuple(of_loops))
        judgement = comparison.hold_against(
            material, comparison.stretch_of(strain), self.known, comparison.with_rubber(choice, fit, judgement)
        )
        law = comparison.FittedLaw(
            choice,
            fit,
            material,
            specimens.judge(material, strain),
            {},
            judgement,
            self._misfits(trial, fit),
            fit.problem.form_slopes(fit.values, form := FORM if self.curves else SHARE),
            form,
        )
        wanted = [p.name for p in fit.free if p.name in first.common and self.options.profiles]
        if first.spectrum is not None:  # many states in time: only where the covariance's interval is not above 0
            wanted = [p.name for p in fit.free if p.name in first.spectrum.names and not fit.interval(p.name)[0] > 0.0]
        if not law.sound:
            return law
        return dataclasses.replace(law, profiles={name: profile(fit, name, PROFILE_POINTS) for name in wanted})

    def _misfits[Source: (OutlineResiduals, HeightResiduals)](
        self, trial: LawTrial[Source], fit: LeastSquaresFit
    ) -> tuple[comparison.DeviceMisfit, ...]:
        """Return the misfits; none for heights, whose errors follow from the misfit."""
        sources: list[OutlineResiduals] = []
        for source in trial.sources:
            if isinstance(source, OutlineResiduals):
                sources.append(source)
        parts = residuals_by_source(sources, fit.residuals)
        return tuple(
            comparison.DeviceMisfit(source.device or self.devices[0].name, float((part**2).sum()), len(part))
            for source, part in zip(sources, parts, strict=False)
        )


def source_of(
    device: MeasuredDevice, model: DeviceModel, measured: Sequence[Outline | SideView], name: str = ""
) -> tuple[OutlineResiduals, list[str]]:
    """Return the residuals of a device against what photographs show of it, and a sentence on each that is left out.
    `OutlineFitError` for what cannot be fitted."""
    of_sides = [view for view in measured if isinstance(view, SideView)]
    if of_sides:
        if len(of_sides) < len(measured):
            raise OutlineFitError("a device is fitted to its outlines or to its side views; give the same case twice for both")
        prepared, notes = views.prepare(of_sides, model)
        of_views = views.ViewResiduals if model.spectrum is None else creeping.CreepingViews
        return of_views(model, prepared, device=name), notes
    outlines = [part for part in measured if isinstance(part, Outline)]
    shapes, notes = prepare(outlines, device.actuator, model.silhouette.width)
    kind = OutlineResiduals if model.spectrum is None else creeping.CreepingResiduals
    return kind(model, shapes, device=name), notes


type Device = Actuator | Case | MeasuredDevice
type Measured = Outline | SideView | Inflation
type Outlines = Sequence[Measured | Path | str] | Inflation | Path | str


@checked
@one_at_a_time
def fit(
    device: Device | Sequence[tuple[Device, Outlines]],
    outlines: Outlines = (),
    material: problem.Laws = "yeoh",
    options: FitOptions = problem.DEFAULT_OPTIONS,
    *,
    curves: Curves = (),
    comm: MPI.Comm | None = None,
) -> comparison.FitReport:
    """Fit laws to outlines of one device or of several of one cast at all pressures, optionally with tensile curves.

    With ``options.memory`` the outlines carry times, and relaxing branches are fitted too; the law is then that of equilibrium.

    Several devices have the material in common; errors of the bench and lengths are fitted per device, as ``NAME.leak`` ...:
    ``options.free`` and ``options.changes`` are about all of them, or by such a name about one; ``options.exclude`` takes
    ``NAME/4.jpg``. NAME is that of the case, or the geometry's; a name that two have gets a number (``disk-2``).

    Args:
        device: What was inflated; or pairs of what was inflated and its outlines.
        outlines: Outlines, or the files or folders that a measurement has written; or one table of the device's pressure over
            its volume, radius or rise. Nothing where ``device`` has pairs.
        material: A law's name or class, or several of them; ``"all"`` compares all.
        options: How.
        curves: Tensile curves to fit at the same time, or their files (see `softmodels.fitting.curves.fit.prepared`).
        comm: Processes that solve together; None for all.

    Returns:
        The laws with error bars, best first; ``report.material`` to simulate with; ``report.chosen.devices`` has chi squared.

    Raises:
        FitError: Bad input, or no law could be fitted.
        UnsoundError: The measurements contradict each other.
    """
    _check_how(options, comm)
    pairs = _pairs(device, outlines)
    if (inflation := table_in(pairs, options.exclude)) is not None:
        return _fit_inflation(pairs[0][0], inflation, material, options, bool(curves), comm)
    measured = [
        MeasuredDevice.of(pair_device, views.seen_in(given)).counting_from(options.height_datum) for pair_device, given in pairs
    ]
    _check_seen(measured, options)
    names = device_names([pair_device.name for pair_device in measured])
    task = _Task(
        tuple(dataclasses.replace(pair_device, name=name) for pair_device, name in zip(measured, names, strict=True)),
        problem.law_choices(material, options.poisson),
        options,
        tuple(prepared(several("curves", curves, TensileCurve, "a sm.TensileCurve"), history=options.memory)),
    )
    if len(pairs) == 1:
        outlines_by_device = [outlines_of(pairs[0][1], options.untrusted, options.exclude)]
    else:
        without = _without_by_device(options.exclude, names)
        outlines_by_device = [
            [
                dataclasses.replace(outline, source=f"{name}/{outline.source}")
                for outline in outlines_of(given, options.untrusted, left)
            ]
            for (_, given), name, left in zip(pairs, names, without, strict=True)
        ]
    return task.with_outlines(outlines_by_device, comm or mpi.start())


def _fit_inflation(
    device: Device, inflation: Inflation, material: problem.Laws, options: FitOptions, has_curves: bool, comm: MPI.Comm | None
) -> comparison.FitReport:
    """Fit laws to a table of pressures; `FitError` for what does not go together with it."""
    if has_curves:
        raise FitError(
            "a table of pressures has no errors to weigh tensile curves with; fit the two separately, and compare the laws "
            "with softmodels score"
        )
    if options.memory:
        raise FitError("a table of pressures shows no memory; leave out --memory, or fit outlines or curves")
    if more := [name for name in options.free if name not in problem.FREE]:
        raise FitError(f"{more[0]} does not show in a table of pressures; leave out --free {more[0]}")
    measured = MeasuredDevice.of(device).counting_from(options.height_datum)
    task = _Task((measured,), problem.law_choices(material, options.poisson), options, ())
    return task.with_inflation(inflation, comm or mpi.start())


def _check_seen(measured: Sequence[MeasuredDevice], options: FitOptions) -> None:
    """Raise `FitError` for options that side views do not have."""
    if all(pair_device.seen.counts_heights for pair_device in measured):
        return
    if options.height_datum:
        raise FitError("places of side views count from the device's base; leave out --height-datum")


PROFILE_POINTS = 6
"""Number of values of a parameter in its profile, each a separate fit."""
HEIGHTS_ALONE = (
    "heights cannot separate a leak, an offset or scale of the pressures, a length scale, the zero plane or a thickness of the "
    "device from the silicone: these are not corrected, and the intervals are widened by their priors; outlines determine more"
)

PRESSURES_ALONE = (
    "a table of pressures cannot separate an offset, a scale or a leak of the pressures, a scale of the sizes or a thickness "
    "of the device from the silicone: these are not corrected, and the intervals are widened by their priors"
)


def _pairs(device: object, outlines: Outlines) -> list[tuple[Device, Outlines]]:
    """Return the devices, each with its outlines; `FitError` for pairs that are none, or outlines beside them."""
    if not isinstance(device, Sequence) or isinstance(device, str):
        return [(device, outlines)]  # type: ignore[list-item]
    if not device or not all(isinstance(part, Sequence) and not isinstance(part, str) and len(part) == 2 for part in device):
        raise FitError(
            "several devices are given as pairs of a device and its outlines, such as [(disk, 'outlines_a'), (membrane, "
            "'outlines_b')]"
        )
    if not isinstance(outlines, Sequence) or len(outlines):
        raise FitError("with several devices, give pairs of device and outlines, and leave out the argument outlines")
    return [(device_model, given) for device_model, given in device]


def table_in(pairs: Sequence[tuple[Device, Outlines]], exclude: Sequence[str] = (), columns: str = "") -> Inflation | None:
    """Return the table of pressures over sizes among what was measured, read; None if there is none. `OutlineFitError` if there
    is more."""
    given = [part for _, own in pairs for part in (own if isinstance(own, Sequence) and not isinstance(own, str) else [own])]
    tables = [part for part in given if inflations.is_table(part)]
    if not tables:
        return None
    if len(given) > 1 or len(pairs) > 1:
        name = tables[0].name if isinstance(tables[0], Inflation) else tables[0]
        raise OutlineFitError(
            f"{name} is a table of a device's pressures, which has no errors to weigh other measurements with; fit each table "
            "by itself"
        )
    return tables[0] if isinstance(tables[0], Inflation) else inflations.read(Path(tables[0]), columns, exclude)


def outlines_of(given: Outlines, untrusted: bool, exclude: Sequence[str] = ()) -> Sequence[Outline | SideView]:
    """Return the outlines or side views that are not excluded, those of files and folders after the others."""
    outlines = several("outlines", given, (Outline, SideView, Path, str), "an outline, or a file or folder of outlines")
    usable = [outline for outline in outlines if not isinstance(outline, Path | str)]
    files = [Path(outline) for outline in outlines if isinstance(outline, Path | str)]
    if of_sides := [file for file in files if views.is_table(file)]:
        if len(of_sides) < len(files):
            raise OutlineFitError("a device is fitted to its outlines or to its side views; give the same case twice for both")
        return [*usable, *(view for file in of_sides for view in views.read_views(file, untrusted, exclude))]
    if files or not usable:
        return [*usable, *read_outlines(files, untrusted, exclude)]
    return [usable[i] for i in kept([(outline.source, None) for outline in usable], exclude)]


def device_names(names: Sequence[str]) -> list[str]:
    """Return the names of several devices, numbered if two have the same."""
    device_names: list[str] = []
    for name in names:
        number, numbered = 1, name
        while numbered in device_names:
            number += 1
            numbered = f"{name}-{number}"
        device_names.append(numbered)
    return device_names


def _without_by_device(exclude: Sequence[str], names: Sequence[str]) -> list[list[str]]:
    """Return the names of photographs to exclude, by device; `OutlineFitError` for one that does not begin with a device's."""
    for text in exclude:
        if not any(text.startswith(f"{name}/") for name in names):
            raise OutlineFitError(
                f"--exclude {text}: with several devices, give the photograph's device too, such as {names[0]}/{text}; the "
                f"devices are {', '.join(names)}"
            )
    return [[text.removeprefix(f"{name}/") for text in exclude if text.startswith(f"{name}/")] for name in names]


@checked
@one_at_a_time
def fit_heights(
    device: Actuator | Case | MeasuredDevice,
    heights: Sequence[Height] | Path | str,
    material: problem.Laws = "yeoh",
    options: FitOptions = problem.DEFAULT_OPTIONS,
    *,
    comm: MPI.Comm | None = None,
) -> comparison.FitReport:
    """Fit laws to the largest deflections of a device, as the thesis did; see `fit`, whose arguments it takes.

    Args:
        device: What was inflated.
        heights: Heights, or the table ``heights.csv`` that a measurement has written.
        material: See `fit`.
        options: See `fit`.
        comm: See `fit`.

    Raises:
        FitError: Bad input, or no law could be fitted.
        UnsoundError: The measurements contradict each other.
    """
    _check_how(options, comm)
    if options.memory:
        raise FitError("heights carry no times, so they show no memory; fit outlines or curves, or leave out --memory")
    if isinstance(heights, Path | str):
        heights = read_heights(Path(heights), options.untrusted, options.exclude)
    heights = several("heights", heights, Height, "a height, or the table heights.csv")
    task = _Task(
        (MeasuredDevice.of(device).counting_from(options.height_datum),),
        problem.law_choices(material, options.poisson),
        options,
        (),
    )
    return task.with_heights(heights, comm or mpi.start())


def _check_how(options: object, comm: object) -> None:
    """Raise `ArgumentError` for invalid options or communicator, `FitError` for options of curves only."""
    one_of("options", options, FitOptions, "how to fit, such as sm.FitOptions(poisson=0.49)")
    if isinstance(options, FitOptions) and options.branches:
        raise FitError("relaxation times are not fitted to photographs; leave out branches, or fit curves only")
    if comm is not None and not callable(getattr(comm, "allreduce", None)):
        raise wrong("comm", comm, "a communicator of MPI, or None for all processes")


def hold_notes(holds: Sequence[float]) -> list[str]:
    """Return for which times a law without a memory holds, by the hold times in s of its photographs."""
    if not holds:
        return []
    low, high = min(holds), max(holds)
    if high < residuals.SEVERAL_HOLDS * max(low, 1e-300):
        times = f"{low:.3g} s" if high <= 1.01 * low else f"{low:.3g} to {high:.3g} s"
        return [f"the photographs were taken after holds of {times}: the law is that of such times"]
    return [
        f"the holds before the photographs differ, from {low:.3g} to {high:.3g} s, and a law without a memory mixes them: "
        "--memory fits how the silicone creeps"
    ]


def _largest_stretch(source: OutlineResiduals | HeightResiduals, fit: LeastSquaresFit) -> float:
    """Return the largest principal stretch of the device in the state of the largest deflection."""
    state = source.largest_state(fit.values)
    source.model.set_parameters(source.own(fit.values))
    return float(Fields(source.model.solver).figures(state).max_stretch)


# ----------------------------------------------------------------------------------------------------------------------
# The fit of one law to outlines, from starts in closed form.


STARTING_SHARE = 0.1
"""Of each branch."""


def fit_law_to_outlines(
    *sources: OutlineResiduals,
    free: Sequence[str] = problem.FREE,
    extra: problem.Extra = problem.NOTHING_ELSE,
    changes: problem.Changes = MappingProxyType({}),
    loss: str = "linear",
    doubted: Collection[str] = (),
) -> LeastSquaresFit:
    """Fit a law to devices of one material, each with its outlines, from starts in closed form.

    Args:
        free: What is free beside the law, see `nuisances`.
        extra: Further sources that depend on the law's parameters, such as tensile curves.
        changes: Fields of parameters to replace; what every device has is so for all, or by its full name for one.
        loss: See `softmodels.fitting.least_squares.fit_parameters`.
        doubted: Names of photographs whose pressures do not count where the fit starts.

    Raises:
        FitError: See `softmodels.fitting.least_squares.fit_parameters`; or a change names no parameter.
        OutlineFitError: The device cannot be the one in the photographs.
    """
    choice, spectrum = sources[0].model.choice, sources[0].model.spectrum
    weights = dict.fromkeys(spectrum.names, STARTING_SHARE) if spectrum else {}
    known = all_nuisances(sources, free)
    names = {*choice.names, *weights, *(name for p in (*known, *extra.parameters) for name in (p.name, p.own_name))}
    for name in changes:
        if name not in names:
            raise FitError(f"there is no parameter {name!r}; {known_are(name, sorted(names))}")
    held = {
        name: change["start"]
        for name, change in changes.items()
        if change.get("fixed") and "start" in change and name in choice.names
    }
    begins: list[dict[str, float]] = []
    hidden: list[problem.Parameter] = []
    for source in sources:
        more, plain = source.starts(held, doubted)
        begins += more
        hidden += source.hidden_parameters(plain.volumes, plain.hangs)
    troubles = []
    stiffer = 1.0 + sum(weights.values()) / 2  # the photographs show what has not relaxed too
    for begin in begins:
        law = {n: v / stiffer if choice.unit(n) == "Pa" and n not in held else v for n, v in begin.items()}
        silicone = [*choice.parameters(law), *(spectrum.parameters(weights) if spectrum else ())]
        stated = (*silicone, *known, *extra.parameters)
        parameters = [*(p.changed({**changes.get(p.own_name, {}), **changes.get(p.name, {})}) for p in stated), *hidden]
        for source in sources:
            source.fixed = frozenset(p.name for p in parameters if p.fixed)
        try:
            return settled(fit_parameters([*sources, *extra.sources], parameters, loss=loss, label=choice.name))
        except FitError as error:
            troubles.append(str(error))
    raise FitError(f"{choice.name}: {troubles[0]}")


# ----------------------------------------------------------------------------------------------------------------------
# Fit one law to a device's outlines or heights, and check its acceptance.


@dataclasses.dataclass(frozen=True, eq=False)
class LawTrial[Source: (OutlineResiduals, HeightResiduals)]:
    """A law's fit to sources, one for each device, what speaks against it, and, of outlines, the series of pressures over
    heights."""

    sources: tuple[Source, ...]
    fit: LeastSquaresFit
    judgement: Judgement
    rows: tuple[tuple[checks.HeightRow, ...], ...] = ()


def try_outlines(
    sources: Sequence[OutlineResiduals],
    free: Sequence[str],
    extra: problem.Extra = problem.NOTHING_ELSE,
    changes: problem.Changes = MappingProxyType({}),
    loss: str = "linear",
    rows: Sequence[Sequence[checks.HeightRow]] = (),
) -> LawTrial[OutlineResiduals]:
    """Fit a law to all outlines as `fit_law_to_outlines`, and search for contradicting ones if the fit is beyond chance. With
    the series of another law's trial, all laws are fitted to the same photographs.

    Raises:
        UnsoundError: The outlines are of another device; or the fit fails, and a photograph contradicts the others.
        FitError: The fit fails.
    """
    all_nuisances(sources, free)  # unknown names, before anything is solved
    series = tuple(
        tuple(heights)
        for heights in rows
        or [
            checks.series_of_shapes(source.model, source.shapes) if source.model.silhouette.counts_heights else ()
            for source in sources
        ]
    )
    if sources[0].model.spectrum is not None:  # at one pressure the heights differ with the time
        series = ((),) * len(sources)
    wrong = [wrong_of_device for wrong_of_device in map(checks.by_course, series) if wrong_of_device]
    doubted = [name for wrong_of_device in wrong for name in wrong_of_device.names]
    said = "; ".join(wrong_of_device.whole for wrong_of_device in wrong)

    def fitted(without: Sequence[str] = (), doubted: Sequence[str] = ()) -> tuple[list[OutlineResiduals], LeastSquaresFit]:
        chosen = []
        for source in sources:
            shapes = [shape for shape in source.shapes if shape.source not in without]
            if shapes:
                chosen.append(type(source)(source.model, shapes, device=source.device))
        fit = fit_law_to_outlines(*chosen, free=free, extra=extra, changes=changes, loss=loss, doubted=doubted)
        return chosen, fit

    def good(without: Sequence[str]) -> bool:
        try:
            return checks.within_chance(*fitted(without))
        except (FitError, problem.CannotEvaluate):
            return False

    try:
        if any(
            wrong_of_device.gross for wrong_of_device in wrong
        ):  # a fit distorted by such a row takes a minute and is meaningless
            chosen, fit = fitted(doubted)
            return LawTrial(tuple(chosen), fit, Judgement((f"{said} (the reported numbers are of such a fit)",)), series)
        chosen, fit = fitted((), doubted)
    except FitError as error:
        if wrong:
            raise problem.UnsoundError(f"{said} (with all photographs: {error})") from None
        raise
    return LawTrial(tuple(chosen), fit, checks.judge_outlines(chosen, fit, series, good), series)
