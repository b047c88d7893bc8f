"""``softmodels limit``: one figure for a design, a margin, a list of materials, a workshop's tolerances."""

from __future__ import annotations

import csv
import dataclasses
import json
import re
import warnings

import numpy as np
import pytest
from mpi4py import MPI

import softmodels as sm
from geometries import ACTUATORS, Balloon, HollowDisk, PneuNet, SeminarActuator
from softmodels.__main__ import softmodels
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.case.load import steps_of
from softmodels.cli import analyses
from softmodels.cli.analyses import LimitOptions
from softmodels.common.commands import NO_INPUT
from softmodels.common.schema import about
from softmodels.components.loads import Force, Gravity, Mass
from softmodels.design.model import DesignModel
from softmodels.design.quantities import Rise
from softmodels.fitting.outlines.residuals import Height
from softmodels.materials.laws import MooneyRivlin, NeoHookean, Yeoh
from softmodels.materials.silicones import SILICONES, density_of
from softmodels.materials.specimens import sphere_pressure
from softmodels.mechanics import body
from softmodels.mechanics.iterative import Multigrid
from softmodels.runs.analyses import Tolerance, check_varied, find_limit, samples
from tests.support import runs

THIN = HollowDisk.variant("shadow", support="base", fillet=0.0, base_fillet=0.0, section="axisymmetric")
ONE = PneuNet(chambers=1, chamber_width=8e-3, chamber_height=8e-3, cell_size=5e-3)
LAW = NeoHookean(20e3, 0.49)
OPTIONS = ("--variant", "shadow", "--support", "base", "--fillet", "0mm", "--base-fillet", "0mm")


def case_of(device, components=(), **how):
    """A case whose load and material do not matter."""
    return Case(device.stem, device, LAW, steps=steps_of(pressure_cm=(1.0,)), components=components, **how)


def test_thin_disk_is_limited_and_a_stiffening_one_is_not(comm):
    """The thin disk of the bench: 34.1 cm for the isochoric neo-Hookean law, 34.5 cm for the thesis' own."""
    materials = [MooneyRivlin(10e3, 0.0, 0.495), NeoHookean(20e3, 0.495), Yeoh(10e3, 2e3, 500.0, 0.495)]
    isochoric, thesis, stiffening = find_limit(case_of(THIN), materials, comm)
    assert isochoric.kind == thesis.kind == "limit"
    assert isochoric.pressure / 95.124 == pytest.approx(34.1, rel=5e-3)
    assert thesis.pressure / 95.124 == pytest.approx(34.5, rel=2e-3)
    assert isochoric.rises["ceiling"] == pytest.approx(24.1e-3, rel=5e-3)
    assert isochoric.added_volume == pytest.approx(28.3e-6, rel=5e-3)
    # At the cavity's upper edge; the integration points, where strain is looked at, lie a little inside the cells.
    assert np.hypot(*isochoric.place[:2]) == pytest.approx(THIN.cavity_radius, abs=0.5e-3)
    assert isochoric.place[2] == pytest.approx(THIN.ceiling, abs=0.5e-3)
    assert stiffening.kind == "none" and stiffening.stretch > 4.9


@pytest.mark.campaign
def test_a_table_of_materials_with_margins(tmp_path):
    materials = ("--material", "ecoflex-00-30", "--material", "dragon-skin-20")
    done = runs.run("-m", "softmodels", "limit", *OPTIONS, *materials, "--working-pressure", "10", "--output", tmp_path)
    assert done.status == 0 and done.err == ""
    rows = json.loads((tmp_path / "limit.json").read_text())
    others = [f"ecoflex-00-30/{key}" for key in ("marechal-2021", "sorotoki", "smooth-on")]
    assert [row["material"] for row in rows] == [
        "ecoflex-00-30",
        "dragon-skin-20",
        *others,
        "dragon-skin-20/marechal-2021",
    ]
    # Both ends of what each product's sources say, as computed limits.
    for many in ((rows[0], *rows[2:5]), (rows[1], rows[5])):
        every = sorted((row["limit_cm"], row["material"]) for row in many)
        ends = (every[0], every[-1])
        start = f"{many[0]['material']} over its {len(many)} sources: "
        (text,) = [line for line in done.out.splitlines() if line.startswith(start)]
        assert (
            all(f"{limit:.4g} cm, 0.97 g/ml (" in text and name in text for limit, name in ends)
            and ends[1][0] > 1.4 * ends[0][0]
        )
    for row in rows:
        assert row["margin"] == pytest.approx(row["limit_cm"] / 10) and f"{row['limit_cm']:.4g} cm" in done.out
    assert rows[1]["limit_cm"] > 3 * rows[0]["limit_cm"] and "--angle 360deg" in done.out


def test_tolerances_scatter_the_limit(tmp_path):
    """A thicker membrane bears more, about in proportion; the picture and the table are there."""
    done = runs.run("-m", "softmodels", "limit", *OPTIONS, "--shear-modulus", "20kPa", "--cell-size", "4mm",
                    "--vary", "membrane=2mm+-0.2mm", "--samples", "5", "--output", tmp_path)  # fmt: skip
    assert done.status == 0 and "5 devices" in done.out
    with (tmp_path / "scatter.csv").open() as file:
        rows = [(float(row["membrane"]), float(row["limit_cm"])) for row in csv.DictReader(file)]
    thickness, limit = np.array(sorted(rows)).T
    assert thickness[0] > 0.0018 and thickness[-1] < 0.0022 and (np.diff(limit) > 0).all()
    assert np.polyfit(np.log(thickness), np.log(limit), 1)[0] == pytest.approx(0.95, abs=0.1)
    assert (tmp_path / "scatter.png").stat().st_size > 10000


@pytest.mark.campaign
def test_tolerances_scatter_the_limit_under_a_weight(tmp_path, comm):
    """Each sampled device bears its own weight and the mass on it, as a single one of its thickness does."""
    heavy = (Gravity("-z"), Mass("top", 0.020))
    coarse = dataclasses.replace(THIN, cell_size=0.004)
    (tmp_path / "case.toml").write_text(case_of(coarse, heavy).to_toml())
    done = runs.run("-m", "softmodels", "limit", tmp_path / "case.toml",
                    "--vary", "membrane=2mm+-0.2mm", "--samples", "2", "--output", tmp_path / "limit")  # fmt: skip
    assert done.status == 0 and "2 devices" in done.out
    with (tmp_path / "limit" / "scatter.csv").open() as file:
        rows = [(float(row["membrane"]), float(row["limit_cm"])) for row in csv.DictReader(file)]
    for thickness, limit in rows:
        device = dataclasses.replace(coarse, membrane=thickness)
        with_it, without = (
            find_limit(case_of(device, components), [LAW], comm)[0].pressure / 95.1243 for components in (heavy, ())
        )
        assert limit == pytest.approx(with_it, rel=1e-4) and abs(with_it / without - 1) > 1e-3


def test_a_device_that_cannot_carry_its_preload_ends_as_a_run_of_it(tmp_path):
    """The same sentence and the same exit status."""
    case = case_of(dataclasses.replace(THIN, cell_size=0.004), (Force("top", "-z", 5.0),))
    (tmp_path / "case.toml").write_text(case.to_toml())
    done = [
        runs.run("-m", "softmodels", command, tmp_path / "case.toml", "--output", tmp_path / command)
        for command in ("limit", "run")
    ]
    assert [one.status for one in done] == [3, 3]
    assert all("no equilibrium under its dead loads (the preload): at 0.2" in one.err for one in done)


@pytest.mark.campaign
def test_a_limit_is_found_with_the_solver_of_its_case(comm, monkeypatch):
    """By iterations it is the same one."""
    case = case_of(dataclasses.replace(THIN, cell_size=0.004))
    direct, iterative = (
        find_limit(dataclasses.replace(case, solver=solver), [LAW], comm)[0] for solver in ("direct", "iterative")
    )
    assert iterative.pressure == pytest.approx(direct.pressure, rel=1e-8) and iterative.kind == "limit"
    made = []
    monkeypatch.setattr(Multigrid, "set_up", lambda self, real=Multigrid.set_up: (made.append(self), real(self))[1])
    find_limit(dataclasses.replace(case, solver="iterative"), [LAW], comm)
    assert made


@pytest.mark.campaign
def test_every_silicone_has_its_own_weight(comm):
    """Where gravity leaves the density out it is the named silicone's, whichever was solved before."""
    soft, hard = (SILICONES[name].material for name in ("ecoflex-00-10", "elastosil-m4601"))
    assert type(soft) is type(hard) and density_of(soft) < 0.95 * density_of(hard)
    membrane = dataclasses.replace(THIN, cell_size=0.004)
    down = (Gravity("-z", magnitude=98.1),)
    both = find_limit(case_of(membrane, down), [soft, hard], comm)
    alone = find_limit(case_of(membrane, down), [hard], comm)
    assert both[1].pressure == pytest.approx(alone[0].pressure, rel=1e-7)


@pytest.mark.campaign
def test_offset_and_thickness_scatter_as_single_devices_differ(tmp_path):
    """The slopes told, against differences of devices drawn thinner, and with their cavities higher in the same height."""
    done = runs.run("-m", "softmodels", "limit", *OPTIONS, "--shear-modulus", "20kPa", "--cell-size", "4mm", "--vary",
                    "membrane=2mm+-0.1mm", "--vary", "offset=0mm+-0.1mm", "--samples", "6", "--output", tmp_path)  # fmt: skip
    assert done.status == 0 and (tmp_path / "scatter.png").exists()
    told = dict(re.findall(r"(membrane|offset): .* by about ([+-][\d.]+) %", done.out))
    drawn = dataclasses.replace(THIN, cell_size=0.004)
    thicker, thinner, higher, lower = (
        sm.limit(dataclasses.replace(drawn, membrane=membrane, base=base), NeoHookean(20e3)).pressure
        for membrane, base in ((2.1e-3, 5e-3), (1.9e-3, 5e-3), (1.9e-3, 5.1e-3), (2.1e-3, 4.9e-3))
    )
    assert float(told["membrane"]) == pytest.approx(np.log(thicker / thinner) / np.log(2.1 / 1.9), rel=0.05)
    assert float(told["offset"]) == pytest.approx(50 * np.log(higher / lower), rel=0.05)
    assert "0.1 mm more changes" in done.out
    assert re.search(r"limit pressure \(cm, 0\.97 g/ml\) [\d.]+ \(5 %\), .* [\d.]+ \(95 %\); lowest", done.out)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--vary", "membrane"], "membrane=2mm+-0.2mm"),
        (["--vary", "depth=2mm+-0.2mm"], "no parameter 'depth'"),
        (["--vary", "membrane=2mm+-3mm"], "between zero and the value"),
        (["--vary", "membrane=2+-0.2mm"], "membrane"),
        (["--vary", "offset=0mm+-0mm"], "above zero"),
        (["--material", "rubber"], "rubber"),
        (["--working-pressure", "0"], "above zero"),
        (["no/case.toml"], "no/case.toml"),
        (["--device", "Balloons"], "--device is 'Balloons'; it must be one of"),
        (["--device", "Beam"], "cavity"),
    ],
)
def test_bad_input_is_a_sentence_and_status_2(words, told):
    done = runs.run("-m", "softmodels", "limit", *words)
    assert done.status == 2 and done.out == "" and done.err.count("\n") == 1 and told in done.err


@pytest.mark.parametrize(
    ("device", "vary", "told"),
    [
        (ONE, "wall=1mm+-0.1mm", "this PneuNet is the same at 0.9 mm and at 1.1 mm, so"),
        (Balloon(neck_radius=0.0, cell_size=4e-3), "neck-length=1cm+-10%", "neck_length has no effect with neck_radius"),
    ],
)  # fmt: skip
def test_a_tolerance_without_effect_is_refused(device, vary, told, comm):
    """Before anything is solved."""
    with pytest.raises(CaseError, match=re.escape(told)):
        check_varied(device, [Tolerance.parse(vary, type(device))], comm)


@pytest.mark.parametrize(("device", "vary"), [(Balloon(cell_size=4e-3), "wall=1mm+-0.1mm"), (THIN, "offset=0mm+-0.2mm")])
def test_a_tolerance_with_an_effect_is_accepted(device, vary, comm):
    """A cavity that sits too high changes no volume, and is seen all the same."""
    check_varied(device, [Tolerance.parse(vary, type(device))], comm)


def test_samples_fill_the_tolerances():
    tolerances = [Tolerance.parse("membrane=2mm±10%", HollowDisk), Tolerance.parse("wall=5mm+/-0.5mm", HollowDisk)]
    values = samples(tolerances, 256)
    assert values.mean(axis=0) == pytest.approx([0.002, 0.005], rel=2e-3)
    assert (np.abs(values / [0.002, 0.005] - 1) <= 0.1).all() and (np.ptp(values, axis=0) > [3.9e-4, 9.8e-4]).all()
    assert samples(tolerances, 256, normal=True).std(axis=0) == pytest.approx([1e-4, 2.5e-4], rel=0.05)
    slab = Tolerance.parse("offset=-1mm+-20%", SeminarActuator)
    assert (slab.middle, slab.half) == pytest.approx((-1e-3, 2e-4))
    with pytest.raises(CaseError):
        Tolerance.parse("section=2mm+-1mm", HollowDisk)


@pytest.mark.campaign
def test_any_device_by_its_options(ended):
    """A closed balloon has the limit of a thick sphere's closed form."""
    words = [
        "--neck-radius",
        "0mm",
        "--cell-size",
        "3mm",
        "--wall",
        "3mm",
        "--shear-modulus",
        "20kPa",
        "--poisson",
        "0.5",
    ]
    status, out, _ = ended(softmodels, "limit", "--device", "balloon", *words)
    stretches = np.linspace(1.0, 3.0, 2001)
    most = sphere_pressure(NeoHookean(20e3, 0.5), 0.015, 0.018, stretches).max()
    assert status == 0 and 1e3 * float(re.search(r"\(([\d.]+) kPa\)", out)[1]) == pytest.approx(most, rel=1e-3)


@pytest.mark.campaign
def test_straight_edges_are_told_wherever_a_device_is_meshed(ended, monkeypatch):
    """A mesh with edges that could not be curved; no device's has some today, so that their number is set."""
    monkeypatch.setattr(body.meshing, "straight_edges", lambda: 12)
    text = "12 edges of the mesh on curved faces are straight"
    words = ("--cell-size", "5mm", "--wall", "3mm", "--shear-modulus", "20kPa", "--poisson", "0.5")
    status, out, _ = ended(softmodels, "limit", "--device", "balloon", *words)
    assert status == 0 and out.count(f"note: {text}") == 1
    device, law = Balloon(wall=3e-3, cell_size=5e-3), NeoHookean(20e3, 0.5)
    for found in (sm.limit(device, law), sm.Model(device, law), sm.modes(device, law, count=1)):
        assert [note for note in found.notes if note.startswith(text)] and text in found._repr_html_()
    sampled = dataclasses.replace(sm.limit(device, law), notes=(text,))
    question = analyses.LimitRequest(case_of(device), {}, (), 2, False, None, 0.0, ())
    notes = analyses._notes(question, {}, {}, analyses.Scatter((), [({}, sampled), ({}, sampled)]))
    assert f"note: 2 of 2 sampled devices have warnings; of the first: {text}" in list(notes)


@pytest.mark.campaign
def test_straight_edges_are_told_with_every_result_on_their_mesh(monkeypatch, tmp_path):
    monkeypatch.setattr(body.meshing, "straight_edges", lambda: 12)
    text = "12 edges of the mesh on curved faces are straight"
    device, law = HollowDisk(section="axisymmetric", cell_size=6e-3, refinement=1.0), Yeoh(9e3, 300.0, 0.0, 0.49)
    case = Case("disk", device, law, steps=steps_of(pressure_cm=(20.0, 50.0, 80.0)))
    run = sm.run(case)
    run.save(tmp_path / "saved")
    sm.run(case, folder=tmp_path / "stored")
    for found in (run, sm.load(tmp_path / "saved"), sm.load(tmp_path / "stored")):
        assert [note for note in found.notes if note.startswith(text)]
    for folder in ("saved", "stored"):
        assert text in json.loads((tmp_path / folder / "summary.json").read_text())["notes"][0]
    heights = [Height(f"{P:.0f}", P, apex) for P, apex in zip(run.pressure[1:], run.apex[1:], strict=True)]
    options = sm.FitOptions(poisson=0.49, changes={"c3": {"start": 0.0, "fixed": True}}, profiles=False)
    assert any(note.startswith(text) for note in sm.fit_heights(device, heights, "yeoh", options).notes)
    model = DesignModel(case, ("membrane",), (Rise(at=1900.0),), MPI.COMM_WORLD)
    assert model.evaluate(model.start).notes[0].startswith(text)
    model.release()


@pytest.mark.parametrize("name", ["ImportedActuator", "ImportedMesh"])
def test_a_part_of_a_file_of_its_own(ended, name, tmp_path):
    """The device's --file is not the command's FILE."""
    words = ("--file", tmp_path / "none.stp", "--cavities", "at 1, 0, 0 mm", "--support", "x = 0 mm")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        status, _, told = ended(softmodels, "limit", "--device", name, *words)
    assert status == 2 and told.count("\n") == 1 and "none.stp" in told


def test_every_option_makes_another_question(ended, monkeypatch):
    """Else the answer would replace that of the question before, in results/limit."""
    asked = []

    def opened(output, default, kind, options, files):
        asked.append({name: value for name, value in options.items() if name not in NO_INPUT})
        raise CaseError("asked")

    monkeypatch.setattr(analyses.commands, "open_folder", opened)
    more = [
        [],
        ["--vacuum"],
        ["--normal"],
        ["--samples", "5"],
        ["--working-pressure", "20cm"],
        ["--output", "elsewhere"],
    ]
    for words in more:
        assert ended(softmodels, "limit", "--vary", "membrane=2mm+-0.2mm", *words)[0] == 2
    assert asked.pop() == asked[0] and not [one for one in asked[1:] if one == asked[0]] and len(asked) == 5


def test_no_device_has_a_length_of_the_commands_own_name():
    own = {field.name for field in dataclasses.fields(LimitOptions)}
    assert not [name for name, kind in ACTUATORS.items() if own & about(kind).keys()]
