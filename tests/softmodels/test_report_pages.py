"""What all reports share: one style, answer first, escaped texts, units that change on the page, and no network."""

from __future__ import annotations

import io
import json
import re

import pytest
from PIL import Image

from softmodels.common import commands, pages
from softmodels.common.commands import Provenance
from softmodels.common.files import data_uri
from softmodels.common.pages import (
    Bullets,
    Cell,
    Charts,
    Fact,
    Folded,
    Gallery,
    Listing,
    Page,
    Picture,
    Program,
    Table,
    Terms,
    Text,
    inline_svg,
)

EVIL = "<script>alert(1)</script>"
UNITS = {"kPa": 1000.0, "mbar": 100.0, "psi": 6894.757293168}


def page(words="plain", **more):
    """A page with every kind of part, each with these words in it."""
    drawing = inline_svg('<svg><path style="fill: #000000"/><g id="pu-cm"></g><g id="pu-kPa"></g></svg>')
    sections = [
        (
            words,
            [Text(words, alarm=True), Bullets([words]), Bullets([words], alarm=True), Bullets([words], ordered=True)],
        ),
        ("Table", [Table([[words, Cell("20", "20.0", 1902.488)]], (words, Cell("pressure (cm)", words, unit="cm")))]),
        (
            "Pictures",
            [Picture("data:,", words, "data:,"), Gallery([Picture("data:,", words)]), Charts([(words, drawing)])],
        ),
        ("Rest", [Terms([(words, words, words)]), Listing(words), Folded(words, [Text(words)]), Program("")]),
        ("Nothing", [None, Bullets([]), Text("")]),
    ]
    made = Provenance("2026-01-02 03:04 UTC", "1.0", "abc+", {"PETSc": words}, 2.0, words)
    given = {"facts": [Fact(words, words, words, alarm=True)], "warnings": [words], "sources": [words],
             "downloads": {"path.csv": words}, **more}  # fmt: skip
    return Page(words, words, sections, made, **given).html()


def test_words_are_escaped_wherever_they_stand():
    text = page(EVIL)
    assert EVIL not in text and text.count("&lt;script&gt;alert(1)&lt;/script&gt;") > 20
    assert "Nothing" not in text, "a section without content"


def test_a_page_needs_no_network_and_fits_a_phone_the_dark_and_paper():
    text = page()
    addresses = re.findall(r'(?:src|href)="([^"]*)"', text)
    assert len(addresses) >= 5 and all(address.startswith("data:") for address in addresses)
    assert not re.search(r"https?:|@import|fetch\(|XMLHttpRequest", text)
    for rule in (r"prefers-color-scheme:dark", r"@media print", r"@media \(max-width", r"img\{max-width:100%",
                 r"svg\{max-width:100%", r"\.wide\{[^}]*overflow-x:auto"):  # fmt: skip
        assert re.search(rule, text), rule
    assert 'name="viewport" content="width=device-width' in text
    assert all(text[: found.start()].endswith('<div class="wide">') for found in re.finditer(r"<table", text))


def test_a_warning_is_told_by_words_and_its_role_not_by_colour_only():
    text = page("mind the gap")
    assert '<section class="warn" role="alert"><p>Warning</p>' in text and "<b>Warning:</b> mind the gap" in text
    assert "<span>Warning: mind the gap</span>" in text


def test_where_it_comes_from_is_read_back_and_never_needed(monkeypatch):
    made = Provenance("now", "1.0", "abc", {"PETSc": "3.25"}, 2.5, "softmodels run 'a b.toml'")
    assert Provenance.from_table(json.loads(json.dumps(made.table()))) == made
    for odd in (None, [], {"date": 5, "libraries": 3, "seconds": "x"}):
        assert Provenance.from_table(odd).rows == [("origin", "not recorded in this folder")]
    monkeypatch.setenv("PATH", "")  # no git
    commands.commit.cache_clear()
    assert commands.commit() == "" and Provenance.now().version
    commands.commit.cache_clear()


@pytest.mark.parametrize("unit", UNITS)
def test_units_have_their_factors(unit):
    assert pages.pascal(unit) == pytest.approx(UNITS[unit], rel=1e-9)


def test_the_unit_of_pressure_changes_in_texts_tables_and_charts(browser, tmp_path):
    """Once in a browser that is offline: 20 cm, 0.97 g/ml are 0.2759 psi, and lengths, moduli and exact values stay."""
    words = "At 20 cm, 0.97 g/ml (1.9 kPa), 5, 10 and 20 cm, x = 2 cm, 3 kPa and 4 mm"
    (tmp_path / "page.html").write_text(page(words))
    context = browser.new_context(offline=True)
    shown, asked = context.new_page(), []
    shown.on("request", lambda request: asked.append(request.url))
    shown.goto((tmp_path / "page.html").as_uri())
    asked = [address for address in asked if not address.startswith(("data:", "file:"))]
    lead, cell, chart = shown.locator(".lead"), shown.locator("[data-pa]"), shown.locator("svg .pu")
    assert lead.text_content() == words and cell.text_content() == "20"
    assert [chart.nth(k).evaluate("e => getComputedStyle(e).display") for k in (0, 1)] == ["inline", "none"]
    shown.select_option("#units", "psi")
    psi = [f"{value * 95.12449 / 6894.757293168:.4g}" for value in (5, 10, 20)]
    assert lead.text_content() == f"At {psi[2]} psi, {psi[0]}, {psi[1]} and {psi[2]} psi, x = 2 cm, 3 kPa and 4 mm"
    assert float(cell.text_content()) == pytest.approx(1902.488 / 6894.757293168, rel=1e-5)
    assert shown.locator("[data-pu]").text_content() == "pressure (psi)"
    shown.select_option("#units", "kPa")
    assert [chart.nth(k).evaluate("e => getComputedStyle(e).display") for k in (0, 1)] == ["none", "inline"]
    with shown.expect_download() as saved:
        shown.locator("figure[data-name] button").click()
    drawing = saved.value.path().read_text()
    assert "#000000" in drawing and "pu-kPa" in drawing and "pu-cm" not in drawing
    shown.select_option("#units", "cm")
    assert lead.text_content() == words and cell.text_content() == "20" and asked == []
    context.close()


def test_all_pictures_are_loaded_before_anybody_has_scrolled(browser, tmp_path):
    """So that they are printed: a browser loads lazy ones only where the window is near."""
    file, count = tmp_path / "report.html", 120
    shown = [Picture(square(number), f"picture {number}") for number in range(count)]
    file.write_text(Page("report", "", [("pictures", shown)], Provenance()).html())
    context = browser.new_context(viewport={"width": 800, "height": 300}, offline=True)
    opened = context.new_page()
    opened.goto(file.as_uri())
    assert opened.evaluate("[...document.images].map(one => one.complete && one.naturalWidth)") == [400] * count
    assert opened.pdf().count(b"/Subtype /Image") == count
    context.close()


def square(number):
    """A picture of one grey."""
    data = io.BytesIO()
    Image.new("L", (400, 400), 2 * number).save(data, "PNG")
    return data_uri(data.getvalue(), "image/png")
