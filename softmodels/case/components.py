"""Entries for the parts of a case: tables ``[kind]`` or ``[kind.name]`` of each registered kind; the user's own modules."""

from __future__ import annotations

import dataclasses
import importlib.util
import os
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, MutableMapping, Sequence
from pathlib import Path
from types import ModuleType

from geometries import Actuator
from geometries.actuator import cavity_roles
from softmodels.case.entries import MISSING, Entry, Missing, Option, Tables, Written, table_of
from softmodels.case.materials import Region
from softmodels.common.errors import OWN, FieldError
from softmodels.common.schema import Text, Words, about
from softmodels.components.contact import AUTO, Obstacle, RigidShape, Walls
from softmodels.components.fibres import Fabric, Fibres, Sheet
from softmodels.components.loads import Force, Gravity, Mass, Moment
from softmodels.components.rigid import Clamp, Rigid
from softmodels.mechanics.component import COMPONENTS, Component, ComponentError, gravity_of

Parts = tuple[Component, ...]

OWN_KINDS: tuple[type[Component], ...] = (
    Sheet, Obstacle, RigidShape, Walls, Rigid, Region, Clamp, Fabric, Fibres, Gravity, Mass, Force, Moment,
)  # fmt: skip
"""The library's kinds, registered by this import."""


class PartsEntry(Entry[Parts]):
    """The components of the device."""

    @property
    def tables(self) -> tuple[str, ...]:  # type: ignore[override]
        return tuple(dict.fromkeys(kind.table for kind in COMPONENTS.values()))

    def read(self, tables: Tables) -> Parts | Missing:
        found = [part for kind in COMPONENTS.values() if kind.table in tables for part in _of_table(kind, tables)]
        return tuple(found) or MISSING

    def write(self, value: Parts, text: Text) -> Written:
        written: dict[str, dict[str, object]] = {}
        for part in value:
            table = written.setdefault(part.table, {})
            (table.setdefault(part.name, {}) if part.name else table).update(part.write_table(text))  # type: ignore[attr-defined]
        return written

    def options(self) -> Iterator[Option]:
        for kind in _optional():
            defaults = {field.name: field.default for field in dataclasses.fields(kind)}
            for name, option in _options(kind).items():
                field = about(kind)[name]
                default = None if defaults[name] is dataclasses.MISSING else defaults[name]
                yield Option(option, field, default, name.upper() if isinstance(field.kind, Words) else None)

    def arguments(self, field: str) -> dict[str, str]:
        return {option: f"{kind.__name__}.{name}" for kind in _optional() for name, option in _options(kind).items()}

    def take(self, options: MutableMapping[str, object]) -> Parts | Missing:
        found = []
        for kind in _optional():
            given = {name: options.pop(option, None) for name, option in _options(kind).items()}
            table = {name: value for name, value in given.items() if value is not None}
            if table:
                kind.check_required("", table)
                found.append(kind(**table))  # type: ignore[arg-type]
        return tuple(found) or MISSING


def _optional() -> list[type[Component]]:
    """Return the kinds of parts that command lines have options for."""
    return [kind for kind in COMPONENTS.values() if kind.optional]


def _options(kind: type[Component]) -> dict[str, str]:
    """Return the options by field."""
    first, *others = about(kind)
    return {first: kind.table, **{name: f"{kind.table}_{name}" for name in others}}


def _of_table(kind: type[Component], tables: Tables) -> list[Component]:
    table = table_of(tables, kind.table)
    if kind.always_named:
        table = {name: value for name, value in table.items() if isinstance(value, Mapping)}
        return [kind.read_table(name, table_of(table, name)) for name in table]
    if f"{kind.table}." in COMPONENTS:  # tables with a name are of another kind
        own = {key: value for key, value in table.items() if not isinstance(value, Mapping)}
        return [kind.read_table("", own)] if own or not table else []
    named = [isinstance(value, Mapping) for value in table.values()]
    if not any(named):
        return [kind.read_table("", table)]
    if not all(named):
        raise FieldError(
            f"[{kind.table}] mixes entries with [{kind.table}.name] tables; put each {kind.table} in a named table"
        )
    return [kind.read_table(name, table_of(table, name)) for name in table]


def with_walls(components: Sequence[Component], actuator: Actuator, draws: bool) -> Parts:
    """Return the parts of a case, with self-contact of walls unless it is disabled; if air is drawn out, the cavities' own
    walls may touch too."""
    inside = cavity_roles(actuator) if draws else []
    if (actuator.meeting == () and not inside) or any(isinstance(part, Walls) for part in components):
        return tuple(components)
    kinds = list(COMPONENTS.values())
    behind = kinds[kinds.index(Walls) + 1 :]
    at = next((number for number, part in enumerate(components) if type(part) in behind), len(components))
    return (*components[:at], Walls(", ".join([AUTO, *inside])), *components[at:])  # as read from a case file


def without_walls(components: Sequence[Component]) -> Parts:
    """Return the parts without the default self-contact, for designs and decks."""
    return tuple(Walls("none") if isinstance(part, Walls) and part.automatic else part for part in components)


def check_parts(components: Sequence[Component], actuator: Actuator) -> None:
    """Raise `ComponentError` for parts unsuitable for the device, or with duplicate names."""
    twice = [label for label, count in Counter(part.label for part in components).items() if count > 1]
    if twice:
        raise ComponentError(
            f"several parts are called {twice[0]}; give each its own name, which is used in its columns"
        )
    gravity = gravity_of(components)
    for part in components:
        if part.weighs and not gravity.any():
            raise ComponentError(
                f"{part.where} has a mass, but gravity has no direction; add it ([gravity], --gravity -z)"
            )
        part.check_under(gravity)
        part.check_on(actuator)


# ----------------------------------------------------------------------------------------------------------------------
# Import user-defined devices, laws, supplies and parts, for commands and their child processes.
#
# A script that defines and runs a device does not need this. A command such as ``softmodels run case.toml`` knows only
# the library's classes; the environment variable `VARIABLE` names the Python files to import first, as `PATH` names folders.


VARIABLE = "SOFTMODELS_MODULES"


class OwnModuleError(ValueError):
    """A file cannot be imported; the message is for the user."""


def import_own_modules() -> None:
    """Import the files that `VARIABLE` names, each once; `OwnModuleError` if one is no Python file, or raises an exception."""
    for text in filter(None, os.environ.get(VARIABLE, "").split(os.pathsep)):
        path = Path(text).resolve()
        if path not in map(_file, list(sys.modules.values())):
            _import(path)


def own_modules(*things: object) -> str:
    """Return the value of `VARIABLE` with which another process can import the classes of these objects and their contents.

    So it does what their fields name (`Component.looked_up`).
    """
    names = {value.__module__: None for value in _within(things)}
    files = [_file(sys.modules.get(name)) for name in names if name.split(".")[0] not in OWN]
    named = filter(None, os.environ.get(VARIABLE, "").split(os.pathsep))
    return os.pathsep.join(dict.fromkeys([*named, *(str(file) for file in files if file is not None)]))


def _within(value: object) -> Iterator[object]:
    """Yield the frozen dataclasses in a value: a case, its device, its parts, their materials; and what parts name."""
    if isinstance(value, tuple | list):
        for one in value:
            yield from _within(one)
    elif dataclasses.is_dataclass(value):
        yield value
        for field in dataclasses.fields(value):
            yield from _within(getattr(value, field.name))
        if isinstance(value, Component):
            yield from value.looked_up


def _file(module: ModuleType | None) -> Path | None:
    file = getattr(module, "__file__", None)
    return Path(file).resolve() if isinstance(file, str) else None


def _import(path: Path) -> None:
    spec = importlib.util.spec_from_file_location(path.stem, path) if path.is_file() else None
    if spec is None or spec.loader is None:
        raise OwnModuleError(f"{VARIABLE} names {path}, which is not a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module  # dataclasses look up their module
    if str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))  # the meshing process gets this list and imports it by name
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        del sys.modules[path.stem]
        raise OwnModuleError(f"{path}, which {VARIABLE} names, cannot be imported ({error!r})") from error
