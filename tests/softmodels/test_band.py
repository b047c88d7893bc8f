"""The 95 % band of a fitted material's errors around a path, against paths of other materials."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import pytest

import softmodels as sm
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.case.load import steps_of
from softmodels.case.materials import MaterialErrors, SourceBand, band_of
from softmodels.components.loads import Gravity, Mass
from softmodels.runs.columns import term
from softmodels.runs.labels import headline, state_labels
from softmodels.runs.notes import band_notes

DISK = sm.HollowDisk(section="axisymmetric", membrane=0.003)
C1, C2 = 14e3, 60.0
COVARIANCE = ((700.0**2, -0.8 * 700.0 * 8.0), (-0.8 * 700.0 * 8.0, 8.0**2))
ERRORS = MaterialErrors(("c1", "c2"), COVARIANCE)


def law(c1=C1, c2=C2):
    return sm.Yeoh(c1, c2, 0.0, 0.49)


@pytest.fixture(scope="module")
def run():
    return sm.inflate(DISK, law(), "0,30,200 cm", band=ERRORS)


@functools.cache
def inflated(law, pressures, components=()):
    """A run, made once for all columns that are read from its rows."""
    return sm.inflate(DISK, law, pressures, components=components)


def half(slopes):
    return 1.959964 * np.sqrt(slopes @ np.array(COVARIANCE) @ slopes)


def slopes(value):
    """Central differences of what a run with other parameters gives."""
    c1, c2 = 0.002 * C1, 0.02 * C2
    return np.array([(value(law(C1 + c1)) - value(law(C1 - c1))) / (2 * c1),
                     (value(law(c2=C2 + c2)) - value(law(c2=C2 - c2))) / (2 * c2)])  # fmt: skip


@pytest.mark.campaign
@pytest.mark.parametrize("column", ["apex_mm", "ceiling_mm", "added_volume_ml"])
def test_at_the_same_pressure(run, column):
    found = next(row for row in run.rows if row["requested"] and row["pressure_cm"] == 30.0)
    expected = half(slopes(lambda other: inflated(other, "30 cm").rows[-1][column]))
    name, unit = column.rsplit("_", 1)
    assert found[f"{name}_ci95_{unit}"] == pytest.approx(expected, rel=2e-4)


@pytest.mark.campaign
def test_the_limit_point(run):
    """There the pressure at the same volume is the highest one, of every material near by."""
    row = next(row for row in run.rows if row["limit"])
    expected = half(slopes(lambda other: sm.limit(DISK, other).pressure))
    assert row["pressure_ci95_cm"] * run.case.column.pascal == pytest.approx(expected, rel=1e-3)
    (note,) = band_notes(run.case, run.table)
    low, high = row["pressure_cm"] - row["pressure_ci95_cm"], row["pressure_cm"] + row["pressure_ci95_cm"]
    assert f"between {low:.4g} and {high:.4g} cm, 0.97 g/ml" in note


@pytest.mark.campaign
def test_at_the_same_volume():
    rows = sm.inflate(DISK, law(), volumes="2 ml", band=ERRORS).rows
    expected = half(slopes(lambda other: sm.inflate(DISK, other, volumes="2 ml").rows[-1]["apex_mm"]))
    assert rows[-1]["apex_ci95_mm"] == pytest.approx(expected, rel=1e-3)
    assert rows[-1]["added_volume_ci95_ml"] == 0.0 and rows[0]["apex_ci95_mm"] == 0.0


def test_the_path_is_as_without(run):
    plain = sm.inflate(DISK, law(), "0,30,200 cm")
    assert [row["apex_mm"] for row in plain.rows] == [row["apex_mm"] for row in run.rows]
    assert term("apex_ci95_mm", DISK).name == "band of the rise of the apex"


HEAVY = (Gravity("-z"), Mass("top", 0.030, name="brass"))


@pytest.mark.campaign
@pytest.mark.parametrize("column", ["apex_mm", "ceiling_mm", "added_volume_ml"])
def test_under_a_weight(heavy_run, column):
    """A weight keeps its newtons: where the device hangs is as uncertain as its material, and so is every state from there."""
    name, unit = column.rsplit("_", 1)
    for row, pressures, step in ((heavy_run.rows[0], "0,1 cm", 0), (heavy_run.at("20 cm").row, "20 cm", -1)):
        expected = half(slopes(lambda other, p=pressures, k=step: heavy(other, p).rows[k][column]))
        assert row[f"{name}_ci95_{unit}"] == pytest.approx(expected, rel=1e-3)
    assert heavy_run.rows[0]["pressure_cm"] == 0.0 and heavy_run.rows[0]["apex_ci95_mm"] > 0.02


@pytest.mark.campaign
def test_the_limit_under_a_weight(heavy_run):
    row = next(row for row in heavy_run.rows if row["limit"])
    limit = sm.limit(DISK, law(), components=HEAVY)
    assert limit.pressure == pytest.approx(row["pressure_cm"] * heavy_run.case.column.pascal, rel=1e-6)
    plain = sm.limit(DISK, law())
    assert abs(limit.pressure / plain.pressure - 1) > 1e-3
    expected = half(slopes(lambda other: sm.limit(DISK, other, components=HEAVY).pressure))
    assert row["pressure_ci95_cm"] * heavy_run.case.column.pascal == pytest.approx(expected, rel=1e-3)


def heavy(law, pressures):
    """A run under weights."""
    return inflated(law, pressures, HEAVY)


@pytest.fixture(scope="module")
def heavy_run():
    return sm.inflate(DISK, law(), "0,20,200 cm", components=HEAVY, band=ERRORS)


def test_in_case_files(tmp_path):
    case = Case("disk", DISK, law(), steps=steps_of(pressure_cm=(10.0,)), band=ERRORS)
    assert Case.from_toml(case.to_toml()).band == ERRORS
    fitted = tmp_path / "fitted.toml"
    fitted.write_text(
        '[material]\nlaw = "yeoh"\nc1 = "14 kPa"\nc2 = "60 Pa"\npoisson = 0.49\n'
        "[fit]\nintervals_95 = { c1 = [13000.0, 15000.0], c2 = [50.0, 70.0] }\n"
    )
    text = dataclasses.replace(case, band=None).to_toml() + f"[band]\nfile = '{fitted}'\n"
    found = Case.from_toml(text).band
    assert np.sqrt(np.diag(found.matrix)) == pytest.approx([1000 / 1.959964, 10 / 1.959964], rel=1e-9)
    with pytest.raises(CaseError, match="another material"):
        dataclasses.replace(case, material=law(15e3), band=found)


@pytest.mark.parametrize(
    ("band", "words"),
    [
        ({"names": ("c1", "c9")}, "errors of c9"),
        ({"covariance": ((1.0, 0.0),)}, "covariance is invalid"),
        ({"covariance": ((1.0, 2.0), (0.0, 1.0))}, "covariance is invalid"),
        ({"covariance": ((1.0, 0.0), (0.0, -1.0))}, "covariance is invalid"),
        ({"covariance": ((1.0, 0.0), (0.0, float("inf")))}, "covariance is invalid"),
    ],
)
def test_what_is_no_error(band, words):
    with pytest.raises(CaseError, match=words):
        Case("disk", DISK, law(), steps=steps_of(pressure_cm=(10.0,)), band=dataclasses.replace(ERRORS, **band))


@pytest.mark.parametrize("table", ["[band]", "[band]\nfile = 3", "[band]\nwidth = 2", "[band]\nfile = 'nowhere.toml'"])
def test_tables_that_are_no_band(table):
    with pytest.raises(CaseError):
        Case.from_toml(Case("disk", DISK, law(), steps=steps_of(pressure_cm=(10.0,))).to_toml() + table)


def test_no_band_of_a_cycle():
    with pytest.raises(CaseError, match="bands are available only for"):
        Case("disk", DISK, law(), steps=steps_of(pressure_cm=(10.0,)), load_unload=True, band=ERRORS)


def test_titles_tell_the_pressure_and_not_its_band(run):
    row, words = run.table[-1], state_labels(run.case)
    assert row["pressure_ci95"] > 0.0 and headline(row, words).startswith(f"{row.shown('pressure'):.4g} cm, 0.97 g/ml")
    assert (words.pressures(row), words.volumes(row)) == (["pressure"], ["added_volume"])
    assert term("pressure_ci95_cm", DISK).name.startswith("band") and term("added_volume_ci95_ml", DISK).name.startswith("band")


@pytest.mark.campaign
def test_of_shares_of_a_weight_and_of_forces():
    """A beam has no pressure: the band of its rise is that at the same share, or at the same force beside its weight."""
    beam = sm.Beam(length=0.03, width=0.01, thickness=0.005, cell_size=0.005)
    weight, pull = sm.Gravity("-z"), sm.Force("tip", "z")
    for components, asked in (((weight,), {"share": (0.5,)}), ((weight, pull), {"force_N": (0.005,)})):
        case = Case("beam", beam, law(), components=components, steps=steps_of(**asked), band=ERRORS)
        expected = half(slopes(lambda other, case=case: sm.run(
            dataclasses.replace(case, material=other, band=None)).rows[-1]["tip_mm"]))  # fmt: skip
        row = sm.run(case).rows[-1]
        assert row["tip_ci95_mm"] == pytest.approx(expected, rel=2e-3) and "pressure_ci95_cm" not in row


@pytest.mark.campaign
def test_of_a_force_on_an_inflated_device():
    """Its pressure is kept beside the force."""
    membrane = sm.Membrane(cell_size=0.002, through=2)
    asked = steps_of(force_N=(0.05,), at_pressure_cm=8.0)
    case = Case("push", membrane, law(), components=(sm.Force("top", "-z"),), steps=asked, band=ERRORS)
    expected = half(slopes(lambda other: sm.run(
        dataclasses.replace(case, material=other, band=None)).rows[-1]["apex_mm"]))  # fmt: skip
    assert sm.run(case).rows[-1]["apex_ci95_mm"] == pytest.approx(expected, rel=2e-3)
    with pytest.raises(CaseError, match="bands are available only for"):
        dataclasses.replace(case, steps=steps_of(travel_mm=(1.0,)))


@pytest.mark.campaign
def test_at_the_same_rise(heavy_run):
    """Sideways in the picture; under a weight far from the band at the same volume: the same height is another shape then."""
    row = next(row for row in heavy_run.rows if row["requested"] and row["pressure_cm"] == 20.0)

    def pressure(other):
        return heavy(other, "17,23 cm").where("apex_mm", row["apex_mm"]).row["pressure_cm"]

    assert row["pressure_at_apex_ci95_cm"] == pytest.approx(half(slopes(pressure)), rel=1e-3)
    assert row["pressure_at_apex_ci95_cm"] < 0.7 * row["pressure_ci95_cm"]
    limit = next(row for row in heavy_run.rows if row["limit"])
    assert limit["pressure_at_apex_ci95_cm"] == pytest.approx(limit["pressure_ci95_cm"], rel=1e-6)
    assert "same rise of the apex" in term("pressure_at_apex_ci95_cm", DISK).text
    axes = heavy_run.plot().axes[0]
    (area,) = [one for one in axes.collections if one.get_label() == "95 % band of the pressure at equal rise"]
    at = area.get_paths()[0].vertices
    sideways = at[np.abs(at[:, 1] - row["apex_mm"]) < 0.02 * row["apex_mm"], 0]
    assert np.ptp(sideways) == pytest.approx(2 * row["pressure_at_apex_ci95_cm"], rel=0.4)


# -- the sources of a silicone ------------------------------------------------------------------------------------------

ECOFLEX = "ecoflex-00-30"
SHADOW = sm.HollowDisk.variant("shadow", section="axisymmetric", support="base")


@pytest.fixture(scope="module")
def spanned():
    return sm.inflate(SHADOW, sm.silicone(ECOFLEX), "0,20,31 cm", band=ECOFLEX)


@pytest.mark.campaign
def test_a_silicones_band_has_a_path_for_each_source(spanned):
    names = [f"{ECOFLEX}/marechal-2021", f"{ECOFLEX}/sorotoki", ECOFLEX, f"{ECOFLEX}/smooth-on"]
    assert list(spanned.sources) == names
    for name in names:
        alone = sm.inflate(SHADOW, sm.silicone(name), "0,20,31 cm")
        assert [row["apex_mm"] for row in spanned.sources[name]] == pytest.approx(
            [row["apex_mm"] for row in alone.rows], rel=1e-9
        )
    plain = sm.inflate(SHADOW, sm.silicone(ECOFLEX), "0,20,31 cm")
    assert plain.rows == spanned.rows and not plain.sources


def test_what_the_sources_span_is_told_and_drawn(spanned):
    """At the last pressure that all of them reach; the softest ends at its limit point before the others."""
    (note,) = [note for note in spanned.notes if note.startswith(f"over the 4 sources of {ECOFLEX}")]
    rises = [next(row["apex_mm"] for row in rows if row["pressure_cm"] == 20.0) for rows in spanned.sources.values()]
    assert f"at 20 cm, 0.97 g/ml the apex rises {min(rises):.4g} mm (smooth-on) to {max(rises):.4g} mm (marechal-2021)" in note
    (limit,) = [row for row in spanned.sources[f"{ECOFLEX}/marechal-2021"] if row["limit"]]
    assert f"the limit point lies at {limit['pressure_cm']:.4g} cm (marechal-2021) (none met with" in note
    axes = spanned.plot().axes[0]
    labels = axes.get_legend_handles_labels()[1]
    assert {f"band of the 4 sources of {ECOFLEX}", "marechal-2021", "sorotoki", "smooth-on"} <= set(labels)
    assert "liao-2021" not in labels  # the run's own path
    for area, a, b in zip(axes.patches, rises, rises[1:], strict=False):
        assert area.get_path().contains_point((20.0, (a + b) / 2))
    assert len(axes.patches) == 3


@pytest.mark.campaign
def test_sources_are_kept_in_a_folder(spanned, tmp_path):
    spanned.save(tmp_path / "run")
    again = sm.load(tmp_path / "run")
    assert again.case == spanned.case and again.notes == spanned.notes
    assert again.sources == spanned.sources
    solved = sm.inflate(SHADOW, sm.silicone(ECOFLEX), "0,20 cm", band=ECOFLEX, folder=tmp_path / "solved")
    assert list(solved.sources) == list(spanned.sources) and (tmp_path / "solved" / "sources.csv").is_file()
    sm.inflate(SHADOW, sm.silicone(ECOFLEX), "0,20 cm", folder=tmp_path / "solved")
    assert not (tmp_path / "solved" / "sources.csv").exists()


def test_bands_of_sources_that_cannot_be():
    case = Case("disk", DISK, sm.silicone(f"{ECOFLEX}/sorotoki"), steps=steps_of(pressure_cm=(10.0,)), band=SourceBand(ECOFLEX))
    assert Case.from_toml(case.to_toml()) == case and "silicone" in case.to_toml()
    with pytest.raises(CaseError, match="the case's material is none of them"):
        dataclasses.replace(case, material=law())
    with pytest.raises(sm.MaterialError, match="mold-star-20t has only one source"):
        band_of("mold-star-20t")
    assert band_of(f"{ECOFLEX}/liao-2021") == SourceBand(ECOFLEX)
