"""What the pages and the README show is run: examples as they are, Python as it stands on each page from top to bottom."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support import file_list, pages
from tests.support.campaigns import sampled
from tests.support.forks import forks

TOP = Path(__file__).parents[2]
SITE = TOP / "docs" / "pages"
EXAMPLES = sorted((TOP / "docs" / "examples").glob("*.py"))
TEXTS = [TOP / "README.md", TOP / "CHANGELOG.md", *sorted(SITE.rglob("*.md"))]


def blocks(page):
    """Python blocks of a page; files of ``docs/examples`` are shown in blocks that begin with ``{ .python }``."""
    return re.findall(r"^```python\n(.*?)^```", page.read_text(), re.DOTALL | re.MULTILINE)


PAGES = [page for page in TEXTS if blocks(page)]
LARGEST_PICTURE = 120_000
"""Bytes of a picture in the gallery."""
MOST_COLUMNS = 79
MOST_FILES = 5
"""That a reader opens for one question."""


@pytest.fixture(scope="module")
def run():
    """Return a function that runs a Python file in a folder to its good end, and gives what it printed."""
    with forks() as forked:

        def to_the_end(file, folder):
            done = forked([file], folder)
            assert done.status == 0, done.err
            return done.out

        yield to_the_end


def test_there_are_examples_and_pages():
    assert len(EXAMPLES) >= 8 and {page.name for page in PAGES} >= {"README.md", "python.md", "notebook.md"}


EXAMPLES_BY_DEFAULT = [path for path in EXAMPLES if path.stem in ("disk",)]
PAGES_BY_DEFAULT = [path for path in PAGES if path.stem in ("README",)]
"""The others run in campaigns."""
COARSER = {"pneunet": ("cell_size=0.004", "cell_size=0.006")}
"""A mesh with which an example's assertion holds too, in half the time."""


@pytest.mark.parametrize("example", sampled(EXAMPLES, EXAMPLES_BY_DEFAULT), ids=lambda path: path.stem)
def test_examples_assert_a_number_and_draw_a_picture(example, run, tmp_path):
    text = example.read_text()
    assert re.search(r"^assert ", text, re.MULTILINE)
    words = COARSER.get(example.stem, ("", ""))
    assert words[0] in text
    (tmp_path / example.name).write_text(text.replace(*words))
    assert run(tmp_path / example.name, tmp_path).strip() and (tmp_path / f"{example.stem}.png").stat().st_size > 10_000


FEW = """from measurement import photographer
from tests.support.photographs.scenes import COARSE

photographer.HEIGHTS, photographer.SCENE = photographer.HEIGHTS[[0, 4, 9]], COARSE
"""
"""Three of the demonstration's thirteen photographs, with a quarter of their pixels."""


@pytest.mark.parametrize("page", sampled(PAGES, PAGES_BY_DEFAULT), ids=lambda path: path.stem)
def test_python_on_pages_runs(page, run, tmp_path):
    text = "\n".join(blocks(page))
    (tmp_path / "page.py").write_text(FEW * ("make_photographs" in text) + text)
    run(tmp_path / "page.py", tmp_path)


FENCE = re.compile(r"^```([^\n]*)\n(.*?)^```", re.DOTALL | re.MULTILINE)
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
LEFT, SECONDS = re.compile(r", about \d[\d.]* s left"), re.compile(r" \d[\d.]* s\b")
"""Of one machine at one time."""


def sessions(page):
    """Commands of a page in order, each list with the lines that the page shows as its output: a block of commands is followed
    by its output, or a block of output begins with its command."""
    found, last = [], None
    for language, body in FENCE.findall(page.read_text()):
        if language.strip() == "sh":
            found.append(([line for line in pages.commands(body) if line.startswith("uv run ")], [], False))
        elif not language.strip() and body.startswith("$ uv run "):
            command, *lines = body.splitlines()
            found.append(([command.removeprefix("$ ")], lines, True))
        elif not language.strip() and last == "sh":
            found[-1][1].extend(body.splitlines())
        last = language.strip()
    if not any(lines and not alone for _, lines, alone in found):  # what needs no earlier command
        return [(commands, lines) for commands, lines, alone in found if alone]
    while not found[-1][1]:
        found.pop()
    return [(commands, lines) for commands, lines, _ in found]


def same(documented, printed):
    """Whether a printed line is the documented one: words are equal, numbers to the last digit that is shown; dots stand for
    anything, and seconds do not count."""
    documented, printed = (" ".join(SECONDS.sub(" _ s", LEFT.sub("", line)).split()) for line in (documented, printed))
    words = [re.escape(part) for part in re.split(r"\s*…\s*", NUMBER.sub("\0", documented))]
    pattern = ".*".join(words).replace("\0", rf"({NUMBER.pattern})")
    found = re.fullmatch(pattern, printed)
    if not found:
        return False
    for shown, number in zip(NUMBER.findall(documented), found.groups(), strict=True):
        digits = len(shown.partition("e")[0].partition(".")[2])
        power = int(shown.partition("e")[2] or 0)
        if abs(float(shown) - float(number)) > 1.01 * 10.0 ** (power - digits):
            return False
    return True


def test_lines_are_the_same_to_the_digits_shown():
    line = "step  13   177.000 cm  apex rise   +3.944 mm   2 iterations    29.3 s, about 0 s left"
    assert same(line, "step 13 177.000 cm apex rise +3.943 mm 2 iterations 7.1 s")
    assert not same(line, "step 13 177.000 cm apex rise +3.940 mm 2 iterations 7.1 s")
    assert same("a 2.224 and … in results/disk … in 4.1 s", "a 2.2239 and b 5 in results/disk or so in 70 s")
    assert not same("a 2.224 and …", "a 2.224 or b")


def test_code_on_pages_is_not_cut_off():
    """Outputs and drawings, whose language is not named, are as wide as they are."""
    for page in TEXTS:
        for language, body in FENCE.findall(page.read_text()):
            if language in ("sh", "toml", "python"):
                long = [line for line in body.splitlines() if len(line) > MOST_COLUMNS]
                assert not long, f"{page.relative_to(TOP)}: {long}"


DOCUMENTED = [page for page in TEXTS if sessions(page)]


def test_outputs_are_documented():
    assert {page.name for page in DOCUMENTED} >= {"first-hour.md", "disk.md", "reports.md"}


@pytest.mark.campaign
@pytest.mark.parametrize("page", DOCUMENTED, ids=lambda path: path.stem)
def test_commands_print_what_the_page_shows(page, tmp_path):
    """In an empty folder, from the page's first command to the last one whose output is shown."""
    missing = []
    for commands, lines in sessions(page):
        printed = []
        for command in commands:
            if " open " not in command:  # a browser
                words = re.sub(r"--extra \w+ ", "", command).replace("uv run softmodels", "uv run python -m softmodels")
                done = subprocess.run(
                    words.replace("uv run python", sys.executable), shell=True, executable="/bin/bash", cwd=tmp_path,
                    stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False,
                )  # fmt: skip
                printed += done.stdout.splitlines()
        for line in filter(lambda line: line.strip(" …"), lines):
            where = next((k for k, one in enumerate(printed) if same(line, one)), None)
            if where is None:
                missing.append(f"{line}\n  of: {commands}")
            else:
                del printed[where]
    assert not missing, "\n".join(missing)


def test_each_thing_that_can_be_added_is_checked_on_its_page():
    sections = re.split(r"^## ", (SITE / "howto" / "extending.md").read_text(), flags=re.MULTILINE)[1:]
    added = "law", "device", "component", "load", "supply", "output", "quantity"
    for word, section in zip(added, sections, strict=True):
        heading, _, text = section.partition("\n")
        registered = "register_" in text or re.search(r"^class \w+\(\w+, name=", text, re.MULTILINE)
        assert word in heading and registered and re.search(r"^assert np\.", text, re.MULTILINE), heading


def test_each_example_is_on_a_page_beside_its_picture():
    shown = {}
    for page in SITE.rglob("*.md"):
        for name in re.findall(r'--8<-- "(\w+)\.py"', page.read_text()):
            shown[name] = page.read_text()
    assert set(shown) == {example.stem for example in EXAMPLES}
    for name, text in shown.items():
        assert f"img/gallery/{name}.png)" in text, name
        assert (SITE / "img" / "gallery" / f"{name}.png").stat().st_size < LARGEST_PICTURE, name


COUNT = """
import atexit, runpy, sys
def told():
    print(sum(name.split(".")[0] in ("softmodels", "geometries", "measurement") for name in sys.modules))
atexit.register(told)
sys.argv = ["disk", "--section=axisymmetric", "--pressure-cm=0,5", "--quiet", "--no-pictures", "--output=disk"]
runpy.run_module("softmodels.disk", run_name="__main__", alter_sys=True)
"""


def test_no_run_imports_more_files_than_the_architecture_page_says(tmp_path):
    text = (SITE / "explanation" / "architecture.md").read_text()
    (tmp_path / "count.py").write_text(COUNT)
    done = subprocess.run([sys.executable, "count.py"], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert int(done.stdout.split()[-1]) <= int(re.search(r"imports (\d+) files", text)[1])


def test_every_file_is_listed_by_its_first_sentence():
    assert file_list.PAGE.read_text().endswith(file_list.written()), "python -m tests.support.file_list"


def test_a_question_about_the_code_is_answered_by_few_files_that_are_there():
    text = (SITE / "explanation" / "architecture.md").read_text()
    lists = [re.findall(r"`([\w/]+\.py)`", line) for line in text.splitlines() if line.startswith("Files: ")]
    assert len(lists) > 12 and all(0 < len(files) == len(set(files)) <= MOST_FILES for files in lists)
    assert [file for files in lists for file in files if not (TOP / file).is_file()] == []


def test_the_readmes_test_command_is_that_of_every_change():
    """And what it leaves out by default comes after it."""
    (command,) = [line for line in pages.pasted(TOP / "README.md") if "pytest" in line.split()]
    lines = (TOP / ".ci" / "run").read_text().splitlines()
    assert [line for line in lines if " pytest " in line] == [command, f"{command} -m campaign"]


def test_links_and_pictures_lead_somewhere():
    for page in TEXTS:
        text = re.sub(r"^ *```.*?^ *```", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
        for target in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", text):
            if "://" not in target and not target.startswith("mailto:") and "/reference/" not in f"/{target}":
                folder = TOP / "docs" if page.name == "gallery.md" and target.startswith("examples/") else page.parent
                assert (folder / target).exists(), f"{page.relative_to(TOP)}: {target}"


def test_pages_load_nothing_from_the_network():
    for page in SITE.rglob("*.md"):
        assert not re.search(r"!\[[^\]]*\]\(https?:|<(script|link|iframe|img)\b", page.read_text()), page.name
    assert re.search(r"^  font: false", (TOP / "docs" / "mkdocs.yml").read_text(), re.MULTILINE)
