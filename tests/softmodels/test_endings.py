"""Stopped in the first second, output that has nowhere to go: one sentence and a status, in every program."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from unittest import mock

import click
import numpy as np
import pytest

import softmodels as sm
from softmodels.case.load import steps_of
from softmodels.common.commands import EXIT_NO_EQUILIBRIUM, run_command
from softmodels.components.fibres import Reinforced, least_resistance
from softmodels.runs.notes import advice
from softmodels.runs.table import Row

STARTS = {
    "softmodels.disk": ["--pressure-cm", "0:100"],
    "softmodels.seminar": ["--pressure-cm", "0:100"],
    "softmodels": ["limit", "--variant", "shadow"],
    "measurement": ["demo"],
    "geometries": ["HollowDisk", "--cell-size", "0.3mm"],
}


def started(module, words, folder, **streams):
    return subprocess.Popen([sys.executable, "-m", module, *words], cwd=folder, stderr=subprocess.PIPE, text=True, **streams)


@pytest.mark.parametrize("module", STARTS)
def test_stopped_while_it_is_imported(module, tmp_path):
    """Stopped as soon as the numbers' library is looked for, which every program imports and which takes longest."""
    with started(module, STARTS[module], tmp_path, stdout=subprocess.DEVNULL) as process:
        for _ in range(1000):
            with open(f"/proc/{process.pid}/maps") as maps:  # noqa: PTH123
                if "numpy" in maps.read():
                    break
            time.sleep(0.005)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert err.count("\n") == 1 and "stopped by the user" in err, err


@pytest.mark.parametrize(
    ("module", "words"),
    [
        ("softmodels.disk", ["--help"]),
        ("softmodels", ["doctor", "--help"]),
        ("measurement", ["--help"]),
        ("geometries", []),
    ],
)
def test_output_that_has_nowhere_to_go(module, words, tmp_path):
    with open("/dev/full", "w") as full, started(module, words, tmp_path, stdout=full) as process:  # noqa: PTH123
        _, err = process.communicate(timeout=60)
    assert process.returncode == 1
    assert err.count("\n") == 1 and "No space left on device" in err, err
    reader, writer = os.pipe()
    os.close(reader)
    with started(module, words, tmp_path, stdout=writer) as process:
        os.close(writer)
        _, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (1, "")


@pytest.mark.parametrize(
    ("module", "words"),
    [
        ("softmodels", [" " * 3000 + "x"]),
        ("softmodels.disk", ["--pressure-cm", "0:1", "--control", "x" * 3000]),
        ("measurement", [" " * 3000 + "x"]),
        ("geometries", ["HollowDisk", "--variant", "x" * 3000]),
    ],
)
def test_words_without_end_get_a_sentence_with_one(module, words, tmp_path):
    """What a user pastes by mistake, such as a whole file, is not repeated in full."""
    with started(module, words, tmp_path, stdout=subprocess.DEVNULL) as process:
        _, err = process.communicate(timeout=60)
    assert process.returncode == 2
    assert len(err) < 1500 and " ... " in err and "x'" in err, err


def test_full_memory_is_a_sentence(capsys):
    @click.command()
    def greedy():
        raise MemoryError

    with mock.patch.object(sys, "argv", ["greedy"]), pytest.raises(SystemExit) as end:
        run_command(greedy, "greedy")
    assert end.value.code == 1
    err = capsys.readouterr().err
    assert err.count("\n") == 1 and "out of memory" in err


# -- Ends of a path that are the device's own are named as such: it is held so that nothing moves, or a part of it s--


TUBE = sm.Cylinder(section="axisymmetric", cell_size=2e-3)
HELD = (sm.Rigid(region="cap", kind="held", name="plate"), sm.Clamp("outer", slip="z", name="grip"))
INCOMPRESSIBLE = sm.NeoHookean(30e3, 0.5)


def test_a_cavity_that_cannot_change_takes_no_volume():
    with pytest.raises(sm.RunError, match=r"no equilibrium at 1 ml .* the supports prevent any change") as told:
        sm.inflate(TUBE, INCOMPRESSIBLE, volumes="1 ml", components=HELD)
    assert told.value.status == EXIT_NO_EQUILIBRIUM


def test_a_pressure_that_squeezes_the_silicone_itself_is_named():
    case = sm.Case("tube", TUBE, sm.NeoHookean(30e3, 0.4999), steps=steps_of(volume_ml=(1.0,)), components=HELD)
    figures = {"max_stretch": 1.05, "J_min": 0.97}
    assert "300 times the silicone's shear modulus" in advice(case, Row({**figures, "pressure_Pa": 9e6}))
    assert advice(case, Row({**figures, "pressure_Pa": 1e6})).startswith("No cause was found")


@pytest.mark.parametrize("control", ["auto", "pressure", "arc-length"])
def test_and_any_pressure(control):
    run = sm.inflate(TUBE, INCOMPRESSIBLE, pressures="50 cm", components=HELD, control=control)
    assert run.limit is None and run.pressure[-1] == pytest.approx(50 * run.case.column.pascal)
    assert abs(run.added_volume[-1]) < 1e-15 and run.largest_stretch[-1] == pytest.approx(1.0)


def test_and_its_syringe_compresses_the_gas_alone():
    syringe = sm.Syringe(3e-6, dead_volume=1e-6)
    run = sm.inflate(TUBE, INCOMPRESSIBLE, strokes="1 ml", supply=syringe, components=HELD)
    gas = syringe.dead_volume + syringe.syringe + TUBE.cavity_volume  # within a percent that of the mesh
    assert abs(run.added_volume[-1]) < 1e-15
    assert run.pressure[-1] == pytest.approx(syringe.ambient * 1e-6 / (gas - 1e-6), rel=0.02)


@pytest.mark.campaign
def test_a_part_that_snaps_while_the_volume_is_given_is_let_go():
    """The edge of a bellows' cap is pushed over on the plane that stops it: pressure and volume turn back both at once."""
    device = sm.Bellows(
        convolutions=1, inner_radius=6.276e-3, outer_radius=10.77e-3, wall=0.95e-3, pitch=5.261e-3, rounding=0.845e-3,
        cap=2.73e-3, tip="free", cell_size=1e-3, through=1.0,
    )  # fmt: skip
    run = sm.inflate(device, sm.Gent(17.95e3, 57.0, 0.5), volumes="12 ml",
                     components=[sm.Obstacle("tip", "z = 14.126 mm"), sm.Walls("none")])  # fmt: skip
    (at,) = np.flatnonzero(run.path["jump"])
    volume, pressure, energy = (run.path[name] for name in ("added_volume_ml", "pressure_Pa", "stored_energy_mJ"))
    assert run.limit is None and volume[-1] == pytest.approx(12.0) and 5.0 < volume[at - 1] < volume[at] < 6.0
    assert energy[at] < energy[at - 1] and run.path["stable_under_volume"][at:].all()
    lost = np.diff(volume) * (pressure[:-1] + pressure[1:]) / 2e3 - np.diff(energy)
    assert np.abs(lost[at:]).max() < 0.1 * lost[at - 1] < 1e-3 * energy[at]


@pytest.mark.campaign
def test_a_part_that_snaps_beside_a_whole_that_goes_on_as_before_is_let_go():
    """The edge of a balloon's neck, beside a balloon five times as wide in a tube: no measure of the whole shows it move."""
    device = sm.Balloon(
        radius=15.85e-3, wall=0.945e-3, neck_radius=6.27e-3, neck_length=8.5e-3, fillet=1.283e-3, held="end",
        cell_size=2e-3, through=1.0, section="axisymmetric",
    )  # fmt: skip
    tube = sm.RigidShape("cylinder", "outer", (0.0, 0.0, 0.0), 18.85e-3, (0.0, 0.0, 1.0), hollow=True, name="tube")
    run = sm.inflate(device, sm.Yeoh(7859.0, 94.3, 0.0, 0.5), pressures="40 cm", components=[tube])
    (at,) = np.flatnonzero(run.path["jump"])
    assert run.limit is None and run.pressure[-1] == pytest.approx(40 * run.case.column.pascal)
    assert run.path["max_stretch"][at] > 5.0 and run.path["stable_under_pressure"][at:].all()
    assert run.path["added_volume_ml"][at] == pytest.approx(run.path["added_volume_ml"][at - 1], rel=1e-2)


@pytest.mark.parametrize("section", [True, False])
def test_a_compressed_fibre_kinks_at_half_a_shear_modulus_across_it(section):
    """Along a wave whose normal is the fibre's the silicone has mu, the fibre 2 dW/dx; nothing else is softer."""
    stretches, stresses = np.array([0.9, 0.9, 0.9]), np.array([[-0.4], [-0.5], [-0.6]])
    gradients = np.array([np.diag([x**-0.5, x**-0.5, x]) for x in stretches])
    lines = np.tile((0.0, 0.0, 1.0), (3, 1, 1))
    state = Reinforced(gradients, lines, stresses, np.full((3, 1), 2.0))
    least = least_resistance(sm.NeoHookean(20e3, 0.49), 20e3, state, section)
    assert least == pytest.approx([0.2, 0.0, -0.2], abs=0.02 if not section else 1e-5)


@pytest.mark.campaign
def test_fibres_that_kink_are_named():
    tube = sm.Cylinder(section="axisymmetric", length=20e-3, cell_size=4e-3)
    threads = sm.Fibres(angle=0.0, helices=1, modulus=3e5, name="threads")
    case = sm.Case(
        "tube", tube, sm.NeoHookean(30e3, 0.49), components=(threads, sm.Force("end", "-z", name="push")),
        steps=steps_of(travel_mm=(0.0, 8.0), on="push"),
    )  # fmt: skip
    run = sm.run(case)
    assert run.limit.kind == "limit" and "the fibres of [fibres.threads] kink" in run.limit.why
