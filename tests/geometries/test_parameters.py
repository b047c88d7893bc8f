"""Continuous parameters by name: those of the shape and no others, entries of lists counted from 1."""

from __future__ import annotations

import dataclasses
from typing import ClassVar

import numpy as np
import pytest

from geometries import GeometryError, HollowDisk, SeminarActuator
from geometries.actuator import Designable, changed, parameter, parameter_names
from softmodels.common.schema import length_field, list_field, number_field


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
    with pytest.raises(
        GeometryError, match=r"not a continuous parameter of this Banded; it has cavity_radius, .*bands\[1\]"
    ):
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
