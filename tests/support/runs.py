"""Runs of the command line, in this process or in one of their own, and what they leave behind."""

from __future__ import annotations

import contextlib
import csv
import io
import runpy
import subprocess
import sys
import types
import warnings
from pathlib import Path
from xml.etree import ElementTree

import h5py
import numpy as np
import pytest

DISK = ("-m", "softmodels.disk", "--section", "axisymmetric", "--no-pictures")
SOFT = ("--variant", "shadow", "--pressure-cm", "0,52.5,52.9,60", "--quiet")
REPEATED = 1e-9
"""Share of a column's largest value by which two runs of one case may differ: the lowest eigenvalue has been seen to differ in
its last digit on a busy machine."""


def start(*arguments, **options):
    """Start a Python process, its output kept as text; the words follow the interpreter's name."""
    command = [*map(str, options.pop("launcher", ())), sys.executable, *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)


def run(*arguments, cwd=None, **options):
    """Run Python to its end with these words: ``status``, ``out`` and ``err``.

    A module runs in this process, which has imported what takes its time. A process of its own is for other programs, for
    several ranks, for what draws (VTK does not live beside DOLFINx), and for words to PETSc, which would stay.
    """
    words = _without_budget([str(word) for word in arguments])
    apart = "--" in words or "draw" in words or any(word.startswith("--ranks") for word in words)
    if words[0] == "-m" and not apart and not any(options.values()):
        with contextlib.chdir(cwd or Path.cwd()), warnings.catch_warnings():
            warnings.filterwarnings("ignore", ".*found in sys.modules", RuntimeWarning)  # it has run before
            return called(lambda: runpy.run_module(words[1], run_name="__main__", alter_sys=True), *words[1:])
    process = start(*words, cwd=cwd, **options)
    out, err = process.communicate(timeout=300)
    return types.SimpleNamespace(status=process.returncode, out=out, err=err)


def _without_budget(words):
    """The words of a run that does not ask for its budget, without one: it is a second path."""
    solves = words[:3] == ["-m", "softmodels", "run"] or words[:2] in (["-m", "softmodels.disk"], ["-m", "softmodels.seminar"])
    if not solves or "--budget" in words or len(words) == 2:
        return words
    end = words.index("--") if "--" in words else len(words)
    return [*words[:end], "--budget", "none", *words[end:]]


def called(program, *words):
    """Call a program with these words as its command line, the first of them its name, as `run`."""
    status, before = 0, sys.argv
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
        sys.argv = list(map(str, words))
        try:
            program()
        except SystemExit as end:
            status = end.code or 0
        finally:
            sys.argv = before
    return types.SimpleNamespace(status=status, out=out.getvalue(), err=err.getvalue())


def disk(folder, *arguments, **options):
    """Run the axisymmetric disk without pictures into a folder."""
    return run(*DISK, "--output", folder, *arguments, **options)


def rows(folder):
    """The table of a folder of results; numbers as numbers, None for an empty cell."""
    with (folder / "path.csv").open() as file:
        return [
            {key: value if key == "control" else float(value) if value else None for key, value in row.items()}
            for row in csv.DictReader(file)
        ]


def readable(folder):
    """Number of states in a folder, after everything the XDMF refers to has been read."""
    xdmf = ElementTree.parse(folder / "disk.xdmf")
    places = {item.text: item.get("Dimensions") for item in xdmf.iter("DataItem")}
    for place, shape in places.items():
        name, inside = place.split(":")
        with h5py.File(folder / name) as file:
            assert np.isfinite(file[inside][:]).all() and " ".join(map(str, file[inside].shape)) == shape
    return len(xdmf.findall(".//Time"))


def same(found, wanted, tolerance):
    """Whether two tables hold the same numbers, to a share of each column's largest one."""
    assert [row["step"] for row in found] == [row["step"] for row in wanted]
    for name in wanted[0]:
        if name == "control":
            assert [row[name] for row in found] == [row[name] for row in wanted]
        elif name != "newton_iterations":
            assert [row[name] is None for row in found] == [row[name] is None for row in wanted]
            column = [row[name] or 0.0 for row in wanted]
            assert [row[name] or 0.0 for row in found] == pytest.approx(
                column, rel=0, abs=tolerance * np.nanmax(np.abs(column)), nan_ok=True
            ), name
