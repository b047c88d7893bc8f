"""How something ended is reported by a flag, a status or a class, never by words searched in a sentence."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import geometries
import measurement
import softmodels
from measurement.cli import SetupError, per_metre
from softmodels.common.commands import EXIT_FAILED, EXIT_STOPPED
from softmodels.common.errors import ComponentError
from softmodels.common.tables import TomlError, parse_toml
from softmodels.common.units import DecimalCommaError, UnitError, quantity
from softmodels.components.contact import Obstacle
from softmodels.design import optimise as search
from softmodels.design.optimise import run_variants
from softmodels.runs.outcomes import RunError

FOREIGN = {"softmodels/mechanics/compiling.py"}
"""DOLFINx passes a compiler's failure from rank to rank as text only."""
SEARCHES = {"startswith", "endswith", "find", "index", "count", "partition", "split"}


def _words_of(node, names):
    """Whether an expression is the text of one of the errors with these names."""
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ("str", "repr"):
        return any(isinstance(one, ast.Name) and one.id in names for one in node.args)
    return isinstance(node, ast.Attribute) and node.attr in ("args", "message") and _named(node.value, names)


def _named(node, names):
    return isinstance(node, ast.Name) and node.id in names


def _searches(tree):
    names = {one.name for one in ast.walk(tree) if isinstance(one, ast.ExceptHandler) and one.name}
    for node in ast.walk(tree):
        if isinstance(node, ast.Compare) and _words_of(node.comparators[0], names):
            yield node.lineno
        called = node.func if isinstance(node, ast.Call) and node.args else None
        if isinstance(called, ast.Attribute) and called.attr in SEARCHES and _words_of(called.value, names):
            yield node.lineno


def test_no_code_searches_the_words_of_an_error():
    found = []
    for package in (softmodels, geometries, measurement):
        root = Path(package.__file__).parent
        for file in root.rglob("*.py"):
            name = str(file.relative_to(root.parent))
            found += [f"{name}:{line}" for line in _searches(ast.parse(file.read_text())) if name not in FOREIGN]
    assert not found
    seen = "try:\n    pass\nexcept ValueError as e:\n    a = 'x' in str(e)\n    b = str(e).startswith('x')\n"
    assert [*_searches(ast.parse(seen))] == [4, 5]


class _Variants:
    """A problem of two choices of a whole number."""

    counts = ("rings",)
    growth = None

    def variants(self):
        return [("rings = 2", self), ("rings = 3", self)]


class _Here:
    """One rank."""

    rank, size = 0, 1


@pytest.mark.parametrize("status", [EXIT_FAILED, EXIT_STOPPED])
def test_a_variant_that_fails_is_not_a_user_who_stops(monkeypatch, status):
    """Newton's method that "stopped converging" in one choice leaves the others; the user's stop ends all."""
    tried = []

    def run_in(problem, folder, comm, **how):
        tried.append(problem)
        raise RunError("Newton's method stopped converging", status)

    monkeypatch.setattr(search, "run_in", run_in)
    monkeypatch.setattr(search, "_begin", lambda *given: None)
    monkeypatch.setattr(search.mpi, "on_root", lambda comm, work: work())
    monkeypatch.setattr(search.mpi, "kept_on_root", lambda comm, work: None)
    with pytest.raises(RunError) as told:
        run_variants(_Variants(), None, _Here())
    assert len(tried) == (1 if status == EXIT_STOPPED else 2)
    assert (told.value.status == EXIT_STOPPED) == (status == EXIT_STOPPED)


def test_a_decimal_comma_has_a_class_of_its_own():
    with pytest.raises(DecimalCommaError):
        quantity("1,5 mm", "m")
    with pytest.raises(UnitError) as other:
        quantity("a decimal comma", "m")
    assert not isinstance(other.value, DecimalCommaError)
    with pytest.raises(SetupError) as told:
        per_metre("a decimal comma")
    assert "(" not in str(told.value)


def test_a_plane_with_a_wrong_number_and_one_that_is_none():
    with pytest.raises(ComponentError, match="decimal comma"):
        Obstacle(faces="top", plane="z = 9,5 mm")
    with pytest.raises(ComponentError, match="is not a plane"):
        Obstacle(faces="top", plane="contact plane: none")


def test_a_toml_file_with_a_giant_number_and_one_with_these_words():
    with pytest.raises(TomlError, match="a whole number of thousands of digits"):
        parse_toml(f"a = {'1' * 5000}")
    with pytest.raises(TomlError) as told:
        parse_toml("integer string = 1")
    assert "thousands of digits" not in str(told.value)
