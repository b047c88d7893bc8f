"""The rooms of the packages: imports point downwards, also inside functions and for types, and never in circles."""

from __future__ import annotations

import ast
import graphlib
import importlib
import shutil
import subprocess
from pathlib import Path

import pytest

TOP = Path(__file__).parents[2]
PACKAGES = ("softmodels", "geometries", "measurement")
ROOMS = (
    "softmodels/common",
    "geometries",
    "measurement",
    "measurement/screen",
    "measurement/outline",
    "measurement/series",
    "measurement/cli",
    "softmodels/materials",
    "softmodels/mechanics",
    "softmodels/components",
    "softmodels/path",
    "softmodels/case",
    "softmodels/runs",
    "softmodels/fitting",
    "softmodels/design",
    "softmodels/decks",
    "softmodels/pictures",
    "softmodels/casting",
    "softmodels/api",
    "softmodels/app",
    "softmodels/cli",
)
"""From the lowest to the highest."""
DOORS = {
    *(f"{package}/{door}" for package in PACKAGES for door in ("__init__", "__main__")),
    "softmodels/disk",
    "softmodels/seminar",
}
"""Public names and commands, above all rooms."""


def _module(parts):
    place = TOP.joinpath(*parts)
    if place.is_dir():
        place = place / "__init__"
    return place.relative_to(TOP).as_posix() if place.with_suffix(".py").is_file() else None


def _imports(path):
    """Modules of the three packages that a file imports, as paths without suffix."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] in PACKAGES:
            parts = node.module.split(".")
            found |= {_module([*parts, alias.name]) or _module(parts) for alias in node.names}
        elif isinstance(node, ast.Import):
            names = [alias.name.split(".") for alias in node.names]
            found |= {_module(name) for name in names if name[0] in PACKAGES}
    return found - {None}


def _rank(module):
    """A door stands above all; what is imported from a package's door comes from a room, which is looked at by itself."""
    if module in DOORS:
        return len(ROOMS)
    room = max((room for room in ROOMS if module.startswith(f"{room}/")), key=len)
    return ROOMS.index(room)


def _public(module):
    """Whether a module is a package's door as others use it: ``from geometries import Actuator``."""
    return module in {f"{package}/__init__" for package in PACKAGES}


@pytest.fixture(scope="module")
def graph():
    """The modules that each module imports."""
    return {
        path.relative_to(TOP).with_suffix("").as_posix(): _imports(path)
        for package in PACKAGES
        for path in sorted((TOP / package).rglob("*.py"))
    }


def test_every_folder_is_in_a_room(graph):
    folders = {path.parent.relative_to(TOP).as_posix() for package in PACKAGES for path in (TOP / package).rglob("*.py")}
    assert {room for room in ROOMS if room not in folders} == set()
    assert all(any(f"{folder}/".startswith(f"{room}/") for room in (*ROOMS, "softmodels")) for folder in folders)
    assert all(sum(len(graph[m]) for m in graph if m.startswith(package)) > 60 for package in PACKAGES)  # they are seen


def test_imports_point_downwards(graph):
    wrong = [
        f"{module} imports {other}"
        for module, imported in graph.items()
        for other in imported
        if (not _public(other) and _rank(other) > _rank(module))
        or (other == "softmodels/__init__" and _rank(module) < len(ROOMS))
    ]
    assert not wrong


def test_no_cycles(graph):
    inner = {module: {other for other in imported if not _public(other)} for module, imported in graph.items()}
    list(graphlib.TopologicalSorter(inner).static_order())  # else a CycleError names one


@pytest.mark.parametrize("room", ROOMS)
def test_every_room_has_a_first_page(room):
    """It says what lives there and where to begin: every file of the room is named."""
    page = ast.get_docstring(ast.parse((TOP / room / "__init__.py").read_text(encoding="utf-8"))) or ""
    inside = [path.stem for path in (TOP / room).glob("*.py") if path.stem not in ("__init__", "__main__")]
    inside += [path.name for path in (TOP / room).iterdir() if (path / "__init__.py").exists()]
    assert [name for name in inside if f"`{name}`" not in page] == []


@pytest.mark.skipif(not (TOP / ".git").exists() or shutil.which("git") is None, reason="not a checkout")
def test_benchmarks_import_names_that_exist():
    """No other test runs most of them."""
    missing = []
    for path in sorted((TOP / "tests/benchmarks").glob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] in PACKAGES:
                module = importlib.import_module(node.module)
                missing += [
                    f"{path.name}: {node.module}.{alias.name}"
                    for alias in node.names
                    if not (hasattr(module, alias.name) or _module([*node.module.split("."), alias.name]))
                ]
    assert not missing


def test_no_results_are_committed():
    """A run that was given a folder of the checkout leaves one that the list of ignored files does not know."""
    done = subprocess.run(["git", "ls-files"], cwd=TOP, capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip("git does not read a checkout of another user")
    files = done.stdout.splitlines()
    folders = {file.split("/")[0] for file in files if "/" in file and not file.startswith(".")}
    assert folders <= {"docs", "geometries", "measurement", "softmodels", "tests"}
    assert not [file for file in files if file.endswith((".h5", ".vtkhdf", ".xdmf"))]


def test_below_the_door_pressures_are_in_pascals():
    """No variable, argument or attribute there is a number of centimetres, or Pa of one."""
    rooms = ("mechanics", "components", "path", "materials", "fitting", "decks", "pictures", "casting", "api")
    for path in (path for room in rooms for path in (TOP / "softmodels" / room).rglob("*.py")):
        nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
        names = {getattr(node, key, None) for node in nodes for key in ("id", "attr", "arg")}
        assert not [name for name in names if isinstance(name, str) and name.split("_")[-1] == "cm"], path
