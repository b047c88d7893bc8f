"""Import user-defined devices, laws, supplies and parts, for commands and their child processes.

A script that defines and runs a device does not need this. A command such as ``softmodels run case.toml`` knows only
the library's classes; the environment variable `VARIABLE` names the Python files to import first, as `PATH` names folders.
"""

from __future__ import annotations

import dataclasses
import importlib.util
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

from softmodels.mechanics.component import Component

VARIABLE = "SOFTMODELS_MODULES"
LIBRARY = ("softmodels", "geometries", "measurement")


class OwnModuleError(ValueError):
    """A file cannot be imported; the message is for the user."""


def import_own_modules() -> None:
    """Import the files that `VARIABLE` names, each once.

    Raises:
        OwnModuleError: One is no Python file, or raises an exception.
    """
    for text in filter(None, os.environ.get(VARIABLE, "").split(os.pathsep)):
        path = Path(text).resolve()
        if path not in map(_file, list(sys.modules.values())):
            _import(path)


def own_modules(*things: object) -> str:
    """Return the value of `VARIABLE` with which another process can import the classes of these objects and their contents.

    So it does what their fields name (`Component.looked_up`).
    """
    names = {value.__module__: None for value in _within(things)}
    files = [_file(sys.modules.get(name)) for name in names if name.split(".")[0] not in LIBRARY]
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
