"""The commands ``fit`` and ``curve``: what they write, what they say, and bad input as one sentence with status 2."""

from __future__ import annotations

import csv
import dataclasses
import functools
import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

from softmodels.__main__ import softmodels as whole_command
from softmodels.case.materials import from_table, material_from
from softmodels.fitting.problem import LawChoice
from softmodels.materials.laws import Ogden, Yeoh
from softmodels.materials.specimens import respond, strain_of

L = np.linspace(1.02, 3.0, 60)
LAW = Yeoh(8e3, 90.0, 0.5, 0.5)


def write_curve(path, mode, noise=30.0, factor=1.0, header="stretch,stress (kPa)"):
    stress = factor * respond(LAW, L, mode).stress + np.random.default_rng(8).normal(0.0, noise, L.size)
    path.write_text(header + "\n" + "".join(f"{a:.6f},{b / 1e3:.6f}\n" for a, b in zip(L, stress, strict=True)))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with curves, good and bad."""
    path = tmp_path_factory.mktemp("curves")
    for mode in ("uniaxial", "planar", "equibiaxial"):
        write_curve(path / f"{mode}.csv", mode)
    write_curve(path / "mpa.csv", "uniaxial", header="stretch,stress (MPa)")
    write_curve(path / "stiff.csv", "uniaxial", factor=200.0)
    write_curve(path / "soft.csv", "uniaxial", noise=0.0, factor=0.01)
    (path / "empty.csv").write_text("")
    (path / "words.toml").write_text("yeoh")
    return path


@pytest.fixture
def says(folder, monkeypatch, ended):
    """Return a function that runs a command in the folder and gives its exit status, what it said and its complaints."""
    monkeypatch.chdir(folder)
    return functools.partial(ended, whole_command)


@pytest.fixture(scope="module")
def whole(folder):
    """A fit of two laws to two tests, run as a user runs it."""
    words = ["--tensile", "uniaxial.csv", "--tensile", "planar.csv:pure-shear", "--material", "neo-hookean,yeoh,ogden1"]
    words += ["--stretch", "1.05:2.5", "--stress-error", "30Pa", "-o", "out"]
    done = subprocess.run(
        [sys.executable, "-m", "softmodels", "fit", *words],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return folder / "out", done.stdout


def test_says_values_intervals_range_and_which_law(whole):
    _, out = whole
    assert "uniaxial.csv (uniaxial): stretch 1.054 to 2.497" in out
    assert "planar.csv (planar)" in out and "stress error 30Pa" in out
    assert "a factor of 1 +- 3.16 % on each test (cross-section 3 % and load cell 1 %, the default" in out
    for words in ("c1", "95 %", "correlation of c2", "rms", "AICc", "stable (Drucker)", "2mu/alpha^2", "--material"):
        assert words in out
    assert "the data prefer yeoh" in out


def test_material_file_goes_into_a_simulation(whole):
    """Read by --material of the disk, it is the fitted law; its other tables say what it rests on."""
    folder, _ = whole
    material = material_from(str(folder / "fitted.toml"), {})
    assert isinstance(material, Yeoh) and material.poisson == 0.5
    assert [material.c1, material.c2] == pytest.approx([LAW.c1, LAW.c2], rel=0.05)
    about = tomllib.loads((folder / "fitted.toml").read_text())["fit"]
    assert "stretch 1.054 to 2.497" in about["range"][0]
    assert about["values"]["c1"] == material.c1 and about["intervals_95"]["c1"][0] < LAW.c1 < about["intervals_95"]["c1"][1]
    ogden = tomllib.loads((folder / "fitted-ogden1.toml").read_text())["material"]
    assert ogden["convention"] == "mu/alpha" and isinstance(from_table(ogden), Ogden)


def test_a_disk_takes_the_material_file(whole):
    from softmodels.case.case import Case

    folder, _ = whole
    case = (
        '[geometry]\ndevice = "HollowDisk"\n[load]\npressure_cm = "0:30"\n'
        + (folder / "fitted.toml").read_text().split("[fit]")[0]
    )
    assert isinstance(Case.from_toml(case).material, Yeoh)


def test_numbers_pictures_and_page(whole):
    folder, _ = whole
    told = json.loads((folder / "fit.json").read_text())
    assert [law["law"] for law in told["laws"]][-1] == "neo-hookean" and told["chosen"] == "yeoh"
    yeoh = next(law for law in told["laws"] if law["law"] == "yeoh")
    assert yeoh["free"] == ["c1", "c2", "c3", "gauge1", "gauge2", "law_form"] and len(yeoh["covariance"]) == 6
    assert yeoh["residuals"]["uniaxial.csv (uniaxial)"]["rms"] == pytest.approx(30.0, rel=0.3)
    with (folder / "curves.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["test"] for row in rows} == {"uniaxial", "planar"}
    assert all(abs(float(row["measured_Pa"]) - float(row["yeoh_Pa"])) < 150.0 for row in rows)
    profiles = ("profiles-yeoh.png", "profiles-ogden1.png", "profiles-neo-hookean.png")
    for name in ("law.png", "curves.png", "residuals.png", *profiles):
        image = matplotlib.image.imread(folder / name)
        assert image.shape[1] == 1280, (name, image.shape)
        assert image[..., :3].std() > 0.02, "an empty picture"
    page = (folder / "report.html").read_text()
    assert page.count('<figure data-name="') == 7 and page.count("</svg>") == 7
    assert set(re.findall(r'[a-z:]+="http[^"]*"', page)) == {
        'xmlns="http://www.w3.org/2000/svg"', 'xmlns:xlink="http://www.w3.org/1999/xlink"'
    }  # fmt: skip


def test_quiet_and_without_pictures(says, folder, tmp_path):
    out = tmp_path / "quiet"
    status, said, complaint = says(
        "fit", "--tensile", "uniaxial.csv", "--quiet", "--no-pictures", "--no-profiles", "-o", str(out)
    )
    assert (status, said, complaint) == (0, "", "")
    assert sorted(path.name for path in out.iterdir()) == [".softmodels.json", "curves.csv", "fit.json", "fitted.toml"]


def test_fix_bounds_and_priors(says, tmp_path):
    words = ["--tensile", "uniaxial.csv", "--fix", "c3=0Pa", "--bounds", "c2=:50Pa", "--prior", "c1=8kPa+-1Pa"]
    status, said, _ = says("fit", *words, "--no-pictures", "-o", str(tmp_path))
    assert status == 0 and "fixed" in said and "c2 ended at its bound 50" in said
    assert "nan" not in said
    assert material_from(str(tmp_path / "fitted.toml"), {}).c3 == 0.0


def test_robust_laws_are_compared_on_one_scale(says, tmp_path, folder):
    """With a slipping grip in the curve, the law that made it is still preferred to one that it does not follow."""
    stress = respond(LAW, L, "uniaxial").stress + np.random.default_rng(8).normal(0.0, 30.0, L.size)
    stress[30:34] -= 8e3
    (folder / "slip.csv").write_text(
        "stretch,stress (kPa)\n" + "".join(f"{a},{b / 1e3}\n" for a, b in zip(L, stress, strict=True))
    )
    words = [
        "--tensile",
        "slip.csv",
        "--material",
        "neo-hookean,yeoh",
        "--robust",
        "--no-pictures",
        "-o",
        str(tmp_path),
    ]
    status, said, _ = says("fit", *words)
    assert status == 0 and "the data prefer yeoh" in said and "outliers counted by their size" in said
    assert material_from(str(tmp_path / "fitted.toml"), {}).c1 == pytest.approx(LAW.c1, rel=0.03)


def test_an_unsound_law_is_not_called_good(says, tmp_path, folder):
    """A curve that softens gives a Yeoh law that Drucker's criterion refuses within its own range: status 1."""
    soft = Yeoh(8e3, -200.0, 0.0, 0.5)
    stretch = np.linspace(1.0, 4.0, 60)
    stress = respond(soft, stretch, "uniaxial").stress / 1e3
    (folder / "softening.csv").write_text(
        "stretch,stress (kPa)\n" + "".join(f"{a},{b}\n" for a, b in zip(stretch, stress, strict=True))
    )
    status, said, complaint = says("fit", "--tensile", "softening.csv", "--no-pictures", "-o", str(tmp_path))
    assert status == 1 and "unstable (Drucker)" in complaint and "warning: the law is unstable" in said
    assert "unstable" in tomllib.loads((tmp_path / "unsound.toml").read_text())["fit"]["warnings"][0]
    assert not (tmp_path / "fitted.toml").exists()


def written(path, stretch, stress, header="stretch,stress (Pa)"):
    path.write_text(header + "\n" + "".join(f"{a:.9g},{b:.9g}\n" for a, b in zip(stretch, stress, strict=True)))


def test_a_raw_strip_is_thinned_and_the_law_that_follows_it_is_taken(says, tmp_path):
    """37,512 readings of a pull that no law follows exactly: the few runs of the residuals must not choose the poorest law."""
    stretch = np.linspace(1.02, 3.0, 37512)
    stress = respond(Yeoh(7.9e3, 150.0, 0.0, 0.5), stretch).stress * (1 + 0.4 * np.exp(-3 * (stretch - 1)))
    written(tmp_path / "raw.csv", stretch, stress + np.random.default_rng(3).normal(0.0, 100.0, stretch.size))
    words = ["--tensile", str(tmp_path / "raw.csv"), "--material", "neo-hookean,yeoh", "--no-profiles", "--no-pictures"]
    status, said, progress = says("fit", *words, "-o", str(tmp_path / "fit"))
    assert status == 0 and "37512 readings averaged over" in said
    assert "fitting neo-hookean, law 1 of 2" in progress
    assert isinstance(material_from(str(tmp_path / "fit" / "fitted.toml"), {}), Yeoh)
    told = json.loads((tmp_path / "fit" / "fit.json").read_text())
    misfit = {law["law"]: law["residuals"]["raw.csv (uniaxial)"]["rms"] for law in told["laws"]}
    assert told["preferred"] == "yeoh" and misfit["neo-hookean"] > 2.5 * misfit["yeoh"]


def test_two_laboratories_are_told_apart(says, tmp_path):
    """Two curves a factor 1.75 apart, one of 300 readings and one of 12: both are named, each with a fit and a file."""
    for name, factor, count in (("savoie.csv", 1.0, 300), ("swansea.csv", 1.75, 12)):
        stretch = np.linspace(1.02, 3.0, count)
        written(tmp_path / name, stretch, factor * respond(LAW, stretch).stress)
    words = [word for name in ("savoie.csv", "swansea.csv") for word in ("--tensile", str(tmp_path / name))]
    status, said, complaint = says("fit", *words, "--no-profiles", "--no-pictures", "-o", str(tmp_path / "fit"))
    assert status == 0
    for text in (said, complaint):
        assert "savoie.csv and swansea.csv contradict each other" in text and "1.75 times" in text
    assert "spread: shear modulus 16 kPa to 28 kPa" in said
    for file, factor in (("fitted-curve1.toml", 1.0), ("fitted-curve2.toml", 1.75)):
        assert material_from(str(tmp_path / "fit" / file), {}).c1 == pytest.approx(factor * LAW.c1, rel=1e-3)
    # The long curve does not silence the short one: the joint fit lies between.
    assert 1.15 * LAW.c1 < material_from(str(tmp_path / "fit" / "fitted.toml"), {}).c1 < 1.6 * LAW.c1
    assert any("contradict" in text for text in json.loads((tmp_path / "fit" / "fit.json").read_text())["apart"])


def test_curves_of_one_name_stay_two(says, tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        written(tmp_path / name / "pull.csv", L, respond(LAW, L).stress)
    words = [word for name in ("a", "b") for word in ("--tensile", str(tmp_path / name / "pull.csv"))]
    status, said, _ = says("fit", *words, "--no-profiles", "--no-pictures", "-o", str(tmp_path / "fit"))
    assert status == 0 and "a/pull.csv (uniaxial)" in said and "b/pull.csv (uniaxial)" in said


def test_curve(says, tmp_path):
    words = ["--material", "ecoflex-00-30", "--material", "ogden:mu=20kPa,-1kPa,alpha=2,-2,poisson=0.5"]
    words += ["--material", "yeoh:c1=8kPa,c2=-200Pa", "--tensile", "uniaxial.csv", "--stretch", "0.5:4"]
    status, said, _ = says("curve", *words, "-o", str(tmp_path))
    assert status == 0 and "warning: the law is unstable" in said and "limit point at stretch" in said
    with (tmp_path / "curves.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["material"].startswith("ogden")]
    stretch = np.array([float(row["stretch"]) for row in rows])
    law = Ogden((20e3, -1e3), (2.0, -2.0), 0.5)
    for mode, side in (("uniaxial", stretch**-0.5), ("planar", stretch**-1.0), ("equibiaxial", stretch**-2.0)):
        nominal = np.array([float(row[f"{mode}_nominal_Pa"]) for row in rows])
        true = np.array([float(row[f"{mode}_true_Pa"]) for row in rows])
        assert nominal == pytest.approx(respond(law, stretch, mode).stress, rel=1e-6, abs=1e-3)
        assert true == pytest.approx(nominal * stretch, rel=1e-6, abs=1e-3), side
    balloon = np.array([float(row["balloon_Pa"]) for row in rows])
    sheet = np.array([float(row["equibiaxial_nominal_Pa"]) for row in rows])
    assert balloon == pytest.approx(2 * 0.05 * sheet / stretch**2, rel=1e-6, abs=1e-3)
    assert matplotlib.image.imread(tmp_path / "curves.png")[..., :3].std() > 0.02


def test_compressible_true_stress(says, tmp_path):
    """At a Poisson's ratio of 0.3 the true stress is the force on the sides' real stretch."""
    assert (
        says("curve", "--material", "neo-hookean:shear_modulus=20kPa,poisson=0.3", "--no-pictures", "-o", str(tmp_path))[0] == 0
    )
    with (tmp_path / "curves.csv").open() as file:
        row = list(csv.DictReader(file))[-1]
    law = material_from("neo-hookean", {"shear_modulus": "20kPa", "poisson": "0.3"})
    found = respond(law, np.array([4.0]))
    assert float(row["uniaxial_true_Pa"]) == pytest.approx(float(found.stress[0] / found.side[0] ** 2), rel=1e-6)


def test_curve_and_fit_need_no_solver():
    """A laptop without FEniCSx can fit and draw."""
    modules = ("__main__", "cli.material_commands", "pictures.fits")
    words = f"import sys, {', '.join(f'softmodels.{name}' for name in modules)}; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", words], capture_output=True, text=True, timeout=100, check=True
    ).stdout.split()
    assert not {"dolfinx", "petsc4py", "mpi4py", "ufl", "basix"} & set(loaded)


def test_strain_of():
    assert strain_of("uniaxial", L) == pytest.approx(L**2 + 2 / L - 3)


T = "fit --tensile uniaxial.csv"
REFUSED = {
    "fit": ["--tensile"],
    "fit --tensile none.csv": ["none.csv", "No such file"],
    "fit --tensile .": ["folder"],
    "fit --tensile empty.csv": ["empty.csv", "empty"],
    "fit --tensile uniaxial.csv:torsion": ["'torsion'", "planar"],
    "fit --tensile soft.csv": ["soft.csv", "kPa", "factor 1000"],
    "fit --tensile uniaxial.csv --tensile stiff.csv": ["uniaxial.csv", "stiff.csv", "one material"],
    f"{T} --material rubber": ["'rubber'", "yeoh"],
    f"{T} --material yeoh,yeoh": ["twice"],
    f"{T} --material ogden9": ["'ogden9'", "at most 4"],
    f"{T} --stretch 3": ["'3'", "1.02:3"],
    f"{T} --stretch 3:1": ["'3:1'", "must rise"],
    f"{T} --stretch 5:6": ["0 of its points", "1.02 to 3"],
    f"{T} --stress-error 2": ["'2'", "no unit"],
    f"{T} --stress-error 2%": ["2%", "absolute"],
    f"{T} --gauge-error 3mm": ["'3mm'"],
    f"{T} --gauge-error 300%": ["gauge error of 3", "between 0 and 100"],
    f"{T} --poisson 0.6": ["poisson", "0.6"],
    f"{T} --fix c9=1kPa": ["c9", "c1"],
    f"{T} --fix c3": ["c3", "NAME=VALUE"],
    f"{T} --fix c3=1": ["c3=1", "no unit"],
    f"{T} --bounds c2=5Pa": ["c2", "FROM:TO"],
    f"{T} --bounds c2=5Pa:1Pa": ["c2", "bounds"],
    f"{T} --prior c1=8kPa": ["c1", "+-"],
    f"{T} --prior c1=8kPa+-0Pa": ["error above zero"],
    f"{T} --columns strain": ["columns", "KIND=COLUMN"],
    f"{T} --cross-section 18": ["--cross-section", "18"],
    f"{T} --gauge-length=-3mm": ["gauge length", "above zero"],
    f"{T} -o uniaxial.csv": ["cannot be written"],
    f"{T} more": ["more"],
    "curve": ["--material"],
    "curve --material rubber": ["rubber"],
    "curve --material words.toml": ["words.toml", "TOML"],
    "curve --material yeoh": ["c1"],
    "curve --material yeoh:c1": ["'c1'", "KEY=VALUE"],
    "curve --material yeoh:c1=8": ["no unit"],
    "curve --material ecoflex-00-30 --stretch 1:1": ["1:1"],
    "curve --material ecoflex-00-30 --thickness 30mm": ["less than the radius"],
    "curve --material ecoflex-00-30 --tensile none.csv": ["none.csv"],
}  # fmt: skip


@pytest.mark.parametrize("text", REFUSED)
def test_bad_input_is_one_sentence(text, says):
    status, out, complaint = says(*text.split())
    assert status == 2, complaint
    assert out == "" and complaint.startswith("softmodels: ") and complaint.count("\n") == 1
    assert all(word in complaint for word in REFUSED[text]), complaint
    assert not Path("results").exists()


def test_a_law_at_the_edge_of_what_it_can_be_is_judged(tmp_path):
    """Mooney-Rivlin on a curve that only hardens ends at a shear modulus of nothing: a sentence, no traceback."""
    from softmodels.fitting.curves.curve import TensileCurve
    from softmodels.fitting.curves.residuals import StressError, residuals_of
    from softmodels.fitting.least_squares import fit_parameters, objections

    choice = LawChoice.from_text("mooney-rivlin")
    curve = TensileCurve("edge", "uniaxial", L, respond(Yeoh(1.0, 300.0, 5.0, 0.5), L).stress)
    sources, _ = residuals_of([curve], choice, StressError.from_text("constant"))
    found = fit_parameters(sources, choice.parameters({"c10": 1e3, "c01": -1e3 + 1e-5}), errors="unknown")
    edge = dataclasses.replace(found, values={"c10": 1e3, "c01": -1e3 + 1e-5})
    said = objections(edge, lambda values: choice.material(values).shear_modulus_0)
    assert any("do not determine the shear modulus" in text for text in said)
