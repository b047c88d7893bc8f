"""``softmodels limit`` and ``softmodels modes``: limit pressure and its scatter over tolerances; natural frequencies."""

from __future__ import annotations

import csv
import dataclasses
import io
import json
import math
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np
import numpy.typing as npt

from geometries import ACTUATORS, Actuator, GeometryError, HollowDisk, MeshingError
from geometries.options import QuantityType, check_meaning, device_options, device_told
from geometries.registry import to_table
from softmodels.case.case import Case
from softmodels.case.entries import INPUT_ERRORS, CaseError, SeriesError, one_of_text, series, split_text
from softmodels.case.materials import material_from
from softmodels.cli.options import (
    DEVICE,
    CaseOptions,
    Values,
    by_device,
    fail,
    law_taken,
    material_options,
    open_on_root,
    taken,
    write_into,
)
from softmodels.cli.run_command import case_of_file
from softmodels.common.commands import FolderType
from softmodels.common.files import image_uri, read_text, write_bytes, write_text
from softmodels.common.folders import ResultFolder
from softmodels.common.pages import Bullets, Cell, Charts, Fact, Folded, Listing, Page, Picture, Provenance, Table, Text
from softmodels.common.processes import say
from softmodels.common.schema import shown
from softmodels.common.units import WATER_DENSITY, UnitError, quantity, readable
from softmodels.materials.laws import Material, MaterialError
from softmodels.materials.silicones import extrapolated, publications
from softmodels.materials.stability import check_rest, weakest, weakness
from softmodels.mechanics.component import ComponentError
from softmodels.mechanics.mpi import abort_on_error, is_root, start
from softmodels.runs.analyses import (
    LARGEST_STRETCH,
    MOST_MODES,
    Limit,
    NaturalFrequencies,
    Tolerance,
    band_texts,
    case_for_modes,
    check_hold,
    check_varied,
    find_frequencies,
    find_limit,
    samples,
    scatter,
    with_sources,
)
from softmodels.runs.model import AtRest
from softmodels.runs.notes import NEAR_STRETCH_LIMIT, unseen
from softmodels.runs.outcomes import FAILED, Ended, RunError

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from mpi4py import MPI


# ----------------------------------------------------------------------------------------------------------------------
# Output of ``softmodels limit``: sentences, tables and the picture of the scatter.


PERCENTILES = (5, 25, 50, 75, 95)

type Row = dict[str, str | float]
"""A row of ``limit.csv``."""
type Sampled = tuple[Mapping[str, float], Limit]
"""A device within the tolerances: its parameters and its limit."""


@dataclasses.dataclass(frozen=True)
class LimitColumn:
    """Unit of the pressures: Pa in one cm of the column, and the working pressure in cm, if given."""

    cm: float
    working: float | None


@dataclasses.dataclass(frozen=True)
class Scatter:
    """The sampled devices within the tolerances."""

    tolerances: Sequence[Tolerance]
    sampled: Sequence[Sampled]

    @property
    def borne(self) -> tuple[str, list[Sampled]]:
        """Return their limit pressures; if none has a limit, the pressures at the largest stretch."""
        found = [one for one in self.sampled if one[1].found]
        stretched = [one for one in self.sampled if one[1].kind == "none"]
        if found or not stretched:
            return "limit pressure", found
        return f"pressure at a stretch of {LARGEST_STRETCH:g}", stretched


def row_of(name: str, found: Limit, column: LimitColumn) -> Row:
    """Return the table row of a material's limit."""
    row: Row = {
        "material": name, "kind": found.kind, "limit_cm": found.pressure / column.cm, "limit_Pa": found.pressure,
        "added_volume_ml": found.added_volume * 1e6, **{f"{k}_mm": v * 1e3 for k, v in found.rises.items()},
        "max_stretch": found.stretch, **{f"{axis}_mm": x * 1e3 for axis, x in zip("xyz", found.place, strict=True)},
    }  # fmt: skip
    row |= {"hold_s": found.held} if found.held else {}
    return row if column.working is None else {**row, "margin": abs(found.pressure) / column.cm / column.working}


def sentence(name: str, found: Limit, column: LimitColumn) -> str:
    """Return the limit of a device in a material as a sentence."""
    radius, height = float(np.hypot(found.place[0], found.place[1])) * 1e3, found.place[2] * 1e3
    place = f"largest stretch {found.stretch:.3g}, {radius:.3g} mm from the axis at height {height:.3g} mm"
    rises = ", ".join(f"{name} {rise * 1e3:+.4g} mm" for name, rise in found.rises.items())
    state = f"{rises}, {found.added_volume * 1e6:+.4g} ml; {place}"
    at = f"{found.pressure / column.cm:.4g} cm ({found.pressure / 1e3:.4g} kPa)"
    what = {
        "limit": f"limit pressure {at}: {state}",
        "bifurcation": f"bifurcation at {at}: {state}",
        "none": f"no limit up to a stretch of {LARGEST_STRETCH:g}, reached at {at}: {state}"
        if found.pressure > 0.0
        else f"no limit down to {at}: {state}",
        "lost": f"no limit up to {at}, where the path was lost ({found.why}): {state}",
    }[found.kind]
    if found.held:
        what = f"{at} is borne for {found.held:g} s, and then: {state}"
    text = f"{name}: {what}"
    if column.working is not None:
        margin = abs(found.pressure) / column.cm / column.working
        text += f"; {margin:.2f} times the working pressure, {'above' if margin > 1 else 'BELOW'} it"
    return text


def scatter_text(scatter: Scatter, column: LimitColumn) -> str:
    """Return how the limit scatters, and which parameters affect it."""
    what, counted = scatter.borne
    count = len(scatter.sampled)
    if not counted:
        return f"none of the {count} devices within the tolerances has a limit"
    pressures = np.array([found.pressure / column.cm for _, found in counted])
    quantiles = np.percentile(pressures, PERCENTILES)
    text = f"{count} devices within the tolerances: {what} " + ", ".join(
        f"{q:.4g} cm ({p} %)" for p, q in zip(PERCENTILES, quantiles, strict=True)
    )
    text += f"; lowest {pressures.min():.4g} cm, highest {pressures.max():.4g} cm"
    if without := count - len(counted):
        text += f"; {without} have no limit or were not followed to it"
    if len(pressures) > len(scatter.tolerances) + 1:
        text += _effects(scatter.tolerances, counted, pressures, what)
    if column.working is not None:
        text += f"\n  {np.mean(pressures < column.working) * 100:.3g} % are below the working pressure"
    return text


def _effects(
    tolerances: Sequence[Tolerance], counted: Sequence[Sampled], pressures: npt.NDArray[np.float64], what: str
) -> str:
    """Return the effect of each parameter, fitted jointly so that none absorbs the scatter of another."""
    values = [[_regressor(t, changes[t.name]) for t in tolerances] for changes, _ in counted]
    slopes = np.linalg.lstsq(values - np.mean(values, axis=0), np.log(pressures / pressures.mean()), rcond=None)[0]
    text = ""
    for t, slope in zip(tolerances, slopes, strict=True):
        more = shown(t.half, t.unit) if t.signed else "one percent"
        effect = 100 * np.expm1(slope) if t.signed else slope
        text += f"\n  {t.name.replace('_', ' ')}: {more} more changes the {what} by about {effect:+.2g} %"
    return text


def _regressor(tolerance: Tolerance, value: float) -> float:
    return (value - tolerance.middle) / tolerance.half if tolerance.signed else float(np.log(value))


def write(folder: Path, limits: Mapping[str, Limit], scatter: Scatter, column: LimitColumn) -> Figure | None:
    """Write ``limit.json`` and ``limit.csv``, and of a scatter its table and picture, which is returned.

    Raises:
        OSError: The folder cannot be written.
    """
    table = [row_of(name, found, column) for name, found in limits.items()]
    write_text(folder / "limit.json", json.dumps(table, indent=2) + "\n")
    _csv(folder / "limit.csv", table)
    if not scatter.sampled:
        return None
    _csv(folder / "scatter.csv", [{**changes, **row_of("", found, column)} for changes, found in scatter.sampled])
    what, counted = scatter.borne
    if not counted:
        return None
    from softmodels.pictures.analyses import scatter_figure

    pressures = [(changes, found.pressure / column.cm) for changes, found in counted]
    nominal = next(iter(limits.values())).pressure / column.cm
    figure = scatter_figure(pressures, scatter.tolerances, what, nominal, column.working)
    figure.savefig(folder / "scatter.png")
    return figure


NO_MESH_ERROR = "The mesh error was not estimated: repeat the command with half the cell size (cell_size in the case)."
KINDS = {"limit": "limit pressure", "bifurcation": "bifurcation", "none": "no limit up to", "lost": "path lost at"}


def write_page(
    folder: Path, question: LimitRequest, limits: Mapping[str, Limit], scatter: Scatter, notes: Sequence[str]
) -> None:
    """Write the tables and their report.

    Args:
        folder: Where to.
        question: What was asked.
        limits: By material.
        scatter: The devices within the tolerances.
        notes: What to know, sentences.
    """
    from softmodels.pictures.curves import drawing

    figure = write(folder, limits, scatter, question.column)
    column, device = question.column, question.case.actuator
    facts, told = [], to_table(device, readable)
    for name, found in limits.items():
        margin = math.inf if column.working is None else abs(found.pressure) / column.cm / column.working
        notes_of_it = (
            [] if column.working is None else [f"{margin:.2f} times the working pressure of {column.working:g} cm"]
        )
        kind = KINDS[found.kind] if found.pressure > 0.0 else KINDS[found.kind].replace("up to", "down to")
        what = f"borne for {found.held:g} s" if found.held else kind
        pressure = f"{found.pressure / column.cm:.4g} cm of water ({found.pressure / 1e3:.4g} kPa)"
        note = "; ".join([*notes_of_it, f"largest stretch there {found.stretch:.4g}"])
        facts.append(Fact(f"{name}: {what}", pressure, note, margin < 1 or found.kind == "lost"))
    sentences = [f"{sentence(name, found, column)}." for name, found in limits.items()]
    names = ("limit.csv", "scatter.csv")
    page = Page(
        f"Limit of {type(device).__name__}", sentences[0],
        [
            ("Other materials", [Bullets(sentences[1:])]),
            ("Scatter within the tolerances", [
                Charts([("scatter.svg", drawing(figure, column.cm))] if figure else []),
                Bullets(scatter_text(scatter, column).split("\n  ") if scatter.sampled else []),
            ]),
            ("Convergence", [Text(NO_MESH_ERROR)]),
            ("Device", [Table([(name.replace("_", " "), str(value)) for name, value in told.items()], numbers=False)]),
        ],
        Provenance.now(), facts, [note.removeprefix("note: ") for note in notes],
        [text for material in question.materials.values() for text in publications(material)],
        {name: read_text(folder / name) for name in names if (folder / name).exists()}, column.cm,
    )  # fmt: skip
    write_text(folder / "report.html", page.html())


def _csv(path: Path, rows: Sequence[Row]) -> None:
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, fieldnames=list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_text(path, text.getvalue())


SAMPLES = 32


@dataclasses.dataclass(frozen=True)
class LimitArguments:
    """The command's options except those of devices and laws; see `_command`."""

    case_file: Path | None  # not called file: a device may have a field of that name
    material: tuple[str, ...]
    vary: tuple[str, ...]
    count: int | None
    normal: bool
    working_pressure: str | None
    hold: float | None
    vacuum: bool
    water_density: float | None
    output: Path | None


@dataclasses.dataclass(frozen=True)
class LimitRequest:
    """The question of one command.

    Attributes:
        case: A case around the device; its load is ignored.
        materials: The silicones by name.
        tolerances: Within which the device scatters; none for only the nominal device.
        count: Devices within them.
        normal: Whether the tolerances are two standard deviations.
        column: Unit of the pressures.
        hold: Time in s for which they must be borne; 0 for ever.
    """

    case: Case
    materials: Mapping[str, Material]
    tolerances: Sequence[Tolerance]
    count: int
    normal: bool
    column: LimitColumn
    hold: float

    @classmethod
    def from_options(cls, kind: type[Actuator], given: LimitArguments, values: Mapping[str, object]) -> LimitRequest:
        """Make it from the command's options.

        Args:
            kind: The device if no file names one.
            given: Those of its own.
            values: Those of the device and the law, None where not given.

        Raises:
            CaseError, GeometryError, MaterialError: Invalid input.
        """
        file = given.case_file
        case = None if file is None else Case.from_file(file)
        device, materials = _asked(kind, case, file, given.material, dict(values))
        for material in materials.values():
            check_rest(material)
        tolerances = [Tolerance.parse(text, type(device)) for text in given.vary]
        if not tolerances and (given.normal or given.count is not None):
            raise CaseError("--samples and --normal need a tolerance; give one with --vary")
        hold = check_hold(given.hold or 0.0, list(materials.values()))
        if hold and tolerances:
            raise CaseError("--hold and --vary cannot be combined; leave out one of them")
        if hold and given.vacuum:
            raise CaseError("--hold and --vacuum cannot be combined; leave out one of them")
        around = _as_asked(case, device, materials, given.water_density, -1.0 if given.vacuum else 1.0)
        count = given.count or SAMPLES
        working = _working_cm(given.working_pressure, around.cm)
        return cls(around, materials, tolerances, count, given.normal, LimitColumn(around.cm, working), hold)


def _working_cm(text: str | None, pascal_in_cm: float) -> float | None:
    """Return a working pressure in cm of the column: a number of cm, or a text with a unit of pressure.

    Raises:
        CaseError: No positive pressure.
    """
    if text is None:
        return None
    try:
        plain = not split_text(text)[1]
        value = quantity(text, "") if plain else one_of_text("cm", text, "working pressure", pascal_in_cm)
    except (SeriesError, UnitError) as error:
        raise CaseError(f"--working-pressure: {error}") from None
    if not value > 0:
        raise CaseError(f"--working-pressure {text}: the working pressure must be above zero")
    return value


def limit(kind: type[Actuator], **values: object) -> None:
    """Find the largest pressure a device can take, and the place of its largest strain.

    With --vacuum it is the largest vacuum. The device is that of a case FILE or of the options below (as a section, unless
    --section is given; --device NAME has those of another one); every --material adds a row. With --vary the limit's scatter
    over fabrication tolerances is added: of any thickness or other length, and of the offset of the cavity, which on a disk
    sits too high in a part of the same height (a thinner membrane over a thicker base). A sideways shift of a disk's core is
    not sampled: by symmetry it has no first-order effect.

    Exit status: 0 done; 1 failed; 2 bad input; 3 no equilibrium under the preload.

    \b
    Examples:
      softmodels limit results/disk/case.toml
      softmodels limit --variant shadow --material ecoflex-00-30 --material dragon-skin-20 --working-pressure 20cm
      softmodels limit --device Balloon --wall 1.5mm --material ecoflex-00-30
      softmodels limit --device Balloon --material memory.toml --hold 60s
      softmodels limit --device Bellows --vacuum
      softmodels limit --variant shadow --shear-modulus 20kPa --vary membrane=2mm+-0.2mm --vary offset=0mm+-0.2mm
      softmodels limit results/seminar/case.toml --vary thickness=8mm+-0.2mm --vary offset=-1mm+-0.2mm --samples 8
    """
    given = taken(LimitArguments, values)
    try:
        question = LimitRequest.from_options(kind, given, values)
    except (CaseError, GeometryError, MaterialError) as error:
        fail(str(error))
    comm = start()
    abort_on_error(comm)
    folder = _open(given, values, question, comm)
    named, bands = with_sources(dict(question.materials))
    limits, scattered = _answered(question, named, comm)
    if not is_root(comm):
        return
    for name, found in limits.items():
        say(sentence(name, found, question.column))
    for text in band_texts(bands, limits, question.column.cm):
        say(text)
    notes = list(_notes(question, named, limits))
    for text in notes:
        say(text)
    if scattered.sampled:
        say(scatter_text(scattered, question.column))
    if folder is not None:
        write_into(folder, lambda place: write_page(place, question, limits, scattered, notes), "the tables")
        say(f"tables and report.html in {folder.path}")


def _open(
    given: LimitArguments, values: Mapping[str, object], question: LimitRequest, comm: MPI.Comm
) -> ResultFolder | None:
    """Open the folder for the tables on rank 0; None elsewhere, or if nothing is to be written."""
    if given.output is None and not question.tolerances:
        return None
    options = {
        **values, "material": given.material, "vary": given.vary, "count": given.count, "normal": given.normal,
        "cm": question.column.cm,
    }  # fmt: skip
    files = [path for path in (given.case_file, *map(Path, given.material)) if path is not None and path.is_file()]
    return open_on_root(comm, given.output, Path("results/limit"), "limits", options, files)


def _answered(
    question: LimitRequest, materials: Mapping[str, Material], comm: MPI.Comm
) -> tuple[dict[str, Limit], Scatter]:
    """Return the limits by material and of the devices within the tolerances; exit on an error."""
    case, sampled = question.case, list[Sampled]()
    try:
        check_varied(case.actuator, question.tolerances, comm)
        limits = find_limit(case, list(materials.values()), comm, question.hold)
        if question.tolerances:
            values = samples(question.tolerances, question.count, question.normal)
            first = next(iter(materials.values()))
            sampled = scatter(case, first, question.tolerances, values, comm)
    except (CaseError, GeometryError, ComponentError) as error:
        fail(str(error))
    except (MeshingError, RunError) as error:
        fail(str(error), Ended.by(error).status)
    except OSError as error:  # the mesh is made in the temporary folder
        fail(f"the mesh cannot be written ({error.strerror or error})", FAILED)
    return dict(zip(materials, limits, strict=True)), Scatter(question.tolerances, sampled)


def _notes(question: LimitRequest, materials: Mapping[str, Material], limits: Mapping[str, Limit]) -> Iterator[str]:
    """Yield warnings about the limits."""
    device = question.case.actuator
    for name, found in limits.items():
        weak = weakest(materials[name])
        if weak is not None and found.stretch >= NEAR_STRETCH_LIMIT * weak.stretch:
            yield (
                f"note: {weakness(materials[name])}, and the state reaches stretch {found.stretch:.3g}: the limit may "
                f"come from the law, not from the device; use a law that is stable over these stretches (softmodels curve "
                f"shows them)"
            )
        if text := extrapolated(materials[name], found.stretch):
            yield f"note: {name}: {text}"
    if hidden := unseen(device):
        yield f"note: {hidden}"
    if len(device.ratios) > 1:
        how = "in its ratios" if device.ratios != (1.0,) * len(device.ratios) else "the same"
        yield f"note: this is the pressure in all {len(device.ratios)} cavities, {how}; softmodels run takes a series for each"


def _as_asked(
    case: Case | None, device: Actuator, materials: Mapping[str, Material], water_density: float | None, dummy: float
) -> Case:
    """Return a case of the device with a dummy load in cm, to check the input as any case is checked.

    Raises:
        CaseError: See `Case`.
    """
    for material in materials.values():
        around = case or Case("limit", device, material, pressures_cm=(dummy,))
        made = dataclasses.replace(
            around, name="limit", actuator=device, material=material, load_unload=False,
            pressures_cm=(dummy,), volumes_ml=(), strokes_ml=(), program=(), supply=None, inertia=False,
            water_density=around.water_density if water_density is None else water_density,
        )  # fmt: skip
    return made


def _asked(
    kind: type[Actuator], case: Case | None, file: Path | None, names: Sequence[str], values: Values
) -> tuple[Actuator, dict[str, Material]]:
    law = law_taken(values)
    given = any(value is not None for value in law.values())
    if case is not None:
        device, default = case.actuator, case.material
        changes = {key: value for key, value in values.items() if value is not None and key != "variant"}
        unknown = changes.keys() - {field.name for field in dataclasses.fields(device)}
        if values.get("variant") or unknown:
            raise CaseError(f"{file} already names the device; leave out --variant and options of other devices")
        device = dataclasses.replace(device, **changes)
        check_meaning(device, changes)
        if not names and not given:
            return device, {default.name: default}
    else:
        variant = kind.variants[str(values.get("variant") or "default")]
        if "section" in values and values["section"] is None and "section" not in variant:
            values["section"] = "axisymmetric"
        device = device_told(kind, values)
    if len(names) > 1 and given:
        raise CaseError(
            "parameters such as --shear-modulus belong to one --material; with several, leave the parameters out"
        )
    if not names:
        made = material_from(kind.silicone if case is None else None, law)
        return device, {made.name: made}
    return device, {name: material_from(name, law) for name in names}


def _limit_command(kind: type[Actuator] = HollowDisk, cls: type[click.Command] = click.Command) -> click.Command:
    def of_kind(**values: object) -> None:
        limit(kind, **values)

    of_kind.__doc__ = limit.__doc__
    made = material_options(of_kind, kind.silicone, several=True)
    made = device_options(kind)(made)
    text = f"Density of the column's liquid.  [default: the case's, or {WATER_DENSITY:g}kg/m^3]"
    made = click.option("--water-density", type=QuantityType("kg/m^3"), help=text)(made)
    text = "Folder for tables and picture.  [default: with --vary results/limit, or results/limit-2 and so on]"
    made = click.option("-o", "--output", type=FolderType(), help=text)(made)
    made = click.option("--normal", is_flag=True, help="Tolerances are two standard deviations of a normal "
                        "distribution; default: uniform.")(made)  # fmt: skip
    made = click.option("--samples", "count", type=click.IntRange(2, 4096),
                        help=f"Number of sampled devices.  [default: {SAMPLES}]")(made)  # fmt: skip
    made = click.option("--vary", multiple=True, metavar="NAME=VALUE+-HALF", help="A tolerance, such as "
                        "membrane=2mm+-0.2mm (a thickness) or offset=0mm+-0.2mm (the cavity's height in the part); may be "
                        "repeated.")(made)  # fmt: skip
    text = "Working pressure, for the margin: cm of water (20), or with a unit (2kPa)."
    made = click.option("--hold", type=QuantityType("s"), help="Time for which the pressure, applied at once, must be borne by "
                        "a silicone with a memory; default: for ever.")(made)  # fmt: skip
    made = click.option("--vacuum", is_flag=True, help="How much vacuum it can take, instead of pressure.")(made)
    made = click.option("--working-pressure", metavar="PRESSURE", help=text)(made)
    if cls is not click.Command:
        text = f"A device, with options of its own: {', '.join(ACTUATORS)}.  [default: {kind.__name__}]"
        made = click.option(DEVICE, metavar="NAME", expose_value=False, help=text)(made)
    made = click.argument("case_file", metavar="[FILE]", required=False, type=click.Path(path_type=Path))(made)
    return click.command(name="limit", cls=cls)(made)


limit_command = _limit_command(cls=by_device(_limit_command))


# ----------------------------------------------------------------------------------------------------------------------
# The command ``modes``.


@dataclasses.dataclass(frozen=True)
class ModesOptions:
    """The options of how to find modes, as `modes_options` adds them."""

    count: int
    sealed: bool
    output: Path | None
    quiet: bool
    no_pictures: bool


def modes_options[Command: Callable[..., object]](command: Command) -> Command:
    """Add the options of `ModesOptions`."""
    command = click.option("--no-pictures", is_flag=True, help="Draw nothing.")(command)
    command = click.option("--quiet", is_flag=True, help="Print only errors.")(command)
    text = "Folder for the results.  [default: results/modes, or results/modes-2 and so on]"
    command = click.option("-o", "--output", type=FolderType(), help=text)(command)
    text = "Close each cavity, with air that keeps its temperature; without it they keep their pressures."
    command = click.option("--sealed", is_flag=True, help=text)(command)
    text = "Number of modes."
    return click.option("--count", type=click.IntRange(1, MOST_MODES), default=4, show_default=True, help=text)(command)


MODES_HELP = """Find the natural frequencies of a device at rest and while it is inflated, and their modes.

Vibrations are of small amplitude, without damping. They are found at every state of the path to the last pressure (0:40:
steps chosen by the solver; 0:40:10: also every 10 cm), or at rest without one. --gravity makes the device hang under its
weight, and sets the density; masses and rigid plates of a case file swing with the device. A symmetric slice has only modes
with its symmetry.

Results: modes.csv, with f1_Hz, f2_Hz ... over the pressure, nan of unstable modes; frequencies.png; shapes.png, the modes of
the last state.

\b
Exit status: 0 done; 1 failed; 2 bad input; 3 no equilibrium at a requested value (limit point).

\b
Examples:
  softmodels modes results/disk/case.toml --pressure-cm 0:40 --count 4
  softmodels modes --device HollowDisk --section axisymmetric --material ecoflex-00-30 --pressure-cm 0:20
  softmodels modes --device Beam --part full --gravity -z
  softmodels modes --device PneuNet --pressure-cm 0:10 --sealed
"""


def _modes_of(device: type[Actuator]) -> click.Command:
    """Return the command for a registered device."""
    options = CaseOptions(device, device.silicone)

    def command(**values: object) -> None:
        given, how = dict(values), taken(ModesOptions, values)
        _find_modes(lambda: case_for_modes(options.case(values, AtRest)), how, given, [])

    command.__doc__ = MODES_HELP
    made = options.add(modes_options(command))
    return click.command(name=f"softmodels modes {DEVICE} {device.__name__}")(made)


def _of_file(**values: object) -> None:
    given, how = dict(values), taken(ModesOptions, values)
    file, material, pressures = values["file"], values["material"], values["pressures"]
    assert isinstance(file, Path)

    def case() -> Case:
        cm = series(pressures, "pressure") if pressures else ()
        return case_for_modes(case_of_file(file, None if material is None else str(material)), cm)

    _find_modes(case, how, given, [file])


def _modes_command() -> click.Command:
    made = modes_options(_of_file)
    made = click.option("--pressure-cm", "pressures", metavar="SERIES", help="Pressures in cm of the column, instead of the "
                        "case's load: 0:40, 0:40:10 or 0,10,40.")(made)  # fmt: skip
    made = click.option("--material", metavar="NAME", help="Material, instead of the case's [material]: a silicone, or a TOML "
                        "file.")(made)  # fmt: skip
    text = f"A device, with options of its own, instead of a FILE: {', '.join(ACTUATORS)}."
    made = click.option(DEVICE, metavar="NAME", expose_value=False, help=text)(made)
    made = click.argument("file", type=click.Path(path_type=Path))(made)
    return click.command("modes", cls=by_device(_modes_of), help=MODES_HELP)(made)


modes_command = _modes_command()


def _find_modes(
    make: Callable[[], Case], how: ModesOptions, options: Mapping[str, object], files: Sequence[Path]
) -> None:
    """Find the modes of a case, write and print them, and exit with the status."""
    try:
        case = make()
    except INPUT_ERRORS as error:
        fail(str(error))
    comm = start()
    abort_on_error(comm)
    folder = open_on_root(comm, how.output, Path("results/modes"), "modes", options, files)
    try:
        found = find_frequencies(case, how.count, how.sealed, comm)
    except (*INPUT_ERRORS, ComponentError, MeshingError, RunError) as error:
        fail(str(error), Ended.by(error).status)
    except OSError as error:  # the mesh is made in the temporary folder
        fail(f"the mesh cannot be written ({error.strerror or error})", FAILED)
    if is_root(comm) and folder is not None:
        _report_modes(case, found, how, folder)
    if found.ended.status:
        fail(found.ended.message, found.ended.status)
    sys.exit(0)


def _report_modes(case: Case, found: NaturalFrequencies, how: ModesOptions, folder: ResultFolder) -> None:
    def write(place: Path) -> None:
        write_text(place / "modes.csv", modes_table(found, case.cm))
        if not how.no_pictures:
            write_text(
                place / "report.html", _modes_page(case, found, _draw_modes(case, found, how.sealed, place), place)
            )

    write_into(folder, write, "the results")
    if how.quiet:
        return
    shown = [*np.flatnonzero(found.requested), *([] if found.requested[-1] else [len(found.pressure) - 1])]
    for state in shown:
        values = ", ".join(f"{value:.4g}" for value in found.frequency[state])
        say(f"{_pressure_text(found, state, case.cm)}: {values} Hz")
    for text in [*found.unstable, *(f"note: {note}" for note in found.notes), f"results in {folder.path}"]:
        say(text)


def _pressure_text(found: NaturalFrequencies, state: int, cm: float) -> str:
    pressure = found.pressure[state]
    return f"{pressure / cm:.4g} cm ({pressure / 1e3:.4g} kPa)" if pressure else "no pressure"


def modes_table(found: NaturalFrequencies, cm: float) -> str:
    """Return ``modes.csv``.

    Args:
        found: The frequencies.
        cm: Pa in one cm of the column.
    """
    count = found.frequency.shape[1]
    rows = [["pressure_cm", "pressure_Pa", "added_volume_ml", "requested", *(f"f{k}_Hz" for k in range(1, count + 1))]]
    states = zip(found.pressure, found.added_volume, found.requested, found.frequency, strict=True)
    for pressure, volume, requested, frequencies in states:
        numbers = [pressure / cm, pressure, volume * 1e6]
        rows.append([*(f"{x:.9g}" for x in numbers), str(int(requested)), *(f"{x:.9g}" for x in frequencies)])
    return "".join(",".join(row) + "\n" for row in rows)


def _modes_page(case: Case, found: NaturalFrequencies, figure: Figure, place: Path) -> str:
    """Return the report; ``place`` has the tables and the shapes already, ``figure`` are the frequencies."""
    from softmodels.pictures.curves import drawing

    shapes, asked = place / "shapes.png", [0, *np.flatnonzero(found.requested)[-1:]]
    facts = [
        Fact(f"Lowest frequency, {_pressure_text(found, state, case.cm)}", f"{found.frequency[state, 0]:.4g} Hz"
             if np.isfinite(found.frequency[state, 0]) else "unstable", "", not np.isfinite(found.frequency[state, 0]))
        for state in dict.fromkeys(asked)
    ]  # fmt: skip
    rows: list[list[str | Cell]] = [
        [Cell(f"{p / case.cm:.5g}", f"{p} Pa", p), f"{V * 1e6:.5g}", *(f"{f:.5g}" for f in values)]
        for p, V, values in zip(found.pressure, found.added_volume, found.frequency, strict=True)
    ]
    head: list[str | Cell] = [
        Cell("pressure (cm)", unit="cm"),
        "added volume (ml)",
        *(f"f{k + 1} (Hz)" for k in range(found.frequency.shape[1])),
    ]
    return Page(
        f"Natural frequencies of {case.name}", f"{found.ended.message}." if found.ended.message else "",
        [
            ("Pictures", [Charts([("frequencies.svg", drawing(figure, case.cm))]),
                          Picture(image_uri(shapes), "The modes of the last state") if shapes.exists() else None]),
            ("Frequencies", [Table(rows, head)]),
            ("Notes", [Bullets([*found.notes, NO_MESH_ERROR])]),
            ("The case", [Folded("case.toml", [Listing(case.to_toml())])]),
        ],
        Provenance.now(), facts, found.unstable, publications(case.material),
        {"modes.csv": read_text(place / "modes.csv")}, case.cm,
    ).html()  # fmt: skip


def _draw_modes(case: Case, found: NaturalFrequencies, sealed: bool, place: Path) -> Figure:
    """Draw the frequencies, which are returned, and the modes of the last state; say so if that fails."""
    from softmodels.cli.run import end, start_drawing, tell_not_drawn
    from softmodels.pictures.analyses import DRAWN, frequency_figure, section_shapes, solid_shapes
    from softmodels.pictures.style import png

    figure = frequency_figure(found.pressure / case.cm, found.frequency, sealed)
    write_bytes(place / "frequencies.png", png(figure))
    last, state = found.modes[-1][:DRAWN], len(found.modes) - 1
    at = _pressure_text(found, state, case.cm)
    titles = [f"f{k} = {mode.frequency:.4g} Hz" if mode.stable else f"f{k}: unstable" for k, mode in enumerate(last, 1)]
    titles[0] += f", {at}"
    moved, shapes = found.points + found.displacement[-1], [mode.displacement for mode in last]
    if case.actuator.dimension == 2:
        write_bytes(place / "shapes.png", png(section_shapes(moved, shapes, found.cells, titles)))
        return figure
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "shapes.npz"
        np.savez(file, **vars(solid_shapes(found.points, found.cells, found.cell_name, case.actuator, moved, shapes)))
        process = start_drawing(case, "softmodels.pictures.analyses", str(file), str(place / "shapes.png"), *titles)
        try:
            out, errors = process.communicate()
        finally:
            end(process)
    if process.returncode:
        tell_not_drawn(out, errors, process.returncode, "the frequencies are complete")
    return figure
