"""``python -m softmodels.pictures.draw_design results/design``: pictures and report of a design.

A program of its own, because VTK and DOLFINx each bring an HDF5. It reads ``design.json`` and the runs ``before`` and
``after``.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import click
import matplotlib

from measurement.page import image_uri, render
from measurement.terminal import say
from measurement.user_file import read_text
from softmodels.case.case import Case, CaseError
from softmodels.case.own_modules import OwnModuleError, import_own_modules
from softmodels.pictures import design_curves, design_shapes
from softmodels.pictures.design_files import CAPTIONS, REPORT
from softmodels.pictures.drawn_folder import DrawnFolder
from softmodels.pictures.offscreen import can_render
from softmodels.pictures.style import STYLE
from softmodels.results.store import ResultsError
from softmodels.results.stored import States
from softmodels.results.writing import write_text


def draw(folder: Path) -> list[Path]:
    """Draw the pictures and the report of a folder of ``softmodels design``.

    Returns:
        The files written.

    Raises:
        ResultsError, CaseError: No design, or none that can be read.
        OSError: The folder cannot be written.
    """
    try:
        told = json.loads(read_text(folder / "design.json"))
    except (OSError, ValueError):
        raise ResultsError(f"{folder} holds no design (design.json)") from None
    before, after = (_states(folder / name) for name in ("before", "after"))
    actuator = before.actuator
    with DrawnFolder(folder) as out, matplotlib.rc_context(STYLE):
        out.save("paths", design_curves.paths(before.rows, after.rows, actuator.gauge, before.case.cm))
        out.save("history", design_curves.history(told))
        out.save("parameters", design_curves.parameters(told["parameters"]))
        if actuator.dimension == 2:
            out.save("sections", design_shapes.sections((before, after)))
        if can_render():
            out.save("shapes", design_shapes.shapes((before, after)))
    pictures = [(image_uri(folder / name), text) for name, text in CAPTIONS.items() if (folder / name) in out.written]
    rows = [
        (one["name"], *(f"{one[name]:.5g} {one['unit']}".strip() for name in ("low", "before", "after", "high")))
        for one in told["parameters"]
    ]
    page = render(
        "design.html", "softmodels.pictures", title=told["name"], told=told, pictures=pictures, rows=rows,
        case=read_text(folder / "design.toml"),
    )  # fmt: skip
    write_text(folder / REPORT, page)
    return [*out.written, folder / REPORT]


def _states(folder: Path) -> States:
    return States(folder, Case.from_file(folder / "case.toml").name)


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("folder", type=click.Path(path_type=Path))
def main(folder: Path) -> None:
    """Draw the pictures and the report of the design in FOLDER."""
    try:
        import_own_modules()
        for path in draw(folder):
            print(path)
    except (ResultsError, CaseError, OwnModuleError) as error:
        say(f"softmodels: {error}", err=True)
        sys.exit(2)
    except OSError as error:
        say(f"softmodels: the pictures cannot be written into {folder} ({error.strerror or error})", err=True)
        sys.exit(2)


if __name__ == "__main__":
    main()
