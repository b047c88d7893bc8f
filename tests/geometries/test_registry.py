"""Devices found by their names: the library's own when they are looked up, others once they are registered."""

from __future__ import annotations

import dataclasses
import subprocess
import sys

import pytest

import geometries
from geometries import ACTUATORS, HollowDisk, registry
from geometries.registry import PLACES, register_device


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
