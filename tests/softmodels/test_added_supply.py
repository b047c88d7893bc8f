"""A supply of one's own: defined here in one class, followed by the path as it is, held against its closed relation."""

from __future__ import annotations

import dataclasses
from typing import ClassVar

import pytest

from geometries import HollowDisk
from softmodels.materials.laws import Yeoh
from softmodels.path.continuation import Continuation, trace
from softmodels.path.stability import AddedVolume, Supply

MUCH, LITTLE = 40e3, 4.0
"""Volume of a bottle in cavities."""


@dataclasses.dataclass(frozen=True)
class Bottle(Supply):
    """A bottle in front of the cavity, into which gas is let; isothermal, (P + P0) (B + V - V0) = P0 (B + gas let in).

    Attributes:
        bottle: Volume B of the bottle and tubes.
        rest: Volume V0 of the cavity at rest.
        ambient: Absolute pressure P0 around.
    """

    bottle: float
    rest: float
    ambient: float
    name: ClassVar[str] = "gas let in"

    def value(self, V: float, P: float) -> float:
        """Volume of the gas that was let in, at the pressure around."""
        return (1 + P / self.ambient) * (self.bottle + V - self.rest) - self.bottle

    def slopes(self, V: float, P: float) -> tuple[float, float]:
        return 1 + P / self.ambient, (self.bottle + V - self.rest) / self.ambient

    @property
    def weight(self) -> float:
        return 1 / (1 + self.bottle / self.ambient)


@pytest.fixture(scope="module")
def device(tmp_path_factory):
    from mpi4py import MPI

    from softmodels.mechanics.body import Body
    from softmodels.mechanics.solver import Solver
    from softmodels.mechanics.system import System

    disk = HollowDisk.variant("shadow", section="axisymmetric", support="base", cell_size=0.004)
    file = disk.write(tmp_path_factory.mktemp("bottle") / "disk.msh")
    return Solver(System(Body.from_file(disk, file, MPI.COMM_SELF), Yeoh(10e3, 20.0, 0.0, 0.495)))


def bottle(device, cavities):
    rest = device.system.rest().V
    return Bottle(cavities * rest, rest, 101.325e3 / device.system.stress_unit)


def test_the_gas_obeys_its_closed_relation(device):
    supply = bottle(device, LITTLE)
    goals = [0.5 * supply.rest, 1.5 * supply.rest]
    path = Continuation(device, supply)
    points = list(trace(path, goals))
    asked = [point.state for point in points if point.requested]
    for state, let_in in zip(asked, goals, strict=True):
        gas = (state.P + supply.ambient) * (supply.bottle + state.V - supply.rest)
        assert gas == pytest.approx(supply.ambient * (supply.bottle + let_in), rel=1e-10)
    assert points[0].line == "gas let in" and asked[-1].P > asked[0].P > 0.0


def test_its_states_lie_on_the_devices_own_curve(device):
    """What pushes the gas does not matter: at the same volume the device has the same pressure."""
    supply = bottle(device, LITTLE)
    state = list(trace(Continuation(device, supply), [1.2 * supply.rest]))[-1].state
    again = list(trace(Continuation(device, AddedVolume()), [state.V - supply.rest]))[-1].state
    assert pytest.approx(again.P, rel=1e-8) == state.P


def test_little_gas_holds_states_past_the_pressures_limit_that_much_gas_jumps_over(device):
    little, much = bottle(device, LITTLE), bottle(device, MUCH)
    path = Continuation(device, little, largest_step=0.3 * little.rest)
    points = list(trace(path, [8 * little.rest]))
    past = [point for point in points if not point.stable_under_pressure]
    assert [point.limit for point in points].count(True) == 1 and len(past) > 3
    held = {
        supply: [point.stable_under(supply.line(point.state.V, point.state.P)) for point in past] for supply in (little, much)
    }
    assert all(held[little]) and not all(held[much])
