"""The commands of the page on the memory of a silicone are run, from the tests to the loop of a device."""

from __future__ import annotations

import csv
import itertools
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from softmodels.case.materials import material_from
from softmodels.cli import examples

PAGE = Path(__file__).parents[2] / "docs" / "pages" / "howto" / "fit-memory.md"


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """The folder in which all commands have run, each once; of the examples only those that they read."""
    folder = tmp_path_factory.mktemp("page")
    (folder / "examples").mkdir()
    for seed, name in enumerate(("cycles", "hold", "fast"), 31):
        (folder / "examples" / f"{name}.csv").write_text(examples.memory_curve(getattr(examples, name.upper()), seed))
    blocks = re.findall(r"^```sh\n(.*?)^```", PAGE.read_text(), re.DOTALL | re.MULTILINE)
    lines = dict.fromkeys(line for block in blocks for line in block.splitlines())
    for line in lines:
        words = shlex.split(line)
        assert words[:2] == ["uv", "run"]
        if words[2:] != ["softmodels", "examples"]:
            command = [sys.executable, *(words[3:] if words[2] == "python" else ["-m", *words[2:]])]
            ended = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
            assert ended.returncode == 0, ended.stderr
    return folder


def test_the_fit_finds_the_silicone_of_the_examples(done):
    memory = material_from(str(done / "results" / "memory" / "fitted.toml"), {}).memory
    assert [branch.time for branch in memory.branches] == [time for _, time in examples.BRANCHES]
    assert [branch.share for branch in memory.branches] == pytest.approx([s for s, _ in examples.BRANCHES], abs=5e-3)
    soft = memory.softening
    assert (soft.r, soft.m, soft.beta) == pytest.approx(examples.SOFTENED, rel=0.05)


def test_the_second_loop_of_the_device_is_smaller(done):
    folder = done / "results" / "loop"
    with (folder / "path.csv").open() as file:
        rows = [
            {key: float(row[key]) for key in ("time_s", "pressure_Pa", "added_volume_ml")}
            for row in csv.DictReader(file)
        ]
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
