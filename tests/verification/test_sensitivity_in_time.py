"""Derivatives through a device's history: Taylor's remainder after a hundred steps, one rank against two, and the cost."""

from __future__ import annotations

import numpy as np
import pytest

from geometries import HollowDisk
from softmodels.case.materials import Region
from softmodels.materials.laws import NeoHookean, Yeoh
from softmodels.materials.specimens import nudged
from softmodels.mechanics.controls import pressure_control, volume_control
from softmodels.mechanics.sensitivity import InTime, Sensitivity, known_parameters, memory_parameters
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from tests.support import bodies
from tests.support.campaigns import sampled

TAYLOR = "Taylor's remainder of displacement, pressure and volume through a hundred steps in time"
DISK = HollowDisk(section="axisymmetric", cell_size=0.006, fillet=0.0, base_fillet=0.0)
BRANCHES = [(0.2, 1.0), (0.1, 30.0)]
LAWS = {
    "branches": Yeoh(14e3, 600.0, 50.0, 0.49).with_memory(branches=BRANCHES),
    "softening": NeoHookean(28e3, 0.5).with_memory(softening=(1.6, "2 kPa", 0.1)),
    "viscosity by stress": NeoHookean(28e3, 0.5).with_memory(
        branches=[{"share": 0.3, "time": 2.0, "onset": 0.1, "exponent": 1.0, "growth": 0.5, "spring": [(1.0, 1.2)]}]
    ),
    "both": Yeoh(14e3, 600.0, 50.0, 0.5).with_memory(branches=BRANCHES, softening=(1.6, "2 kPa", 0.1, "20 s")),
}
CORNERS = np.array([0.0, 2.5, 12.5, 15.0, 40.0])
TIMES = np.cumsum(np.repeat(np.diff(CORNERS) / 25, 25))
LEVELS = {"pressure": np.array([0.0, 12e3, 12e3, 3e3, 3e3]), "volume": 1e-6 * np.array([0.0, 1.5, 1.5, 0.5, 0.5])}
LOOKS = (24, 49, 74, 99)


def through(solver, kind="pressure", by=0.0, in_time=None):
    """States at `LOOKS` under a pressure in Pa or an added volume in m3, raised by a share; and their rates."""
    eq, found = solver.system, []
    state, last, rest = eq.rest(), 0.0, eq.rest().V
    eq.potential.commit(state.w, reset=True)
    for number, time in enumerate(TIMES.tolist()):
        level = float(np.interp(time, CORNERS, LEVELS[kind]))
        value = level * (1.0 + by)
        line = pressure_control(value / eq.stress_unit) if kind == "pressure" else volume_control(rest + value / eq.volume_unit)
        eq.potential.pass_time(time - last)
        state, last = solver.solve(line, state.w, state.P), time
        rates = in_time.step(state, line, {"level": level})[1] if in_time else {}
        eq.potential.commit(state.w)
        if number in LOOKS:
            found.append((state, eq.stress_unit, eq.volume_unit, rates))
    return found


def size_of(material, name):
    """A change of a parameter that is large: a tenth of it."""
    own = material.memory
    if name.startswith(("share", "time")):
        return 0.1 * getattr(own.branches[int(name[-1]) - 1], name[:-1])
    sizes = {
        "softening": lambda: 0.06,
        "softening_m": lambda: 200.0,
        "softening_beta": lambda: 0.01,
        "poisson": lambda: -0.02,
    }
    return sizes[name]() if name in sizes else 0.1 * getattr(material, name)


def orders(solver, law, names, states, kind, figure):
    """Record the order of the remainder when all of some parameters change together, where it is more than rounding."""
    left = []
    sizes = {name: 0.1 if name == "level" else size_of(law, name) for name in names}
    for share in (0.2, 0.1):
        changed = law
        for name in set(names) - {"level"}:
            changed = nudged(changed, name, share * sizes[name])
        solver.system.set_material(changed)
        row = []
        there_on = through(solver, kind, share * sizes.get("level", 0.0))
        for (here, P_unit, V_unit, rates), (there, P_there, _, _) in zip(states, there_on, strict=True):
            w, P, V = (sum(share * sizes[name] * getattr(rates[name], part) for name in names) for part in "wPV")
            row += [
                np.linalg.norm(there.w - here.w - w) / np.linalg.norm(here.w),
                abs(there.P * P_there - here.P * P_unit - P) / abs(here.P * P_unit),
                abs((there.V - here.V) * V_unit - V) / abs(here.V * V_unit),
            ]
        left.append(row)
    solver.system.set_material(law)
    for name, size in sizes.items():
        assert max(np.linalg.norm(size * rates[name].w) for _, _, _, rates in states) > 1e-6, name
    for quantity in np.array(left).T:
        if quantity[-1] > 1e-8:
            order = np.log2(quantity[0] / quantity[1])
            figure(TAYLOR, "distance of the order from 2, every parameter of law and memory", order - 2.0, 0.3)
        else:
            assert quantity[0] < 1e-5, names


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("law", "kind"),
    sampled(
        [
            ("viscosity by stress", "pressure"),
            ("softening", "pressure"),
            ("both", "volume"),
        ]
    ),
)
def test_rates_through_a_hundred_steps(law, kind, body_of, figure):
    law = LAWS[law]
    solver = Solver(System(body_of(DISK), law, creeping=True))
    names = [name for name in (*known_parameters(law), *memory_parameters(law)) if name != "poisson" or law.poisson < 0.5]
    in_time = InTime(Sensitivity(solver), names, ["level"])
    states = through(solver, kind, in_time=in_time)
    # The law, its memory and the level apart, so that large rates do not hide an error of small ones.
    for some in (known_parameters(law), memory_parameters(law), ["level"]):
        orders(solver, law, [name for name in some if name in (*names, "level")], states, kind, figure)


@pytest.mark.campaign
def test_two_silicones(body_of, figure):
    """Each region's own branches, by the region's name: central differences after twelve steps of a rise and a hold."""
    laws = {
        "": NeoHookean(30e3, 0.45).with_memory(branches=[(0.3, 2.0)]),
        "shell": Yeoh(40e3, 2e3, 100.0, 0.45).with_memory(branches=[(0.2, 1.0), (0.1, 20.0)]),
    }
    body = body_of(bodies.LayeredSphere(through=2, along=6))
    solver = Solver(System(body, laws[""], components=[Region(laws["shell"], name="shell")], creeping=True))
    eq = solver.system

    def last(in_time=None):
        state, rates = eq.rest(), {}
        eq.potential.commit(state.w, reset=True)
        for step, pressure in zip([0.5] * 6 + [2.0] * 6, [*np.linspace(3e3, 15e3, 6), *[15e3] * 6], strict=True):
            eq.potential.pass_time(step)
            line = pressure_control(pressure / eq.stress_unit)
            state = solver.solve(line, state.w, line.target)
            rates = in_time.step(state, line)[1] if in_time else {}
            eq.potential.commit(state.w)
        return state, rates

    names = ("shear_modulus", "share1", "time1", "shell.c1", "shell.share1", "shell.time2", "shell.share2")
    _, rates = last(InTime(Sensitivity(solver), names))
    for name in names:
        where, _, number = name.rpartition(".")
        step, ends = 0.02 * size_of(laws[where], number), []
        for sign in (1, -1):
            moved = laws | {where: nudged(laws[where], number, sign * step)}
            eq.potential.regions[1].material = moved["shell"]
            eq.set_material(moved[""])
            ends.append(last()[0].V * eq.volume_unit)
        eq.potential.regions[1].material = laws["shell"]
        eq.set_material(laws[""])
        apart = (ends[0] - ends[1]) / (2 * step) / rates[name].V - 1
        figure("central differences of a creeping sphere of two layers", "volume, by numbers of both laws", apart, 1.7e-5)


@pytest.mark.campaign
def test_a_parameter_costs_one_linear_solve_a_step(body_of, monkeypatch):
    """With the factorisation of the step, whatever the number of parameters."""
    law, made, solved = LAWS["branches"], [], []
    solver = Solver(System(body_of(DISK), law, creeping=True))
    sensitivity = Sensitivity(solver)
    make, respond = solver.factorise, solver.linear_response
    monkeypatch.setattr(solver, "factorise", lambda state: (made.append(1), make(state))[1])
    monkeypatch.setattr(solver, "linear_response", lambda *words: (solved.append(1), respond(*words))[1])
    names = [*known_parameters(law), *memory_parameters(law)]
    through(solver, in_time=InTime(sensitivity, names, ["level"]))
    assert len(made) == len(TIMES) and len(solved) == len(TIMES) * (len(names) + 2)  # the level's, and the path's tangent
