"""What kinds of values there are: how each is read from a text or a table, written, and checked where code gives it.

A field of a dataclass names its kind; from that come its entry in a settings file (`geometries.codec`), its option on a
command line (`geometries.options`) and the sentences about what cannot be meant.
"""

from __future__ import annotations

import abc
import dataclasses
import math
import numbers
from collections.abc import Callable
from typing import ClassVar

from geometries.errors import FieldError
from measurement import wording
from measurement.wording import meant

Text = Callable[[float, str], str]
"""Writes a number of a unit, as `measurement.units.exact_text` does for files and `readable` for people."""
Scalar = str | int | float | bool
Entry = Scalar | list[Scalar]
"""What a settings file holds."""

SHORTEST = 1e-5
"""Shortest length in m: the CAD kernel merges points closer than about 0.1 micrometre."""

LONGEST = 10.0
"""Longest length in m; anything above it is a number typed in another unit."""

LISTED = 4
"""Up to so many whole numbers are listed one by one in messages; of more their least and largest are."""

ROUNDING = 1e-9
"""Share by which a value may pass a bound: 10 um is 9.999999999999999e-06 m."""


def shown(value: object, unit: str) -> str:
    """Return a value as a person would write it, for example ``"20 mm"`` for 0.02 in ``"m"``."""
    if not isinstance(value, int | float):
        return repr(value)
    from measurement.units import readable  # not above: whoever imports the devices need not have pint

    return readable(value, unit)


def _given(value: object) -> str:
    """A value that is refused, for its sentence."""
    from measurement.units import brief  # not above, as in `shown`

    return brief(value)


class Kind(abc.ABC):
    """A kind of value.

    Attributes:
        unit: Of its numbers in Pint's spelling; ``""`` for pure numbers and for what is no number.
        several: Whether it is a tuple of values.
    """

    unit: str = ""
    several: ClassVar[bool] = False

    @abc.abstractmethod
    def settled(self, name: str, value: object) -> object:
        """A value that code gives, as a plain float, int, str, bool or tuple.

        Raises:
            FieldError: It is not of this kind.
        """

    def read(self, name: str, value: object) -> object:
        """A value from a settings file or from the text of an option; see `settled`."""
        return self.settled(name, value)

    def write(self, value: object, text: Text) -> object:
        """A value for a settings file, which `read` takes back."""
        return list(value) if isinstance(value, tuple) else value


@dataclasses.dataclass(frozen=True)
class Quantity(Kind):
    """A number with a unit, or a pure number."""

    unit: str = ""

    def settled(self, name: str, value: object) -> float:
        if isinstance(value, str):
            return Quantity.read(self, name, value)
        if not isinstance(value, numbers.Real) or isinstance(value, bool):
            raise FieldError(f"{name} is {_given(value)}; it must be {self._wanted}")
        try:
            plain = float(value)
        except OverflowError:
            plain = math.inf
        if not math.isfinite(plain):
            raise FieldError(f"{name} is {_given(value)}; it must be a finite number")
        return plain

    @property
    def _wanted(self) -> str:
        if not self.unit:
            return "a number"
        from measurement.units import example

        return f"a number in {self.unit}, or a text with a unit such as '{example(self.unit)}'"

    def read(self, name: str, value: object) -> float:
        from measurement.units import UnitError, brief, quantity

        if isinstance(value, bool) or not isinstance(value, str | int | float):
            raise FieldError(f"{name} is {brief(value)}; it must be a {'text with a unit' if self.unit else 'number'}")
        try:
            return quantity(value, self.unit)
        except UnitError as error:
            raise FieldError(f"{name}: {error}") from None

    def write(self, value: object, text: Text) -> object:
        return text(value, self.unit) if self.unit and isinstance(value, int | float) else value


@dataclasses.dataclass(frozen=True)
class Length(Quantity):
    """A length in m that a device can have; ``zero`` allows the value 0, ``signed`` negative ones."""

    unit: str = "m"
    zero: bool = False
    signed: bool = False

    def settled(self, name: str, value: object) -> float:
        plain = super().settled(name, value)
        size = abs(plain) if self.signed else plain
        if self.zero and size == 0.0:
            return plain
        if size <= 0.0:
            raise FieldError(
                f"{name} is {shown(size, 'm')}; it must be {'0 or more' if self.zero else 'larger than 0'}"
            )
        if size < SHORTEST * (1 - ROUNDING):
            raise FieldError(f"{name} is {size * 1e6:.6g} um; lengths below {SHORTEST * 1e6:g} um cannot be modelled")
        if size > LONGEST * (1 + ROUNDING):
            raise FieldError(f"{name} is {shown(size, 'm')}; above {LONGEST:g} m this looks like a mistaken unit")
        return plain


@dataclasses.dataclass(frozen=True)
class Open(Kind):
    """A quantity that may be left open: None where it follows from something else."""

    of: Quantity
    unit: str = dataclasses.field(init=False, default="")

    def __post_init__(self) -> None:
        object.__setattr__(self, "unit", self.of.unit)

    def settled(self, name: str, value: object) -> float | None:
        return None if value is None else self.of.settled(name, value)

    def read(self, name: str, value: object) -> float | None:
        return None if value is None else self.of.read(name, value)

    def write(self, value: object, text: Text) -> object:
        return None if value is None else self.of.write(value, text)


@dataclasses.dataclass(frozen=True)
class Choice(Kind):
    """One of some values, all of one type."""

    choices: tuple[str | int | float, ...]

    def __post_init__(self) -> None:
        wording.choices(self.choices)

    def settled(self, name: str, value: object) -> str | int | float:
        for known in self.choices:
            if isinstance(value, str | numbers.Real) and value == known and not isinstance(value, bool):
                return known
        if ends := self.ends:
            raise FieldError(f"{name} is {_given(value)}; it must be a whole number from {ends[0]} to {ends[1]}")
        names = [str(known) for known in self.choices]
        more = meant(value, names) if isinstance(value, str) else ""
        raise FieldError(f"{name} is {_given(value)}; it must be one of {', '.join(names)}{more}")

    @property
    def ends(self) -> tuple[int, int] | None:
        """The least and the largest of whole numbers without gaps, if they are more than `LISTED`."""
        whole = [known for known in self.choices if isinstance(known, int)]
        if len(whole) <= LISTED or whole != list(range(whole[0], whole[0] + len(self.choices))):
            return None
        return whole[0], whole[-1]


@dataclasses.dataclass(frozen=True)
class Words(Kind):
    """A text."""

    def settled(self, name: str, value: object) -> str:
        if not isinstance(value, str):
            raise FieldError(f"{name} is {_given(value)}; it must be a text")
        return value


@dataclasses.dataclass(frozen=True)
class Flag(Kind):
    """Yes or no."""

    def settled(self, name: str, value: object) -> bool:
        if not isinstance(value, bool):
            raise FieldError(f"{name} is {_given(value)}; it must be true or false")
        return value


@dataclasses.dataclass(frozen=True)
class Several(Kind):
    """Any number of texts, or of numbers of one kind."""

    of: Quantity | Words
    unit: str = dataclasses.field(init=False, default="")
    several: ClassVar[bool] = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "unit", self.of.unit)

    def settled(self, name: str, value: object) -> tuple[object, ...]:
        if not isinstance(value, str | list | tuple) and hasattr(value, "tolist"):  # an array
            value = value.tolist()
        if not isinstance(value, list | tuple) or not all(isinstance(item, self._wanted) for item in value):
            raise self._refused(name, value)
        if any(isinstance(item, bool) for item in value):
            raise self._refused(name, value)
        if isinstance(self.of, Words):
            return tuple(value)
        return tuple(self.of.settled(f"{name}[{place}]", item) for place, item in enumerate(value, 1))

    def read(self, name: str, value: object) -> object:
        if not self.unit:
            return self.settled(name, value)
        if not isinstance(value, list | tuple):
            raise self._refused(name, value)
        return tuple(self.of.read(f"{name}[{place}]", item) for place, item in enumerate(value, 1))

    def write(self, value: object, text: Text) -> object:
        return [self.of.write(item, text) for item in value] if isinstance(value, tuple) else value

    @property
    def _wanted(self) -> tuple[type, ...]:
        return (str,) if isinstance(self.of, Words) else (numbers.Real, str)

    def _refused(self, name: str, value: object) -> FieldError:
        what = "texts" if isinstance(self.of, Words) else f"numbers in {self.unit}" if self.unit else "numbers"
        return FieldError(f"{name} is {_given(value)}; it must be a list of {what}, such as [...]")
