"""Fibres and fabrics in case files: read and written exactly, refused with a sentence where they cannot be meant."""

from __future__ import annotations

import os
import re
import subprocess
import sys

import pytest

import softmodels as sm
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.case.load import steps_of
from softmodels.case.materials import own_modules
from softmodels.common.errors import OWN_MODULES
from softmodels.components.contact import Walls
from softmodels.components.fibres import Fabric, Fibres, register_fibre_law
from softmodels.mechanics.component import ComponentError
from softmodels.pictures import curves, offscreen, report
from softmodels.runs import notes
from softmodels.runs.columns import term
from softmodels.runs.labels import headline
from softmodels.runs.notes import advice
from softmodels.runs.states import FolderStates
from softmodels.runs.table import Row
from tests.support import runs

TUBE, HALF = sm.Cylinder(), sm.Cylinder(section="half", strip=90.0)


def ended(states):
    return notes.ending(states.rows, states.rows[states.main], states.words, {})


READ = """
import sys
from softmodels.case.case import Case
from softmodels.case.materials import import_own_modules
import_own_modules()
print(Case.from_file(sys.argv[1]).components[0].law)
"""


@register_fibre_law
def own(k, q, b):
    return k * (q + b * q**2) / 8


def case(device, *components):
    return Case("tube", device, sm.NeoHookean(30e3, 0.5), steps=steps_of(pressure_cm=(0.0, 10.0)), components=components)


def test_they_come_back_from_a_case_file():
    components = (
        Fabric(on="strip", along=5e4, across=123.4, poisson=0.1, name="cloth"),
        Fibres(on="wall", modulus=1.25e6, angle=33.3, law="exponential", exponent=7.5, name="braid"),
        Fibres(on="outer, strip", stiffness=2e4, angle=90.0, helices=1, slack=True, name="hoop"),
    )
    text = case(HALF, *components).to_toml()
    assert set(Case.from_toml(text).components) == set(components) and "[fibres.hoop]" in text and "25" in text


@pytest.mark.parametrize(
    ("device", "table", "words"),
    [
        (TUBE, "[fibres]\non = 'wall'", "one of stiffness .* and modulus"),
        (TUBE, "[fibres]\non = 'wall'\nmodulus = '1 MPa'\nstiffness = '1 N/m'", "one of stiffness"),
        (TUBE, "[fibres]\nstiffness = '1 kN/m'", "on is empty"),
        (TUBE, "[fibres]\non = 'outer'\nmodulus = '1 MPa'", "no region 'outer'; its regions are wall, cap"),
        (TUBE, "[fibres]\non = 'wall'\nstiffness = '1 kN/m'", "'wall' is not a face of Cylinder; it has outer, side, end"),
        (TUBE, "[fibres]\non = 'strip'\nstiffness = '1 kN/m'", "'strip' is not a face"),
        (TUBE, "[fibres]\nmodulus = '1 MPa'\nhelices = 1", "cannot twist"),
        (TUBE, "[fibres]\nmodulus = '1 MPa'\naxis = [1.0, 0.0, 0.0]", "the axis must be 0, 0, 1"),
        (HALF, "[fibres]\nmodulus = '1 MPa'\nhelices = 1", "not symmetric about the plane plane0"),
        (HALF, "[fibres]\nmodulus = '1 MPa'\naxis = [1.0, 1.0, 0.0]", "must lie in the plane"),
        (TUBE, "[fibres]\nmodulus = '1 MPa'\nangle = '95 deg'", "between -90 and 90"),
        (TUBE, "[fibres]\nmodulus = '1 MPa'\naxis = [0.0, 0.0, 0.0]", "three numbers"),
        (TUBE, "[fibres]\nmodulus = '1 MPa'\nlaw = 'cubic'", "one of standard, exponential"),
        (TUBE, "[fibres]\nmodulus = '1 MPa'\nexponent = -1", "exponent is -1"),
        (TUBE, "[fibres]\nmodulus = '5 TPa'", "are accepted"),
        (TUBE, "[fabric]\non = 'outer'\nalong = '1 kN/m'", "both|needs"),
        (TUBE, "[fabric]\non = 'outer'\nalong = '1 kN/m'\nacross = '0 N/m'", "across is 0 N/m"),
        (TUBE, "[fabric]\non = 'outer'\nalong = '1 kN/m'\nacross = '4 kN/m'\npoisson = 0.5", "must be below 0.5"),
        (TUBE, "[fabric]\non = 'outer'\nalong = '1 kN/m'\nacross = '1 kN/m'\npoisson = 0.3\nslack = true", "do not contract"),
        (TUBE, "[fabric]\non = 'outer'\nalong = '1 kN/m'\nacross = '1 kN/m'\nangle = '45 deg'", "cannot twist"),
    ],
)  # fmt: skip
def test_what_cannot_be_meant(device, table, words):
    with pytest.raises(CaseError, match=words):
        Case.from_toml(f"{case(device).to_toml()}\n{table}\n")


def test_a_face_that_the_direction_is_square_to():
    cloth = Fabric(on="end", along=1e3, across=1e3, name="cloth")
    with pytest.raises(ComponentError, match=r"fabric.cloth.*normal to the face end"):
        sm.run(case(TUBE, cloth))


def test_a_lost_path_names_them():
    last = Row({"max_stretch": 1.1, "J_min": 0.99})
    cloth, hoop = Fabric(on="strip", along=1e5, across=1e3), Fibres(on="outer", stiffness=2e4, angle=90.0)
    braid = Fibres(on="wall", modulus=1.25e6, name="braid")
    text = advice(case(HALF, cloth, hoop, braid), last)
    assert "fabric of [fabric] has up to 100 kN/m" in text and "fibres of [fibres] have 20 kN/m" in text
    assert "[fibres.braid] have a modulus of 1.25 MPa" in text and text.count("a stiffer one locks") == 1
    assert "locks" not in advice(case(TUBE, Fabric(on="outer", along=1e5, across=1e3)), last)


def test_a_lost_path_names_walls_that_press_on_each_other():
    components = case(TUBE, Walls(faces="outer", name="side"))
    text = advice(components, Row({"max_stretch": 1.1, "J_min": 0.99, "side_overlap_mm": 0.0123}))
    assert "[walls.side] (outer) are in contact and overlap by 0.0123 mm" in text and "than 2000" in text
    assert "No cause was found" in advice(components, Row({"max_stretch": 1.1, "J_min": 0.99}))


def test_their_columns_are_explained():
    assert term("braid_mean_tension_kPa").name == "tension of braid"
    assert term("hoop_mean_tension_N_per_m").name == "tension of hoop"
    assert term("cloth_stretch_along").name == "stretch of cloth along"


def test_another_process_is_told_of_a_law_of_ones_own(tmp_path):
    """A process that reads the case's file, such as the one that draws, imports the file with the law."""
    one, file = case(TUBE, Fibres(on="wall", modulus=1e6, law="own", name="braid")), tmp_path / "case.toml"
    assert own_modules(case(TUBE, Fibres(on="wall", modulus=1e6))) == "" and own_modules(one) == __file__
    file.write_text(one.to_toml())
    environment = {**os.environ, OWN_MODULES: own_modules(one)}
    words = [sys.executable, "-c", READ, str(file)]
    done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=300, check=False)
    assert done.stdout == "own\n", done.stderr


# -- What is shown of a state: a device without air shows no pressure and no volume, in messages, titles, captions a--


AIR = re.compile(r"\d cm| ml\b|added volume|cavity")
"""What tells of air."""
BEAM = ("--device", "Beam", "--part", "quarter", "--cell-size", "5mm", "--force", "tip", "--force-direction", "x",
        "--force-N", "0:0.2")  # fmt: skip
WEIGHED = ("--device", "Membrane", "--cell-size", "4mm", "--through", "1", "--gravity=-z", "--weight-share", "0:1")  # fmt: skip


@pytest.fixture(scope="module")
def beam(tmp_path_factory):
    folder = tmp_path_factory.mktemp("beam") / "beam"
    return folder, runs.run("-m", "softmodels", "run", *BEAM, "--no-pictures", "--output", folder)


@pytest.fixture(scope="module")
def weighed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("weighed") / "membrane"
    return folder, runs.run("-m", "softmodels", "run", *WEIGHED, "--no-pictures", "--output", folder)


def drawn(states):
    """All words that pictures and report make of a state's load."""
    row, words = states.rows[states.main], states.words
    labels = curves._labels(states.rows, words, range(len(states.rows)))
    return [
        headline(row, words), headline(states.row(0.5), words), offscreen.hot_spot(states, states.main).note, *labels.values(),
        ended(states), *report._notes(states),
        *(line[0].text for line in report._lines(states.rows, states).rows),
    ]  # fmt: skip


def test_a_device_without_a_cavity_shows_no_air(beam):
    folder, done = beam
    assert done.status == 0, done.err
    states = FolderStates(folder, "beam")
    closing = done.out.splitlines()[0]
    assert closing.startswith("force 0.2 N: tip rise") and "added volume" not in done.out and "0.2 N" in done.err
    steps = [line for line in done.err.splitlines() if line.startswith("step ")]
    assert len(steps) == len(states.rows)
    texts = [closing, *steps, *drawn(states), *(note for note in done.out.splitlines()[1:] if "states in" not in note)]
    assert [text for text in texts if AIR.search(text)] == []
    assert headline(states.rows[-1], states.words).startswith("force 0.2 N, tip rise")
    assert "stable under load and under travel" in done.out
    # Its outline is drawn under each load, which took a pressure or a volume before.
    assert curves.profile_steps(states.rows, states.words)[-1] == len(states.rows) - 1


def test_a_membrane_under_its_weight_shows_its_volume_and_no_pressure(weighed):
    folder, done = weighed
    assert done.status == 0, done.err
    states = FolderStates(folder, "membrane")
    texts = [done.out, done.err, *drawn(states)]
    assert [text for text in texts if re.search(r"\d cm\b|under pressure|a pressure,", text)] == []
    assert " ml" in done.out.splitlines()[0] and "the cavity has lost" in notes.ending(
        states.rows, states.rows[states.main], states.words, {}
    )


def test_a_disk_that_is_inflated_shows_both_at_rest_too(half_section):
    states = FolderStates(half_section, "disk")
    assert headline(states.rows[0], states.words) == "0 cm, 0.97 g/ml (0 kPa), apex rise 0.00 mm"
    assert "the cavity has gained" in ended(states)
