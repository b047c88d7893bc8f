"""Standing in somebody else's folder: nothing in it is run, and nothing in it changes the numbers."""

from __future__ import annotations

import json

import pytest

from geometries import HollowDisk
from geometries.apart import apart

WRITER = """
import pathlib
pathlib.Path({hit!r}).touch()
"""


@pytest.fixture
def foreign(tmp_path, monkeypatch):
    """A folder with files that Python, PETSc, DOLFINx and FFCx look for where they start, and a file that shows a hit."""
    folder, hit = tmp_path / "foreign", tmp_path / "hit"
    folder.mkdir()
    for name in ("pickle.py", "vtkmodules.py", "pyvista.py", "sitecustomize.py", "h5py.py"):
        (folder / name).write_text(WRITER.format(hit=str(hit)))
    for name in (".petscrc", "petscrc"):
        (folder / name).write_text("-snes_max_it 0\n-log_view\n")
    (folder / "dolfinx_jit_options.json").write_text(json.dumps({"cffi_extra_compile_args": ["-fplugin=missing"]}))
    (folder / "ffcx_options.json").write_text(json.dumps({"epsilon": 1e-2}))
    monkeypatch.chdir(folder)
    return hit


def test_a_run_there_is_the_run_of_elsewhere(foreign, whole, runs, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))  # so that the equations are compiled there
    started = "from softmodels.disk import command; from softmodels.cli.options import main; main(command)"
    done = runs.run("-P", "-c", started, *runs.DISK[2:], "--pressure-cm", "0:177:5", "--output", tmp_path / "run")
    assert done.status == 0, done.err
    assert "PETSc" not in done.out and not foreign.exists()
    assert runs.rows(tmp_path / "run") == runs.rows(whole[0])


def test_a_meshers_process_takes_no_module_from_there(foreign, tmp_path):
    assert apart(HollowDisk(section="axisymmetric", fillet=0).write, tmp_path / "disk.msh").exists()
    assert not foreign.exists()
