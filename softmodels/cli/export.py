"""``softmodels export``: write a case for CalculiX or FEBio, to check results with another program."""

from __future__ import annotations

from pathlib import Path

import click

from softmodels.api.calls import export
from softmodels.case.entries import INPUT_ERRORS
from softmodels.cli.options import fail
from softmodels.common.commands import status_of
from softmodels.common.errors import MeshingError
from softmodels.common.terminal import say
from softmodels.mechanics.body import BodyError
from softmodels.mechanics.compiling import CompilingError
from softmodels.mechanics.mpi import launched, speaks, start
from softmodels.runs.outcomes import FAILED


@click.command(name="export", context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("file", type=click.Path(path_type=Path))
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), help="Deck: NAME.inp or NAME.feb.")
@click.option("--quiet", is_flag=True, help="Print only errors.")
def command(file: Path, output: Path, quiet: bool) -> None:
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
