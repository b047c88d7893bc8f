"""The rooms of the packages: imports point downwards, also inside functions and for types, and never in circles."""

from __future__ import annotations

import ast
import graphlib
import shutil
import subprocess
from pathlib import Path

import pytest

TOP = Path(__file__).parents[2]
ROOMS = {
    "softmodels": (
        "materials",
        "mechanics",
        "path",
        "case",
        "results",
        "fitting",
        "design",
        "pictures",
        "runs",
        "cli",
        "",
    ),
    "measurement": ("common", "camera", "screen", "edge", "outline", "series", "synthetic", "cli", ""),
}
"""From the lowest to the highest. The last are the public names and the commands as users call them."""
COMMON = {"measurement": "common"}
"""Rank of modules that stand in no room: files, folders, units and endings, which every program here shares."""
DOORS = ("__init__", "__main__", "disk", "seminar")


def _module(package, parts):
    place = TOP.joinpath(package, *parts)
    if place.is_dir():
        place = place / "__init__"
    return place.relative_to(TOP).as_posix() if place.with_suffix(".py").is_file() else None


def _imports(path):
    """Modules of its own package that a file imports, as paths without suffix."""
    package, found = path.relative_to(TOP).parts[0], set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == package:
            parts = node.module.split(".")[1:]
            found |= {_module(package, [*parts, alias.name]) or _module(package, parts) for alias in node.names}
        elif isinstance(node, ast.Import):
            names = [alias.name.split(".") for alias in node.names]
            found |= {_module(package, name[1:]) for name in names if name[0] == package}
    return found - {None}


def _rank(module):
    package, *parts = module.split("/")
    room = parts[0] if len(parts) > 1 else "" if parts[0] in DOORS else COMMON.get(package, "")
    return ROOMS[package].index(room)


GRAPH = {
    path.relative_to(TOP).with_suffix("").as_posix(): _imports(path)
    for package in ROOMS
    for path in sorted((TOP / package).rglob("*.py"))
}


@pytest.mark.parametrize("package", ROOMS)
def test_every_room_has_a_rank(package):
    rooms = {path.name for path in (TOP / package).iterdir() if any(path.glob("*.py"))}
    assert rooms == set(ROOMS[package]) - {"", COMMON.get(package)}
    assert (
        sum(len(GRAPH[module]) for module in GRAPH if module.startswith(package)) > 100
    )  # the imports are really seen


@pytest.mark.parametrize("module", sorted(GRAPH))
def test_imports_point_downwards(module):
    wrong = {other for other in GRAPH[module] if _rank(other) > _rank(module)}
    assert not wrong, f"{module} imports from higher rooms"


def test_no_cycles():
    list(graphlib.TopologicalSorter(GRAPH).static_order())  # else a CycleError names one


@pytest.mark.skipif(not (TOP / ".git").exists() or shutil.which("git") is None, reason="not a checkout")
def test_no_results_are_committed():
    """A run that was given a folder of the checkout leaves one that the list of ignored files does not know."""
    done = subprocess.run(["git", "ls-files"], cwd=TOP, capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip("git does not read a checkout of another user")
    files = done.stdout.splitlines()
    folders = {file.split("/")[0] for file in files if "/" in file and not file.startswith(".")}
    assert folders <= {"docs", "geometries", "measurement", "softmodels", "tests"}
    assert not [file for file in files if file.endswith((".h5", ".vtkhdf", ".xdmf"))]
