"""The tables of measured figures: what a run writes into them, and that each figure has one."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.support import figure_tables as tables

TESTS = Path(__file__).parents[1]
PAGE = """# Page

<!-- figures: test_one.py test_two.py -->
<!-- end of figures -->

Words.
"""


def rows(text):
    return [line for line in text.splitlines() if line.startswith("| ") and not line.startswith("| against")]


def test_a_run_renews_its_own_rows_alone():
    one = tables.Figure("test_one.py", "theory", "load", 2e-4, 5e-4)
    rate = tables.Figure("test_one.py", "theory", "rate", 3.21, 3.0, least=True)
    two = tables.Figure("test_two.py", "drops", "width", 0.31, 0.5, unit="%")
    page = tables.rewritten(PAGE, [two, one, rate], {"test_one.py": True, "test_two.py": True})
    assert rows(page) == [
        "| theory | load | 0.0002 | ≤ 0.0005 | `test_one.py` |",
        "| theory | rate | 3.2 | ≥ 3 | `test_one.py` |",
        "| drops | width | 0.31% | ≤ 0.5% | `test_two.py` |",
    ]
    assert tables.rewritten(page, [two, one, rate], {}) == page and page.endswith("Words.\n")
    # A test that was left out keeps its row, one that is gone loses it.
    again = one._replace(value=3e-4)
    assert rows(tables.rewritten(page, [again], {"test_one.py": False}))[0].startswith("| theory | load | 0.0003 |")
    assert len(rows(tables.rewritten(page, [again], {"test_one.py": False}))) == 3
    assert len(rows(tables.rewritten(page, [again], {"test_one.py": True}))) == 2


def test_of_like_figures_the_worst_is_shown():
    values = [tables.Figure("test_one.py", "theory", "load", value, 5e-4) for value in (1e-4, 3e-4, 2e-4)]
    rates = [tables.Figure("test_one.py", "theory", "rate", value, 3.0, least=True) for value in (3.5, 3.1, 4.0)]
    assert [figure.value for figure in tables.worst(values + rates)] == [3e-4, 3.1]
    assert not values[1].loose and values[1]._replace(bound=1e-3).loose
    assert not values[1]._replace(value=1e-16, bound=1e-12).loose


def test_a_figure_without_a_table_is_named():
    three = tables.Figure("test_three.py", "theory", "load", 0.0, 1.0)
    assert tables.unlisted(PAGE, [three, three._replace(file="test_two.py")]) == ["test_three.py"]
    assert rows(tables.rewritten(PAGE, [three], {"test_three.py": True})) == []


def test_every_file_with_figures_stands_in_one_table():
    listed = re.findall(r"<!-- figures: ([^>]*?) -->", tables.README.read_text(encoding="utf-8"))
    names = [name for line in listed for name in line.split()]
    files = {path.name: path.read_text(encoding="utf-8") for path in TESTS.rglob("test_*.py")}
    using = {name for name, text in files.items() if re.search(r"(?<![.\w])figure\(", text)} - {Path(__file__).name}
    assert len(names) == len(set(names)) and using <= set(names) <= set(files)


def test_figures_are_asserted_in_every_run(figure, request):
    figure("nothing", "zero", [0.0, -1e-3], 2e-3)
    figure("nothing", "rate", [2.1, 2.2], at_least=2.0)
    with pytest.raises(AssertionError, match=r"allowed is 0\.002"):
        figure("nothing", "zero", [0.0, -3e-3], 2e-3)
    with pytest.raises(AssertionError, match="allowed is 2"):
        figure("nothing", "rate", [2.1, 1.9], at_least=2.0)
    with pytest.raises(AssertionError):
        figure("nothing", "lost", float("nan"), 1.0)
    assert [name for name, _ in request.node.user_properties] == ["figure"] * 4
    request.node.user_properties.clear()  # these are none for a table
