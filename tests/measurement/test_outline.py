"""The outline: its file, its height, and arrays or files that are none."""

from __future__ import annotations

import numpy as np
import pytest

from measurement.outline.outline import COLUMNS, Outline, OutlineError

X = np.linspace(-0.01, 0.01, 41)
Z = 0.004 * (1.0 - (X / 0.01) ** 2)
ERROR = np.full(41, 2e-6)


def made(**changes):
    values = {"x": X, "z": Z, "error": ERROR, "pressure": 951.0, "pressure_error": 6.7, "source": "IMG_1.JPG"}
    return Outline(**{**values, **changes})


@pytest.mark.parametrize("reasons", [(), ("the outline has a gap", "and = another\nreason, with a comma")])
def test_csv_and_back(tmp_path, reasons):
    outline = made(z=Z + 1e-9 / 3.0, trusted=not reasons, reasons=reasons, pressure=0.1 + 0.2)
    outline.to_csv(tmp_path / "a.csv")
    again = Outline.from_csv(tmp_path / "a.csv")
    for name in ("x", "z", "error"):
        assert getattr(again, name) == pytest.approx(getattr(outline, name), rel=1e-3 if name == "error" else 1e-8)
    assert (again.pressure, again.pressure_error, again.source) == (0.1 + 0.2, 6.7, "IMG_1.JPG")
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
        (lambda text: text + "1,2\n", "line 50: '1,2' is not three numbers"),
        (lambda text: text + "1,2,x\n", "not three numbers"),
        (lambda text: text + "0,1;2;3\n", "line 50: '0,1;2;3' is not three numbers .*'0,1' has a decimal comma"),
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
