"""Plates with networks of channels: walls against closed forms, drawings of other programs, what is refused, by its place."""

import itertools
import math

import gmsh
import numpy as np
import pytest
from click import testing

from geometries import ChannelPlate, SeminarActuator, actuator, drawings, mesh_arrays, meshing, network, plates
from softmodels.case.case import Case
from softmodels.cli import exports
from softmodels.common.errors import GeometryError, MeshingError

ONE = {"outline": "rectangle 25 x 10 mm", "channels": ("5, 0 to 20, 0 mm radius 1.3 to 0.9 mm",), "cell_size": 3e-3}
LEAF = """<?xml version="1.0"?>
<svg width="60mm" height="40mm" viewBox="0 0 60 40" xmlns="http://www.w3.org/2000/svg"
     xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape">
  <g inkscape:label="Blade" inkscape:groupmode="layer" id="layer1">
    <path style="fill:none;stroke:#000000;stroke-width:0.2" d="M 2,14 C 20,2 45,4 58,20 45,36 20,38 2,26 Z" id="blade"/>
  </g>
  <g id="layer2" transform="translate(0,20)" style="fill:none;stroke:#1f77b4;stroke-width:2;stroke-linecap:round">
    <path d="M 6,0 H 48" id="midrib"/>
    <path d="M 14,0 C 18,-4 20,-8 26,-10" id="vein"/>
    <path d="m 28,0 c 4,4 6,7 12,8" id="other"/>
    <circle cx="6" cy="0" r="1" style="fill:#000000;stroke:none" id="inlet"/>
  </g>
</svg>"""


def _hull_of_two_balls(length, p, q):
    """Volume of the convex hull of two balls: a cone that touches both, and what is beyond it of each."""
    b = (p - q) / length
    low, high, cosine = p * b, length + q * b, math.sqrt(1.0 - b * b)
    cone = math.pi / 3 * (high - low) * cosine**2 * (p * p + p * q + q * q)
    return cone + math.pi * (p**3 * (2 / 3 + b - b**3 / 3) + q**3 * (2 / 3 - b + b**3 / 3))


def test_volume_of_a_channel_converges_to_its_closed_form():
    exact, errors = _hull_of_two_balls(15e-3, 1.3e-3, 0.9e-3), []
    for around in (8, 12, 18):
        plate = ChannelPlate(**ONE, around=around)
        errors.append(abs(plate.cavity_volume / exact - 1.0))
        assert plate.cavity_volume + plate.solid_volume == pytest.approx(25e-3 * 10e-3 * 6e-3, rel=1e-12)
    assert errors[2] < 5e-4 and errors[0] / errors[2] > 5.0  # triangles curved by squares: order 3 or more


def test_coarse_cells_shorten_no_channel():
    plate = ChannelPlate(around=6, thickness=5.5e-3, start_radii=(1.3e-3,) * 4 + (1.4e-3,))
    assert plate.cavity_volume == pytest.approx(plate.replaced(around=9).cavity_volume, rel=0.03)


@pytest.mark.parametrize("symmetry", ["auto", "none"])
def test_the_mesh_has_the_air_of_the_walls_and_ends_on_them(tmp_path, symmetry):
    plate = ChannelPlate(outline="rectangle 24 x 14 mm", network="parallel:2", around=8, cell_size=4e-3, symmetry=symmetry)
    file = plate.write(tmp_path / "plate.msh")
    summary = meshing.summarize(file)
    assert plate.copies * summary.measure == pytest.approx(plate.solid_volume, rel=1e-4) and summary.quality > 0.03
    mesh = mesh_arrays.read_arrays(file)
    roles = {"cavity", "support", "top", "bottom", "edge", *(plane.name for plane in plate.cut_planes)}
    assert set(mesh.faces) == roles and sum(len(faces) for faces in mesh.faces.values()) > 500 / plate.copies
    x, y, z = mesh.points[np.unique(mesh.triangles("support"))].T
    assert np.abs(x).max() < 1e-12 and np.ptp(y) == pytest.approx(14e-3 / plate.copies) and np.ptp(z) == pytest.approx(6e-3)
    # On a channel far from the spine the walls are a cylinder's; the distance is computed here by hand.
    places = mesh.points[np.unique(mesh.triangles("cavity"))]
    own = places[(np.abs(places[:, 0] - 2.8e-3) < 1.4e-3) & (places[:, 1] > 2e-3) & (places[:, 1] < 4e-3)]
    assert len(own) > 20
    assert np.hypot(own[:, 0] - 2.8e-3, own[:, 2] + 0.5e-3) == pytest.approx(1.3e-3, rel=1e-6)


@pytest.mark.parametrize(("radius", "pieces"), [(3.0, 8), (2.5, 40)])
def test_straight_sides_beside_arcs_stay_straight(tmp_path, radius, pieces):
    """A rectangle with round corners, as drawn in Inkscape and CAD: its area in closed form, and none of it lies outside."""
    turns = np.radians(np.linspace(0.0, 90.0, pieces + 1))
    centres = [(40.0 - radius, 7.5 - radius), (radius, 7.5 - radius), (radius, radius - 7.5), (40.0 - radius, radius - 7.5)]
    corners = [
        (x + radius * math.cos(turn + 0.5 * math.pi * k), y + radius * math.sin(turn + 0.5 * math.pi * k))
        for k, (x, y) in enumerate(centres)
        for turn in turns
    ]
    outline = ", ".join(f"{x:.9f}, {y:.9f}" for x, y in corners) + " mm"
    plate = ChannelPlate(outline=outline, channels=("10, 0 to 30, 0 mm",), support="bottom", around=6)
    file = plate.write(tmp_path / "plate.msh")
    summary, mesh = meshing.summarize(file), mesh_arrays.read_arrays(file)
    area = (40.0 * 15.0 - (4.0 - math.pi) * radius**2) * 1e-6
    air = outline_volume(plate) - plate.solid_volume
    assert summary.quality > 0.05
    assert plate.copies * summary.measure + air == pytest.approx(area * plate.thickness, rel=1e-4)
    x, y = mesh.points[np.unique(mesh.triangles("edge"))].T[:2]
    assert x.min() > -1e-9 and x.max() < 40e-3 + 1e-9 and np.abs(y).max() < 7.5e-3 + 1e-9


def outline_volume(plate):
    return plates.outline_area(plate.paths) * plate.thickness


CROSSED = ChannelPlate(network="lattice:4", symmetry="none")


def test_walls_left_as_polygons_are_counted(tmp_path):
    """Channels that cross at a sharp angle: the cells in the creases allow no curved walls there."""
    summary = meshing.summarize(CROSSED.write(tmp_path / "plate.msh"))
    assert summary.straight > 10 and "--finer 1.5" in meshing.straight_text(summary.straight)


@pytest.mark.campaign
def test_smaller_cells_cure_polygons_and_walls_that_gmsh_cannot_mesh(tmp_path):
    assert not meshing.summarize(CROSSED.replaced(finer=1.5).write(tmp_path / "whole.msh")).straight
    half = CROSSED.replaced(symmetry="auto")
    with pytest.raises(MeshingError, match=r"finer=1\.5"):
        half.write(tmp_path / "half.msh")
    assert not meshing.summarize(half.replaced(finer=1.5).write(tmp_path / "half.msh")).straight


def _rays(*degrees):
    """Texts of channels from 6 to 13 mm from the middle."""
    ways = [(math.cos(math.radians(each)), math.sin(math.radians(each))) for each in degrees]
    return tuple(f"{6 * x:.9f}, {6 * y:.9f} to {13 * x:.9f}, {13 * y:.9f} mm" for x, y in ways)


DISK = {"outline": "circle 32 mm", "support": "edge"}
SQUARE = {"outline": "-15, -15, 15, -15, 15, 15, -15, 15 mm", "support": "bottom"}
LINES = ("20, 4 to 35, 4 mm{}", "20, -4 to 35, -4 mm{}")


@pytest.mark.parametrize(
    ("given", "copies"),
    [
        ({}, 2),
        ({"symmetry": "none"}, 1),
        ({"support": "in 0..0, -7.5..-7.4, -3..3 mm in 40..40, -7.5..7.5, -3..3 mm"}, None),
        ({"channels": _rays(0, 90, 180, 270), **DISK}, 8),
        ({"channels": _rays(*range(10, 370, 45)), **DISK}, 16),  # its mirrors are at 10 degrees
        ({"channels": _rays(0, 90, 180), **DISK}, 2),
        ({"channels": _rays(0, 90, 180, 270.01), **DISK}, 1),
        ({"network": "spiral:1", **DISK}, 1),
        ({"channels": ("-10, 0 to 10, 0 mm", "0, -10 to 0, 10 mm"), **SQUARE}, 8),
        ({"channels": ("-10, 0 to 10, 0 mm", "0, -10 to 0, 10 mm"), **SQUARE, "support": "x = -15 mm"}, 2),
        ({"channels": ("-10, 0 to 10, 0 mm radius 1 to 1.2 mm",), **SQUARE}, 2),
        ({"channels": tuple(line.format("") for line in LINES)}, 2),
        ({"channels": (LINES[0].format(""), LINES[1].format(" offset 0.1 mm"))}, 1),
        ({"channels": (LINES[0].format(" in left"), LINES[1].format(" in right")), "pressure_ratios": (1.0, 0.5)}, 1),
        ({"channels": ("20, 0.0001 to 35, 0.0001 mm",)}, 2),
        ({"channels": ("20, 0.001 to 35, 0.001 mm",)}, 1),
    ],
)
def test_mirrors_of_a_drawing(given, copies):
    if copies is None:
        with pytest.raises(GeometryError):
            ChannelPlate(**given)
        return
    plate = ChannelPlate(**given)
    part = "solid, 1/1" if copies == 1 else "half, 1/2" if copies == 2 else f"wedge of {360 / copies:g} degrees, 1/{copies}"
    assert plate.copies == copies and part in meshing.mesh_label(plate)
    ((*gauge, _),) = plate.probes.values()
    assert all(np.dot(gauge, plane.normal[:2]) < 1e-9 for plane in plate.cut_planes)


@pytest.mark.parametrize(
    "given",
    [
        {"channels": _rays(0, 90, 180, 270), **DISK, "gauge_point": "at -4, 3 mm"},
        {"network": "radial:6", **DISK},  # air on the axis
        {"network": "radial:3", "outline": "circle 50 mm", "support": "free"},  # two corners near to it
        {"network": "rings:2", "outline": "circle 40 mm", "support": "free"},
    ],
    ids=["wedge elsewhere", "axis", "two corners", "rings"],
)
def test_walls_of_a_slice_end_on_its_cut_planes(tmp_path, given):
    plate = ChannelPlate(**given, around=8, cell_size=4e-3)
    file = plate.write(tmp_path / "plate.msh")
    summary = meshing.summarize(file)
    assert plate.copies * summary.measure == pytest.approx(plate.solid_volume, rel=3e-4) and summary.quality > 0.03
    assert plate.cavity_volume == pytest.approx(plate.replaced(symmetry="none").cavity_volume, rel=2e-3)
    mesh = mesh_arrays.read_arrays(file)
    for plane in plate.cut_planes:
        assert np.abs(mesh.points[np.unique(mesh.triangles(plane.name))] @ plane.normal).max() < 1e-15
        assert (mesh.points @ plane.normal).max() < 1e-15
    walls = mesh.points[np.unique(mesh.triangles("cavity"))]
    away = np.abs(network.Distance(plate.drawn.channels, plate.fillet).distances(walls))
    assert (away < 1e-9).mean() > 0.99 and away.max() < 2e-4  # edges in creases are eased
    ((*gauge, _),) = plate.probes.values()
    assert np.abs(mesh.points - (*gauge, 0.5 * plate.thickness)).max(axis=1).min() < 1e-12


def test_what_breaks_a_mirror_does_not_follow():
    plate = ChannelPlate()
    assert {"node_x[9]", "end_radii[5]", "thickness", "scale_y"} < {*plate.movable}
    assert not {"node_y[9]", "node_x[7]", "node_offsets[7]", "start_radii[1]"} & {*plate.movable}
    assert "symmetry = 'none'" in plate.why_not_movable("node_x[7]")
    assert "node_x[7]" in plate.replaced(symmetry="none").movable
    wedge = ChannelPlate(channels=_rays(0, 90, 180, 270), **DISK)
    assert set(wedge.movable) == {"thickness", "radius", "offset", "fillet", "edge"}
    with pytest.raises(GeometryError, match="other mirrors"):
        plate.carried(actuator.changed(plate, {"node_x[7]": 34e-3}), np.zeros((1, 3)))


def test_a_crease_is_rounded_only_where_channels_meet_at_an_angle():
    straight = [network.Channel.along(n, np.array(line) * 1e-3, 0.0, (1e-3, 1e-3)) for n, line in
                (("a", [(0, 0), (5, 0)]), ("b", [(5, 0), (10, 0)]))]  # fmt: skip
    points = np.array([(5e-3, 1.2e-3, 0.0), (4.8e-3, 0.0, 1.1e-3)])
    distance, _ = network.Distance(straight, 4e-4).of(points)
    assert distance == pytest.approx([2e-4, 1e-4], abs=2e-6)
    across = network.Channel.along("c", np.array([(5e-3, 0), (5e-3, 8e-3)]), 0.0, (1e-3, 1e-3))
    corner = np.array([(6.1e-3, 1.1e-3, 0.0)])
    sharp, _ = network.Distance([straight[1], across], 0.0).of(corner)
    both = network.Distance([straight[1], across], 4e-4)
    rounded, steps = both.of(corner)
    assert sharp == pytest.approx(1e-4) and rounded == pytest.approx(
        1e-4 - 0.25 * (1 - math.exp(-2)) * 4e-4  # the air reaches further
    )
    assert both.of(corner + 1e-6 * steps)[0] - rounded == pytest.approx(1e-6, rel=1e-3)


def test_the_distance_of_one_point_without_roundings():
    line = network.Channel.along("c", 1e-3 * np.array([(0, 0), (8, 0)]), 0.0, (1e-3, 1e-3))
    assert network.Distance([line], 0.0).distances(1e-3 * np.array([(4, 3, 0)])) == pytest.approx([2e-3])


@pytest.mark.parametrize("turn", [30, 60, 90, 120])
def test_a_rounded_crease_has_no_kink(turn):
    """Across the crease between two channels the distance's slopes on both sides are one."""
    along = 8e-3 * np.array([math.cos(math.radians(turn)), math.sin(math.radians(turn))])
    lines = np.array([[(0, 0), (8e-3, 0)], [(0, 0), along]])
    both = network.Distance([network.Channel.along("c", line, 0.0, (1e-3, 1e-3)) for line in lines], 4e-4)
    half = math.radians(0.5 * turn)
    on_crease = 1.1e-3 / math.sin(half) * np.array([math.cos(half), math.sin(half), 0.0])
    across = np.array([-math.sin(half), math.cos(half), 0.0])
    here, left, right = both.of(on_crease + 1e-6 * np.outer([0, 1, -1], across))[0]
    assert left == pytest.approx(right, abs=1e-12) and abs(left - here) < 0.02 * 1e-6


def test_a_corner_within_a_channel_is_rounded_as_between_two():
    line = 1e-3 * np.array([(0, 0), (8, 0), (8, 8)])
    bent = network.Distance([network.Channel.along("a", line, 0.0, (1e-3, 1e-3))], 4e-4)
    two = network.Distance([network.Channel.along("a", part, 0.0, (1e-3, 1e-3)) for part in (line[:2], line[1:])], 4e-4)
    points = 1e-3 * np.random.default_rng(0).uniform((6, -1.5, -1.2), (9.5, 2, 1.2), (200, 3))
    assert np.ptp(np.stack([bent.distances(points), two.distances(points)]), axis=0) == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize("walls", [2, 3, 6])
def test_shares_of_blended_walls_are_the_least(walls):
    """No wall outside would lower the smooth union, and all inside lower it alike: what a convex minimum on a simplex has."""
    rng = np.random.default_rng(walls)
    normals = rng.normal(size=(300, walls, 3))
    normals /= np.linalg.norm(normals, axis=2)[..., None]
    far = rng.uniform(0.0, 0.6, (300, walls))
    far -= far.min(axis=1)[:, None]
    alike = np.exp(2.0 * (np.einsum("ngi,nhi->ngh", normals, normals) - 1.0))
    shares = network.blended(far, alike)
    rates = far + np.einsum("ngh,nh->ng", alike, shares)
    least = rates.min(axis=1)[:, None]
    assert shares.min() >= 0.0 and shares.sum(axis=1) == pytest.approx(1.0)
    assert (shares * (rates - least)).max() < 1e-11
    assert walls == 2 or ((shares > 0.0).sum(axis=1) > 2).mean() > 0.1


def test_walls_follow_a_radius_without_a_kink_where_three_channels_meet():
    """The second differences of places over a radius are those of its square, where the order of the walls changes too."""
    texts = (
        "15.5, 1.6 to 12.1, -1 to 9, -2 mm radius 0.98 mm", "15.5, 1.6 to 23.2, -4.9 mm radius 1.03 to 1.05 mm",
        "15.5, 1.6 to 22, 3 mm radius 1.07 to 1.2 mm",
    )  # fmt: skip
    plate = ChannelPlate(channels=texts, around=8)
    points = plate.air["cavity"][0]
    radii = [plate.replaced(start_radii=(0.98e-3 + k * 1e-6, 1.03e-3, 1.07e-3)) for k in range(11)]
    moved = np.array([plate.carried(other, points) for other in radii])
    turns = np.linalg.norm(np.diff(moved, n=2, axis=0), axis=2)
    assert turns.max() < 0.1 * np.linalg.norm(np.diff(moved, axis=0), axis=2).max()


@pytest.mark.parametrize("text", ["fan:4", "parallel:3", "radial:8", "rings:2", "spiral:2", "tree:2", "lattice:3", "radial:12"])
def test_families_fit_in_their_box(text):
    plate = ChannelPlate(network=text, outline="rectangle 50 x 50 mm", radius=1e-3)
    low, high = (np.array([place for each in plate.drawn.channels for place in each.points]).__getattribute__(end)(axis=0)
                 for end in ("min", "max"))  # fmt: skip
    assert (low[:2] >= [2.5e-3 - 1e-9, -22.5e-3 - 1e-9]).all() and (high[:2] <= [47.5e-3 + 1e-9, 22.5e-3 + 1e-9]).all()
    assert len(plate.drawn.cavities) == 1


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"channels": ("5, 0 to 20, 0 mm", "5, 3 to 20, 3 mm")}, r"1 and channel 2 are 0\.4 mm apart near \([\d.]+, 1\.5\)"),
        ({"channels": ("5, 0 to 20, 0 mm in a", "10, -3 to 10, 3 mm in b")}, r"2 of cavity 'b' cross near \((10|9\.)"),
        ({"channels": ("5, 0 to 60, 0 mm",)}, r"channel 1 lies outside of the outline near \([56]\d"),
        ({"channels": ("5, 0 to 39, 0 mm",)}, r"channel 1 leaves no wall to the outline near \(39, 0\) mm"),
        ({"channels": ("5, 0 to 20, 0 mm radius 2.3 mm",)}, r"leaves 0\.2 mm to the bottom face near"),
        ({"channels": ("5, 0 to 20, 0 mm", "5, 0 to 20, 2 mm")}, "more than 23 degrees"),
        ({"channels": ("from 5 to 6",)}, "write places"),
        ({"channels": ("5, 0 to 5, 0 mm",)}, "two places in a row are the same"),
        ({"channels": ("5, 0 to 20, 0 mm radius -1 mm",)}, "channel 1 has a radius of -1 mm; channels have at least 0.01 mm"),
        ({"network": "radial"}, "number of a family's airways"),
        ({"network": "star:5"}, "families: fan"),
        ({"outline": "circle"}, "outline is 'circle'"),
        ({"support": "x = 3 mm"}, "no side of the outline lies there"),
        ({"fillet": 2e-3}, "it would fill walls"),
        ({"channels": ("5, 0 to 20, 0 mm",), "pressure_ratios": (1.0, 2.0)}, "2 values for 1 cavities"),
    ],
)
def test_what_cannot_be_is_refused_by_its_place(fields, words):
    with pytest.raises(GeometryError, match=words):
        ChannelPlate(**fields)


def test_a_leaf_of_inkscape(tmp_path):
    file = tmp_path / "leaf.svg"
    file.write_text(LEAF)
    plate = ChannelPlate(network=str(file))
    drawn = plate.drawn
    assert [each.name for each in drawn.channels] == ["midrib", "vein", "other"] and drawn.cavities == ("#1f77b4",)
    assert [each.radii[-1] for each in drawn.channels] == pytest.approx([1e-3] * 3, rel=1e-6)
    low, high = plate.box  # the outline's left end is x = 0
    assert low[0] == pytest.approx(0.0, abs=1e-12) and high[0] == pytest.approx(56e-3, rel=1e-6)
    assert np.array(drawn.inlets) == pytest.approx(np.array([(4e-3, 0.0)]), abs=1e-8)
    ends = [each.points[-1][:2] for each in drawn.channels]
    assert np.array(ends) == pytest.approx(np.array([(46e-3, 0.0), (24e-3, 10e-3), (38e-3, -8e-3)]), abs=1e-7)  # y upwards
    # The middle of the cubic: (14 + 3 * 18 + 3 * 20 + 26) / 8 - 2, and so on.
    middle = np.array([(14 + 3 * 18 + 3 * 20 + 26) / 8 - 2, (3 * 4 + 3 * 8 + 10) / 8]) * 1e-3
    assert min(math.dist(middle, place[:2]) for place in drawn.channels[1].points) < 1e-7
    assert ChannelPlate(network=str(file), width=28e-3, thickness=3e-3, offset=0.0).box[1][0] == pytest.approx(28e-3)
    area = plates.outline_area(plate.paths)
    assert area == pytest.approx(_area_of_blade(), rel=1e-3)


def test_a_drawing_is_looked_for_beside_its_case_file(tmp_path, monkeypatch):
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    (folder / "leaf.svg").write_text(LEAF)
    text = "[geometry]\ndevice = 'ChannelPlate'\nnetwork = '{}'\n[load]\npressure_cm = '0:10'\n"
    monkeypatch.chdir(tmp_path)
    case = Case.from_toml(text.format("leaf.svg"), folder)
    assert case.actuator.network == str(folder / "leaf.svg")
    assert "network = 'a.svg'" in case.to_toml({str(folder / "leaf.svg"): "a.svg"}).replace('"', "'")
    assert Case.from_toml(text.format("radial:8"), folder).actuator.network == "radial:8"


def test_a_drawing_that_changes_is_read_again(tmp_path):
    """As while somebody draws beside a notebook."""
    file = tmp_path / "leaf.svg"
    file.write_text(LEAF)
    plate = ChannelPlate(network=str(file))
    before = len(plate.drawn.channels), plate.key
    file.write_text(LEAF.replace("</svg>", '<path d="M20 26 L24 26" stroke="#1f77b4" stroke-width="2" fill="none"/></svg>'))
    assert len(plate.drawn.channels) == before[0] + 1 and plate.key != before[1]


def test_a_line_without_a_length_draws_nothing(tmp_path):
    file = tmp_path / "leaf.svg"
    file.write_text(LEAF)
    plain = ChannelPlate(network=str(file)).drawn
    file.write_text(LEAF.replace("</svg>", '<path d="M20 26 L20 26 z" stroke="#1f77b4" stroke-width="2" fill="none"/></svg>'))
    assert ChannelPlate(network=str(file)).drawn == plain


def _area_of_blade():
    """Area in m2 of the leaf's blade by Gmsh's Bezier curves and CAD kernel."""
    with meshing.private_model():
        occ = gmsh.model.occ
        corners = [(2, 14), (20, 2), (45, 4), (58, 20), (45, 36), (20, 38), (2, 26)]
        points = [occ.addPoint(x, y, 0) for x, y in corners]
        curves = [occ.addBezier(points[:4]), occ.addBezier(points[3:]), occ.addLine(points[6], points[0])]
        face = occ.addPlaneSurface([occ.addCurveLoop(curves)])
        return 1e-6 * occ.getMass(2, face)


@pytest.mark.parametrize(
    ("drawn", "words"),
    [
        ('<path id="thick" d="M10 20 L40 20" stroke="red" fill="none" stroke-width="7"/>', "thick, of radius 3.5 mm there"),
        ('<text x="10" y="10">a</text>', "has a text"),
        ('<path id="blob" d="M10 20 L40 20 L30 25" fill="red"/>', r"blob near \(9, 0\) mm is an open line without a stroke"),
        ('<path d="M10 20 H40" stroke="red" stroke-width="2"/><circle cx="10" cy="30" r="1"/>', r"a dot near \(9, -10\) mm"),
        ("", "no open stroke"),
        ("<g>", "not an SVG drawing"),
        ('<path d="M10 20 H40" stroke="red" stroke-width="2" fill="none" data-offset="abc"/>', "data-offset 'abc'"),
        ('<path d="M10 20 H40" stroke="red" stroke-width="2" fill="none" data-offset="nan"/>', "a radius that is no number"),
        ('<path d="M10 20 H40" stroke="red" stroke-width="2" fill="none" data-radii="1 x"/>', "data-radii '1 x'"),
        ('<path d="M10 20 H40" stroke="red" stroke-width="2" fill="none" data-radii="1 -1"/>', "has a radius of -1 mm"),
        ('<path d="M10 20 H40" stroke="red" stroke-width="-2" fill="none"/>', "has a radius of -1 mm"),
        ('<path d="M10 20 H40" stroke="red" stroke-width="1e-8" fill="none"/>', "channels have at least 0.01 mm"),
    ],
)
def test_drawings_that_are_refused(tmp_path, drawn, words):
    file = tmp_path / "plate.svg"
    box = '<rect x="1" y="1" width="48" height="38" fill="none" stroke="black"/>'
    file.write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" width="50mm" height="40mm" viewBox="0 0 50 40">{box}{drawn}</svg>'
    )
    with pytest.raises(GeometryError, match=words):
        ChannelPlate(network=str(file))


def test_a_drawing_of_cad(tmp_path):
    ezdxf = pytest.importorskip("ezdxf")
    document = ezdxf.new(units=5)  # cm
    space = document.modelspace()
    space.add_lwpolyline([(0, 0), (6, 0), (6, 3), (0, 3)], close=True)
    space.add_line((0.5, 1.0), (4.0, 1.0), dxfattribs={"layer": "left", "lineweight": 200})
    space.add_arc((4.0, 1.5), 0.5, 270, 360, dxfattribs={"layer": "left", "lineweight": 200})
    space.add_lwpolyline([(0.5, 2.2), (3.0, 2.2), (5.0, 2.4)], dxfattribs={"layer": "right", "const_width": 0.15})
    space.add_point((0.6, 1.0), dxfattribs={"layer": "left"})
    document.saveas(tmp_path / "plate.dxf")
    plate = ChannelPlate(network=str(tmp_path / "plate.dxf"), pressure_ratios=(1.0, 0.5))
    assert plate.drawn.cavities == ("left", "right") and plate.drawn.inlets[0] == pytest.approx((6e-3, -5e-3))
    line, arc, bent = plate.drawn.channels
    assert (line.radii[0], arc.radii[0], bent.radii[0]) == pytest.approx((1e-3, 1e-3, 0.75e-3))
    away = [math.dist(place[:2], (40e-3, 0.0)) for place in arc.points]
    assert away == pytest.approx([5e-3] * len(away), rel=5e-4) and arc.points[-1][:2] == pytest.approx((45e-3, 0.0))


@pytest.mark.parametrize("text", ["tree:2", "rings:2", "spiral:2"])
def test_a_network_drawn_and_read_again(tmp_path, text):
    own = ("5, 20 to 15, 21 mm radius 0.8 to 0.5 mm offset -1 mm in left",) if text == "tree:2" else ()
    plate = ChannelPlate(network=text, outline="rectangle 60 x 50 mm", radius=1e-3, channels=own)
    heights = tuple(np.linspace(-1e-3, 1e-3, len(plate.nodes.places)))
    plate = plate.replaced(node_offsets=heights)
    file = tmp_path / "plate.svg"
    file.write_text(drawings.svg_text(plate.drawn))
    back = ChannelPlate(network=str(file))
    assert len(back.drawn.channels) == len(plate.drawn.channels) and back.drawn.cavities == plate.drawn.cavities
    for one, other in zip(plate.drawn.channels, back.drawn.channels, strict=True):
        assert np.array(other.points) == pytest.approx(np.array(one.points), abs=1e-7) and other.name == one.name
        assert other.radii == pytest.approx(one.radii, abs=1e-12)
    assert np.array(back.paths[0]) == pytest.approx(np.array(plate.paths[0]), abs=1e-7)


def test_the_command_draws_a_case(tmp_path):
    case = tmp_path / "case.toml"
    case.write_text('[geometry]\ndevice = "ChannelPlate"\nnetwork = "parallel:3"\n')
    done = testing.CliRunner().invoke(exports.draw_network_command, [str(case), "-o", str(tmp_path / "plate.svg")])
    assert done.exit_code == 0 and "4 channels" in done.output
    assert "node 1 at (2.8, -4.7) mm, offset -0.5 mm, of channel 1 (airway 1)" in done.output
    assert "corner 3 of the outline at (40, 7.5) mm" in done.output
    assert ChannelPlate(network=str(tmp_path / "plate.svg")).drawn.channels[0].radii[0] == pytest.approx(1.3e-3)


def test_the_seminar_actuator_is_drawn_and_read_back(tmp_path):
    case = tmp_path / "case.toml"
    case.write_text('[geometry]\ndevice = "SeminarActuator"\nchannels = 3\nspread = "60 deg"\n')
    done = testing.CliRunner().invoke(exports.draw_network_command, [str(case), "-o", str(tmp_path / "slab.svg")])
    assert done.exit_code == 0 and "4 channels" in done.output and "of channel 1 (the manifold)" in done.output
    slab = SeminarActuator(channels=3, spread=60.0)
    plate = ChannelPlate(network=str(tmp_path / "slab.svg"), thickness=slab.thickness, offset=slab.offset, around=8)
    assert plate.copies == 2 and plate.cavity_volume == pytest.approx(slab.cavity_volume, rel=1e-3)


def test_corners_of_the_outline_move():
    outline = "0, -8, 32, -6, 36, 1, 28, 8, 0, 8 mm"
    plate = ChannelPlate(outline=outline, channels=("5, 0 to 25, 0 mm",), symmetry="none")
    assert {"outline_x[3]", "outline_y[5]"} <= set(plate.movable)
    moved = actuator.changed(plate, {"outline_x[3]": 38e-3})
    assert moved.paths[0][2] == (38e-3, 1e-3) and moved.paths[0][3] == plate.paths[0][3]
    assert moved.drawn.channels == plate.drawn.channels
    with pytest.raises(GeometryError, match="outline_x has 2 entries for 5 corners of the outline"):
        plate.replaced(outline_x=(0.0, 0.03))
    round_one = ChannelPlate(outline="circle 40 mm", support="bottom", network="radial:3", symmetry="none")
    assert not any(name.startswith("outline") for name in round_one.movable)


def test_nodes_are_the_ends_and_corners_of_channels():
    texts = ("5, 0 to 15, 0 to 15, 6 mm radius 1 to 0.8 mm", "curve 15, 0 to 25, 2 to 35, -2 mm radius 1 mm")
    plate = ChannelPlate(channels=texts)
    assert 1e3 * plate.nodes.places == pytest.approx(np.array([(5, 0, -0.5), (15, 0, -0.5), (15, 6, -0.5), (35, -2, -0.5)]))
    assert plate.entries("start_radii") == pytest.approx((1e-3, 1e-3)) and plate.entries("end_radii") == (8e-4, 1e-3)
    moved = actuator.changed(plate, {"node_x[2]": 17e-3, "node_y[4]": 0.0, "end_radii[1]": 1e-3})
    first, second = moved.drawn.channels
    assert 1e3 * np.array(first.points) == pytest.approx(np.array([(5, 0, -0.5), (17, 0, -0.5), (15, 6, -0.5)]))
    assert first.radii == pytest.approx((1e-3,) * 3) and second.points[0][0] == 17e-3 and second.points[-1][1] == 0.0
    middle = len(second.points) // 2  # a curve keeps its shape between its ends, which move by 2 mm each
    assert np.subtract(second.points[middle], plate.drawn.channels[1].points[middle])[:2] == pytest.approx((1e-3,) * 2, rel=0.1)
    with pytest.raises(GeometryError, match="node_x has 2 entries for 4 nodes"):
        ChannelPlate(channels=texts, node_x=(0.01, 0.02))


@pytest.fixture(scope="module")
def bent(tmp_path_factory):
    """A plate of two channels at an angle, and its mesh."""
    texts = ("5, 0 to 20, 3 mm radius 1.2 to 0.9 mm", "20, 3 to 30, -2 mm radius 1 mm")
    plate = ChannelPlate(channels=texts, around=6, cell_size=4e-3, fillet=3e-4)
    return plate, mesh_arrays.read_arrays(plate.write(tmp_path_factory.mktemp("bent") / "plate.msh"))


@pytest.mark.parametrize("name", ["node_x[2]", "node_offsets[3]", "end_radii[1]", "fillet", "thickness", "scale_y"])
def test_the_boundary_follows_a_length_onto_the_other_plate(bent, name):
    """Walls are compared with distances from the cones that are computed here; the outline with its own polygon."""
    plate, mesh = bent
    value = actuator.parameter(plate, name)
    other = actuator.changed(plate, {name: value + (0.1 if name == "scale_y" else 2e-4)})
    walls, top, edge = (mesh.points[np.unique(mesh.triangles(role))] for role in ("cavity", "top", "edge"))
    assert np.array_equal(plate.carried(plate, walls), walls)
    before, after = (_levels(each, places) for each, places in ((plate, walls), (other, plate.carried(other, walls))))
    alone = np.abs(before[1] - before[0]) > 6e-4  # where nothing is rounded
    assert alone.sum() > 100 and after.min(axis=0)[alone] == pytest.approx(before.min(axis=0)[alone], abs=1e-8)
    assert plate.carried(other, top)[:, 2] == pytest.approx(0.5 * other.thickness)
    assert network.depths(plate.carried(other, edge)[:, :2], other.paths) == pytest.approx(0.0, abs=1e-12)


def _levels(plate, points):
    """Distances from two straight channels, each a row of many balls."""
    levels = []
    for each in plate.drawn.channels:
        (a, b), (p, q) = np.array(each.points), each.radii
        shares = np.linspace(0.0, 1.0, 4001)
        balls = [np.linalg.norm(points - a - share * (b - a), axis=1) - p - share * (q - p) for share in shares]
        levels.append(np.min(balls, axis=0))
    return np.array(levels)


def test_walls_of_random_networks_are_checked_as_by_brute_force():
    """Pairs of channels that are not joined: what is refused is what dense samples of both lines say."""
    rng = np.random.default_rng(5)
    refused = 0
    for _ in range(80):
        ends = rng.uniform((6e-3, -14e-3), (44e-3, 14e-3), (3, 2, 2))
        channels = [network.Channel.along(f"c{k}", line, 0.0, (1e-3, 1e-3)) for k, line in enumerate(ends)]
        shares = np.linspace(0.0, 1.0, 150)[:, None]
        lines = [a + shares * (b - a) for a, b in ends]
        gaps = [np.linalg.norm(p[:, None] - q, axis=2).min() - 2e-3 for p, q in itertools.combinations(lines, 2)]
        if any(-1.2e-3 < gap < -1e-3 or 4e-4 < gap < 6e-4 for gap in gaps) or any(gap < -1e-3 for gap in gaps):
            continue  # joined, or too near the limit for samples
        try:
            network.check_walls(channels, network.Samples.of(channels), 5e-4)
            assert min(gaps) > 5e-4
        except GeometryError:
            refused += 1
            assert min(gaps) < 5e-4
    assert refused > 2
