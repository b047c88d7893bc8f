"""Names of what is drawn of a run, and the record of it in a folder of results."""

from __future__ import annotations

from pathlib import Path

from measurement.own_folder import OwnFolder

PICTURES = (
    "profile",
    "mesh",
    "slice",
    "mode",
    "undeformed",
    "cut",
    "hot-spots",
    "stress",
    *(f"stress-{k}" for k in range(1, 5)),
)
"""Stems of the pictures drawn beside the one that has the gauge's name."""
PAGES = ("film.gif", "film.webp", "film.mp4", "report.html")


def picture_files(gauge: str) -> list[str]:
    """Names of all that is drawn of a run: pictures, film and report."""
    return [*(f"{picture}.png" for picture in (*PICTURES, gauge)), *PAGES]


def picture_folder(folder: Path) -> OwnFolder:
    """The pictures in a folder of results: a record beside the run's, for they are also drawn while the run goes on."""
    return OwnFolder(folder, "pictures", part="pictures")
