"""``softmodels limit``: how much pressure a design can bear, by material, and how the workshop's tolerances scatter it."""

from __future__ import annotations

import csv
import dataclasses
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

from geometries import Actuator, GeometryError, HollowDisk, MeshingError
from geometries.fields import shown
from geometries.options import QuantityType, check_meaning, device_options, device_told
from measurement.output_option import FolderType, open_folder
from measurement.output_place import status_of
from measurement.own_folder import OwnFolderError
from measurement.result_folder import ResultFolder
from measurement.units import WATER_DENSITY
from softmodels.case.case import Case, CaseError
from softmodels.case.material_table import material_from, material_names, material_options
from softmodels.cli.options import fail
from softmodels.materials.laws import Material, MaterialError
from softmodels.materials.stability import check_rest, weakest, weakness
from softmodels.mechanics.body import BodyError
from softmodels.mechanics.compiling import CompilingError
from softmodels.mechanics.contact import ObstacleError
from softmodels.mechanics.mpi import abort_on_error, is_root, on_root, start
from softmodels.results.limit_band import band_texts, with_ends
from softmodels.results.limits import LARGEST_STRETCH, Limit, Tolerance, find_limit, samples, scatter
from softmodels.results.lost_path import NEAR
from softmodels.results.outcomes import FAILED
from softmodels.results.stability_report import unseen
from softmodels.results.writing import write_text

SAMPLES = 32
PERCENTILES = (5, 25, 50, 75, 95)


def limit(file: Path | None, working_cm: float | None, vary: tuple[str, ...], count: int | None, normal: bool,
          water_density: float | None, output: Path | None, material: tuple[str, ...], **values: Any) -> None:  # fmt: skip
    """Tell the largest pressure a device can bear, and where it is strained most there.

    The device is that of a case FILE or of the options below (as a section, unless --section says otherwise); every
    --material adds a row. With --vary the limit's scatter over fabrication tolerances is added: of any thickness or other
    length, and of the offset of the cavity, which on a disk sits too high in a part of the same height (a thinner membrane
    over a thicker base). A disk's core that is shifted sideways has no effect to first order, for shifts to the left and to
    the right do the same; it is not sampled.

    \b
    Examples:
      softmodels limit results/disk/case.toml
      softmodels limit --variant shadow --material ecoflex-00-30 --material dragon-skin-20 --working-cm 20
      softmodels limit --variant shadow --shear-modulus 20kPa --vary membrane=2mm+-0.2mm --vary offset=0mm+-0.2mm
      softmodels limit results/seminar/case.toml --vary thickness=8mm+-0.2mm --vary offset=-1mm+-0.2mm --samples 8
    """
    try:
        case = None if file is None else Case.from_file(file)
        device, materials = _asked(case, file, material, values)
        for made in materials.values():
            check_rest(made)
        tolerances = [Tolerance.parse(text, type(device)) for text in vary]
        if working_cm is not None and not working_cm > 0:
            raise CaseError(f"--working-cm {working_cm:g}: the working pressure must be above zero")
        if not tolerances and (normal or count is not None):
            raise CaseError("--samples and --normal are about tolerances; give one with --vary")
        asked = _as_asked(case, device, materials, water_density)
        cm = asked.cm
    except (CaseError, GeometryError, MaterialError) as error:
        fail(str(error))
    comm = start()
    abort_on_error(comm)
    spread: list[Any] = []
    folder: list[ResultFolder] = []  # of rank 0
    if output is not None or tolerances:
        given = {**values, "vary": vary, "count": count, "normal": normal, "material": material, "cm": cm}
        files = [path for path in (file, *map(Path, material)) if path is not None and path.is_file()]
        try:
            on_root(comm, lambda: folder.append(open_folder(output, Path("results/limit"), "limits", given, files)))
        except OwnFolderError as error:
            fail(str(error))
    materials, bands = with_ends(materials)
    try:
        around = (asked.sheet, asked.obstacle, asked.formulation)
        limits = find_limit(device, list(materials.values()), comm, *around)
        first = next(iter(materials.values()))
        if tolerances:
            spread = scatter(device, first, tolerances, samples(tolerances, count or SAMPLES, normal), comm, *around)
    except (CaseError, ObstacleError) as error:
        fail(str(error))
    except (MeshingError, BodyError, CompilingError) as error:
        fail(str(error), FAILED)
    except OSError as error:  # the mesh is made in the folder for temporary files
        fail(f"the mesh cannot be written ({error.strerror or error})", FAILED)
    if not is_root(comm):
        return
    table = [_row(name, found, cm, working_cm) for name, found in zip(materials, limits, strict=True)]
    for row, found in zip(table, limits, strict=True):
        click.echo(_sentence(row, found, device))
    for text in band_texts(bands, dict(zip(materials, limits, strict=True)), cm):
        click.echo(text)
    for made, found in zip(materials.values(), limits, strict=True):
        weak = weakest(made)
        if weak is not None and found.stretch >= NEAR * weak.stretch:
            click.echo(
                f"note: {weakness(made)}, and the state found has stretch {found.stretch:.3g}: what gives way there may be the "
                "law and not the device; take one that is stable over these stretches (softmodels curve shows them)"
            )
    if hidden := unseen(device):
        click.echo(f"note: {hidden}")
    if len(device.ratios) > 1:
        how = "in its ratios" if device.ratios != (1.0,) * len(device.ratios) else "the same"
        click.echo(
            f"note: the pressure is that of all {len(device.ratios)} cavities, {how}; softmodels run takes a series for each"
        )
    if spread:
        click.echo(_scatter_text(spread, tolerances, cm, working_cm))
    if folder:
        try:
            with folder[0].writing() as place:
                _write(place, table, spread, tolerances, cm, working_cm, limits[0])
        except OwnFolderError as error:
            fail(str(error))
        except OSError as error:
            fail(f"the tables cannot be written into {folder[0].path} ({error.strerror or error})", status_of(error))
        click.echo(f"tables in {folder[0].path}")


def _as_asked(
    case: Case | None, device: Actuator, materials: Mapping[str, Material], water_density: float | None
) -> Case:
    """A case around the device, with a load that is not looked at: what no case may be, no limit is asked of.

    Raises:
        CaseError: See `Case`.
    """
    load: dict[str, Any] = {"pressures_cm": (1.0,), "volumes_ml": (), "strokes_ml": (), "program": (), "supply": None}
    if water_density is not None:
        load["water_density"] = water_density
    for material in materials.values():
        around = case or Case("limit", device, material, pressures_cm=(1.0,))
        made = dataclasses.replace(around, name="limit", actuator=device, material=material, cycle=False, **load)
    return made


def _asked(
    case: Case | None, file: Path | None, names: Sequence[str], values: dict[str, Any]
) -> tuple[Actuator, dict[str, Material]]:
    law = {key: values.pop(key) for key in material_names()}
    given = any(value is not None for value in law.values())
    if case is not None:
        device, default = case.actuator, case.material
        changes = {key: value for key, value in values.items() if value is not None and key != "variant"}
        unknown = changes.keys() - {field.name for field in dataclasses.fields(device)}
        if values.get("variant") or unknown:
            raise CaseError(f"{file} names the device already; leave out --variant and options of other devices")
        device = dataclasses.replace(device, **changes)
        check_meaning(device, changes)
        if not names and not given:
            return device, {default.name: default}
    else:
        if values.get("section") is None:
            values["section"] = "axisymmetric"
        device = device_told(HollowDisk, values)
    if len(names) > 1 and given:
        raise CaseError("parameters such as --shear-modulus belong to one --material; several are compared as they are")
    if not names:
        made = material_from(None, law)
        return device, {made.name: made}
    return device, {name: material_from(name, law) for name in names}


def _row(name: str, found: Limit, cm: float, working_cm: float | None) -> dict[str, Any]:
    row = {
        "material": name, "kind": found.kind, "limit_cm": found.pressure / cm, "limit_Pa": found.pressure,
        "added_volume_ml": found.added_volume * 1e6, **{f"{k}_mm": v * 1e3 for k, v in found.rises.items()},
        "max_stretch": found.stretch, **{f"{axis}_mm": x * 1e3 for axis, x in zip("xyz", found.place, strict=True)},
    }  # fmt: skip
    return row if working_cm is None else {**row, "margin": found.pressure / cm / working_cm}


def _sentence(row: dict[str, Any], found: Limit, device: Actuator) -> str:
    radius = float(np.hypot(found.place[0], found.place[1])) * 1e3
    place = f"largest stretch {found.stretch:.3g}, {radius:.3g} mm from the axis at height {row['z_mm']:.3g} mm"
    rises = ", ".join(f"{name} {rise * 1e3:+.4g} mm" for name, rise in found.rises.items())
    state = f"{rises}, {row['added_volume_ml']:+.4g} ml; {place}"
    at = f"{row['limit_cm']:.4g} cm ({row['limit_Pa'] / 1e3:.4g} kPa)"
    what = {
        "limit": f"limit pressure {at}: {state}",
        "bifurcation": f"leaves its shape (bifurcation) at {at}: {state}",
        "none": f"no limit up to a stretch of {LARGEST_STRETCH:g}, which it reaches at {at}: {state}",
        "lost": f"no limit up to {at}, where the path was lost ({found.why}): {state}",
    }[found.kind]
    text = f"{row['material']}: {what}"
    if "margin" in row:
        verdict = "above" if row["margin"] > 1 else "BELOW"
        text += f"; {row['margin']:.2f} times the working pressure, {verdict} it"
    return text


def _borne(spread: list[Any]) -> tuple[str, list[Any]]:
    """What the devices within the tolerances bear: their limits; where none has one, the pressures of the largest stretch."""
    found = [one for one in spread if one[1].found]
    stretched = [one for one in spread if one[1].kind == "none"]
    return (
        ("limit pressure", found)
        if found or not stretched
        else (f"pressure at a stretch of {LARGEST_STRETCH:g}", stretched)
    )


def _scatter_text(spread: list[Any], tolerances: Sequence[Tolerance], cm: float, working_cm: float | None) -> str:
    what, counted = _borne(spread)
    if not counted:
        return f"none of the {len(spread)} devices within the tolerances has a limit"
    pressures = np.array([found.pressure / cm for _, found in counted])
    quantiles = np.percentile(pressures, PERCENTILES)
    text = f"{len(spread)} devices within the tolerances: {what} " + ", ".join(
        f"{q:.4g} cm ({p} %)" for p, q in zip(PERCENTILES, quantiles, strict=True)
    )
    text += f"; lowest {pressures.min():.4g} cm, highest {pressures.max():.4g} cm"
    if without := len(spread) - len(counted):
        text += f"; {without} have none or were not followed to it"
    if (
        len(pressures) > len(tolerances) + 1
    ):  # all parameters at once: one alone would take the others' scatter for its own
        values = [[_regressor(t, changes[t.name]) for t in tolerances] for changes, _ in counted]
        slopes = np.linalg.lstsq(values - np.mean(values, axis=0), np.log(pressures / pressures.mean()), rcond=None)[0]
        for t, slope in zip(tolerances, slopes, strict=True):
            more = shown(t.half, t.unit) if t.signed else "one percent"
            effect = 100 * np.expm1(slope) if t.signed else slope
            text += f"\n  {t.name.replace('_', ' ')}: {more} more changes the {what} by about {effect:+.2g} %"
    if working_cm is not None:
        text += f"\n  {np.mean(pressures < working_cm) * 100:.3g} % lie below the working pressure"
    return text


def _regressor(tolerance: Tolerance, value: float) -> float:
    return (value - tolerance.middle) / tolerance.half if tolerance.signed else float(np.log(value))


def _write(
    folder: Path, table: list[dict[str, Any]], spread: list[Any], tolerances: Sequence[Tolerance], cm: float,
    working_cm: float | None, nominal: Limit,
) -> None:  # fmt: skip
    write_text(folder / "limit.json", json.dumps(table, indent=2) + "\n")
    _csv(folder / "limit.csv", table)
    if spread:
        rows = [{**changes, **_row("", found, cm, working_cm)} for changes, found in spread]
        _csv(folder / "scatter.csv", rows)
        from softmodels.pictures.limit_plots import scatter_figure

        what, counted = _borne(spread)
        if counted:
            pressures = [(changes, found.pressure / cm) for changes, found in counted]
            figure = scatter_figure(pressures, tolerances, what, nominal.pressure / cm, working_cm)
            figure.savefig(folder / "scatter.png")


def _csv(path: Path, rows: list[dict[str, Any]]) -> None:
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, fieldnames=list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_text(path, text.getvalue())


def _command() -> click.Command:
    made: Any = material_options(limit)
    made = device_options(HollowDisk)(made)
    text = f"Density of the column's liquid.  [default: the case's, or {WATER_DENSITY:g}kg/m^3]"
    made = click.option("--water-density", type=QuantityType("kg/m^3"), help=text)(made)
    text = "Folder for tables and picture.  [default: with --vary results/limit, or results/limit-2 and so on]"
    made = click.option("-o", "--output", type=FolderType(), help=text)(made)
    made = click.option("--normal", is_flag=True, help="Tolerances are two standard deviations; else all in them are as "
                        "likely.")(made)  # fmt: skip
    made = click.option("--samples", "count", type=click.IntRange(2, 4096),
                        help=f"Devices within the tolerances.  [default: {SAMPLES}]")(made)  # fmt: skip
    made = click.option("--vary", multiple=True, metavar="NAME=VALUE+-HALF", help="A tolerance, such as "
                        "membrane=2mm+-0.2mm (a thickness) or offset=0mm+-0.2mm (the cavity's height in the part); may be "
                        "repeated.")(made)  # fmt: skip
    made = click.option("--working-cm", type=QuantityType(""), help="Working pressure in cm of water, for the margin.")(
        made
    )
    made = click.argument("file", required=False, type=click.Path(path_type=Path))(made)
    command = click.command(name="limit", context_settings={"help_option_names": ["-h", "--help"]})(made)
    for parameter in command.params:
        if parameter.name == "material":  # one in a run; here as many as there are to compare
            parameter.multiple = True
    return command  # type: ignore[no-any-return]


command = _command()
