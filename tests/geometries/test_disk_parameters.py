"""Parameters: impossible ones are refused by name and value, possible ones survive a settings file unchanged."""

from __future__ import annotations

import math
import subprocess
import sys
import tomllib

import numpy as np
import pytest

from geometries import ACTUATORS, GeometryError, Hold, HollowDisk
from geometries.imported import ImportedPart
from geometries.registry import device_from, from_table, to_table
from tests.support.campaigns import sampled

REFUSED = [
    ({"cavity_radius": -0.01}, "cavity_radius", "-10 mm"),
    ({"membrane": 0.0}, "membrane", "0 mm"),
    ({"base": math.nan}, "base", "nan"),
    ({"wall": math.inf}, "wall", "inf"),
    ({"cavity_height": 4.0e-6}, "cavity_height", "4 um"),
    ({"cavity_radius": 20.0}, "cavity_radius", "20 m"),
    ({"cavity_radius": 9.0, "wall": 9.0}, "wall", "9 m"),
    ({"fillet": -0.001}, "fillet", "-1 mm"),
    ({"fillet": 0.004}, "fillet", "4 mm"),
    ({"base_fillet": 0.0045}, "base_fillet", "4.5 mm"),
    ({"fillet": 0.0025, "base_fillet": 0.002}, "base_fillet", "2 mm"),
    ({"fillet": 0.012, "cavity_height": 0.02}, "fillet", "12 mm"),
    ({"angle": 50}, "angle", "50 deg"),
    ({"angle": 0}, "angle", "0 deg"),
    ({"angle": -45}, "angle", "-45 deg"),
    ({"angle": 720}, "angle", "720 deg"),
    ({"angle": 1}, "angle", "1 deg"),
    ({"azimuth": 1000}, "azimuth", "1000 deg"),
    ({"cell_size": 0.011}, "cell_size", "11 mm"),
    ({"cell_size": 0.003, "membrane": 0.0002}, "cell_size", "membrane"),
    ({"cell_size": 0.00002}, "cell_size", "0.02 mm"),
    ({"refinement": 0.5}, "refinement", "0.5"),
    ({"refinement": 1e5}, "refinement", "100000"),
    ({"order": 3}, "order", "3"),
    ({"order": True}, "order", "True"),
    ({"section": "cube"}, "section", "cube"),
    ({"support": "rope"}, "support", "rope"),
    ({"membrane": None}, "membrane", "None"),
    ({"profile": (1,)}, "profile", "1 entry"),
    ({"profile": (1,) * 13}, "profile", "13 entries"),
    ({"profile": (1, 0.05)}, "profile[2]", "0.05"),
    ({"profile": (1, 1, 11)}, "profile[3]", "11"),
    ({"profile": (-1, 1)}, "profile[1]", "-1"),
    ({"profile": (10, 0.1, 0.1, 10)}, "profile", "leaves a membrane of 0 mm"),
    ({"profile": (0.1, 1), "membrane": 0.002}, "cell_size", "0.2 mm"),
    ({"profile": (10, 10), "membrane": 0.05}, "membrane", "500 mm"),
    ({"profile": 1.0}, "profile", "1.0"),
    ({"profile": (1, "thick")}, "profile", "thick"),
    ({"profile": (1, math.nan)}, "profile", "nan"),
]


@pytest.mark.parametrize(("changes", "name", "value"), REFUSED, ids=[str(case[0]) for case in REFUSED])
def test_impossible_parameters_are_refused_by_name_and_value(changes, name, value):
    with pytest.raises(GeometryError) as caught:
        HollowDisk(**changes)
    assert name in str(caught.value) and value in str(caught.value)
    assert "\n" not in str(caught.value)


def test_angle_means_nothing_to_a_profile():
    assert HollowDisk(section="axisymmetric", angle=50).copies == 1


def test_equal_parameters_are_equal_whatever_their_type():
    first, second = HollowDisk(angle=90, order=2, membrane=np.float64(0.004)), HollowDisk(angle=90.0, membrane=0.004)
    assert first == second and first.key == second.key and hash(first) == hash(second)
    assert first.key != HollowDisk(angle=90, membrane=math.nextafter(0.004, 1)).key
    assert first.name == f"HollowDisk-{first.key}"


def test_key_is_the_same_in_another_process():
    code = "from geometries import HollowDisk; print(HollowDisk(membrane=0.004).key)"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == HollowDisk(membrane=0.004).key


@pytest.mark.parametrize("name", sampled(HollowDisk.variants, 3))
def test_variants_survive_a_table(name):
    disk = HollowDisk.variant(name)
    assert from_table(to_table(disk)) == disk


def test_any_float_survives_a_table_and_a_toml_file():
    random = np.random.default_rng(7)
    for _ in range(20):
        lengths = {name: random.uniform(0.003, 0.02) for name in ("cavity_radius", "membrane", "base", "wall")}
        shares = tuple(random.uniform(0.8, 1.3, random.integers(2, 13))) if random.random() < 0.5 else ()
        disk = HollowDisk(
            **lengths, profile=shares, cell_size=0.003, azimuth=random.uniform(-360, 360), angle=360 / 7, refinement=1.7
        )
        table = to_table(disk)
        text = "\n".join(f"{key} = {value!r}" for key, value in table.items())
        assert from_table(tomllib.loads(text)) == disk


def test_table_is_friendly():
    table = to_table(HollowDisk())
    assert table["device"] == "HollowDisk" and table["membrane"] == "6 mm"
    assert table["cavity_radius"] == "10 mm" and table["angle"] == "45 deg" and table["order"] == 2
    assert from_table({"device": "HollowDisk", "variant": "shadow", "membrane": "0.3 cm"}) == HollowDisk.variant(
        "shadow", membrane=0.003
    )


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({}, ["device", "HollowDisk"]),
        ({"device": "Sponge"}, ["device", "Sponge"]),
        ({"device": "HollowDisk", "colour": "red"}, ["colour", "membrane"]),
        ({"device": "HollowDisk", "membrane": "6"}, ["membrane", "6", "unit"]),
        ({"device": "HollowDisk", "membrane": 6}, ["membrane", "6", "unit"]),
        ({"device": "HollowDisk", "membrane": "6 kg"}, ["membrane", "6 kg"]),
        ({"device": "HollowDisk", "membrane": [1]}, ["membrane", "[1]"]),
        ({"device": "HollowDisk", "profile": "1, 2"}, ["profile", "1, 2", "list"]),
        ({"device": "HollowDisk", "profile": ["1 mm", 2]}, ["profile", "1 mm", "numbers"]),
        ({"device": "HollowDisk", "refinement": "two"}, ["refinement", "two"]),
        ({"device": "HollowDisk", "variant": "huge"}, ["variant", "huge", "shadow"]),
    ],
)
def test_wrong_tables_are_refused(table, words):
    with pytest.raises(GeometryError) as caught:
        from_table(table)
    assert all(word in str(caught.value) for word in words)


def test_variant_comes_first_and_none_means_not_given():
    disk = device_from(HollowDisk, {"variant": "shadow", "membrane": 0.003, "base": None})
    assert disk == HollowDisk.variant("shadow", membrane=0.003)
    assert device_from(HollowDisk, {}) == HollowDisk()


@pytest.mark.campaign
def test_expected_cells_are_of_the_right_size(meshed):
    for disk in (HollowDisk(), HollowDisk.variant("shadow", angle=30)):
        cells = len(meshed(disk).groups[3, "solid"].corners)
        assert 0.5 < disk.expected_cells / cells < 2.5


def test_every_device_has_a_default_variant_and_texts():
    for name, device in ACTUATORS.items():
        assert device.__name__ == name and device.variants["default"] == {}
        if not issubclass(device, ImportedPart):  # which is nothing without a file
            assert device().lift == (0.0, 0.0, 1.0)


# -- The axisymmetric hollow disk: roles on the right lines, volumes by turning the profile --------------------------


PROFILES = {
    "rim": HollowDisk(section="axisymmetric"),
    "base": HollowDisk(section="axisymmetric", support="base", fillet=0),
    "straight": HollowDisk(section="axisymmetric", order=1),
    "thin": HollowDisk.variant("shadow", section="axisymmetric"),
}


@pytest.fixture(params=PROFILES.values(), ids=PROFILES.keys())
def disk(request):
    return request.param


def test_groups_and_symmetry(disk, meshed):
    support = (0, "support") if disk.support == "rim" else (1, "support")
    assert set(meshed(disk).groups) == {(2, "solid"), (1, "cavity"), (1, "top"), (1, "outer"), (1, "axis"), support}
    assert (disk.dimension, disk.copies, disk.cut_planes) == (2, 1, ())
    held = Hold("support", (0, 0, 1), point=True) if disk.support == "rim" else Hold("support", None)
    assert disk.holds == (held, Hold("axis", (1, 0, 0)))


def test_lines_are_where_their_roles_say(disk, meshed):
    mesh = meshed(disk)
    near = 1e-12 * disk.outer_radius
    assert np.abs(mesh.at(1, "axis")[:, 0]).max() < near
    assert mesh.groups[1, "axis"].measure == pytest.approx(disk.base + disk.membrane)
    r, z = mesh.at(1, "outer")[:, :2].T
    bottom = np.abs(z) < near
    assert np.all(bottom | (np.abs(z - disk.height) < near) | (np.abs(r - disk.outer_radius) < near))
    assert np.count_nonzero(bottom) > 1 if disk.support == "rim" else np.count_nonzero(bottom) == 1
    cavity = 2 * disk.cavity_radius + disk.cavity_height
    cavity -= (2 - np.pi / 2) * (disk.fillet + disk.base_fillet)
    assert mesh.groups[1, "cavity"].measure == pytest.approx(cavity, rel={1: 1e-2, 2: 1e-4}[disk.order])
    if disk.support == "rim":
        assert mesh.at(0, "support") == pytest.approx(np.array([[disk.outer_radius, 0, 0]]))
    else:
        assert mesh.groups[1, "support"].measure == pytest.approx(disk.outer_radius)


def test_area_and_flatness(disk, meshed):
    mesh = meshed(disk)
    assert np.abs(mesh.at(2, "solid")[:, 2]).max() == 0.0
    area = disk.outer_radius * disk.height - disk.cavity_radius * disk.cavity_height
    area += (disk.fillet**2 + disk.base_fillet**2) * (1 - np.pi / 4)
    assert mesh.groups[2, "solid"].measure == pytest.approx(area, rel={1: 1e-3, 2: 1e-5}[disk.order])


def test_every_edge_on_the_boundary_has_one_role(disk, meshed):
    mesh = meshed(disk)
    cells = mesh.groups[2, "solid"].corners
    edges = np.sort(np.concatenate([cells[:, list(two)] for two in ((0, 1), (1, 2), (2, 0))]), axis=1)
    edges, shared = np.unique(edges, axis=0, return_counts=True)
    named = np.sort(np.concatenate([group.corners for (dim, _), group in mesh.groups.items() if dim == 1]), axis=1)
    assert set(shared) == {1, 2}
    assert np.array_equal(np.unique(named, axis=0), edges[shared == 1]) and len(named) == np.sum(shared == 1)


def test_probes_and_profile_in_device_coordinates(disk, meshed):
    mesh = meshed(disk)
    points = disk.device_points(mesh.at(2, "solid"))
    for place in disk.probes.values():
        assert np.linalg.norm(points - place, axis=1).min() < 1e-12
    line = points[disk.on_profile(points)]
    assert np.all(line[:, 1] == 0.0) and line[:, 2] == pytest.approx(disk.height)
    assert line[:, 0].min() == pytest.approx(0.0, abs=1e-12) and line[:, 0].max() == pytest.approx(disk.outer_radius)


def test_closed_volumes_agree_with_turning_the_outline():
    disk = HollowDisk(fillet=0.0025, base_fillet=0.0012)
    z = np.linspace(disk.base, disk.ceiling, 200_001)
    over = np.maximum(z - (disk.ceiling - disk.fillet), 0.0)
    under = np.maximum(disk.base + disk.base_fillet - z, 0.0)
    upper = disk.fillet - np.sqrt(np.maximum(disk.fillet**2 - over**2, 0.0))
    lower = disk.base_fillet - np.sqrt(np.maximum(disk.base_fillet**2 - under**2, 0.0))
    r = disk.cavity_radius - upper - lower
    assert disk.cavity_volume == pytest.approx(np.trapezoid(np.pi * r**2, z), rel=1e-7)
    assert disk.cavity_volume + disk.solid_volume == pytest.approx(np.pi * disk.outer_radius**2 * disk.height)
