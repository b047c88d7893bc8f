"""Runs of the command line in processes of their own, and what they leave behind."""

from __future__ import annotations

import csv
import shutil
import subprocess
import sys
import types

import pytest

DISK = ("-m", "softmodels.disk", "--section", "axisymmetric", "--no-pictures")


def start(*arguments, **options):
    """Start a Python process, its output kept as text; the words follow the interpreter's name."""
    command = [*map(str, options.pop("launcher", ())), sys.executable, *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)


def run(*arguments, **options):
    """Run a Python process to its end: ``status``, ``out`` and ``err``."""
    process = start(*arguments, **options)
    out, err = process.communicate(timeout=300)
    return types.SimpleNamespace(status=process.returncode, out=out, err=err)


def disk(folder, *arguments, **options):
    """Run the axisymmetric disk without pictures into a folder."""
    return run(*DISK, "--output", folder, *arguments, **options)


def rows(folder):
    """The table of a folder of results; numbers as numbers."""
    with (folder / "path.csv").open() as file:
        return [
            {key: value if key == "following" else float(value) for key, value in row.items()}
            for row in csv.DictReader(file)
        ]


def same(found, wanted, tolerance):
    """Whether two tables hold the same numbers, to a share of each column's largest one."""
    assert [row["step"] for row in found] == [row["step"] for row in wanted]
    for name in wanted[0]:
        if name == "following":
            assert [row[name] for row in found] == [row[name] for row in wanted]
        elif name != "newton_iterations":
            column = [row[name] for row in wanted]
            assert [row[name] for row in found] == pytest.approx(column, rel=0, abs=tolerance * max(map(abs, column))), name


@pytest.fixture(scope="session")
def runs():
    """The functions of this file: modules of tests cannot import each other."""
    return types.SimpleNamespace(DISK=DISK, start=start, run=run, disk=disk, rows=rows, same=same)


@pytest.fixture(scope="session")
def whole(tmp_path_factory):
    """A run to 177 cm in 36 steps that nothing disturbed: its folder, and what it said."""
    folder = tmp_path_factory.mktemp("whole") / "disk"
    return folder, disk(folder, "--pressure-cm", "0:177:5")


@pytest.fixture
def whole_copy(whole, tmp_path):
    """The undisturbed run's folder, to be changed."""
    return shutil.copytree(whole[0], tmp_path / "copy")
