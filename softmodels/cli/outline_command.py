"""The command ``fit`` with a case: outlines or heights of a device, alone or together with tensile curves."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from measurement.units import UnitError, quantity
from softmodels.case.case import Case, CaseError
from softmodels.fitting.believable import caution, expected, hold_against, stretch_of
from softmodels.fitting.comparison import compare
from softmodels.fitting.curves.contradiction import contradictions
from softmodels.fitting.curves.curve import TensileCurve
from softmodels.fitting.curves.fit import residuals_of
from softmodels.fitting.law_parameters import LawChoice, all_parameters
from softmodels.fitting.outlines.data import OutlineFitError, Shape, prepare, read_outlines
from softmodels.fitting.outlines.device import device_of
from softmodels.fitting.outlines.fit import BENCH, Bench, Fitting, OutlineResiduals
from softmodels.fitting.outlines.heights import check_heights, read_heights
from softmodels.fitting.outlines.pressure_course import Row
from softmodels.fitting.outlines.trials import Trial, try_heights, try_outlines
from softmodels.fitting.problem import FitError
from softmodels.fitting.result import Fit
from softmodels.fitting.tables import Fitted, Report
from softmodels.materials.stability import judge
from softmodels.mechanics.mpi import abort_on_error, start

PROFILE_POINTS = 6
"""Values at which a parameter is held for its profile: each is a fit of its own."""
HEIGHTS_ALONE = (
    "heights alone cannot tell a leak, an offset or a unit of the pressures, a unit of length or the zero plane from the "
    "silicone: nothing of it is corrected, and the intervals are widened by what is believable of each; whole outlines see more"
)
UNITS = {"pressure_offset": "Pa", "zero": "m", "centre": "m"}
"""Units of what is not a plain number; lengths of the device have m."""


@dataclasses.dataclass(frozen=True, eq=False)
class DeviceReport(Report):
    """A report of fits to a device.

    Attributes:
        device: The device in words.
        notes: What was left out, and why.
        fittings: By law: each photograph with its fitted state; empty for heights.
    """

    device: str = ""
    notes: tuple[str, ...] = ()
    fittings: Mapping[str, list[Fitting]] = dataclasses.field(default_factory=dict)

    @property
    def ranges(self) -> list[str]:
        return [self.device, *self.notes, *super().ranges]

    def own_pictures(self) -> dict[str, Any]:
        from softmodels.pictures.outline_pictures import draw_outlines, draw_photographs

        figures = {}
        for one in self.laws:
            law, fittings = one.choice.name, self.fittings.get(one.choice.name)
            if fittings:
                figures[f"outlines-{law}.png"] = draw_outlines(fittings, law)
                figures[f"photographs-{law}.png"] = draw_photographs(fittings, law)
        return figures


def device_report(
    options: dict[str, Any], curves: Sequence[TensileCurve], choices: Sequence[LawChoice]
) -> DeviceReport:
    """Fit laws to a case's outlines or heights.

    Args:
        options: Of the command.
        curves: Tensile curves to fit at the same time.
        choices: The laws.

    Raises:
        FitError: Bad input, or no law could be fitted.
        UnsoundError: The measurements contradict each other.
    """
    case, outlines, heights = _read(options)
    known = expected(options["silicone"], case.material)
    changes = device_changes(options, (*BENCH, "poisson", *case.actuator.variable))
    comm = start()
    abort_on_error(comm)
    notes = [text for text in (caution(known), HEIGHTS_ALONE if outlines is None else "") if text]
    notes += [f"{name} is left out, as --without says" for name in options["without"]]
    against = [pair.sentence for pair in contradictions(curves, options["gauge"])]
    trials: dict[str, Trial] = {}
    rows: tuple[Row, ...] = ()
    for choice in choices:
        device = device_of(case, choice, comm)
        loss = "soft_l1" if options["robust"] else "linear"
        mine = {
            name: change for name, change in changes.items() if name not in all_parameters() or name in choice.names
        }
        if outlines is not None:
            shapes, more = prepare(outlines, case.actuator, device.silhouette.width)
            notes += [note for note in more if note not in notes]
            others = residuals_of(curves, choice, options["stress"], options["gauge"])
            trials[choice.name] = try_outlines(device, shapes, bench(options), others, mine, loss, rows)
            rows = trials[choice.name].rows
        else:
            assert heights is not None
            trials[choice.name] = try_heights(device, check_heights(heights, device.silhouette.width), mine, loss)
    comparison = compare([trial.fit for trial in trials.values()])
    laws = []
    for ranked in comparison.ranked:
        trial = trials[ranked.fit.label]
        choice, strain = trial.source.inflation.choice, _strain(trial.source, trial.fit)
        material = trial.source.inflation.material(ranked.fit.values)
        judgement = hold_against(material, stretch_of(strain), known, trial.judgement)
        one = Fitted(choice, ranked.fit, material, judge(material, strain), {}, judgement)
        wanted = [p.name for p in ranked.fit.free if p.name in (*choice.names, "poisson")]
        if one.sound and not options["no_profiles"]:
            profiles = {name: ranked.fit.profile(name, PROFILE_POINTS) for name in wanted}
            one = dataclasses.replace(one, profiles=profiles)
        laws.append(one)
    sources = {name: trial.source for name, trial in trials.items()}
    device_text = f"{case.name}: {type(case.actuator).__name__}, {_measured(outlines, sources)}"
    # Solved again where a profile was the last to be asked for, by all ranks together.
    fittings = {
        one.choice.name: sources[one.choice.name].fittings(one.fit.values) for one in laws if outlines is not None
    }
    how = _how(options, outlines is not None)
    return DeviceReport(
        tuple(laws), comparison, tuple(curves), how, device=device_text, notes=(*notes, *against), fittings=fittings
    )


def _read(options: dict[str, Any]) -> tuple[Case, Any, Any]:
    """The case, its outlines or None, its heights or None."""
    file, *files = options["files"]
    try:
        case = Case.from_file(file)
    except CaseError as error:
        raise FitError(str(error)) from None
    case = dataclasses.replace(case, actuator=as_section(case.actuator))
    bench(options)
    if options["heights"] is not None:
        if files:
            raise OutlineFitError("fit either whole outlines or --heights: one would count the other twice")
        if options["tensile"]:
            raise OutlineFitError(
                "heights alone have no errors to weigh tensile curves with; give outlines, or fit them apart"
            )
        return case, None, read_heights(options["heights"], options["untrusted"], options["without"])
    if not files:
        raise OutlineFitError(f"{file} says what was inflated; give its outlines too, or --heights heights.csv")
    return case, read_outlines(files, options["untrusted"], options["without"]), None


def as_section(actuator: Any) -> Any:
    """A device that turns about its axis as its section, which gives the same outline in a hundredth of the time."""
    fields = {field.name: field.metadata.get("choices", ()) for field in dataclasses.fields(actuator)}
    if "axisymmetric" in fields.get("section", ()) and actuator.section != "axisymmetric":
        return dataclasses.replace(actuator, section="axisymmetric")
    return actuator


def bench(options: dict[str, Any]) -> Bench:
    """What is free of bench and device: the defaults, ``--free`` more, ``--fix`` less.

    Raises:
        OutlineFitError: A parameter is to be both.
    """
    fixed = {text.partition("=")[0].strip() for text in options["fixes"]}
    for name in options["free"]:
        if name in fixed:
            raise OutlineFitError(f"{name} cannot be both free (--free) and fixed (--fix)")
    return Bench(tuple(dict.fromkeys(name for name in (*BENCH, *options["free"]) if name not in fixed)))


def device_changes(options: dict[str, Any], known: Sequence[str]) -> dict[str, dict[str, Any]]:
    """What ``--fix``, ``--bounds`` and ``--prior`` say, by parameter; ``--fix leak`` alone keeps it at its nominal value.

    Raises:
        FitError: A text that is no such change, or a name that nothing has.
    """
    from softmodels.cli.fit_command import read_bounds, read_prior

    lengths = set(known) - set(BENCH) - {"poisson"}
    stresses = {name for name, unit in all_parameters().items() if unit == "Pa"}
    changes: dict[str, dict[str, Any]] = {}
    for key, read in (("fixes", None), ("bounds", read_bounds), ("priors", read_prior)):
        for text in options[key]:
            name, found, value = (part.strip() for part in text.partition("="))
            if name not in (*known, *all_parameters()) and not name.startswith("gauge"):
                raise FitError(f"there is no parameter {name!r}; the bench and the device have {', '.join(known)}")
            unit = "m" if name in lengths else "Pa" if name in stresses else UNITS.get(name, "")
            try:
                change: dict[str, Any] = {"fixed": True} if read is None else dict(read(value, unit))
                if read is None and found:
                    change["start"] = quantity(value, unit)
            except (UnitError, FitError) as error:
                raise FitError(f"{text!r}: {error}") from None
            changes.setdefault(name, {}).update(change)
    return changes


def _strain(source: Any, fit: Fit) -> float:
    """Largest I1 - 3 of the device in the state of the largest deflection."""
    from softmodels.results.fields import Fields

    device = source.inflation
    if isinstance(source, OutlineResiduals):
        state = max((fitting.state for fitting in source.fittings(fit.values)), key=lambda state: state.V)
    else:
        state = device.states(fit.values, source.pressures, "pressure")[-1]
    device.take(fit.values)
    stretch = Fields(device.equilibrium).figures(state).max_stretch
    return 2 * stretch**2 + stretch**-4 - 3  # as if equibiaxial, which is the most that this stretch can mean


def _measured(outlines: Any, sources: dict[str, Any]) -> str:
    source = next(iter(sources.values()))
    if outlines is None:
        top = float(source.measured.max())
        return f"{len(source.heights)} heights to {top * 1e3:.4g} mm at {source.pressures[-1] / 1e3:.4g} kPa"
    shapes: tuple[Shape, ...] = source.shapes
    top = max(shape.height for shape in shapes)
    values = f"{source.count - len(shapes)} independent values"
    return f"{len(shapes)} outlines to {top * 1e3:.4g} mm at {source.most / 1e3:.4g} kPa, {values}"


def _how(options: dict[str, Any], whole: bool) -> str:
    if not whole:
        return (
            "mean square deviation of the largest deflections at the readings as they are, errors from the scatter and from "
            "what the bench may get wrong"
        )
    robust = ", outliers counted by their size" if options["robust"] else ""
    free = ", ".join(bench(options).free)
    return f"whole outlines and readings, each by its stated error{robust}; free beside the law: {free or 'nothing'}"
