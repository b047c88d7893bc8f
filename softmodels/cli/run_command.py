"""``softmodels run``: a case file, or any registered device with options of its own."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path

import click

from geometries import ACTUATORS, Actuator
from softmodels.case.case import Case
from softmodels.case.materials import material_from, to_table
from softmodels.cli.options import DEVICE, RunOptions, by_device, device_command, execute, run_options, taken
from softmodels.materials.silicones import product_of, silicone_called
from softmodels.mechanics.solver import METHODS


def command_of(device: type[Actuator]) -> click.Command:
    """Return the command that runs a registered device."""
    words = tuple(f"--pressure-cm {device.pressures} {options}" for options in device.examples)
    return device_command(device, f"softmodels run {DEVICE} {device.__name__}", words)


@click.command("run", cls=by_device(command_of))
@click.argument("file", type=click.Path(path_type=Path))
@click.option(
    DEVICE, metavar="NAME", expose_value=False, help="A device with its own options, instead of a FILE: "
    f"{', '.join(ACTUATORS)}. softmodels run {DEVICE} NAME --help shows them.",
)  # fmt: skip
@click.option("--material", metavar="NAME", help="Material, instead of the case's [material]: a silicone, "
              "or a TOML file such as fitted.toml of softmodels fit.")  # fmt: skip
@click.option("--band", metavar="FILE|NAME", help="fitted.toml of a fitted material, instead of the case's [band]: "
              "adds the 95 % band from its errors to path.csv and the curves. Or a silicone's name: each of its sources "
              "is solved, and the curves show the band they span.")  # fmt: skip
@click.option("--solver", type=click.Choice(METHODS), help="Linear solver, instead of the case's: direct "
              "(factorisation), iterative (multigrid), or auto by the available memory.")  # fmt: skip
@run_options
def run(file: Path, material: str | None, band: str | None, solver: str | None, **values: object) -> None:
    """Run a case FILE, such as the case.toml in a folder of results, or a device by its options.

    Results are written to --output, by default results/NAME with the case's name. Words after -- go to PETSc.

    \b
    Examples:
      softmodels run results/disk/case.toml
      softmodels run lifted.toml --material results/fit/fitted.toml --band results/fit/fitted.toml
      softmodels run --device HollowDisk --pressure-cm 0:177 --section axisymmetric
      softmodels run --device HollowDisk --help
    """
    execute(lambda: case_of_file(file, material, band, solver), taken(RunOptions, values), [file])


def case_of_file(file: Path, material: str | None, band: str | None = None, solver: str | None = None) -> Case:
    """Return a case file's case, with the given material, band or solver."""
    more: dict[str, Mapping[str, object]] = {}
    if material is not None:
        more["material"] = to_table(material_from(material, {}))
    if band is not None:
        product = product_of(band) if silicone_called(band) else ""
        more["band"] = {"silicone": product} if product else {"file": str(Path(band).absolute())}
    case = Case.from_file(file, more)
    return case if solver is None else dataclasses.replace(case, solver=solver)
