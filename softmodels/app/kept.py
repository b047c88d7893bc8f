"""Devices and results that a project keeps under names of their own: opened, renamed, duplicated, deleted."""

from __future__ import annotations

import asyncio
import shutil
from collections.abc import Awaitable, Callable
from pathlib import Path
from urllib.parse import quote

from nicegui import ui

from softmodels.app import forms
from softmodels.app.bench import DEVICES, Bench

type Action = tuple[str, str, Callable[[], Awaitable[object]]]
"""A button's icon, what it does, and the function that does it."""


class KeptDevices(forms.TabPage):
    """A list of the project's kept devices, in the current place of a page."""

    def __init__(self, bench: Bench):
        super().__init__(bench)
        with ui.expansion("Kept devices").classes("w-full").props("dense"):
            with ui.row().classes("w-full items-center no-wrap gap-2"):
                self.name = forms.tagged(ui.input("name", value="device"), "keep-device-name", "grow")
                forms.tagged(ui.button("Keep this device", on_click=self._keep), "keep-device", "shrink-0", "outline no-caps")
            self.message, self.dialogs = forms.tagged(ui.label(), "kept-message", "text-negative", ""), ui.element()
            self.rows = ui.refreshable(self._rows)
            self.rows()
        self.project.changed.subscribe(lambda place: self.rows.refresh() if place in ("", DEVICES) else None)

    def _rows(self) -> None:
        for file in self.project.devices:

            async def renamed(file: Path = file) -> None:
                if name := await ask(self.dialogs, f"Another name for {file.stem}", "Rename", file.stem):
                    with self.saying():
                        self.project.rename_device(file, name)

            async def opened(file: Path = file) -> None:
                self._do(lambda: self.project.open_device(file))

            async def duplicated(file: Path = file) -> None:
                self._do(lambda: self.project.duplicate_device(file))

            async def deleted(file: Path = file) -> None:
                self._do(lambda: self.project.remove(file))

            named_row(file.stem, [
                ("folder_open", "open", opened), ("edit", "rename", renamed), ("content_copy", "duplicate", duplicated),
                ("delete", "delete", deleted),
            ])  # fmt: skip

    def _keep(self) -> None:
        self._do(lambda: self.project.keep_device(str(self.name.value)))

    def _do(self, change: Callable[[], object]) -> None:
        with self.saying():
            self.say("")
            change()


class KeptResults(forms.TabPage):
    """Buttons that copy and delete a folder of results, and a list of its copies with their ``report``, in the current place of
    a page. Results cannot be undone: it asks before it deletes."""

    def __init__(self, bench: Bench, output: str, report: str = "report.html"):
        super().__init__(bench)
        self.output, self.report = output, report
        self.message, self.dialogs = forms.tagged(ui.label(), f"kept-message-{output}", "text-negative", ""), ui.element()
        self.shown, self.rows = self._here(), ui.refreshable(self._rows)
        self.rows()
        self.while_working(output, "working on these results")
        bench.jobs.changed.subscribe(lambda job: self._renew() if job.output == output else None)
        bench.worked.subscribe(lambda place: self._renew() if place == output else None)

    def _here(self) -> dict[Path, bool]:
        """Return the folders that have a row, each with whether it has a report."""
        job, results = self.bench.jobs.latest(self.output), self.project / self.output
        own = [results] if results.is_dir() and not (job and job.active) else []
        return {folder: (folder / self.report).is_file() for folder in (*own, *self.project.copies(self.output))}

    def _renew(self) -> None:
        """Build the rows again if they change: a click on a button that is built again at that moment would be lost."""
        if (here := self._here()) != self.shown:
            self.shown = here
            self.rows.refresh()

    def _rows(self) -> None:
        for folder, has_report in self.shown.items():
            if folder == self.project / self.output:
                named_row("these results", self._actions(folder)[1:])
                continue
            place = folder.relative_to(self.project.folder).as_posix()
            own = folder.name.removeprefix(f"{Path(self.output).name}-")
            with named_row(own, self._actions(folder)):
                if has_report:
                    ui.link("report", f"/files/{quote(f'{place}/{self.report}')}", new_tab=True)
                forms.with_attribute(ui.link("ZIP", forms.zip_address(place)), "download", "")

    def _actions(self, folder: Path) -> list[Action]:
        async def renamed() -> None:
            if name := await ask(self.dialogs, "Another name for these results", "Rename", folder.name.partition("-")[2]):
                await self._do(folder.rename, self.project.copy_place(self.output, name))

        async def copied() -> None:
            if name := await ask(self.dialogs, "Keep a copy of these results as", "Keep", "copy"):
                await self._do(shutil.copytree, folder, self.project.copy_place(self.output, name))

        async def deleted() -> None:
            if await ask(self.dialogs, f"Delete {folder.name}? It cannot be undone.", "Delete"):
                await self._do(shutil.rmtree, folder)

        return [("edit", "rename", renamed), ("content_copy", "keep a copy of", copied), ("delete", "delete", deleted)]

    async def _do(self, work: Callable[..., object], *places: Path) -> None:
        """Work on folders beside the server; all tabs show it."""
        with self.saying(), self.bench.work(self.output):
            self.say("")
            await asyncio.to_thread(work, *places)
        if (job := self.bench.jobs.latest(self.output)) is not None:
            self.bench.jobs.changed.emit(job)


def named_row(name: str, actions: list[Action]) -> ui.row:
    """Add a row with a name and a button for each action in the current place of the page."""
    with ui.row().classes("w-full items-center no-wrap gap-1") as row:
        ui.label(name).classes("grow truncate")
        for icon, verb, take in actions:
            button = ui.button(icon=icon, on_click=take).props("flat dense round size=sm").classes("shrink-0")
            forms.with_attribute(button.tooltip(verb), "aria-label", f"{verb} {name}")
    return row


async def ask(place: ui.element, words: str, verb: str, text: str | None = None) -> str:
    """Ask for a text, or, without one, whether to go on, in a place that stays; return the text, or the verb, or nothing if
    the answer is no."""
    with place, ui.dialog() as dialog, ui.card():
        ui.label(words)
        box = None if text is None else forms.tagged(ui.input("name", value=text), "asked")
        with ui.row():
            ui.button("Cancel", on_click=lambda: dialog.submit("")).props("flat")
            ui.button(verb, on_click=lambda: dialog.submit(verb if box is None else str(box.value or "").strip()))
    answer = str(await dialog or "")
    dialog.delete()
    return answer
