"""The site: a reference page for each public name and nothing private, a build without warnings that needs no network."""

from __future__ import annotations

import doctest
import importlib.util
import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest

import geometries
import measurement
import softmodels

DOCS = Path(__file__).parents[2] / "docs"
LOADED = re.compile(r"<(?:script|link|img|iframe)\b[^>]*(?:src|href)=\"(?:https?:)?//[^>]*>")


@pytest.fixture(scope="module")
def reference():
    spec = importlib.util.spec_from_file_location("reference", DOCS / "reference.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_each_public_name_has_a_page_and_is_listed_once(reference):
    public = [name for name in softmodels.__all__ if not name.startswith("_")]
    grouped = [name for names in reference.groups().values() for name in names]
    assert sorted(grouped) == sorted(public)
    pages = reference.pages()
    assert {reference.place(name) for name in public} <= set(pages)
    assert len({path.lower() for path in pages}) == len(pages), "two pages differ by case only"


SHOWN_ON_PAGES = {
    "DesignProblem", "ImportedActuator", "ImportedMesh", "ReducedModel", "Study", "export", "fit", "fit_heights", "mould",
    "optimise", "study",
}  # fmt: skip
"""Names whose example needs a file or a minute: the how-to pages show them, and run."""


def test_each_public_name_has_an_example(reference):
    public = [name for name in softmodels.__all__ if not name.endswith(("Error", "Warning")) and name[0] != "_"]
    assert {*public} - SHOWN_ON_PAGES == {*reference.examples()}


def test_examples_of_names_print_what_they_say(reference, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, code in reference.examples().items():
        test = doctest.DocTestParser().get_doctest(f"{code}\n", {"sm": softmodels}, name, None, None)
        assert doctest.DocTestRunner(verbose=False).run(test).failed == 0, name


def test_arguments_of_devices_and_laws_are_explained(reference):
    for name in ("HollowDisk", "Yeoh", "Rigid", "Case"):
        assert "| argument |" in reference.fields_table(getattr(softmodels, name)), name
    assert "| `spectral_radius` | `0.9` |" in reference.fields_table(softmodels.inflate)
    assert "\n    spectral_radius: " in inspect.getdoc(softmodels.inflate)
    assert reference.fields_table(softmodels.run) == ""


def test_each_documented_argument_is_one_of_its_function():
    """Of several in one line the reference would say that they are required, and no default."""
    several = []
    for module in (softmodels, measurement, geometries):
        for name in module.__all__:
            thing = getattr(module, name)
            own = vars(thing).values() if inspect.isclass(thing) else ()
            for function in (thing, *(one for one in own if inspect.isfunction(one))):
                arguments = re.search(r"^Args:\n((?:    .*\n|\n)*)", f"{inspect.getdoc(function)}\n", re.MULTILINE)
                listed = re.findall(r"^    (\w+, [\w, ]+):", arguments[1], re.MULTILINE) if arguments else []
                several += [f"{function.__qualname__}: {names}" for names in listed]
    assert several == []


def test_site_builds_without_warnings_and_needs_no_network(tmp_path):
    pytest.importorskip("mkdocs", reason="uv sync --group docs brings MkDocs")
    words = ["-m", "mkdocs", "build", "--strict", "-q", "-f", str(DOCS / "mkdocs.yml"), "-d", str(tmp_path / "site")]
    done = subprocess.run([sys.executable, *words], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    pages = list((tmp_path / "site").rglob("*.html"))
    assert len(pages) > 80
    notebook = (tmp_path / "site" / "notebooks" / "photographs-to-material.html").read_text()
    assert "FitReport of yeoh: c1 14." in notebook and notebook.count('src="data:image/') == 3  # the stored outputs
    for page in pages:
        loaded = [tag for tag in LOADED.findall(page.read_text()) if 'rel="canonical"' not in tag]
        assert not loaded, f"{page}: {loaded}"
