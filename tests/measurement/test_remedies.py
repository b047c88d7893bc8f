"""Every refusal of a photograph ends with what to do: which option to give, or what to photograph again."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import measurement

ROOT = Path(measurement.__file__).parent
REMEDIES = (
    "photograph", "give ", "setup --", "level ", "clear away", "leave one", "expose", "focus", "bring", "darken", "calibrate",
    "show more", "aim ", "switch", "move the camera",
)  # fmt: skip


def refusals():
    """File, line and literal text of every refusal that is written out where it is raised."""
    for file in sorted(ROOT.rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text())):
            if not (isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call)):
                continue
            if getattr(node.exc.func, "id", "") != "Unmeasurable":
                continue
            text = "".join(
                part.value
                for part in ast.walk(node.exc)
                if isinstance(part, ast.Constant) and isinstance(part.value, str)
            )
            if text:
                yield pytest.param(text, id=f"{file.relative_to(ROOT)}:{node.lineno}")


@pytest.mark.parametrize("text", refusals())
def test_a_refusal_names_its_remedy(text):
    assert any(remedy in text for remedy in REMEDIES), text
