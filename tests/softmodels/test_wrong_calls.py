"""Wrong calls of everything that is public: a sentence of the project's own answers each, before anything is meshed or solved.

For each public function and class there is one right call. From it come the wrong ones: every argument, one after the other,
takes values that it cannot have, by its kind; each name is misspelt once; too many arguments are given, and none at all.
"""

from __future__ import annotations

import dataclasses
import inspect
import math
import re
import shutil
import warnings

import numpy as np
import pytest

import softmodels as sm
from geometries import Actuator
from softmodels.case.case import RequestOptions, arguments, case_of
from softmodels.case.load import steps_of
from softmodels.common.errors import OWN_PACKAGES
from softmodels.common.names import span
from softmodels.common.schema import Choice, Flag, Length, Open, Quantity, Several, Words, about
from softmodels.design.study import Input, StudyPlan
from softmodels.materials.laws import Material

LEAST = 300
"""Wrong calls that are made at least."""
DISK = sm.HollowDisk(section="axisymmetric", cell_size=6e-3, refinement=1.0)
LAW = sm.Yeoh(14e3, 60.0)
STRETCH = np.linspace(1.05, 2.5, 12)
CURVE = sm.TensileCurve("pull", "uniaxial", STRETCH, 14e3 * (STRETCH - STRETCH**-2))
PROBLEM = sm.DesignProblem(
    sm.Case("disk", DISK, LAW, steps_of(pressure_cm=(0.0, 100.0))), {"membrane": ("4 mm", "8 mm")},
    maximise={"quantity": "rise", "at": "100 cm"},
)  # fmt: skip
STUDY = StudyPlan("disk", PROBLEM.case, (Input.parse("geometry.membrane", ["4 mm", "8 mm"]),), "grid")


class Started(Exception):
    """Something was meshed or solved."""


class Odd:
    def __repr__(self):
        raise RuntimeError("no words")


# -- values that a kind of argument cannot have -----------------------------------------------------------------------

NEVER = [None, Odd(), {}, sm.HollowDisk]
NUMBERS = [*NEVER, math.nan, math.inf, 10**400, True, "", "abc", [1.0, 2.0], b"1", np.zeros((2, 2))]
KINDS = {
    "length": [*NUMBERS, "2 furlongs", "2,5 mm", "5 kPa", "5", 1e9],
    "quantity": [*NUMBERS, "2 furlongs", "2,5 mm", "5"],
    "pressure": [*NUMBERS, "2 furlongs", "2,5 kPa", "5 mm", "5"],
    "number": [*NUMBERS, "5 mm", "1,5"],
    "numbers": [*NEVER, math.nan, 5.0, "abc", ["abc"], [math.nan], [None], [[1.0]], [True]],
    "heights": [Odd(), {}, "177:0", "0:177 cm", "cm", "", [None], [500.0, 300.0], -5e9, math.nan, True, ["a"], b"5"],
    "name": [Odd(), 5, [], {}, b"folder", sm.HollowDisk],
    "names": [None, Odd(), {}, 5.0, [5.0], [None]],
    "seed": [*NEVER, -3, 1.5, "two", True, math.nan],
    "materials": [*NEVER, "ecoflex-00-33", "", 5.0, [sm.Yeoh], DISK, [], {"a": 5}, {"a": "ecoflex-00-33"}, [LAW, LAW]],
    "options": [None, Odd(), {"poisson": 0.49}, 5, "robust", sm.FitOptions],
    "texts": [*NEVER, 5.0, [5.0], [None]],
    "choice": [*NEVER, math.nan, "nothing of it", "", [], True],
    "text": [*NEVER, 5.0, [], True, b"top"],
    "flag": [*NEVER, "yes", 1, math.nan, []],
    "device": [*NEVER, "HollowDisk", 5, LAW, [DISK]],
    "material": [*NEVER, "ecoflex-00-33", "", 5.0, sm.Yeoh, DISK, [LAW]],
    "components": [Odd(), 5, "gravity", sm.Gravity, [sm.Gravity], [None], DISK],
    "values": [Odd(), {}, "0:177", "0:177 furlongs", "cm", "", [], [None], [500.0, 300.0], -5e9, math.nan, math.inf, True,
               [True], np.array(["a"]), np.array([]), ["5"], ["5 mm"], b"5 cm", "1:2:3:4 cm", [1.0, math.nan], 10**400],
    "thing": [Odd(), {1: 2}, 5, "sheet", sm.HollowDisk, DISK],
    "path": [Odd(), 5, "", "a\0b", [], {}, b"folder", sm.HollowDisk],
    "function": [5, "yes", {}, [], DISK],
    "span": [5, "1:2", [1.0], [2.0, 1.0], ["a", "b"], [math.nan, 2.0], [None, None]],
    "count": [*NEVER, 0, -3, 1.5, "two", True, math.nan],
    "curves": [None, Odd(), 5, [5], [None], sm.HollowDisk, "no-such-file.csv", ["no-such-file.csv"]],
    "laws": [None, Odd(), 5, "yeogh", "", [], [5], LAW, DISK, sm.HollowDisk, "yeoh,yeoh"],
    "table": [Odd(), 5, "membrane", [], sm.HollowDisk],
}  # fmt: skip


def kind_of(kind):
    """The name in `KINDS` of a field's kind."""
    if isinstance(kind, Open):
        return kind_of(kind.of)
    if isinstance(kind, Length):
        return "length"
    if isinstance(kind, Quantity):
        return "number" if not kind.unit else "quantity" if kind.unit != "Pa" else "pressure"
    if isinstance(kind, Several):
        return "texts" if isinstance(kind.of, Words) else "numbers"
    return {Choice: "choice", Flag: "flag", Words: "text"}[type(kind)]


def fields_of(thing):
    """Kinds of the fields of a device, a part, a law, by name."""
    if issubclass(thing, Material):
        unit = {"Pa": "pressure", "": "number"}
        return {
            field.name: "numbers" if field.metadata["many"] else unit[field.metadata["unit"]]
            for field in dataclasses.fields(thing)
            if "unit" in field.metadata
        }
    return {name: kind_of(field.kind) for name, field in about(thing).items()}


# -- the right calls --------------------------------------------------------------------------------------------------

CASE = {
    "control": "choice", "formulation": "choice", "solver": "choice", "components": "components",
    "gauges": "thing", "band": "thing", "load_unload": "flag", "steps": "thing", "water_density": "quantity",
    "supply": "thing", "tolerance": "thing",
}  # fmt: skip
RUN = {"progress": "function", "folder": "path", "resume": "flag", "branch": "flag"}
FIT = {"material": "laws", "options": "options"}
WALL = dict.fromkeys(("wall", "rim", "clearance", "least_wall", "least_gap", "pin", "pour", "vent", "tube", "chord"), "length")


class Call:
    """A right call.

    Args:
        does: What is called.
        right: Its arguments.
        kinds: Kinds of the arguments that take wrong values.
        takes: Values of these kinds that are right here.
    """

    def __init__(self, does, right, kinds, takes=()):
        self.does, self.right, self.kinds, self.takes = does, right, kinds, takes

    @property
    def name(self):
        return getattr(self.does, "__qualname__", "call")

    def wrong(self):
        """The wrong calls: what is wrong, and how it is called."""
        for name, kind in self.kinds.items():
            for value in KINDS[kind]:
                right = any(value is one or (isinstance(value, str) and value == one) for one in self.takes)
                if right or (value is None and self._optional(name)):
                    continue
                yield f"{name}={kind} {_words(value)}", lambda n=name, v=value: self.does(**{**self.right, n: v})
        for name in self.right or self.kinds:
            rest = {key: value for key, value in self.right.items() if key != name}
            value = self.right.get(name, 1)
            yield f"{name} misspelt", lambda n=name, r=rest, v=value: self.does(**{**r, f"{n[:-1]}qx": v})
        yield "too many", lambda: self.does(*[None] * 40)
        if self._needs():
            yield "nothing", lambda: self.does()

    def _optional(self, name):
        found = inspect.signature(self.does).parameters.get(name)
        return found is not None and found.default is None

    def _needs(self):
        named = inspect.signature(self.does).parameters.values()
        return any(one.default is inspect.Parameter.empty and one.kind.name != "VAR_KEYWORD" for one in named)


def _words(value):
    return "an odd object" if isinstance(value, Odd) else repr(value)[:40]


def calls(loaded):
    """The right calls of everything public, and of a run's methods."""
    devices = [getattr(sm, name) for name in sm.__all__ if isinstance(getattr(sm, name), type)]
    for device in devices:
        if issubclass(device, Actuator) and device not in (sm.ImportedActuator, sm.ImportedMesh):
            yield Call(device, {}, fields_of(device))
            yield Call(device.variant, {"name": "default"}, {"name": "choice"})
        if issubclass(device, Material) and device is not Material:
            right = {"c1": 14e3, "c10": 14e3, "shear_modulus": 28e3, "limit": 50.0, "mu": (28e3,), "alpha": (2.0,)}
            kinds = fields_of(device)
            yield Call(device, {name: right[name] for name in kinds if name in right}, kinds)
    components = {
        sm.Gravity: {"direction": "-z"}, sm.Mass: {"face": "top", "amount": 0.1}, sm.Force: {"face": "top", "direction": "z"},
        sm.Moment: {"face": "top", "axis": "y"}, sm.Rigid: {"face": "top", "name": "plate"},
        sm.RigidShape: {"faces": "top", "at": (0, 0, 0.05), "radius": 0.01, "name": "ball"},
        sm.Sheet: {"face": "top", "stiffness": 1e3}, sm.Obstacle: {"faces": "top", "plane": "z = 30 mm"},
        sm.Fabric: {"face": "top", "stiffness_1": 1e3, "stiffness_2": 1e3}, sm.Walls: {"faces": "cavity"},
        sm.Syringe: {}, sm.Reservoir: {}, sm.Fibres: {}, sm.Clamp: {"face": "top"},
        sm.BodyContact: {"between": ("inner", "outer"), "name": "touching"},
        sm.Spring: {"on": "top", "stiffness": 1.0, "name": "soft"},
    }  # fmt: skip
    for part, right in components.items():
        yield Call(part, {key: value for key, value in right.items() if key in about(part) or key == "name"}, fields_of(part))
    yield Call(sm.Region, {"material": LAW, "name": "base"}, {"material": "material", "density": "quantity"})
    yield Call(sm.silicone, {"name": "ecoflex-00-30"}, {"name": "choice"})
    base = {"device": DISK, "material": LAW}
    asked = {"pressures": "values", "volumes": "values", "strokes": "values"}
    for name in asked:
        more = {"supply": sm.Syringe(syringe=1.0)} if name == "strokes" else {}
        yield Call(sm.inflate, {**base, **more, name: "0:1 ml" if name != "pressures" else "0:30 cm"}, {name: "values"})
    right = {**base, "pressures": "0:30 cm"}
    yield Call(sm.inflate, right, {"device": "device", "material": "material", **CASE, **RUN, "name": "path"}, takes=[None])
    yield Call(
        sm.limit, base,
        {"device": "device", "material": "material", "components": "components",
         "formulation": "choice", "solver": "choice"},
    )  # fmt: skip
    yield Call(
        sm.modes, base,
        {"device": "device", "material": "material", "pressures": "values", "components": "components", "solver": "choice",
         "sealed": "flag"},
        takes=[None],
    )  # fmt: skip
    yield Call(
        sm.Model, base,
        {"device": "device", "material": "material", "components": "components",
         "formulation": "choice", "solver": "choice"},
    )  # fmt: skip
    case = PROBLEM.case
    right = {"name": "a", "actuator": DISK, "material": LAW, "steps": steps_of(pressure_cm=(0.0, 30.0))}
    yield Call(
        sm.Case,
        right,
        {"actuator": "device", "material": "material", **CASE},
    )
    yield Call(sm.run, {"case": case}, {"case": "path", **RUN})
    yield Call(sm.load, {"folder": "no-such-folder"}, {"folder": "path"})
    yield Call(sm.compare, {"first": "no-such", "second": "no-such"}, {"first": "path", "second": "path"})
    yield Call(
        sm.mould, {"device": DISK},
        {"device": "device", "silicone": "choice", "folder": "path", "draft": "quantity", "shrinkage": "number",
         "surplus": "number", "vents": "count", "pull": "text", "split": "text", **WALL},
    )  # fmt: skip
    yield Call(sm.export, {"case": case, "file": "disk.inp"}, {"case": "path", "file": "path"})
    yield Call(sm.fit_curves, {"curves": CURVE, **dict.fromkeys(["material"], "yeoh")},
               {"curves": "curves", **FIT, "stretch": "span", "progress": "function"})  # fmt: skip
    yield Call(sm.fit, {"device": DISK, "outlines": "no-such-folder"},
               {"device": "device", "outlines": "curves", "curves": "thing", "comm": "thing", **FIT})  # fmt: skip
    yield Call(sm.fit_heights, {"device": DISK, "heights": "no-such.csv"},
               {"device": "device", "heights": "curves", "comm": "thing", **FIT})  # fmt: skip
    readings = {"times": [0.0, 10.0, 20.0], "pressures": [2e3, 1.5e3, 1.2e3], "cavity": 2e-5, "supply": sm.Reservoir()}
    yield Call(
        sm.fit_leak, readings,
        {"times": "numbers", "pressures": "numbers", "cavity": "thing", "supply": "thing", "error": "number"},
    )  # fmt: skip
    yield Call(sm.score, {"materials": LAW, "curves": CURVE},
               {"materials": "materials", "curves": "curves", "stretch": "span", "stress_error": "text", "untrusted": "flag",
                "device": "thing", "outlines": "curves"})  # fmt: skip
    yield Call(sm.FitOptions, {}, {
        "poisson": "number", "changes": "table", "robust": "flag", "profiles": "flag", "silicone": "name",
        "stress_error": "text", "gauge_error": "number", "free": "names", "exclude": "names", "untrusted": "flag",
        "height_datum": "choice"}, takes=[""])  # fmt: skip
    yield Call(sm.TensileCurve, {"name": "pull", "mode": "uniaxial", "stretch": STRETCH, "stress": CURVE.stress},
               {"name": "text", "mode": "choice", "stretch": "numbers", "stress": "numbers"})  # fmt: skip
    yield Call(
        sm.DesignProblem,
        {"case": case, "parameters": {"membrane": ("4 mm", "8 mm")}, "maximise": {"quantity": "rise", "at": "100 cm"}},
        {"case": "path", "parameters": "table", "maximise": "table", "keep": "thing", "tolerances": "table",
         "material_errors": "thing", "name": "path", "folder": "path"},
        takes=[""],
    )  # fmt: skip
    yield Call(sm.optimise, {"problem": PROBLEM}, {
        "problem": "path", "folder": "path", "starts": "count", "evaluations": "count", "seed": "seed",
        "resume": "flag", "progress": "function", "stopped": "function", "confirm": "flag", "finer": "number",
        "inputs": "components"})  # fmt: skip
    yield Call(loaded.at, {"value": "20 cm"}, {"value": "pressure"})
    yield Call(loaded.where, {"column": "apex_mm", "value": 0.1}, {"column": "choice", "value": "number"})
    yield Call(loaded.last.through, {"point": "apex"}, {"point": "choice"})
    yield Call(loaded.save, {"folder": "somewhere"}, {"folder": "path"})
    yield Call(loaded.reduce, {}, {"file": "path", "kind": "text", "face": "text"})
    yield Call(sm.study, {"file": STUDY}, {
        "file": "path", "folder": "path", "jobs": "seed", "scheduler": "text", "resume": "flag", "progress": "function"},
    )  # fmt: skip


MEANT = {
    "sm.Keep": "its quantity is checked by the problem",
    "sm.ImportedActuator": "needs a file",
    "sm.ImportedMesh": "likewise",
}


@pytest.fixture(scope="module")
def loaded():
    return sm.inflate(DISK, LAW, pressures="0,30 cm")


@pytest.fixture
def nothing_starts(monkeypatch, tmp_path):
    """Let everything that costs time raise `Started`, in an empty folder."""

    def started(*args, **kwargs):
        raise Started

    monkeypatch.chdir(tmp_path)
    for place in (
        "geometries.actuator.Actuator.write", "softmodels.mechanics.system.System.__init__",
        "softmodels.mechanics.mpi.start", "softmodels.casting.make.made", "softmodels.fitting.curves.fit.fit_law_to_curves",
        "softmodels.runs.recording.begin", "softmodels.design.study.solve_into",
    ):  # fmt: skip
        monkeypatch.setattr(place, started)


def trouble_of(call):
    """What is wrong with the answer to a wrong call; empty for a sentence."""
    try:
        call()
    except Started:
        return "was started"
    except Exception as error:
        text = str(error)
        if type(error).__module__.split(".")[0] not in OWN_PACKAGES:
            return f"{type(error).__name__}: {text}"
        if "\n" in text or len(text) < 15 or " " not in text or re.search(r"0x[0-9a-f]{6}|Traceback|NoneType", text):
            return f"no sentence: {text}"
        return ""
    return "was taken"


def test_every_wrong_call_is_answered_by_a_sentence(nothing_starts, loaded):
    troubles, count = [], 0
    for call in calls(loaded):
        for what, wrong in call.wrong():
            count += 1
            if trouble := trouble_of(wrong):
                troubles.append(f"{call.name}: {what}: {trouble}")
    assert not troubles, f"{len(troubles)} of {count}:\n" + "\n".join(troubles)
    assert count >= LEAST


def test_texts_names_and_single_values_are_taken(nothing_starts):
    disk = dataclasses.replace(DISK, membrane="2 mm", profile=[])
    assert disk.membrane == 2e-3 and sm.Yeoh(c1="14 kPa", c2=np.float64(60.0)) == LAW
    assert sm.Ogden(["28 kPa"], [2.0]) == sm.Ogden((28e3,), (2.0,))
    assert sm.NeoHookean.from_young("30 kPa", 0.5) == sm.NeoHookean(10e3, 0.5)
    assert sm.Gravity("-z", density="1070 kg/m^3") == sm.Gravity("-z", 1070.0)
    case = sm.Case(
        "a",
        disk,
        "ecoflex-00-30",
        steps_of(pressure_cm=["10", 20], water_density="0.97 g/ml"),
        components=sm.Gravity("-z"),
        water_density="0.97 g/ml",
    )
    assert case.material == sm.silicone("ecoflex-00-30") and case.components == (sm.Gravity("-z"),)
    assert [value.number for value in case.values] == [10.0, 20.0] and case.water_density == pytest.approx(970.0, rel=1e-12)
    assert sm.Region("dragon-skin-30", name="base").material == sm.silicone("dragon-skin-30")
    curve = sm.TensileCurve("pull", "uniaxial", [1.1, 1.2], ["4 kPa", 8e3])
    assert curve.stress.tolist() == [4e3, 8e3]
    for pressures in (["1 kPa", "2 kPa"], ["1 kPa", 2000], np.array([1e3, 2e3]), "1:2:1 kPa", (np.int64(1000), 2e3)):
        case = case_of(disk, "ecoflex-00-30", pressures)
        assert case.values == pytest.approx((1e3, 2e3), rel=1e-12)


@pytest.mark.parametrize("one", [np.float32, np.float64, np.array, lambda x: np.array(x, np.float32), np.ma.array])
def test_numpys_numbers_are_numbers(one, nothing_starts):
    """Scalars of every type and arrays of no dimension, alone and in lists, wherever Python's numbers are taken."""
    case = case_of(DISK, LAW, one(1024.0), water_density=one(1000.0))
    assert case.values == pytest.approx((1024.0,), rel=1e-12) and case.water_density == 1000.0
    assert case_of(DISK, LAW, [one(512.0), one(1024.0)]).values == pytest.approx((512.0, 1024.0), rel=1e-12)
    assert case_of(DISK, LAW, [one(512.0)], times=one(2.0), time_tolerance=one(0.25)).time_tolerance == 0.25
    assert dataclasses.replace(DISK, membrane=one(2**-9)).membrane == 2**-9
    assert sm.Yeoh(one(16384.0), one(64.0)) == sm.Yeoh(16384.0, 64.0) and type(sm.Yeoh(one(16384.0)).c1) is float
    assert sm.Ogden([one(16384.0)], one([2.0])) == sm.Ogden((16384.0,), (2.0,))
    assert sm.TensileCurve("pull", "uniaxial", [one(1.25)], [one(4096.0)]).stress.tolist() == [4096.0]
    assert Input.parse("material.c1", [one(2.0), one(4.0)]).values == (2.0, 4.0)
    assert span("stretch", one([1.25, 2.5])) == (1.25, 2.5)


GAPPY = np.ma.array([512.0, 768.0, 1024.0], mask=[False, True, False])


@pytest.mark.parametrize(
    "call",
    [
        lambda: case_of(DISK, LAW, GAPPY),
        lambda: case_of(DISK, LAW, np.ma.masked),
        lambda: case_of(DISK, LAW, [512.0, GAPPY[1]]),
        lambda: case_of(DISK, LAW, [512.0, 768.0, 1024.0], times=GAPPY),
        lambda: sm.Yeoh(GAPPY[1]),
        lambda: sm.Ogden(GAPPY, [2.0, 3.0, 4.0]),
        lambda: sm.TensileCurve("pull", "uniaxial", GAPPY / 500, [1e3, 2e3, 3e3]),
        lambda: sm.TensileCurve("pull", "uniaxial", [1.1, 1.2, 1.3], GAPPY),
        lambda: sm.fit_leak(GAPPY, [3e3, 2e3, 1e3], 1e-5, sm.Reservoir()),
        lambda: sm.fit_leak([0.0, 1.0, 2.0], GAPPY[::-1], 1e-5, sm.Reservoir()),
    ],
)
def test_masked_values_are_no_numbers(call, nothing_starts):
    with pytest.raises(ValueError, match=r"masked values, which are no numbers; leave them out"):
        call()


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: sm.HollowDsk, "did you mean HollowDisk"),
        (lambda: sm.HollowDisk(membran=2e-3), "HollowDisk has no argument 'membran'.* did you mean membrane"),
        (lambda: sm.HollowDisk.variant("shadwo"), "did you mean shadow"),
        (lambda: sm.HollowDisk.variant("shadow", membran=1), "did you mean membrane"),
        (lambda: sm.HollowDisk(section="axisymetric"), "did you mean axisymmetric"),
        (lambda: sm.silicone("ecoflex-0031"), "did you mean ecoflex-00-30"),
        (lambda: sm.inflate(DISK, "dragonskin-33", 500.0), "did you mean dragon-skin-30"),
        (lambda: sm.inflate(DISK, LAW, presures=500.0), "did you mean pressures"),
        (lambda: sm.inflate(DISK, LAW, "0:30 kpa"), "'kpa'.*did you mean kPa"),
        (lambda: sm.inflate(DISK, LAW, 500.0, control="presure"), "did you mean pressure"),
        (lambda: sm.Sheet("top", stifness=5), "did you mean stiffness"),
        (lambda: sm.Yeoh("14 KPa"), "'14 KPa' .*did you mean kPa"),
        (lambda: sm.fit_curves(CURVE, "yeho"), "did you mean yeoh"),
        (lambda: sm.fit_curves(CURVE, "yeoh", sm.FitOptions(silicone="ecoflex-00-33")), "did you mean ecoflex-00-30"),
        (lambda: sm.mould(DISK, silicone="ecoflex-00-3"), "did you mean ecoflex-00-30"),
        (lambda: sm.Yeoh(), "Yeoh needs c1; give it"),
        (lambda: sm.HollowDisk(0.002), "HollowDisk is given 1 argument without a name and takes none"),
        (lambda: sm.inflate(DISK), "inflate needs material"),
        (lambda: sm.inflate(sm.HollowDisk, LAW, 500.0), r"device is the class HollowDisk.*write HollowDisk\(\.\.\.\)"),
    ],
)  # fmt: skip
def test_sentences_name_what_was_meant(call, words, nothing_starts):
    with pytest.raises((AttributeError, TypeError, ValueError), match=words):
        call()


def test_columns_of_a_run_are_named(loaded):
    with pytest.raises(sm.CaseError, match=r"no column 'apex'; .*did you mean apex_mm"):
        loaded.where("apex", 1.0)
    with pytest.raises(IndexError, match=f"no state number {len(loaded)}; it must be a whole number from 0 to"):
        loaded[len(loaded)]
    with pytest.raises(sm.CaseError, match="not a finite number"):
        loaded.where("apex_mm", math.nan)


def test_numbers_in_another_unit_are_warned_of(nothing_starts):
    with pytest.raises(sm.CaseError, match=r"shear modulus .*28 Pa"):
        sm.inflate(DISK, sm.Yeoh(14), "1 kPa")
    highest = "highest pressure is 10 Pa.*write another unit as a text"
    with pytest.warns(sm.ImplausibleWarning, match=highest) as told, pytest.raises(Started):
        sm.inflate(DISK, LAW, pressures=10)
    assert told[0].filename == __file__
    with pytest.warns(sm.ImplausibleWarning, match="amount is 30 kg; numbers are in kg.*'20g'"), pytest.raises(Started):
        sm.inflate(DISK, LAW, "1 kPa", components=[sm.Mass("top", 30), sm.Gravity("-z")])
    with pytest.warns(sm.ImplausibleWarning, match=r"syringe is 20 m\^3"), pytest.raises(Started):
        sm.inflate(DISK, LAW, strokes="0:1 ml", supply=sm.Syringe(20))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        case_of(DISK, LAW, "10 Pa"), case_of(DISK, LAW, 500.0)
        assert sm.fit_curves.__name__ == "fit_curves"


def test_calls_take_every_field_of_a_case():
    assert set(RequestOptions.__annotations__) == set(arguments()) - {"actuator", "material"}
    assert set(RequestOptions.__annotations__) < set(inspect.signature(sm.inflate).parameters)


@pytest.mark.parametrize(
    "name", ["inflate", "run", "limit", "load", "mould", "export", "fit", "score", "optimise", "HollowDisk"]
)
def test_tab_completes_every_argument(name):
    """What an editor and a notebook ask: names, and no sack of them."""
    found = inspect.signature(getattr(sm, name)).parameters.values()
    assert not [one for one in found if one.kind in (one.VAR_KEYWORD, one.VAR_POSITIONAL)]
    known = {"inflate": "water_density", "mould": "draft", "optimise": "evaluations", "HollowDisk": "membrane"}
    assert known.get(name, next(iter(found)).name) in {one.name for one in found}
    assert "membrane" in inspect.signature(sm.HollowDisk.variant).parameters


def test_every_public_name_is_called_wrongly(loaded):
    """A new public name gets a right call above, or stands here."""
    made = {call.does.__qualname__.partition(".")[0] for call in calls(loaded)}
    public = {name for name in sm.__all__ if callable(getattr(sm, name))}
    errors = {name for name in public if isinstance(getattr(sm, name), type) and issubclass(getattr(sm, name), Exception)}
    results = {
        "Comparison",
        "Leak",
        "Run",
        "SolvedState",
        "Score",
        "Limit",
        "NaturalFrequencies",
        "Equilibrium",
        "Line",
        "Mode",
        "Study",
        "ReducedModel",
    }
    below = {
        "Material",
        "ImportedActuator",
        "ImportedMesh",
        "Keep",
    }  # an interface, two that need files, one that a problem reads
    assert public - errors - results - below <= made


def test_what_is_gone_or_damaged(loaded, tmp_path):
    folder = loaded.save(tmp_path / "disk")
    run = sm.load(folder)
    (folder / "summary.json").write_text("[" * 100_000)
    assert sm.load(folder).limit is None
    shutil.move(folder, tmp_path / "moved")
    for look in (lambda: run[0], lambda: run.at("7 cm"), lambda: run.save(tmp_path / "other")):
        with pytest.raises(sm.ResultsError, match=r"can no longer be read .*load it from its new place"):
            look()


FACET = "facet normal 0 0 1\n outer loop\n{} endloop\n endfacet\n"
FLAT = "".join(f"  vertex {x} 0 0\n" for x in range(3))


@pytest.mark.parametrize(
    "text",
    ["", "solid a\nendsolid a\n", "solid a\n" + FACET.format(FLAT) * 4 + "endsolid a\n", "solid a\nfacet", "\0" * 84,
     "solid a\n" + FACET.format("  vertex nan 0 0\n  vertex 1 0 0\n  vertex 0 1 0\n") * 4 + "endsolid a\n",
     "solid a\n" + FACET.format("  vertex 1e300 0 0\n  vertex 1 0 0\n  vertex 0 1 0\n") * 4 + "endsolid a\n"],
    ids=["empty", "no facets", "lines", "cut off", "zeros", "nan", "huge"],
)  # fmt: skip
def test_degenerate_stl_files(text, tmp_path, monkeypatch):
    def started(*args, **kwargs):
        raise Started

    monkeypatch.setattr("softmodels.runs.simulation.Simulation.steps", started)
    file = tmp_path / "hand.stl"
    file.write_text(text)
    shape = {"shape": "stl", "file": str(file), "faces": "top", "at": (0, 0, 0.05)}
    with pytest.raises(sm.CaseError) as told:
        sm.inflate(DISK, LAW, "0:30 cm", components=sm.RigidShape(**shape))
    assert len(str(told.value)) > 20 and str(file) in str(told.value)


def test_a_deck_or_a_case_is_not_run_in_a_folder_that_is_gone(tmp_path, monkeypatch):
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    for call in (
        lambda: sm.load("disk"), lambda: sm.run("case.toml"), lambda: sm.inflate(DISK, LAW, 500.0, folder="disk"),
        lambda: sm.export(PROBLEM.case, "disk.inp"), lambda: sm.mould(DISK, "mould"), lambda: sm.fit_curves("pull.csv"),
        lambda: sm.fit(DISK, "outlines"), lambda: sm.optimise("problem.toml"), lambda: sm.optimise(PROBLEM, "design"),
    ):  # fmt: skip
        assert not trouble_of(call)
