"""``softmodels limit``, ``modes`` and ``grasp``: limit pressure and its scatter; natural frequencies; an object held."""

from __future__ import annotations

import dataclasses
import json
import math
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np
import numpy.typing as npt

from geometries import Actuator, HollowDisk, registry
from softmodels.case import entries, load, materials
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.case.materials import MaterialErrors
from softmodels.cli import ending, options
from softmodels.common import commands, files, pages, processes, schema, units
from softmodels.common.lazy import MPI
from softmodels.common.pages import Page
from softmodels.materials import silicones, specimens
from softmodels.materials.laws import Material
from softmodels.mechanics import component, mpi
from softmodels.path import steps
from softmodels.runs import analyses, grasp, simulation
from softmodels.runs.analyses import Limit, NaturalFrequencies
from softmodels.runs.grasp import Grasp
from softmodels.runs.notes import NEAR_STRETCH_LIMIT, sentences, unseen

if TYPE_CHECKING:
    from matplotlib.figure import Figure


# ----------------------------------------------------------------------------------------------------------------------
# Output of ``softmodels limit``: sentences, tables and the picture of the scatter.


PERCENTILES = (5, 25, 50, 75, 95)

type Row = dict[str, str | float]
"""A row of ``limit.csv``."""
type Sampled = tuple[Mapping[str, float], Limit]
"""A device within the tolerances: its parameters and its limit."""


@dataclasses.dataclass(frozen=True)
class LimitColumn:
    """Unit of the pressures: the column of liquid, and the working pressure as a height of it, if given."""

    scale: units.Column
    working: float | None


@dataclasses.dataclass(frozen=True)
class Scatter:
    """The sampled devices within the tolerances."""

    tolerances: Sequence[analyses.Tolerance]
    sampled: Sequence[Sampled]

    @property
    def borne(self) -> tuple[str, list[Sampled]]:
        """Return their limit pressures; if none has a limit, the pressures at the largest stretch."""
        limited = [sample for sample in self.sampled if sample[1].exists]
        stretched = [sample for sample in self.sampled if sample[1].kind == "none"]
        if limited or not stretched:
            return "limit pressure", limited
        return f"pressure at a stretch of {analyses.MAX_STRETCH:g}", stretched


def row_of(name: str, limit: Limit, column: LimitColumn) -> Row:
    """Return the table row of a material's limit."""
    row: Row = {
        "material": name, "kind": limit.kind, "limit_cm": limit.pressure / column.scale.pascal, "limit_Pa": limit.pressure,
        "added_volume_ml": limit.added_volume * 1e6, **{f"{k}_mm": v * 1e3 for k, v in limit.rises.items()},
        "max_stretch": limit.stretch, **{f"{axis}_mm": x * 1e3 for axis, x in zip("xyz", limit.place, strict=True)},
    }  # fmt: skip
    row |= {"hold_s": limit.held} if limit.held else {}
    row |= {"limit_ci95_Pa": limit.half_width} if limit.errors else {}
    row |= {f"limit_ci95_{part.name}_Pa": part.half for part in limit.errors}
    return row if column.working is None else {**row, "margin": abs(limit.pressure) / column.scale.pascal / column.working}


def sentence(name: str, limit: Limit, column: LimitColumn) -> str:
    """Return the limit of a device in a material as a sentence."""
    radius, height = float(np.hypot(limit.place[0], limit.place[1])) * 1e3, limit.place[2] * 1e3
    place = f"largest stretch {limit.stretch:.3g}, {radius:.3g} mm from the axis at height {height:.3g} mm"
    rises = ", ".join(f"{name} {rise * 1e3:+.4g} mm" for name, rise in limit.rises.items())
    state = f"{rises}, {limit.added_volume * 1e6:+.4g} ml; {place}"
    parts = ", ".join(f"{part.text} {column.scale.text(part.half, '.2g')}" for part in limit.errors)
    error = f" +- {column.scale.text(limit.half_width, '.2g')} (95 %: {parts})" if parts else ""
    at = f"{column.scale.full(limit.pressure)} ({limit.pressure / 1e3:.4g} kPa){error}"
    what = {
        "limit": f"limit pressure {at}: {state}",
        "bifurcation": f"bifurcation at {at}: {state}",
        "none": f"no limit up to a stretch of {analyses.MAX_STRETCH:g}, reached at {at}: {state}"
        if limit.pressure > 0.0
        else f"no limit down to {at}: {state}",
        "lost": f"no limit up to {at}, where the path was lost ({limit.why}): {state}",
    }[limit.kind]
    if limit.held:
        what = f"{at} is held for {limit.held:g} s, and then: {state}"
    text = f"{name}: {what}"
    if column.working is not None:
        margin = abs(limit.pressure) / column.scale.pascal / column.working
        text += f"; {margin:.2f} times the working pressure, {'above' if margin > 1 else 'BELOW'} it"
    return text


def scatter_text(scatter: Scatter, column: LimitColumn) -> str:
    """Return how the limit scatters, and which parameters affect it."""
    what, counted = scatter.borne
    count = len(scatter.sampled)
    if not counted:
        return f"none of the {count} devices within the tolerances has a limit"
    pressures = np.array([limit.pressure / column.scale.pascal for _, limit in counted])
    quantiles = np.percentile(pressures, PERCENTILES)
    text = f"{count} devices within the tolerances: {what} ({column.scale.unit}) " + ", ".join(
        f"{q:.4g} ({p} %)" for p, q in zip(PERCENTILES, quantiles, strict=True)
    )
    text += f"; lowest {pressures.min():.4g}, highest {pressures.max():.4g}"
    if without := count - len(counted):
        text += f"; {without} have no limit or were not followed to it"
    if len(pressures) > len(scatter.tolerances) + 1:
        text += _effects(scatter.tolerances, counted, pressures, what)
    if column.working is not None:
        text += f"\n  {np.mean(pressures < column.working) * 100:.3g} % are below the working pressure"
    return text


def _effects(
    tolerances: Sequence[analyses.Tolerance], counted: Sequence[Sampled], pressures: npt.NDArray[np.float64], what: str
) -> str:
    """Return the effect of each parameter, fitted jointly so that none absorbs the scatter of another."""
    values = [[_regressor(t, changes[t.name]) for t in tolerances] for changes, _ in counted]
    slopes = np.linalg.lstsq(values - np.mean(values, axis=0), np.log(pressures / pressures.mean()), rcond=None)[0]
    text = ""
    for t, slope in zip(tolerances, slopes, strict=True):
        more = schema.shown(t.half, t.unit) if t.signed else "one percent"
        effect = 100 * np.expm1(slope) if t.signed else slope
        text += f"\n  {t.name.replace('_', ' ')}: {more} more changes the {what} by about {effect:+.2g} %"
    return text


def _regressor(tolerance: analyses.Tolerance, value: float) -> float:
    return (value - tolerance.middle) / tolerance.half if tolerance.signed else float(np.log(value))


def write(folder: Path, limits: Mapping[str, Limit], scatter: Scatter, column: LimitColumn) -> Figure | None:
    """Write ``limit.json`` and ``limit.csv``, and of a scatter its table and picture, which is returned."""
    table = [row_of(name, limit, column) for name, limit in limits.items()]
    files.write_text(folder / "limit.json", json.dumps(table, indent=2) + "\n")
    names = list(dict.fromkeys(name for row in table for name in row))
    files.write_text(folder / "limit.csv", files.csv_text(names, (map(row.get, names) for row in table)))
    if not scatter.sampled:
        return None
    rows = [{**changes, **row_of("", limit, column)} for changes, limit in scatter.sampled]
    files.write_text(folder / "scatter.csv", files.csv_text(rows[0], (map(row.get, rows[0]) for row in rows)))
    what, counted = scatter.borne
    if not counted:
        return None
    from softmodels.pictures import analyses

    pressures = [(changes, limit.pressure / column.scale.pascal) for changes, limit in counted]
    nominal = next(iter(limits.values())).pressure / column.scale.pascal
    figure = analyses.scatter_figure(pressures, scatter.tolerances, what, nominal, column.working, column.scale.unit)
    figure.savefig(folder / "scatter.png")
    return figure


def mesh_text(limits: Sequence[Limit], column: LimitColumn) -> str:
    """Return a sentence with the mesh errors of limits."""
    known = [column.scale.text(limit.mesh_error, ".2g") for limit in limits if not math.isnan(limit.mesh_error)]
    return f"Mesh error of the pressures, as half a 95 % interval: {', '.join(known)}." if known else ASK_MESH_ERROR


ASK_MESH_ERROR = "The mesh error was not estimated: repeat the command with --mesh-error."
KINDS = {"limit": "limit pressure", "bifurcation": "bifurcation", "none": "no limit up to", "lost": "path lost at"}


def write_page(
    folder: Path, question: LimitRequest, limits: Mapping[str, Limit], scatter: Scatter, notes: Sequence[str]
) -> None:
    """Write the tables and their report, with notes in sentences."""
    from softmodels.pictures import curves

    figure = write(folder, limits, scatter, question.column)
    column, device = question.column, question.case.actuator
    facts, told = [], registry.to_table(device, units.readable)
    for name, limit in limits.items():
        margin = math.inf if column.working is None else abs(limit.pressure) / column.scale.pascal / column.working
        notes_of_it = [] if column.working is None else [
            f"{margin:.2f} times the working pressure of {column.working:g} {column.scale.unit}"
        ]  # fmt: skip
        kind = KINDS[limit.kind] if limit.pressure > 0.0 else KINDS[limit.kind].replace("up to", "down to")
        what = f"held for {limit.held:g} s" if limit.held else kind
        pressure = f"{column.scale.full(limit.pressure)} ({limit.pressure / 1e3:.4g} kPa)"
        note = "; ".join([*notes_of_it, f"largest stretch there {limit.stretch:.4g}"])
        facts.append(pages.Fact(f"{name}: {what}", pressure, note, margin < 1 or limit.kind == "lost"))
    sentences = [f"{sentence(name, limit, column)}." for name, limit in limits.items()]
    names = ("limit.csv", "scatter.csv")
    page = Page(
        f"Limit of {type(device).__name__}", sentences[0],
        [
            ("Other materials", [pages.Bullets(sentences[1:])]),
            ("Scatter within the tolerances", [
                pages.Charts([("scatter.svg", curves.drawing(figure, column.scale))] if figure else []),
                pages.Bullets(scatter_text(scatter, column).split("\n  ") if scatter.sampled else []),
            ]),
            ("Convergence", [pages.Text(mesh_text(list(limits.values()), column))]),
            ("Device", [pages.Table([(name.replace("_", " "), str(value)) for name, value in told.items()], numbers=False)]),
        ],
        commands.Provenance.now(), facts, [note.removeprefix("note: ") for note in notes],
        [text for material in question.materials.values() for text in silicones.publications(material)],
        {name: files.read_text(folder / name) for name in names if (folder / name).exists()}, column.scale,
    )  # fmt: skip
    files.write_text(folder / "report.html", page.html())


# ----------------------------------------------------------------------------------------------------------------------
# The command ``modes``.


@dataclasses.dataclass(frozen=True)
class ModesOptions:
    """The options of how to find modes."""

    count: int = commands.option(
        type=click.IntRange(1, analyses.MAX_MODES), default=4, show_default=True, help="Number of modes."
    )
    sealed: bool = commands.flag_option(
        "Close each cavity, with air that keeps its temperature; without it they keep their pressures."
    )
    output: Path | None = commands.output_option(  # noqa: RUF009
        "Folder for the results.  [default: results/modes, or results/modes-2 and so on]"
    )
    quiet: bool = commands.quiet_option()
    no_pictures: bool = commands.flag_option("Draw nothing.")


MODES_HELP = """Find the natural frequencies and modes of a device.

They are those at rest and while it is inflated. Vibrations are of small amplitude; the branches of a silicone with a memory
stiffen and damp each at its own frequency. They are found at every state of the path to the last pressure (0:40: steps chosen
by the solver; 0:40:10: also every 10 cm), or at rest without one.
--gravity makes the device hang under its weight, and sets the density; masses and rigid plates of a case file swing with the
device. A symmetric slice has only modes with its symmetry.

Results: modes.csv, with f1_Hz, f2_Hz ... over the pressure, nan of unstable modes, and with a memory the damping ratios
damping1, damping2 ...; frequencies.png; shapes.png, the modes of
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
    given = options.CaseOptions(device, device.silicone)

    @commands.options(ModesOptions)
    def of_device(how: ModesOptions, **values: object) -> None:
        asked = {**values, **vars(how)}
        _find_modes(analyses.case_for_modes(given.case(values, simulation.AtRest)), how, asked, [])

    return options.command(f"softmodels modes {options.DEVICE} {device.__name__}", help=MODES_HELP)(given.add(of_device))


@options.command(
    "modes", cls=options.by_device(_modes_of, "A device, with options of its own, instead of a FILE: {}."), help=MODES_HELP
)
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--material", metavar="NAME", help="Material, instead of the case's [material]: a silicone, a law "
              "with its numbers (yeoh:c1=8kPa,c2=90Pa), or a TOML file.")  # fmt: skip
@click.option("--pressure-cm", "pressures", metavar="SERIES", help="Pressures in cm of the column, instead of the "
              "case's load: 0:40, 0:40:10 or 0,10,40; 0: at rest.")  # fmt: skip
@options.set_option
@commands.options(ModesOptions)
def modes_command(file: Path, how: ModesOptions, material: str | None, pressures: str | None, changes: tuple[str, ...]) -> None:
    case = options.case_of_file(file, material, changes, kind=simulation.AtRest)
    steps = None if pressures is None else load.steps_of(pressure_cm=pressures, water_density=case.water_density)
    asked = {**vars(how), "material": material, "pressures": pressures, "changes": changes}
    _find_modes(analyses.case_for_modes(case, steps), how, asked, [file])


def _find_modes(case: Case, how: ModesOptions, asked: Mapping[str, object], files: Sequence[Path]) -> None:
    """Find the modes of a case, write and print them, and exit with the status."""
    comm = mpi.start()
    folder = mpi.kept_on_root(comm, lambda: commands.open_folder(how.output, Path("results/modes"), "modes", asked, files))
    with sentences():
        modes = analyses.find_frequencies(case, how.count, how.sealed, comm)
    if mpi.is_root(comm) and folder is not None:
        _report_modes(case, modes, how, folder)
    if modes.ended.status:
        ending.fail(modes.ended.message, modes.ended.status)


def _report_modes(case: Case, modes: NaturalFrequencies, how: ModesOptions, folder: commands.ResultFolder) -> None:
    def write(place: Path) -> None:
        files.write_text(place / "modes.csv", modes_table(modes, case.column.pascal))
        if not how.no_pictures:
            files.write_text(
                place / "report.html", _modes_page(case, modes, _draw_modes(case, modes, how.sealed, place), place)
            )

    ending.write_into(folder, write, "the results")
    if how.quiet:
        return
    shown = [*np.flatnonzero(modes.requested), *([] if modes.requested[-1] else [len(modes.pressure) - 1])]
    for state in shown:
        errors = [f" +- {half:.2g}" if np.isfinite(half) else "" for half in modes.mesh_error[state]]
        values = ", ".join(f"{value:.4g}{half}" for value, half in zip(modes.frequency[state], errors, strict=True))
        ratios = ", ".join(f"{value:.3g}" for value in modes.damping[state])
        damped = f", damping ratio {ratios}" if modes.damping.any() else ""
        meshed = " (+-: mesh, 95 %)" if any(errors) else ""
        processes.say(f"{_pressure_text(modes, state, case.column)}: {values} Hz{meshed}{damped}")
    for text in [*modes.unstable, *(f"note: {note}" for note in modes.notes), f"results in {folder.path}"]:
        processes.say(text)


def _pressure_text(modes: NaturalFrequencies, state: int, column: units.Column) -> str:
    pressure = modes.pressure[state]
    return f"{column.full(pressure)} ({pressure / 1e3:.4g} kPa)" if pressure else "no pressure"


def modes_table(modes: NaturalFrequencies, cm: float) -> str:
    """Return ``modes.csv``; ``cm`` is Pa in one cm of the column."""
    count = modes.frequency.shape[1]
    head = ["pressure_cm", "pressure_Pa", "added_volume_ml", "requested", *(f"f{k}_Hz" for k in range(1, count + 1))]
    damped = bool(np.nan_to_num(modes.damping).any())
    head += [f"damping{k}" for k in range(1, count + 1)] if damped else []
    rows = []
    states = zip(modes.pressure, modes.added_volume, modes.requested, modes.frequency, modes.damping, strict=True)
    for pressure, volume, requested, frequencies, ratios in states:
        numbers = [pressure / cm, pressure, volume * 1e6]
        values = [*frequencies, *(ratios if damped else ())]
        rows.append([*(f"{x:.9g}" for x in numbers), str(int(requested)), *(f"{x:.9g}" for x in values)])
    return files.csv_text(head, rows)


def _modes_page(case: Case, modes: NaturalFrequencies, figure: Figure, place: Path) -> str:
    """Return the report; ``place`` has the tables and the shapes already, ``figure`` are the frequencies."""
    from softmodels.pictures import curves

    shapes, asked = place / "shapes.png", [0, *np.flatnonzero(modes.requested)[-1:]]
    facts = [
        pages.Fact(f"Lowest frequency, {_pressure_text(modes, state, case.column)}", f"{modes.frequency[state, 0]:.4g} Hz"
             if np.isfinite(modes.frequency[state, 0]) else "unstable", "", not np.isfinite(modes.frequency[state, 0]))
        for state in dict.fromkeys(asked)
    ]  # fmt: skip
    rows: list[list[str | pages.Cell]] = [
        [pages.Cell(f"{p / case.column.pascal:.5g}", f"{p} Pa", p), f"{V * 1e6:.5g}", *(f"{f:.5g}" for f in values)]
        for p, V, values in zip(modes.pressure, modes.added_volume, modes.frequency, strict=True)
    ]
    head: list[str | pages.Cell] = [
        pages.Cell("pressure (cm)", unit="cm"),
        "added volume (ml)",
        *(f"f{k + 1} (Hz)" for k in range(modes.frequency.shape[1])),
    ]
    return Page(
        f"Natural frequencies of {case.name}", f"{modes.ended.message}." if modes.ended.message else "",
        [
            ("Pictures", [pages.Charts([("frequencies.svg", curves.drawing(figure, case.column))]),
                          pages.Picture(files.image_uri(shapes), "The modes of the last state") if shapes.exists() else None]),
            ("Frequencies", [pages.Table(rows, head)]),
            ("Notes", [pages.Bullets([*modes.notes, *([_mesh_text(modes)] if modes.convergent else [])])]),
            ("The case", [pages.Folded("case.toml", [pages.Listing(case.to_toml())])]),
        ],
        commands.Provenance.now(), facts, modes.unstable, silicones.publications(case.material),
        {"modes.csv": files.read_text(place / "modes.csv")}, case.column,
    ).html()  # fmt: skip


def _mesh_text(modes: NaturalFrequencies) -> str:
    """Return a sentence with the mesh errors of the last state of which they are known."""
    known = [half for half in modes.mesh_error if np.isfinite(half).any()][-1:]
    halves = ", ".join(f"{value:.2g}" for half in known for value in half)
    return f"Mesh errors of the last frequencies, as half 95 % intervals: {halves} Hz." if known else ASK_MESH_ERROR


def _draw_modes(case: Case, modes: NaturalFrequencies, sealed: bool, place: Path) -> Figure:
    """Draw the frequencies, which are returned, and the modes of the last state; say so if that fails."""
    from softmodels.cli import run
    from softmodels.pictures import analyses, style

    figure = analyses.frequency_figure(modes.pressure / case.column.pascal, modes.frequency, sealed, case.column.unit)
    files.write_bytes(place / "frequencies.png", style.png(figure))
    last, state = modes.modes[-1][: analyses.MAX_MODES_DRAWN], len(modes.modes) - 1
    at = _pressure_text(modes, state, case.column)
    titles = [f"f{k} = {mode.frequency:.4g} Hz" if mode.stable else f"f{k}: unstable" for k, mode in enumerate(last, 1)]
    titles[0] += f", {at}"
    moved, shapes = modes.points + modes.displacement[-1], [mode.displacement for mode in last]
    if case.actuator.dimension == 2:
        files.write_bytes(place / "shapes.png", style.png(analyses.section_shapes(moved, shapes, modes.cells, titles)))
        return figure
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "shapes.npz"
        np.savez(file, **vars(analyses.solid_shapes(modes.points, modes.cells, modes.cell_name, case.actuator, moved, shapes)))
        words = "softmodels.pictures.analyses", str(file), str(place / "shapes.png"), *titles
        run.drawn_aside(case, "the frequencies are complete", *words)
    return figure


# ----------------------------------------------------------------------------------------------------------------------
# The command ``grasp``.


USED_UP = 1e-2
"""Reserve of the friction cones over the load below which the object slips."""


@dataclasses.dataclass(frozen=True)
class GraspOptions:
    """The options of `grasp_command`."""

    changes: tuple[str, ...] = options.set_field()
    fingers: int = commands.option(type=int, default=3, show_default=True, help="Number of equal fingers around the object.")
    load: float = commands.option(
        type=registry.QuantityType("N"), default=0.0, help="Force on the object, reached in steps, such as 5mN."
    )
    direction: str = commands.option(
        default="-z", show_default=True, help="Direction of that force, as the first finger sees it."
    )
    label: str = commands.option(
        "--object", default="", help="Name of the object's [contact.NAME], if the case has several shapes."
    )
    steps: int = commands.option(
        type=click.IntRange(1, 1000), default=grasp.DEFAULT_STEPS, show_default=True,
        help="Steps to each pressure and to the load; with friction more of them are more accurate.",
    )  # fmt: skip
    output: Path | None = commands.output_option(  # noqa: RUF009
        "Folder for the results.  [default: results/grasp, or results/grasp-2 …]"
    )
    quiet: bool = commands.quiet_option()


@options.command("grasp")
@click.argument("file", type=click.Path(path_type=Path))
@commands.options(GraspOptions)
def grasp_command(file: Path, how: GraspOptions) -> None:
    """Close equal fingers around an object, and load it.

    The object is free in their plane. FILE is the case of one finger with a rigid cylinder that it presses on ([contact.NAME]);
    the others are its copies, turned around the cylinder's axis. At each pressure, and then at each step of the load,
    displacement and rotation of the object are those of equilibrium.

    Results: grasp.csv, with pose, force of each finger, force closure (1: friction can balance any force and moment in the
    plane) and the load that friction can balance as the fingers press now (bears_N); grasp.png.

    \b
    Exit status: 0 done; 1 failed; 2 bad input; 3 no equilibrium of the object at a requested pressure or load.

    \b
    Examples:
      softmodels grasp examples/grasp.toml --load 8mN
      softmodels grasp examples/grasp.toml --fingers 4 --load 5mN --direction x
    """
    case = options.case_of_file(file, None, how.changes)
    way = np.array(component.direction(how.direction, "--direction"))
    comm = mpi.start()
    asked = {"file": file, **vars(how)}
    folder = mpi.kept_on_root(comm, lambda: commands.open_folder(how.output, Path("results/grasp"), "grasp", asked, [file]))
    with sentences():
        made, states = grasp.grasp(case, how.fingers, how.load, way, how.label, how.steps)
    outlines = [made.outlines(held) for held in states]
    if mpi.is_root(comm) and folder is not None:

        def write(place: Path) -> None:
            from softmodels.pictures import analyses, style

            files.write_text(place / "grasp.csv", grasp_table(made, states))
            files.write_bytes(place / "grasp.png", style.png(analyses.grasp_figure(made, states, outlines)))

        ending.write_into(folder, write, "the results")
        if not how.quiet:
            for text in [*told(made, states), f"results in {folder.path}: grasp.csv, grasp.png"]:
                processes.say(text)
    if states[-1].load < how.load * (1 - 1e-9):
        ending.fail(
            f"no equilibrium of the object at a load of {how.load:.4g} N: beyond {states[-1].load:.4g} N it leaves the "
            "fingers; use a higher pressure, more friction or more fingers",
            3,
        )


def grasp_table(made: Grasp, states: Sequence[grasp.Held]) -> str:
    """Return ``grasp.csv``."""
    fingers = range(1, len(made.angles) + 1)
    parts = ("along_N", "across_N", "press_N", "sliding")
    head = [
        "pressure_cm", "pressure_Pa", "load_N", "moved_along_mm", "moved_across_mm", "turned_deg", "closure", "bears_N",
        *(f"finger{k}_{part}" for k in fingers for part in parts),
    ]  # fmt: skip
    rows = []
    for held in states:
        height = held.pressure / made.case.column.pascal
        numbers = [height, held.pressure, held.load, *held.moved * 1e3, math.degrees(held.turned),
                   float(held.closed(made.shape.friction)), held.bears(made.shape.friction)]  # fmt: skip
        for force, press, sliding in zip(held.forces, held.press, held.sliding, strict=True):
            numbers += [*force, press, sliding]
        rows.append([f"{number:.9g}" for number in numbers])
    return files.csv_text(head, rows)


def told(made: Grasp, states: Sequence[grasp.Held]) -> list[str]:
    """Return what a user wants to know, as sentences."""
    friction, lines = made.shape.friction, [f"note: {note}" for note in made.model.notes]
    for held in states if not states[-1].load else [held for held in states if not held.load] + [states[-1]]:
        forces = ", ".join(f"{force:.4g}" for force in held.press)
        closed = "force closure" if held.closed(friction) else "no force closure"
        pressure = made.case.column.full(held.pressure)
        lines.append(
            f"{pressure}, load {held.load:.4g} N: the fingers press with {forces} N, {closed}; the "
            f"object has moved {_zero(held.moved[0] * 1e3):.4g} mm along and {_zero(held.moved[1] * 1e3):.4g} mm across the "
            f"load and turned by {_zero(math.degrees(held.turned)):.3g} deg"
        )
    loaded = [held for held in states if held.load]
    slipped = next((held for held in loaded if held.bears(friction) < (1 + USED_UP) * held.load), None)
    if friction and loaded:
        lines.append(
            f"it slips at a load of about {slipped.load:.4g} N, where friction is used up"
            if slipped
            else f"it does not slip up to {loaded[-1].load:.4g} N"
        )
    return lines


def _zero(value: float) -> float:
    """Return a value without the rounding errors of zero."""
    return value if abs(value) > 1e-9 else 0.0


# ----------------------------------------------------------------------------------------------------------------------
# The command ``limit``.


CURVE_SAMPLES = 32


@dataclasses.dataclass(frozen=True)
class LimitOptions:
    """The options of the command except those of devices and laws."""

    changes: tuple[str, ...] = options.set_field()
    working_pressure: str | None = commands.option(
        metavar="PRESSURE", help="Working pressure, for the margin: cm of column (20), or with a unit (2kPa)."
    )
    vacuum: bool = commands.flag_option("How much vacuum it can take, instead of pressure.")
    hold: float | None = commands.option(type=registry.QuantityType("s"),
    help="Hold time the device must survive at constant pressure, applied at "
                                "once (silicone with memory); default: unlimited.")  # fmt: skip
    vary: tuple[str, ...] = commands.option(multiple=True, metavar="NAME=VALUE+-HALF", help="A tolerance, such as "
                                   "membrane=2mm+-0.2mm (a thickness) or offset=0mm+-0.2mm (the cavity's height in the part); "
                                   "may be repeated.")  # fmt: skip
    count: int | None = commands.option("--samples", type=click.IntRange(2, 4096),
                               help=f"Number of sampled devices.  [default: {CURVE_SAMPLES}]")  # fmt: skip
    normal: bool = commands.flag_option("Tolerances are two standard deviations of a normal distribution; default: uniform.")
    mesh_error: bool = commands.flag_option(
        "State the mesh error of the pressures: everything is solved again with smaller cells."
    )
    output: Path | None = commands.output_option(  # noqa: RUF009
        "Folder for tables and picture.  [default: with --vary results/limit, or results/limit-2 and so on]"
    )
    water_density: float | None = commands.option(
        type=registry.QuantityType("kg/m^3"),
        help=f"Density of the column's liquid.  [default: the case's, or {units.WATER_DENSITY:g}kg/m^3]",
    )


@dataclasses.dataclass(frozen=True)
class LimitRequest:
    """The question of one command.

    Attributes:
        case: A case around the device; its load is ignored.
        tolerances, count: Within which the device scatters, none for only the nominal device; how many devices.
        normal: Whether the tolerances are two standard deviations.
        column: Unit of the pressures.
        hold: Hold time in s that the device must survive; 0: unlimited.
        fitted: Errors of the materials that are files of a fit.
    """

    case: Case
    materials: Mapping[str, Material]
    tolerances: Sequence[analyses.Tolerance]
    count: int
    normal: bool
    column: LimitColumn
    hold: float
    fitted: Sequence[MaterialErrors]

    @classmethod
    def from_options(
        cls, kind: type[Actuator], file: Path | None, how: LimitOptions, names: Sequence[str], values: options.Values
    ) -> LimitRequest:
        """Make it from the command's options, of a case file or else a device, and those of device and law, None where not
        given; `CaseError`, `GeometryError` or `MaterialError` for invalid input."""
        if how.changes and file is None:
            raise CaseError("--set changes a case FILE; give one, or use the options of the device")
        case = None if file is None else simulation.AtRest.from_file(file, changes=how.changes)
        device, asked = _asked(kind, case, file, names, dict(values))
        for material in asked.values():
            specimens.check_rest(material)
        tolerances = [analyses.Tolerance.parse(text, type(device)) for text in how.vary]
        if not tolerances and (how.normal or how.count is not None):
            raise CaseError("--samples and --normal need a tolerance; give one with --vary")
        hold = analyses.check_hold(how.hold or 0.0, list(asked.values()))
        for other in ("vary", "vacuum"):
            if hold and getattr(how, other):
                raise CaseError(f"--hold and --{other} cannot be combined; leave out one of them")
        around = _as_asked(case, device, asked, how.water_density, -100.0 if how.vacuum else 100.0)
        around = dataclasses.replace(around, mesh_error=how.mesh_error or around.mesh_error)
        column = LimitColumn(around.column, _working_cm(how.working_pressure, around.column.pascal))
        fitted = list(filter(None, map(MaterialErrors.beside, names)))
        return cls(around, asked, tolerances, how.count or CURVE_SAMPLES, how.normal, column, hold, fitted)


def _working_cm(text: str | None, pascal_in_cm: float) -> float | None:
    """Return a working pressure in cm of the column, of a number of cm or a text with a unit; `CaseError` if it is not
    positive."""
    if text is None:
        return None
    try:
        plain = not entries.split_text(text)[1]
        value = (
            units.quantity(text, "")
            if plain
            else entries.one_of_text("cm", text, "working pressure", pascal_in_cm) / pascal_in_cm
        )
    except (entries.SeriesError, units.UnitError) as error:
        raise CaseError(f"--working-pressure: {error}") from None
    if not value > 0:
        raise CaseError(f"--working-pressure {text}: the working pressure must be above zero")
    return value


def limit(
    kind: type[Actuator], case_file: Path | None, how: LimitOptions, material: tuple[str, ...], values: options.Values
) -> None:
    """Find the largest pressure a device can take.

    The place of its largest strain is printed too. With --vacuum it is the largest vacuum. The device is that of a case FILE or
    of the options below (as a section, unless --section is given; --device NAME has those of another one); every --material
    adds a row. With --vary the limit's scatter over fabrication tolerances is added: of any thickness or other length, and of
    the offset of the cavity, which on a disk sits too high in a part of the same height (a thinner membrane over a thicker
    base). A sideways shift of a disk's core is not sampled: by symmetry it has no first-order effect.

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
    question = LimitRequest.from_options(kind, case_file, how, material, values)
    comm = mpi.start()
    folder = None
    if how.output is not None or question.tolerances:
        asked = {**values, **vars(how), "material": material, "cm": question.column.scale.pascal}
        files = [path for path in (case_file, *map(Path, material)) if path is not None and path.is_file()]
        folder = mpi.kept_on_root(comm, lambda: commands.open_folder(how.output, Path("results/limit"), "limits", asked, files))
    named, bands = analyses.with_sources(dict(question.materials))
    with sentences():
        limits, scattered = _answered(question, named, comm)
    if not mpi.is_root(comm):
        return
    notes = list(_notes(question, named, limits, scattered))
    for text in [
        *(sentence(name, limit, question.column) for name, limit in limits.items()),
        *analyses.band_texts(bands, limits, question.column.scale), *notes,
        *([scatter_text(scattered, question.column)] if scattered.sampled else []),
    ]:  # fmt: skip
        processes.say(text)
    if folder is not None:
        ending.write_into(folder, lambda place: write_page(place, question, limits, scattered, notes), "the tables")
        processes.say(f"tables and report.html in {folder.path}")


def _answered(question: LimitRequest, materials: Mapping[str, Material], comm: MPI.Comm) -> tuple[dict[str, Limit], Scatter]:
    """Return the limits by material and of the devices within the tolerances."""
    case, sampled = question.case, list[Sampled]()
    analyses.check_varied(case.actuator, question.tolerances, comm)
    limits = analyses.find_limit(case, list(materials.values()), comm, question.hold, question.fitted)
    if question.tolerances:
        values = analyses.samples(question.tolerances, question.count, question.normal)
        sampled = analyses.scatter(case, next(iter(materials.values())), question.tolerances, values, comm)
    return dict(zip(materials, limits, strict=True)), Scatter(question.tolerances, sampled)


def _notes(
    question: LimitRequest, materials: Mapping[str, Material], limits: Mapping[str, Limit], scatter: Scatter
) -> Iterator[str]:
    """Yield warnings about the limits."""
    device = question.case.actuator
    for name, limit in limits.items():
        weak = specimens.weakest(materials[name])
        if weak is not None and limit.stretch >= NEAR_STRETCH_LIMIT * weak.stretch:
            yield (
                f"note: {specimens.weakness(materials[name])}, and the state reaches stretch {limit.stretch:.3g}: the limit "
                "may come from the law, not from the device; use a law that is stable over these stretches (softmodels curve "
                "shows them)"
            )
        if text := silicones.extrapolated(materials[name], limit.stretch):
            yield f"note: {name}: {text}"
        if materials[name].misread:
            yield f"note: {materials[name].misread}"
    for text in dict.fromkeys(text for limit in limits.values() for text in limit.notes):
        yield f"note: {text}"
    if warned := [limit.notes for _, limit in scatter.sampled if limit.notes]:
        many = f"{len(warned)} of {len(scatter.sampled)} sampled devices have warnings"
        yield f"note: {many}; of the first: {'; '.join(warned[0])}"
    if hidden := unseen(device):
        yield f"note: {hidden}"
    if len(device.ratios) > 1:
        how = "in its ratios" if device.ratios != (1.0,) * len(device.ratios) else "the same"
        yield f"note: this is the pressure in all {len(device.ratios)} cavities, {how}; softmodels run takes a series for each"


def _as_asked(
    case: Case | None, device: Actuator, materials: Mapping[str, Material], water_density: float | None, dummy: float
) -> Case:
    """Return a case of the device with a dummy pressure in Pa, to check the input as any case is checked."""
    for material in materials.values():
        around = case or Case("limit", device, material, steps.one_step(steps.PRESSURE, [dummy]))
        made = dataclasses.replace(
            around, name="limit", actuator=device, material=material, load_unload=False,
            steps=steps.one_step(steps.PRESSURE, [dummy]), supply=None, inertia=False,
            water_density=around.water_density if water_density is None else water_density,
        )  # fmt: skip
    return made


def _asked(
    kind: type[Actuator], case: Case | None, file: Path | None, names: Sequence[str], values: options.Values
) -> tuple[Actuator, dict[str, Material]]:
    law = options.law_taken(values)
    given = any(value is not None for value in law.values())
    if case is not None:
        device, default = case.actuator, case.material
        changes = {key: value for key, value in values.items() if value is not None and key != "variant"}
        unknown = changes.keys() - {field.name for field in dataclasses.fields(device)}
        if values.get("variant") or unknown:
            raise CaseError(f"{file} already names the device; leave out --variant and options of other devices")
        device = device.replaced(**changes)
        registry.check_meaning(device, changes)
        if not names and not given:
            return device, {default.name: default}
    else:
        variant = kind.variants[str(values.get("variant") or "default")]
        if "section" in values and values["section"] is None and "section" not in variant:
            values["section"] = "axisymmetric"
        device = registry.device_told(kind, values)
    if len(names) > 1 and given:
        raise CaseError("parameters such as --shear-modulus belong to one --material; with several, leave the parameters out")
    if not names:
        made = materials.material_from(kind.silicone if case is None else None, law)
        return device, {made.name: made}
    return device, {name: materials.material_from(name, law) for name in names}


def _limit_command(kind: type[Actuator] = HollowDisk, cls: type[click.Command] = options.Command) -> click.Command:
    @click.argument("case_file", metavar="[FILE]", required=False, type=click.Path(path_type=Path))
    @commands.options(LimitOptions)
    def of_kind(case_file: Path | None, how: LimitOptions, material: tuple[str, ...], **values: object) -> None:
        limit(kind, case_file, how, material, values)  # a device may have a field "file"

    made = registry.device_options(kind)(options.material_options(of_kind, kind.silicone, several=True))
    return options.command("limit", cls=cls, help=limit.__doc__)(made)


limit_command = _limit_command(
    cls=options.by_device(_limit_command, "A device, with options of its own: {}.  [default: HollowDisk]")
)
