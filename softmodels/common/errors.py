"""Errors whose message is a sentence for the user, how options are spelt in it, and the system's reasons in words."""

from __future__ import annotations

import difflib
import importlib
import itertools
import re
import sys
from collections.abc import Iterable
from pathlib import Path
from types import ModuleType


class OptionMessage:
    """Mixin of errors whose message uses option names for its reader."""

    def __str__(self) -> str:
        return spoken(super().__str__())


class MissingPackageError(OptionMessage, ImportError):
    """A package that only some calls need is not installed; the message says how to install it."""

    __str__ = ImportError.__str__  # uv's options stay as they are typed


def required(package: str, extra: str) -> ModuleType:
    """Import a package that comes with an extra of this project; `MissingPackageError` if it is not installed."""
    try:
        return importlib.import_module(package)
    except ImportError:
        raise MissingPackageError(
            f"{package} is not installed; it comes with the extra {extra!r}: uv sync --inexact --extra {extra} in a clone, "
            f"pip install 'softmodels[{extra}]' elsewhere"
        ) from None


def written(error: BaseException) -> str:
    """Return an error's sentence as it was written, to be read by others later."""
    return str(error.args[0]) if isinstance(error, OptionMessage) and error.args else str(error)


class FieldError(OptionMessage, ValueError):
    """An invalid value of a field, or an unknown entry; the message is for the user."""


def whole_path(file: str) -> str:
    """Return a file's absolute path; a text that cannot be a path is returned unchanged, so that reading it fails."""
    try:
        return str(Path(file).absolute()) if file and "\0" not in file else file
    except OSError:  # the current folder is gone
        return file


class ComponentError(OptionMessage, ValueError):
    """An invalid part, or one unsuitable for this device; the message is for the user."""


class GeometryError(OptionMessage, ValueError):
    """Invalid parameters of a device; the message names the field and its value."""


class MeshingError(OptionMessage, RuntimeError):
    """Meshing failed although the parameters seem valid; the message gives the cause and a fix."""


class MeshingStopped(Exception):
    """The caller stopped the meshing."""


class MeshFileError(OptionMessage, ValueError):
    """A file is not a mesh written by this project; the message names the file."""


# ----------------------------------------------------------------------------------------------------------------------
# Names of options in messages: ``--cell-size`` on a command line, ``cell_size`` in Python.
#
# A sentence is written once, with options as the command line has them, and given its reader's words where it is read: by the
# errors that are `OptionMessage`, and by `spoken` where a sentence is no error. An option is the argument of its name, unless
# the owner of it changes that with `call`. Choices that follow an option are its values.


OWN_PACKAGES = ("softmodels", "geometries", "measurement")
"""Packages whose click commands are the project's command line; a program of the user's own calls a library."""
OWN_MODULES = "SOFTMODELS_MODULES"
"""Environment variable with the user's Python files to import first, as `PATH` has folders."""
PETSC = ("what follows --", "the variable PETSC_OPTIONS")
"""Where PETSc's options come from, at a command line and else."""
_arguments: dict[str, str] = {}
_choices: set[str] = set()
_VALUE = r"'[^']*'|[+-]?\d[\d.]*(?:e[+-]?\d+)?(?:deg|[a-zA-Z%/]+)?|[a-z][a-z-]*"
_OPTION = re.compile(rf"(?<![\w-])--(?P<name>[a-z][a-z0-9]*(?:-[a-zA-Z0-9]+)*)(?:[ =](?P<value>{_VALUE})(?![\w-]))?")
_MORE = re.compile(rf"(=\S+) or ({_VALUE})(?![\w-])")


def call(option: str, argument: str) -> None:
    """Register the Python name of an option, such as ``"pressures"`` or ``"resume=True"``; the option is without dashes, and
    with a value behind it (``"supply syringe"``) only where that follows."""
    _arguments[option] = argument


def choices(values: Iterable[object]) -> None:
    """Register words that are values after an option."""
    _choices.update(value for value in values if isinstance(value, str))


def spoken(sentence: str) -> str:
    """Return a message with option names for its reader."""
    if "--" not in sentence or at_command_line():
        return sentence
    # Alternatives such as --control auto or volume are values too.
    said = _OPTION.sub(_argument, sentence).replace(*PETSC)
    return _MORE.sub(lambda m: f'{m[1]} or "{m[2]}"' if m[2] in _choices else m[0], said)


def _argument(match: re.Match[str]) -> str:
    name, value = match["name"], match["value"]
    if value is None:
        return _arguments.get(name, name.replace("-", "_"))
    if (known := _arguments.get(f"{name} {value}")) is not None:
        return known
    argument = _arguments.get(name, name.replace("-", "_"))
    if "=" not in argument:
        if value in _choices:
            return f'{argument}="{value}"'
        if value.startswith("'"):
            return f"{argument}={value}"
        if value[0].isdigit():
            return f"{argument}={value.removesuffix('deg')}"
    return f"{argument} {value}"


def at_command_line() -> bool:
    """Return whether one of the project's own commands is under way in this thread."""
    click = sys.modules.get("click")
    context = click.get_current_context(silent=True) if click else None
    module = getattr(getattr(context and context.command, "callback", None), "__module__", "")
    return module.split(".")[0] in OWN_PACKAGES


def meant(name: object, known: Iterable[str]) -> str:
    """Return the end of a sentence: which of some names may have been meant; empty for none."""
    near = _nearest(name, known) if isinstance(name, str) else []
    return f"; did you mean {' or '.join(near)}?" if near else ""


def _nearest(name: str, known: Iterable[str]) -> list[str]:
    """Return the names nearest to another one, at most two; letters' case and an option's dashes do not count."""
    names = {str(name_known).lower().lstrip("-"): str(name_known) for name_known in known}
    return [names[name_known] for name_known in difflib.get_close_matches(name.lower().lstrip("-"), names, 2, 0.6)]


MOST_BESIDE = 1000
"""Files of a folder that are looked through for a near name."""


def near_paths(path: Path | str) -> str:
    """Return the end of a sentence on a path that does not exist: which existing file of the same ending, or folder, may have
    been meant; empty for none."""
    wanted = Path(path)
    try:
        while not wanted.parent.exists():
            wanted = wanted.parent
        beside = list(itertools.islice(wanted.parent.iterdir(), MOST_BESIDE))
    except (OSError, ValueError):  # the folder may not be read, or a name has a zero byte in it
        return ""
    # Without the ending, which all of them share: zz.toml is not near to aa.toml.
    alike = {file.stem: file for file in beside if file.suffix == wanted.suffix and not file.name.startswith(".")}
    near = [str(alike[stem]) for stem in _nearest(wanted.stem, alike)]
    return f"; did you mean {' or '.join(near)}?" if near else ""


def no_case(folder: Path) -> str:
    """Return why a folder holds no results of a run: it has no case file, or does not exist."""
    return "there is no case.toml in it" if folder.exists() else f"there is no such folder{near_paths(folder)}"


def known_are(name: object, known: Iterable[str], more: str = "") -> str:
    """Return the end of a sentence: what there is, and what may have been meant; ``more``, begun with a comma, is what there
    is beside."""
    names = list(dict.fromkeys(known))
    return f"known are {', '.join(names)}{more}{meant(name, names)}" if names else "there are none"


# ----------------------------------------------------------------------------------------------------------------------
# The operating system's reason of a file error, without Python's prefix.


def reason(error: BaseException) -> str:
    """Return ``"No such file or directory"`` where Python has ``"[Errno 2] No such file or directory: 'a.csv'"``, and which
    file may have been meant."""
    why = getattr(error, "strerror", None) or str(error)
    missing = error.filename if isinstance(error, FileNotFoundError) else None
    return why + (near_paths(missing) if isinstance(missing, str) else "")
