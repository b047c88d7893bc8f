"""``softmodels modes``: natural frequencies of a device along its path, and their modes."""

from __future__ import annotations

import dataclasses
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np

from geometries import ACTUATORS, Actuator, MeshingError
from softmodels.case.case import Case
from softmodels.case.entries import INPUT_ERRORS, series
from softmodels.cli.drawing import end, start_drawing, tell_not_drawn
from softmodels.cli.options import DEVICE, CaseOptions, by_device, fail, open_on_root, taken, write_into
from softmodels.cli.run_command import HELP_OPTIONS, case_of_file
from softmodels.common.commands import FolderType
from softmodels.common.files import write_bytes, write_text
from softmodels.common.output import ResultFolder
from softmodels.common.terminal import say
from softmodels.mechanics.component import ComponentError
from softmodels.mechanics.mpi import abort_on_error, is_root, start
from softmodels.runs.frequencies import MOST_MODES, NaturalFrequencies, case_for_modes, find_frequencies
from softmodels.runs.model import AtRest
from softmodels.runs.outcomes import FAILED, Ended, RunError

if TYPE_CHECKING:
    pass


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


HELP = """Find the natural frequencies of a device at rest and while it is inflated, and their modes.

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


def command_of(device: type[Actuator]) -> click.Command:
    """Return the command for a registered device."""
    options = CaseOptions(device, device.silicone)

    def command(**values: object) -> None:
        given, how = dict(values), taken(ModesOptions, values)
        _find(lambda: case_for_modes(options.case(values, AtRest)), how, given, [])

    command.__doc__ = HELP
    made = options.add(modes_options(command))
    return click.command(name=f"softmodels modes {DEVICE} {device.__name__}", context_settings=HELP_OPTIONS)(made)


def _of_file(**values: object) -> None:
    given, how = dict(values), taken(ModesOptions, values)
    file, material, pressures = values["file"], values["material"], values["pressures"]
    assert isinstance(file, Path)

    def case() -> Case:
        cm = series(pressures, "pressure") if pressures else ()
        return case_for_modes(case_of_file(file, None if material is None else str(material)), cm)

    _find(case, how, given, [file])


def _command() -> click.Command:
    made = modes_options(_of_file)
    made = click.option("--pressure-cm", "pressures", metavar="SERIES", help="Pressures in cm of the column, instead of the "
                        "case's load: 0:40, 0:40:10 or 0,10,40.")(made)  # fmt: skip
    made = click.option("--material", metavar="NAME", help="Material, instead of the case's [material]: a silicone, or a TOML "
                        "file.")(made)  # fmt: skip
    text = f"A device, with options of its own, instead of a FILE: {', '.join(ACTUATORS)}."
    made = click.option(DEVICE, metavar="NAME", expose_value=False, help=text)(made)
    made = click.argument("file", type=click.Path(path_type=Path))(made)
    return click.command("modes", cls=by_device(command_of), help=HELP, context_settings=HELP_OPTIONS)(made)


command = _command()


def _find(make: Callable[[], Case], how: ModesOptions, options: Mapping[str, object], files: Sequence[Path]) -> None:
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
        _told(case, found, how, folder)
    if found.ended.status:
        fail(found.ended.message, found.ended.status)
    sys.exit(0)


def _told(case: Case, found: NaturalFrequencies, how: ModesOptions, folder: ResultFolder) -> None:
    def write(place: Path) -> None:
        write_text(place / "modes.csv", table(found, case.cm))
        if not how.no_pictures:
            _draw(case, found, how.sealed, place)

    write_into(folder, write, "the results")
    if how.quiet:
        return
    shown = [*np.flatnonzero(found.requested), *([] if found.requested[-1] else [len(found.pressure) - 1])]
    for state in shown:
        values = ", ".join(f"{value:.4g}" for value in found.frequency[state])
        say(f"{_place(found, state, case.cm)}: {values} Hz")
    for text in [*found.unstable, *(f"note: {note}" for note in found.notes), f"results in {folder.path}"]:
        say(text)


def _place(found: NaturalFrequencies, state: int, cm: float) -> str:
    pressure = found.pressure[state]
    return f"{pressure / cm:.4g} cm ({pressure / 1e3:.4g} kPa)" if pressure else "no pressure"


def table(found: NaturalFrequencies, cm: float) -> str:
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


def _draw(case: Case, found: NaturalFrequencies, sealed: bool, place: Path) -> None:
    """Draw the frequencies, and the modes of the last state; say so if that fails."""
    from softmodels.pictures.modes import DRAWN, frequency_figure, section_shapes, solid_shapes
    from softmodels.pictures.style import png

    write_bytes(place / "frequencies.png", png(frequency_figure(found.pressure / case.cm, found.frequency, sealed)))
    last, state = found.modes[-1][:DRAWN], len(found.modes) - 1
    at = _place(found, state, case.cm)
    titles = [f"f{k} = {mode.frequency:.4g} Hz" if mode.stable else f"f{k}: unstable" for k, mode in enumerate(last, 1)]
    titles[0] += f", {at}"
    moved, shapes = found.points + found.displacement[-1], [mode.displacement for mode in last]
    if case.actuator.dimension == 2:
        write_bytes(place / "shapes.png", png(section_shapes(moved, shapes, found.cells, titles)))
        return
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "shapes.npz"
        np.savez(file, **vars(solid_shapes(found.points, found.cells, found.cell_name, case.actuator, moved, shapes)))
        process = start_drawing(case, "softmodels.pictures.modes", str(file), str(place / "shapes.png"), *titles)
        try:
            out, errors = process.communicate()
        finally:
            end(process)
    if process.returncode:
        tell_not_drawn(out, errors, process.returncode, "the frequencies are complete")
