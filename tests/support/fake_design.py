"""A device, its quantities and what evaluates them in closed form, in place of finite elements: a disk as a thin membrane.

The optimiser's fast tests use it in their own process; commands in other processes get it by SOFTMODELS_MODULES.
"""

from __future__ import annotations

import dataclasses
import os
import time
import types
from typing import ClassVar

import numpy as np

from geometries import GeometryError, HollowDisk, register_device
from geometries.actuator import changed
from softmodels.common.schema import length_field
from softmodels.design import model, problem
from softmodels.design.quantities import DesignQuantity
from softmodels.design.trials import DesignFailure, EvaluatedLoad

DENSITY = 1070.0


@register_device
@dataclasses.dataclass(frozen=True, kw_only=True)
class FakeDisk(HollowDisk):
    """A disk that a design may change."""

    least_sum: float = length_field(0.001, "least membrane and wall together")

    movable: ClassVar = ("membrane", "cavity_radius", "wall", "base")

    def check(self):
        super().check()
        if self.membrane + self.wall < self.least_sum:
            raise GeometryError("membrane and wall are too thin together")

    @property
    def clearances(self):
        return {"membrane": self.membrane, "solid around the cavity": self.wall}


class FakeQuantity(DesignQuantity):
    name: ClassVar = ""
    unit: ClassVar = "1"

    def measure(self, design):
        raise NotImplementedError

    @property
    def key(self):
        return self.title if self.at is None else f"{self.title} at {EvaluatedLoad.of(self.at).value / 1e3:.6g} kPa"


class FakeRise(FakeQuantity):
    name: ClassVar = "rise"
    unit: ClassVar = "m"
    of: str = ""

    def value(self, device, mu, _):
        q = EvaluatedLoad.of(self.at).value / limit(device, mu)
        return 0.6 * device.cavity_radius * q ** (1 / 3) * (1 + 0.5 * q**4)


class FakeStretch(FakeQuantity):
    name: ClassVar = "max_stretch"

    def value(self, device, mu, _):
        return 1.0 + 0.5 * (FakeRise(at=self.at).value(device, mu, _) / device.cavity_radius) ** 2


class FakeMargin(FakeQuantity):
    name: ClassVar = "limit_margin"
    of_state: ClassVar = False

    def value(self, device, mu, working):
        return limit(device, mu) / working


class FakeMass(FakeQuantity):
    name: ClassVar = "mass"
    unit: ClassVar = "kg"
    of_state: ClassVar = False

    def value(self, device, mu, _):
        return DENSITY * device.solid_volume


class FakeClearances(FakeQuantity):
    name: ClassVar = "clearances"
    unit: ClassVar = "m"
    of_state: ClassVar = False


REGISTRY = {one.name: one for one in (FakeRise, FakeStretch, FakeMargin, FakeMass, FakeClearances)}


def limit(device, mu):
    """Largest pressure in Pa."""
    return 1.5 * mu * device.membrane / device.cavity_radius * (1 + 0.3 * device.wall / device.cavity_radius)


class FakeModel:
    """Values in closed form, gradients by central differences."""

    def __init__(self, case, names, quantities, comm=None):
        self.case, self.names, self.quantities, self.calls = case, names, quantities, []
        self.working = max(
            (EvaluatedLoad.of(one.at).value for one in quantities if one.at is not None), default=case.values[-1]
        )

    def values(self, theta, mu=None):
        device = changed(self.case.actuator, dict(zip(self.names, theta, strict=True)))
        mu = self.case.material.shear_modulus_0 if mu is None else mu
        if self.working > limit(device, mu):
            raise DesignFailure(f"the device jumps at {self.case.column.text(limit(device, mu))}")
        found = {}
        for one in self.quantities:
            if one.name == "clearances":
                found |= {f"clearance: {wall}": value for wall, value in device.clearances.items()}
            else:
                found[one.key] = one.value(device, mu, self.working)
        return found

    def evaluate(self, theta):
        self.calls.append(tuple(theta))
        time.sleep(float(os.environ.get("FAKE_SECONDS", "0")))
        values, slopes = self.values(theta), {}
        for k in range(len(theta)):
            step = 1e-6 * (abs(theta[k]) or 1e-3) * np.eye(len(theta))[k]
            ahead, back = self.values(theta + step), self.values(theta - step)
            for key in values:
                slopes.setdefault(key, np.zeros(len(theta)))[k] = (ahead[key] - back[key]) / (2 * step[k])
        mu = self.case.material.shear_modulus_0
        ahead, back = self.values(theta, 1.0001 * mu), self.values(theta, 0.9999 * mu)
        material = {key: {"shear_modulus": (ahead[key] - back[key]) / (2e-4 * mu)} for key in values}
        return types.SimpleNamespace(values=values, gradients=slopes, material_gradients=material, newton=5, quality=0.9,
                                     remeshed=False, squares={}, notes=())  # fmt: skip

    def confirm(self, theta, finer=1.0):
        return types.SimpleNamespace(values={key: 1.001 * value for key, value in self.values(theta).items()})

    def release(self):
        self.released = True


def install(setattr_=setattr):
    """Put the fake in the place of finite elements."""
    setattr_(problem, "QUANTITIES", REGISTRY)
    setattr_(model, "DesignModel", lambda case, names, quantities, comm, **_: FakeModel(case, names, quantities, comm))


if os.environ.get("FAKE_DESIGN"):
    install()


PROBLEM = """name = "more-rise"
[case.geometry]
device = "FakeDisk"
section = "axisymmetric"
[case.material]
law = "neo-hookean"
shear_modulus = "30 kPa"
[case.load]
pressure_cm = "0:177"
[parameters]
membrane = { from = "2 mm", to = "9 mm" }
cavity_radius = { from = "6 mm", to = "14 mm" }
[maximise]
quantity = "rise"
of = "apex"
at = "177 cm"
[[keep]]
quantity = "max_stretch"
at = "177 cm"
at_most = 1.18
[[keep]]
quantity = "limit_margin"
at_least = 1.3
"""
"""A problem of the device here that can be met."""
