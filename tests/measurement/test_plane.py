"""The screen's homography and whether its stated errors are true."""

from __future__ import annotations

import numpy as np
import pytest

from measurement.camera import Camera
from measurement.photographer import Scene, truth_of
from measurement.screen.setup import Plane, PlaneError

TRUTH = truth_of(Scene(tilt=35.0, pan=-15.0, width=2400, height=1600, target=(0.002, 0.004)))
NODES = np.stack(np.meshgrid(np.arange(-3, 4), np.arange(-2, 3)), axis=-1).reshape(-1, 2) * 0.009
SEEN = TRUTH.to_pixels(NODES)
PLACES = np.random.default_rng(1).uniform([100, 100], [2300, 1500], (40, 2))


def test_points_without_error_are_fitted_exactly_there_and_back():
    plane = Plane.fit(SEEN, NODES)
    assert plane.residual < 1e-12
    assert np.abs(plane.to_metres(PLACES) - TRUTH.to_screen(PLACES)).max() < 1e-12
    assert np.abs(plane.to_pixels(plane.to_metres(PLACES)) - PLACES).max() < 1e-7
    assert np.linalg.norm(plane.homography) == pytest.approx(1.0)


def test_jacobian_against_differences():
    plane, step = Plane.fit(SEEN, NODES), 1e-3
    slope = plane.jacobian(PLACES)
    for axis in (0, 1):
        aside = step * np.eye(2)[axis]
        difference = (plane.to_metres(PLACES + aside) - plane.to_metres(PLACES - aside)) / (2 * step)
        assert np.abs(slope[:, :, axis] - difference).max() < 1e-6 * np.abs(slope).max()


@pytest.mark.parametrize("sigma", [0.05, None], ids=["error given", "error from the fit"])
def test_stated_errors_are_true(sigma):
    rng = np.random.default_rng(7)
    lengths = []
    for _ in range(50):
        plane = Plane.fit(SEEN + rng.normal(0.0, 0.05, SEEN.shape), NODES, sigma)
        missed = plane.to_metres(PLACES) - TRUTH.to_screen(PLACES)
        spread = plane.covariances(PLACES)
        lengths.append(np.einsum("ni,nij,nj->n", missed, np.linalg.inv(spread), missed) / 2.0)
    # Mean of 50 squared standardised residuals (two axes, strongly correlated over the places): 1 within 0.2.
    assert np.mean(lengths) == pytest.approx(1.0, abs=0.25)


def test_each_point_may_have_its_own_error():
    rng = np.random.default_rng(8)
    sigma = rng.uniform(0.02, 0.5, len(SEEN))
    lengths, flat = [], []
    for _ in range(50):
        noisy = SEEN + rng.normal(0.0, 1.0, SEEN.shape) * sigma[:, None]
        plane = Plane.fit(noisy, NODES, sigma)
        missed = plane.to_metres(PLACES) - TRUTH.to_screen(PLACES)
        lengths.append(np.einsum("ni,nij,nj->n", missed, np.linalg.inv(plane.covariances(PLACES)), missed) / 2.0)
        flat.append(
            np.sum((Plane.fit(noisy, NODES).to_metres(PLACES) - TRUTH.to_screen(PLACES)) ** 2) / np.sum(missed**2)
        )
    assert np.mean(lengths) == pytest.approx(1.0, abs=0.25)
    assert np.median(flat) > 1.5  # weighing pays


def test_refused():
    line = np.column_stack([np.linspace(0, 1000, 8), np.linspace(0, 500, 8)])
    with pytest.raises(PlaneError, match="on a line"):
        Plane.fit(line, line * 1e-5)
    with pytest.raises(PlaneError, match="on a line"):
        Plane.fit(np.vstack([line, [500.0, 900.0]]), np.vstack([line, [500.0, 900.0]]) * 1e-5)
    with pytest.raises(PlaneError, match="give at least 5"):
        Plane.fit(SEEN[:4], NODES[:4])
    with pytest.raises(PlaneError, match="same point"):
        Plane.fit(np.ones((6, 2)), NODES[:6])
    with pytest.raises(PlaneError, match="35 points in the photograph but 34"):
        Plane.fit(SEEN, NODES[1:])
    with pytest.raises(PlaneError, match="finite"):
        Plane.fit(np.where(SEEN[0] == SEEN, np.nan, SEEN), NODES)
    with pytest.raises(PlaneError, match="must be positive"):
        Plane.fit(SEEN, NODES, 0.0)
    corners = np.array([0, 6, 28, 34])
    assert Plane.fit(SEEN[corners], NODES[corners], 0.1).residual < 1e-12


def test_focal_length_does_not_matter():
    """Lengths on the screen are the same whatever pinhole matrix an undistorted photograph is given."""
    first, second = Camera.ideal(2400, 1600), Camera.ideal(2400, 1600, 9000.0)
    a, b = (Plane.fit(camera.undistort(SEEN), NODES).to_metres(camera.undistort(PLACES)) for camera in (first, second))
    assert np.array_equal(a, b)


def test_what_neighbours_miss_in_common_is_no_noise():
    rng = np.random.default_rng(3)
    x, y = np.meshgrid(np.arange(9.0), np.arange(7.0))
    targets = np.column_stack([x.ravel(), y.ravel()]) * 5e-3
    px = targets * 2e4 + 300.0
    noisy = Plane.fit(px + rng.normal(0.0, 0.2, px.shape), targets)
    assert noisy.systematic < 0.3 * noisy.residual
    offset = px - px.mean(axis=0)
    bent = px + 0.3 * offset * (np.linalg.norm(offset, axis=1, keepdims=True) / 300.0) ** 2
    wrong = Plane.fit(bent, targets)
    assert wrong.systematic > 0.4 * wrong.residual
