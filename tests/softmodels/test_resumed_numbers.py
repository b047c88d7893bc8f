"""A resumed run has the states and numbers of the undisturbed one to 1e-6, wherever it was stopped."""

from __future__ import annotations

import csv
import dataclasses
import errno
import itertools
import os
import shutil

import h5py
import numpy as np
import pytest

from softmodels.case.case import Case
from softmodels.runs import formats
from softmodels.runs.store import Results
from tests.support import runs
from tests.support.campaigns import sampled

SHADOW = '[geometry]\ndevice = "HollowDisk"\ncavity_radius = "20 mm"\nmembrane = "2 mm"\n'
COARSE = 'wall = "5 mm"\ncavity_height = "5 mm"\ncell_size = "10 mm"\nrefinement = 1.0\nfillet = "0 mm"\nbase_fillet = "0 mm"\n'
SECTION = f'{SHADOW}base = "5 mm"\n{COARSE}section = "axisymmetric"\n'
SOFT = '[material]\nlaw = "neo-hookean"\nshear_modulus = "30 kPa"\npoisson = 0.49\n'
LATE = '[material]\nlaw = "yeoh"\nc1 = "10 kPa"\nc2 = "20 Pa"\nc3 = "3 Pa"\npoisson = 0.495\n'
CASES = {
    "past a limit point by volume": f'{SECTION}{SOFT}[load]\nvolume_ml = "0:60:15"\n',
    "to a pressure beyond the limit": f"{SECTION}{SOFT}[load]\npressure_cm = [0, 20, 49.2, 49.6, 60]\n",
    "past a bifurcation": f'{SHADOW}base = "2 mm"\nwall = "15 mm"\ncavity_height = "5 mm"\ncell_size = "2 mm"\n'
    f'section = "axisymmetric"\n{LATE}[load]\nvolume_ml = "0:75:25"\n',
    "a syringe": f'{SECTION}{LATE}[load]\nstroke_ml = "0:20:10"\n[supply]\nkind = "syringe"\ndead_volume = "5 ml"\n',
    "friction": f'{SECTION}{SOFT}[contact.plate]\nshape = "plane"\nfaces = "top"\nat = ["0 mm", "0 mm", "13 mm"]\n'
    'along = [0, 0, -1]\nfriction = 0.5\n[load]\npressure_cm = "0:30:10"\n',
    "friction, there and back": f'{SECTION}{SOFT}[contact.plate]\nshape = "plane"\nfaces = "top"\n'
    'at = ["0 mm", "0 mm", "13 mm"]\n'
    "along = [0, 0, -1]\nfriction = 0.5\n[load]\ncavity1.pressure_cm = [30, 10]\n",
    "a part that snaps": '[geometry]\ndevice = "Bellows"\nconvolutions = 1\ninner_radius = "6.276 mm"\n'
    'outer_radius = "10.77 mm"\nwall = "0.95 mm"\npitch = "5.261 mm"\n'
    'rounding = "0.845 mm"\ncap = "2.73 mm"\ntip = "free"\ncell_size = "1 mm"\n'
    'through = 1\n[material]\nlaw = "gent"\nshear_modulus = "17.95 kPa"\nlimit = 57\npoisson = 0.5\n[contact]\nfaces = "tip"\n'
    'plane = "z = 14.126 mm"\n[walls]\nfaces = "none"\n[load]\nvolume_ml = "0:12:6"\n',
    "a wedge": f'{SHADOW}base = "5 mm"\n{COARSE}angle = "15 deg"\n{SOFT}[load]\nvolume_ml = "0:45:15"\n',
}
EVERY = {"a wedge": 9, "past a bifurcation": 9, "a part that snaps": 9}
"""Of how many states one is stopped at; every fourth where nothing else is stated."""


def table(folder):
    return list(csv.DictReader((folder / "path.csv").read_text().splitlines()))


def cut_off(whole, folder, count):
    """A copy of a run as it was after so many states."""
    shutil.copytree(whole.folder, folder)
    part = Results(folder, whole.name, whole.gauge)
    with h5py.File(whole.heavy) as file:
        part.begin(file["mesh/points"][:], file["mesh/cells"][:], str(file["mesh"].attrs["cell_name"]))
        for stored in whole.stored[:count]:
            fields = {name: values[:] for name, values in file[stored.group].items()}
            part.add(formats.StateRecord(stored.row, fields, stored.restart))
    return part.folder


LOOSER = {
    "newton_iterations": np.inf, "lowest_eigenvalue_Pa_per_mm2": 1e-3, "max_von_mises_kPa": 1e-5,
    "peak_von_mises_kPa": 3e-6, "max_stretch": 3e-6,
}  # fmt: skip
"""Columns with bounds of their own. Iterations depend on where K was factorised, and so does the eigenvalue of larger models,
which is corrected from there. What two states differ by grows three to five times in a step, most where a coarse mesh has a
sharp corner: there the largest stress and stretch are."""


def worst(found, wanted):
    """Largest difference of two tables in shares of each column's largest number, and its column."""
    most = (0.0, "")
    for name in wanted[0]:
        if name == "control":
            assert [row[name] for row in found] == [row[name] for row in wanted]
            continue
        numbers = [[float(row[name] or "nan") for row in rows] for rows in (found, wanted)]
        size = max(map(abs, numbers[1])) or 1.0
        difference = max(abs(a - b) for a, b in zip(*numbers, strict=True)) / size
        if difference < LOOSER.get(name, 0.0):
            continue
        most = max(most, (difference, name))
    return most


@pytest.mark.parametrize("name", sampled(["past a limit point by volume", "a syringe", "friction, there and back"], 2))
def test_resumed_from_the_middle_equals_uninterrupted(name, tmp_path, figure):
    _resumed(name, tmp_path, figure, lambda counts: counts[len(counts) // 2 :][:1])


@pytest.mark.campaign
@pytest.mark.parametrize("name", CASES)
def test_resumed_equals_uninterrupted(name, tmp_path, figure):
    """To rounding in most, and as far as Newton's tolerance leaves it with friction."""
    _resumed(name, tmp_path, figure, lambda counts: counts[:: EVERY.get(name, 4)])


def _resumed(name, tmp_path, figure, chosen):
    """Solve a case, cut its results off after numbers of states chosen among all that can be resumed, and compare."""
    from softmodels.cli.run import run
    from softmodels.common.commands import RunOptions

    case = Case.from_toml(CASES[name])
    how = RunOptions(quiet=True, no_pictures=True)
    status = run(case, tmp_path / "whole", how)
    whole = Results(tmp_path / "whole", case.name, case.actuator.gauge)
    whole.load()
    wanted = table(whole.folder)
    # A program is resumed from the last of its steps that is complete.
    first = next(i for i, row in enumerate(wanted) if float(row["load_step"]) == 1.0) + 1 if case.program else 2
    for count in chosen(range(first, len(wanted))):
        folder = cut_off(whole, tmp_path / str(count), count)
        assert run(case, folder, dataclasses.replace(how, resume=True)) == status
        found = table(folder)
        assert len(found) == len(wanted), count
        difference, _ = worst(found, wanted)
        figure("an uninterrupted run, wherever it was stopped", f"every column resumed, {name}", difference, 1e-6)


# -- Runs in time that are killed again before they are as far as they were ------------------------------------------------


CREEPING = f"{SECTION}{SOFT}[material.memory]\nbranches = [[0.3, 2.0]]\n"
IN_TIME = {
    "a hold": f"{CREEPING}[load]\ncavity1.pressure_cm = [0, 15, 15]\ntime_s = [0, 1, 20]\n",
    "a hold that does not begin at rest": f"{CREEPING}[load]\ncavity1.pressure_cm = [15]\ntime_s = [20]\n",
    "cycles": f"{CREEPING}[load]\ncavity1.pressure_cm = [0, 10, 0, 10, 0]\ntime_s = [0, 2, 4, 6, 8]\n",
    "inertia": f"{SECTION}{SOFT}[load]\ninertia = true\ncavity1.pressure_cm = [0, 5]\ntime_s = [0, 0.02]\n",
    "air in time": f"{SECTION}{SOFT}[load]\nsource_pressure_cm = [0, 15]\ntime_s = [0, 5]\n"
    '[supply]\nkind = "reservoir"\ndead_volume = "20 ml"\n',
}


class Killed(BaseException):
    """The end of a run without a chance to do anything else."""


@pytest.fixture
def killed_after(monkeypatch):
    """A function that lets a run of a case file end after so many states of its own, killed or stopped."""

    def run(count, *words, by=Killed):
        left, add = itertools.count(1), Results.add

        def add_and_die(self, *step):
            add(self, *step)
            if next(left) == count:
                raise by

        with monkeypatch.context() as patch:
            patch.setattr(Results, "add", add_and_die)
            try:
                return runs.run("-m", "softmodels", "run", *words, "--no-pictures", "--quiet")
            except Killed:
                return None

    return run


def states_in(folder):
    """How many states a folder has: in its table, and to go on from."""
    results = Results(folder, next(folder.glob("*.xdmf")).stem)
    results.load()
    return len(table(folder)), len(results.stored)


@pytest.mark.parametrize("name", sampled(IN_TIME, ()))
def test_no_stored_state_is_lost_however_often_a_run_in_time_is_cut_off(name, killed_after, tmp_path):
    file, folder = tmp_path / "case.toml", tmp_path / "cut"
    file.write_text(IN_TIME[name])
    assert killed_after(-1, file, "-o", tmp_path / "whole").status == 0
    count = max(6, 3 * len(table(tmp_path / "whole")) // 4)
    assert killed_after(count, file, "-o", folder) is None
    assert states_in(folder) == (count, count)
    for new in (1, 2):
        assert killed_after(new, file, "-o", folder, "--resume") is None
        assert states_in(folder) == (count, count)
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))  # this end gathers what there is
    assert killed_after(2, file, "-o", folder, "--resume", by=full).status == 1
    assert states_in(folder) == (count, count)
    assert killed_after(-1, file, "-o", folder, "--resume").status == 0
    assert len(states_in(folder)) == 2 and worst(table(folder), table(tmp_path / "whole"))[0] < 1e-6
