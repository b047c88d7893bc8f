"""The page of making: a better device within limits, and the mould to cast one in."""

from __future__ import annotations

from typing import TYPE_CHECKING
from urllib.parse import quote

from softmodels.app.jobs import DONE, Command, Job, job_panel
from softmodels.app.project import CASE, RESULTS
from softmodels.materials.silicones import PRODUCTS

if TYPE_CHECKING:
    from softmodels.app.shell import Shell

MOULD = f"{RESULTS}/mould"
PRINTED = (".stl", ".step", ".3mf")


class MouldPage:
    """One tab's page of the mould.

    Args:
        shell: What all tabs share.
    """

    def __init__(self, shell: Shell):
        from nicegui import ui

        self.shell, self.project = shell, shell.project
        with ui.element("div").classes("two-columns"):
            with ui.card().classes("w-full"):
                ui.label("Mould").classes("font-bold")
                self.silicone = ui.select(
                    ["as simulated", *sorted(PRODUCTS)], value="as simulated", label="Silicone to cast"
                )
                self.silicone.classes("w-full").props("dense").mark("cast-silicone")
                self.settings = {}
                for name, field, default in workshop_fields():
                    self.settings[name] = (
                        ui.input(name.replace("_", " "), placeholder=default).props("dense").classes("w-full")
                    )
                    self.settings[name].tooltip(field).mark(f"mould-{name}")
                ui.label("Files").classes("font-bold")
                self.files = ui.column().classes("gap-1")
            with ui.column().classes("w-full min-w-0"):
                job_panel(shell, MOULD, "Make the mould", self._command, f"{MOULD}/sheet.html")
        shell.jobs.changed.subscribe(self._ended)
        self._show()

    def _command(self) -> Command:
        if not (self.project / CASE).exists():
            self.project.change()
        words = ["softmodels", "mould", CASE, "-o", MOULD]
        if self.silicone.value != "as simulated":
            words += ["--silicone", str(self.silicone.value)]
        for name, box in self.settings.items():
            if text := str(box.value or "").strip():
                words += [f"--{name.replace('_', '-')}", text]
        return words, MOULD, False

    async def _ended(self, job: Job) -> None:
        if job.output == MOULD and job.state == DONE:
            self._show()

    def _show(self) -> None:
        from nicegui import ui

        self.files.clear()
        folder = self.project / MOULD
        if not folder.is_dir():
            return
        with self.files:
            for file in self.project.files(MOULD, PRINTED):
                ui.link(file.name, f"/files/{quote(f'{MOULD}/{file.name}')}").props(f'download="{file.name}"')


def workshop_fields() -> list[tuple[str, str, str]]:
    """Return name, help and default of each setting of a mould, as texts."""
    from softmodels.casting.settings import Workshop
    from softmodels.common.schema import about, shown

    found = []
    for name, field in about(Workshop).items():
        default = getattr(Workshop, name)
        text = shown(default, field.kind.unit) if isinstance(default, float) else str(default)
        found.append((name, field.help, "" if default is None else text))
    return found
