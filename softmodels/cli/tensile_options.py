"""Options of the commands that read curves."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypedDict

import click

from geometries.options import QuantityType
from measurement.units import UnitError, brief, number
from softmodels.fitting.curves.curve import SYNONYMS, Specimen, TensileCurve, TensileError, read_curve
from softmodels.fitting.curves.fit_curves import prepared


class CurveFiles(TypedDict):
    """What `tensile_option` and `specimen_options` give a command."""

    tensile: tuple[str, ...]
    columns: str
    gauge_length: float | None
    cross_section: float | None


def tensile_option[Command: Callable[..., object]](
    text: str = "Curve of a test, FILE[:TEST], CSV or Excel (.xlsx); may be given several times.",
) -> Callable[[Command], Command]:
    return click.option("--tensile", "tensile", multiple=True, metavar="FILE[:TEST]", help=text)


def specimen_options[Command: Callable[..., object]](command: Command) -> Command:
    """Options for what a curve's file does not say."""
    for flag, unit, text in (
        ("--gauge-length", "m", "Undeformed length, for files with extensions."),
        ("--cross-section", "m^2", "Undeformed cross-section, such as 18mm^2, for files with forces."),
    ):
        command = click.option(flag, type=QuantityType(unit), help=text)(command)
    text = "Columns of the files, if the headers do not say: 'strain=1[%],stress=Load[kPa]'."
    return click.option("--columns", default="", metavar="KIND=COLUMN[UNIT],...", help=text)(command)


def check_curves_given(options: Mapping[str, object]) -> None:
    """Refuse options about curves where there are none.

    Raises:
        TensileError: The first of them.
    """
    if options["tensile"]:
        return
    usual = {"columns": "", "gauge_length": None, "cross_section": None, "stretch": None, "radius": None, "thickness": None,
             "stress_error": "auto", "gauge_error": "auto"}  # fmt: skip
    for name, default in usual.items():
        if options.get(name, default) != default:
            raise TensileError(f"--{name.replace('_', '-')} is about curves; give one with --tensile, or leave it out")


def read_curves(
    files: CurveFiles, radius: float | None, thickness: float | None, stretch: str | None = None
) -> list[TensileCurve]:
    """The curves of ``--tensile``, within ``--stretch``, dense ones averaged (see `thinned`).

    Args:
        files: The curves.
        radius, thickness: Of a balloon, undeformed, in m.
        stretch: Range of stretch, as it is typed; None for all.

    Raises:
        TensileError: A curve cannot be used, or they do not go together.
    """
    if not files["tensile"]:
        raise TensileError("nothing to fit to; give a curve with --tensile FILE")
    specimen = Specimen(files["cross_section"], files["gauge_length"], radius, thickness)
    curves = []
    for text in files["tensile"]:
        name, _, test = text.rpartition(":")
        if not name or (test.lower() not in SYNONYMS and Path(text).exists()):
            name, test = text, "uniaxial"
        curves.append(read_curve(Path(name), test, files["columns"], specimen))
    names = [curve.name for curve in curves]
    if len(set(names)) < len(names):  # files of one name in different folders
        texts = [text if names.count(name) > 1 else name for text, name in zip(files["tensile"], names, strict=True)]
        curves = [dataclasses.replace(curve, name=text) for curve, text in zip(curves, texts, strict=True)]
    return prepared(curves, stretch_range(stretch) if stretch else None)


def stretch_range(text: str) -> tuple[float, float]:
    """Read ``"1.02:6"``."""
    try:
        low, high = (number(part) for part in text.split(":"))
    except UnitError as error:
        raise TensileError(f"stretch {brief(text)} is not a range ({error}); write it like 1.02:3") from None
    except ValueError:
        raise TensileError(f"stretch {brief(text)} is not a range; write it like 1.02:3") from None
    if not 0.0 < low < high < 100.0:
        raise TensileError(f"stretch {text!r}: a range rises, from above 0 to below 100")
    if high <= 1.0 <= low or low == high:
        raise TensileError(f"stretch {text!r} holds nothing but rest")
    return low, high
