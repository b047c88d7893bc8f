"""From an STL file with an inlet and a tensile test of Bluehill, as downloaded, to the bend at a pressure with its band."""

import re

import gmsh
import pytest
from click.testing import CliRunner

from geometries import meshing
from geometries.__main__ import main as geometries
from softmodels.__main__ import softmodels
from tests.softmodels.test_machine_files import PULL, bluehill
from tests.support.open_parts import Bore, OpenPart

FINGER = OpenPart(
    (30.0, 8.0, 10.0),
    (((7.0, 1.5, 1.5, 20.0, 5.0, 3.0),),),
    # The seat of a barb, and the bore behind it.
    ((Bore((0.0, 4.0, 3.0), (1.0, 0.0, 0.0), 1.4, 2.0), Bore((0.0, 4.0, 3.0), (1.0, 0.0, 0.0), 1.0, 8.0)),),
)


@pytest.mark.campaign
def test_three_commands_from_files_to_the_bend_with_its_band(tmp_path, monkeypatch):
    """Look at the part, fit the silicone, press: the finger bends upwards, since its chamber lies below its middle, and its
    band is that of the fitted parameters."""
    monkeypatch.chdir(tmp_path)
    with meshing.private_model():
        FINGER.draw()
        gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 24)
        gmsh.model.mesh.generate(2)
        gmsh.write("finger.stl")
    (tmp_path / "pull.csv").write_text(bluehill(PULL))
    part = ["--file", "finger.stl", "--support", "x = 0 mm", "--cell-size", "5mm"]
    for command, words in (
        (geometries, ["ImportedMesh", *part, "-o", "finger.msh"]),
        (softmodels, ["fit", "--tensile", "pull.csv", "--material", "mooney-rivlin", "--no-pictures", "-o", "fit"]),
        (softmodels, ["run", "--device", "ImportedMesh", *part, "--material", "fit/fitted.toml", "--band", "fit/fitted.toml",
                      "--pressure", "20 kPa", "--ranks", "1", "--no-pictures", "-o", "bend"]),
    ):  # fmt: skip
        result = CliRunner().invoke(command, words)
        assert result.exit_code == 0, result.output
    said = " ".join(result.output.split())
    errors = r"\S+ \+- \S+ mm \(95 %\): (law's form|silicone) \S+ mm, (law's form|silicone) \S+ mm"
    assert re.search(f"tip rise {errors} tip displacement {errors}", said), said
    assert "closed by a plug" in said
