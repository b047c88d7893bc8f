"""Fixtures shared by all folders; figures that go into tables; what is not checked for want of data."""

from __future__ import annotations

import collections
import csv
import importlib.util
import json
import math
import os
import resource
import shutil
import sys
from pathlib import Path

import filelock
import numpy as np
import pytest

from geometries import ImportedActuator
from geometries.meshing import private_model
from tests.support import figure_tables

MEASURED = {
    "silicone_tensile": "tensile curves of 19 silicones, Marechal et al. 2021 (ODbL)",
    "ecoflex_uniaxial": "tensile curve of Ecoflex 00-30, Liao et al. 2021",
    "rubber": "three tests on rubber and silicone, Treloar 1944 and Meunier 2008",
    "chessboards": "photographs of a chessboard, OpenCV's samples",
    "silhouettes": "photographs of drops, DropPyTension (GPL)",
    "memory": "VHB 4910, Hossain et al. 2012 and Wang et al. 2016; solutions of Kumar and Lopez-Pamies' law",
    "lens": "lens profile of a Canon EF-S 18-55, lensfun (CC BY-SA)",
}
"""Data of others by folder of ``shared/data`` beside the checkout: they are not part of the project."""
ABSENT = "no shared/data/"
NOISE = 1e-8
"""Bounds below this are of rounding and of what the solvers' tolerances leave, which differ from machine to machine: they are
asserted ten times wider."""


# Tests of several ranks run beside other tests, whatever the number of cores: who waits looks seldom.
os.environ.setdefault("MPIR_CVAR_CH4_PROGRESS_THROTTLE_NO_PROGRESS_COUNT", "4")

if sys.dont_write_bytecode and not Path(importlib.util.cache_from_source(__file__)).exists():
    # Many images set PYTHONDONTWRITEBYTECODE. Tests start hundreds of commands, and each would compile all it imports anew,
    # which takes longer than importing it. Unless all was compiled before, as `.ci/run` and the Dockerfile do, bytecode goes
    # beside pytest's own cache, and nothing into the source.
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    os.environ.setdefault("PYTHONPYCACHEPREFIX", str(Path(__file__).parents[1] / ".pytest_cache" / "bytecode"))
    sys.dont_write_bytecode, sys.pycache_prefix = False, os.environ["PYTHONPYCACHEPREFIX"]


@pytest.fixture(scope="session")
def shared_data():
    """Return a function that gives a folder of measured data beside the checkout, or skips where it is not there."""

    def folder_of(name):
        assert name in MEASURED
        for folder in Path(__file__).resolve().parents:
            found = folder / "shared" / "data" / name
            if found.is_dir():
                return found
        return pytest.skip(f"{ABSENT}{name} beside the project")

    return folder_of


CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
"""The system's own; None for Playwright's."""


@pytest.fixture(scope="module")  # its event loop must not outlive the tests that need it
def browser():
    """Chromium, Playwright's own or the system's; skips where there is neither."""
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as started:
        try:
            found = started.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        except playwright.Error:
            pytest.skip("no Chromium: install Debian's chromium, or run playwright install chromium")
        yield found
        found.close()


@pytest.fixture(scope="session")
def made_once(tmp_path_factory):
    """Return a function that fills a folder once in a run of the tests, whatever the number of workers.

    ``made_once(name, fill)`` gives the folder, and what ``fill(folder)`` returned, which JSON can hold. Tests only look at it.
    """
    top = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        top = top.parent  # of all workers

    def made(name, fill):
        folder, result = top / name, top / f"{name}.json"
        with filelock.FileLock(top / f"{name}.lock"):
            if not result.exists():
                folder.mkdir()
                result.write_text(json.dumps(fill(folder)))
            return folder, json.loads(result.read_text())

    return made


@pytest.fixture
def figure(request):
    """Return a function that asserts a measured figure, and records it for the tables of ``tests/verification/README.md``.

    ``figure(against, name, value, at_most)`` takes the largest absolute value of an array, ``at_least=`` the smallest;
    ``unit=`` is the value's. `pytest --write-figures` writes the tables.
    """

    def check(against, name, value, at_most=None, *, at_least=None, unit=""):
        least = at_most is None
        if not least and at_most < NOISE:
            at_most = 10 * at_most
        assert np.size(value) and np.isfinite(value).all(), (against, name, value)
        worst = float(np.min(value) if least else np.max(np.abs(value)))
        bound = float(at_least if least else at_most)
        request.node.user_properties.append(("figure", (request.path.name, against, name, worst, bound, least, unit)))
        assert worst >= bound if least else worst <= bound, (
            f"{name} against {against}: {worst:.3g} {unit}, allowed is {bound:g}"
        )

    return check


class FigureWriter:
    """Gathers the figures of a run, those of its workers too, and writes the tables at its end."""

    def __init__(self, config):
        self.figures, self.passed, self.config = [], {}, config

    def pytest_runtest_logreport(self, report):
        file = report.location[0].rsplit("/", 1)[-1]
        self.passed[file] = self.passed.get(file, True) and report.outcome == "passed"
        if report.when == "call" and report.outcome == "passed":
            self.figures += [figure_tables.Figure(*value) for name, value in report.user_properties if name == "figure"]

    def pytest_terminal_summary(self, terminalreporter):
        option = self.config.option
        picked = option.keyword or option.markexpr or option.deselect or any("::" in word for word in self.config.args)
        whole = {file: passed and not picked for file, passed in self.passed.items()}
        readme = figure_tables.README
        text = readme.read_text(encoding="utf-8")
        readme.write_text(figure_tables.rewritten(text, self.figures, whole), encoding="utf-8")
        terminalreporter.write_line(f"{len(self.figures)} figures written to {readme}")
        for file in figure_tables.unlisted(text, self.figures):
            terminalreporter.write_line(f"no table there names {file}: add it to a line '<!-- figures:'", red=True)
        for one in figure_tables.worst(self.figures):
            if one.loose:
                terminalreporter.write_line(f"more than three times: {' | '.join(one.cells())}")


COSTS = Path(__file__).with_name("costs.csv")
"""CPU seconds of each file's default items and campaigns, started processes included; ``--write-costs`` renews the rows of the
files it runs to the end."""
KINDS = "default_s", "campaign_s"
TYPICAL = 10.0
"""CPU seconds that a file without a row is taken for."""


def read_costs():
    """Return the table of costs: a row by file."""
    with COSTS.open(newline="") as file:
        return {row.pop("file"): row for row in csv.DictReader(file)}


def pytest_collection_modifyitems(config, items):
    """Begin with the files that take longest, so that no core waits for one of them at the end."""
    costs, kind = read_costs(), KINDS[config.option.markexpr == "campaign"]
    order = {file: -float(row[kind]) for file, row in costs.items()}
    items.sort(key=lambda item: order.get("/".join(item.path.parts[-2:]), -TYPICAL))


def cpu_seconds():
    """Return the CPU time of this process and of those that it started and has waited for, in s."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


SPENT = [0.0]
"""CPU seconds of this process at the end of the last phase of a test."""


def pytest_runtest_logstart():
    SPENT[0] = cpu_seconds()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport():
    report = yield
    now = cpu_seconds()
    report.cpu_seconds, SPENT[0] = now - SPENT[0], now
    return report


class CostWriter:
    """Adds up the CPU seconds of each file in a run, those of its workers too, and renews the table at its end."""

    def __init__(self):
        self.seconds = {}

    def pytest_runtest_logreport(self, report):
        file = "/".join(Path(report.location[0]).parts[-2:])
        kind = KINDS["campaign" in report.keywords]
        row = self.seconds.setdefault(file, {})
        row[kind] = row.get(kind, 0.0) + report.cpu_seconds

    def pytest_terminal_summary(self, terminalreporter):
        rows = read_costs()
        for file, spent in self.seconds.items():
            rows.setdefault(file, dict.fromkeys(KINDS, "0")).update((kind, f"{s:.0f}") for kind, s in spent.items())
        with COSTS.open("w", newline="") as table:
            csv.writer(table, lineterminator="\n").writerows(
                [("file", *KINDS), *((file, *(row[kind] for kind in KINDS)) for file, row in sorted(rows.items()))]
            )
        totals = (sum(float(row[kind]) for row in rows.values()) for kind in KINDS)
        terminalreporter.write_line(f"{COSTS}: {' and '.join(f'{total:.0f}' for total in totals)} CPU seconds")


def pytest_addoption(parser):
    parser.addoption("--write-figures", action="store_true", help="write the measured figures to tests/verification/README.md")
    parser.addoption("--write-costs", action="store_true", help="write CPU seconds by file to tests/costs.csv")


def pytest_configure(config):
    if config.option.write_figures and not hasattr(config, "workerinput"):
        config.pluginmanager.register(FigureWriter(config))
    if config.option.write_costs and not hasattr(config, "workerinput"):
        config.pluginmanager.register(CostWriter())


def pytest_terminal_summary(terminalreporter):
    """Name what was not checked because measured data are not beside the checkout."""
    counts = collections.Counter(
        report.longrepr[2].split(ABSENT)[1].split()[0]
        for report in terminalreporter.stats.get("skipped", [])
        if isinstance(report.longrepr, tuple) and ABSENT in report.longrepr[2]
    )
    if counts:
        terminalreporter.section("not checked: measured data of others, which are not part of the project")
        for name, count in sorted(counts.items()):
            terminalreporter.write_line(f"{count} tests need shared/data/{name} beside the checkout: {MEASURED[name]}")


@pytest.fixture(scope="session")
def step_file():
    """Return a function that writes what ``draw(gmsh.model.occ)`` draws as a STEP file in a unit, and gives its path."""
    import gmsh

    def write(path, draw, unit="MM"):
        with private_model():
            gmsh.option.setString("Geometry.OCCTargetUnit", unit)
            draw(gmsh.model.occ)
            gmsh.model.occ.synchronize()
            gmsh.write(str(path))
            gmsh.option.setString("Geometry.OCCTargetUnit", "")
        return str(path)

    return write


@pytest.fixture(scope="session")
def wedge_part(step_file, tmp_path_factory):
    """Return a function that gives a wedge of a "can" or of the upper half of a "ball" from a STEP file.

    The can has a radius of 15 mm, a height of 10 mm, a flat cavity of 10 mm radius and a held bottom; the ball has radii of
    10 and 15 mm and is cut at z = 0 too. Planes stand at 0 degrees and at the wedge's angle; at 180 they are one.
    """
    folder = tmp_path_factory.mktemp("wedges")
    second = {45: "normal 1, -1, 0", 60: "normal 0.866, -0.5, 0", 90: "x = 0 mm"}

    def part(shape, angle, **changes):
        around = {"angle" if shape == "can" else "angle3": math.radians(angle)}

        def draw(occ):
            if shape == "can":
                whole, hole = (occ.addCylinder(0, 0, z, 0, 0, h, r, **around) for z, h, r in ((0, 10, 15), (3, 4, 10)))
            else:
                whole, hole = (occ.addSphere(0, 0, 0, r, angle1=0, angle2=math.pi / 2, **around) for r in (15, 10))
            occ.cut([(3, whole)], [(3, hole)])

        file = folder / f"{shape}{angle}.step"
        planes = ["y = 0 mm", second.get(angle), "z = 0 mm" if shape == "ball" else None]
        choices = {
            "cavities": ("at 3, 0.5, 5 mm",),
            "support": "z = 0 mm" if shape == "can" else "",
            "cell_size": 0.005,
        }
        return ImportedActuator(
            file=str(file) if file.exists() else step_file(file, draw),
            planes=tuple(filter(None, planes)),
            **{**choices, **changes},
        )

    return part


@pytest.fixture(scope="session")
def comm():
    """The world communicator; the first to ask for it starts MPI, PETSc and DOLFINx in their order."""
    from softmodels.mechanics.mpi import start

    return start()


@pytest.fixture(scope="session")
def two_cavities(step_file, tmp_path_factory):
    """STEP file of a block of 20 x 10 x 10 mm with two like cavities above each other, 1.5 mm apart.

    What one does moves the other's walls. They lie around (11, 0, 2) and (11, 0, -2) mm, and the block starts at x = 0.
    """

    def draw(occ):
        block = occ.addBox(0, -5, -5, 20, 10, 10)
        holes = [occ.addBox(6, -3, z, 10, 6, 2.0) for z in (0.75, -2.75)]
        occ.cut([(3, block)], [(3, hole) for hole in holes])

    return step_file(tmp_path_factory.mktemp("step") / "two_cavities.step", draw)
