"""The command ``curve``: stress of a material in test specimens and its balloon's pressure, without a mesh."""

from __future__ import annotations

import csv
import re
from pathlib import Path
from typing import Unpack

import click
import numpy as np

from geometries.options import QuantityType
from softmodels.case.materials import material_from
from softmodels.cli.options import fail
from softmodels.cli.tensile_options import (
    CurveFiles,
    check_curves_given,
    curve_file,
    read_curves,
    specimen_options,
    stretch_range,
    tensile_option,
)
from softmodels.common.commands import FolderType, open_folder, status_of
from softmodels.common.folders import OwnFolderError
from softmodels.common.terminal import say
from softmodels.common.units import exact_text, with_prefix
from softmodels.fitting.curves.curve import TensileError
from softmodels.materials.laws import Material, MaterialError
from softmodels.materials.specimens import MODE_NAMES
from softmodels.materials.stability import MaterialCurves
from softmodels.mechanics.mpi import speaks

POINTS = 201
TABLE_POINTS = 11


class CurveGiven(CurveFiles):
    """Values of the command's further options, by name."""

    radius: float
    thickness: float


@click.command("curve", context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--material", "names", multiple=True, metavar="NAME[:KEY=VALUE,...]",
              help="Silicone, TOML file, or law with numbers (yeoh:c1=8kPa,c2=90Pa); several are compared.")  # fmt: skip
@click.option("--stretch", default="1:4", show_default=True, metavar="FROM:TO", help="Range of stretch.")
@click.option("--incompressible", is_flag=True, help="Use a Poisson's ratio of 0.5 instead of the material's.")
@click.option(
    "--radius", type=QuantityType("m"), default=0.02, help="The balloon's undeformed radius.  [default: 20mm]"
)
@click.option("--thickness", type=QuantityType("m"), default=0.001, help="Its undeformed thickness.  [default: 1mm]")
@tensile_option("Measured curve to plot for comparison, FILE[:TEST].")
@specimen_options
@click.option("--no-pictures", is_flag=True, help="Do not draw the picture.")
@click.option("--quiet", is_flag=True, help="Print only errors.")
@click.option("-o", "--output", type=FolderType(), help="Folder for the results.  [default: results/curve; "
              "results/curve-2 and so on if that holds other curves]")  # fmt: skip
def curve(names: tuple[str, ...], stretch: str, incompressible: bool, output: Path | None, no_pictures: bool, quiet: bool,
          **options: Unpack[CurveGiven]) -> None:  # fmt: skip
    """Show materials in uniaxial tension, pure shear and equibiaxial tension, and as a balloon.

    Each is drawn with its own Poisson's ratio. Where a law stops being stable, is said. Ogden's factors take commas:
    ogden:mu=0.63MPa,0.0012MPa,-0.01MPa,alpha=1.3,5,-2 and perhaps convention=2mu/alpha^2.

    \b
    Examples:
      softmodels curve --material ecoflex-00-30 --material ecoflex-00-30/marechal-2021 --stretch 1:3
      softmodels curve --material results/fit/fitted.toml --tensile curve.csv --stretch 0.5:6
      softmodels curve --material gent:shear_modulus=20kPa,limit=30 --radius 20mm --thickness 1mm

    \b
    Exit status: 0 done; 2 bad input.
    """
    try:
        low, high = stretch_range(stretch)
        if not names:
            raise MaterialError("nothing to show; give a material with --material NAME")
        materials = [read_material(text, incompressible) for text in names]
        check_curves_given({name: value for name, value in options.items() if name not in ("radius", "thickness")})
        asked = {**options, "names": names, "stretch": stretch, "incompressible": incompressible}
        files = [*map(Path, names), *map(curve_file, options["tensile"])]
        folder = open_folder(output, Path("results/curve"), "curves", asked, files) if speaks() else None
        measured = []
        if options["tensile"]:
            measured = read_curves(options, options["radius"], options["thickness"])
        if min(options["radius"], options["thickness"]) <= 0.0 or options["thickness"] > options["radius"]:
            raise TensileError(
                "the balloon's radius and thickness must be above zero, and the thickness less than the radius"
            )
    except (MaterialError, OwnFolderError, TensileError) as error:
        fail(str(error))
    stretches = np.linspace(low, high, POINTS)
    many = [MaterialCurves.of(name, material, stretches) for name, material in zip(names, materials, strict=True)]
    ratio = options["thickness"] / options["radius"]
    if folder is None:
        return
    try:
        with folder.writing() as place:
            _write(place / "curves.csv", many, ratio)
            if not no_pictures:
                from softmodels.pictures.fits import draw

                (place / "curves.png").write_bytes(draw(many, measured, options["radius"], options["thickness"]))
    except OwnFolderError as error:
        fail(str(error))
    except OSError as error:
        fail(f"the results cannot be written ({error.strerror or error})", status_of(error))
    if not quiet:
        for one in many:
            say(as_text(one, ratio))
        say(f"written to {folder.path}")


def read_material(text: str, incompressible: bool = False) -> Material:
    """Read ``"ecoflex-00-30"``, a TOML file's name or ``"yeoh:c1=8kPa,c2=90Pa"``."""
    name, _, numbers = text.partition(":")
    values: dict[str, str] = {}
    for part in re.split(r",(?=\s*\w+=)", numbers) if numbers else []:
        key, found, value = part.partition("=")
        if not found:
            raise MaterialError(f"material {text!r}: {part!r} is not KEY=VALUE")
        values[key.strip().replace("-", "_")] = value.strip()
    if incompressible:
        values["poisson"] = "0.5"
    return material_from(name, values)


def as_text(one: MaterialCurves, thickness_over_radius: float) -> str:
    """Return a material's table for the terminal."""
    modulus, unit = with_prefix(one.material.shear_modulus_0, "Pa")
    nu = one.material.poisson
    lines = [f"{one.name}: {one.material.name}, shear modulus {modulus} {unit}, Poisson's ratio {nu:g}"]
    lines.append("  stretch   nominal stress (kPa)                      balloon (kPa)")
    lines.append("            uniaxial     planar       equibiaxial")
    columns = [*(one.responses[mode].stress for mode in MODE_NAMES), one.balloon(thickness_over_radius)]
    for i in np.linspace(0, len(one.stretch) - 1, TABLE_POINTS).astype(int):
        lines.append(f"  {one.stretch[i]:7.3f} " + "".join(f"  {column[i] / 1e3:11.5g}" for column in columns))
    lines += [f"  warning: {text}" for text in one.verdict.flags]
    lines += [f"  {text}" for text in one.verdict.notes]
    return "\n".join(lines) + "\n"


def _write(path: Path, many: list[MaterialCurves], thickness_over_radius: float) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        stresses = [f"{mode}_{kind}_Pa" for mode in MODE_NAMES for kind in ("nominal", "true")]
        rows.writerow(["material", "poisson", "stretch", *stresses, "balloon_Pa", "thickness_over_radius"])
        for one in many:
            columns = [c for mode in MODE_NAMES for c in (one.responses[mode].stress, one.true_stress(mode))]
            columns.append(one.balloon(thickness_over_radius))
            for i, stretch in enumerate(one.stretch):
                numbers = [f"{column[i]:.9g}" for column in columns]
                nu = exact_text(one.material.poisson, "")
                rows.writerow([one.name, nu, f"{stretch:.9g}", *numbers, f"{thickness_over_radius:.6g}"])
