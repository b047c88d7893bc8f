"""The command ``softmodels``: run a case file, fit a material, check the installation, draw results."""

from __future__ import annotations

from softmodels.common import commands
from softmodels.mechanics import mpi

with commands.stoppable("softmodels", mpi.speaks):
    import click

    from softmodels import __version__
    from softmodels.cli import options as commandline

PLACES = {
    "softmodels.cli.analyses": {
        "grasp": "Close equal fingers around an object that is free in their plane, and load it.",
        "limit": "Find the largest pressure a device can take, and the place of its largest strain.",
        "modes": "Find the natural frequencies of a device at rest and while it is inflated, and their modes.",
    },
    "softmodels.cli.design": {
        "design": "Find the device that best meets the objective of a problem FILE, within its limits.",
        "study": "Solve the case of a study FILE many times with some of its fields varied.",
    },
    "softmodels.cli.doctor": {
        "app": "Open the bench as a page in the browser: photographs, material, device, mould.",
        "doctor": "Check the installation: list versions and what is missing (MPI, compiler), and solve a small case.",
    },
    "softmodels.cli.examples": {
        "demo": "Run the whole workflow: simulate a known silicone, photograph it, measure the photographs, fit, and compare.",
        "examples": "Write small files to try every command with: photographs, boards, a tensile curve, a STEP part, cases.",
    },
    "softmodels.cli.exports": {
        "export":
            "Write the case FILE for CalculiX: the same mesh, silicones, supports, rigid parts, contact and loads.",
        "mould":
            "Make the mould of the device in a case FILE: cups and lids as STEP and STL, in mm, and a sheet for the bench.",
        "reduce": "Reduce the results in FOLDER to the device's tip, for robot simulators.",
    },
    "softmodels.cli.material_commands": {
        "curve": "Show materials in uniaxial tension, pure shear and equibiaxial tension, and as a balloon.",
        "fit": "Fit laws to measurements: parameters with 95 % intervals, and a material file for a simulation.",
        "score": "Score materials against held-out tensile curves, or against outlines of a device.",
        "silicones": "List the named silicones: shear modulus at small strain, stresses in uniaxial tension, range and source.",
    },
    "softmodels.cli.options": {
        "run": "Run a case FILE, such as the case.toml in a folder of results, or a device by its options.",
    },
    "softmodels.cli.results": {
        "compare": "Compare the results in FOLDERS with those in the first: their cases, main figures, paths and outlines.",
        "draw": "Redraw the pictures and the report of the results in FOLDER.",
        "line": "Take the values along a line through the body of the results in FOLDER, such as the stress through a wall.",
        "open": "Open the report of the results in FOLDER in the browser.",
    },
}  # fmt: skip
"""The first sentence of each command's help, by its module and its name."""


@click.group(
    cls=commands.LazyGroup, program="softmodels", places=PLACES, speaks=mpi.speaks,
    context_settings={"help_option_names": ["-h", "--help"]},
)  # fmt: skip
@click.version_option(__version__, prog_name="softmodels")
def softmodels() -> None:
    """Simulate pneumatic soft actuators.

    \b
    python -m softmodels.disk --help    the disk actuator
    softmodels run case.toml            repeat a run from its case file
    softmodels run --device Membrane --pressure-cm 0:20   inflate any device of the library
    softmodels limit --help             how much pressure a design can bear
    softmodels grasp finger.toml        an object between several fingers, and the load that it bears
    softmodels modes --help             natural frequencies at rest and under pressure
    softmodels design problem.toml      the device that does best what is asked for, within its limits
    softmodels study study.toml         many samples of a case: dataset, response surfaces, Sobol indices
    softmodels mould case.toml          the bodies to cast a device in, and a sheet for the bench
    softmodels export case.toml -o x.inp    the same case for CalculiX
    softmodels reduce results/finger -o finger.xml   a model for robot simulators: pose and stiffness over the pressure
    softmodels open results/disk        open a report in the browser
    softmodels compare results/a results/b  what differs, and by how much
    softmodels line results/disk --through apex  values along a line, such as the stress through a wall
    softmodels draw results/disk        make the pictures and report of a run anew; its film with --film
    softmodels fit --tensile pull.csv   a material with error bars from measured curves
    softmodels curve --material yeoh:c1=8kPa   a material's curves, its balloon, its unstable range
    softmodels score --material fitted.toml --tensile other.csv   a material against held-out measurements
    softmodels silicones                named silicones with all their sources
    softmodels examples                 small files to try everything with: photographs, a curve, a part, cases
    softmodels demo                     whole workflow: simulate, photograph, measure, fit, compare
    softmodels doctor                   check the installation
    """


def main() -> None:
    commandline.main(softmodels)


if __name__ == "__main__":
    main()
