"""Coulomb friction on rigid shapes: derivatives, Coulomb's ratio, a strip around a rod, work lost, steps, refusals."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

import softmodels as sm
from softmodels.case.load import steps_of
from softmodels.components.contact import RigidShape
from softmodels.components.pressing import FrictionHistory, HardeningPenalty, PressedByDistance, Rubbed, Rubbing, Surface
from softmodels.components.shapes import slopes
from softmodels.fitting.outlines.device import MeasuredDevice
from softmodels.fitting.problem import FitError
from softmodels.mechanics.component import ComponentError

LAW = sm.NeoHookean(30e3, 0.49)
SECTION = sm.HollowDisk(section="axisymmetric")
PLATE = RigidShape("plane", "top", (0.0, 0.0, 0.017), along=(0.0, 0.0, -1.0), friction=0.5, name="plate")
BEAM = """
[geometry]
device = "Beam"
{sizes}
[material]
law = "neo-hookean"
shear_modulus = "30 kPa"
poisson = 0.49
[contact.rod]
faces = "bottom"
friction = {mu}
{shape}
[force]
face = "tip"
{load}
"""
ROUND = (np.zeros(3), np.array([0.0, 0.6, 0.8]), 1.0, 0.3, 1.0)
FLAT = (np.array([0.0, 0.0, 1.2]), np.array([0.0, 0.0, 1.0]), None, 0.0, 1.0)


def _faces(numbers, rng):
    """Two facets just outside a shape, and what presses on them where their nodes are."""
    x, y = (axis.ravel() for axis in np.meshgrid(*2 * [np.linspace(-0.2, 0.2, 3)], indexing="ij"))
    at = np.arange(9).reshape(3, 3)
    facets = np.array(
        [[at[0, 0], at[2, 0], at[2, 2], at[2, 1], at[1, 1], at[1, 0]],
         [at[0, 0], at[2, 2], at[0, 2], at[1, 2], at[0, 1], at[1, 1]]]
    )  # fmt: skip
    nodes = np.column_stack([x, y, np.full(9, 1.25)]) + 0.005 * rng.normal(size=(9, 3))
    surface = Surface(nodes, facets, np.zeros(2, int), nodes[facets[:, :3]].mean(axis=1) + np.array([0, 0, 0.1]))
    penalty = HardeningPenalty(30.0, 1e-3, 0.02, 16.0)
    return nodes, lambda places: PressedByDistance(surface, lambda x: slopes(x, numbers), penalty, 0.1, places)


@pytest.mark.parametrize("numbers", [ROUND, FLAT])
@pytest.mark.parametrize("way", [0.001, 0.05])
def test_forces_of_a_step_have_their_derivative(numbers, way, figure):
    """What newly touches, sticks or slides; and the symmetric matrix is the same but for the pressing force. Forces, and what
    will be remembered, change with the places and with what is remembered now."""
    rng = np.random.default_rng(3)
    nodes, pressed = _faces(numbers, rng)
    rubbing, moved = Rubbing(0.4, 0.003), nodes - np.array([-0.01, 0.02, 0.06])
    grip = Rubbed(pressed(moved), rubbing, FrictionHistory.of_free(pressed(nodes))).kept()
    places = moved + way * np.array([-0.5, 1.0, -0.2]) + 0.1 * way * rng.normal(size=nodes.shape)
    here = Rubbed(pressed(places), rubbing, grip)
    assert here.touching.any() and here.slides.any() == (way > 0.01)
    along, held, gaps = (rng.normal(size=size) for size in (nodes.shape, grip.held.shape, grip.gaps.shape))
    samples, on = here.surface.places(along), here.touching
    pulls, (kept, far) = here.pull_rates(samples[on], held[on], gaps[on]), here.kept_rates(samples, held, gaps)
    errors = []
    for h in (2e-6, 1e-6):
        after, before = (Rubbed(pressed(places + sign * h * along), rubbing, grip).forces for sign in (1, -1))
        numbered, product = (after - before).ravel() / (2 * h), here.whole_stiffness @ along.ravel()
        errors.append(np.abs(numbered - product).max() / np.abs(numbered).max())
        grips = (dataclasses.replace(grip, held=grip.held + by * held, gaps=grip.gaps + by * gaps) for by in (h, -h))
        a, b = (Rubbed(pressed(places + by * along), rubbing, one) for by, one in zip((h, -h), grips, strict=True))
        for before, after, rate in (
            (b.pulls, a.pulls, pulls), (b.kept().held, a.kept().held, kept), (b.kept().gaps, a.kept().gaps, far),
        ):  # fmt: skip
            apart = np.abs((after - before) / (2 * h) - rate).max() / np.abs(rate).max()
            figure("differences", "derivative of what friction pulls and remembers, through a step", apart, 5e-6)
    figure("differences", "derivative of the forces of friction", errors[1], 1e-4)
    assert errors[0] > 2.5 * errors[1]  # of second order
    held = dataclasses.replace(rubbing, coefficient=0.0)
    np.testing.assert_allclose(Rubbed(pressed(places), held, grip).forces, pressed(places).forces, atol=1e-15)
    assert abs(here.stiffness - here.stiffness.T).max() < 1e-12


def test_a_kept_state_stays():
    nodes, pressed = _faces(ROUND, np.random.default_rng(5))
    rubbing, moved = Rubbing(0.4, 0.003), nodes - np.array([-0.01, 0.02, 0.06])
    here = Rubbed(pressed(moved), rubbing, FrictionHistory.of_free(pressed(nodes)))
    again = Rubbed(pressed(moved), rubbing, here.kept())
    np.testing.assert_allclose(again.forces, here.forces, atol=1e-15)
    assert again.kept().lost == pytest.approx(here.kept().lost, abs=1e-15) and here.kept().lost > 0.0
    assert again.slides.all() == here.slides.all()


def _run(sizes, mu, shape, load):
    return sm.run(sm.Case.from_toml(BEAM.format(sizes=sizes, mu=mu, shape=shape, load=load))).path


@pytest.mark.campaign
def test_a_beam_that_slides_on_a_table_has_coulombs_ratio(figure):
    """It lies down under its weight, and its tip is drawn out and pushed back."""
    table = 'shape = "plane"\nat = ["0 mm", "0 mm", "-6 mm"]\nalong = [0, 0, 1]\nslip = "0.05 mm"'
    load = 'direction = "x"\n[gravity]\ndirection = "-z"\n[load]\ngravity = 1\nforce.force_N = [0, 0.02, -0.02]'
    path = _run('cell_size = "5 mm"', 0.4, table, load)
    drawn = [int(np.flatnonzero(path["load_step"] == step)[0]) for step in (2, 3)]
    ratio = path["rod_force_x_N"][drawn] / path["rod_force_z_N"][drawn]
    figure("Coulomb's law", "ratio of forces where all slides, there and back", ratio / [-0.4, 0.4] - 1, 3e-3)
    np.testing.assert_allclose(path["rod_sliding"][drawn], 1.0, atol=1e-3)
    pressing, drawn = path["rod_force_z_N"].min(), 5e-5  # of the work, what has drawn what sticks comes back
    assert np.diff(path["rod_friction_mJ"]).min() > 0.4 * pressing * drawn * 1e3


@pytest.mark.campaign
def test_a_strip_around_a_rod_holds_as_euler_and_eytelwein_have_it(figure):
    """A strip that hangs over a rod by a quarter of a turn: the pull at its clamp is the tip's over exp(mu pi / 2).

    Friction acts at the rod's radius R, the pull in the middle of the thickness h: the exponent is R / (R + h/2) of that.
    """
    R, h, mu = 6.0, 1.0, 0.3
    sizes = f'length = "30 mm"\nwidth = "1 mm"\nthickness = "{h} mm"\ncell_size = "1 mm"'
    rod = f'shape = "cylinder"\nat = ["9 mm", "0 mm", "{-(R + h / 2 + 0.1)} mm"]\nalong = [0, 1, 0]\nradius = "{R} mm"'
    path = _run(sizes, mu, rod, 'direction = "-z"\n[load]\nforce_N = "0:0.01"')
    assert path["rod_sliding"][-1] > 0.99
    thin = h / path["max_stretch"][-1] ** 0.5
    wanted = mu * math.pi / 2 * R / (R + thin / 2)
    found = math.log(path["rod_force_z_N"][-1] / path["rod_force_x_N"][-1])
    figure("Euler and Eytelwein's rope", "logarithm of the ratio of pulls, a strip around a rod", found / wanted - 1, 0.04)


@pytest.fixture(scope="module")
def pressed_disk():
    """Paths to 120 cm, by the number of their steps."""
    found = {}
    for count in (12, 24, 96):
        values = ",".join(f"{value:.10g}" for value in np.linspace(0.0, 120.0, count + 1))
        found[count] = sm.inflate(SECTION, LAW, f"{values} cm", components=[PLATE]).path
    return found


@pytest.mark.campaign
def test_a_state_between_two_remembers_what_they_do(pressed_disk):
    run = sm.inflate(SECTION, LAW, "0:120 cm", components=[PLATE])
    row, beside = run.at("100 cm").row, pressed_disk[24]
    for column, apart in (("added_volume_ml", 1e-3), ("plate_force_z_N", 5e-3), ("plate_friction_mJ", 0.1)):
        assert row[column] == pytest.approx(np.interp(100.0, beside["pressure_cm"], beside[column]), rel=apart)


@pytest.mark.campaign
def test_air_works_for_what_is_stored_and_lost(pressed_disk, figure):
    path = pressed_disk[96]
    P, V = path["pressure_Pa"], 1e-6 * path["added_volume_ml"]
    work = 1e3 * float(((P[1:] + P[:-1]) / 2 * np.diff(V)).sum())
    lost = path["plate_friction_mJ"][-1]
    figure(
        "work of the air less the energy stored",
        "work lost to friction",
        (work - path["stored_energy_mJ"][-1]) / lost - 1,
        0.05,
    )


@pytest.mark.campaign
def test_states_depend_little_on_the_steps_and_less_on_shorter_ones(pressed_disk, figure):
    for column, bound in (("added_volume_ml", 1.5e-4), ("plate_force_z_N", 1.3e-3), ("plate_friction_mJ", 0.05)):
        few, some, many = (pressed_disk[count][column][-1] for count in (12, 24, 96))
        figure("a path of 96 steps", f"{column}, 12 steps with friction", few / many - 1, bound)
        if column != "plate_friction_mJ":  # the work between two states is a trapezoid's, which errs the other way
            assert abs(some - many) < abs(few - many)


def test_a_pressed_disk_comes_back_by_another_way_and_to_rest(figure):
    plate = '[contact.plate]\nshape = "plane"\nfaces = "top"\nat = ["0 mm", "0 mm", "17 mm"]\nalong = [0, 0, -1]\n'
    plate += "friction = 0.5\n"
    text = f'[geometry]\ndevice = "HollowDisk"\nsection = "axisymmetric"\n{plate}[load]\ncavity1.pressure_cm = [80, 120, 80, 0]'
    path = sm.run(sm.Case.from_toml(text)).path
    there, back = (path["added_volume_ml"][int(np.flatnonzero(path["load_step"] == step)[0])] for step in (1, 3))
    assert back / there - 1 > 1e-4 and path["plate_friction_mJ"][-1] > 1e-3
    figure("the disk at rest", "volume after a way with friction", path["added_volume_ml"][-1], 1e-9, unit="ml")


def test_what_cannot_be_meant_is_refused(tmp_path):
    with pytest.raises(ComponentError, match="coefficient of friction of 7 is out of range"):
        dataclasses.replace(PLATE, friction=7.0)
    with pytest.raises(ComponentError, match="a slip needs"):
        dataclasses.replace(PLATE, friction=0.0, slip=1e-4)
    with pytest.raises(ComponentError, match="friction needs a fixed shape"):
        dataclasses.replace(PLATE, guide="z", spring=5.0)
    with pytest.raises(ComponentError, match="has no radius"):
        dataclasses.replace(PLATE, radius=0.01)
    with pytest.raises(sm.CaseError, match="use a series"):
        sm.inflate(SECTION, LAW, "0,5 cm", components=[PLATE], load_unload=True)
    with pytest.raises(sm.CaseError, match="is not available with friction"):
        sm.inflate(SECTION, LAW, "0,5 cm", components=[PLATE], branch=True)
    case = sm.Case("disk", SECTION, LAW, steps=steps_of(pressure_cm=(5.0,)), components=(PLATE,))
    with pytest.raises(FitError, match="has friction, whose derivatives"):
        MeasuredDevice.of(case)
    solid = dataclasses.replace(case, actuator=sm.HollowDisk())
    with pytest.raises(sm.CaseError, match=r"\[contact.plate\], which decks do not support"):
        sm.export(solid, tmp_path / "disk.inp")
    with pytest.raises(sm.CaseError, match="not perpendicular to the cut plane"):
        sm.inflate(sm.HollowDisk(), LAW, "0,5 cm", components=[dataclasses.replace(PLATE, along=(0.0, 0.6, -0.8))])
    with pytest.raises(ComponentError, match="the undeformed device is"):
        sm.inflate(SECTION, LAW, "0,5 cm", components=[dataclasses.replace(PLATE, at=(0.0, 0.0, 0.012))])
