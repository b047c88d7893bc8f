"""Where laws stop being stable, against closed forms."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.optimize import brentq

from softmodels.materials.laws import (
    Carroll,
    FungDemiray,
    Gent,
    MaterialError,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    Polynomial,
    Yeoh,
)
from softmodels.materials.specimens import check_rest, instabilities, judge, last_stretch, weakest, weakness
from tests.support import runs


@pytest.mark.parametrize("law", [NeoHookean(20e3), Yeoh(8e3, 90.0), Gent(20e3, 40.0), MooneyRivlin(8e3, 1e3),
                                 FungDemiray(20e3, 0.01), Carroll(8e3, 0.01, 4e3), Polynomial(8e3, 1e3, 20.0),
                                 Ogden((0.63e6, 1.2e3, -10e3), (1.3, 5.0, -2.0))])  # fmt: skip
def test_convex_laws_are_stable_everywhere(law):
    assert instabilities(law) == ()
    assert judge(law, 20.0).flags == ()


def test_uniaxial_instability_of_yeoh():
    """In uniaxial tension Drucker's determinant vanishes where the slope of the true (Kirchhoff) stress does.

    tau = 2 (c1 + 2 c2 k) (l^2 - 1/l), differentiated by hand along ln l.
    """
    c1, c2 = 8e3, -200.0

    def slope(x):
        k, rise = x**2 + 2 / x - 3, 2 * (x**2 - 1 / x)
        return 2 * c2 * rise * 2 * (x**2 - 1 / x) + 2 * (c1 + 2 * c2 * k) * (2 * x**2 + 1 / x)

    by_hand = brentq(slope, 1.5, 6.0)
    (found,) = [one for one in instabilities(Yeoh(c1, c2)) if one.mode == "uniaxial" and one.stretch > 1]
    assert found.stretch == pytest.approx(by_hand, rel=1e-3)
    assert found.strain == pytest.approx(by_hand**2 + 2 / by_hand - 3, rel=1e-3)


def test_the_fitted_range_decides():
    law = Yeoh(8e3, -200.0)
    first = instabilities(law)[0]
    assert judge(law, 0.95 * first.strain).flags == ()
    assert "unstable beyond it in" in judge(law, 0.95 * first.strain).notes[0]
    (flag,) = judge(law, 1.05 * first.strain).flags
    assert "unstable (Drucker)" in flag and str(first) in flag


def test_negative_mooney_is_unstable_in_compression():
    """c01 below zero lets a sheet pulled both ways lose its stiffness first among the pulled ones."""
    found = {(one.mode, one.stretch > 1): one.stretch for one in instabilities(MooneyRivlin(10e3, -4e3))}
    assert found["equibiaxial", True] < found["planar", True] < found["uniaxial", True]


@pytest.mark.parametrize(("mode", "shape"), [("uniaxial", lambda x: x**2 + 2 / x), ("planar", lambda x: x**2 + 1 + x**-2),
                                             ("equibiaxial", lambda x: 2 * x**2 + x**-4)])  # fmt: skip
@pytest.mark.parametrize("limit", [0.5, 40.0, 3000.0])
def test_taut_chains(mode, shape, limit):
    assert shape(last_stretch(Gent(20e3, limit), mode)) - 3 == pytest.approx(limit)
    assert np.isinf(last_stretch(NeoHookean(20e3), mode))


def test_notes_name_the_balloon():
    assert any("limit point at stretch 1.383" in note for note in judge(NeoHookean(20e3), 5.0).notes)
    assert any("no limit point" in note for note in judge(MooneyRivlin(8e3, 3e3), 5.0).notes)
    assert any("lock at stretch: uniaxial" in note for note in judge(Gent(20e3, 40.0), 5.0).notes)


# -- A law that is unstable by its own check is named before the run, where a path ends, by limit, and refused if at--


SOFTENING = Yeoh(10e3, -400.0, 0.0, 0.495)
WORDS = ("--variant", "shadow", "--material", "yeoh", "--c1", "10kPa", "--c2=-0.4kPa", "--poisson", "0.495")


def test_a_softening_law_names_its_stretches():
    assert weakest(SOFTENING).mode == "equibiaxial" and weakest(SOFTENING).stretch == pytest.approx(2.0, abs=0.01)
    text = weakness(SOFTENING)
    assert text.startswith("the law yeoh (c1 = 10 kPa, c2 = -0.4 kPa")
    assert all(mode in text for mode in ("2.8 (uniaxial)", "2.67 (planar)", "2 (equibiaxial)"))
    assert weakness(NeoHookean(30e3)) == "" and weakest(NeoHookean(30e3)) is None


@pytest.mark.campaign
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
