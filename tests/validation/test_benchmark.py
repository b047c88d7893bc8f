"""The open benchmark: a device predicted, the page's figures, cases that others can solve."""

import dataclasses
import re

import numpy as np
import pytest

from tests.support import membrane_shooting as shooting
from tests.validation.__main__ import BEGIN, END, PAGE, PICTURE, predict, table, write_cases
from tests.validation.devices import ECOFLEX, G, beam, cylinder, membranes


@pytest.fixture(scope="module")
def plain():
    return predict(next(membranes()), sources=False)


@pytest.mark.campaign
def test_a_membrane_is_predicted(plain):
    """Within 6 % of what was measured, and within 2 % of the membrane equations by shooting."""
    assert np.abs(plain.errors).max() < 6.0
    law = shooting.Yeoh(ECOFLEX.c1, ECOFLEX.c2, ECOFLEX.c3)
    membrane = shooting.CircularMembrane(0.070, 0.002, law, 0.0254, 1.5 * G)
    up, down = (membrane.path(np.linspace(0.5, end, 25) * 0.070) for end in (0.75, 0.12))
    path = [*reversed(down), *up[1:]]
    heights, pressures = np.array([(1e3 * one.height, one.pressure / 1e3) for one in path]).T
    assert plain.values == pytest.approx(np.interp(plain.of.given, heights, pressures), rel=0.02)


def test_the_page_has_every_device(plain, tmp_path):
    text = PAGE.read_text(encoding="utf-8").split(BEGIN)[1].split(END)[0]
    groups = dict.fromkeys(one.group for one in (*membranes(), *beam(), *cylinder(tmp_path)))
    written = re.findall(r"^\| (?!device|---)([^|]+) \|.*?\| (\d+) of (\d+) \| ([\d.]+) %", text, re.MULTILINE)
    assert [name for name, *_ in written] == list(groups) and PICTURE.is_file()
    assert f"{np.sqrt((plain.errors**2).mean()):.1f} %" in table([plain])
    for _, reached, points, rms in written:
        assert int(reached) > 0.85 * int(points) and float(rms) < 15.0


def test_cases_are_files_that_others_can_take(tmp_path):
    one = next(membranes())
    case = one.case(one.material)
    coarse = dataclasses.replace(case, actuator=dataclasses.replace(case.actuator, thickness=0.01, cell_size=0.01))
    write_cases([dataclasses.replace(one, case=lambda material: dataclasses.replace(coarse, material=material))], tmp_path)
    assert {file.name for file in tmp_path.iterdir()} == {"plain-15N.toml", "plain-15N.inp"}
