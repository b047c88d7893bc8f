"""The outline of a device: where it is at rest, that a slice shows what the section shows, and how it moves."""

from __future__ import annotations

import numpy as np
import pytest

from geometries import HollowDisk, Membrane
from softmodels.fitting.outlines.residuals import Height, HeightResiduals, OutlineResiduals
from softmodels.fitting.outlines.shapes import OutlineFitError
from softmodels.fitting.problem import LawChoice

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
    with pytest.raises(
        OutlineFitError, match=r"top of the device is 1\.2.* mm from flat.*height_datum apex.*table of heights"
    ):
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
