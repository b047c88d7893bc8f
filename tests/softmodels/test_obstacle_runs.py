"""A plate over the disk, from the command line to the table, and what makes no contact."""

from __future__ import annotations

import pytest

from tests.support import runs

PLATE = ("--support", "base", "--contact", "top", "--contact-plane", "z = 17mm")


def test_a_plate_stops_the_disk_and_its_force_is_in_the_table(tmp_path):
    done = runs.disk(tmp_path / "a", *PLATE, "--pressure-cm", "0:177:59", "--quiet")
    assert done.status == 0 and done.err == "", done.err
    rows = runs.rows(tmp_path / "a")
    assert rows[0]["contact_force_N"] == 0.0 and rows[0]["contact_depth_mm"] == 0.0
    last = rows[-1]
    assert last["apex_mm"] == pytest.approx(1.0 + last["contact_depth_mm"], rel=0.02)
    assert 0.0 < last["contact_depth_mm"] < 0.1 and 0.5 < last["contact_force_N"] < 20.0
    assert all(row["contact_force_N"] == 0.0 for row in rows if row["apex_mm"] < 1.0)
    again = runs.run("-m", "softmodels", "run", tmp_path / "a" / "case.toml", "--output", tmp_path / "b", "--quiet",
                     "--no-pictures")  # fmt: skip
    assert again.status == 0
    runs.same(runs.rows(tmp_path / "a"), runs.rows(tmp_path / "b"), runs.REPEATED)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--contact", "top"), "--contact-plane"),
        (("--contact", "top", "--contact-plane", "z = 17"), "'17' has no unit"),
        (("--contact", "top", "--contact-plane", "x = 17mm"), "perpendicular to its axis"),
        (("--contact", "lid", "--contact-plane", "z = 17mm"), "no face 'lid'"),
        (("--contact", "outer", "--contact-plane", "z = 9mm"), "both sides"),
        (("--contact", "top", "--contact-plane", "z = 17mm", "--contact-stiffness", "0"), "shear moduli per size"),
    ],
)
def test_what_makes_no_contact_is_a_sentence_and_status_2(words, told, tmp_path):
    done = runs.disk(tmp_path / "disk", "--pressure-cm", "0:10", "--quiet", *words)
    assert done.status == 2 and done.out == "" and done.err.count("\n") == 1 and told in done.err
