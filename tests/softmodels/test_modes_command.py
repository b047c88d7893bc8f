"""``softmodels modes`` and `sm.modes`: a table of frequencies, pictures, exit statuses and what is refused."""

from __future__ import annotations

import csv
import re

import numpy as np
import pytest

import softmodels as sm
from softmodels.__main__ import softmodels
from softmodels.case.load import steps_of
from tests.support import runs

DISK = sm.HollowDisk.variant("shadow", section="axisymmetric", cell_size=6e-3, refinement=1.0)
WORDS = (
    "--device",
    "HollowDisk",
    "--variant",
    "shadow",
    "--section",
    "axisymmetric",
    "--cell-size",
    "6mm",
    "--refinement",
    "1",
)
LAW = sm.NeoHookean(20e3, 0.49)
BEAM = sm.Beam(length=0.03, width=0.006, thickness=0.006, cell_size=0.003)


def rows_of(folder):
    with (folder / "modes.csv").open() as file:
        return [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]


def test_a_table_and_pictures_as_python_has_them(tmp_path):
    law = ("--shear-modulus", "20kPa", "--poisson", "0.49", "--material", "neo-hookean")
    done = runs.run("-m", "softmodels", "modes", *WORDS, *law, "--pressure-cm", "0:10:5", "--count", "3", "-o", tmp_path)
    assert done.status == 0 and done.err == ""
    found, rows = sm.modes(DISK, LAW, "0:10:5 cm", count=3), rows_of(tmp_path)
    assert [row["pressure_cm"] for row in rows if row["requested"]] == pytest.approx([0.0, 5.0, 10.0])
    written = np.array([[row[f"f{k}_Hz"] for k in (1, 2, 3)] for row in rows])
    assert written == pytest.approx(found.frequency, rel=1e-6) and "f4_Hz" not in rows[0]
    assert [row["pressure_Pa"] for row in rows] == pytest.approx(found.pressure)
    assert f"no pressure: {found.frequency[0, 0]:.4g}, " in done.out and "--angle 360deg" in done.out
    assert {file.name for file in tmp_path.iterdir()} >= {"modes.csv", "frequencies.png", "shapes.png"}
    assert found.displacement.shape == (len(rows), *found.points.shape) and found.modes[0][0].stable
    assert not found.frequency.flags.writeable


def test_the_damping_of_a_memory_is_printed_and_stored(tmp_path):
    law = LAW.with_memory(branches=[(0.2, "5 ms")])
    (tmp_path / "disk.toml").write_text(sm.Case("disk", DISK, law, steps_of(pressure_cm=(5.0,))).to_toml())
    done = runs.run(
        "-m", "softmodels", "modes", tmp_path / "disk.toml", "--count", "1", "-o", tmp_path / "out", "--no-pictures"
    )
    relaxed, row = sm.modes(DISK, LAW, "5 cm", count=1).frequency[-1, 0], rows_of(tmp_path / "out")[-1]
    assert done.status == 0 and f"{row['f1_Hz']:.4g} Hz, damping ratio {row['damping1']:.3g}\n" in done.out
    assert relaxed < row["f1_Hz"] < 1.2**0.5 * relaxed and 0.01 < row["damping1"] < 0.1
    assert "stiffen and damp" in done.out and "no damping" not in done.out


def test_a_path_that_ends_says_what_is_unstable(tmp_path):
    where = ("--output", tmp_path, "--no-pictures")
    done = runs.run("-m", "softmodels", "modes", *WORDS, "--shear-modulus", "20kPa", "--pressure-cm", "0:60", *where)
    assert done.status == 3 and "limit point" in done.err
    assert re.search(r"^unstable at \S+ Pa and \S+ ml: 1 of the modes have no frequency", done.out, re.MULTILINE)
    assert np.isnan(rows_of(tmp_path)[-1]["f1_Hz"]) and not (tmp_path / "shapes.png").exists()
    closed = sm.modes(DISK, sm.NeoHookean(20e3), "0:60 cm", sealed=True, count=1)
    assert closed.ended.status == 3 and np.isfinite(closed.frequency).all() and not closed.unstable


@pytest.mark.campaign
def test_a_solid_is_drawn_and_a_case_file_read(tmp_path):
    case = sm.Case("beam", BEAM, LAW, components=sm.Gravity("-z"), steps=steps_of(share=(1.0,)))
    (tmp_path / "beam.toml").write_text(case.to_toml())
    refused = runs.run("-m", "softmodels", "modes", tmp_path / "beam.toml", "-o", tmp_path / "out")
    assert refused.status == 2 and "give the pressures" in refused.err
    words = ("--device", "Beam", "--length", "30mm", "--width", "6mm", "--thickness", "6mm", "--cell-size", "3mm")
    done = runs.run("-m", "softmodels", "modes", *words, "--gravity", "-z", "--quiet", "-o", tmp_path / "out")
    assert done.status == 0 and done.out == "" and done.err == ""
    assert (tmp_path / "out" / "shapes.png").stat().st_size > 10_000 and len(rows_of(tmp_path / "out")) == 1


def test_a_case_at_rest(ended, tmp_path):
    """A file without a load, with a pressure of 0, or with another load and --pressure-cm 0: the same frequencies."""
    case = sm.Case("disk", DISK, LAW, steps_of(pressure_cm=(10.0,))).to_toml()
    rest = sm.modes(DISK, LAW, 0.0, count=1).frequency[0, 0]
    assert sm.modes(DISK, LAW, "0 cm", count=1).frequency[0, 0] == rest
    start, end = case.index("[load]"), case.index("[solver]")
    shares = '[gravity]\ndirection = "-z"\nmagnitude = "0.001 m/s^2"\n[load]\nshare = 1.0\n\n'
    files = {"none": "", "zero": "[load]\npressure_cm = 0\n\n", "share": shares}
    for name, load in files.items():
        (tmp_path / f"{name}.toml").write_text(case[:start] + load + case[end:])
    for name, words in (("none", ()), ("zero", ()), ("share", ("--pressure-cm", "0"))):
        status, out, err = ended(
            softmodels,
            "modes",
            tmp_path / f"{name}.toml",
            *words,
            "--count",
            "1",
            "--no-pictures",
            "-o",
            tmp_path / name,
        )
        assert (status, err) == (0, "") and out.startswith("no pressure: "), name
        assert rows_of(tmp_path / name)[0]["f1_Hz"] == pytest.approx(rest, rel=1e-4), name
    status, _, err = ended(softmodels, "modes", tmp_path / "share.toml", "-o", tmp_path / "out")
    assert status == 2 and "or 0 for the state at rest (--pressure-cm 0)" in err


@pytest.mark.campaign
def test_a_mass_on_an_edge_swings_with_the_device():
    """As one on the whole face of the tip, whose middle is as far from the clamp."""
    edge, face = (
        sm.modes(BEAM, LAW, components=[sm.Gravity("-z"), sm.Mass(where, 1e-3)], count=1).frequency[0, 0]
        for where in ("edge of tip and top", "tip")
    )
    assert edge == pytest.approx(face, rel=0.05) and edge != face
    assert face < 0.7 * sm.modes(BEAM, LAW, components=sm.Gravity("-z"), count=1).frequency[0, 0]


def test_a_memory_is_relaxed_or_not_by_the_frequency():
    """A branch that is far quicker than the vibration adds nothing, and one that is far slower all of its modulus."""
    shear, bulk = 1.5 * LAW.shear_modulus, LAW.bulk + 2.0 / 3.0 * LAW.shear_modulus
    stiffer = sm.NeoHookean(shear, (3.0 * bulk - 2.0 * shear) / (6.0 * bulk + 2.0 * shear))
    for time, law in ((1e-9, LAW), (1e6, stiffer)):
        found, elastic = (sm.modes(DISK, one, count=2) for one in (LAW.with_memory(branches=[(0.5, time)]), law))
        # Mixed elements do not project the strain of the shear part, of which the stiffer law has more.
        assert found.frequency == pytest.approx(elastic.frequency, rel=1.5e-3) and (found.damping < 1e-5).all()
        assert any("stiffen and damp" in note for note in found.notes)
    assert not sm.modes(DISK, LAW, count=2).damping.any()


@pytest.mark.parametrize(
    ("device", "asked", "words"),
    [
        (DISK, {"count": 0}, "count is 0; it must be a whole number of modes from 1 to 20"),
        (BEAM, {"sealed": True}, "Beam has no cavity to be sealed; leave out sealed=True"),
        (BEAM, {"pressures": "1 kPa"}, "Beam has no cavity for a pressure"),
    ],
)
def test_what_is_refused(device, asked, words):
    with pytest.raises(sm.CaseError, match=re.escape(words)):
        sm.modes(device, LAW, **asked)
