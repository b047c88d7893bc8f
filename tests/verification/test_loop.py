"""The whole loop: a known silicone is simulated, photographed with noise, perspective and a leak, measured and fitted."""

from __future__ import annotations

import dataclasses
import tomllib

import pytest
from click.testing import CliRunner

from measurement.__main__ import main as measurement
from measurement.units import pascal_per_cm
from softmodels.cli import demo
from softmodels.cli.fit_command import fit_material

PRESSURES = tuple(cm * pascal_per_cm() for cm in (35.0, 80.0, 125.0, 177.0))
SILICONES = {
    "yeoh": demo.TRUTH,
    "neo-hookean": dataclasses.replace(demo.TRUTH, law="neo-hookean", values={"shear_modulus": 31e3}),
}


@pytest.mark.parametrize("law", SILICONES)
def test_intervals_hold_the_truth(law, comm, tmp_path, figure):
    truth = dataclasses.replace(SILICONES[law], pressures=PRESSURES)
    demo.write_case(tmp_path, truth)
    _, halves = demo.inflated(truth, comm)
    assert halves[-1][:, 1].max() > 3e-3
    demo.take_photographs(tmp_path / "photographs", truth, halves, demo.scene_of(2.5))
    runner = CliRunner()
    for module, words in demo.commands(tmp_path, truth):
        command = {"measurement": measurement, "softmodels": fit_material}[module]
        words = words[1:] if module == "softmodels" else words
        more = {"photos": ["--jobs", "1", "--no-pictures"], "setup": []}.get(
            words[0], ["--no-profiles", "--no-pictures"]
        )
        done = runner.invoke(command, [*words, *more])
        assert done.exit_code == 0, done.output
    lines, good = demo.compared(tmp_path, truth)
    assert good, "\n".join(lines)
    material = tomllib.loads((tmp_path / "fit" / "fitted.toml").read_text())
    assert not material["fit"]["warnings"]
    values, true = material["fit"]["values"], truth.values
    modulus = {"yeoh": "c1", "neo-hookean": "shear_modulus"}[law]
    against = "a known silicone, simulated, photographed, measured, fitted"
    figure(against, f"{law}, {modulus}", values[modulus] / true[modulus] - 1, 0.02)
    figure(against, "axis", (values["centre"] - demo.CENTRE) * 1e6, 50.0, unit="um")
