"""The setup: its file, its metres against the photographer's, and whether its errors add up."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from measurement.camera import Camera, Exif, lens_profile
from measurement.photographer import Scene, truth_of
from measurement.screen.setup import Plane, Setup, SetupError, magnification

TRUTH = truth_of(Scene(tilt=35.0, pan=-10.0, distortion=(-0.2, 0.05, 1e-3, 0.0), magnification=1.05))
CAMERA = Camera(TRUTH.matrix, TRUTH.distortion, 1200, 800, "truth", 0.1)
NODES = np.stack(np.meshgrid(np.arange(-2, 3), np.arange(-1, 2)), axis=-1).reshape(-1, 2) * 0.009
SEEN = TRUTH.to_pixels(NODES / 1.05)
PLACES = np.random.default_rng(0).uniform([50, 50], [1150, 750], (30, 2))


def made(noise=0.02, seed=0, **options):
    noisy = SEEN + np.random.default_rng(seed).normal(0.0, noise, SEEN.shape)
    options = {"camera": CAMERA, "magnification": 1.05, **options}
    return Setup(plane=Plane.fit(options["camera"].undistort(noisy), NODES, max(noise, 1e-9)), **options)


def test_metres_and_back():
    setup = made(noise=0.0)
    assert np.abs(setup.to_metres(PLACES) - TRUTH.to_metres(PLACES)).max() < 1e-9
    assert np.abs(setup.to_pixels(setup.to_metres(PLACES)) - PLACES).max() < 1e-4
    step = 0.05
    for axis in (0, 1):
        aside = step * np.eye(2)[axis]
        difference = (TRUTH.to_metres(PLACES + aside) - TRUTH.to_metres(PLACES - aside)) / (2 * step)
        assert np.abs(setup.jacobian(PLACES)[:, :, axis] - difference).max() < 1e-4 * 40e-6


def test_file_gives_exactly_the_same_setup(tmp_path):
    lensfun = lens_profile(Exif("Canon", "Canon EOS 550D", "EF-S18-55mm f/3.5-5.6 IS", 35.0), 1200, 800)
    for setup in (
        made(),
        made(camera=lensfun),
        made(zero=[[0.0, 1 / 3], [0.02, 0.001]], roi=(1.0, 2.0, 700.0, 600.5), grid_pitch=0.009,
             shadow_colour=(30.0, 31.1, 33.3), magnification_error=0.1 + 0.2),
    ):  # fmt: skip
        path = tmp_path / "setup.toml"
        path.write_text(setup.to_toml())
        again = Setup.from_file(path)
        assert again.to_toml() == setup.to_toml()
        assert np.array_equal(again.to_metres(PLACES), setup.to_metres(PLACES))
        assert np.array_equal(again.error(PLACES, 0.1), setup.error(PLACES, 0.1))


def test_errors_add_up():
    """Standardised misses of an edge with its own error, grid fit and lens, along given directions, have unit variance."""
    rng = np.random.default_rng(5)
    normal = rng.normal(size=PLACES.shape)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    misses = []
    for seed in range(200):
        setup = made(noise=0.05, seed=seed, magnification=1.05 * (1.0 + 0.002 * rng.normal()), magnification_error=0.0021)
        raw = PLACES + rng.normal(0.0, 0.12, PLACES.shape) + rng.normal(0.0, CAMERA.error_px, PLACES.shape)
        missed = np.sum((setup.to_metres(raw) - TRUTH.to_metres(PLACES)) * normal, axis=1)
        misses.append(missed / setup.error(raw, 0.12, normal))
    assert np.mean(np.square(misses)) == pytest.approx(1.0, abs=0.1)


def test_each_part_counts():
    setup = made()
    alone = setup.error(PLACES, 0.1)
    assert np.all(setup.error(PLACES, 0.2) > alone)
    assert np.all(made(noise=0.5).error(PLACES, 0.1) > alone)
    assert np.all(made(camera=dataclasses.replace(CAMERA, error_px=1.0)).error(PLACES, 0.1) > alone)
    wider = made(magnification_error=0.01)
    assert np.all(wider.error(PLACES, 0.1) > alone)
    # From the point that lengths are counted from, a wrong magnification moves nothing.
    place = setup.to_metres(PLACES[:1])[0]
    assert wider.error(PLACES[:1], 0.1, about=place) == pytest.approx(alone[:1])
    # Both axes together make up the error over all directions.
    across, up = (setup.error(PLACES, 0.1, axis) for axis in np.eye(2))
    assert np.sqrt((across**2 + up**2) / 2.0) == pytest.approx(alone)


def test_magnification_of_a_lamp():
    assert magnification(2.0, 0.1) == (1.05, 0.0)
    value, error = magnification(2.0, 0.1, 0.05, 0.002)
    samples = np.random.default_rng(0).normal([2.0, 0.1], [0.05, 0.002], (200_000, 2))
    assert value == pytest.approx(1.05)
    assert error == pytest.approx(np.std((samples[:, 0] + samples[:, 1]) / samples[:, 0]), rel=0.02)
    with pytest.raises(SetupError, match="must be positive"):
        magnification(0.0, 0.1)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda text: text.replace("magnification = 1.05", "magnification = 0.0"), "magnification must be positive"),
        (lambda text: text.replace("magnification = 1.05", 'magnification = "big"'), "cannot be read"),
        (lambda text: text.replace("[camera]", "[kamera]"), "unknown field 'kamera'"),
        (lambda text: text.replace('model = "opencv"', ""), "camera cannot be used: .* no field 'model'"),
        (lambda text: text.replace("residual", "rest"), "no field 'residual'"),
        (lambda text: "roi = [1, 2, 3]\n" + text, "roi needs four"),
        (lambda text: "roi = [600, 2, 300, 400]\n" + text, "region of interest"),
        (lambda text: "zero = [[0.1, 0.1], [0.1, 0.1]]\n" + text, "two different points"),
        (lambda text: "camera = 3\n" + text.split("[camera]")[0], "cannot be read"),
        (lambda text: text[: len(text) // 2], "not valid TOML|no field"),
        (lambda text: "", "no field 'camera'"),
    ],
)
def test_broken_files_are_refused(tmp_path, change, reason):
    path = tmp_path / "setup.toml"
    path.write_text(change(made().to_toml()))
    with pytest.raises(SetupError, match=reason) as error:
        Setup.from_file(path)
    assert str(path) in str(error.value)


def test_missing_files_are_refused(tmp_path):
    with pytest.raises(SetupError, match="cannot be read"):
        Setup.from_file(tmp_path / "none.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(SetupError, match="cannot be read"):
        Setup.from_file(tmp_path / "binary.toml")
