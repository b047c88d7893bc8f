"""``softmodels mould``, ``export``, ``import``, ``reduce``: cases for the workshop, to and from decks, for robot simulators."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from geometries import actuator, faces, registry
from softmodels.api import calls
from softmodels.api.run import Run
from softmodels.case import abaqus
from softmodels.case.case import Case
from softmodels.casting.settings import Workshop, asked_of
from softmodels.cli import ending, options
from softmodels.common import commands, files, processes, schema
from softmodels.common.errors import GeometryError
from softmodels.mechanics import mpi
from softmodels.runs.outcomes import RunError

if TYPE_CHECKING:
    from softmodels.casting import make


# ----------------------------------------------------------------------------------------------------------------------
# The command ``mould``.


@dataclasses.dataclass(frozen=True)
class MouldOptions:
    """The options of the command except those of the workshop."""

    changes: tuple[str, ...] = options.set_field()
    output: Path | None = commands.output_option(  # noqa: RUF009
        "Folder for the mould.  [default: results/NAME-mould, or results/NAME-mould-2 and so on]"
    )
    silicone: str | None = commands.option(help="Silicone product, such as ecoflex-00-30.  [default: the case's]")
    quiet: bool = commands.quiet_option()
    no_pictures: bool = commands.flag_option("Skip the pictures.")


def mould(file: Path, how: MouldOptions, settings: Mapping[str, object]) -> None:
    """Make the mould of a device, and a sheet for the bench.

    Cups and lids come as STEP and STL, in mm. A device is cast in one piece or in several that are bonded, as its recipe says:
    a cup forms the outside of a piece, a lid carries the cavity's core. An imported part is parted across --pull. Before any
    file is written, these are checked: bodies watertight, no undercuts, nothing in the way, no wall or gap too fine for the
    printer, STL within --chord of the exact surface, casts equal to the device. The file needs no load; a table [mould] in it
    may hold the settings below.

    \b
    Examples:
      softmodels mould results/seminar/case.toml
      softmodels mould results/disk/case.toml --silicone dragon-skin-10-medium --shrinkage 0.001
      softmodels mould examples/mypart.toml --pull '0, 1, 0' --tube 0mm

    \b
    Exit status: 0 done; 1 failed; 2 bad input; 130 stopped.
    """
    asked = asked_of(file, how.silicone, how.changes, **settings)
    files = [file, *map(Path, asked.device.files.values())]
    if not mpi.speaks():
        return
    given = {"silicone": how.silicone, "changes": how.changes, **settings}
    folder = commands.open_folder(how.output, Path("results") / f"{asked.name}-mould", "mould", given, files)
    from softmodels.casting import make
    from softmodels.casting.files import write_bodies, write_sheet

    drawn = False

    def write(place: Path) -> None:
        nonlocal drawn
        write_bodies(place, asked, made)
        drawn = write_sheet(place, asked, made, not how.no_pictures)

    made = make.made(asked.device, asked.workshop)
    ending.write_into(folder, write, "the mould")
    if not how.quiet:
        for text in mould_summary(made):
            processes.say(text)
        if not drawn and not how.no_pictures:
            processes.say("no pictures: this machine cannot render; see softmodels doctor")
        processes.say(f"mould in {folder.path}; sheet.html is the casting sheet")


def mould_summary(mould: make.Mould) -> list[str]:
    """Return a summary of the mould, line by line."""
    lines = []
    for body in mould.bodies:
        assert body.checked is not None
        gap = "" if math.isinf(body.checked.gap) else f", gap {body.checked.gap * 1e3:.3g} mm"
        leaves = "no undercut" if any(body.pull) else "of wax" if mould.waxes else "dissolved"
        lines.append(
            f"{body.name}: watertight, {leaves}, smallest wall "
            f"{body.checked.wall * 1e3:.3g} mm{gap}, STL within {body.checked.chord * 1e6:.3g} um"
        )
    grooves = f" and grooves {mould.grooved * 1e6:.2g} ml" if mould.grooved else ""
    lines.append(
        f"casts: {mould.cast_volume * 1e6:.5g} ml in the mould; shrunk and bonded they are the device "
        f"({mould.volume * 1e6:.5g} ml, of which the tube takes {mould.plug * 1e6:.2g} ml{grooves}) to {mould.differs:.2g}"
    )
    return [*lines, *(f"note: {text}" for text in mould.notes)]


def _mould_command() -> click.Command:
    @click.argument("file", type=click.Path(path_type=Path))
    @commands.options(MouldOptions)
    def made(file: Path, how: MouldOptions, **settings: object) -> None:
        mould(file, how, settings)

    for name, field in reversed(list(schema.about(Workshop).items())):
        default = getattr(Workshop, name)
        made = registry.field_option(name, field, None if default == "" else default)(made)
    return options.command("mould", help=mould.__doc__)(made)


mould_command = _mould_command()


# ----------------------------------------------------------------------------------------------------------------------
# The command ``export``.


@options.command("export")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), help="Deck: NAME.inp.")
@options.set_option
@click.option("--quiet", is_flag=True, help="Print only errors.")
def export_command(file: Path, output: Path, changes: tuple[str, ...], quiet: bool) -> None:
    """Write the case FILE for CalculiX.

    It has the same mesh, silicones, supports, rigid parts and dead loads. It is solved by `ccx NAME`. Lengths in the deck are
    in mm, pressures in Pa. Cells have only displacements there: compare the result with --formulation displacement.

    \b
    Examples:
      softmodels export results/disk/case.toml -o disk.inp
      softmodels export results/seminar/case.toml -o slab.inp

    \b
    Exit status: 0 done; 1 failed; 2 bad input; 130 stopped.
    """
    if mpi.launched() is not None:  # dead loads start MPI, which waits for all ranks of a launcher
        mpi.start()
    if not mpi.speaks():
        return
    with ending.unwritable(output):
        deck = calls.export(Case.from_file(file, changes=changes), output)
    if not quiet:
        steps, mesh = len(deck.pressures), deck.mesh
        processes.say(f"{output}: {len(mesh.cells)} cells, {len(mesh.points)} nodes, {steps} pressure{'s' * (steps > 1)}")
        remarks = [*(text for silicone in deck.silicones for text in silicone.remarks[2:]), deck.overlapping]
        for text in filter(None, dict.fromkeys(remarks)):
            processes.say(f"note: {text}")


# ----------------------------------------------------------------------------------------------------------------------
# The command ``draw-network``.


@options.command("draw-network")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), help="Drawing: NAME.svg.")
@options.set_option
@click.option("--quiet", is_flag=True, help="Print only errors.")
def draw_network_command(file: Path, output: Path, changes: tuple[str, ...], quiet: bool) -> None:
    """Write the network of a ChannelPlate as a drawing.

    Strokes are as wide as the channels, and coloured by cavity. --network reads the drawing back. The printed numbers of nodes
    and channels are those of a design's parameters, such as node_x[3] or start_radii[2].

    \b
    Examples:
      softmodels draw-network results/plate/case.toml -o plate.svg
      softmodels draw-network results/plate/case.toml --set geometry.network=radial:8 -o plate.svg

    \b
    Exit status: 0 done; 2 bad input; 130 stopped.
    """
    from geometries import drawings, network, plates

    if not mpi.speaks():
        return
    plate = asked_of(file, None, changes).device
    if not isinstance(plate, plates.NetworkPlate):
        raise GeometryError(f"{file} has a {type(plate).__name__}, which has no network of channels; a ChannelPlate has one")
    with ending.unwritable(output):
        if output.suffix != ".svg":
            raise GeometryError(f"{output} is not the name of an SVG file; end it in .svg")
        inputs = [file, *map(Path, plate.files.values())]
        commands.check_output_file(output, inputs, lambda path: drawings.WRITTEN_BY in path.read_text("utf-8", "replace"),
                                   "a drawing", "--output")  # fmt: skip
        files.write_text(output, drawings.svg_text(plate.drawn))
    if not quiet:
        drawn = plate.drawn
        processes.say(f"{output}: {len(drawn.channels)} channels, {len(drawn.cavities)} cavities")
        for text in network.Nodes.of(drawn.channels).texts(drawn.channels):
            processes.say(text)
        if "outline_x[1]" in actuator.parameter_names(plate):
            for number, (x, y) in enumerate((1e3 * np.array(drawn.outline[0])).round(6).tolist(), 1):
                processes.say(f"corner {number} of the outline at ({x:.4g}, {y:.4g}) mm")


# ----------------------------------------------------------------------------------------------------------------------
# The command ``import``.


IMPORTED_BY = "# from a deck by softmodels import"
"""First line of imported cases: files with it may be overwritten."""


@options.command("import")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), help="Case file: NAME.toml.")
@click.option("--unit", type=click.Choice(list(faces.UNITS)), default="mm", show_default=True, help="Unit of lengths.")
@click.option("--stress", type=click.Choice(list(abaqus.STRESS_UNITS)), default=None,
              help="Unit of stresses.  [default: MPa with mm or cm, Pa with m, psi with inch]")  # fmt: skip
@click.option("--program", type=click.Choice(abaqus.PROGRAMS), default=None,
              help="Whose dialect it is.  [default: by its keywords]")  # fmt: skip
@click.option("--quiet", is_flag=True, help="Print only errors.")
def import_command(file: Path, output: Path, unit: str, stress: str | None, program: str | None, quiet: bool) -> None:
    """Write the case of an Abaqus or CalculiX deck FILE.

    The case uses the deck's mesh. Materials, supports, symmetry planes, pressures and gravity are read, instances are bonded by
    *Tie where their nodes coincide, and hexahedra and wedges are split into tetrahedra. What is not read is listed with its
    line.

    \b
    Examples:
      softmodels import model.inp -o model.toml
      softmodels run model.toml

    \b
    Exit status: 0 done; 2 bad input; 130 stopped.
    """
    if not mpi.speaks():
        return
    with ending.unwritable(output):
        commands.check_output_file(output, [file], lambda path: IMPORTED_BY in path.read_text("utf-8", "replace"), "a case",
                                   "--output")  # fmt: skip
        made = abaqus.import_model(file, output.parent, unit, stress or "", program or "")
        files.write_text(output, f"{IMPORTED_BY}\n{made.text}")
    if quiet:
        return
    processes.say(f"{output}: {made.case.actuator.expected_cells:.0f} cells, {made.case.actuator.solid_volume * 1e6:.5g} ml")
    for text in made.remarks:
        processes.say(f"note: {text}")
    for text in made.unread:
        processes.say(f"not read: {text}")


# ----------------------------------------------------------------------------------------------------------------------
# The command ``reduce``.


@options.command("reduce")
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), help="File: NAME.csv, NAME.json, NAME.xml (MuJoCo) or "
              "NAME.fmu.")  # fmt: skip
@click.option("--check", type=click.Path(path_type=Path), help="Chain NAME.xml to compare with the device, in MuJoCo.")
@click.option("--as", "kind", default="", metavar="KIND", help="csv, json, mjcf or fmu.  [default: by the file's name]")
@click.option("--face", default="", help="Face that is the tip.  [default: the device's own]")
@click.option("--fingers", default=1, help="Such devices on a wrist, in NAME.xml, with pressures of their own.",
              show_default=True)  # fmt: skip
@click.option("--radius", metavar="LENGTH", help="Radius of the circle on which several fingers stand, such as 30mm.")
@click.option("--grid", type=int, metavar="N", help="Several cavities: solve a grid of N pressures of each, from 0 to the "
              "run's, into FOLDER-gridN, and reduce that.")  # fmt: skip
@click.option("--quiet", is_flag=True, help="Print only errors.")
def reduce_command(folder: Path, output: Path | None, check: Path | None, grid: int | None, quiet: bool, **given: Any) -> None:
    """Reduce results to the device's tip, for robot simulators.

    Over the pressures of the path up to the first limit point: position and rotation of the tip, added volume, their exact
    derivatives by the pressures, the compliance by force and moment on the tip, effective area, arc of constant curvature, and
    95 % bands where the run has them. NAME.xml is a chain of joints for MuJoCo, whose control is the pressure in kPa;
    NAME.fmu a unit for co-simulation (FMI 2.0). With --grid the table is over the pressure of each cavity; an interrupted grid
    goes on where it stopped. --check compares pose, deflection and first mode of a chain with the device's.

    \b
    Examples:
      softmodels reduce results/pneunet -o finger.xml
      softmodels reduce results/pneunet -o finger.csv
      softmodels reduce results/pneunet -o finger.fmu
      softmodels reduce results/pneunet --check finger.xml
      softmodels reduce results/pneunet -o hand.xml --fingers 3 --radius 30mm
      softmodels reduce results/arm -o arm.csv --grid 5

    \b
    Exit status: 0 done; 1 failed; 2 bad input; 130 stopped.
    """
    from softmodels.decks import chain_check, chains

    written = check if output is None else output
    if written is None:
        raise click.UsageError("name a file to write (-o finger.xml), or a chain to compare (--check finger.xml)")
    with ending.unwritable(written):
        if output is not None:
            chains.kind_of(output, given["kind"])
            commands.check_output_file(output, [], chains.is_own, "a reduced model", "--output")
        if check is not None and check != output:
            chain_check.check_file(check)
        run = calls.load(folder)
        if grid is not None:
            run = grid_run(run, folder.with_name(f"{folder.absolute().name}-grid{grid}"), grid, quiet)
        made = run.reduce(output, **given)
    if not quiet:
        processes.say(f"{output or folder}: {made._line()}, tip {made.face}")
        for name, text in made._figures():
            processes.say(f"{name}: {text}")
        for text in [*([run.limit.why] if grid is not None and run.limit else []), *made.notes]:
            processes.say(f"note: {text}")
    for text in [] if check is None else chain_check.check(made, check):
        processes.say(text)


def grid_run(run: Run, place: Path, count: int, quiet: bool) -> Run:
    """Return the run of a grid of pressures in a folder; one of other pressures or another device there is replaced."""
    case = run.grid(count)
    try:
        return calls.run(case, folder=place, resume=True, progress=not quiet)
    except RunError as error:
        if error.status != commands.EXIT_BAD_INPUT:
            raise
        return calls.run(case, folder=place, progress=not quiet)
