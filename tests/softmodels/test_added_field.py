"""A field and columns that are not the library's own: defined here alone, found in every file of a run."""

from __future__ import annotations

import csv
from xml.etree import ElementTree

import h5py
import numpy as np
import pytest

from geometries import HollowDisk
from softmodels.case.case import Case
from softmodels.case.load import steps_of
from softmodels.cli.run import run
from softmodels.common.commands import RunOptions
from softmodels.materials.laws import NeoHookean
from softmodels.runs.columns import term
from softmodels.runs.fields import OUTPUTS, Extreme, OutputField, register_output
from softmodels.runs.table import Variable

SMALLEST = OutputField(
    "smallest_stretch",
    "",
    "smallest stretch",
    lambda at: at.at_nodes(at.stretches[..., 0], positive=True),
    lambda at: at.stretches[..., 0],
    (Extreme("min_stretch", "", "smallest stretch", "where the silicone is pressed together most", least=True),),
)
RADIAL = OutputField("turned", "m", "displacement, turned", lambda at: at.displacement[:, [2, 0, 1]])
MEAN = Variable("mean_rise", "mm", "mean rise", "of all nodes", lambda s: float(s.nodal["displacement"][:, 2].mean()))
NODES = Variable("nodes_here", "", "nodes", "of a rank", measured=lambda sampling, state: float(sampling.grid.owned))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    added = [register_output(output) for output in (SMALLEST, RADIAL, MEAN, NODES)]
    folder = tmp_path_factory.mktemp("added") / "disk"
    case = Case("disk", HollowDisk(section="axisymmetric"), NeoHookean(28e3), steps=steps_of(pressure_cm=(0.0, 10.0)))
    try:
        assert run(case, folder, RunOptions(quiet=True, no_pictures=True)) == 0
        assert term("min_stretch").text == SMALLEST.extremes[0].text and term("nodes_here").name == "nodes"
        yield folder
    finally:
        for output in added:
            del OUTPUTS[output.key]


def test_the_field_and_its_extreme_are_in_every_file(folder):
    with (folder / "path.csv").open() as file:
        rows = list(csv.DictReader(file))
    tree = ElementTree.parse(folder / "disk.xdmf")
    with h5py.File(folder / "disk.h5") as file:
        for number, grid in enumerate(tree.iterfind("Domain/Grid/Grid")):
            kinds = {one.get("Name"): one.get("AttributeType") for one in grid.iterfind("Attribute")}
            assert kinds["smallest_stretch"] == "Scalar" and kinds["turned"] == "Vector"
            assert {"displacement", "p", "von_mises", "largest_stretch", "J"} < set(kinds)
            step = file[f"steps/{number:04d}"]
            smallest, largest = step["smallest_stretch"][:], step["largest_stretch"][:]
            assert (smallest <= largest).all() and np.ptp(smallest) > 1e-3 * bool(number)
            assert np.array_equal(step["turned"][:], step["displacement"][:][:, [2, 0, 1]])
            # Nodal values come by a linear fit through those at the integration points.
            assert float(rows[number]["min_stretch"]) == pytest.approx(smallest.min(), abs=0.02)
            mean = 1e3 * step["displacement"][:][:, 2].mean()
            assert float(rows[number]["mean_rise_mm"]) == pytest.approx(mean, abs=1e-9)
            assert float(rows[number]["nodes_here"]) == len(smallest)
    assert len(rows) > 2 and float(rows[-1]["min_stretch"]) < 0.995


def test_a_name_is_of_one_output():
    with pytest.raises(ValueError, match="'J' is taken by another output"):
        register_output(OutputField("J", "", "another", lambda at: at.p))
