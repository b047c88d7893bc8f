"""Short functions, few parameters, few entries at the top: the lists of what is larger may only shrink."""

from __future__ import annotations

import ast
import functools
import re
from pathlib import Path

import geometries
import measurement
import softmodels

FUNCTION_LINES, PARAMETERS, ENTRIES = 60, 7, 20
"""Most lines of a function, most parameters, and most entries directly in ``softmodels/``."""
CLASS_LINES, BANNER_LINES = 60, 40
"""A class of more lines stands this near to its banner, or to the imports; other classes of the section do not count."""
MOST_ANY = 45
"""Most times that ``softmodels/`` says `Any`, imports included: where a library has no types, or wrong ones. In ``common/``
values come from files and command lines, and may be anything."""
PACKAGES = [Path(package.__file__).parent for package in (softmodels, measurement, geometries)]

MANY_PARAMETERS: set[str] = {
    "softmodels/design/optimise.py: optimise", "softmodels/fitting/scoring.py: score",
    "softmodels/api/calls.py: inflate", "softmodels/casting/files.py: mould",
    "softmodels/case/case.py: case_of",
}  # fmt: skip
"""Public calls, whose arguments are real ones so that Tab completes them."""
LONG_FUNCTIONS: set[str] = {
    "softmodels/cli/material_commands.py: fit_material",
}  # fmt: skip
"""Sequences of steps, and public calls with a line and a sentence for each argument."""


def _files():
    for package in PACKAGES:
        for path in sorted(package.rglob("*.py")):
            yield path.relative_to(package.parent).as_posix(), path.read_text(encoding="utf-8")


@functools.cache
def _functions():
    return [
        (f"{file}: {node.name}", node)
        for file, text in _files()
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    ]


def _parameters(function):
    """How many a caller sees: ``self`` and ``cls`` are not among them."""
    given = function.args
    names = [
        argument.arg for argument in (*given.posonlyargs, *given.args, *given.kwonlyargs, given.vararg, given.kwarg) if argument
    ]
    return len(names) - (names[:1] in (["self"], ["cls"]))


def _differ(found, listed, limit):
    """What is too large and not listed, and what is listed and no longer too large."""
    too_large, no_longer = sorted(found - listed), sorted(listed - found)
    assert not too_large, f"more than {limit}: {', '.join(too_large)}"
    assert not no_longer, f"no longer more than {limit}, to be taken off the list: {', '.join(no_longer)}"


def test_functions_are_short():
    found = {name for name, function in _functions() if function.end_lineno - function.lineno >= FUNCTION_LINES}
    _differ(found, LONG_FUNCTIONS, f"{FUNCTION_LINES} lines")


def test_functions_have_few_parameters():
    found = {name for name, function in _functions() if _parameters(function) > PARAMETERS}
    _differ(found, MANY_PARAMETERS, f"{PARAMETERS} parameters")


def test_few_entries_at_the_top():
    entries = {path.name for path in PACKAGES[0].iterdir()} - {"__pycache__"}
    assert len(entries) <= ENTRIES, sorted(entries)


def test_any_stays_rare():
    found = {
        file: len(re.findall(r"\bAny\b", text))
        for file, text in _files()
        if file.startswith("softmodels/") and "/common/" not in file
    }
    most = ", ".join(f"{file} {count}" for file, count in found.items() if count)
    assert sum(found.values()) <= MOST_ANY, f"Any is said more than {MOST_ANY} times, where object or a type would do: {most}"


def test_parameters_are_counted_as_a_caller_sees_them():
    (method,) = ast.parse("def f(self, a, /, b, *rest, c=1, **more): ...").body
    (plain,) = ast.parse("def f(a, b): ...").body
    assert _parameters(method) == 5 and _parameters(plain) == 2


def test_every_long_file_is_there(request):
    """Files that begin first are named in `tests/costs.csv`, and must not get lost under another name."""
    plugins = request.config.pluginmanager.get_plugins()
    costs = next(plugin.read_costs() for plugin in plugins if hasattr(plugin, "read_costs"))
    tests = Path(__file__).parents[1]
    assert costs and [file for file in costs if not (tests / file).is_file()] == []


def _far_from_banner(text):
    """Classes of more than 60 lines, and the lines other than of classes between each and its banner, or the imports."""
    lines, statements = text.splitlines(), ast.parse(text).body
    banners = [number for number, line in enumerate(lines, 1) if re.fullmatch("# -{20,}", line)]
    opening = max((node.end_lineno for node in statements if isinstance(node, ast.Import | ast.ImportFrom)), default=0)
    for node in statements:
        if not isinstance(node, ast.ClassDef) or node.end_lineno - node.lineno < CLASS_LINES:
            continue
        first = min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])
        banner = max((number for number in [opening, *banners] if number < first), default=0)
        between = set(range(banner + 1, first))
        for other in statements:
            if isinstance(other, ast.ClassDef):
                between -= set(range(other.lineno, other.end_lineno + 1))
        if sum(bool(lines[number - 1].strip()) for number in between) > BANNER_LINES:
            yield node.name


def test_large_classes_stand_near_their_banner():
    found = [f"{file}: {name}" for file, text in _files() for name in _far_from_banner(text)]
    assert not found, "put the class before its helpers, or under a banner of its own"
