"""Phrases that hide their meaning do not come back: the terms of the field are used instead."""

from __future__ import annotations

import ast
import dataclasses
import re
import types
from pathlib import Path
from typing import ClassVar

import pytest
from click.testing import CliRunner

import softmodels as sm
from softmodels.api.calls import inflate  # noqa: F401  (says what its arguments are)
from softmodels.case.load import steps_of
from softmodels.common.errors import spoken, written
from softmodels.common.schema import Quantity, field_of
from softmodels.disk import command
from softmodels.path.supply import SUPPLIES, AirSupply, Stroke, register_supply
from softmodels.runs.columns import term
from softmodels.runs.notes import explain, explain_failure

ROOT = Path(__file__).parents[2]
PHRASES = re.compile(
    r"a result or in a reason|what a machine lacks|no failure but an answer|name is not a number|no factorisation fits|"
    r"one state of rest to the next|rigid parts alone|a design bears|was meshed before|compiled the first time|"
    r"of which \S+ make the device|its sources differ|on each other, and here they pass|lie within the colours|"
    r"on what is seen|less measured|keeps? together|corners miss by|would give about|cannot be meant|(is|are) come to|"
    r"what is held leaves|dead pressure|everything else passes through|(is|are|be|was) fore(told|seen)|gone on with|"
    r"hangs on the shape|knows nothing of|nothing (says|tells)|cure by addition|one must know before|"
    r"confidence interval contains it|what (limits were kept|holds the design back|it was held against)|the others go on\b|"
    r"gradient does not know|error stands beside|pressure is borne|must be borne|\bbears for ever|part without air|so often \||"
    r"stays longer after|states what holds it|known by its surfaces|would lock in its mould|[Tt]exts carry a unit|"
    r"dropped give back their memory|may not be used\b|common wrong factor|results against each other|All it printed|"
    r"design holds back|best device within limits|mould to cast one in|chain for MuJoCo|faster than time"
)
PACKAGES = [ROOT / name for name in ("softmodels", "geometries", "measurement", "docs")]
NAMES = re.compile(
    r"Grip|Stand|_?Drawn|Begun|Known|Judged|Judge|Teller|Told|Evaluating|Presented|Spoken|Shown|Asked|Rigged|Listed|_?Hung|Hanging|"
    r"let_move|lets_go|hung|come|told_of\w*|forget|recall|admits|_begun|_further|hushed|KeptFactorisation|Foresight|found|one"
)
"""Private words: names that do not say what they hold or return."""
UNITS = {"DPI", "HOUR", "IDENTITY", "MINUTE", "PSI", "ENLARGEMENTS", "PENALTIES", "PERCENTILES", "_LITRE"}
"""Numbers whose one-word name says all."""


def _files():
    for package in PACKAGES[:3]:
        for path in sorted(package.rglob("*.py")):
            yield path, ast.parse(path.read_text(encoding="utf-8"))


def _names(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.ClassDef | ast.FunctionDef):
            yield node.name
        elif isinstance(node, ast.arg):
            yield node.arg


def _is_number(value):
    parts = [*value.elts] if isinstance(value, ast.Tuple) else [value]
    kinds = (ast.Constant, ast.BinOp, ast.UnaryOp, ast.operator, ast.unaryop)
    return all(isinstance(node, kinds) and not isinstance(getattr(node, "value", 0), str | bytes | bool | None.__class__)
               for part in parts for node in ast.walk(part))  # fmt: skip


def test_names_say_what_they_hold():
    private = {f"{path.relative_to(ROOT)}: {name}" for path, tree in _files() for name in _names(tree)
               if NAMES.fullmatch(name)}  # fmt: skip
    assert not private


def test_numbers_say_what_they_count():
    """A number of a module is called by more than one word, such as `MIN_POINTS` or `CORNER_TOLERANCE`."""
    vague = {
        f"{path.relative_to(ROOT)}: {name.id}"
        for path, tree in _files()
        for node in tree.body
        if isinstance(node, ast.Assign) and _is_number(node.value)
        for target in node.targets
        for name in ast.walk(target)
        if isinstance(name, ast.Name) and re.fullmatch(r"_?[A-Z][A-Z0-9]+", name.id) and name.id not in UNITS
    }
    assert not vague


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.name)
def test_plain_words(package):
    files = [path for path in package.rglob("*") if path.suffix in (".py", ".html", ".js", ".md", ".c")]
    for path in files:
        text = " ".join(re.sub(r'"?\n\s*(#|f?")?', " ", path.read_text(encoding="utf-8")).split())
        assert not [match[0] for match in PHRASES.finditer(text)], path


# -- One sentence, two readers: the command line reads of options, a caller from Python of arguments. A supply has a--


COARSE = {"section": "axisymmetric", "cell_size": 6e-3, "refinement": 1.0}
BALLOONS = sm.HollowDisk(membrane=1e-3, **COARSE)
LAW = sm.NeoHookean(20e3)
SENTENCES = {
    "drive it by volume (--volume-ml, or --control volume)": 'drive it by volume (volumes, or control="volume")',
    "use --control auto or arc-length, which pass": 'use control="auto" or "arc-length", which pass',
    "refine the mesh (--cell-size) or round": "refine the mesh (cell_size) or round",
    "run without --resume into another folder (--output)": "run without resume=True into another folder (folder)",
    "take a larger --contact-stiffness than 5": "take a larger Obstacle.stiffness than 5",
    "a smaller --dead-volume or --gas liquid": 'a smaller dead_volume or gas="liquid"',
    "use a --poisson closer to 0.5, or --poisson 0.49": "use a poisson closer to 0.5, or poisson=0.49",
    "--section wedge --angle 360deg shows all": 'section="wedge" angle=360 shows all',
    "strokes of a syringe (--supply syringe with --stroke-ml)": "strokes of a syringe (supply=Syringe(...) with strokes)",
    "0.005 per ml (--leak-per-ml)": "0.005 per ml (leak)",
    "leave out PETSc's options (what follows --), refine": "leave out PETSc's options (the variable PETSC_OPTIONS), refine",
    "a dash -- as here, and a range 2--3": "a dash -- as here, and a range 2--3",
}


@dataclasses.dataclass(frozen=True)
class Flask(AirSupply):
    """A flask in front of the cavity."""

    flask: float = field_of(Quantity("m^3"), "volume of the flask", 1e-3)
    name: ClassVar[str] = "flask"

    def control(self, cavity, pressure_unit, volume_unit):
        rest = cavity / volume_unit
        return Stroke(rest, rest + self.flask / volume_unit, 101.325e3 / pressure_unit, 1.0, 0.0)


@pytest.fixture
def flask():
    register_supply(Flask)
    yield Flask(1e-3)
    del SUPPLIES["flask"]


@pytest.mark.parametrize("sentence", SENTENCES)
def test_options_are_arguments_in_python(sentence):
    assert spoken(sentence) == SENTENCES[sentence] == spoken(SENTENCES[sentence])


def test_a_run_explains_its_end_to_each_reader(tmp_path):
    run = sm.inflate(BALLOONS, LAW, pressures="0:100 cm")
    assert 'drive it by volume past the limit (volumes, or control="volume")' in run.limit.why
    assert "a thicker membrane (membrane)" in run.limit.why and "--" not in run.limit.why
    folder = run.save(tmp_path / "disk")
    assert "(--volume-ml, or --control volume)" in (folder / "summary.json").read_text()
    assert sm.load(folder).limit == run.limit
    with pytest.raises(sm.RunError, match="volumes, or control") as caught:
        run.at("60 cm")
    assert "--" not in str(caught.value)


REFUSED = {
    'use control="auto" or "volume"': {"volumes": "0:10 ml", "control": "pressure"},
    "add pressures or steps=steps_of(force_N=...)": {
        "volumes": "0:10 ml",
        "load_unload": True,
    },
    "a syringe (supply=Syringe(...)) and its strokes (strokes) belong together": {"strokes": "0:10 ml"},
    "use a larger one (syringe)": {"strokes": "0:30 ml", "supply": sm.Syringe()},
    'use formulation="mixed", or poisson=0.49': {"pressures": "0:9 cm", "formulation": "displacement"},
    "leave out resume=True": {"pressures": "0:9 cm", "resume": True},
}


@pytest.mark.parametrize("words", REFUSED)
def test_refusals_name_arguments(words):
    law = sm.NeoHookean(20e3, 0.5) if "formulation" in REFUSED[words] else LAW
    with pytest.raises((sm.CaseError, sm.MaterialError)) as caught:
        sm.inflate(BALLOONS, law, **REFUSED[words])
    assert words in str(caught.value) and "--" not in str(caught.value)


def test_the_command_line_keeps_its_words_in_the_same_process():
    words = ["--volume-ml", "0:10", "--control", "pressure", "--quiet"]
    done = CliRunner().invoke(command, words)
    assert done.exit_code == 2 and "use --control auto or volume\n" in done.stderr
    with pytest.raises(sm.CaseError) as caught:
        sm.inflate(BALLOONS, LAW, volumes="0:10 ml", control="pressure")
    assert 'use control="auto" or "volume"' in str(caught.value) and "--control auto" in written(caught.value)


def test_a_supply_is_called_by_its_name(flask):
    with pytest.raises(sm.CaseError, match=r"a flask \(supply=Flask\(...\)\) and its strokes"):
        sm.inflate(BALLOONS, LAW, pressures="0:9 cm", supply=flask)
    run = sm.inflate(BALLOONS, LAW, strokes="0:1 ml", supply=flask)
    assert term("stable_under_supply", None, run.case.load.driver).name == "stable under the flask"
    assert "stroke_limit" in run.path
    assert "syringe" not in "".join(term(name, BALLOONS, "flask").text for name in run.path)


@pytest.mark.parametrize(
    ("supply", "gas", "ending"),
    [
        (Flask(1e-3), "the gas of the flask", "snaps through. Stay below"),
        (sm.Syringe(), "the gas in syringe and tubes", "or use a smaller --dead-volume or --gas liquid"),
    ],
)
def test_a_limit_of_the_stroke_is_told_in_the_supplys_words(supply, gas, ending):
    case = sm.Case("disk", BALLOONS, LAW, steps=steps_of(stroke_ml=(0.0, 20.0)), supply=supply)
    figures = types.SimpleNamespace(rises={"apex": 0.01}, pressure=3e3, added_volume=1e-5, max_stretch=1.5, device={},
                                    extremes={"J": (1.0, 1.0)})  # fmt: skip
    fields = types.SimpleNamespace(figures=lambda state: figures, system=types.SimpleNamespace(volume_unit=1e-5))
    path = types.SimpleNamespace(last=types.SimpleNamespace(state=None), value=lambda state: 1.0)
    end = types.SimpleNamespace(limit=types.SimpleNamespace(state=None), cause=None)
    text = explain(case, end, fields, path)
    assert f"beyond it {gas} expands and the device snaps through" in text and text.endswith(ending)


def test_what_a_lost_path_is_told():
    case = sm.Case("disk", BALLOONS, LAW, steps=steps_of(pressure_cm=(1.0,)))
    text = explain_failure(case, ValueError("no convergence"), None, petsc=True)
    assert spoken(text).endswith("(the variable PETSC_OPTIONS), refine the mesh (finer=2), or use another control")
