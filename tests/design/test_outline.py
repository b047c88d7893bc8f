"""The outline as what a design is to follow: its value, its derivatives, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest

from geometries import HollowDisk
from measurement.outline.outline import Outline as Measured
from softmodels.design.targets import Outline, _middle
from softmodels.design.trials import JudgedLoad

TAYLOR = "Taylor's remainder of the distance from an outline, by every length"
AT = 2000.0
DOME = tuple((x, 6e-3 - 12.0 * x * x) for x in np.linspace(-0.02, 0.02, 41))
NAMES = ("membrane", "cavity_radius", "wall", "base", "profile[1]", "profile[2]", "profile[3]")


@pytest.mark.parametrize("name", NAMES)
def test_of_a_section(designed, thin_disk, second_order, comm, name):
    second_order(designed(thin_disk, NAMES, (Outline(points=DOME, at=AT),), comm), name, TAYLOR, "section")


def test_of_a_wedge(designed, second_order, comm):
    wedge = HollowDisk.variant("shadow", fillet=0.0, base_fillet=0.0, angle=15.0, azimuth=20.0, cell_size=0.006)
    names = ("membrane", "cavity_radius")
    model = designed(wedge, names, (Outline(points=DOME, at=AT),), comm)
    for name in names:
        second_order(model, name, TAYLOR, "wedge")


@pytest.mark.parametrize("at", [AT, JudgedLoad("volume", 40e-6)], ids=["pressure", "volume"])
def test_each_distance_has_its_derivatives(designed, thin_disk, comm, at):
    """Of the distances one by one, by the rates of the state, against the adjoint of their root mean square."""
    asked = Outline(points=DOME, at=at)
    model = designed(thin_disk, NAMES, (asked,), comm)
    found = model.evaluate(model.start)
    squares, value = found.squares[asked.key], found.values[asked.key]
    assert squares.residuals @ squares.residuals == pytest.approx(len(DOME) * value**2, rel=1e-12)
    gradient = squares.jacobian.T @ squares.residuals / (len(DOME) * value)
    assert gradient == pytest.approx(found.gradients[asked.key], rel=1e-6, abs=1e-7 * np.abs(gradient).max())


def test_of_its_own_outline_it_is_none(designed, thin_disk, comm):
    """Points taken off the curve lie on it; raised by a tenth of a millimetre the flat part is that far away."""
    model = designed(thin_disk, NAMES, (Outline(points=DOME, at=AT),), comm)
    model.evaluate(model.start)
    (measure,), (state,) = model.meshed.measures.values(), model.meshed.states.states.values()
    measure.silhouette.follow()
    curve = measure.silhouette.curve(state)
    piece = np.arange(len(curve.nodes) // 2)
    on_it = curve.at(piece, np.full(len(piece), 0.3))[0]
    for shift, distance in ((0.0, 0.0), (1e-4, 1e-4)):
        measure.points = on_it + np.array([0.0, shift])
        assert measure.slopes(state).value == pytest.approx(distance, rel=0.1, abs=1e-9)
    measure.points = np.abs(np.array(DOME))


def test_files_are_read_as_the_measurement_writes_them(tmp_path):
    x = np.linspace(-0.03, 0.03, 1201)
    z = np.maximum(6e-3 - 12.0 * x * x, 0.0)
    noise = np.random.default_rng(3).normal(0.0, 20e-6, len(x))
    file = tmp_path / "dome.csv"
    Measured(x + 0.1, z + noise, np.full(len(x), 2e-5), AT, 5.0, "dome.jpg").to_csv(file)
    asked = Outline(file=str(file), at=AT, sigma="20 um")
    points = np.array(asked.points)
    assert asked.key == "distance from the outline dome at 2 kPa"
    assert 0.5 < points[:, 1].max() / 6e-3 < 1.1 and points[:, 1].min() > -1e-4
    assert _middle(points) == pytest.approx(0.1, abs=1e-4)
    assert _middle(points[points[:, 0] >= 0.1] - np.array([0.1, 0.0])) == 0.0
    assert asked.sigma == pytest.approx(20e-6) and 1.0 <= asked.run < 2.0


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({}, "either a file of points or the points"),
        ({"points": ((0.0, 1e-3),)}, "at least 3 points"),
        ({"points": ((0.0,), (1.0, 2.0), (1.0, 2.0))}, "are pairs"),
        ({"points": DOME, "sigma": -1.0}, "above zero"),
        ({"file": "nowhere.csv"}, "nowhere.csv cannot be read"),
    ],
)
def test_refused(values, words):
    with pytest.raises(ValueError, match=words):
        Outline(at=AT, **values)


def test_a_curved_top_is_refused_where_heights_were_measured(designed, thin_disk, tmp_path, comm):
    x = np.linspace(-0.03, 0.03, 121)
    file = tmp_path / "dome.csv"
    Measured(x, np.maximum(6e-3 - 12 * x * x, 0), np.full(121, 2e-5), AT, 5.0, "dome.jpg").to_csv(file)
    curved = HollowDisk.variant("shadow", section="axisymmetric", cell_size=0.004, profile=(1.2, 0.8))
    with pytest.raises(ValueError, match="mm from flat"):
        designed(curved, ("membrane",), (Outline(file=str(file), at=AT),), comm).evaluate(np.array([curved.membrane]))
