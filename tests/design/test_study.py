"""Studies: samples, workers that die, resuming, a cluster, Sobol indices, and limits that scale as they must."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest
from click.testing import CliRunner

import softmodels as sm
from geometries import HollowDisk
from softmodels.case.case import Case
from softmodels.case.load import steps_of
from softmodels.case.materials import MaterialErrors
from softmodels.cli.design import study_command
from softmodels.common import processes as workers
from softmodels.design.study import (
    SAMPLES,
    Input,
    Study,
    StudyError,
    StudyPlan,
    _inputs,
    _read,
    indices_of,
    study,
    surrogate_of,
)  # fmt: skip
from softmodels.materials.laws import Yeoh
from tests.support import dying

CASE = """
[geometry]
device = "HollowDisk"
section = "axisymmetric"
cell_size = "6 mm"
[material]
law = "neo-hookean"
shear_modulus = "20 kPa"
[load]
pressure_cm = "0:10"
"""
STUDY = """
case = "disk.toml"
sampling = "grid"
answer = "limit"
[vary]
geometry.membrane = ["2 mm", "500 mm"]
material.shear_modulus = ["20 kPa", "30 kPa"]
"""


def test_worker_that_dies_is_replaced(tmp_path):
    tasks = {k: str(tmp_path / str(k)) for k in range(3)}
    assert dict(workers.answers(dying.__name__, "die_once", tasks, 2)) == dict.fromkeys(tasks, (True, "alive"))
    found = dict(workers.answers(dying.__name__, "die", {0: ""}, 1))
    assert found[0][0] is False and "process that computes ended" in found[0][1]


def test_lines_that_are_no_samples_are_left_out(tmp_path):
    (tmp_path / "samples.jsonl").write_text('[]\n3\n{"sample": null}\n{"sample": 4, "a": 1.0}\n{"sample": 5, "a"')
    assert _read(tmp_path / "samples.jsonl") == {4: {"a": 1.0}}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    (folder / "disk.toml").write_text(CASE)
    (folder / "limits.toml").write_text(STUDY)
    return folder


@pytest.fixture(scope="module")
def limits(files) -> Study:
    return study(files / "limits.toml", files / "results", jobs=2)


def test_limit_is_proportional_to_the_shear_modulus(limits):
    """Pressures of an incompressible neo-Hookean body scale with its modulus at the same shape."""
    soft, stiff = limits.values("limit_Pa")[:2]
    assert stiff / soft == pytest.approx(1.5, rel=1e-5)
    assert limits.dataset["max_stretch"][0] == pytest.approx(float(limits.dataset["max_stretch"][1]), rel=1e-4)
    assert limits.dataset["limit_Pa"].attrs["units"] == "Pa"


def test_failures_keep_their_sentences(limits):
    assert sorted(limits.failures) == [2, 3] and "membrane" in limits.failures[2]
    assert np.isnan(limits.values("limit_Pa")[2:]).all()


@pytest.mark.campaign
def test_killed_study_resumes_to_the_same_dataset(files, limits):
    xarray = pytest.importorskip("xarray")
    file = files / "results" / SAMPLES
    lines = file.read_text().splitlines(keepends=True)
    solved = next(k for k, line in enumerate(lines) if '"rows"' in line)
    file.write_text("".join(lines[: solved + 1]) + lines[-1][:20])  # killed within a line
    told = []
    again = study(files / "limits.toml", files / "results", resume=True, jobs=1, progress=told.append)
    assert len(told) == 1
    xarray.testing.assert_identical(again.dataset, limits.dataset)
    again.save(files / "limits.nc")
    xarray.testing.assert_identical(xarray.load_dataset(files / "limits.nc", engine="h5netcdf"), limits.dataset)
    if importlib.util.find_spec("zarr"):
        with pytest.raises(StudyError, match="no Zarr"):
            (files / "mine.zarr").mkdir()
            again.save(files / "mine.zarr")
        for _ in range(2):
            again.save(files / "limits.zarr")
        xarray.testing.assert_identical(xarray.load_dataset(files / "limits.zarr", engine="zarr"), limits.dataset)
    (files / "other.toml").write_text(STUDY.replace("30 kPa", "40 kPa"))
    with pytest.raises(StudyError, match=r"another study: study.inputs changed"):
        study(files / "other.toml", files / "results", resume=True)


@pytest.mark.campaign
def test_two_dask_workers_give_the_same_dataset(files, limits):
    distributed, xarray = pytest.importorskip("distributed"), pytest.importorskip("xarray")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=False, dashboard_address=None) as cluster:
        found = study(files / "limits.toml", scheduler=cluster.scheduler_address)
    xarray.testing.assert_identical(found.dataset, limits.dataset)


# -- Sobol indices and surrogates ---------------------------------------------------------------------------------------


A, B = 7.0, 0.1
ANGLES = tuple(Input(f"x{k}", (), -np.pi, np.pi) for k in range(3))


def ishigami(x):
    """Ishigami and Homma 1990, the usual test of Sobol indices."""
    return np.sin(x[:, 0]) + A * np.sin(x[:, 1]) ** 2 + B * x[:, 2] ** 4 * np.sin(x[:, 0])


def test_sobol_indices_of_ishigami():
    first = 0.5 * (1 + B * np.pi**4 / 5) ** 2
    mixed = B**2 * np.pi**8 * (1 / 18 - 1 / 50)
    variance = first + A**2 / 8 + mixed
    exact = np.array([first, A**2 / 8, 0.0]) / variance
    exact_total = np.array([first + mixed, A**2 / 8, mixed]) / variance
    plan = StudyPlan.__new__(StudyPlan)
    for name, value in {"inputs": ANGLES, "sampling": "saltelli", "samples": 2**14, "seed": 1}.items():
        object.__setattr__(plan, name, value)
    for found in (indices_of(ANGLES, ishigami, 2**14), indices_of(ANGLES, ishigami(plan.points))):
        assert np.abs(np.array(found.first) - exact).max() < 0.01
        assert np.abs(np.array(found.total) - exact_total).max() < 0.01


def test_the_only_input_has_all_of_the_variance():
    for response, share in ((lambda x: np.sin(x[:, 0]), 1.0), (np.zeros(3 * 64), 0.0)):
        found = indices_of(ANGLES[:1], response, 64)
        assert (found.first, found.total, found.first_half) == ((share,), (share,), (0.0,)) and found.doubt == ""


def test_contradicting_sobol_indices_are_told():
    """Eight samples of Ishigami's function: an index by itself above the one with all interactions, which none is."""
    few, many = indices_of(ANGLES, ishigami, 8), indices_of(ANGLES, ishigami, 2**14)
    wrong = [k for k in range(3) if not 0.0 <= few.first[k] <= few.total[k]]
    assert wrong and all(f"{ANGLES[k].key} ({few.first[k]:.3f} of {few.total[k]:.3f})" in few.doubt for k in wrong)
    assert many.doubt == ""


def test_surrogate_knows_its_error():
    pytest.importorskip("sklearn")
    inputs = (Input.parse("a.x", "0:2 mm"), Input.parse("a.kind", ["soft", "stiff"]))
    rng = np.random.default_rng(0)
    points, fresh = (np.column_stack([rng.uniform(0, 2, n), rng.integers(0, 2, n)]) for n in (40, 200))
    made = surrogate_of(inputs, points, np.sin(points[:, 0]) + 2 * points[:, 1])
    assert 0.0 < made.error < 0.01 * made.spread
    miss = made(fresh) - np.sin(fresh[:, 0]) - 2 * fresh[:, 1]
    assert np.sqrt(np.mean(miss**2)) < 3 * made.error
    with pytest.raises(StudyError, match="at least 8"):
        surrogate_of(inputs, points[:5], points[:5, 0])


# -- study files --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (("[vary]", "[varied]"), "unknown entry 'varied'"),
        (("grid", "random"), "sampling is 'random'"),
        (('["2 mm", "500 mm"]', '"1:2 mm"'), "a grid needs steps"),
        (("geometry.membrane", "geometry.membran"), "membran"),
        (('["20 kPa", "30 kPa"]', '"30:20 kPa"'), "smaller value first"),
        (("geometry.membrane", "membrane"), "write the table too"),
        (('material.shear_modulus = ["20 kPa", "30 kPa"]', 'material = "fit"'), "needs the errors of a fit"),
        (("disk.toml", "disc.toml"), "disk.toml?"),
        (("sampling", f'name = "{"a" * 5000}"\nsampling'), "5000 bytes"),
        (("sampling", 'name = "../elsewhere"\nsampling'), "is not a valid file name"),
    ],
)
def test_wrong_study_files(files, tmp_path, change, sentence):
    (tmp_path / "disk.toml").write_text(CASE)
    (tmp_path / "wrong.toml").write_text(STUDY.replace(*change))
    done = CliRunner().invoke(study_command, [str(tmp_path / "wrong.toml"), "-o", str(tmp_path / "results")])
    assert done.exit_code == 2 and sentence in done.output + done.stderr and not (tmp_path / "results").exists()


def test_inputs_reach_the_case(files):
    """Steps, normal distributions, silicones, and loads are in the case of a sample."""
    text = STUDY.replace(
        "material.shear_modulus = [", 'material.silicone = ["ecoflex-00-30", "dragon-skin-20"]\nload.pressure = ['
    )
    (files / "many.toml").write_text(text.replace("20 kPa", "1 kPa").replace("30 kPa", "2 kPa"))
    plan = StudyPlan.from_file(files / "many.toml")
    last = plan.case_at(np.array([0.0, 1.0, 1.0]))
    assert last.material == sm.silicone("dragon-skin-20") and last.values == pytest.approx([2e3])
    steps = Input.parse("geometry.base", "1:2:0.25 mm")
    assert steps.values == (1.0, 1.25, 1.5, 1.75, 2.0) and steps.text(1.0) == "1.25 mm"
    normal = Input.parse("geometry.base", "2 mm +- 10 %")
    assert normal.ppf(np.array([0.5, 0.9772498680518208])) == pytest.approx([2.0, 2.2])


@pytest.mark.campaign
def test_fitted_covariance_is_drawn():
    """Samples of a fit have its covariance."""
    errors = MaterialErrors(("c1", "c2"), ((1e4, -300.0), (-300.0, 25.0)))
    case = Case("disk", HollowDisk(section="axisymmetric"), Yeoh(14e3, 60.0), steps=steps_of(pressure_cm=(10.0,)), band=errors)
    plan = StudyPlan("fit", case, tuple(_inputs({"material": "fit"}, case)), "sobol", 128)
    drawn = [plan.case_at(point).material for point in plan.points]
    found = np.cov([[one.c1, one.c2] for one in drawn], rowvar=False)
    assert found == pytest.approx(np.array(errors.covariance), rel=0.15)
