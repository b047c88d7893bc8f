"""The door: what a notebook writes, and what a library call leaves alone."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

import softmodels as sm
from softmodels.common.units import COLUMN
from softmodels.design.trials import Squares
from softmodels.fitting.curves.curve import TensileCurve
from softmodels.runs import outcomes
from softmodels.runs.simulation import Simulation

CM = COLUMN.pascal
COARSE = {"section": "axisymmetric", "cell_size": 6e-3, "refinement": 1.0}
LAW = sm.Yeoh(14e3, 60.0)
BALLOONS = sm.HollowDisk(membrane=1e-3, **COARSE)
"""Has a limit point near 36 cm in a soft silicone."""
HEAD = """
import os
import sys
import tomllib
from pathlib import Path

import softmodels as sm

COARSE = {"section": "axisymmetric", "cell_size": 6e-3, "refinement": 1.0}
"""


def script(text, *, launcher=(), folder=None):
    """Run lines in a process of their own, after `HEAD`; their standard output."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "MPIR_CVAR_CH4_PROGRESS_THROTTLE": "1"}
    command = [*map(str, launcher), sys.executable, "-c", HEAD + text]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, cwd=folder, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    assert not done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def run():
    return sm.inflate(sm.HollowDisk(section="axisymmetric"), LAW, pressures="0:177 cm")


@pytest.fixture(scope="module")
def folder(run, tmp_path_factory):
    return run.save(tmp_path_factory.mktemp("door") / "disk")


@pytest.fixture(scope="module")
def ballooned():
    return sm.inflate(BALLOONS, sm.NeoHookean(20e3), pressures="0:100 cm")


def test_the_example(monkeypatch, tmp_path, capfd):
    monkeypatch.chdir(tmp_path)

    disk = sm.HollowDisk(section="axisymmetric")
    run = sm.inflate(disk, sm.Yeoh(14e3, 60.0), pressures="0:177 cm")
    assert len(run.pressure) == len(run.apex) == len(run.added_volume) == len(run)
    assert run.limit is None
    state = run.at("70 cm")
    assert state.von_mises.shape == state.J.shape == (state.grid.n_points,)
    figure = run.plot()
    run.save("results/disk")
    again = sm.load("results/disk")
    limit = sm.limit(disk, sm.silicone("ecoflex-00-30/marechal-2021"))

    assert run.pressure[-1] == pytest.approx(177 * CM, rel=1e-12)
    assert (np.diff(run.apex) > 0).all()
    assert run.apex[-1] == pytest.approx(4.232e-3, rel=1e-3)
    assert state.pressure == pytest.approx(70 * CM, rel=1e-9)
    assert state.row["pressure_cm"] == pytest.approx(70, rel=1e-9)
    assert np.interp(state.pressure, run.pressure, run.added_volume) == pytest.approx(state.added_volume, rel=2e-2)
    assert "cm, 0.97 g/ml" in figure.axes[0].get_xlabel()
    assert figure._repr_png_()[:4] == b"\x89PNG"
    assert again.pressure.tolist() == run.pressure.tolist()
    assert limit.kind == "limit"
    assert limit.pressure == pytest.approx(11974, rel=1e-3)
    assert capfd.readouterr() == ("", "")


def test_a_saved_folder_is_the_command_lines(folder, tmp_path):
    words = [
        "--section",
        "axisymmetric",
        "--material",
        "yeoh",
        "--c1",
        "14kPa",
        "--c2",
        "60Pa",
        "--pressure-cm",
        "0:177",
        "--budget",
        "none",
    ]
    subprocess.run(
        [sys.executable, "-m", "softmodels.disk", *words, "--no-pictures", "--quiet", "-o", str(tmp_path / "disk")],
        check=True, env={**os.environ, "OMP_NUM_THREADS": "1"},
    )  # fmt: skip
    for name in ("case.toml", "path.csv", "disk.xdmf", "summary.json"):
        assert (folder / name).read_text() == (tmp_path / "disk" / name).read_text()
    assert {file.name for file in folder.iterdir()} == {file.name for file in (tmp_path / "disk").iterdir()}


def test_a_loaded_run_is_the_same_and_needs_no_solver(run, folder):
    text = f"""
sys.modules["dolfinx"] = sys.modules["petsc4py"] = sys.modules["mpi4py"] = None
run = sm.load({str(folder)!r})
state = run.at("177 cm")
print(len(run), run.apex[-1].hex(), state.von_mises.max().hex(), state.grid.n_cells, run.limit)
"""
    state = run.at("177 cm")
    expected = [len(run), run.apex[-1].hex(), state.von_mises.max().hex(), state.grid.n_cells, None]
    assert script(text).split() == list(map(str, expected))


def test_a_loaded_run_can_be_saved_elsewhere(folder, tmp_path):
    copy = sm.load(folder).save(tmp_path / "copy")
    assert (copy / "path.csv").read_text() == (folder / "path.csv").read_text()
    both = [sm.load(place).last.fields for place in (folder, copy)]
    assert all(np.array_equal(both[0][name], both[1][name]) for name in both[0])


@pytest.mark.parametrize(
    ("pressures", "cm"),
    [
        ("0:30 cm", (0, 30)), ("0:30:10cm", (0, 10, 20, 30)), ("10,30 cm", (10, 30)),
        (np.array([0.0, 10.0, 30.0]) * CM, (0, 10, 30)), (30 * CM, (30,)), (f"0:{30 * CM / 1e3!r} kPa", (0, 30)),
    ],
)  # fmt: skip
def test_pressures_are_texts_with_a_unit_or_pascals(pressures, cm):
    case = sm.inflate(sm.HollowDisk(**COARSE), LAW, pressures).case
    assert case.values == pytest.approx([CM * height for height in cm], rel=1e-12)
    assert case.load.told(case.values[-1]) == "30 cm"


def test_volumes_and_strokes():
    disk = sm.HollowDisk(**COARSE)
    by_text = sm.inflate(disk, LAW, volumes="0,2 ml")
    by_number = sm.inflate(disk, LAW, volumes=np.array([0.0, 2e-6]))
    assert by_text.added_volume[-1] == pytest.approx(2e-6, rel=1e-9)
    assert by_number.pressure[-1] == pytest.approx(by_text.pressure[-1], rel=1e-9)
    syringe = sm.inflate(disk, LAW, strokes="0,4 ml", supply=sm.Syringe(syringe=10e-6, dead_volume=1e-6))
    assert 0 < syringe.added_volume[-1] < 4e-6  # the rest is the gas, squeezed
    assert syringe.at("4 ml").pressure == syringe.pressure[-1]


@pytest.mark.parametrize(
    ("load", "words"),
    [
        ({"pressures": "0:177"}, "no unit; write it like 0:177 cm"),
        ({"pressures": "0:177 furlongs"}, "unknown unit"),
        ({"pressures": "0:60 ml"}, "unknown unit"),
        ({"pressures": "cm"}, "not a list of numbers"),
        ({"pressures": [500.0, 300.0]}, "falls from"),
        ({"pressures": ["a"]}, "unknown unit, 'a'"),
        ({"pressures": [None]}, "neither numbers nor a text"),
        ({"volumes": "0:60 cm"}, "unknown unit"),
        ({}, "request either pressures"),
        ({"pressures": "0:10 cm", "volumes": "0:1 ml"}, "request either pressures"),
        ({"pressures": "0:10 cm", "control": "will"}, "control is 'will'"),
    ],
)
def test_what_cannot_be_meant_is_a_sentence(load, words):
    with pytest.raises(sm.CaseError, match=words):
        sm.inflate(sm.HollowDisk(**COARSE), LAW, **load)


def test_unknown_silicones_are_named():
    with pytest.raises(sm.MaterialError, match="known are ecoflex-00-10"):
        sm.silicone("ecoflex")


@pytest.mark.campaign
def test_a_run_past_its_limit_point_comes_back_with_it(ballooned, tmp_path):
    limit = ballooned.limit
    assert limit.kind == "limit"
    assert limit.pressure == ballooned.pressure.max() == pytest.approx(36 * CM, rel=0.02)
    assert "the pressure has a limit point at" in limit.why
    assert sm.load(ballooned.save(tmp_path / "disk")).limit == limit
    with pytest.raises(sm.RunError, match=r"no state at 60 cm: its pressures go from 0 cm to 3.\.\d+ cm; no equilibrium at"):
        ballooned.at("60 cm")
    assert limit.pressure == pytest.approx(sm.limit(BALLOONS, sm.NeoHookean(20e3)).pressure, rel=1e-6)


def test_a_run_without_a_state_under_load_raises(monkeypatch):
    def ends_at_rest(self, begun=None):
        yield from (step for step, _ in zip(real(self), range(1), strict=False))
        raise outcomes.PathEnded("no step of any length succeeded", 1)

    real = Simulation.steps
    monkeypatch.setattr(Simulation, "steps", ends_at_rest)
    with pytest.raises(sm.RunError, match="no step of any length succeeded"):
        sm.inflate(sm.HollowDisk(**COARSE), LAW, pressures="0:30 cm")


def test_states_between_the_steps_are_solved_for(ballooned):
    before, after = ballooned.pressure[3], ballooned.pressure[4]
    state = ballooned.at(0.3 * before + 0.7 * after)
    assert state.pressure == pytest.approx(0.3 * before + 0.7 * after, rel=1e-9)
    straight = sm.inflate(BALLOONS, sm.NeoHookean(20e3), pressures=[state.pressure])
    assert np.allclose(state.displacement, straight.last.displacement, rtol=0, atol=1e-12)
    grid = state.grid
    assert {"displacement", "p", "von_mises", "largest_stretch", "J"} <= set(grid.point_data)
    for name in grid.point_data:  # one name in the grid, in the files and as an attribute
        assert np.array_equal(grid.point_data[name], getattr(state, name))
    assert grid.warp_by_vector("displacement").bounds[5] > grid.bounds[5]


def arrays_of(thing, found, seen, depth=0):
    """All arrays that can be reached from an object by public attributes, with how they are reached."""
    if depth > 7 or id(thing) in seen:
        return found
    seen[id(thing)] = thing  # kept, so that no other object gets its number
    if isinstance(thing, np.ndarray):
        return [*found, thing]
    if isinstance(thing, Mapping):
        return [array for value in thing.values() for array in arrays_of(value, found, seen, depth + 1)]
    if isinstance(thing, list | tuple):
        return [array for value in thing for array in arrays_of(value, found, seen, depth + 1)]
    if not type(thing).__module__.startswith(("softmodels", "geometries", "measurement")) or isinstance(thing, type):
        return found
    for name in dir(thing):
        if name.startswith("_") or name in ("grid", "problem", "case"):
            continue
        value = getattr(thing, name, None)
        if not callable(value):
            found = found + arrays_of(value, [], seen, depth + 1)
    return found


@pytest.mark.campaign
def test_the_runs_arrays_are_its_own(ballooned, tmp_path):
    """What a user does with an array of a run changes neither the run, nor what is solved from it, nor what it saves."""
    before = ballooned.save(tmp_path / "before")
    between = 0.4 * ballooned.pressure[4] + 0.6 * ballooned.pressure[5]
    kept = {name: values.copy() for name, values in ballooned.at(between).fields.items()}
    for run in (ballooned, sm.load(before)):
        for state in (*run, run.at(between), run.at(run.pressure[3])):
            for array in arrays_of(state, [], {}):
                with pytest.raises(ValueError, match="read-only"):
                    array *= 1000
            with pytest.raises(TypeError):
                state.fields["J"] = 0.0
            for array in (state.grid.points, *state.grid.point_data.values()):
                array[...] = 7
        for column in run.path.values():
            if column.dtype == float:
                column *= 1e3
        for array in arrays_of(run, [], {}):
            if array.flags.writeable:
                array[...] = 0
        run.rows.clear()
        path = run.path
        path.clear()
    after = ballooned.save(tmp_path / "after")
    for name in ("path.csv", "summary.json", "case.toml"):
        assert (before / name).read_text() == (after / name).read_text()
    for one, other in zip(sm.load(before), sm.load(after), strict=True):
        assert all(np.array_equal(one.fields[name], other.fields[name]) for name in one.fields)
    assert all(np.array_equal(ballooned.at(between).fields[name], values) for name, values in kept.items())
    assert ballooned.at(between).grid.points.max() < 1.0
    again = ballooned.at(0.5 * between + 0.5 * ballooned.pressure[4])
    assert again.displacement.max() < 0.1


def test_arrays_of_fits_are_their_own():
    stretch = np.linspace(1.05, 2.5, 12)
    stress = 14e3 * (stretch - stretch**-2)
    curve = TensileCurve("pull", "uniaxial", stretch, stress)
    report = sm.fit_curves(curve, "neo-hookean,yeoh", sm.FitOptions(profiles=True))
    stress *= 1000
    assert curve.stress[0] == pytest.approx(14e3 * (1.05 - 1.05**-2))
    found = arrays_of(report, [], {})
    assert len(found) > 10
    assert not [array for array in found if array.flags.writeable]
    followed = Squares.of(np.array([1.0, 2.0]), np.array([[1.0], [0.5]]))
    assert not followed.triangle.flags.writeable


def test_progress_only_where_it_is_asked_for(capfd):
    heights = []
    disk = sm.HollowDisk(**COARSE)
    run = sm.inflate(disk, LAW, pressures="0,30 cm", progress=lambda row: heights.append(row["pressure_cm"]))
    assert heights == run.path["pressure_cm"].tolist()
    assert capfd.readouterr() == ("", "")
    sm.inflate(disk, LAW, pressures="0,30 cm", progress=True)
    out, err = capfd.readouterr()
    assert not out
    assert "apex rise" in err


def test_every_public_name_is_there_and_typed():
    for name in sm.__all__:
        assert getattr(sm, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'balloon'"):
        sm.balloon  # noqa: B018


def test_importing_is_quick():
    text = """
heavy = {"numpy", "click", "dolfinx", "petsc4py", "matplotlib", "pint"}
assert not heavy & sys.modules.keys()
sm.HollowDisk, sm.Yeoh, sm.inflate
assert not {"dolfinx", "petsc4py", "mpi4py", "matplotlib", "pyvista"} & sys.modules.keys()
"""
    assert not script(text)


def test_a_commands_options_need_no_solver():
    text = """
from softmodels.cli.options import device_command
from softmodels.case.case import Case
from softmodels.case.load import steps_of

command = device_command(sm.HollowDisk, "softmodels.disk", ())
assert "--membrane" in command.get_help(command.make_context("softmodels.disk", ["--pressure-cm", "0:177"]))
case = Case("disk", sm.HollowDisk(membrane=3e-3), sm.Yeoh(14e3, 60.0), steps_of(pressure_cm=(0.0, 177.0)))
assert Case.from_toml(case.to_toml()) == case
used = {"pint", "h5py", "gmsh", "rich", "scipy.sparse", "scipy.linalg", "scipy.spatial", "dolfinx", "matplotlib"}
assert not used & sys.modules.keys(), used & sys.modules.keys()
"""
    assert not script(text)


def test_a_thread_is_enough_and_no_signal_is_handled():
    text = """
import threading

def handlers():
    return [line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith(("SigIgn", "SigCgt"))]

try:
    import dolfinx_solver  # MPI's own handlers are set here
except ImportError:
    from mpi4py import MPI
before, runs = handlers(), []

def work():
    runs.append(sm.inflate(sm.HollowDisk(**COARSE), sm.Yeoh(14e3), pressures="0,5 cm"))

thread = threading.Thread(target=work)
thread.start()
thread.join()
assert len(runs[0]) > 1
assert handlers() == before, (before, handlers())
"""
    assert not script(text)


@pytest.mark.campaign
def test_threads_take_turns(tmp_path):
    """Each call of the door by two threads at a time, begun at once: what each returns alone."""
    text = f"""
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np

disks = [sm.HollowDisk(**COARSE, membrane=thickness) for thickness in (5e-3, 6e-3)]
law, folder = sm.Yeoh(14e3, 60.0), Path({str(tmp_path)!r})
stretch = np.linspace(1.1, 2.0, 8)
curve = sm.TensileCurve("pull", "uniaxial", stretch, 14e3 * (stretch - stretch**-2))

def inflated(k):
    return sm.inflate(disks[k], law, "0,5 cm")

def stored(k):
    return sm.inflate(disks[k], law, "0,5 cm", folder=folder / str(k)).apex[-1]

def between(k):
    return runs[k].at("3 cm").pressure, sm.load(runs[k].save(folder / f"saved{{k}}")).at("4 cm").added_volume

def meshed(k):
    return disks[k].write(folder / f"{{k}}.msh").stat().st_size

def fitted(k):
    return sm.fit_curves(curve, "yeoh").material.c1 + sm.score(law, curve)[0].rms

with ThreadPoolExecutor(2) as pool:
    runs = list(pool.map(inflated, [0, 1]))  # the first to start MPI, PETSc and the compiler
    for call in (stored, between, meshed, fitted):
        barrier = threading.Barrier(2)
        def both(k):
            barrier.wait()
            return call(k)
        together = list(pool.map(both, [0, 1]))
        assert all(np.allclose(found, call(k), rtol=1e-9) for k, found in enumerate(together)), (call, together)
alone = [inflated(k) for k in (0, 1)]
assert all(np.array_equal(one.apex, other.apex) for one, other in zip(runs, alone)) and alone[0].apex[-1] > alone[1].apex[-1]
"""
    assert not script(text)


@pytest.mark.campaign
def test_thirty_devices_leave_memory_and_communicators_as_they_were():
    text = """
import ctypes
import gc

from mpi4py import MPI

def memory():
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)  # what the allocator keeps for later is no leak
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20

def free():
    made = []
    try:
        while len(made) < 4000:
            made.append(MPI.COMM_SELF.Dup())
    except MPI.Exception:
        pass
    for comm in made:
        comm.Free()
    return len(made)

for k in range(30):
    disk = sm.HollowDisk(membrane=2e-3 + 1e-5 * k, **COARSE)
    assert sm.inflate(disk, sm.Yeoh(14e3, 60.0), pressures=[1500.0]).apex[-1] > 0
    if k == 9:  # what the first ones keep is kept once
        before = memory(), free()
print(memory() - before[0], before[1] - free())
"""
    grown, lost = map(float, script(text).split())
    assert grown < 5.0  # MB in 20 devices
    assert lost <= 0


def test_versions_agree_and_the_packages_are_typed():
    top = Path(sm.__file__).parents[1]
    told = subprocess.run([sys.executable, "-m", "softmodels", "--version"], capture_output=True, text=True, check=True)
    assert told.stdout == f"softmodels, version {sm.__version__}\n"
    assert tomllib.loads((top / "pyproject.toml").read_text())["project"]["version"] == sm.__version__
    assert all((top / package / "py.typed").exists() for package in ("softmodels", "geometries", "measurement"))
