"""The seminar actuator: what can be built, what is refused by name, and whether the mesh is the shape."""

from __future__ import annotations

import math

import click
import gmsh
import numpy as np
import pytest

from geometries import GeometryError, SeminarActuator, plates
from geometries.actuator import changed, parameter, parameter_names
from geometries.meshing import private_model, summarize
from geometries.registry import device_options, device_told, from_table, to_table
from geometries.seminar import check_seminar, edge_distance, fan, half_fan
from tests.support.campaigns import sampled

COARSE = {"around": 6.0, "channels": 3, "spread": 60.0}


@pytest.fixture(scope="module")
def mesh(tmp_path_factory):
    """Return a function that meshes a slab once: its file."""
    folder = tmp_path_factory.mktemp("seminar")
    known = {}

    def make(**changes):
        slab = SeminarActuator(**{**COARSE, **changes})
        if slab not in known:
            known[slab] = slab.write(folder / f"{slab.name}.msh")
        return slab, known[slab]

    return make


def groups(path):
    """Nodes' places (m) by physical group."""
    found = {}
    with private_model():
        gmsh.merge(str(path))
        for dimension, tag in gmsh.model.getPhysicalGroups():
            _, places = gmsh.model.mesh.getNodesForPhysicalGroup(dimension, tag)
            found[gmsh.model.getPhysicalName(dimension, tag)] = places.reshape(-1, 3)
    return found


def test_default_is_a_believable_piece():
    slab = SeminarActuator()
    assert (slab.length, slab.base_width, slab.thickness) == (0.070, 0.060, 0.008)
    assert 0.2e-6 < slab.cavity_volume < 1e-6
    # A cone, its caps and the arc lie within a tenth of the network's volume, junctions counted twice.
    cones = sum(
        math.pi / 3 * (line.end - line.start) * (line.bore**2 + line.bore * (r := line.radius(line.end)) + r**2)
        + 2 / 3 * math.pi * line.cap**3
        for line in fan(slab)
    )
    arc = math.pi * slab.manifold_bore**2 * slab.manifold_radius * math.radians(slab.spread)
    caps = 4 / 3 * math.pi * slab.manifold_bore**3
    assert slab.cavity_volume == pytest.approx(cones + arc + caps, rel=0.1)
    assert slab.cavity_volume < cones + arc + caps


def test_one_channel_has_its_volume_in_closed_form():
    """A channel so deep in the manifold's shadow that what both share is small and known to bounds."""
    slab = SeminarActuator(channels=1, spread=40.0, channel_bore=0.0003, end_bore=0.0003, fillet=0.0)
    line = half_fan(slab)[0]
    bore = slab.manifold_bore
    straight = math.pi * line.bore**2
    arc = math.pi * bore**2 * slab.manifold_radius * math.radians(slab.spread) + 4 / 3 * math.pi * bore**3
    outside = straight * (line.end - line.start - bore) + 2 / 3 * math.pi * line.cap**3
    # The manifold's wall is curved: the channel leaves it up to bore - sqrt(bore^2 - r^2) earlier.
    most = straight * (bore - math.sqrt(bore**2 - line.bore**2))
    assert arc + outside - 1e-3 * most < slab.cavity_volume < arc + outside + most


def test_cap_continues_the_cone_without_a_corner():
    for changes in ({}, {"channel_bore": 0.0008, "end_bore": 0.0005}, {"end_bore": 0.0015}):
        slab = SeminarActuator(**changes)
        line = half_fan(slab)[0]
        radius = line.radius(line.end)
        assert math.hypot(line.end - line.centre, radius) == pytest.approx(line.cap, rel=1e-12)
        assert (line.end - line.centre) == pytest.approx(-line.cones[0].slope * radius, rel=1e-9, abs=1e-15)  # tangent


def test_ends_keep_their_distance_from_the_sides():
    slab = SeminarActuator()
    for line in fan(slab):
        place = line.centre * math.cos(line.angle), line.centre * math.sin(line.angle)
        assert edge_distance(slab, *place) == pytest.approx(slab.edge + slab.end_bore, rel=1e-9)


@pytest.mark.parametrize("tip_radius", sampled([0.0, 0.004, 0.012]))
def test_outline(tip_radius):
    """Area by counting points, distance to the sides against the nearest of many points on the outline."""
    slab = SeminarActuator(tip_radius=tip_radius, channels=1)
    x, y = np.meshgrid(np.linspace(0, slab.length, 801), np.linspace(0, slab.base_width / 2, 401), indexing="ij")
    inside = np.vectorize(lambda a, b: edge_distance(slab, a, b) > 0)(x, y)
    cell = slab.length / 800 * slab.base_width / 800
    assert inside.sum() * cell == pytest.approx(0.5 * plates.outline_area(slab.paths), rel=5e-3)
    assert edge_distance(slab, slab.length, 0.0) == pytest.approx(0.0, abs=1e-12)
    assert edge_distance(slab, 0.0, slab.base_width / 2) == pytest.approx(0.0, abs=1e-12)


def test_mesh_is_the_shape(mesh):
    slab, path = mesh()
    found = summarize(path)
    assert found.quality > 0.05  # no cell is turned inside out, curved edges counted
    assert found.measure * slab.copies == pytest.approx(slab.solid_volume, rel=1e-4)
    lost = plates.outline_area(slab.paths) * slab.thickness - found.measure * slab.copies
    assert lost == pytest.approx(slab.cavity_volume, rel=1e-2)


def test_roles_lie_where_they_should(mesh):
    slab, path = mesh()
    found, near, half = groups(path), 1e-9, slab.thickness / 2
    assert set(found) == {"solid", "cavity", "support", "top", "bottom", "tip", "outer", "plane0"}
    assert np.abs(found["support"][:, 0]).max() < near and np.abs(found["plane0"][:, 1]).max() < near
    assert np.abs(found["top"][:, 2] - half).max() < near and np.abs(found["bottom"][:, 2] + half).max() < near
    radius = np.hypot(found["tip"][:, 0] - slab.length + slab.tip_radius, found["tip"][:, 1])
    assert np.abs(radius - slab.tip_radius).max() < 1e-7  # second-order edges on an arc
    x, y, z = found["cavity"].T
    assert np.abs(z - slab.offset).max() < slab.end_bore + near
    assert min(edge_distance(slab, a, b) for a, b in zip(x, y, strict=True)) > slab.edge - 1e-6
    for place in slab.probes.values():
        assert np.linalg.norm(found["solid"] - place, axis=1).min() < near


def test_mirrored_faces_keep_their_corners(mesh):
    """Nodes of a spline's points, of no cell, had the numbers of images."""
    slab, path = mesh(offset=0.0, part="full", channels=1, spread=20.0)
    found, near, half = groups(path), 1e-9, slab.thickness / 2
    assert np.abs(found["support"][:, 0]).max() < near and np.ptp(found["support"][:, 2]) == pytest.approx(2 * half)
    assert np.abs(found["top"][:, 2] - half).max() < near and np.abs(found["bottom"][:, 2] + half).max() < near
    assert np.hypot(found["tip"][:, 0] - slab.length + slab.tip_radius, found["tip"][:, 1]) == pytest.approx(
        slab.tip_radius, abs=1e-7
    )
    assert summarize(path).measure == pytest.approx(slab.solid_volume, rel=1e-4)


@pytest.mark.campaign
def test_full_slab_is_two_halves(mesh):
    half, _ = mesh()
    full, path = mesh(part="full")
    assert full.solid_volume == pytest.approx(half.solid_volume, rel=1e-12) and full.copies == 1
    assert summarize(path).measure == pytest.approx(full.solid_volume, rel=3e-4)
    found = groups(path)
    assert "plane0" not in found
    assert found["cavity"][:, 1].min() == pytest.approx(-found["cavity"][:, 1].max(), rel=1e-6)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"end_bore": 0.0035}, ("end_bore is 3.5 mm", "breaks through the bottom face")),
        ({"offset": 0.0028}, ("manifold_bore", "leaves 0.3 mm to the top face")),
        ({"manifold_bore": 0.0031}, ("manifold_bore is 3.1 mm", "breaks through the bottom")),
        ({"channels": 12, "spread": 60.0}, ("channels is 12", "break into each other")),
        ({"spread": 159.0, "manifold_radius": 0.006}, ("spread 159 deg", "to the base")),
        ({"manifold_radius": 0.024}, ("manifold_radius is 24 mm",)),
        ({"manifold_radius": 0.0015}, ("manifold_radius is 1.5 mm", "twice manifold_bore")),
        ({"edge": 0.030}, ("edge 30 mm", "no length is left")),
        ({"edge": 0.0001}, ("edge is 0.1 mm", "least_wall")),
        ({"channel_bore": 0.00088}, ("channel_bore is 0.88 mm", "0.9 times manifold_bore")),
        ({"thickness": 0.060}, ("thickness is 60 mm",)),
        ({"tip_radius": 0.030}, ("tip_radius is 30 mm",)),
        ({"tip": "held", "tip_radius": 0.0}, ("tip is 'held'",)),
        ({"length": 2.0}, ("wrong unit",)),
        ({"around": 200.0}, ("around is 200",)),
        ({"cell_size": 0.02}, ("cell_size is 20 mm",)),
        ({"channels": 31}, ("channels is 31; it must be a whole number from 1 to 30",)),
        ({"spread": 1.0}, ("spread is 1 deg",)),
        ({"offset": math.nan}, ("offset",)),
    ],
)
def test_impossible_slabs_are_refused_by_name(changes, words):
    with pytest.raises(GeometryError) as refused:
        SeminarActuator(**changes)
    assert all(word in str(refused.value) for word in words), refused.value


def test_table_gives_the_same_device_back():
    slab = SeminarActuator(offset=0.0007, channels=4, part="full")
    assert from_table(to_table(slab)) == slab


def test_figures_of_a_bent_slab():
    """A slab bent to a circle has the circle's curvature, and half its angle as lift angle."""
    slab = SeminarActuator()
    radius, angle = 0.080, slab.length / 0.080
    place = radius * math.sin(angle), 0.0, radius * (1 - math.cos(angle))
    figures = slab.device_figures({"tip": place, "tip_below": place})
    assert figures["curvature"] == pytest.approx(1 / radius, rel=1e-12)
    assert figures["lift_angle"] == pytest.approx(angle / 2, rel=1e-12)


OWN = {
    "bores": (0.0008, 0.0006),
    "middle_bores": (0.0011, 0.0008),
    "end_bores": (0.0006, 0.0012),
    "angles": (0.0, 35.0),
    "reaches": (0.040, 0.028),
}
"""A fan of three channels that are all different."""


@pytest.mark.campaign
def test_lists_of_common_values_are_the_common_device(mesh):
    """The same values given one by one: the same cells."""
    plain, path = mesh()
    lines = half_fan(plain)
    own, its_path = mesh(
        bores=(plain.channel_bore,) * 2,
        end_bores=(plain.end_bore,) * 2,
        angles=tuple(math.degrees(line.angle) for line in lines),
        reaches=tuple(line.centre + line.cap for line in lines),
    )
    assert summarize(its_path).cells == pytest.approx(summarize(path).cells, rel=0.01)
    assert own.cavity_volume == pytest.approx(plain.cavity_volume, rel=1e-9)
    for line, same in zip(lines, half_fan(own), strict=True):
        assert same.cones[0] == pytest.approx(line.cones[0], rel=1e-12) and same.angle == line.angle


@pytest.mark.campaign
def test_every_channel_has_its_own_shape(mesh):
    """Volumes of the cones in closed form; ends and radii where they were asked for, on the mesh too."""
    slab, path = mesh(**OWN)
    wall = groups(path)["cavity"]
    for line, bore, middle, end, angle, reach in zip(half_fan(slab), *OWN.values(), strict=True):
        assert math.degrees(line.angle) == pytest.approx(angle) and line.centre + line.cap == pytest.approx(reach)
        half = 0.5 * (line.start + line.centre)
        assert line.radius(line.start) == bore and line.radius(half) == pytest.approx(middle, rel=1e-12)
        assert line.cap == pytest.approx(end, rel=0.01)
        c, s = math.cos(line.angle), math.sin(line.angle)
        along = wall @ [c, s, 0.0]
        away = np.hypot(wall @ [-s, c, 0.0], wall[:, 2] - slab.offset)
        near = (along > line.start + 3 * slab.manifold_bore) & (along < line.end) & (away < 2 * line.cap)
        assert near.sum() > 20
        assert away[near] == pytest.approx([line.radius(at) for at in along[near]], abs=5e-7)  # cones meet half way on one ball
        assert along[away < 2 * line.cap].max() == pytest.approx(reach, abs=5e-6)  # of a node near the pole
    cones = [
        math.pi / 3 * (cone.end - cone.start) * (cone.bore**2 + cone.bore * (r := line.radius(cone.end)) + r**2)
        for line in fan(slab)
        for cone in line.cones
    ]
    caps = sum(2 / 3 * math.pi * line.cap**3 for line in fan(slab))
    arc = math.pi * slab.manifold_bore**2 * (slab.manifold_radius * math.radians(70.0) + 4 / 3 * slab.manifold_bore)
    assert slab.cavity_volume == pytest.approx(sum(cones) + caps + arc, rel=0.06)
    assert summarize(path).quality > 0.05


def test_lists_are_read_and_written_with_units():
    slab = SeminarActuator(**COARSE, **OWN)
    table = to_table(slab)
    assert table["bores"] == ["0.8 mm", "0.6 mm"] and table["angles"] == ["0 deg", "35 deg"]
    assert from_table(table) == slab
    assert from_table({**table, "end_bores": ["600 um", "0.12 cm"]}) == slab
    with pytest.raises(GeometryError, match=r"bores\[2\].*no unit"):
        from_table({**table, "bores": ["0.8 mm", 0.6]})


def test_lists_stand_between_commas_on_the_command_line():
    command = click.command()(device_options(SeminarActuator)(lambda **values: device_told(SeminarActuator, values)))
    given = "--channels 3 --around 6 --bores 0.8mm,600um --middle-bores 1.1mm,0.8mm"
    given += " --end-bores 0.6mm,1.2mm --angles 0deg,35deg --reaches 4cm,28mm"
    assert command.main(given.split(), standalone_mode=False) == SeminarActuator(channels=3, around=6.0, **OWN)
    with pytest.raises(click.BadParameter, match="has no unit"):
        command.main(["--bores", "0.8mm,0.6"], standalone_mode=False)
    with pytest.raises(GeometryError, match="channel_bore has no effect with bores"):
        command.main([*given.split(), "--channel-bore", "0.7mm"], standalone_mode=False)


def test_parameters_of_a_fan_with_lists():
    names = parameter_names(SeminarActuator(**COARSE, bores=OWN["bores"], reaches=OWN["reaches"]))
    assert {"bores[1]", "bores[2]", "reaches[1]", "reaches[2]", "spread", "end_bore"} <= set(names)
    assert not {"channel_bore", "edge", "angles[1]", "least_wall"} & set(names)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"bores": (0.0007,)}, ("bores has 1 entry", "3 channels", "take 2")),
        ({"angles": (0.0, 30.0, 40.0)}, ("angles has 3 entries", "take 2")),
        ({"channels": 1, "angles": (0.0,)}, ("angles", "one channel")),
        ({"angles": (5.0, 30.0)}, ("angles[1] is 5 deg", "0 deg")),
        ({"channels": 5, "angles": (0.0, 40.0, 30.0)}, ("angles[3] is 30 deg", "larger than 40 deg")),
        ({"channels": 4, "angles": (0.0, 30.0)}, ("angles[1] is 0 deg", "larger than 0 deg")),
        ({"angles": (0.0, 85.0)}, ("angles[2] is 85 deg", "5 and 80 deg")),
        ({"bores": (0.0007, 0.00085)}, ("bores[2] is 0.85 mm", "0.9 times manifold_bore")),
        ({"end_bores": (0.001, 0.0035)}, ("end_bores[2] is 3.5 mm", "breaks through the bottom face")),
        ({"middle_bores": (0.003, 0.001)}, ("middle_bores[1] is 3 mm", "bottom")),
        ({"reaches": (0.0697, 0.030)}, ("reaches[1] is 69.7 mm", "channel 1", "side")),
        ({"reaches": (0.040, 0.013)}, ("reaches[2] 13 mm", "channel 2")),
        ({"angles": (0.0, 6.0)}, ("channels 1 and 2", "break into each other", "angles[2] 6 deg")),
        ({"bores": (0.0007, 0.0003)}, ("fillet is 0.4 mm", "bores[2] 0.3 mm")),
        ({"bores": (0.0007, -0.0003)}, ("bores[2]", "larger than 0")),
        ({"bores": 0.0007}, ("bores is 0.0007", "list")),
    ],
)
def test_impossible_lists_are_refused_by_entry(changes, words):
    with pytest.raises(GeometryError) as refused:
        SeminarActuator(**{**COARSE, **changes})
    assert all(word in str(refused.value) for word in words), refused.value


# -- What has a least width in a seminar actuator: names, values against the plan, and that the checks ask for nothi--


SLABS = {
    "common": SeminarActuator(),
    "even": SeminarActuator(channels=4, spread=90.0, fillet=0.0, offset=0.0012),
    "own": SeminarActuator(
        channels=3,
        bores=(0.0007, 0.0006),
        middle_bores=(0.0011, 0.0008),
        end_bores=(0.0006, 0.0012),
        angles=(0.0, 35.0),
        reaches=(0.040, 0.028),
    ),
}


def test_walls_are_those_of_the_plan():
    found = SLABS["common"].clearances
    assert found["solid between the manifold and the bottom"] == pytest.approx(0.0021)
    assert found["solid between the channels at the end and the top"] == pytest.approx(0.0040)
    assert found["solid between the channels' ends and the side"] == 0.004
    assert found["width of the channels at the manifold"] == pytest.approx(0.0014)
    gap = 2 * 0.0129 * math.sin(math.radians(12.5)) - sum(k.radius(0.0129) for k in half_fan(SLABS["common"])[:2])
    assert found["solid between channels 1 and 2 at the manifold"] == pytest.approx(gap)
    assert found["least_wall and room for the channels in the manifold's bore"] == pytest.approx(0.0005 + 0.00011)
    own = SLABS["own"].clearances
    assert own["solid between channel 1 half way and the bottom"] == pytest.approx(0.0019)
    assert own["width of channel 2 at the end"] == pytest.approx(0.0024)
    assert "solid between channels 1 and 1 at the manifold" in SLABS["even"].clearances
    assert min(own.values()) >= 0.0005 and min(found.values()) >= 0.0005


@pytest.mark.parametrize("name", sampled(SLABS, ("even",)))
def test_the_check_passes_where_clearances_are_kept(name, monkeypatch):
    """Hundreds of devices, sound and not, with sizes of all kinds: what has its clearances is never refused."""
    slab, random = SLABS[name], np.random.default_rng(3)
    monkeypatch.setattr(SeminarActuator, "check", lambda self: None)
    kept = refused = 0
    for _ in range(600):
        by = random.choice([0.1, 0.3, 0.6])
        values = {key: parameter(slab, key) * math.exp(by * random.normal()) for key in slab.movable}
        try:
            other = changed(slab, values)
            good = None not in half_fan(other) and min(other.clearances.values()) >= other.least_wall
        except (GeometryError, ValueError):  # a fan wider than the base, a tip wider than the slab
            continue
        if good:
            check_seminar(other)
            kept += 1
        else:
            try:
                check_seminar(other)
            except GeometryError:
                refused += 1
    assert kept > 15 and refused > 50


@pytest.mark.parametrize("name", sampled(SLABS, 3))
def test_clearances_are_smooth(name):
    slab = SLABS[name]
    for key in slab.movable:
        wide, less, fine = (_slopes(slab, key, step) for step in (4e-3, 2e-3, 1e-6))
        size = np.abs(fine).max() + 1e-12
        assert np.abs(less - fine).max() < 0.3 * np.abs(wide - fine).max() + 1e-6 * size, key


def _slopes(slab, key, step):
    value = parameter(slab, key)
    one, other = (changed(slab, {key: value * (1 + sign * step)}).clearances for sign in (1, -1))
    assert one.keys() == slab.clearances.keys()
    return (np.array([*one.values()]) - [*other.values()]) / (2 * step)
