"""``softmodels mould``, ``export`` and ``reduce``: a case for the workshop, for CalculiX or FEBio, and for robot simulators."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import click

from geometries.options import field_option
from softmodels.api.calls import export
from softmodels.case.entries import INPUT_ERRORS
from softmodels.casting.settings import Asked, MouldError, Workshop, asked_of
from softmodels.cli.options import fail, write_into
from softmodels.common.commands import FolderType, open_folder, status_of
from softmodels.common.errors import MeshingError
from softmodels.common.folders import OwnFolderError, check_output_file
from softmodels.common.processes import say
from softmodels.common.schema import about
from softmodels.mechanics.body import BodyError
from softmodels.mechanics.compiling import CompilingError
from softmodels.mechanics.mpi import launched, speaks, start
from softmodels.runs.outcomes import FAILED

if TYPE_CHECKING:
    from softmodels.casting.make import Made

# ----------------------------------------------------------------------------------------------------------------------
# The command ``mould``.


def mould(
    file: Path, silicone: str | None, output: Path | None, quiet: bool, no_pictures: bool, **settings: object
) -> None:
    """Make the mould of the device in a case FILE: cups and lids as STEP and STL, in mm, and a sheet for the bench.

    A device is cast in one piece or in several that are bonded, as its recipe says: a cup forms the outside of a piece, a
    lid carries the cavity's core. An imported part is parted across --pull. Before any file is written, these are checked:
    bodies watertight, no undercuts, nothing in the way, no wall or gap too fine for the printer, STL within --chord of the
    exact surface, casts equal to the device.
    The file needs no load; a table [mould] in it may hold the settings below.

    \b
    Examples:
      softmodels mould results/seminar/case.toml
      softmodels mould results/disk/case.toml --silicone dragon-skin-10-medium --shrinkage 0.001
      softmodels mould examples/mypart.toml --pull '0, 1, 0' --tube 0mm

    \b
    Exit status: 0 done; 1 failed; 2 bad input; 130 stopped.
    """
    try:
        asked = asked_of(file, silicone, **settings)
        given = {"silicone": silicone, **settings}
        files = [file, *map(Path, asked.device.files.values())]
        folder = (
            open_folder(output, Path("results") / f"{asked.name}-mould", "mould", given, files) if speaks() else None
        )
    except (MouldError, OwnFolderError, *INPUT_ERRORS) as error:
        fail(str(error))
    if folder is None:
        return
    from softmodels.casting.files import write_bodies, write_sheet
    from softmodels.casting.make import made

    drawn = False

    def write(place: Path) -> None:
        nonlocal drawn
        write_bodies(place, asked, found)
        drawn = write_sheet(place, asked, found, not no_pictures)

    try:
        found = made(asked.device, asked.workshop)
        write_into(folder, write, "the mould")
    except (MouldError, *INPUT_ERRORS) as error:
        fail(str(error))
    except MeshingError as error:
        fail(str(error), FAILED)
    if not quiet:
        for text in mould_summary(asked, found):
            say(text)
        if not drawn and not no_pictures:
            say("no pictures: this machine cannot render; see softmodels doctor")
        say(f"mould in {folder.path}; sheet.html is the casting sheet")


def mould_summary(asked: Asked, found: Made) -> list[str]:
    """Return a summary of the mould, line by line."""
    lines = []
    for body in found.bodies:
        assert body.checked is not None
        gap = "" if math.isinf(body.checked.gap) else f", gap {body.checked.gap * 1e3:.3g} mm"
        lines.append(
            f"{body.name}: watertight, {'dissolved' if not any(body.pull) else 'no undercut'}, smallest wall "
            f"{body.checked.wall * 1e3:.3g} mm{gap}, STL within {body.checked.chord * 1e6:.3g} um"
        )
    lines.append(
        f"casts: {found.cast_volume * 1e6:.5g} ml in the mould; shrunk and bonded they are the device "
        f"({found.volume * 1e6:.5g} ml, of which the tube takes {found.plug * 1e6:.2g} ml) to {found.differs:.2g}"
    )
    return lines


def _mould_command() -> click.Command:
    command = mould
    command = click.option("--no-pictures", is_flag=True, help="Skip the pictures.")(command)
    command = click.option("--quiet", is_flag=True, help="Print only errors.")(command)
    for name, field in reversed(list(about(Workshop).items())):
        default = getattr(Workshop, name)
        command = field_option(name, field, None if default == "" else default)(command)
    command = click.option("--silicone", help="Silicone product, such as ecoflex-00-30.  [default: the case's]")(
        command
    )
    text = "Folder for the mould.  [default: results/NAME-mould, or results/NAME-mould-2 and so on]"
    command = click.option("-o", "--output", type=FolderType(), help=text)(command)
    command = click.argument("file", type=click.Path(path_type=Path))(command)
    return click.command(name="mould")(command)


mould_command = _mould_command()


# ----------------------------------------------------------------------------------------------------------------------
# The command ``export``.


@click.command(name="export")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), help="Deck: NAME.inp or NAME.feb.")
@click.option("--quiet", is_flag=True, help="Print only errors.")
def export_command(file: Path, output: Path, quiet: bool) -> None:
    """Write the case FILE for another program: the same mesh, silicones, supports, rigid parts, contact and loads.

    NAME.inp is for CalculiX (ccx NAME), NAME.feb for FEBio. Lengths in the deck are in mm, pressures in Pa. Cells have
    only displacements there: compare the result with --formulation displacement.

    \b
    Examples:
      softmodels export results/disk/case.toml -o disk.inp
      softmodels export results/seminar/case.toml -o slab.feb

    \b
    Exit status: 0 done; 1 failed; 2 bad input; 130 stopped.
    """
    if launched() is not None:  # dead loads start MPI, which waits for all ranks of a launcher
        start()
    if not speaks():
        return
    try:
        deck = export(file, output)
    except INPUT_ERRORS as error:
        fail(str(error))
    except (MeshingError, BodyError, CompilingError) as error:
        fail(str(error), FAILED)
    except OSError as error:
        fail(f"{output} cannot be written ({error.strerror or error})", status_of(error))
    if not quiet:
        steps, mesh = len(deck.pressures), deck.mesh
        say(f"{output}: {len(mesh.cells)} cells, {len(mesh.points)} nodes, {steps} pressure{'s' * (steps > 1)}")
        remarks = [*(text for silicone in deck.silicones for text in silicone.remarks[2:]), deck.overlapping]
        for text in filter(None, dict.fromkeys(remarks)):
            say(f"note: {text}")


# ----------------------------------------------------------------------------------------------------------------------
# The command ``reduce``.


@click.command(name="reduce")
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), help="File: NAME.csv, NAME.json, NAME.xml "
              "(MuJoCo) or NAME.py (SOFA).")  # fmt: skip
@click.option("--as", "kind", default="", metavar="KIND", help="csv, json, mjcf, sofa or fonsim.  [default: by the file's "
              "name]")  # fmt: skip
@click.option("--face", default="", help="Face that is the tip.  [default: the device's own]")
@click.option("--quiet", is_flag=True, help="Print only errors.")
def reduce_command(folder: Path, output: Path, kind: str, face: str, quiet: bool) -> None:
    """Reduce the results in FOLDER to the device's tip, for robot simulators.

    Over the pressures of the path up to the first limit point: position and rotation of the tip, added volume, their exact
    derivatives by the pressures, the compliance by force and moment on the tip, effective area, arc of constant curvature, and
    95 % bands where the run has them. NAME.xml is a chain of joints for MuJoCo, whose control is the pressure in kPa; NAME.py a
    scene for SOFA; --as fonsim a pressure-volume curve for FONSim.

    \b
    Examples:
      softmodels reduce results/pneunet -o finger.xml
      softmodels reduce results/pneunet -o finger.csv
      softmodels reduce results/pneunet -o finger-pv.csv --as fonsim

    \b
    Exit status: 0 done; 1 failed; 2 bad input.
    """
    from softmodels.api.calls import load
    from softmodels.decks.chains import is_own, kind_of
    from softmodels.runs.outcomes import RunError
    from softmodels.runs.store import ResultsError

    try:
        kind_of(output, kind)
        check_output_file(output, [], is_own, "a reduced model", "--output")
        made = load(folder).reduce(output, kind=kind, face=face)
    except (OwnFolderError, ResultsError, *INPUT_ERRORS) as error:
        fail(str(error))
    except (MeshingError, BodyError, CompilingError, RunError) as error:
        fail(str(error), FAILED)
    except OSError as error:
        fail(f"{output} cannot be written ({error.strerror or error})", status_of(error))
    if not quiet:
        say(f"{output}: {made._line()}, tip {made.face}")
        for name, text in made._figures():
            say(f"{name}: {text}")
        for text in made.notes:
            say(f"note: {text}")
