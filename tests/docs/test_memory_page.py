"""The commands of the page on the memory of a silicone are run, from the tests to the loop of a device."""

from __future__ import annotations

import csv
import itertools
import shlex
import tomllib
from pathlib import Path

import pytest

from softmodels.case.materials import material_from
from softmodels.cli import examples
from tests.support import example_files, pages
from tests.support.forks import forks

pytestmark = pytest.mark.campaign

PAGE = Path(__file__).parents[2] / "docs" / "pages" / "howto" / "fit-memory.md"


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """The folder in which all commands have run, each once."""
    folder = tmp_path_factory.mktemp("page")
    examples.write_examples(folder / "examples")
    with forks() as run:
        for line in dict.fromkeys(pages.pasted(PAGE)):
            words = shlex.split(line)
            assert words[:2] == ["uv", "run"]
            if words[2:] != ["softmodels", "examples"]:
                words = [name for word in words for name in (sorted(map(str, folder.glob(word))) if "*" in word else [word])]
                ended = run(words[3:] if words[2] == "python" else ["-m", *words[2:]], folder)
                assert ended.status == 0, ended.err
    return folder


def test_the_fit_finds_the_silicone_of_the_examples(done):
    memory = material_from(str(done / "results" / "memory" / "fitted.toml"), {}).memory
    assert [branch.time for branch in memory.branches] == [time for _, time in example_files.BRANCHES]
    assert [branch.share for branch in memory.branches] == pytest.approx([s for s, _ in example_files.BRANCHES], abs=5e-3)
    soft = memory.softening
    assert (soft.r, soft.m, soft.beta) == pytest.approx(example_files.SOFTENING_NUMBERS, rel=0.05)


def test_photographs_show_how_the_disk_creeps(done):
    memory = material_from(str(done / "results" / "held" / "fitted.toml"), {}).memory
    assert [branch.time for branch in memory.branches] == [10.0, 100.0]
    assert [branch.share for branch in memory.branches] == pytest.approx(list(example_files.HELD.values()), abs=2e-3)
    fitted = tomllib.loads((done / "results" / "held" / "fitted.toml").read_text())["fit"]
    for name, value in (examples.TRUTH.values | example_files.HELD).items():
        low, high = fitted["intervals_95"].get(name, (value, value))
        assert low <= value <= high, name
    assert (done / "results" / "held" / "creep-yeoh.png").stat().st_size > 10_000


def test_the_second_loop_of_the_device_is_smaller(done):
    folder = done / "results" / "loop"
    with (folder / "path.csv").open() as file:
        rows = [{key: float(row[key]) for key in ("time_s", "pressure_Pa", "added_volume_ml")} for row in csv.DictReader(file)]
    middle = rows[-1]["time_s"] / 2
    work = [0.0, 0.0]
    for a, b in itertools.pairwise(rows):
        mean = (a["pressure_Pa"] + b["pressure_Pa"]) / 2
        work[a["time_s"] > middle - 1e-6] += mean * (b["added_volume_ml"] - a["added_volume_ml"])
    assert 0.0 < work[1] < 0.8 * work[0]
    assert (folder / "loop.png").stat().st_size > 10_000


def test_the_test_that_was_left_out_is_predicted(done):
    with (done / "results" / "score" / "scores.csv").open() as file:
        (row,) = csv.DictReader(file)
    assert float(row["chi2_per_value"]) < 1.0 and row["data"].startswith("fast.csv")
