"""The command ``join``: the tip in space, from two side views of a device that leaves its plane."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from measurement import cli
from measurement.series import space
from softmodels.common import commands, errors, processes
from softmodels.common.folders import OwnFolderError


@click.command()
@click.argument("first", type=click.Path(path_type=Path))
@click.argument("second", type=click.Path(path_type=Path))
@click.option("--from", "side", required=True, type=commands.Choice(list(space.SIDES)),
              help="Where the second camera stands, as the first one sees it.")  # fmt: skip
@click.option("-o", "--output", type=commands.FolderType(),
              help="Folder for the results.  [default: tips; tips-2 and so on if that holds others]")  # fmt: skip
@click.option("--quiet", is_flag=True, help="Print only errors.")
def join(first: Path, second: Path, side: str, output: Path | None, quiet: bool) -> None:
    """Join two views of a device in space.

    FIRST and SECOND are folders of softmodels measure view --in-space, of cameras that look square to each other. Views of the
    same pressure belong together. Places count from the middle of the base: x to the right and z upwards in the first view, y
    away from its camera.

    \b
    Exit status: 0 all joined and trusted; 3 some are not; 2 the input cannot be used.
    """
    try:
        tips = [space.joined(pair, side) for pair in space.pairs(space.read(first), space.read(second))]
        files = [folder / space.SPACE_TABLE for folder in (first, second)]
        folder = commands.open_folder(output, Path("tips"), "tips in space", {"from": side}, files)
        with folder.writing() as place:
            space.write(place / space.TIPS, tips)
    except (OwnFolderError, space.SpaceError) as error:
        cli.stop(str(error))
    except OSError as error:
        cli.stop(f"the results cannot be written: {errors.reason(error)}", commands.status_of(error))
    if not quiet:
        for tip in tips:
            at = ", ".join(
                f"{axis} {value * 1e3:.3f} +- {error * 1e3:.3f} mm"
                for axis, value, error in zip("xyz", tip.place, tip.error, strict=True)
            )
            remark = f"  not trusted: {'; '.join(tip.reasons)}" if tip.reasons else ""
            processes.say(f"{tip.views[0].file}  {tip.views[0].pressure[0]:9.1f} Pa  tip {at}{remark}")
        processes.say(f"{len(tips)} tips, {sum(tip.trust == 'no' for tip in tips)} of them untrusted; written to {folder.path}")
    sys.exit(cli.EXIT_SOME_REJECTED if any(tip.trust == "no" for tip in tips) else commands.EXIT_DONE)
