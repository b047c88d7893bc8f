"""The mould's sheet for the bench, as Markdown and as a page with its pictures inside; and the pictures themselves."""

from __future__ import annotations

from pathlib import Path

from measurement.page import image_uri, render
from softmodels.design.mould.asked import Asked
from softmodels.design.mould.bench import bench_sheet
from softmodels.design.mould.make import Made
from softmodels.pictures.offscreen import can_render
from softmodels.pictures.style import DPI
from softmodels.results.writing import write_text

EXPLODED = "exploded.png"


def write_sheet(folder: Path, asked: Asked, made: Made, pictures: bool = True) -> bool:
    """Write ``sheet.md``, ``sheet.html`` and the pictures into a folder; return whether pictures were drawn.

    Args:
        folder: The folder.
        asked: What was asked for.
        made: The mould.
        pictures: Whether to draw; without a way to render nothing is drawn.

    Raises:
        OSError: There is no room.
    """
    drawn = pictures and can_render()
    files = [(EXPLODED, "The mould, apart along the pull")] if drawn else []
    if drawn:
        _draw(folder, made)
        files += [(f"{body.stem}.png", f"The {body.name}") for body in made.bodies]
    sheet = bench_sheet(asked, made)
    # Markdown is no HTML: its texts go in as they are.
    write_text(folder / "sheet.md", render("mould.md", "softmodels.pictures", pictures=files, sheet=sheet))
    inside = [(image_uri(folder / name), text) for name, text in files]
    write_text(
        folder / "sheet.html",
        render("mould.html", "softmodels.pictures", pictures=inside, title=sheet.title, sheet=sheet),
    )
    return drawn


def _draw(folder: Path, made: Made) -> None:
    from softmodels.pictures.mould_pictures import body_picture, exploded_picture

    exploded_picture(made).savefig(folder / EXPLODED, dpi=DPI)
    for body in made.bodies:
        body_picture(body).savefig(folder / f"{body.stem}.png", dpi=DPI)
