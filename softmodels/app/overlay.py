"""The page that draws the simulated outline over the photographs, pressure by pressure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from softmodels.app.device import OUTPUT as DEVICE, is_section, stored_run
from softmodels.app.photographs import picture_of, points_text
from softmodels.app.project import OUTLINES, PHOTOS
from softmodels.app.warm import AnswerError, SupersededError

if TYPE_CHECKING:
    from softmodels.app.bench import Bench
    from softmodels.app.tracing import Overlay


class OverlayPage:
    """One tab's page of the simulated outline over the photographs.

    Args:
        bench: What all tabs share.
    """

    def __init__(self, bench: Bench):
        from nicegui import ui

        self.bench, self.project = bench, bench.project
        self.message = ui.label().classes("text-negative").props('data-name="overlay-message"')
        with ui.row().classes("w-full items-center gap-3"):
            self.chosen = (
                ui.select([], label="Photograph", on_change=self._show)
                .classes("w-72")
                .props('data-name="overlay-photograph"')
            )
            ui.button("Draw", on_click=self._refresh).props('outline data-name="overlay-draw"')
            self.about = ui.label().props('data-name="overlay-about"')
        self.image = (
            ui.interactive_image(sanitize=False)
            .classes("w-full photograph")
            .props('data-name="overlay" aria-label="the photograph with the simulated outline"')
        )
        self.image.set_visibility(False)
        bench.jobs.changed.subscribe(lambda job: self._list() if job.output == OUTLINES else None)
        self._list()

    def _list(self) -> None:
        self.measured = {name: float(row["pressure_Pa"]) for name, row in self.bench.photographs.measured.items()}
        self.chosen.set_options(list(self.measured))

    async def _refresh(self) -> None:
        self._list()
        if not self.measured:
            self.message.set_text("there are no outlines yet: measure the photographs first")
        elif self.chosen.value is None:
            self.chosen.set_value(list(self.measured)[-1])
        else:
            await self._show()

    async def _show(self) -> None:
        name = self.chosen.value
        try:
            self.message.set_text(await self._draw(name) if name else "")
        except SupersededError:
            pass
        except AnswerError as error:
            self.message.set_text(str(error))

    async def _draw(self, name: str) -> str:
        """Draw the outline over a photograph; return the sentence why it cannot be drawn."""
        photos, case = self.bench.photographs, self.project.case
        solid = "" if is_section(case.actuator) else str(self.project / DEVICE)
        if solid and ((stored := stored_run(self.project)[0]) is None or stored.actuator != case.actuator):
            return "this device is a solid: run it first, on the page Device"
        one, pressure = photos.listed.get(name), self.measured[name]
        if one is None:
            return f"{name} is no longer among the photographs"
        curve = await self.bench.slower.ask("outline", case.to_toml(), pressure, solid, kind="outline")
        file, listing = self.project / OUTLINES / f"{one.file.stem}.csv", self.project / PHOTOS
        found: Overlay = await self.bench.tracer.ask(
            "overlay", str(listing), photos.setup, str(file), curve, case.actuator.axial
        )
        await photos.show(one)
        if one.preview is None:
            return one.why
        source, scale = picture_of(one.preview)
        self.image.set_source(source)
        self.image.set_visibility(True)
        self.image.set_content(f'<polyline class="simulated" points="{points_text(found.curve, scale)}"/>')
        self.about.set_text(
            f"{pressure / case.cm:.4g} cm; measured and simulated heights differ by {found.difference * 1e6:.3g} um (rms)"
        )
        return ""
