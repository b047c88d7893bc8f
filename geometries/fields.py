"""Parameters that know their unit, so that checks, command lines and settings files need no list of their own.

A device declares ``membrane: float = length_field(0.006, "thickness of the membrane")``. The unit, the help text and
the limits travel in the dataclass field's metadata, and `settle` checks every field of every device the same way.
"""

from __future__ import annotations

import dataclasses
import math
import numbers
from typing import Any

from geometries.errors import GeometryError

SHORTEST = 1e-5
"""Shortest length in m: the CAD kernel merges points closer than about 0.1 micrometre."""

LONGEST = 10.0
"""Longest length in m; anything above it is a number typed in another unit."""


ROUNDING = 1e-9
"""Share by which a value may pass a bound: 10 um is 9.999999999999999e-06 m."""


def length_field(default: float, text: str, *, zero: bool = False, signed: bool = False) -> Any:
    """Return a dataclass field for a length in m; ``zero`` allows the value 0, ``signed`` negative ones."""
    return dataclasses.field(default=default, metadata={"unit": "m", "help": text, "zero": zero, "signed": signed})


def angle_field(default: float, text: str, *, unless: tuple[str, str] | None = None) -> Any:
    """Return a dataclass field for an angle in degrees.

    Args:
        default: Its value if not given.
        text: What it is.
        unless: Name and value of another field with which it means nothing.
    """
    return dataclasses.field(default=default, metadata={"unit": "degree", "help": text, "unless": unless})


def number_field(default: float, text: str) -> Any:
    """Return a dataclass field for a pure number."""
    return dataclasses.field(default=default, metadata={"unit": "", "help": text})


def choice_field(default: Any, choices: tuple[Any, ...], text: str) -> Any:
    """Return a dataclass field that takes one of ``choices`` (all of one type)."""
    return dataclasses.field(default=default, metadata={"unit": "", "help": text, "choices": choices})


def text_field(default: str, text: str) -> Any:
    """Return a dataclass field for a text."""
    return dataclasses.field(default=default, metadata={"unit": "", "help": text, "kind": "text"})


def list_field(default: tuple[Any, ...], text: str, *, numbers: bool = False) -> Any:
    """Return a dataclass field for any number of texts, or of pure numbers."""
    kind = "numbers" if numbers else "texts"
    return dataclasses.field(default=default, metadata={"unit": "", "help": text, "kind": kind})


def shown(value: Any, unit: str) -> str:
    """Return a value as a person would write it, for example ``"20 mm"`` for 0.02 in ``"m"``."""
    if not isinstance(value, int | float):
        return repr(value)
    from measurement.units import readable  # not above: whoever imports the devices need not have pint

    return readable(value, unit)


def settle(device: Any) -> None:
    """Turn every field of a frozen dataclass into a plain float, int, str or tuple of them and check what needs no other field.

    Plain types make equal devices compare, print and hash equally whether a caller wrote 45, 45.0 or a NumPy scalar.

    Raises:
        GeometryError: Wrong type, not finite, not one of the choices, or a length out of `SHORTEST`...`LONGEST`.
    """
    for field in dataclasses.fields(device):
        value = getattr(device, field.name)
        settled = _settled(field.name, value, field.metadata)
        object.__setattr__(device, field.name, settled)


def _settled(name: str, value: Any, meta: Any) -> Any:
    unit = meta["unit"]
    if "choices" in meta:
        for known in meta["choices"]:
            if value == known and not isinstance(value, bool):
                return known
        raise GeometryError(f"{name} is {value!r}; it must be one of {', '.join(map(str, meta['choices']))}")
    if meta.get("kind") == "text":
        if not isinstance(value, str):
            raise GeometryError(f"{name} is {value!r}; it must be a text")
        return value
    if "kind" in meta:
        return _settled_list(name, value, meta["kind"])
    if not isinstance(value, numbers.Real) or isinstance(value, bool):
        raise GeometryError(f"{name} is {value!r}; it must be a number{' in ' + unit if unit else ''}")
    plain = float(value)
    if not math.isfinite(plain):
        raise GeometryError(f"{name} is {plain}; it must be a finite number")
    if unit == "m":
        _check_length(name, abs(plain) if meta.get("signed") else plain, meta["zero"])
    return plain


def _settled_list(name: str, value: Any, kind: str) -> tuple[Any, ...]:
    wanted: Any = str if kind == "texts" else numbers.Real
    if not isinstance(value, list | tuple) or not all(
        isinstance(item, wanted) and not isinstance(item, bool) for item in value
    ):
        raise GeometryError(f"{name} is {value!r}; it must be a list of {kind}, such as [...]")
    settled = tuple(item if kind == "texts" else float(item) for item in value)
    if kind == "numbers" and not all(math.isfinite(item) for item in settled):
        raise GeometryError(f"{name} is {value!r}; it must hold finite numbers")
    return settled


def _check_length(name: str, value: float, zero: bool) -> None:
    if zero and value == 0.0:
        return
    if value <= 0.0:
        raise GeometryError(f"{name} is {shown(value, 'm')}; it must be {'0 or more' if zero else 'larger than 0'}")
    if value < SHORTEST * (1 - ROUNDING):
        raise GeometryError(f"{name} is {value * 1e6:.6g} um; lengths below {SHORTEST * 1e6:g} um cannot be modelled")
    if value > LONGEST * (1 + ROUNDING):
        raise GeometryError(f"{name} is {shown(value, 'm')}; above {LONGEST:g} m this looks like a mistaken unit")
