"""The command ``silicones`` and what runs of named silicones say of their spread."""

from __future__ import annotations

import csv
import functools
import json

import pytest

from softmodels.__main__ import softmodels as whole_command
from softmodels.materials.silicones import PRODUCTS, SILICONES
from tests.support import runs


@pytest.fixture
def says(ended):
    return functools.partial(ended, whole_command)


def test_all_are_listed_with_units(says):
    status, out, _ = says("silicones")
    assert status == 0
    for product, many in PRODUCTS.items():
        for one in many:
            full = f"{product}/{one.origin.key} "
            (line,) = [line for line in out.splitlines() if line[2:].startswith(full)]
            assert line.startswith("*") == (one is SILICONES[product])
            assert f"{one.material.shear_modulus_0 / 1e3:.4g} kPa" in line


def test_one_product_with_its_origins(says):
    status, out, _ = says("silicones", "ecoflex-00-30")
    assert status == 0 and "ecoflex-00-10" not in out
    for words in (
        "10.1089/soro.2019.0115",
        "10.1016/j.ijmecsci.2021.106624",
        "450 mm/min",
        "first cycle",
        "factor of 2.5",
    ):
        assert words in out


def test_an_unknown_one_is_refused(says):
    status, out, complaint = says("silicones", "butter")
    assert (status, out) == (2, "") and "'butter' is not a silicone" in complaint


def test_a_run_says_how_far_laboratories_differ(tmp_path):
    """In the closing line, in the report and in summary.json; and another source by name gives other numbers."""
    rises = {}
    for name in ("ecoflex-00-30", "ecoflex-00-30/marechal-2021"):
        folder = tmp_path / name.replace("/", "-")
        done = runs.run("-m", "softmodels.disk", "--pressure-cm", "0:20", "--section", "axisymmetric", "--material", name,
                        "--no-pictures", "--output", folder)  # fmt: skip
        assert done.status == 0, done.err
        notes = json.loads((folder / "summary.json").read_text())["notes"]
        (note,) = [note for note in notes if "published sources disagree" in note]
        assert "liao-2021 28" in note and note in done.out + done.err
        assert ("the median of 4" in note) == (name == "ecoflex-00-30")
        *_, last = csv.DictReader((folder / "path.csv").open())
        assert float(last["break_margin"]) == pytest.approx(10.0 / float(last["max_stretch"]))  # the maker's, the least
        rises[name] = float(last["apex_mm"])
    assert rises["ecoflex-00-30"] < rises["ecoflex-00-30/marechal-2021"]
