"""The page in a real browser: what it shows is what Python computes."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

import softmodels as sm
from geometries import ACTUATORS
from softmodels.app import answers, forms
from softmodels.case.case import Case
from softmodels.case.load import steps_of
from tests.app.conftest import served, tab, value
from tests.support.campaigns import sampled

NUMBER = re.compile(r"-?[0-9][0-9.]*(?:e-?[0-9]+)?")
DEVICE = sm.HollowDisk(section="axisymmetric", membrane=5e-3)


def number(text):
    return float(NUMBER.search(text)[0])


@pytest.mark.campaign
def test_a_changed_length_gives_what_python_gives(page):
    page.locator('[data-name="membrane"]').first.wait_for()
    page.get_by_label("membrane", exact=True).first.fill("5 mm")
    page.get_by_label("membrane", exact=True).first.press("Tab")
    page.locator("svg.section").wait_for()
    page.wait_for_function("document.querySelector('[data-name=\"rise of the apex\"]')")
    run = sm.inflate(DEVICE, "ecoflex-00-30", "0:60 cm")
    wanted = run.at("60 cm").row
    page.wait_for_function(
        "wanted => Math.abs(parseFloat(document.querySelector('[data-name=\"rise of the apex\"]')?.textContent) - wanted)"
        " < 1e-3 * wanted",
        arg=wanted["apex_mm"],
    )
    assert number(value(page, "rise of the apex")) == pytest.approx(wanted["apex_mm"], rel=5e-4)
    assert number(value(page, "added volume")) == pytest.approx(wanted["added_volume_ml"], rel=5e-4)
    assert number(value(page, "largest stretch")) == pytest.approx(wanted["max_stretch"], rel=5e-4)
    limit = sm.limit(DEVICE, "ecoflex-00-30")
    assert number(value(page, "limit").partition(" at ")[2] or value(page, "limit").partition(" to ")[2]) == pytest.approx(
        limit.pressure / Case("x", DEVICE, "ecoflex-00-30", steps=steps_of(pressure_cm=(1.0,))).column.pascal, rel=5e-4
    )


def test_the_error_stands_under_the_slider(page):
    """The number at the highest pressure with its interval, and what it is made of; of the silicone's sources and the mesh."""
    page.wait_for_function("document.querySelector('[data-name=\"error\"]')?.textContent.includes('(95 %)')")
    said = value(page, "error")
    run = sm.inflate(sm.HollowDisk(section="axisymmetric"), "ecoflex-00-30", "0:60 cm", band="ecoflex-00-30", mesh_error=True)
    (line, *_), (first, *_) = run.budget.lines(), run.budget.contributions(run.table[-1], "apex")
    assert said.startswith("at 60 cm") and said.endswith(line.replace("+-", "±"))
    assert f": {first.text} " in said and first.text == "silicone"
    assert not BARE_COLUMN.search(value(page, "spread"))


def test_the_colours_end_at_the_largest_stress_of_the_table(page):
    """At the highest pressure, where the slider stands first."""
    largest = value(page, "largest von Mises stress")
    assert page.locator(".colour-bar span").last.text_content().startswith(f"{largest}, von Mises stress")


TEXTS = """all => all.filter(one => !one.closest("code, textarea, i") && !one.querySelector("textarea"))
  .flatMap(one => [...one.childNodes].filter(node => node.nodeType == 3).map(node => node.data)
           .concat(one.ariaLabel ?? "", one.value ?? ""))"""
"""What stands on the page, hints and choices too, but for the log and the files as they are."""
BARE_COLUMN = re.compile(r"[1-9][\d.]* *cm(?!, [\d.]+ g/ml)\b")
CLASSES = "|".join(name for name in ACTUATORS if re.search("[a-z][A-Z]", name) and name not in forms.OWN_SPELLINGS)
INTERNAL = re.compile(rf"\b(?:{CLASSES})\b|\b[a-z]+_[a-z_]+|\bof case\.toml|(?<!\S)--[a-z]")


def test_texts_name_the_liquid_and_no_internal_names(browser, tmp_path):
    """Boxes that are typed into have the liquid in their label."""
    project, law = tmp_path / "project", sm.NeoHookean(20e3)
    project.mkdir()
    case = Case("device", sm.HollowDisk(section="axisymmetric"), law, steps=steps_of(pressure_cm="0:60"))
    (project / "case.toml").write_text(case.to_toml())
    with served(project) as (_, address), tab(browser, address) as page:
        assert value(page, "limit") and value(page, "error")
        assert page.locator('input[data-name="silicone"]').input_value() == "Neo-Hookean with its own numbers"
        for name in ("Start", "Photographs", "Material", "Device", "Overlay", "Design", "Mould"):
            page.get_by_role("tab", name=name).click()
            page.wait_for_timeout(400)
            lists = page.locator(".q-tab-panel .q-select:visible").all() if name in ("Device", "Design") else []
            for opened in [None, *lists]:
                if opened is not None:
                    opened.click()
                    page.locator(".q-menu").wait_for()
                shown = page.locator(".q-tab-panel *, .q-menu *, header *").evaluate_all(TEXTS)
                texts = {text.strip() for text in shown} - {"0:60 cm", "60 cm"}
                wrong = [text for text in texts if BARE_COLUMN.search(text) or INTERNAL.search(text)]
                assert not wrong and len(texts) > 10, (name, wrong)
                page.keyboard.press("Escape")


def test_an_impossible_length_is_told_in_place_and_changes_nothing(page):
    box = page.get_by_label("membrane", exact=True).first
    before = value(page, "rise of the apex")
    box.fill("-3 mm")
    box.press("Tab")
    assert "membrane is" in value(page, "message")
    assert value(page, "rise of the apex") == before


@pytest.mark.campaign
def test_two_tabs_show_the_same(browser, server, page):
    with tab(browser, server) as other:
        page.get_by_label("wall", exact=True).first.fill("12 mm")
        page.get_by_label("wall", exact=True).first.press("Tab")
        other.wait_for_function(
            "document.querySelector('[data-name=\"wall\"] input, input[data-name=\"wall\"]')?.value == '12 mm'"
        )


@pytest.mark.campaign
def test_the_python_lines_shown_do_the_same(page):
    rise = number(value(page, "rise of the apex"))
    page.get_by_text("The same in a terminal").click()
    assert re.search(r"uv run softmodels run /\S+/project/case.toml", value(page, "terminal"))
    namespace = {}
    exec(page.locator('[data-name="python"] code').inner_text(), namespace)
    assert namespace["run"].apex[-1] * 1e3 == pytest.approx(rise, rel=5e-4)


@pytest.mark.campaign
def test_what_is_no_photograph_is_told(page, tmp_path):
    page.get_by_role("tab", name="Photographs").click()
    bad = []
    for name, data in {
        "empty.jpg": b"", "text.png": b"not a picture", "half.jpg": b"\xff\xd8\xff\xe0" + bytes(40), "<b>.jpg": b"x",
    }.items():  # fmt: skip
        (tmp_path / name).write_bytes(data)
        bad.append(tmp_path / name)
    for file in bad:
        page.locator('[data-name="drop"] input[type=file]').set_input_files(file)
        page.wait_for_function(
            "name => document.querySelector('[data-name=\"photo-message\"]')?.textContent.startsWith(name)",
            arg=f"{file.name}:",
        )
    page.wait_for_function("!document.querySelector('.q-uploader__file')")
    (tmp_path / "a.exe").write_bytes(b"MZ")
    page.locator('[data-name="drop"] input[type=file]').set_input_files(tmp_path / "a.exe")
    page.wait_for_function("document.querySelector('[data-name=\"photo-message\"]')?.textContent.startsWith('not taken')")
    assert page.locator('button:has-text("empty.jpg")').count() == 0


@pytest.mark.campaign
def test_a_killed_server_resumes_its_job(browser, tmp_path):
    """Its results are those of a run that was left alone."""
    import signal
    import time

    project = tmp_path / "project"
    project.mkdir()
    disk = sm.HollowDisk(cell_size=6e-3, refinement=1.0)
    case = Case("device", disk, sm.Yeoh(14e3, 60.0), steps=steps_of(pressure_cm=tuple(range(0, 60, 3))))
    (project / "case.toml").write_text(case.to_toml())
    rows = project / "results" / "device" / "path.csv"
    with served(project, stop=signal.SIGKILL) as (_, address), tab(browser, address) as page:
        page.get_by_role("button", name="Run with all pictures").click()
        for _ in range(1200):
            if rows.exists() and len(rows.read_text().splitlines()) > 3:
                break
            time.sleep(0.1)
    before = len(rows.read_text().splitlines())
    assert 3 < before < 21
    with served(project) as (_, address), tab(browser, address) as page:
        page.wait_for_function("document.querySelector('[data-name=\"state-results/device\"]')?.textContent == 'done'")
        shown = [value(page, "rise of the apex")]
        page.wait_for_function("document.querySelector('img.stored')?.naturalWidth > 0")
        page.get_by_label("membrane", exact=True).first.fill("6.2 mm")
        page.get_by_label("membrane", exact=True).first.press("Tab")
        page.wait_for_function("document.querySelector('[data-name=\"rise of the apex\"]')?.textContent.endsWith('(linear)')")
        shown.append(value(page, "rise of the apex"))
    alone = sm.run(case)
    found = sm.load(project / "results" / "device")
    assert found.apex == pytest.approx(alone.apex, rel=1e-6)
    pressure = float(found.pressure[-1])
    linear = answers.linear(str(project / "results" / "device"), pressure)
    assert number(shown[0]) == pytest.approx(found.apex[-1] * 1e3, rel=5e-4) and "(linear)" not in shown[0]
    assert number(shown[1]) == pytest.approx(linear.at(pressure, {"membrane": 0.2e-3})["apex_mm"], rel=5e-4)


FOREIGN = """<!doctype html><title>report</title><p id="told">nothing yet</p><img src="/files/mine.png"><script>
const told = [];
for (const [name, attempt] of [["page", () => parent.document.title], ["cookie", () => document.cookie],
                               ["storage", () => localStorage.length]])
  try { attempt(); told.push(name) } catch {}
fetch("/files/case.toml").then(() => told.push("file"), () => 0)
  .then(() => fetch("https://evil.example", {mode: "no-cors"})).then(() => told.push("network"), () => 0)
  .then(() => document.getElementById("told").textContent = `reached: ${told}`);
</script>"""


@pytest.mark.campaign
def test_a_foreign_project_is_shown_and_neither_runs_nor_reaches_anything(browser, tmp_path):
    project, hit = tmp_path / "project", tmp_path / "hit"
    (project / "jobs").mkdir(parents=True)
    (project / "results" / "device").mkdir(parents=True)
    (project / "results" / "device" / "report.html").write_text(FOREIGN)
    words = ["timeit", "-n1", "-r1", f"open({str(hit)!r}, 'w')"]
    job = {"number": 1, "words": words, "output": "results/device", "resumable": False, "state": "running"}
    (project / "jobs" / "1.json").write_text(json.dumps(job))
    with served(project) as (_, address), tab(browser, address) as page:
        assert value(page, "state-results/device") == "recorded elsewhere, not run"
        frame = page.frame_locator("iframe")
        frame.locator("#told", has_text="reached:").wait_for()
        assert frame.locator("#told").text_content() == "reached: "
        opened = page.context.new_page()  # by its own address, outside of the page's frame
        opened.goto(f"{address.partition('?')[0]}files/results/device/report.html")
        opened.locator("#told", has_text="reached:").wait_for()
        assert opened.locator("#told").text_content() == "reached: page"  # of itself, which is no other page
    assert not hit.exists()


@pytest.mark.campaign
def test_an_own_report_works_within_the_page(browser, tmp_path):
    """Its program runs, its pictures load, its tables can be saved."""
    project = tmp_path / "project"
    disk = sm.HollowDisk(section="axisymmetric", cell_size=6e-3, refinement=1.0)
    case = Case("device", disk, sm.Yeoh(14e3, 60.0), steps=steps_of(pressure_cm=(0.0, 20.0)))
    project.mkdir()
    (project / "case.toml").write_text(case.to_toml())
    with served(project) as (_, address), tab(browser, address) as page:
        page.get_by_role("button", name="Run with all pictures").click()
        page.wait_for_function("document.querySelector('[data-name=\"state-results/device\"]')?.textContent == 'done'")
        frame = page.frame_locator("iframe")
        frame.locator("#units").select_option("kPa")
        assert frame.locator("html").get_attribute("data-unit") == "kPa"
        assert frame.locator("img").evaluate_all("all => Promise.all(all.map(one => one.decode())).then(all => all.length)") > 3
        with page.expect_download() as saved:
            frame.get_by_text("path.csv").first.click()
        assert saved.value.suggested_filename == "path.csv"


@pytest.mark.campaign
def test_axe_finds_nothing_serious(browser, server):
    """In light colours everything, in dark ones the contrast."""
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    contrast = {"runOnly": {"type": "rule", "values": ["color-contrast"]}}
    with tab(browser, server, color_scheme="light") as page:
        page.locator("svg.section").wait_for()
        for name in ("Photographs", "Material", "Device", "Overlay", "Design", "Mould"):
            page.get_by_role("tab", name=name).click()
            assert name != "Material" or page.locator('input[data-name="poisson"]').input_value() == "0.5"
            for scheme, rules in (("light", {}), ("dark", contrast)):
                page.emulate_media(color_scheme=scheme)
                page.wait_for_function(f"document.body.classList.contains('body--{scheme}')")
                page.wait_for_timeout(400)  # colours fade
                found = axe.run(page, {"exclude": [[".q-loading-bar"]]}, rules).response["violations"]
                found = [one for one in found if one["impact"] in ("serious", "critical")]
                assert not found, (scheme, [(one["id"], [node["html"] for node in one["nodes"]]) for one in found])


@pytest.mark.parametrize("width", sampled([390, 1280]))
def test_nothing_sticks_out(browser, server, width):
    with tab(browser, server, viewport={"width": width, "height": 844}) as page:
        page.locator("svg.section").wait_for()
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        slider, form = (page.locator(f'[data-name="{name}"]').first.bounding_box() for name in ("pressure", "device"))
        assert slider["y"] < form["y"] if width < 900 else form["x"] + form["width"] < slider["x"]


@pytest.mark.campaign
def test_files_stay_in_the_project(page, server):
    address = server.partition("?")[0]
    for path in ("files/../../../../etc/passwd", "files/%2e%2e/%2e%2e/etc/passwd", "files//etc/passwd"):
        assert "root:" not in page.request.get(f"{address}{path}").text()
    assert "root:" in Path("/etc/passwd").read_text()
