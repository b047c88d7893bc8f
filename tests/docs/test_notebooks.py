"""The notebooks of the pages: they run, their figures are those of the same calls in Python, and they store what they show."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import numpy as np
import pytest

import softmodels as sm

nbclient = pytest.importorskip("nbclient", reason="nbclient is not installed")
nbformat = pytest.importorskip("nbformat", reason="nbclient is not installed")
pytest.importorskip("ipykernel", reason="ipykernel is not installed")

FOLDER = Path(__file__).parents[2] / "docs" / "pages" / "notebooks"
NAMES = ["first-hour", "photographs-to-material", "study"]
LARGEST = 250_000
"""Bytes of a notebook with its outputs."""


INTERRUPTED = """
import os, signal

def interrupt(row):
    if row["step"] == 2:
        os.kill(os.getpid(), signal.SIGINT)  # what the notebook's stop button sends

sm.inflate(disk, "ecoflex-00-30", "0:100 cm", progress=interrupt)
"""


def executed(name, folder, asked, *before):
    """A notebook executed in a folder, and the values there of some expressions, by their names; before these, further cells,
    which may fail."""
    book = nbformat.read(FOLDER / f"{name}.ipynb", 4)
    book.cells += [nbformat.v4.new_code_cell(cell, metadata={"tags": ["raises-exception"]}) for cell in before]
    book.cells.append(nbformat.v4.new_code_cell(f"import json; print(json.dumps(dict({asked})))"))
    own = {"OMP_NUM_THREADS": "1", "JUPYTER_PLATFORM_DIRS": "1", "IPYTHONDIR": str(folder / "ipython")}
    nbclient.NotebookClient(book, timeout=600, kernel_name="python3", resources={"metadata": {"path": str(folder)}}).execute(
        env=os.environ | own
    )
    return book, json.loads(book.cells.pop().outputs[0].text)


def printed(book):
    """What the cells of a notebook print, and the tables that they show as text."""
    outputs = [told for cell in book.cells if cell.cell_type == "code" for told in cell.outputs]
    return [told.get("text") or told.data.get("text/plain") for told in outputs]


def test_all_are_stored_with_their_outputs_and_stay_small():
    assert [path.stem for path in sorted(FOLDER.glob("*.ipynb"))] == NAMES
    for path in FOLDER.glob("*.ipynb"):
        assert path.stat().st_size < LARGEST, path.name
        cells = [cell for cell in nbformat.read(path, 4).cells if cell.cell_type == "code"]
        assert [cell.execution_count for cell in cells] == [*range(1, len(cells) + 1)], path.name
        assert not [told for cell in cells for told in cell.outputs if told.output_type == "error"], path.name


@pytest.mark.campaign
def test_the_first_hour(tmp_path):
    """It also goes on after it was interrupted."""
    asked = "rises=run.apex.tolist(), limit=limit.pressure, differs=mould.differs"
    book, found = executed("first-hour", tmp_path, f"{asked}, again=sm.inflate(disk, silicone, '5 cm').apex[-1]", INTERRUPTED)
    assert [told.ename for told in book.cells.pop().outputs] == ["KeyboardInterrupt"] and found["again"] > 1e-4
    disk, silicone = sm.HollowDisk(section="axisymmetric"), sm.Yeoh("14 kPa", "0.9 kPa")
    assert found["rises"] == pytest.approx(sm.inflate(disk, silicone, pressures="0:177 cm").apex, rel=1e-9, abs=1e-12)
    assert found["limit"] == pytest.approx(sm.limit(disk, silicone).pressure, rel=1e-9)
    assert found["differs"] < 1e-6
    bar, card = (told.data["text/html"] for told in book.cells[1].outputs)
    assert re.match(r'<progress value="1" max="1" [^>]*></progress> 177 cm of 177 cm: apex rise 3.91', bar)
    assert "<img" in card and f"{found['rises'][-1] * 1e3:.4g} mm" in card
    stored = nbformat.read(FOLDER / "first-hour.ipynb", 4)
    assert printed(book)[1:] == printed(stored)[1:]  # but for the object that draws the bar


@pytest.mark.campaign
def test_a_study(tmp_path):
    book, found = executed("study", tmp_path, "rises=study['apex rise in mm'].tolist(), limits=study['limit in kPa'].tolist()")
    rises, limits = (np.array(found[name]).reshape(3, 3) for name in ("rises", "limits"))
    assert (np.diff(rises) < 0).all() and (np.diff(limits) > 0).all()  # a thicker membrane rises less and can take more
    disk = sm.HollowDisk(section="axisymmetric", membrane=2e-3)
    assert rises[2, 0] == pytest.approx(1e3 * sm.inflate(disk, "dragon-skin-20", pressures="60 cm").apex[-1], rel=1e-6)
    assert printed(book) == printed(nbformat.read(FOLDER / "study.ipynb", 4))


@pytest.mark.campaign
def test_photographs_to_material(tmp_path):
    """The notebook itself asserts that the interval holds the truth and that the disk rises as far as the photographed one."""
    book, found = executed("photographs-to-material", tmp_path, "c1=report.material.c1, off=off, rows=len(measured.outlines)")
    assert found["c1"] == pytest.approx(14e3, rel=0.02) and len(found["off"]) == 5 and found["rows"] == 6
    assert f"c1 {found['c1'] / 1e3:.4g}"[:7] in printed(book)[2] and "<img" in book.cells[6].outputs[0].data["text/html"]
