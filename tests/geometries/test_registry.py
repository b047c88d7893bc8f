"""Devices found by their names: the library's own when they are looked up, others once they are registered."""

from __future__ import annotations

import dataclasses
import inspect
import subprocess
import sys
from typing import ClassVar

import numpy as np
import pytest

import geometries
from geometries import ACTUATORS, GeometryError, HollowDisk, SeminarActuator, registry
from geometries.actuator import Designable, changed, parameter, parameter_names
from geometries.registry import PLACES, register_device
from softmodels.common import schema
from softmodels.common.schema import length_field, list_field, number_field
from softmodels.mechanics.component import COMPONENTS
from softmodels.path.supply import SUPPLIES


def test_the_librarys_devices_are_loaded_when_they_are_looked_up():
    text = (
        "import sys, geometries; from geometries import ACTUATORS as a; print(len(a), 'Beam' in a, *a); "
        "print('numpy' in sys.modules); a['Beam']; print(*(name for name in sys.modules if name in a.loaded or name in "
        f"{set(PLACES.values())}))"
    )
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True).stdout.splitlines()
    assert done == [f"{len(PLACES)} True {' '.join(PLACES)}", "False", "geometries.beam"]


def test_the_table_names_every_device_where_it_is_defined():
    for name, place in PLACES.items():
        assert ACTUATORS[name] is getattr(geometries, name) and ACTUATORS[name].__module__ == place
    assert list(PLACES) == sorted(PLACES)


@pytest.fixture
def table(monkeypatch):
    """The table as it is before any device is loaded; what is registered in it goes with the test."""
    monkeypatch.setattr(registry.ACTUATORS, "loaded", {})
    return registry.ACTUATORS


def test_a_librarys_name_is_taken_before_its_device_is_loaded(table):
    other = dataclasses.make_dataclass("Balloon", [], bases=(HollowDisk,), frozen=True)
    with pytest.raises(ValueError, match=r"Balloon. is taken by another device, in geometries\.balloon"):
        register_device(other)
    assert not table.loaded


def test_a_device_of_ones_own_stands_behind_the_librarys(table):
    own = dataclasses.make_dataclass("Own", [], bases=(HollowDisk,), frozen=True)
    assert "Own" not in table and register_device(own) is own
    assert "Own" in table and table["Own"] is own and [*table][-1] == "Own" and len(table) == len(PLACES) + 1
    with pytest.raises(KeyError):
        table["Nothing"]


# -- Continuous parameters by name: those of the shape and no others, entries of lists counted from 1 ----------------


@dataclasses.dataclass(frozen=True, kw_only=True)
class Banded(HollowDisk):
    """A disk with a list of numbers beside its lengths."""

    bands: tuple[float, ...] = list_field((1.0, 2.0, 4.0), "shares of three bands", numbers=True)
    names: tuple[str, ...] = list_field((), "their names")
    margin: float = length_field(0.001, "a limit of the workshop", shape=False)
    tilt: float = number_field(0.5, "a number", shape=True)
    stem: ClassVar = "banded"


DISK = ("cavity_radius", "membrane", "base", "wall", "cavity_height", "fillet", "base_fillet")


def test_names_are_those_of_the_shape():
    assert parameter_names(HollowDisk()) == DISK == parameter_names(HollowDisk(section="axisymmetric"))
    assert parameter_names(Banded()) == (*DISK, "bands[1]", "bands[2]", "bands[3]", "tilt")
    slab = parameter_names(SeminarActuator())
    assert {"length", "spread", "offset", "end_bore"} < set(slab)
    assert not {"channels", "least_wall", "cell_size", "around", "order", "part"} & set(slab)


def test_values_are_read_and_changed_by_name():
    device = Banded()
    assert [parameter(device, name) for name in ("membrane", "bands[3]", "tilt")] == [0.006, 4.0, 0.5]
    other = changed(device, {"bands[3]": np.float64(3.0), "membrane": 0.005, "bands[1]": 0.5})
    assert isinstance(other, Banded) and other.bands == (0.5, 2.0, 3.0) and other.membrane == 0.005
    assert dataclasses.replace(other, bands=device.bands, membrane=device.membrane) == device
    assert changed(device, {}) == device


@pytest.mark.parametrize("name", ["cell_size", "colour", "bands", "names[1]", "section", "azimuth"])
def test_other_names_are_refused_with_those_there_are(name):
    with pytest.raises(GeometryError, match=r"not a continuous parameter of this Banded; it has cavity_radius, .*bands\[1\]"):
        parameter(Banded(), name)


def test_places_beyond_a_list_and_impossible_values_are_refused():
    with pytest.raises(GeometryError, match="bands has 3 entries"):
        changed(Banded(), {"bands[4]": 1.0})
    with pytest.raises(GeometryError, match="bands has 3 entries"):
        parameter(Banded(), "bands[0]")
    with pytest.raises(GeometryError, match="membrane is -1 mm"):
        changed(Banded(), {"membrane": -0.001})


def test_a_device_that_says_nothing_cannot_be_designed():
    class Plain(Designable):
        pass

    device = Plain()
    assert device.movable == () and device.clearances == {}
    with pytest.raises(GeometryError, match="mesh of Plain cannot follow its parameters"):
        device.carried(device, np.zeros((1, 3)))


def test_help_says_what_every_field_is():
    for kind in (*ACTUATORS.values(), *COMPONENTS.values(), *SUPPLIES.values()):
        described = inspect.getdoc(kind).partition("\nAttributes:\n")[2]
        for name, field in schema.about(kind).items():
            assert f"    {name}: {field.text}" in described, (kind.__name__, name)
