"""A law that is unstable by its own check is named before the run, where a path ends, by limit, and refused if at rest."""

from __future__ import annotations

import json

import pytest

from softmodels.materials.laws import MaterialError, NeoHookean, Ogden, Yeoh
from softmodels.materials.specimens import check_rest, weakest, weakness
from tests.support import runs

SOFTENING = Yeoh(10e3, -400.0, 0.0, 0.495)
WORDS = ("--variant", "shadow", "--material", "yeoh", "--c1", "10kPa", "--c2=-0.4kPa", "--poisson", "0.495")


def test_a_softening_law_names_its_stretches():
    assert weakest(SOFTENING).mode == "equibiaxial" and weakest(SOFTENING).stretch == pytest.approx(2.0, abs=0.01)
    text = weakness(SOFTENING)
    assert text.startswith("the law yeoh (c1 = 10 kPa, c2 = -0.4 kPa")
    assert all(mode in text for mode in ("2.8 (uniaxial)", "2.67 (planar)", "2 (equibiaxial)"))
    assert weakness(NeoHookean(30e3)) == "" and weakest(NeoHookean(30e3)) is None


def test_a_run_warns_first_and_ends_with_the_laws_name(tmp_path):
    done = runs.disk(tmp_path / "disk", *WORDS, "--volume-ml", "0:60")
    first, last = done.err.split("step   0")
    assert "warning: the law yeoh (c1 = 10 kPa, c2 = -0.4 kPa" in first and "2 (equibiaxial)" in first
    (end,) = [line for line in last.splitlines() if line.startswith("softmodels: no equilibrium at 60 ml")]
    reached = runs.rows(tmp_path / "disk")[-1]["max_stretch"]
    assert done.status == 3 and "refine the mesh" not in end
    assert "The law yeoh (c1 = 10 kPa" in end and f"the last state has stretch {reached:.3g}" in end
    assert "yeoh" in json.loads((tmp_path / "disk" / "summary.json").read_text())["notes"][0]


@pytest.mark.parametrize("law", [Yeoh(10e3, -100e6), Ogden((1000e3, -9.99e3), (2.0, 200.0), 0.495)])
def test_a_law_unstable_at_rest_is_refused(law):
    with pytest.raises(MaterialError, match=r"unstable at small strain.*check the signs"):
        check_rest(law)
    check_rest(SOFTENING)


def test_unstable_at_rest_is_bad_input(tmp_path):
    words = ["--material", "yeoh", "--c1", "10kPa", "--c2=-100MPa", "--poisson", "0.495"]
    done = runs.disk(tmp_path / "disk", *words, "--pressure-cm", "0:10")
    assert done.status == 2 and "unstable at small strain" in done.err and not (tmp_path / "disk" / "path.csv").exists()
    done = runs.run("-m", "softmodels", "limit", *words)
    assert done.status == 2 and "unstable at small strain" in done.err


def test_limit_names_the_law_too():
    done = runs.run("-m", "softmodels", "limit", *WORDS)
    assert done.status == 0 and "note: the law yeoh (c1 = 10 kPa, c2 = -0.4 kPa" in done.out
