"""What each file of the library holds, by its first sentence, as the architecture page lists it.

``python -m tests.support.file_list`` renews the list.
"""

from __future__ import annotations

import ast
from itertools import groupby
from pathlib import Path

TOP = Path(__file__).parents[2]
PAGE = TOP / "docs" / "pages" / "explanation" / "architecture.md"
HEADING = "## Every file\n"


def written():
    """Return the page's part with the list."""
    paths = sorted(path for package in ("geometries", "measurement", "softmodels") for path in (TOP / package).rglob("*.py"))
    parts = [HEADING, "\nIts first sentence, by package. A test keeps this so.\n"]
    for folder, files in groupby(paths, lambda path: path.parent.relative_to(TOP)):
        parts.append(f"\n### `{folder}`\n\n")
        for path in files:
            text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
            sentence = " ".join(text.split("\n\n")[0].split()).replace("``", "`")
            name = "the package" if path.name == "__init__.py" else f"`{path.name}`"
            parts.append(f"- {name}: {sentence}\n")
    return "".join(parts)


if __name__ == "__main__":
    before = PAGE.read_text(encoding="utf-8").split(HEADING)[0]
    PAGE.write_text(before.rstrip() + "\n\n" + written(), encoding="utf-8")
