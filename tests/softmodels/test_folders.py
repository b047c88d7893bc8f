"""Folders of results: what is not a run's own stays as it is, and a run's own stays until there is something in its place."""

from __future__ import annotations

import dataclasses
import errno
import json
import os
import shutil
import socket
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

import softmodels as sm
from geometries import HollowDisk
from geometries.meshing import apart
from softmodels.__main__ import softmodels
from softmodels.case.case import Case, difference, identity
from softmodels.case.load import steps_of
from softmodels.case.materials import DEFAULT
from softmodels.common import folders
from softmodels.common.folders import OwnFolder
from softmodels.components.contact import Obstacle
from softmodels.disk import command
from softmodels.runs import formats
from softmodels.runs.store import Results
from softmodels.runs.table import Row
from tests.support import runs
from tests.support.campaigns import sampled

BASIC = ["--section=axisymmetric", "--no-pictures", "--quiet"]
SHORT = [*BASIC, "--pressure-cm=0,30"]


@pytest.fixture
def says(tmp_path, monkeypatch, ended):
    """Return a function that runs a command in an empty folder, in this process, and gives its status and what it said."""
    monkeypatch.chdir(tmp_path)

    def say(asked, *arguments):
        status, out, err = ended(asked, *arguments)
        assert "Traceback" not in err, err
        if status != 0:
            assert err.count("\n") == 1, err
        return status, out, err

    return say


@pytest.fixture(scope="session")
def short(tmp_path_factory):
    """A finished run to 30 cm."""
    folder = tmp_path_factory.mktemp("short") / "disk"
    assert runs.run("-m", "softmodels.disk", *SHORT, "--output", folder).status == 0
    return folder


@pytest.fixture
def copy(short, tmp_path):
    return Path(shutil.copytree(short, tmp_path / "copy"))


def contents(folder):
    """Every file under a folder, with its bytes."""
    return {path.relative_to(folder): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


MINE = ["report.html", "mesh.png", "disk.steps/0001.h5", "path.csv", "case.toml", "disk.h5"]


@pytest.mark.parametrize("name", MINE)
@pytest.mark.parametrize("words", [["--output", "mine"], ["--output", "mine", "--resume"]], ids=["new", "resume"])
def test_a_users_folder_is_not_taken(name, words, says, tmp_path):
    file = tmp_path / "mine" / name
    file.parent.mkdir(parents=True)
    file.write_text("mine")
    status, out, err = says(command, *SHORT, *words)
    assert status == 2 and out == "" and "mine" in err and "--output" in err
    assert contents(tmp_path) == {Path("mine") / name: b"mine"}


def test_the_folder_of_the_case_that_is_run_is_not_taken(says, tmp_path):
    text = Case("disk", HollowDisk(section="axisymmetric"), DEFAULT, steps_of(pressure_cm=(10.0,))).to_toml() + "# mine\n"
    (tmp_path / "case.toml").write_text(text)
    for folder in (".", tmp_path):
        status, _, err = says(softmodels, "run", "case.toml", "--no-pictures", "--output", folder)
        assert status == 2 and "'case.toml'" in err
    status, _, err = says(softmodels, "run", "case.toml", "--no-pictures", "--output", "")
    assert status == 2 and "empty" in err
    assert contents(tmp_path) == {Path("case.toml"): text.encode()}


@pytest.mark.parametrize("name", sampled(["report.html", "apex.png", "branch", "disk.png"], 3))
def test_somebody_elses_file_among_a_runs_results_is_not_replaced(name, says, copy):
    (copy / name).write_text("mine")
    before = contents(copy)
    words = ("--section=axisymmetric", "--quiet", "--pictures=few", "--pressure-cm=0,20")
    status, _, err = says(command, *words, "--output", copy)
    if name == "disk.png":  # nothing of this name is ever written
        assert status == 0 and (copy / name).read_text() == "mine"
        return
    assert status == 2 and name in err and "not replaced" in err
    assert contents(copy) == before
    if name != "branch":
        status, _, err = says(softmodels, "draw", copy)
        assert status == 2 and name in err and contents(copy) == before


def test_a_case_file_changed_among_its_results_is_kept(says, copy):
    file = copy / "case.toml"
    file.write_text(file.read_text().replace("30.0", "40.0"))
    before = contents(copy)
    for words in ([], ["--resume"]):
        status, _, err = says(softmodels, "run", file, "--no-pictures", "--quiet", "--output", copy, *words)
        assert status == 2 and "case.toml" in err
        status, _, err = says(command, *SHORT, "--output", copy, *words)
        assert status == 2 and "case.toml" in err and "changed" in err
    assert contents(copy) == before


def test_results_without_a_record_are_kept(says, copy):
    (copy / ".softmodels.json").unlink()
    before = contents(copy)
    for words in ([], ["--resume"]):
        status, _, err = says(command, *SHORT, "--output", copy, *words)
        assert status == 2 and "not written by a run" in err and contents(copy) == before


@pytest.mark.parametrize(("number", "word"), [(0, "earlier version"), (99, "later version")])
def test_the_format_of_stored_states_is_checked(number, word, says, copy):
    with h5py.File(copy / "disk.h5", "r+") as file:
        file.attrs["format"] = number
    status, _, err = says(command, *BASIC, "--pressure-cm=0,30,40", "--output", copy, "--resume")
    assert status == 2 and word in err
    if number > 1:
        status, _, err = says(softmodels, "draw", copy)
        assert status == 2 and word in err


LATE = {
    "a contact on no face": ["--contact=lid", "--contact-plane=z = 17mm"],
    "PETSc's words": ["--", "-body_pc_type", "nonsense"],
}


@pytest.mark.parametrize("words", LATE.values(), ids=LATE)
def test_bad_input_that_is_noticed_late_leaves_the_last_results(words, copy):
    before = contents(copy)
    done = runs.run("-m", "softmodels.disk", *SHORT, "--pressure-cm=0,20", "--output", copy, *words)
    assert done.status == 2 and done.err.count("\n") == 1, done.err
    assert contents(copy) == before


def test_a_mesh_that_fails_leaves_the_last_results_and_no_new_folder(says, copy, monkeypatch, tmp_path):
    from geometries import MeshingError

    def fail(self, path, *_):
        Path(path).write_text("half a mesh")
        raise MeshingError("no cells")

    monkeypatch.setattr(HollowDisk, "write", fail)
    before = contents(copy)
    for folder in (copy, tmp_path / "new"):
        status, _, err = says(command, *BASIC, "--pressure-cm=0,20", "--output", folder)
        assert status == 1 and "no cells" in err
    assert contents(copy) == before and not (tmp_path / "new").exists()


def test_states_without_their_case_are_not_begun_anew(says, copy):
    (copy / "case.toml").unlink()
    before = contents(copy)
    status, _, err = says(command, *BASIC, "--pressure-cm=0,30,40", "--output", copy, "--resume")
    assert status == 2 and "case.toml is missing" in err and contents(copy) == before


CONTACTS = [["--contact=top", "--contact-plane=z = 17mm"], ["--contact=top", "--contact-plane=z = 17.5mm"],
            ["--contact=top", "--contact-plane=z = 17mm", "--contact-stiffness=100"], []]  # fmt: skip


def test_no_run_goes_on_with_another_contact(says, tmp_path):
    folder = tmp_path / "disk"
    assert says(command, *SHORT, *CONTACTS[0], "--output", folder)[0] == 0
    before = contents(folder)
    more = [*BASIC, "--pressure-cm=0,30,35", "--output", folder, "--resume"]
    for other in CONTACTS[1:]:
        status, _, err = says(command, *more, *other)
        assert status == 2 and "another contact" in err and contents(folder) == before
    assert says(command, *more, *CONTACTS[0])[0] == 0
    assert runs.rows(folder)[-1]["pressure_cm"] == 35.0


def test_every_field_of_a_case_counts():
    """Also of what is inside it, and nothing by the place where it happens to be in memory."""
    plain = Case("disk", HollowDisk(), DEFAULT, steps_of(pressure_cm=(10.0,)))
    texts = identity(dataclasses.replace(plain, components=[Obstacle("top", "z = 20 mm")]))
    counting = {field.name for field in dataclasses.fields(Case)} - {"solver"}  # either one finds the same states
    assert counting <= {name.split(".")[0] for name in texts}
    assert {"actuator.membrane", "material.shear_modulus", "components.contact"} <= texts.keys()
    assert not any(" at 0x" in text for text in texts.values())
    assert difference(identity(plain), texts) == "components.contact"
    assert difference(identity(plain), identity(dataclasses.replace(plain, steps=steps_of(pressure_cm=(10.0, 20.0))))) is None
    assert identity(plain) == identity(dataclasses.replace(plain, solver="iterative"))
    assert identity(plain) == identity(Case.from_toml(plain.to_toml()))


def test_a_part_whose_file_was_changed_is_another_part(wedge_part, tmp_path):
    part = wedge_part("can", 90)
    copied = tmp_path / "part.step"
    shutil.copy(part.file, copied)
    case = Case("part", dataclasses.replace(part, file=str(copied)), DEFAULT, steps_of(pressure_cm=(10.0,)))
    known = identity(case)
    assert difference(known, identity(dataclasses.replace(case, actuator=part))) is None  # the same content elsewhere
    copied.write_text(copied.read_text().replace("FILE_NAME('", "FILE_NAME('other ", 1))
    assert difference(known, identity(case)) == "actuator.file"


def test_a_mesh_that_was_changed_is_made_anew(says, copy, whole):
    (copy / "disk.msh").write_text("SystemCall 'touch executed';\n")
    assert says(command, *BASIC, "--pressure-cm=0,30,35", "--output", copy, "--resume")[0] == 0
    assert "SystemCall" not in (copy / "disk.msh").read_text() and not Path("executed").exists()
    assert runs.rows(copy)[-1]["pressure_cm"] == 35.0


def test_a_folder_in_use_is_refused_with_the_process_that_uses_it(says, copy):
    before, busy = contents(copy), OwnFolder(copy, "run")
    busy.take()
    for words in ([], ["--resume"], ["--membrane=5mm"]):
        status, out, err = says(command, *SHORT, *words, "--output", copy)
        assert status == 2 and out == "" and f"process {os.getpid()} on" in err and "--output" in err
    busy.leave()
    assert contents(copy) == before
    # A lock that a killed process has left behind holds nobody up.
    (copy / ".softmodels.lock").write_text("1\nelsewhere\n")
    assert says(command, *SHORT, "--output", copy)[0] == 0 and not list(copy.glob("*.lock"))


def test_where_the_system_knows_no_locks_the_file_alone_counts(tmp_path, monkeypatch):
    """Of this machine's processes it is seen whether they have ended; of another's it is not."""
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    monkeypatch.setattr("fcntl.flock", lambda *_: (_ for _ in ()).throw(OSError(errno.ENOLCK, "no locks")))
    lock = folders.FolderLock(tmp_path / "lock")
    for pid, host, free in ((ended.pid, socket.gethostname(), True), (os.getppid(), socket.gethostname(), False),
                            (ended.pid, "elsewhere", False)):  # fmt: skip
        lock.file.write_text(f"{pid}\n{host}\n")
        if free:
            lock.take()
            with pytest.raises(folders.InUseError, match=f"process {os.getpid()} on"):
                folders.FolderLock(lock.file).take()
            lock.release()
            assert not lock.file.exists()
        else:
            with pytest.raises(folders.InUseError, match=rf"process {pid} on {host}, since \d{{4}}-"):
                lock.take()


@pytest.mark.campaign
def test_runs_keep_out_of_each_others_way(says, tmp_path):
    for words in (["--pressure-cm=0,30"], ["--pressure-cm=0,20"], ["--pressure-cm=0,30"]):
        assert says(command, *BASIC, *words)[0] == 0
    assert sorted(path.name for path in Path("results").iterdir()) == ["disk", "disk-2"]
    assert [runs.rows(Path("results") / name)[-1]["pressure_cm"] for name in ("disk", "disk-2")] == [30.0, 20.0]
    # The case to resume is found by what it is; where two fit, the user is asked.
    assert says(command, *BASIC, "--pressure-cm=0,20", "--resume")[0] == 0
    status, _, err = says(command, *BASIC, "--pressure-cm=0,35", "--resume")
    assert status == 2 and "results/disk and results/disk-2" in err
    status, _, err = says(command, *BASIC, "--pressure-cm=0,35", "--membrane=5mm", "--resume")
    assert status == 2 and "--output" in err and "results/disk" in err
    shutil.rmtree("results/disk-2")
    assert says(command, *BASIC, "--pressure-cm=0,35", "--resume")[0] == 0
    assert runs.rows(Path("results/disk"))[-1]["pressure_cm"] == 35.0
    done = says(softmodels, "run", "results/disk/case.toml", "--no-pictures")
    assert done[0] == 0 and "in results/disk:" in done[1] and "writing results to results/disk" in done[2]


def test_a_run_killed_while_it_takes_the_folder_over_loses_nothing(few_new, monkeypatch):
    """At every single rename and removal the earlier or the new results are whole, once the folder is opened again."""
    folder, old, new, replay = few_new
    came = False
    for moment in range(100):
        shutil.rmtree(folder)
        shutil.copytree(old, folder)
        ended = replay(moment)
        own = OwnFolder(folder, "run")
        own.take()
        own.leave()
        found = contents_of(folder)
        came = came or found != contents_of(old)  # from one moment on the new ones are there
        assert found == contents_of(new if came else old), moment
        if ended:
            assert moment > 5 and came
            return
    pytest.fail("it never ended")


def contents_of(folder):
    return {name: data for name, data in contents(folder).items() if not name.name.startswith(".softmodels")}


@pytest.fixture
def few_new(tmp_path, monkeypatch):
    """A folder, its contents before and after a second run's first state, and a run cut off at a numbered change."""
    import numpy as np

    folder, old, new = tmp_path / "few", tmp_path / "old", tmp_path / "new"

    made = []

    def write(steps, first):
        results = Results(folder, "few")
        made.append(results)
        results.own.take()
        results.prepare({"inputs": {"first": first}})
        results.begin(np.zeros((6, 3)), np.arange(6).reshape(1, 6), "Triangle_6")
        (results.folder / "case.toml").write_text(str(first))
        for step in range(steps):
            fields = {"displacement": np.full((6, 3), first + step), "p": np.full(6, float(step))}
            results.add(formats.StateRecord(Row({"step": step, "pressure_cm": first}), fields, {"P": step}))

    write(3, 1.0)
    made[-1].own.claim(["summary.json"])
    (folder / "summary.json").write_text("{}")
    made[-1].own.leave()
    shutil.copytree(folder, old)
    write(1, 2.0)
    made[-1].own.leave()
    shutil.copytree(folder, new)

    def replay(moment):
        count = [0]

        def cut(function):
            def counted(*arguments, **words):
                count[0] += 1
                if count[0] > moment:
                    raise KeyboardInterrupt
                return function(*arguments, **words)

            return counted

        with monkeypatch.context() as patch:
            for name in ("replace", "rename", "unlink", "rmdir", "mkdir"):
                patch.setattr(os, name, cut(getattr(os, name)))
            try:
                write(1, 2.0)
            except KeyboardInterrupt:
                return False
            finally:
                count[0] = -1000
                made[-1].own.lock.release()
        return True

    return folder, old, new, replay


def test_a_record_from_elsewhere_names_nothing_outside(tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    folder = tmp_path / "disk"
    folder.mkdir()
    for name in ("../mine.txt", "/etc/hostname", "..", "a/..", "./a", "a/b/c", "a//"):
        record = {"format": 2, "kind": "run", "files": [name], "about": {}}
        (folder / ".softmodels.json").write_text(json.dumps(record))
        assert OwnFolder(folder, "run").files == []
    (folder / "a").symlink_to(tmp_path)
    (folder / ".softmodels.json").write_text(json.dumps({**record, "files": ["a/", "a/mine.txt"]}))
    own = OwnFolder(folder, "run")
    own.remove(own.files)
    assert own.files == [] and (tmp_path / "mine.txt").read_text() == "mine"


def test_a_record_of_the_first_format_is_read(tmp_path):
    """What is in a folder stood beside its name; what was on its way when the program was killed is still brought in."""
    (tmp_path / ".softmodels-new" / "edges").mkdir(parents=True)
    (tmp_path / ".softmodels-new" / "edges" / "b.png").write_text("new")
    (tmp_path / "edges").mkdir()
    (tmp_path / "edges" / "a.png").write_text("old")
    record = {
        "format": 1,
        "kind": "outlines",
        "files": ["edges/"],
        "about": {},
        "inside": {"edges/": ["a.png", "b.png"]},
    }
    (tmp_path / ".softmodels.json").write_text(json.dumps({**record, "incoming": {"edges/": ["b.png"]}}))
    own = OwnFolder(tmp_path, "outlines")
    own.take()
    own.leave()
    assert own.files == ["edges/", "edges/b.png"]
    assert contents(tmp_path / "edges") == {Path("b.png"): b"new"}


# -- Somebody else's folder: nothing in it is run, nothing in it changes the numbers, and it shows no other file's b--


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


@pytest.mark.campaign
def test_a_run_there_is_the_run_of_elsewhere(foreign, whole, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))  # so that the equations are compiled there
    started = "from softmodels.disk import command; from softmodels.cli.ending import main; main(command)"
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
