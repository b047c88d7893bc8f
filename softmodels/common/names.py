"""Names: arguments of calls checked, classes registered by name, public names loaded when they are first used.

Every package here begins with this, so it imports the standard library alone: Ctrl-C while the rest is imported ends with a
sentence, see `softmodels.common.commands.stoppable`.
"""

from __future__ import annotations

import ast
import functools
import importlib
import inspect
import operator
import re
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, MutableMapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, cast

from softmodels.common import errors, units

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt


_OWN_FILES = tuple(str(Path(__file__).parents[2] / package) for package in errors.OWN_PACKAGES)
"""Files of the project: a warning names the line that called into them."""


class ArgumentError(errors.OptionMessage, TypeError):
    """An argument that a function or a class does not take; the message is for the user."""


class ImplausibleWarning(UserWarning):
    """A possible number that seems to be in another unit; the message is for the user."""


def checked[T](thing: T) -> T:
    """Make a function or constructor reject unknown, missing or too many arguments by an `ArgumentError`; a decorator."""
    if not isinstance(thing, type):
        return cast("T", _checked(cast("Callable[..., object]", thing), cast("Any", thing).__name__))
    if "__init__" in vars(thing):
        thing.__init__ = _checked(thing.__init__, thing.__name__)  # type: ignore[misc]
    return thing


def _checked(function: Callable[..., Any], name: str) -> Callable[..., Any]:
    @functools.wraps(function)
    def call(*args: object, **kwargs: object) -> object:
        _check_arguments(name, function, args, kwargs)
        return function(*args, **kwargs)

    return call


@functools.cache
def _signature(function: Callable[..., object]) -> inspect.Signature:
    return inspect.signature(function)


def _check_arguments(name: str, function: Callable[..., object], args: Sequence[object], kwargs: dict[str, object]) -> None:
    """Raise `ArgumentError` where arguments do not fit a function; of a method the first one is not spoken of."""
    signature = _signature(function)
    try:
        signature.bind(*args, **kwargs)
    except TypeError:
        if next(iter(signature.parameters), "") in ("self", "cls"):
            signature = signature.replace(parameters=[*signature.parameters.values()][1:])
            args = args[1:]
        raise ArgumentError(_reason_against(name, signature, args, kwargs)) from None


MAX_NAME_BYTES = 200
"""Bytes of the name of results: names of files have up to 255 on most systems, and results add endings."""


def unusable_name(name: object) -> str:
    """Return why results cannot have a name, which is that of their files and their default folder; empty if they can."""
    if not isinstance(name, str) or not re.fullmatch(r"\w[\w.+-]*", name):
        return f"name {units.brief(name)} is not a valid file name; use letters, digits, '_', '-', '+' and '.'"
    if (size := len(name.encode())) > MAX_NAME_BYTES:
        return f"name {units.brief(name)} has {size} bytes, and names of results at most {MAX_NAME_BYTES}; shorten it"
    return ""


def doubt(text: str) -> None:
    """Warn of an implausible number at the user's line."""
    warnings.warn(errors.spoken(text), ImplausibleWarning, skip_file_prefixes=_OWN_FILES)


def _reason_against(name: str, signature: inspect.Signature, args: Sequence[object], kwargs: dict[str, object]) -> str:
    """Return why arguments do not fit a signature."""
    kinds = inspect.Parameter
    known = [p for p in signature.parameters.values() if p.kind not in (kinds.VAR_POSITIONAL, kinds.VAR_KEYWORD)]
    by_place = [p.name for p in known if p.kind in (kinds.POSITIONAL_ONLY, kinds.POSITIONAL_OR_KEYWORD)]
    for key in kwargs:
        if key not in signature.parameters:
            return f"{name} has no argument {key!r}; {errors.known_are(key, [p.name for p in known])}"
    if len(args) > len(by_place):
        named = [p.name for p in known if p.kind is kinds.KEYWORD_ONLY]
        order = f"{', '.join(by_place)} in this order" if by_place else "none without its name"
        more = f", and by name {', '.join(named)}" if named else ""
        given = f"{len(args)} arguments without names" if len(args) > 1 else "1 argument without a name"
        return f"{name} is given {given} and takes {order}{more}"
    twice = [key for key in by_place[: len(args)] if key in kwargs]
    if twice:
        return f"{name} is given {twice[0]} twice, by its place and by its name"
    there = {*kwargs, *by_place[: len(args)]}
    missing = [p.name for p in known if p.default is kinds.empty and p.name not in there]
    return f"{name} needs {' and '.join(missing)}; give {'it' if len(missing) == 1 else 'them'}"


def wrong(name: str, value: object, wanted: str) -> ArgumentError:
    """Return what is raised for an argument of another kind than is wanted, such as ``"a device, such as sm.HollowDisk()"``."""
    hint = f"; write {value.__name__}(...), with its arguments" if isinstance(value, type) else ""
    return ArgumentError(f"{name} is {units.brief(value)}; it must be {wanted}{hint}")


def one_of(name: str, value: object, kinds: type | tuple[type, ...], wanted: str) -> Any:
    """Return a value that has to be of some classes; else `ArgumentError`."""
    if not isinstance(value, kinds):
        raise wrong(name, value, wanted)
    return value


def flag(name: str, value: object) -> bool:
    """True or False; `ArgumentError` for anything else."""
    return bool(one_of(name, value, bool, "True or False"))


def place(name: str, value: object, what: str = "a file or folder") -> Path:
    """Return a path from its text; `ArgumentError` for what is none."""
    path = one_of(name, value, (str, Path), f"the name of {what}")
    if not str(path) or "\0" in str(path):
        raise wrong(name, value, f"the name of {what}")
    return Path(path)


def callback(name: str, value: object, or_flag: bool = False) -> None:
    """Reject, with `ArgumentError`, what is neither a function nor None; ``or_flag`` allows True and False too."""
    if not (value is None or callable(value) or (or_flag and isinstance(value, bool))) or isinstance(value, type):
        raise wrong(name, value, "True, False or a function" if or_flag else "a function")


def several(name: str, value: object, kinds: type | tuple[type, ...], wanted: str) -> tuple[Any, ...]:
    """Return a tuple of values of some classes, from one of them or from any number; else `ArgumentError`."""
    if isinstance(value, kinds):
        return (value,)
    if isinstance(value, str | bytes | dict) or not isinstance(value, Iterable):
        raise wrong(name, value, f"{wanted}, or a list of such")
    return tuple(one_of(f"{name}[{number}]", entry_given, kinds, wanted) for number, entry_given in enumerate(value))


def span(name: str, value: object) -> tuple[float, float] | None:
    """Return two pure numbers, the first below the second, or None for None; else `ArgumentError`."""
    if value is None:
        return None
    wanted = "two numbers, from and to, such as (1.0, 2.5)"
    try:
        ends = units.plain(value)
        if not isinstance(ends, list | tuple) or len(ends) != 2:
            raise wrong(name, value, wanted)
        low, high = units.numbers(ends)
    except units.UnitError as error:
        raise ArgumentError(f"{name}: {error}; it must be {wanted}") from None
    if not low < high:
        raise ArgumentError(f"{name} goes from {low:g} to {high:g}; give the smaller number first")
    return low, high


def whole(name: str, value: object, least: int) -> int:
    """Return a whole number that is no smaller than another; `ArgumentError` for anything else."""
    try:
        count = units.plain(value)
    except units.UnitError:
        count = None
    if isinstance(count, bool) or not isinstance(count, int) or count < least:
        raise wrong(name, value, f"a whole number from {least} up")
    return count


def spelling(name: str) -> str:
    """Return a name without what people write in different ways: large letters, separators, zeros before a number."""
    return "".join(part.lstrip("0") for part in re.findall(r"[^\W\d_]+|\d+", name.lower()))


# ----------------------------------------------------------------------------------------------------------------------
# Read-only arrays of results.


def read_only[Kind: np.generic](array: npt.NDArray[Kind]) -> npt.NDArray[Kind]:
    """Return a read-only view; ``array.copy()`` is the caller's own."""
    view = array.view()
    view.flags.writeable = False
    return view


def keep_arrays(value: object) -> None:
    """Make every array that an object holds, of a frozen dataclass too, read-only at the end of its making."""
    import numpy as np

    for name, array in list(vars(value).items()):
        if isinstance(array, np.ndarray):
            object.__setattr__(value, name, read_only(array))


# ----------------------------------------------------------------------------------------------------------------------
# What users add to by name: laws, devices, components, supplies, quantities of designs, outputs of runs, checks.
#
# Entries are classes, and objects of `softmodels.runs.table.Output`. A registry has a function that registers, such as
# ``register_law = LAWS.register``, for classes a decorator; a quantity is registered by the name in its class statement. An
# entry of the same module and name, as a notebook defines it anew, takes the place of the one before.


class Registry[T](MutableMapping[str, T]):
    """Entries of one kind (``what``, for messages) by the name that ``name`` gives. ``places`` are the library's own modules
    by name, imported when an entry is looked up; ``made_known`` is called with each that is registered."""

    def __init__(
        self,
        what: str,
        name: Callable[[T], str] = operator.attrgetter("__name__"),
        places: Mapping[str, str] = MappingProxyType({}),
        made_known: Callable[[T], None] = lambda entry: None,
    ) -> None:
        self._what, self._name, self._places, self._made_known = what, name, places, made_known
        self.loaded: dict[str, T] = {}

    def register[C](self, entry: C) -> C:
        """Let case files, command lines and runs find an entry by its name; a decorator of a class. `ValueError` if
        another one has this name."""
        name = self._name(entry)  # type: ignore[arg-type]
        place = _place_of(entry, name)
        known = _place_of(self.loaded[name], name) if name in self.loaded else (self._places.get(name, place[0]), place[1])
        if place != known:
            raise ValueError(f"the name {name!r} is taken by another {self._what}, in {known[0]}")
        self.loaded[name] = checked(entry) if isinstance(entry, type) else entry  # type: ignore[assignment]
        self._made_known(entry)  # type: ignore[arg-type]
        return entry

    def put_first(self, entries: Iterable[T]) -> None:
        """Put registered entries before all others, in this order, whatever was imported first."""
        self.loaded = {self._name(entry): entry for entry in entries} | self.loaded

    def __getitem__(self, name: str) -> T:
        if name not in self.loaded and name in self._places:
            importlib.import_module(self._places[name])
        return self.loaded[name]

    def __setitem__(self, name: str, entry: T) -> None:
        self.loaded[name] = entry

    def __delitem__(self, name: str) -> None:
        del self.loaded[name]

    def __iter__(self) -> Iterator[str]:
        yield from self._places
        yield from (name for name in list(self.loaded) if name not in self._places)

    def __contains__(self, name: object) -> bool:
        return name in self._places or name in self.loaded

    def __len__(self) -> int:
        return len(self._places.keys() | self.loaded.keys())


def _place_of(entry: object, name: str) -> tuple[str, str]:
    """Return the module of an entry, and the name that it has there."""
    return entry.__module__, getattr(entry, "__qualname__", name)


# ----------------------------------------------------------------------------------------------------------------------
# Public names of a package that are loaded when they are first used.


def lazy_names(package: str) -> tuple[list[str], Callable[[str], object], Callable[[], list[str]]]:
    """Return a package's ``__all__``, ``__getattr__`` and ``__dir__`` (PEP 562): the names that it imports for type
    checkers."""
    source = inspect.getsource(sys.modules[package])
    module_of = {
        alias.name: str(line.module)
        for block in ast.parse(source).body
        if isinstance(block, ast.If)  # TYPE_CHECKING
        for line in block.body
        if isinstance(line, ast.ImportFrom)
        for alias in line.names
    }
    namespace = vars(sys.modules[package])

    def load(name: str) -> object:
        if name not in module_of:
            raise AttributeError(f"module {package!r} has no attribute {name!r}{errors.meant(name, module_of)}")
        namespace[name] = value = getattr(importlib.import_module(module_of[name]), name)
        return value

    return [*module_of], load, lambda: sorted({*namespace, *module_of})
