"""The whole way of a maker on the page: from ten photographs to a mould, by clicks in Chromium, each step timed.

    python -m tests.benchmarks.maker [--output FOLDER] [--narrow] [--dark]

It writes a picture of the page after each step into the folder. Photographs and boards are those of ``softmodels examples``.
Found: 149 s on two busy cores (edges 22, outlines 35, fit 20, overlay 7, design 28, mould 14).
"""

from __future__ import annotations

import argparse
import contextlib
import re
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from playwright.sync_api import Page, expect, sync_playwright

from softmodels.cli.examples import write_examples
from tests.app.conftest import served
from tests.conftest import CHROMIUM

WAIT = 300e3
"""Milliseconds for the longest step."""


class Steps:
    """Times of the steps, and a picture of the page after each.

    Args:
        page: The tab.
        folder: Of the pictures.
        look: What the pictures' names end with.
    """

    def __init__(self, page: Page, folder: Path, look: str):
        self.page, self.folder, self.look = page, folder, look
        self.times: dict[str, float] = {}

    @contextlib.contextmanager
    def step(self, name: str) -> Iterator[None]:
        start = time.monotonic()
        yield
        self.times[name] = time.monotonic() - start
        print(f"{self.times[name]:7.1f} s  {name}", flush=True)
        self.page.wait_for_timeout(700.0)  # fonts and charts settle
        self.page.evaluate("window.scrollTo(0, 0)")
        file = self.folder / f"{len(self.times):02d}-{name.replace(' ', '-')}-{self.look}.png"
        self.page.screenshot(path=file, full_page=True)


def main() -> None:
    """Walk the whole way."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--output", type=Path, default=Path(tempfile.gettempdir()) / "maker")
    parser.add_argument("--narrow", action="store_true", help="a phone's width")
    parser.add_argument("--dark", action="store_true")
    given = parser.parse_args()
    given.output.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as started:
        examples = Path(folder) / "examples"
        write_examples(examples)
        with served(Path(folder) / "project") as (_, address):
            browser = started.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
            size = {"width": 390, "height": 844} if given.narrow else {"width": 1280, "height": 900}
            page = browser.new_page(viewport=size, color_scheme="dark" if given.dark else "light")
            page.set_default_timeout(WAIT)
            page.goto(address)
            look = f"{'narrow' if given.narrow else 'wide'}-{'dark' if given.dark else 'light'}"
            walk(Steps(page, given.output, look), examples)
            browser.close()


def walk(steps: Steps, examples: Path) -> None:
    """Do what a maker does, from photographs to a mould."""
    page = steps.page
    expect.set_options(timeout=WAIT)

    def named(name: str) -> str:
        return f'[data-name="{name}"]'

    def choose(name: str, option: str) -> None:
        page.locator(named(name)).click()
        page.get_by_role("option", name=option, exact=True).click()

    def done(output: str, report: bool = True) -> None:
        page.locator(named(f"start-{output}")).click()
        state = page.locator(named(f"state-{output}"))
        expect(state).to_have_text(re.compile("done|failed|stopped"))
        expect(state).to_have_text("done", timeout=100.0)
        if report:
            page.locator("iframe:visible").last.content_frame.locator("body").wait_for()

    with steps.step("device shown"):
        page.locator("svg.section").wait_for()
    with steps.step("photographs dropped"):
        page.get_by_role("tab", name="Photographs").click()
        folder = examples / "photographs"
        files = [*sorted(folder.glob("*.JPG")), folder / "grid.jpg", folder / "photos.csv"]
        page.locator("input[type=file]").first.set_input_files(files)
        page.locator('button:has-text("IMG_0110.JPG")').wait_for()
    with steps.step("lens calibrated"):
        page.get_by_text("Lens from photographs of a board").click()
        page.locator("input[type=file]").nth(1).set_input_files(sorted((examples / "boards").iterdir()))
        expect(page.locator(named("boards-given"))).to_have_text("10 photographs of the board")
        done("lens.toml", report=False)
    with steps.step("grid and edges found"):
        choose("lens", "lens.toml")
        choose("grid", "grid.jpg")
        page.locator(named("find-grid")).click()
        page.locator('button:has-text("IMG_0110.JPG")').click()
        page.locator("polyline.traced").first.wait_for(state="attached")
    with steps.step("outlines measured"):
        done("outlines")
    with steps.step("pressures given"):
        page.get_by_role("tab", name="Device").click()
        page.locator(named("pressures")).fill("0:177 cm")
        page.locator(named("pressures")).press("Tab")
        expect(page.locator(named("pressure-shown"))).to_have_text("177 cm")
    with steps.step("material fitted"):
        page.get_by_role("tab", name="Material").click()
        done("results/fit")
        page.locator(named("use-material")).click()
    with steps.step("device with it"):
        page.get_by_role("tab", name="Device").click()
        expect(page.locator(named("silicone"))).to_have_value(re.compile("of case.toml"))
        expect(page.locator(named("limit"))).not_to_be_empty()
    with steps.step("outline over the photograph"):
        page.get_by_role("tab", name="Overlay").click()
        page.locator(named("overlay-draw")).click()
        page.locator("polyline.simulated").first.wait_for(state="attached")
    with steps.step("design found"):
        page.get_by_role("tab", name="Design").click()
        page.locator(named("reach")).fill("1.15")
        done("results/design")
        page.locator(named("use-design")).click()
    with steps.step("mould made"):
        page.get_by_role("tab", name="Mould").click()
        done("results/mould")
    print(f"{sum(steps.times.values()):7.1f} s  in all; pictures in {steps.folder}")


if __name__ == "__main__":
    main()
