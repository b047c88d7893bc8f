"""What the pages and the README show is run: examples as they are, Python as it stands on each page from top to bottom."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

TOP = Path(__file__).parents[2]
EXAMPLES = sorted((TOP / "docs" / "examples").glob("*.py"))
PAGES = [
    page
    for page in [TOP / "README.md", *sorted((TOP / "docs" / "pages").glob("*.md"))]
    if "```python" in page.read_text()
]


def _run(words, folder):
    done = subprocess.run(
        [sys.executable, *words], cwd=folder, capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, done.stderr
    return done


def test_there_are_examples_and_pages():
    assert len(EXAMPLES) >= 3 and {page.name for page in PAGES} >= {"README.md", "python.md"}


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_examples_assert_a_number_and_draw_a_picture(example, tmp_path):
    text = example.read_text()
    assert re.search(r"^assert ", text, re.MULTILINE)
    done = _run([example], tmp_path)
    assert done.stdout.strip() and (tmp_path / f"{example.stem}.png").stat().st_size > 10_000


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.stem)
def test_python_on_pages_runs(page, tmp_path):
    blocks = re.findall(r"^```python\n(.*?)^```", page.read_text(), re.DOTALL | re.MULTILINE)
    (tmp_path / "page.py").write_text("\n".join(blocks))
    _run(["page.py"], tmp_path)
