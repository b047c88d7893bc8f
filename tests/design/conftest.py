"""Devices that are designed, and what is asked of them."""

from __future__ import annotations

import numpy as np
import pytest

from geometries import HollowDisk
from softmodels.case.case import Case
from softmodels.case.load import steps_of
from softmodels.design.extremes import PeakStretch, PeakVonMises
from softmodels.design.model import DesignModel
from softmodels.design.quantities import AddedVolume, Clearances, LimitMargin, Mass, Place, Rise, StoredEnergy
from softmodels.design.trials import EvaluatedLoad
from softmodels.materials.laws import NeoHookean

WORKING = 2000.0
"""Pa; a thin disk of this silicone balloons at 3.4 kPa."""
PAST = EvaluatedLoad("volume", 40e-6)
"""Far past the limit point."""
SILICONE = NeoHookean(20e3, 0.49)


@pytest.fixture(scope="session")
def designed():
    """Return a function that makes a design model of a device; those asked for last are kept, since each has factorisations."""
    known = {}

    def make(device, names, quantities, comm, components=(), **more):
        key = (device, tuple(names), tuple(quantities), components, tuple(more.items()))
        if key not in known:
            case = Case(
                name="design",
                actuator=device,
                material=SILICONE,
                steps=steps_of(pressure_cm=(20.0,)),
                components=components,
            )
            known[key] = DesignModel(case, names, quantities, comm, **more)
        model = known[key] = known.pop(key)  # the last one asked for comes last
        while len(known) > 4:
            known.pop(next(iter(known)))
        return model

    yield make
    for model in known.values():
        model.release()


@pytest.fixture(scope="session")
def thin_disk():
    """A thin disk's section whose membrane has a profile."""
    return HollowDisk.variant("shadow", section="axisymmetric", cell_size=0.004, profile=(1.0, 1.0, 1.1))


@pytest.fixture(scope="session")
def of_all_kinds():
    """Quantities of every kind before and past the limit point."""
    return (
        Rise(at=WORKING), Place(at=WORKING, of="ceiling"), AddedVolume(at=WORKING), StoredEnergy(at=WORKING),
        PeakStretch(at=WORKING), PeakVonMises(at=WORKING), LimitMargin(), Mass(), Rise(at=PAST), StoredEnergy(at=PAST),
        PeakStretch(at=PAST), Clearances(),
    )  # fmt: skip


@pytest.fixture(scope="session")
def taylor():
    """Return a function that gives, by quantity, the order of Taylor's remainder and its last share of the linear part."""

    def remainders(model, name, share=0.01):
        start = model.start
        here = model.evaluate(start)
        i, found = model.names.index(name), {}
        step = share * start[i]
        left = []
        for part in (1.0, 0.5, 0.25):
            theta = start.copy()
            theta[i] += part * step
            there = model.evaluate(theta)
            left.append({key: there.values[key] - here.values[key] - part * step * g[i] for key, g in here.gradients.items()})
        for key, gradient in here.gradients.items():
            linear = abs(0.25 * step * gradient[i])
            last, before = abs(left[2][key]), abs(left[1][key])
            if max(linear, last) > 1e-8 * abs(here.values[key]):  # states are solved to about 1e-11
                found[key] = np.log2(before / last) if last else np.inf, last / linear
        return found

    return remainders


@pytest.fixture
def second_order(taylor, figure):
    """Return a function that asserts that Taylor's remainder by a length is of second order: its figures go into a table.

    Either it falls as the square of the step, or it is next to nothing: the square's factor may vanish.
    """

    def check(model, name, table, what, share=0.01):
        found = taylor(model, name, share)
        assert found
        for order, left in found.values():
            if left > 2e-3:
                figure(table, f"distance of the order from 2, {what}", order - 2.0, 0.3)
            else:
                figure(table, f"remainder over the linear part at the smallest step, {what}", left, 2e-3)

    return check
