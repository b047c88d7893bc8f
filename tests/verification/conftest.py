"""What solves bodies whose behaviour is known (`tests.support.bodies`)."""

from __future__ import annotations

import numpy as np
import pytest

KEPT = 6
"""Equations that are kept for tests that ask for them again."""


@pytest.fixture(scope="session")
def body_of(comm, tmp_path_factory):
    """Return a function that meshes an actuator and reads it, once for all tests."""
    from softmodels.mechanics.body import Body

    folder = tmp_path_factory.mktemp("bodies")
    known = {}

    def body(actuator, kind=Body):
        key = (kind, type(actuator), actuator.key)
        if key not in known:
            known[key] = kind.from_file(actuator, actuator.write(folder / f"{actuator.name}.msh"), comm)
        return known[key]

    return body


@pytest.fixture(scope="session")
def equilibrium(body_of):
    """Return a function that gives the equations of a device, once per device, law and formulation while they are in use.

    A state of the equations belongs to the test that asks: every use begins with a solve or with values of its own. Those asked
    for last are kept: each has a factorisation, and all of a session's together take gigabytes.
    """
    from softmodels.mechanics.body import Body
    from softmodels.mechanics.solver import Solver
    from softmodels.mechanics.system import System

    known = {}

    def make(actuator, material, formulation="mixed", kind=Body):
        key = (kind, type(actuator), actuator.key, type(material), formulation)
        terms = len(getattr(material, "mu", ()))
        if (key, terms) not in known:
            known[key, terms] = Solver(System(body_of(actuator, kind), material, formulation))
        equations = known[key, terms] = known.pop((key, terms))  # the last one asked for comes last
        while len(known) > KEPT:
            known.pop(next(iter(known)))
        equations.system.set_material(material)
        equations.system.direction = 1
        equations.system.coupling = equations.system.inflating(np.empty(0))
        return equations

    return make


@pytest.fixture(scope="session")
def solved():
    """Return a function that follows a device through requested values and gives its path and all its points.

    The points end where the path does; `PathEnd` is the third value then, else None.
    """
    from softmodels.path.continuation import Continuation, trace
    from softmodels.path.stability import QUANTITIES, PathEnd

    def solve(equations, goals, control="auto", quantity="pressure", **options):
        path = Continuation(equations, QUANTITIES.get(quantity, quantity), control, **options)
        points, end = [], None
        try:
            points.extend(trace(path, goals))
        except PathEnd as met:
            end = met
        return path, points, end

    return solve
