"""The command ``softmodels``: run a case file, fit a material, check the installation, draw results."""

from __future__ import annotations

from pathlib import Path

from measurement.ending import stoppable
from softmodels.mechanics.mpi import speaks

with stoppable("softmodels", speaks):
    import click

    from softmodels import __version__
    from softmodels.cli import limit_command
    from softmodels.cli import mould as mould_command
    from softmodels.cli import options as commandline
    from softmodels.cli.curve_command import curve
    from softmodels.cli.demo import demo
    from softmodels.cli.design import design
    from softmodels.cli.examples import examples
    from softmodels.cli.export import command as export_command
    from softmodels.cli.fit_command import fit_material
    from softmodels.cli.run_command import run
    from softmodels.cli.score_command import score
    from softmodels.cli.silicone_command import silicones


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="softmodels")
def softmodels() -> None:
    """Simulate pneumatic soft actuators.

    \b
    python -m softmodels.disk --help    the disk actuator
    softmodels run case.toml            repeat a run from its case file
    softmodels run --device Membrane --pressure-cm 0:20   inflate any device of the library
    softmodels limit --help             how much pressure a design can bear
    softmodels design problem.toml      the device that does best what is asked for, within its limits
    softmodels mould case.toml          the bodies to cast a device in, and a sheet for the bench
    softmodels export case.toml -o x.inp    the same case for CalculiX or FEBio
    softmodels draw results/disk        make the pictures, film and report of a run anew
    softmodels fit --tensile pull.csv   a material with error bars from measured curves
    softmodels curve --material yeoh:c1=8kPa   a material's curves, its balloon, where it is not stable
    softmodels score --material fitted.toml --tensile other.csv   a material against held-out measurements
    softmodels silicones                named silicones with all their sources
    softmodels examples                 small files to try everything with: photographs, a curve, a part, cases
    softmodels demo                     once around: simulate, photograph, measure, fit, compare
    softmodels doctor                   check the installation
    """


softmodels.add_command(run)
softmodels.add_command(limit_command.command)
softmodels.add_command(mould_command.command)
softmodels.add_command(export_command)


@softmodels.command("draw")
@click.argument("folder", type=click.Path(path_type=Path))
def draw(folder: Path) -> None:
    """Make the pictures, the film and the report of the results in FOLDER anew."""
    from softmodels.pictures.draw import draw_folder

    draw_folder(folder)


@softmodels.command("doctor")
def check() -> None:
    """Tell what is installed and whether it works: versions, MPI, compiler, a one-second solve."""
    from softmodels.cli.doctor import doctor

    doctor()


softmodels.add_command(fit_material)
softmodels.add_command(curve)
softmodels.add_command(score)
softmodels.add_command(silicones)
softmodels.add_command(design)
softmodels.add_command(demo)
softmodels.add_command(examples)


def main() -> None:
    commandline.main(softmodels)


if __name__ == "__main__":
    main()
