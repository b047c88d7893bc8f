"""Derivatives of states by parameters: Taylor's remainder against full solves, before and past a limit point."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from geometries import HollowDisk, Membrane
from softmodels.components.fibres import Sheet
from softmodels.components.loads import Force, Gravity, Mass
from softmodels.components.rigid import Rigid
from softmodels.materials.laws import Gent, MooneyRivlin, NeoHookean, Ogden, Yeoh
from softmodels.mechanics.controls import Coupling, pressure_control, volume_control
from softmodels.mechanics.sensitivity import MeshMotion, Sensitivity, known_parameters
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from softmodels.path.continuation import Continuation, trace
from softmodels.path.schedule import apply_preload, inflate_from
from softmodels.path.stability import AddedVolume
from tests.support.campaigns import sampled

TAYLOR = "Taylor's remainder of displacement, pressure and volume, before and past a limit point"
LAWS = {
    "neo-hookean": NeoHookean(30e3, 0.45),
    "mooney-rivlin": MooneyRivlin(14e3, 400.0, 0.45),
    "yeoh": Yeoh(15e3, 10.0, 0.1, 0.45),
    "ogden": Ogden((28e3, 20.0), (2.0, 4.0), 0.45),
    "gent": Gent(30e3, 300.0, 0.45),
}
THIN = HollowDisk.variant("shadow", section="axisymmetric", cell_size=0.004)
WEDGE = HollowDisk(angle=15.0, azimuth=20.0, cell_size=0.008, fillet=0.0, base_fillet=0.0)
BEFORE, PAST = 0.3, 6.0
"""Added volumes in cavity radii cubed."""


@pytest.fixture(scope="module")
def sensitivity():
    known = {}

    def make(equations):
        if id(equations) not in known:
            known[id(equations)] = Sensitivity(equations, MeshMotion(equations.system.body))
        return known[id(equations)]

    return make


def changed(material, name, by):
    """A material with one number moved."""
    field = name if hasattr(material, name) else name[:-1]
    value = getattr(material, field)
    if not isinstance(value, tuple):
        return dataclasses.replace(material, **{field: value + by})
    return dataclasses.replace(material, **{field: tuple(v + by * (i == int(name[-1]) - 1) for i, v in enumerate(value))})


def size_of(equations, name):
    """A change of a parameter that is large: a tenth of it, or the whole of a small hardening."""
    device = equations.system.body.actuator
    if name in device.variable:
        return 0.1 * getattr(device, name)
    material = equations.system.material
    whole = getattr(material, name) if hasattr(material, name) else getattr(material, name[:-1])[int(name[-1]) - 1]
    return 0.02 if name == "poisson" else 0.1 * whole


def moved_state(equations, motion, material, name, by, control, guess):
    """The state on the line with one parameter moved, as w and P in Pa; the mesh is left as it was read."""
    device = equations.system.body.actuator
    if name in device.variable:
        motion.move(dataclasses.replace(device, **{name: getattr(device, name) + by}))
    else:
        equations.system.set_material(changed(material, name, by))
    weigh(equations)
    pressed = control == 0.0 or control > 20.0
    line = control / equations.system.stress_unit if pressed else control
    made = pressure_control(line) if pressed else volume_control(line)
    w, P = guess
    state = equations.solve(made, w, P / equations.system.stress_unit)
    found = state.w, state.P * equations.system.stress_unit, state.V * equations.system.volume_unit
    equations.system.set_material(material)
    if name in device.variable:
        motion.move(device)
    weigh(equations)
    return found


def weigh(equations):
    """Keep the dead loads' newtons in another shear modulus."""
    system = equations.system
    system.coupling = Coupling.proportional(system.body.actuator.ratios, system.dead.amounts / system.dead.units)


def remainders(equations, motion, material, state, rate, name, line):
    """What is left of the change of (w, P, V) after the linear part, for steps halved twice, relative to the linear part."""
    P, V = state.P * equations.system.stress_unit, state.V * equations.system.volume_unit
    left = []
    for step in size_of(equations, name) * np.array([0.5, 0.25, 0.125]):
        guess = state.w + step * rate.w, P + step * rate.P
        w, new_P, new_V = moved_state(equations, motion, material, name, step, line, guess)
        left.append(
            [
                np.linalg.norm(w - state.w - step * rate.w),
                abs(new_P - P - step * rate.P),
                abs(new_V - V - step * rate.V),
            ]
        )
    whole = [np.linalg.norm(state.w), abs(P) or 1.0, abs(V)]
    return np.array(left) / whole


def check(figure, equations, sensitivity, material, state, line=None, names=None):
    """Every parameter's remainder falls as the square of the step, or is nothing."""
    control = volume_control(state.V) if line is None else pressure_control(state.P)
    line = state.V if line is None else line
    names = names or (*known_parameters(material), "membrane")
    known = sensitivity(equations)
    _, rates = known.rates(state, control, names)
    for name in names:
        left = remainders(equations, known.motion, material, state, rates[name], name, line)
        for quantity in left.T:
            if quantity[0] > 1e-6:
                rate = np.log2(quantity[:-1] / quantity[1:])[-1]
                figure(TAYLOR, "distance of the order from 2, every parameter of every law", rate - 2.0, 0.25)
            else:
                assert quantity[-1] < 1e-6 and quantity[0] < 1e-6, name
    assert any(np.linalg.norm(rate.w) > 0.0 for rate in rates.values())
    return rates


def at(solved, equations, added):
    _, points, end = solved(equations, [added], "auto", "volume")
    assert end is None
    return points[-1]


@pytest.mark.parametrize("law", sampled(LAWS.values(), 2), ids=LAWS.keys())
def test_rates_on_both_sides_of_a_limit_point(law, equilibrium, solved, sensitivity, figure):
    equations = equilibrium(THIN, law)
    before, past = at(solved, equations, BEFORE), at(solved, equations, PAST)
    assert before.tangent.P > 0.0
    check(figure, equations, sensitivity, law, before.state)
    assert past.tangent.P * past.tangent.V < 0.0
    check(figure, equations, sensitivity, law, past.state)


@pytest.mark.parametrize("law", sampled(["neo-hookean", "yeoh"]))
def test_rates_without_a_pressure_field(law, equilibrium, solved, sensitivity, figure):
    equations = equilibrium(THIN, LAWS[law], "displacement")
    check(figure, equations, sensitivity, LAWS[law], at(solved, equations, PAST).state)


HEAVY = (Gravity("-z"), Mass("top", 0.020, name="brass"), Force("top", "z", 0.05, name="thread"))
LOADED = {
    "disk": (THIN, LAWS["yeoh"], HEAVY, (0.05, BEFORE, PAST)),
    "wedge": (WEDGE, LAWS["neo-hookean"], HEAVY[:2], (0.1,)),
    "membrane with a plate": (
        Membrane(plate_radius=0.008, clamp_width=0.005, cell_size=0.002), LAWS["yeoh"],
        (Gravity("-z"), Rigid("plate", name="plate", mass=0.020)), (0.05, 0.5),
    ),
}  # fmt: skip


@pytest.mark.parametrize(("actuator", "law", "components", "volumes"), sampled(LOADED.values()), ids=LOADED.keys())
def test_rates_under_dead_loads(actuator, law, components, volumes, body_of, figure):
    """Weights keep their newtons while the material changes, and a thicker membrane is heavier: where the device hangs, and
    before and past its limit point, with the volume kept and with the pressure kept."""
    equations = Solver(System(body_of(actuator), law, components=components))
    rates = Sensitivity(equations, MeshMotion(equations.system.body))
    dead, cavities = equations.system.dead, np.zeros(len(actuator.ratios))
    hung = inflate_from(
        equations, apply_preload(equations, [("its loads", np.concatenate([cavities, dead.amounts / dead.units]))])
    )
    names = (*known_parameters(law), *actuator.variable)
    check(figure, equations, lambda _: rates, law, hung, 0.0, names)
    *_, sag = rates.rates(hung, pressure_control(0.0), names[:1])
    assert np.abs(sag[names[0]].w).max() * getattr(law, names[0]) > 1e-3
    path = Continuation(equations, AddedVolume(), start=hung)
    for point in trace(path, list(volumes)):
        if point.requested:
            check(figure, equations, lambda _: rates, law, point.state, None, names)
            pressed = point.state.P * equations.system.stress_unit
            assert pressed > 20.0  # below, `moved_state` takes it for a volume
            check(figure, equations, lambda _: rates, law, point.state, pressed, names)


def test_rates_of_a_slice(equilibrium, solved, sensitivity, figure):
    law = LAWS["neo-hookean"]
    equations = equilibrium(WEDGE, law)
    check(figure, equations, sensitivity, law, at(solved, equations, 0.1).state)


def test_rates_with_a_sheet(body_of, solved, figure):
    """A bonded sheet keeps its own stiffness as the silicone's changes."""
    law, disk = LAWS["neo-hookean"], dataclasses.replace(THIN, membrane=0.003)
    equations = Solver(System(body_of(disk), law, components=[Sheet("top", 30.0)]))
    making = Sensitivity(equations, MeshMotion(equations.system.body))
    rates = check(figure, equations, lambda _: making, law, at(solved, equations, BEFORE).state)
    assert np.linalg.norm(rates["shear_modulus"].w) > 0.0


def test_rates_at_a_given_pressure(equilibrium, solved, sensitivity, figure):
    """On a line of pressure it is the volume that follows; a stiffness changes w there although it does not on a volume."""
    law = LAWS["neo-hookean"]
    equations = equilibrium(THIN, law)
    state = at(solved, equations, BEFORE).state
    rates = check(figure, equations, sensitivity, law, state, line=state.P * equations.system.stress_unit)
    assert all(pytest.approx(0.0, abs=1e-9) == rate.P for rate in rates.values())
    assert rates["shear_modulus"].V < 0.0 and rates["membrane"].V < 0.0


def test_incompressible_rubber_has_a_rate_by_poisson(equilibrium, solved, sensitivity, figure):
    """At 0.5 the bulk modulus is infinite, and its inverse has a slope all the same."""
    law = NeoHookean(30e3, 0.5)
    equations = equilibrium(THIN, law)
    state = at(solved, equations, BEFORE).state
    _, rates = sensitivity(equations).rates(state, volume_control(state.V), ["poisson"])
    slopes = []
    for step in (-0.004, -0.002):
        guess = state.w, state.P * equations.system.stress_unit
        moved = moved_state(equations, None, law, "poisson", step, state.V, guess)
        slopes.append((moved[1] - state.P * equations.system.stress_unit) / step)
    against = "differences of full solves, extrapolated"
    figure(
        against,
        "rate of the pressure by Poisson's ratio at 0.5",
        (2 * slopes[1] - slopes[0]) / rates["poisson"].P - 1,
        7.5e-5,
    )


def test_a_modulus_alone_moves_no_shape(equilibrium, solved, sensitivity):
    """At a given volume one stress scales the pressure and nothing else."""
    law = LAWS["neo-hookean"]
    equations = equilibrium(THIN, law)
    state = at(solved, equations, PAST).state
    _, rates = sensitivity(equations).rates(state, volume_control(state.V), ["shear_modulus"])
    assert np.abs(rates["shear_modulus"].w).max() * law.shear_modulus < 1e-14
    assert rates["shear_modulus"].P * law.shear_modulus == pytest.approx(state.P * equations.system.stress_unit, rel=1e-14)


def test_moved_mesh_is_the_other_disk(equilibrium, solved, figure):
    """A mesh stretched to another thickness gives the states of a mesh made for it, to the mesh's own error."""
    law = LAWS["neo-hookean"]
    disk = HollowDisk.variant("shadow", section="axisymmetric")
    equations, other = (equilibrium(d, law) for d in (disk, dataclasses.replace(disk, membrane=0.0021)))
    expected = at(solved, other, BEFORE).state.P
    moving = MeshMotion(equations.system.body)
    moving.move(dataclasses.replace(disk, membrane=0.0021))
    found = at(solved, equations, BEFORE).state.P
    moving.move(disk)
    plain = at(solved, equations, BEFORE).state.P
    figure("a mesh made for another membrane", "pressure on the moved mesh", found / expected - 1, 5e-4)
    assert abs(plain / expected - 1) > 0.03
