"""How runs end when something fails: a sentence, the right status, and the states so far."""

from __future__ import annotations

import os
import sys

import pytest
from click.shell_completion import ShellComplete
from ffcx.codegeneration import jit

import softmodels as sm
from geometries import ACTUATORS, meshing
from softmodels.__main__ import softmodels
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.cli.ending import main
from softmodels.disk import command
from softmodels.mechanics.compiling import report_waits, use_cache
from softmodels.runs.simulation import Simulation
from tests.support import runs
from tests.support.campaigns import sampled

STEPS = ("--pressure-cm", "0:177:5", "--quiet")


def test_a_failed_mesher_is_a_sentence_and_status_1(monkeypatch, capsys, tmp_path):
    import gmsh

    def broken(dimension):
        raise Exception("PLC Error: a segment and a facet intersect")  # what Gmsh raises

    monkeypatch.setattr(gmsh.model.mesh, "generate", broken)
    monkeypatch.setattr(meshing, "load_cached_mesh", lambda *_: False)
    monkeypatch.setattr(sys, "argv", ["disk", *STEPS, "--output", str(tmp_path / "disk")])
    with pytest.raises(SystemExit) as end:
        main(command)
    told = capsys.readouterr()
    assert end.value.code == 1 and told.out == "" and told.err.count("\n") == 1
    assert "HollowDisk" in told.err and "PLC Error" in told.err and "cell size" in told.err
    assert not (tmp_path / "disk").exists()  # nothing was made that a folder would be needed for


@pytest.mark.campaign
def test_a_solver_kept_from_converging_leaves_its_states(tmp_path):
    """One iteration of the linear solver is enough where the tangent was factorised close by, not on a plane that stops it."""
    plane = ("--contact", "top", "--contact-plane", "z = 30 mm")
    volumes = ("--variant", "shadow", "--volume-ml", "0:60", "--poisson", "0.49", "--quiet", *plane)
    done = runs.disk(tmp_path / "disk", *volumes, "--", "-ksp_max_it", "1")
    assert done.status == 1 and done.out == "" and done.err.count("\n") == 1
    assert "60 ml was not reached" in done.err and "linear solver failed" in done.err and "first try without them" in done.err
    rows = runs.rows(tmp_path / "disk")
    assert len(rows) > 1 and runs.readable(tmp_path / "disk") == len(rows) and f"({len(rows)} states" in done.err


@pytest.mark.parametrize(
    ("words", "status", "told"),
    [
        (["-ksp_max_it", "0"], 1, "linear solver failed"),
        (["-ksp_max_it", "many"], 2, "many"),
        (["-ksp_type", "magic"], 2, "magic"),
    ],
)
def test_words_that_petsc_cannot_use(words, status, told, tmp_path):
    done = runs.disk(tmp_path / "disk", *STEPS, "--", *words)
    assert done.status == status and done.err.count("\n") == 1 and "Traceback" not in done.err
    assert told in done.err and "PETSc" in done.err


def test_a_limit_point_is_found_and_told(limited):
    folder, done = limited
    assert done.status == 3 and done.out == "" and done.err.count("\n") == 1
    rows = runs.rows(folder)
    limits = [row for row in rows if row["limit"]]
    assert len(limits) == 1 and len(rows) - rows.index(limits[0]) in range(2, 6)
    assert limits[0]["pressure_cm"] == max(row["pressure_cm"] for row in rows) < 60 and rows[-1]["pressure_cm"] > 40
    assert rows[-1]["added_volume_ml"] > 1.1 * limits[0]["added_volume_ml"]
    assert [row["pressure_cm"] for row in rows if row["requested"]] == [0, 52.5, 52.9]
    for name, unit in (("pressure_cm", "cm"), ("apex_mm", "mm"), ("added_volume_ml", "ml")):
        assert f"{limits[0][name]:.4g} {unit}" in done.err, name
    assert "no equilibrium at 60 cm" in done.err and "--volume-ml" in done.err and f"({len(rows)} states)" in done.err
    assert runs.readable(folder) == len(rows)


def test_no_compiler_is_a_sentence(tmp_path):
    without = {**os.environ, "CC": "/no/compiler", "XDG_CACHE_HOME": str(tmp_path / "cache")}
    done = runs.disk(tmp_path / "disk", *STEPS, env=without)
    assert done.status == 1 and done.out == "" and done.err.count("\n") == 1
    assert "cannot be compiled" in done.err and "/no/compiler" in done.err and "doctor" in done.err


@pytest.mark.parametrize(
    ("job", "status", "sentence"),
    sampled([(True, 130, "stopped by the user"), (False, 1, "SIGTERM ended the C compiler")]),
)
def test_a_signal_during_compilation_is_no_missing_compiler(job, status, sentence, tmp_path):
    """A batch queue ends all processes of a job at once."""
    compiler, once = tmp_path / "cc", f"mkdir {tmp_path}/once 2>/dev/null && kill -TERM $PPID\n" if job else ""
    compiler.write_text(f"#!/bin/sh\n{once}kill -TERM $$\n")
    compiler.chmod(0o755)
    without = {**os.environ, "CC": str(compiler), "XDG_CACHE_HOME": str(tmp_path / "cache")}
    done = runs.disk(tmp_path / "disk", *STEPS, env=without)
    assert done.status == status and done.out == "" and done.err.count("\n") == 1
    assert sentence in done.err and "compiler is needed" not in done.err


def test_a_kernel_is_waited_for_and_one_that_a_killed_run_left_half_compiled_is_made_anew(tmp_path, monkeypatch):
    """Only for kernels that are asked for: FFCx itself would wait for ten seconds, and end with a TimeoutError."""
    young, old, other = (tmp_path / f"libffcx_forms_{name}.c" for name in ("young", "old", "other"))
    for source in (young, old, other):
        source.touch()
    os.utime(old, (0, 0))
    said, asked = [], []

    def finished():
        young.with_suffix(".c.cached").touch()

    def look_up(name, objects, folder, timeout):
        asked.append((name, [file.name for file in sorted(tmp_path.iterdir())]))
        return (None, None)

    monkeypatch.setattr(jit, "get_cached_module", look_up)
    use_cache()
    with report_waits(said.append, finished):
        for source in (young, old):
            jit.get_cached_module(source.stem, [], tmp_path, 1)
    assert len(said) == 1 and "compile" in said[0]
    rest = ["libffcx_forms_other.c", "libffcx_forms_young.c", "libffcx_forms_young.c.cached"]
    assert asked == [(young.stem, sorted([*rest, old.name])), (old.stem, rest)]


def test_waiting_in_vain_for_a_compiler_is_a_sentence(monkeypatch):
    def late(self, begun=None):
        raise TimeoutError("JIT compilation timed out")

    monkeypatch.setattr(Simulation, "steps", late)
    disk = sm.HollowDisk(section="axisymmetric", cell_size=6e-3, refinement=1.0)
    with pytest.raises(sm.RunError, match="compiling the same kernels, or was killed while doing so; run again"):
        sm.inflate(disk, sm.NeoHookean(20e3), pressures="0,5 cm")


def test_the_callers_folder_is_left_once_and_only_from_option_files(tmp_path):
    text = """
import os
from pathlib import Path
left, real = [], os.chdir
os.chdir = lambda place: (left.append(place), real(place))
from softmodels.mechanics.mpi import start
here = os.getcwd()
for name in {files}:
    Path(name).write_text("{{}}")
for _ in range(3):
    start()
assert os.getcwd() == here
print(len(left))
"""
    for files, count in (("()", 0), ("('dolfinx_jit_options.json',)", 1)):
        done = runs.run("-c", text.format(files=files), cwd=tmp_path)
        assert (done.status, done.out, done.err) == (0, f"{count}\n", "")


@pytest.mark.campaign
def test_a_case_files_solver_is_replaced_and_its_run_resumed_by_the_other(tmp_path):
    """A rigid plate on a membrane: begun by iterations, resumed by a factorisation."""
    text = '[geometry]\ndevice = "Membrane"\nplate_radius = "8 mm"\n[rigid.plate]\nface = "plate"\n[load]\nvolume_ml = "{}"\n'
    for name, volumes in (("begun", "0,5"), ("whole", "0,5,8")):
        (tmp_path / f"{name}.toml").write_text(f'name = "lifted"\n{text.format(volumes)}')
    run = ("-m", "softmodels", "run", "--no-pictures", "--ranks", "1")
    folders = [tmp_path / name for name in ("both", "direct")]
    begun = runs.run(*run, tmp_path / "begun.toml", "--solver", "iterative", "-o", folders[0])
    assert begun.status == 0 and 'method = "iterative"' in (folders[0] / "case.toml").read_text(), begun.err
    done = runs.run(*run, tmp_path / "whole.toml", "--solver", "direct", "-o", folders[0], "--resume")
    assert done.status == 0 and 'method = "direct"' in (folders[0] / "case.toml").read_text(), done.err
    assert runs.run(*run, tmp_path / "whole.toml", "-o", folders[1]).status == 0
    both, direct = ([row for row in runs.rows(folder) if row["requested"]] for folder in folders)
    for key in ("pressure_Pa", "plate_z_mm", "stored_energy_mJ"):
        assert [row[key] for row in both] == pytest.approx([row[key] for row in direct], rel=1e-8)


# -- ``softmodels run --device NAME``: any registered device by its options ------------------------------------------


MEMBRANE = ("-m", "softmodels", "run", "--device", "membrane", "--thickness", "2mm", "--cell-size", "2mm",
            "--pressure-cm", "0,10", "--quiet", "--no-pictures")  # fmt: skip


def test_it_runs(tmp_path):
    """The name may be written in small letters; the folder's case names the device, and repeats the run."""
    done = runs.run(*MEMBRANE, "--output", tmp_path / "one")
    assert done.status == 0, done.err
    last = runs.rows(tmp_path / "one")[-1]
    assert last["pressure_cm"] == 10.0 and last["apex_mm"] > 1.0
    case = Case.from_file(tmp_path / "one" / "case.toml")
    assert type(case.actuator).__name__ == "Membrane" and case.actuator.thickness == 0.002


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("run", "--device", "Balloons", "--pressure-cm", "1"), "--device is 'Balloons'; it must be one of"),
        (("run", "--device"), "--device is ''"),
        (("run", "--device", "Membrane"), "request either pressures"),
        (("run", "--device=Membrane", "--pressure-cm", "1", "--thickness", "1m"), "thickness is 1 m"),
        (("run", "--device", "Membrane", "--wall", "1mm"), "there is no option --wall"),
        (
            ("run", "disk.toml", "--pressure-cm", "0:5"),
            "--pressure-cm goes with --device NAME; what a case FILE requests",
        ),
        (("run", "disk.toml", "--presume"), "there is no option --presume; did you mean --resume?"),
        (("run", "disk.toml", "--solver", "dirct"), "did you mean direct?"),
        (("run", "--device", "Membrane", "--pressure", "0:4"), "has no unit; write it like 0:177 cm or 0:17 kPa\n"),
        (("design", "dsk.toml"), "No such file or directory; did you mean disk.toml?"),
        (("study", "dsk.toml"), "No such file or directory; did you mean disk.toml?"),
        (("compare", "results/dsk", "results/disk"), "there is no such folder; did you mean results/disk?"),
        (("draw", "results/dsk"), "there is no such folder; did you mean results/disk?"),
        (("open", "results/dsk"), "did you mean results/disk?"),
        (("run", "case.toml", "--device", "Membrane", "--pressure-cm", "1"), "unexpected argument 'case.toml'"),
        (("run",), "Missing argument 'FILE'"),
        (("run", "none.toml", "--", "--device"), "none.toml"),
    ],
)
def test_what_cannot_be_meant_is_one_sentence(ended, words, told, tmp_path, monkeypatch):
    """With the name that was meant, of options, choices, files and folders alike."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "disk.toml").touch()
    (tmp_path / "results" / "disk").mkdir(parents=True)
    status, out, err = ended(softmodels, *words)
    assert status == 2 and told in err and err.count("\n") == 1 and not out


@pytest.mark.parametrize(
    ("words", "completed"),
    [
        ("softmodels run --device Pn", ["PneuNet"]),
        ("softmodels limit --device b", ["Balloon", "Beam", "Bellows", "BendingBellows"]),
        ("softmodels run --device Pneu --pressure-c", []),
        ("softmodels run --device PneuNet --pressure-c", ["--pressure-cm"]),
    ],
)
def test_tab_completes_devices_and_prints_no_error(words, completed):
    *before, begun = words.split()
    comp = ShellComplete(softmodels, {}, "softmodels", "_SOFTMODELS_COMPLETE")
    assert [item.value for item in comp.get_completions(before[1:], begun)] == completed


def test_every_entry_of_a_load_is_listed():
    with pytest.raises(CaseError, match=r"unknown entry 'shares'; known are .*share, force_N, travel_mm.* did you mean share"):
        Case.from_toml("[geometry]\ndevice = 'Beam'\n[load]\nshares = 1")


@pytest.mark.parametrize("name", ACTUATORS)
def test_every_device_has_its_help(ended, name):
    status, out, _ = ended(softmodels, "run", "--device", name, "--help")
    assert status == 0 and f"run --device {name} --pressure-cm {ACTUATORS[name].pressures}" in out


# -- Machines that lack something: what is missing is named, and nothing else is blamed for it -----------------------


RUN = """
import sys
from pathlib import Path
import softmodels.mechanics.iterative, softmodels.mechanics.mpi
{change}
from softmodels.{module} import {names}
{main}
"""
DISK = {"module": "disk", "names": "command", "main": "from softmodels.cli.ending import main; main(command)"}
WHOLE = {"module": "__main__", "names": "main", "main": "main()"}
SMALL = ("--pressure-cm", "0:20", "--section", "axisymmetric", "--no-pictures")
NO_MEMORY = "softmodels.mechanics.newton.OUT_OF_MEMORY = (0,)"  # what MUMPS reports where all is well
NO_SHARED_MEMORY = "softmodels.mechanics.mpi.SHARED_MEMORY = Path('/proc/none')"


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="/proc and /dev/shm are Linux's")
@pytest.mark.parametrize(
    ("program", "words", "change", "told"),
    [
        (DISK, SMALL, NO_MEMORY, "out of memory; use a larger --cell-size"),
        (WHOLE, ("limit", "--variant", "shadow"), NO_MEMORY, "out of memory; use a larger --cell-size"),
        (DISK, SMALL, NO_SHARED_MEMORY, "needs shared memory, and /proc/none cannot be written"),
        (WHOLE, ("limit", "--variant", "shadow"), "", "kernel cache /proc/none/fenics cannot be used"),
    ],
)
def test_what_is_missing_is_named(program, words, change, told, tmp_path, monkeypatch):
    if not change:
        monkeypatch.setenv("XDG_CACHE_HOME", "/proc/none")
    done = runs.run("-c", RUN.format(change=change, **program), *words, cwd=tmp_path)
    last = done.err.strip().splitlines()[-1]
    assert done.status == 1 and told in last and "Traceback" not in done.err, done.err
    assert "refine the mesh" not in last and "free some disk space" not in last


BLOCKED = """
import runpy, sys
class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("dolfinx", "dolfinx_solver", "petsc4py", "slepc4py", "mpi4py", "ufl", "basix", "ffcx"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Missing())
sys.argv = sys.argv[1:]
runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
"""


def test_photographs_curves_and_meshes_need_no_fenicsx(tmp_path):
    (tmp_path / "pull.csv").write_text("stretch,stress_kPa\n" + "".join(
        f"{1 + k / 10:.1f},{28 * (1 + k / 10 - (1 + k / 10) ** -2):.4f}\n" for k in range(1, 15)
    ))  # fmt: skip
    fit = ("softmodels", "fit", "--tensile", "pull.csv", "--material", "yeoh", "--no-pictures", "-o", "fit")
    for words in (fit, ("geometries", "HollowDisk", "-o", "disk.msh"), ("measurement", "--help")):
        done = runs.run("-c", BLOCKED, *words, cwd=tmp_path)
        assert done.status == 0, done.err
    assert (tmp_path / "fit" / "fitted.toml").is_file() and (tmp_path / "disk.msh").is_file()
    done = runs.run("-c", BLOCKED, "softmodels", "run", "--device", "Balloon", "--pressure-cm", "0:2", cwd=tmp_path)
    assert done.status == 1 and "the simulation needs FEniCSx (softmodels doctor lists what is missing)" in done.err
