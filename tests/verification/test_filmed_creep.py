"""A film of a simulated finger that creeps, rendered frame by frame, goes through the three commands that a user types: the
shares of its silicone's branches, its modulus and the offset between the clocks come out. Shares no code with the reader."""

from __future__ import annotations

import csv
import json
import re

import numpy as np
import pytest
from click.testing import CliRunner

import softmodels as sm
from geometries import BendingBellows
from measurement.cli.setup import setup as setup_command
from measurement.cli.views import view as view_command
from softmodels.case.case import case_of
from softmodels.cli.material_commands import fit_material
from softmodels.pictures.offscreen import can_render
from tests.support import films, side_views

FINGER = BendingBellows(folds=1, cap=0.006, cell_size=0.008)
BRANCHES = [(0.2, 1.0), (0.15, 10.0)]
SHEAR_MODULUS = 20e3
PROGRAM = films.Program((0.0, 2000.0, 3200.0), (0.0, 3.2, 15.2), 0.4, 28.0)
OFFSET, FRAME = 41.237, 0.25
SIZE, PIXEL, CENTRE = (480, 360), 7e-5, np.array([0.008, 0.002])


def rendered_film(path, states, times):
    """Write a film in MP4 of states at times in s: between two of them, which are less than a pixel apart, their pictures are
    mixed."""
    side = {"pixel": PIXEL, "centre": CENTRE, "size": SIZE}
    clamp = side_views.pv.Box((-0.02, 0.0, -FINGER.crest, FINGER.crest, -FINGER.base / 2, FINGER.crest + FINGER.base / 2))
    lights = []
    for state in states:
        half = state.grid.warp_by_vector("displacement").extract_surface(nonlinear_subdivision=2, algorithm="dataset_surface")
        half.clear_data()
        lights.append(side_views.rendered(half, half.reflect((0, 1, 0)), clamp, **side))
    moments = np.arange(0.0, PROGRAM.until, FRAME)
    places = np.interp(moments, times, np.arange(len(times)))
    before = np.minimum(places.astype(int), len(times) - 2)
    mixed = ((1 - by) * lights[k] + by * lights[k + 1] for k, by in zip(before, places - before, strict=True))
    films.write(path, (side_views.stored(light, number, 2.0) for number, light in enumerate(mixed)), 1.0 / FRAME)


@pytest.mark.campaign
@pytest.mark.skipif(not can_render(), reason="no rendering off screen")
def test_a_film_of_a_finger_gives_its_memory_back_to_three_commands(tmp_path, monkeypatch, figure):
    monkeypatch.chdir(tmp_path)
    begin = PROGRAM.begins[1]
    corners = [time - begin for level in (1, 2) for time in PROGRAM.plateaus[level]]
    silicone = sm.NeoHookean(SHEAR_MODULUS).with_memory(branches=BRANCHES)
    pressures = [f"{level} Pa" for level in PROGRAM.levels[1:] for _ in range(2)]
    run = sm.inflate(FINGER, silicone, pressures, times=corners, time_tolerance=1e-3)
    rendered_film(tmp_path / "finger.mp4", run, [begin + float(row["time"]) for row in run.table])
    films.log(tmp_path / "log.csv", PROGRAM, OFFSET, noise=5.0, end=31.0)
    (tmp_path / "finger.toml").write_text(case_of(FINGER, "ecoflex-00-30", "0,3200 Pa", name="finger").to_toml())

    def typed(command, words):
        ran = CliRunner().invoke(command, words.split())
        assert ran.exit_code == 0, ran.output
        return ran.output

    ends = side_views.to_pixels([[0.0, FINGER.crest + FINGER.base / 2], [0.0, -FINGER.base / 2]], PIXEL, CENTRE, SIZE)
    base = "=".join(f"{x:.0f},{y:.0f}" for x, y in ends)
    typed(setup_command, f"finger.mp4 --scale {1e-3 / PIXEL:.4f}px/mm+-0.05px/mm --lens none")
    said = typed(
        view_command,
        "finger.mp4 --pressures log.csv --every 2s --device finger.toml --camera-distance 80cm+-5mm --ahead 0+-0.5mm "
        f"--base {base} --no-pictures",
    )
    offset = float(re.search(r"begins at ([\d.]+) s of the log", said)[1])
    figure("a film of a finger that creeps", "offset of the clocks over a frame", (offset - OFFSET) / FRAME, 1.0)
    with (tmp_path / "views" / "views.csv").open(newline="") as table:
        assert [row["trusted"] for row in csv.DictReader(table)] == ["yes"] * 14
    typed(fit_material, "finger.toml views --memory --material neo-hookean --silicone any --no-profiles -o fit")
    (law,) = json.loads((tmp_path / "fit" / "fit.json").read_text())["laws"]
    known = {parameter["name"]: parameter for parameter in law["parameters"]}
    wanted = {"shear_modulus": SHEAR_MODULUS, **{f"share_{time:g}s": share for share, time in BRANCHES}}
    for (name, true), bound in zip(wanted.items(), (0.06, 0.5, 0.5), strict=True):
        low, high = known[name]["interval_95"]
        assert low <= true <= high, name
        figure("a film of a finger that creeps", name, known[name]["value"] / true - 1, bound)
