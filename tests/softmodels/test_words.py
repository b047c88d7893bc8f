"""Phrases that hide their meaning do not come back: the terms of the field are used instead."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PHRASES = re.compile(
    r"a result or in a reason|what a machine lacks|no failure but an answer|name is not a number|no factorisation fits|"
    r"one state of rest to the next|rigid parts alone|a design bears|was meshed before|compiled the first time|"
    r"of which \S+ make the device|its sources differ|on each other, and here they pass|lie within the colours|"
    r"on what is seen|less measured|keeps? together|corners miss by|would give about|cannot be meant|(is|are) come to|"
    r"what is held leaves|dead pressure|everything else passes through|(is|are|be|was) fore(told|seen)|gone on with|"
    r"hangs on the shape|knows nothing of|nothing (says|tells)|cure by addition|one must know before"
)
PACKAGES = [ROOT / name for name in ("softmodels", "geometries", "measurement", "docs")]


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.name)
def test_plain_words(package):
    files = [path for path in package.rglob("*") if path.suffix in (".py", ".html", ".js", ".md", ".c")]
    for path in files:
        text = " ".join(re.sub(r'"?\n\s*(#|f?")?', " ", path.read_text(encoding="utf-8")).split())
        assert not [found[0] for found in PHRASES.finditer(text)], path
