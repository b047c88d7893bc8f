"""Options of the commands that read tensile curves."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TypedDict

import click

from geometries.options import QuantityType
from softmodels.common.units import UnitError, brief, number, quantity
from softmodels.fitting.curves.curve import EQUILIBRIUM, Specimen, TensileCurve, TensileError, read_curve
from softmodels.fitting.curves.fit import prepared
from softmodels.fitting.outlines.shapes import OutlineFitError
from softmodels.fitting.problem import (
    BENCH,
    HEIGHTS_FROM,
    USUAL_GAUGE_ERROR,
    Change,
    FitError,
    FitOptions,
    LawChoice,
    Prior,
    all_parameters,
)
from softmodels.materials.specimens import SOFTENING


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


# ----------------------------------------------------------------------------------------------------------------------
# Options of the command ``fit``: parse ``--fix``, ``--bounds``, ``--prior``, ``--free`` and the others.


height_datum_option = click.option(
    "--height-datum", type=click.Choice(HEIGHTS_FROM), default=None,
    help="Zero of the heights if the case has gravity or forces, or a top that is not flat (balloon, bellows): the "
    "upper edge of the shadow at zero pressure, the apex there, or the undeformed top.  [default: the shadow; if the "
    "undeformed top is not flat the apex, which outlines have to name]",
)  # fmt: skip

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
    the weights of its branches and its softening."""
    changes: dict[str, Change] = {}
    remembered = ("share_", *SOFTENING) if options["memory"] else ()
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
