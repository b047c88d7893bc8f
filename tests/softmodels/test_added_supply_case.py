"""A supply defined here is read from a case file and from options, and checked, without a change to the library."""

from __future__ import annotations

import dataclasses
from typing import ClassVar

import pytest

from geometries import HollowDisk
from softmodels.case.case import Case, entries
from softmodels.case.entries import CaseError
from softmodels.case.load import steps_of
from softmodels.common.schema import Quantity, field_of
from softmodels.materials.laws import NeoHookean
from softmodels.path.supply import SUPPLIES, AirSupply, Stroke, SupplyError, register_supply


@dataclasses.dataclass(frozen=True)
class Bottle(AirSupply):
    """A bottle in front of the cavity, into which gas is let; a stroke is the gas's volume at the pressure around."""

    bottle: float = field_of(Quantity("m^3"), "volume of the bottle", 1e-3)
    name: ClassVar[str] = "bottle"

    def check(self):
        if self.bottle <= 0:
            raise SupplyError("the bottle has no volume")

    def control(self, cavity, pressure_unit, volume_unit):
        rest = cavity / volume_unit
        return Stroke(rest, rest + self.bottle / volume_unit, 101.325e3 / pressure_unit, 1.0, 0.0)


@pytest.fixture(autouse=True)
def registered():
    register_supply(Bottle)
    yield
    del SUPPLIES["bottle"]


def test_it_is_read_from_a_case_file_to_the_last_bit():
    case = Case("disk", HollowDisk(), NeoHookean(30e3), steps=steps_of(stroke_ml=(0.0, 10 / 3)), supply=Bottle(1e-3 / 3))
    assert Case.from_toml(case.to_toml()) == case and 'kind = "bottle"' in case.to_toml()
    with pytest.raises(CaseError, match="bottle has no volume"):
        Case.from_toml(case.to_toml().split("[supply]")[0] + '[supply]\nkind = "bottle"\nbottle = "0 ml"\n')


def test_it_is_read_from_options():
    entry = entries()["supply"]
    names = {option.name for option in entry.options()}
    assert {"supply", "bottle", "syringe"} <= names
    given = dict.fromkeys(names) | {"supply": "bottle", "bottle": 5e-4}
    assert entry.take(given) == Bottle(5e-4) and not given
    with pytest.raises(SupplyError, match="bottle belongs to a bottle; add supply=Bottle"):
        entry.take(dict.fromkeys(names) | {"bottle": 5e-4})
    with pytest.raises(SupplyError, match="gas does not belong to a bottle"):
        entry.take(dict.fromkeys(names) | {"supply": "bottle", "gas": "liquid"})
