"""Every refusal of a photograph ends with what to do: which option to give, or what to photograph again."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import measurement

ROOT = Path(measurement.__file__).parent
REMEDIES = (
    "photograph", "give ", "setup --", "level ", "clear away", "leave one", "expos", "focus", "bring", "darken", "calibrate",
    "show more", "aim ", "switch", "move the camera",
    "check its", "save ", "; use ", "as the camera took them", "copy it",
)  # fmt: skip


def refusals():
    """File, line and literal text of every refusal that is written out where it is raised."""
    for file in sorted(ROOT.rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text())):
            if not isinstance(node, ast.Call):
                continue
            name = getattr(node.func, "id", "")
            if name != "Unmeasurable" and not (name == "Doubt" and any(word.arg == "rejects" for word in node.keywords)):
                continue
            # A check's remedy is the second argument of its doubt.
            parts = [node] if name == "Unmeasurable" else node.args[1:] or node.args
            text = "".join(
                part.value
                for one in parts
                for part in ast.walk(one)
                if isinstance(part, ast.Constant) and isinstance(part.value, str)
            )
            if text:
                yield pytest.param(text, id=f"{file.relative_to(ROOT)}:{node.lineno}")


def test_refusals_are_found():
    assert len(list(refusals())) > 30


@pytest.mark.parametrize("text", list(refusals()))
def test_a_refusal_names_its_remedy(text):
    assert any(remedy in text for remedy in REMEDIES), text
