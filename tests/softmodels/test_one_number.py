"""One definition and one number for each maximum, wherever it is read; jumps, forces and lengths as people read them."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest

from geometries import HollowDisk, registry as geometry_table
from softmodels.case.case import Case
from softmodels.case.load import steps_of
from softmodels.case.materials import DEFAULT
from softmodels.common.units import exact_text, quantity, readable
from softmodels.components.loads import Force
from softmodels.components.rigid import Rigid
from softmodels.pictures import curves, offscreen, report, solid
from softmodels.pictures.offscreen import look
from softmodels.pictures.style import Pixels
from softmodels.runs.columns import every_variable, term
from softmodels.runs.labels import StateLabels, headline, overlap_of, state_labels
from softmodels.runs.notes import events, gained, jumps_text, pressed, risen, unlocated
from softmodels.runs.states import FolderStates
from softmodels.runs.table import PathTable, Row
from tests.support import runs

CYCLE = (
    "--variant",
    "shadow",
    "--material",
    "yeoh",
    "--c1",
    "10kPa",
    "--c2",
    "20Pa",
    "--c3",
    "3Pa",
    "--poisson",
    "0.495",
)
"""A law that stiffens late, under which the thin disk jumps out once and back twice."""


@pytest.fixture(scope="module")
def inflated(tmp_path_factory):
    """A run whose nodal stresses and stretches pass those at the integration points, and what it said."""
    folder = tmp_path_factory.mktemp("inflated") / "disk"
    return folder, runs.disk(folder, "--pressure-cm", "0,70,177")


@pytest.fixture(scope="module")
def cycled(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cycled") / "disk"
    return folder, runs.disk(folder, "--pressure-cm", "0,20,36", "--load-unload", *CYCLE)


def texts(figure):
    """All words of a figure."""
    return " ".join(text.get_text() for text in [*figure.texts, *(t for axes in figure.axes for t in [axes.title])])


def test_the_largest_stress_and_stretch_are_the_same_everywhere(inflated):
    folder, done = inflated
    row = runs.rows(folder)[-1]
    stress, stretch = f"{row['max_von_mises_kPa']:.4g}", f"{row['max_stretch']:.4g}"
    states = FolderStates(folder, "disk")
    nodal = states.field(states.main, "von_mises").max() / 1e3
    assert f"{nodal:.4g}" != stress  # or this shows nothing
    assert f"stretch {stretch} and von Mises stress {stress} kPa (at integration points)" in done.out
    assert f"the largest stretch is {stretch}" in report.Report(look(states), folder, "disk").write().read_text()
    seen = look(states)
    scale = seen.scales["von_mises"]
    drawn = solid.section_stress(seen, states.main)
    assert f"largest, at an integration point: {stress} kPa" in texts(drawn)
    assert any(artist._image is scale.foot[1] for artist in drawn.artists if isinstance(artist, Pixels))
    assert f"largest stretch {stretch} at 177 cm, 0.97 g/ml; at" in offscreen.hot_spot(states, states.main).note


def test_a_picture_has_the_largest_value_of_its_own_state(inflated):
    """One colour scale for all, and below it the largest value of the shown states, of the sheet's of all that it shows."""
    folder, _ = inflated
    rows, seen = runs.rows(folder), look(FolderStates(folder, "disk"))
    lower = next(k for k, row in enumerate(rows) if row["pressure_cm"] == 70.0)
    scale = seen.scales["von_mises"]
    for step, row in ((lower, rows[lower]), (len(rows) - 1, rows[-1])):
        words = f"integration point: {row['max_von_mises_kPa']:.4g} kPa"
        assert words in texts(solid.section_stress(seen, step)) and words in seen.caption(step, None, scale).largest
    between = seen.states.row(lower - 0.5).shown("max_von_mises")
    assert f"integration point: {between:.4g} kPa" in seen.caption(lower - 0.5, None, scale).largest
    assert f"integration point: {rows[-1]['max_von_mises_kPa']:.4g} kPa" in texts(solid.section_sheet(seen))


def test_centimetres_name_their_liquid(inflated, tmp_path):
    """0.97 g/ml of the thesis unless another is given: on the command line, in titles, at axes, in the report's menu."""
    folder, done = inflated
    assert "177 cm, 0.97 g/ml (16.837 kPa): apex" in done.out
    states = FolderStates(folder, "disk")
    assert curves.rise_of(states).axes[0].get_xlabel() == "pressure in cm, 0.97 g/ml"
    page = report.Report(look(states), folder, "disk").write().read_text()
    assert '<option value="cm" selected>cm, 0.97 g/ml</option>' in page and "At 177 cm, 0.97 g/ml (16.8 kPa) the apex" in page
    water = dataclasses.replace(states.case, water_density=998.2)
    row = Row({"pressure_cm": 10.0, "pressure_Pa": 978.9, "apex_mm": 1.0})
    assert headline(row, state_labels(water)) == "10 cm, 0.9982 g/ml (0.979 kPa), apex rise 1.00 mm"
    assert curves.over_of(water) == ("pressure", "pressure in cm, 0.9982 g/ml")
    limits = runs.run("-m", "softmodels", "limit", "--variant", "shadow", "--cell-size", "6mm", "--refinement", "1",
                      "--water-density", "1000kg/m^3")  # fmt: skip
    assert re.search(r"limit pressure \d+\.\d+ cm, 1 g/ml \(", limits.out), limits.err


def test_columns_are_described_by_their_own_names():
    """Not by a pattern that a part's columns have: the least gap is not the gap between walls named least."""
    for variable in every_variable():
        if variable.name.isidentifier() and variable.title:
            assert term(variable.key, None, "{supply}").name == variable.title, variable.key
    loaded = Case(
        "disk",
        HollowDisk(),
        DEFAULT,
        steps_of(pressure_cm=(1.0,)),
        components=(Rigid("top", name="force_lid"), Force("top", "-z", 2.0, name="tip")),
    )
    row = Row({"force_lid_force_N": 3.0, "force_tip_N": 2.0, "pressure_cm": 1.0})
    assert state_labels(loaded).loads_words(row) == ["force tip 2 N"]


def test_without_walls_near_each_other_no_gap_is_told(inflated):
    """Nor the distance within which they are searched: the cavity of the open disk is farther away than that."""
    folder, _ = inflated
    rows = runs.rows(folder)
    assert rows[0]["least_gap_mm"] is rows[-1]["least_gap_mm"] is None
    states = FolderStates(folder, "disk")
    assert "gap between" not in report.Report(look(states), folder, "disk").write().read_text()
    assert overlap_of(states.rows[-1]) == 0.0 and overlap_of(Row({"least_gap_mm": -0.5})) == 0.5e-3


@pytest.mark.campaign
def test_a_cycle_tells_its_jumps(cycled):
    folder, done = cycled
    assert done.status == 0, done.err
    rows = runs.rows(folder)
    landed = [k for k, row in enumerate(rows) if row["jump"]]
    assert len(landed) == 3 and done.out.count("it inflates") == 1 and done.out.count("it collapses") == 2
    for k in landed:
        before, after = rows[k - 1], rows[k]
        assert f"at {before['pressure_cm']:.4g} cm it" in done.out
        assert f"apex rise {before['apex_mm']:.4g} to {after['apex_mm']:.4g} mm" in done.out
    path = PathTable.read(rows)
    jumps = [event for event in events(path, StateLabels("apex")) if event["kind"] == "jump"]
    assert [jump["way"] for jump in jumps] == ["inflates", "collapses", "collapses"]
    assert [jump["from_apex_mm"] for jump in jumps] == [rows[k - 1]["apex_mm"] for k in landed]
    # Limit points that it comes to from the other side are no bifurcations.
    assert unlocated(path, StateLabels("apex")) == "" and "could not be located" not in done.out


def test_what_sinks_is_said_to_sink():
    assert (risen(-8.6946e-3), risen(0.0), gained(-4.0041e-6), gained(6.5e-6)) == (
        "sunk 8.695 mm", "risen 0 mm", "lost 4.004 ml", "gained 6.5 ml"
    )  # fmt: skip


def test_a_syringes_jump_starts_where_its_gas_still_held():
    keys = ("pressure_cm", "added_volume_ml", "apex_mm", "stable_under_supply", "jump", "stroke_limit")
    table = ((20, 5, 4, 1, 0, 0), (21, 6, 5, 1, 0, 1), (19, 9, 8, 0, 0, 0), (15, 20, 16, 1, 1, 0))
    rows = PathTable.read(dict(zip(keys, row, strict=True)) for row in table)
    assert jumps_text(rows, StateLabels("apex")) == (
        "snap-through: at 21 cm to 15 cm it inflates, apex rise 5 to 16 mm, added volume 6 to 20 ml"
    )


def test_a_snap_that_hardly_moves_the_device_is_that_of_a_part():
    keys = ("pressure_cm", "added_volume_ml", "apex_mm", "jump")
    table = ((0, 0, 0, 0), (-8, -9, -4, 0), (-8.1, -9.1, -4, 1))
    rows = PathTable.read(dict(zip(keys, row, strict=True)) for row in table)
    assert jumps_text(rows, StateLabels("apex")).startswith("snap-through: at -8 cm to -8.1 cm it snaps in a part, apex")


@pytest.mark.campaign
def test_profiles_of_a_cycle_are_labelled_by_their_part_of_the_path(cycled):
    rows = runs.rows(cycled[0])
    places = curves.branches(PathTable.read(rows), StateLabels("apex"))
    landed = [k for k, row in enumerate(rows) if row["jump"]]
    asked = [(row["pressure_cm"], place) for row, place in zip(rows, places, strict=True) if row["requested"]]
    jumped = "after snap-through"
    assert asked == [(0, "up"), (20, "up"), (36, f"up, {jumped}"), (36, f"down, {jumped}"), (20, "down"), (0, "down")]
    assert all(place == "down" for place in places[landed[-1] :])
    assert not any("past the limit point" in place for place in places)


def test_a_path_by_volume_is_past_the_limit_until_it_is_stable_again():
    stable, limit = (1, 1, 1, 0, 0, 0, 1), (0, 0, 1, 0, 0, 1, 0)
    rows = PathTable.read(
        {"pressure_Pa": p, "added_volume_ml": k, "limit": limit[k], "stable_under_pressure": stable[k]}
        for k, p in enumerate((0, 5, 6, 5, 4, 3, 4))
    )
    words = ["", "", "limit point", "past the limit point", "past the limit point", "limit point", "stable again"]
    assert curves.branches(rows, StateLabels("apex")) == words


def test_forces_are_in_the_closing_line():
    assert pressed(Row({"blocked_force_N": 0.123456})) == ", blocked force 0.1235 N"
    assert pressed(Row({"contact_force_N": 3.07765})) == ", contact force 3.078 N"
    assert pressed(Row({"pressure_cm": 3.0})) == ""


def test_lengths_are_written_as_people_write_them():
    rng = np.random.default_rng(11)
    for value in [*rng.integers(1, 9999, 300) / 10.0, 0.7, 0.9, 0.3, 12.3, 2.675]:
        metres = quantity(f"{value}mm", "m")
        assert readable(metres, "m") == f"{value:g} mm"
        text = exact_text(metres, "m")
        assert quantity(text, "m") == metres
    assert readable(0.0009, "m") == "0.9 mm" and exact_text(quantity("0.7mm", "m"), "m") == "0.7 mm"
    assert readable(quantity("20ml", "m^3"), "m^3") == "20 ml" and readable(14e3, "Pa") == "14 kPa"
    # What is read back by a machine keeps every bit; what people read does not show the rounding.
    disk = HollowDisk(membrane=0.0009, cell_size=0.0009)
    told = geometry_table.to_table(disk, readable)
    assert told["membrane"] == "0.9 mm" and geometry_table.from_table(geometry_table.to_table(disk)) == disk
