"""The outline of a device: where it is at rest, that a slice shows what the section shows, and how it moves."""

from __future__ import annotations

import numpy as np
import pytest

from geometries import HollowDisk, Membrane
from softmodels.fitting.outlines.residuals import Height, HeightResiduals, OutlineResiduals
from softmodels.fitting.outlines.shapes import OutlineFitError, shadow_of
from softmodels.fitting.problem import LawChoice
from softmodels.runs.grid import QuadraticCurve

SECTION = HollowDisk(section="axisymmetric")
WEDGE = HollowDisk(angle=30.0, azimuth=20.0)
CURVED = HollowDisk(section="axisymmetric", profile=(1.1, 0.9, 1.0))
ADDED = 0.6e-6


@pytest.fixture(scope="module")
def device(comm, tmp_path_factory):
    from softmodels.fitting.outlines.device import DeviceModel
    from softmodels.mechanics.body import Body
    from softmodels.mechanics.solver import Solver
    from softmodels.mechanics.system import System

    folder, known = tmp_path_factory.mktemp("devices"), {}

    def make(disk):
        if disk.key not in known:
            choice = LawChoice.from_text("neo-hookean", 0.49)
            body = Body.from_file(disk, disk.write(folder / f"{disk.name}.msh"), comm)
            known[disk.key] = DeviceModel(Solver(System(body, choice.material({"shear_modulus": 30e3}))), choice)
        return known[disk.key]

    return make


@pytest.mark.parametrize("disk", [SECTION, WEDGE], ids=["section", "wedge"])
def test_at_rest_it_is_the_disk(disk, device):
    """From the axis along the top to the edge, then down to the bottom, with no gaps."""
    made = device(disk)
    curve = made.silhouette.curve(made.system.rest())
    ends = curve.nodes[:, :2]
    assert ends[0, 0] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert ends[1:, 0] == pytest.approx(ends[:-1, 1], abs=1e-12)
    assert ends[-1, 1] == pytest.approx([disk.outer_radius, -disk.height], abs=1e-9)
    top = np.abs(curve.nodes[..., 1]) < 1e-9
    side = np.abs(curve.nodes[..., 0] - disk.outer_radius) < 1e-9
    assert (top | side).all() and top.any() and side.any()
    assert made.silhouette.width == pytest.approx(disk.outer_radius)


@pytest.mark.parametrize("clamp_width", [0.0, 0.005])
def test_of_a_flat_membrane_it_is_the_upper_face(clamp_width, device):
    """From the axis to its edge, that of the clamp where it has one: nothing of it lies lower."""
    made = device(Membrane(clamp_width=clamp_width, cell_size=0.002))
    nodes = made.silhouette.curve(made.system.rest()).nodes
    assert nodes[0, 0] == pytest.approx([0.0, 0.0], abs=1e-12) and np.abs(nodes[..., 1]).max() < 1e-12
    assert nodes[1:, 0] == pytest.approx(nodes[:-1, 1], abs=1e-12)
    assert nodes[-1, 1, 0] == made.silhouette.width == pytest.approx(0.020 + clamp_width) and made.silhouette.flat


def test_outlines_of_a_device_that_is_curved_at_rest_are_refused(device):
    """A fit would take the dome for a rise; heights, which are the apex's rises, can be fitted."""
    for disk in (SECTION, WEDGE):
        assert device(disk).silhouette.unevenness < 1e-12
    made = device(CURVED)
    top = CURVED.membrane_top.height(np.linspace(0.0, 0.75 * CURVED.outer_radius, 1001))
    assert made.silhouette.unevenness == pytest.approx(CURVED.probes["apex"][2] - top.min(), rel=0.02)
    with pytest.raises(OutlineFitError, match=r"top of the device is 1\.2.* mm from flat.*height_datum apex.*table of heights"):
        OutlineResiduals(made, [])
    source = HeightResiduals(made, [Height("one", 5e3, 1.2e-3), Height("two", 9e3, 2.1e-3)])
    (first, second) = (
        made.curve(state).nodes[0, 0, 1] for state in made.states({"shear_modulus": 30e3}, source.pressures, "pressure")
    )
    assert 1e-3 < first < second


def test_a_slice_shows_what_the_section_shows(device):
    """Outlines of both within 0.2 % of the rise at one added volume."""
    curves = []
    for disk in (SECTION, WEDGE):
        made = device(disk)
        (state,) = made.states({"shear_modulus": 30e3}, [ADDED])
        curves.append(made.curve(state))
    rise = curves[0].nodes[0, 0, 1]
    assert rise > 0.8e-3
    points = curves[1].nodes[:, 0]
    points = points[points[:, 1] > 0.0]
    assert len(points) > 4
    assert np.abs(curves[0].closest(points).distance).max() < 2e-3 * rise


def test_it_moves_as_the_derivatives_say(device):
    """Nodes against central differences in added volume and in the membrane's thickness."""
    made = device(SECTION)
    values = {"shear_modulus": 30e3, "membrane": 6.1e-3}

    def nodes(added, membrane):
        (state,) = made.states({**values, "membrane": membrane}, [added])
        return made.curve(state).nodes

    (state,) = made.states(values, [ADDED])
    slopes = made.slopes(state, ["membrane"])
    h, t = 1e-3 * ADDED, 1e-6
    by_volume = (nodes(ADDED + h, 6.1e-3) - nodes(ADDED - h, 6.1e-3)) / (2 * h)
    by_membrane = (nodes(ADDED, 6.1e-3 + t) - nodes(ADDED, 6.1e-3 - t)) / (2 * t)
    assert by_volume == pytest.approx(slopes.along_nodes, abs=1e-5 * np.abs(by_volume).max())
    assert by_membrane == pytest.approx(slopes.nodes["membrane"], abs=1e-5 * np.abs(by_membrane).max())


# -- The edge of a shadow where the surface dips behind its rim ------------------------------------------------------


def surface(rim, pieces=40):
    """Dome to 10 mm, a trough, and a rim of this height in m at 15 mm; then down."""
    x = np.linspace(0.0, 0.018, 2 * pieces + 1)
    z = 4e-3 * np.exp(-((x / 5e-3) ** 2)) - 3e-4 + (rim + 3e-4) * np.exp(-(((x - 0.015) / 1.5e-3) ** 2))
    places = np.column_stack([x, z])
    return QuadraticCurve(np.stack([places[:-2:2], places[2::2], places[1::2]], axis=1))


def test_nothing_is_hidden_where_nothing_dips():
    curve = surface(-3e-4)
    shadow = shadow_of(curve)
    assert shadow.curve.nodes == pytest.approx(curve.nodes, abs=1e-15)
    rate = np.random.default_rng(0).standard_normal(curve.nodes.shape)
    assert shadow.rate(rate) == pytest.approx(rate, abs=1e-12)


def test_a_trough_behind_the_rim_is_level():
    """Heights of the edge are the largest from there outwards, taken from a fine sampling of the curve itself."""
    curve = surface(2e-4)
    s = np.linspace(-1, 1, 200)
    dense = np.concatenate([curve.at(np.full(len(s), k), s)[0] for k in range(len(curve.nodes))])
    envelope = np.maximum.accumulate(dense[::-1, 1])[::-1]
    assert (envelope - dense[:, 1]).max() > 3e-4
    points = np.column_stack([dense[:, 0], envelope])[::7]
    assert np.abs(shadow_of(curve).curve.closest(points).distance).max() < 3e-6
    assert np.abs(curve.closest(points).distance).max() > 1e-4


def test_the_edge_runs_on_from_piece_to_piece():
    """Where a trough is bridged too, to the distance of the places at which heights are compared."""
    nodes = shadow_of(surface(2e-4)).curve.nodes
    ends = np.linalg.norm(nodes[1:, 0] - nodes[:-1, 1], axis=1)
    assert ends.max() < 5e-6 and nodes[0, 0] == pytest.approx([0.0, 3.7e-3])
    assert (nodes[1:, 0, 0] > nodes[:-1, 0, 0]).all()


def test_the_level_part_moves_with_the_rim():
    curve, higher = surface(2e-4), surface(2.01e-4)
    rate = (higher.nodes - curve.nodes) / 1e-6
    points = np.array([[0.011, 2.2e-4], [0.012, 1.9e-4], [0.013, 2.5e-4]])
    shadow = shadow_of(curve)
    closest = shadow.curve.closest(points)
    moved = shadow_of(higher).curve.closest(points).distance - closest.distance
    top = 2e-4 + 4e-3 * np.exp(-9.0)  # the dome still adds a little at the rim
    assert closest.distance == pytest.approx(points[:, 1] - top, abs=1e-7)  # the elements are not the function
    assert closest.moved(shadow.rate(rate)) * 1e-6 == pytest.approx(moved, rel=1e-3)
    assert moved == pytest.approx(-1e-6, rel=0.01)


# -- Distances from curves of quadratic pieces: against circles, brute force and moved nodes -------------------------


def arc(pieces, radius=1.0):
    """A quarter circle from the top to the right."""
    angle = np.linspace(0.0, np.pi / 2, 2 * pieces + 1)
    places = radius * np.column_stack([np.sin(angle), np.cos(angle)])
    return QuadraticCurve(np.stack([places[:-2:2], places[2::2], places[1::2]], axis=1))


def wavy(pieces=12, seed=3):
    """A curve with uneven pieces, joints that are not smooth and middle nodes off the middle."""
    rng = np.random.default_rng(seed)
    x = np.sort(np.r_[0.0, rng.uniform(0.02, 2.98, 2 * pieces - 1), 3.0])
    places = np.column_stack([x, np.sin(2 * x) + 0.01 * rng.standard_normal(len(x))])
    ends, middles = places[::2], (places[:-2:2] + places[2::2]) / 2
    middles = middles + 0.02 * rng.standard_normal(middles.shape)
    return QuadraticCurve(np.stack([ends[:-1], ends[1:], middles], axis=1))


def test_distance_from_a_circle_converges():
    """The largest error of a quadratic through an arc falls with the fourth power of its length."""
    rng = np.random.default_rng(1)
    angle, radius = rng.uniform(0.05, 1.5, 400), rng.uniform(0.7, 1.3, 400)
    points = radius[:, None] * np.column_stack([np.sin(angle), np.cos(angle)])
    errors = [np.abs(arc(n).closest(points).distance - (radius - 1.0)).max() for n in (2, 4, 8, 16)]
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx(4.0, abs=0.3)
    assert errors[-1] < 1e-6


def test_distance_is_the_least_of_all_places():
    curve = wavy()
    points = np.random.default_rng(2).uniform([-0.3, -1.5], [3.3, 1.5], (500, 2))
    found = curve.closest(points)
    s = np.linspace(-1, 1, 4001)
    places = np.concatenate([curve.at(np.full(len(s), i), s)[0] for i in range(len(curve.nodes))])
    least = np.array([np.sqrt(((places - point) ** 2).sum(-1).min()) for point in points])
    assert np.abs(found.distance) == pytest.approx(least, abs=2e-6)
    assert (np.abs(found.distance) < least + 1e-12).all()


def test_points_above_are_on_the_left():
    curve = wavy()
    x = np.linspace(0.2, 2.8, 50)
    low, high = (curve.closest(np.column_stack([x, np.sin(2 * x) + step])).distance for step in (-0.3, 0.3))
    assert (low < 0.0).all() and (high > 0.0).all()


def test_distance_follows_nodes_and_points():
    """Central differences of the distance, away from joints, against the envelope theorem."""
    curve, rng = wavy(), np.random.default_rng(4)
    points = np.column_stack([np.linspace(0.1, 2.9, 200), np.sin(2 * np.linspace(0.1, 2.9, 200))])
    points += 0.05 * rng.standard_normal(points.shape)
    rate, shift = rng.standard_normal(curve.nodes.shape), rng.standard_normal(points.shape)
    found = curve.closest(points)
    h = 1e-6

    def both(step):
        return QuadraticCurve(curve.nodes + step * rate).closest(points + step * shift)

    ahead, behind = both(h), both(-h)
    smooth = (ahead.piece == found.piece) & (behind.piece == found.piece)
    assert smooth.mean() > 0.9
    slope = (ahead.distance - behind.distance)[smooth] / (2 * h)
    expected = (found.moved(rate) + (found.normal * shift).sum(-1))[smooth]
    assert slope == pytest.approx(expected, abs=1e-5 * np.abs(expected).max())


def test_a_point_beyond_the_end_is_as_far_as_the_end():
    curve = arc(4)
    assert abs(curve.closest(np.array([[1.3, -0.4]])).distance[0]) == pytest.approx(0.5, abs=1e-12)
