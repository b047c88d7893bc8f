"""``python -m geometries``: make a mesh file of a device from the command line."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from softmodels.common import commands

with commands.stoppable("softmodels"):
    import click

    from geometries import ACTUATORS, meshing, registry
    from geometries.actuator import Actuator
    from softmodels.common import commands
    from softmodels.common.errors import GeometryError, MeshingError


class DeviceCommands(commands.CommandGroup):
    """A command for every registered device, made when it is asked for."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(ACTUATORS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        return _command(cmd_name, ACTUATORS[cmd_name]) if cmd_name in ACTUATORS else None


@click.group(cls=DeviceCommands, invoke_without_command=True, context_settings={"help_option_names": ["-h", "--help"]})
@commands.version_option
@click.pass_context
def main(context: click.Context) -> None:
    """Make the mesh of a soft actuator.

    Lengths and angles are written with their unit, such as 20mm or 45deg. Exit status: 0 mesh written, 1 the mesher
    failed, 2 the input makes no device or the file cannot be written.

    \b
    Examples:
      python -m geometries HollowDisk --help
      python -m geometries HollowDisk --cavity-radius 12mm --membrane 4mm -o disk.msh
    """
    if context.invoked_subcommand is None:
        click.echo("Devices (python -m geometries DEVICE --help shows the parameters):")
        for name, device in ACTUATORS.items():
            click.echo(f"  {name}  {_summary(device)}")


def _summary(device: type[Actuator]) -> str:
    return (device.__doc__ or "").strip().split("\n")[0]


def _command(name: str, device: type[Actuator]) -> click.Command:
    def run(output: Path | None, **values: Any) -> None:
        _make(device, output, values)

    lines = [f"  python -m geometries {name} {options} -o {device.stem}.msh" for options in ("", *device.examples)]
    run.__doc__ = "\n".join([_summary(device), "", "\b", "Examples:", *(line.replace("  -o", " -o") for line in lines)])
    made: Callable[..., Any] = registry.device_options(device)(run)
    made = click.option(
        "-o", "--output", type=click.Path(path_type=Path), help="Mesh file, ending in .msh.  [default: device and key]"
    )(made)
    return click.command(name)(made)


def _make(device: type[Actuator], output: Path | None, values: dict[str, Any]) -> None:
    try:
        actuator = registry.device_told(device, values)
        path = actuator.write(output if output is not None else Path(f"{actuator.name}.msh"))
        mesh = meshing.summarize(path)
    except GeometryError as error:
        _stop(str(error), 2)
    except OSError as error:
        _stop(f"the mesh file cannot be written: {error}", 2)
    except MeshingError as error:
        _stop(str(error), 1)
    kind = "tetrahedra" if actuator.dimension == 3 else "triangles"
    click.echo(
        f"{device.__name__}: {mesh.cells} {kind} of order {actuator.mesh_order}, {mesh.nodes} nodes, "
        f"smallest quality {mesh.quality:.2f}"
    )
    for remark in actuator.remarks:
        click.echo(f"note: {remark}")
    if mesh.straight:
        click.echo(f"warning: {meshing.straight_text(mesh.straight)}")
    click.echo(
        f"Whole device: solid {actuator.solid_volume * 1e6:.4g} ml, cavity {actuator.cavity_volume * 1e6:.4g} ml; "
        f"the mesh models 1/{actuator.copies} of it; written to {path}"
    )


def _stop(sentence: str, status: int) -> None:
    commands.tell(sentence)
    sys.exit(status)


if __name__ == "__main__":
    commands.run_command(main, "python -m geometries")
