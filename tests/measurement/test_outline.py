"""The outline: its file, its height, and arrays or files that are none."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from measurement.outline.edge import Edge
from measurement.outline.outline import COLUMNS, Outline, OutlineError
from measurement.outline.profiles import ShadowColour
from measurement.outline.zero import ZeroLine, highest_ripple
from measurement.screen.look import GridLook, flatness
from measurement.series.checks import flat, membrane, one_lamp, unsure_of

X = np.linspace(-0.01, 0.01, 41)
Z = 0.004 * (1.0 - (X / 0.01) ** 2)
ERROR = np.full(41, 2e-6)


def made(**changes):
    values = {"x": X, "z": Z, "error": ERROR, "pressure": 951.0, "pressure_error": 6.7, "source": "IMG_1.JPG"}
    return Outline(**{**values, **changes})


@pytest.mark.parametrize("reasons", [(), ("the outline has a gap", "and = another\nreason, with a comma")])
def test_csv_and_back(tmp_path, reasons):
    outline = made(z=Z + 1e-9 / 3.0, trusted=not reasons, reasons=reasons, pressure=0.1 + 0.2, edge_error=1.5e-6)
    outline.to_csv(tmp_path / "a.csv")
    again = Outline.from_csv(tmp_path / "a.csv")
    for name in ("x", "z", "error"):
        assert getattr(again, name) == pytest.approx(getattr(outline, name), rel=1e-3 if name == "error" else 1e-8)
    assert (again.pressure, again.pressure_error, again.source) == (0.1 + 0.2, 6.7, "IMG_1.JPG")
    assert again.edge_error == 1.5e-6
    assert again.trusted == (not reasons)
    assert again.reasons == tuple(" ".join(reason.split()) for reason in reasons)
    again.to_csv(tmp_path / "b.csv")
    assert (tmp_path / "b.csv").read_text() == (tmp_path / "a.csv").read_text()


def test_the_height_is_that_of_the_parabola_at_the_top():
    outline = made(z=np.where(np.abs(X) < 0.004, 0.004, 0.001) + 1e-6 * np.cos(np.arange(41) * np.pi))
    assert outline.height == pytest.approx(0.004, abs=0.2e-6)
    assert outline.height_error == 2e-6
    # An error that all points share says nothing about which of them are the top.
    assert made(error=np.full(41, 3e-4)).height == pytest.approx(0.004, abs=20e-6)


def test_nobody_changes_an_outline_from_outside():
    x = X.copy()
    outline = made(x=x)
    x[0] = 5.0
    assert outline.x[0] == X[0]
    with pytest.raises(ValueError, match="read-only"):
        outline.z[0] = 1.0


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"x": X[1:]}, "as many x"),
        ({"x": [], "z": [], "error": []}, "at least one"),
        ({"z": np.where(X > 0, np.nan, Z)}, "not finite"),
        ({"error": 0.0 * ERROR}, "not positive"),
        ({"x": X[::-1]}, "not sorted"),
        ({"pressure": np.inf}, "pressure"),
        ({"pressure_error": -1.0}, "pressure"),
        ({"trusted": False}, "reasons if and only if"),
        ({"reasons": ("why",)}, "reasons if and only if"),
    ],
)
def test_what_is_no_outline(changes, reason):
    with pytest.raises(OutlineError, match=reason):
        made(**changes)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda text: "", "no comment line '# pressure_Pa"),
        (lambda text: text.replace("# pressure_error_Pa", "# other"), "no comment line '# pressure_error_Pa"),
        (lambda text: text.replace("951.0", "much"), "is not a number"),
        (lambda text: text + "1,2\n", "line 51: '1,2' is not three numbers"),
        (lambda text: text + "1,2,x\n", "not three numbers"),
        (lambda text: text + "0,1;2;3\n", "line 51: '0,1;2;3' is not three numbers .*'0,1' has a decimal comma"),
        (lambda text: text.replace("951.0", "951,0"), "'951,0' has a decimal comma"),
        (lambda text: text + "1,nan,1e-6\n", "not a finite number"),
        (lambda text: text.split(COLUMNS)[0] + COLUMNS, "at least one"),
    ],
)
def test_broken_files(tmp_path, change, reason):
    path = tmp_path / "a.csv"
    made().to_csv(path)
    path.write_text(change(path.read_text()))
    with pytest.raises(OutlineError, match=reason):
        Outline.from_csv(path)


def test_unreadable_files_and_silent_ones(tmp_path):
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00")
    for name in ("none.csv", "binary.csv"):
        with pytest.raises(OutlineError, match="cannot be read"):
            Outline.from_csv(tmp_path / name)
    made().to_csv(tmp_path / "a.csv")
    text = (tmp_path / "a.csv").read_text().replace("# trusted = yes\n", "")
    (tmp_path / "a.csv").write_text(text)
    assert not Outline.from_csv(tmp_path / "a.csv").trusted


def test_bridges_are_told_from_measured_points(tmp_path):
    bridged = np.abs(X) < 0.003
    outline = made(bridged=bridged, error=np.where(bridged, 80e-6, 2e-6))
    outline.to_csv(tmp_path / "a.csv")
    again = Outline.from_csv(tmp_path / "a.csv")
    assert (again.bridged == bridged).all()
    assert len(again.measured().x) == (~bridged).sum()
    # A top that was not measured is known no better than its bridge.
    assert outline.height_error == pytest.approx(80e-6)
    with pytest.raises(OutlineError, match="whether it was measured"):
        made(bridged=bridged[1:])


def test_files_without_that_column_were_measured_everywhere(tmp_path):
    made().to_csv(tmp_path / "a.csv")
    text = (tmp_path / "a.csv").read_text().replace(",bridged", "").replace("2e-06,0", "2e-06")
    (tmp_path / "a.csv").write_text(text)
    assert not Outline.from_csv(tmp_path / "a.csv").bridged.any()


def test_the_history_of_the_pressure_stays_in_the_file(tmp_path):
    history = ((0.0, 0.0), (2.0, 1e3 / 3.0), (12.0, 1e3 / 3.0))
    before = made(history=history)
    before.to_csv(tmp_path / "a.csv")
    assert Outline.from_csv(tmp_path / "a.csv").history == history
    assert Outline.from_csv(tmp_path / "a.csv").pressure == before.pressure
    text = (tmp_path / "a.csv").read_text().replace("; 2.0 ", "; 2.0; ")
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(OutlineError, match="is not pairs of time and pressure"):
        Outline.from_csv(tmp_path / "a.csv")
    with pytest.raises(OutlineError, match="run backwards"):
        made(history=((0.0, 0.0), (2.0, 1e3), (1.0, 1e3)))


# -- Bumps narrower than a membrane can bend: doubted if they are high, in the stated error if they are low ----------


def edge(bump=0.0, place=2e-3, noise=1.5e-6, seed=0):
    """A bulge of 20 mm width and 4 mm height, a point every 50 um, with a thing of 0.6 mm length and this height on it."""
    x = np.linspace(-14e-3, 14e-3, 561)
    rise = 4e-3 * np.clip(1.0 - (x / 10e-3) ** 2, 0.0, None) ** 3
    thing = bump * np.exp(-0.5 * ((x - place) / 0.25e-3) ** 2)
    return np.column_stack([x, rise + thing + np.random.default_rng(seed).normal(0.0, noise, len(x))])


def check_ripples(placed):
    flat = ZeroLine.through(np.array([[0.0, 0.0], [1.0, 0.0]]))
    error = np.full(len(placed), 2e-6)
    return next(
        membrane(SimpleNamespace(raw=placed, ripple=highest_ripple(placed), placed=placed, error=error, zero=flat)),
        None,
    )


def unsure(placed):
    return unsure_of(highest_ripple(placed))


@pytest.mark.parametrize("seed", range(10))
def test_a_smooth_edge_is_trusted_as_it_is(seed):
    placed = edge(seed=seed)
    assert check_ripples(placed) is None
    assert unsure(placed) == 0.0


@pytest.mark.parametrize("place", [-4e-3, 0.0, 2e-3])
@pytest.mark.parametrize("bump", [20e-6, -20e-6])
def test_a_low_bump_is_trusted_and_widens_the_stated_error(bump, place):
    placed = edge(bump, place)
    assert check_ripples(placed) is None
    # A polynomial over a few millimetres follows a part of it.
    assert 0.2 * abs(bump) < unsure(placed) < 0.6 * abs(bump)


@pytest.mark.parametrize(("bump", "name"), [(80e-6, "bump of"), (-80e-6, "hollow of")])
def test_a_high_one_is_doubted(bump, name):
    doubt = check_ripples(edge(bump))
    assert name in str(doubt)
    assert unsure(edge(bump)) > 20e-6


def test_a_flat_surface_a_little_below_the_zero_plane_is_no_second_thing():
    x = np.linspace(-14e-3, 14e-3, 561)
    assert check_ripples(np.column_stack([x, np.full(561, -20e-6)])) is None


# -- A second lamp beside the first: one flank of the shadow is less deep than the other, which one lamp does not ma--


COLOUR = ShadowColour(np.full(3, 0.1), np.full(3, 0.8), np.eye(3) * 1e-4)
WHOLE = 1.0 / float(COLOUR.direction @ COLOUR.lit)


def flanks(part, seed=0):
    noise = np.random.default_rng(seed).normal(0.0, 0.01, len(part))
    one = np.ones(len(part))
    flanks = Edge(np.zeros((len(part), 2)), np.zeros((len(part), 2)), one, one, WHOLE * (part + noise), 0.0)
    return SimpleNamespace(traced=SimpleNamespace(edge=flanks, coarse=SimpleNamespace(colour=COLOUR)))


def test_one_lamp_and_some_dust_are_no_second_lamp():
    part = np.ones(400)
    part[100:104] = 0.6
    assert next(one_lamp(flanks(part)), None) is None
    assert next(one_lamp(flanks(np.linspace(0.98, 1.02, 400))), None) is None


@pytest.mark.parametrize("share", [0.15, 0.3])
def test_a_flank_that_a_second_lamp_reaches_is_doubted(share):
    part = np.where(np.arange(400) < 150, 1.0 - share, 1.0)
    assert "a second lamp" in next(one_lamp(flanks(part)), None).verdict


def test_an_edge_of_half_a_lamp_is_refused():
    doubt = next(one_lamp(flanks(np.full(400, 0.5))), None)
    assert doubt.rejects and "second lamp" in doubt.verdict


# -- A screen that bulges in one place: told from noise and dust, and counted for the edge beside it -----------------


PITCH, NOISE = 9e-3, 4e-6
EDGE = np.column_stack([np.linspace(-0.01, 0.01, 50), np.full(50, 1e-3)])


def look(bulge=0.0, dust=0, noise=NOISE, seed=0):
    """Places along the lines of a screen 54 mm wide, moved as a whole, and by a bulge about (2 mm, 3 mm)."""
    rng = np.random.default_rng(seed)
    along = np.arange(-27e-3, 27e-3, 0.75e-3)
    lines = np.arange(-2, 3) * PITCH
    place = np.array([[(line, at), (at, line)] for line in lines for at in along]).reshape(-1, 2)
    axis = np.tile([0, 1], len(lines) * len(along))
    far = np.linalg.norm(place - [2e-3, 3e-3], axis=1)
    shift = 5e-6 + 4e-5 * place[:, 0] + bulge * np.exp(-0.5 * (far / 4e-3) ** 2) + rng.normal(0.0, noise, len(axis))
    shift[rng.integers(0, len(axis), dust)] += 200e-6
    bare = np.ones((2, 3))
    return GridLook(PITCH, 1.0, place, shift, axis, bare, np.linspace(0.0, 1.0, 3), ({}, {}))


def found(looks, points):
    seen = flatness(looks, points)
    return seen.error, next(flat(SimpleNamespace(traced=SimpleNamespace(flatness=seen))), None)


@pytest.mark.parametrize("seed", range(5))
def test_a_flat_screen_and_dust_are_no_bulge(seed):
    error, doubt = found([look(dust=6, seed=seed)], EDGE)
    assert doubt is None
    assert np.median(error) < 3e-6


@pytest.mark.parametrize("seed", range(5))
def test_a_bulge_beside_the_edge_is_stated_and_doubted(seed):
    error, doubt = found([look(bulge=100e-6, seed=seed)], EDGE)
    assert "the screen bulges" in doubt.verdict
    assert error.max() > 25e-6
    assert np.argmax(error) == pytest.approx(30, abs=10)


def test_a_bulge_far_from_the_edge_is_not_its_matter():
    error, doubt = found([look(bulge=100e-6)], EDGE - np.array([0.0, 30e-3]))
    assert doubt is None
    assert error.max() < 10e-6


def test_faint_lines_in_the_shadow_have_an_error_of_their_own():
    looks = [look(), look(noise=30e-6, seed=1)]
    noise = flatness(looks, EDGE).noise
    assert noise.max() > 5.0 * noise.min()
    assert found(looks, EDGE)[1] is None
