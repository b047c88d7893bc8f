"""Somebody else's folder: nothing in it is run, nothing in it changes the numbers, and it shows no other file's bytes."""

from __future__ import annotations

import json
import os
import shutil

import h5py
import numpy as np
import pytest

import softmodels as sm
from geometries import HollowDisk
from geometries.meshing import apart
from tests.support import runs

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


def test_a_run_there_is_the_run_of_elsewhere(foreign, whole, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))  # so that the equations are compiled there
    started = "from softmodels.disk import command; from softmodels.cli.options import main; main(command)"
    done = runs.run("-P", "-c", started, *runs.DISK[2:], "--pressure-cm", "0:177:5", "--output", tmp_path / "run")
    assert done.status == 0, done.err
    assert "PETSc" not in done.out and not foreign.exists()
    runs.same(runs.rows(tmp_path / "run"), runs.rows(whole[0]), runs.REPEATED)


def test_a_meshers_process_takes_no_module_from_there(foreign, tmp_path):
    assert apart(HollowDisk(section="axisymmetric", fillet=0).write, tmp_path / "disk.msh").exists()
    assert not foreign.exists()


SECRET = b"the user's own secret, and nobody else's" * 4000


@pytest.fixture
def theirs(half_section, tmp_path):
    """A folder of results, to be changed."""
    return shutil.copytree(half_section, tmp_path / "theirs")


def external(file, name, secret):
    shape = file[name].shape
    del file[name]
    file.create_dataset(name, shape, "f8", external=[(str(secret), 0, h5py.h5f.UNLIMITED)])


def virtual(file, name, secret):
    shape = file[name].shape
    del file[name]
    with h5py.File(f"{secret}.h5", "w") as other:
        other["x"] = np.frombuffer(SECRET[: 8 * int(np.prod(shape))]).reshape(shape)
    layout = h5py.VirtualLayout(shape, "f8")
    layout[:] = h5py.VirtualSource(f"{secret}.h5", "x", shape)
    file.create_virtual_dataset(name, layout)


def linked(file, name, secret):
    with h5py.File(f"{secret}.h5", "w") as other:
        other["x"] = np.zeros(file[name].shape)
    del file[name]
    file[name] = h5py.ExternalLink(f"{secret}.h5", "/x")


def unwritten(file, name, secret):
    del file[name]
    file.create_dataset(name, (1 << 40, 3), "f8", chunks=(1024, 3))


@pytest.mark.parametrize("trick", [external, virtual, linked, unwritten])
@pytest.mark.parametrize("name", ["mesh/points", "steps/0002/displacement", "steps/0003/largest_stretch"])
def test_results_show_no_other_files_bytes(theirs, tmp_path, trick, name):
    secret = tmp_path / "secret.bin"
    secret.write_bytes(SECRET)
    with h5py.File(theirs / "disk.h5", "a") as file:
        trick(file, name, secret)
    with pytest.raises(
        sm.ResultsError, match=f"cannot be read .{name if 'mesh' in name else name[11:]} (takes|is a|is compressed)"
    ):
        sm.load(theirs)


@pytest.mark.parametrize("name", ["disk.h5", "case.toml", "summary.json", ".softmodels.json"])
def test_no_pipe_in_them_is_waited_for(theirs, name):
    (theirs / name).unlink(missing_ok=True)
    os.mkfifo(theirs / name)
    refused = {"disk.h5": sm.ResultsError, "case.toml": sm.CaseError}
    if name in refused:
        with pytest.raises(refused[name], match="it is a named pipe, not a regular file"):
            sm.load(theirs)
    else:
        assert len(sm.load(theirs)) == 6
