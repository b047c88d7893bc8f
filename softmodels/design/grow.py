"""Networks that grow: what a channel more at any place would do, and the stages of a search that adds the best.

A thin channel at the air's pressure P changes the potential per volume of its bore by (incompressible, shear modulus 1)

        e = -int_0^m (L - 1) ds - L ((s11 - s22)^2 / 4 + s12^2 + (s33 - m)^2 / 6 + s13^2 + s23^2)

where s is the Cauchy stress plus P, the channel's direction is 3, m = (s11 + s22) / 2, and L the growth of a bore's section
under m: m = (ln L + 1 - 1 / L) / 2. The first term is exact (a thick tube of neo-Hookean silicone), the rest is of a hole in a
linear solid (Eshelby 1957, doi 10.1098/rspa.1957.0133). The first-order gain of a quantity is minus the derivative of e along
its adjoint, times the bore's volume: the topological derivative of the network.
"""

from __future__ import annotations

import contextlib
import csv
import dataclasses
import functools
import io
import itertools
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np
import numpy.typing as npt

from geometries import ChannelPlate, GeometryError, MeshingError, actuator, drawings, network
from softmodels.case import entries
from softmodels.case.case import Case
from softmodels.common import commands, files
from softmodels.common.arrays import Array
from softmodels.common.lazy import MPI, fem, ufl
from softmodels.design import states, targets
from softmodels.design.model import DesignFolder, DesignModel, MeshedDesign
from softmodels.design.problem import GROW, DesignProblem, Growth, in_words, label, shown, shown_factor
from softmodels.design.result import Variant
from softmodels.design.trials import DesignError, DesignFailure
from softmodels.materials import laws
from softmodels.mechanics import compiling, mpi
from softmodels.runs import state_values
from softmodels.runs.outcomes import RunError

if TYPE_CHECKING:
    from softmodels.mechanics.system import System


def stages(
    problem: DesignProblem,
    ended: Sequence[Variant],
    folder: Path | None,
    comm: MPI.Comm,
    resume: bool,
    tell: Callable[[str], object],
) -> Iterator[tuple[str, DesignProblem]]:
    """Yield the problem of the network as it is, with its words, then with the channel that promises most, and so on, as long
    as the search of each gains. Each has to be in ``ended`` before the next is asked for."""
    growth, base = problem.growth, dataclasses.replace(problem, grow=None)
    assert growth is not None
    yield stage_name(len(_plate(base.case).drawn.channels)), base
    best = ended[-1]
    while best.result is not None and (count := len(_plate(best.result.case).drawn.channels)) < growth.most_channels:
        before, case = best, best.result.case
        file = None if folder is None else _map_file(folder, count)
        known = mpi.on_root(comm, functools.partial(_read, file, base)) if resume else None
        table = known or make_map(base, case, growth, file, comm)
        for doubt in doubts(base, _plate(case), table):
            tell(doubt)
        for attempt, candidate in enumerate(_promising(_plate(case), growth, table), 1):
            plate = _plate(case).with_channels(candidate.channels)
            try:
                grown = dataclasses.replace(base, case=dataclasses.replace(case, actuator=plate))
            except (DesignError, *entries.INPUT_ERRORS) as error:
                tell(f"{candidate.sentence(base)}, but is not tried: {error}")
                continue
            tell(candidate.sentence(base))
            yield stage_name(len(plate.drawn.channels), attempt), grown
            if gained(ended[-1], before):
                best = ended[-1]
                break
        if best is before:
            tell(f"no channel more gains; the network stays at {stage_name(count)}")
            return


MAX_TRIES = 3
"""Channels that are tried in turn, until one gains."""
MIN_RELATIVE_GAIN = 1e-3
"""Gain of the objective above which a channel stays."""


def stage_name(channels: int, attempt: int = 1) -> str:
    """Return the words of a stage."""
    return f"{channels} channel" + "s" * (channels > 1) + (f", try {attempt}" if attempt > 1 else "")


def _map_file(folder: Path, channels: int) -> Path:
    """Return the table of what a channel more would do; a drawing lies beside it."""
    return folder / f"more-than-{channels}.csv"


def file_names(problem: DesignProblem, folder_name: Callable[[str], str]) -> list[str]:
    """Return the files and folders that the stages of a problem may write."""
    assert problem.growth is not None
    counts = range(len(_plate(problem.case).drawn.channels), problem.growth.most_channels + 1)
    tables = [_map_file(Path(), count) for count in counts]
    maps = [str(file.with_suffix(ending)) for file in tables for ending in (".csv", ".svg")]
    return maps + [f"{folder_name(stage_name(count, k))}/" for count in counts for k in range(1, MAX_TRIES + 1)]


def gained(after: Variant, before: Variant) -> bool:
    """Return whether a stage is better than another by more than `MIN_RELATIVE_GAIN`, or keeps limits that it violates."""
    if after.result is None or after.result.stopped:
        return False
    new, old = after.order, before.order
    return new[:-1] < old[:-1] or (new[:-1] == old[:-1] and old[-1] - new[-1] > MIN_RELATIVE_GAIN * abs(old[-1]))


def _plate(case: Case) -> ChannelPlate:
    return cast("ChannelPlate", case.actuator)


# ----------------------------------------------------------------------------------------------------------------------
# Candidates: straight channels between places of a grid and nodes of the network, that join it and leave walls.


@dataclasses.dataclass(frozen=True)
class Candidate:
    """A channel that may be added: both ends (m) and its cavity, the texts of it and its mirror images, and the predicted gain
    of the objective in SI units, above 0 for the better."""

    start: network.Place
    end: network.Place
    cavity: str
    channels: tuple[str, ...]
    gain: float = 0.0

    def sentence(self, problem: DesignProblem) -> str:
        """Return what it is predicted to do."""
        asked = problem.terms[0].quantity
        where = " to ".join(f"({1e3 * x:.4g}, {1e3 * y:.4g})" for x, y in (self.start, self.end))
        both = "" if len(self.channels) == 1 else f" and its mirror image{'s' if len(self.channels) > 2 else ''}"
        does = "improve" if self.gain >= 0.0 else "worsen"
        by = in_words(asked, abs(self.gain), 3)
        return f"a channel from {where} mm{both} is predicted to {does} {label(asked, problem.case)} by {by}"


def candidates(problem: DesignProblem, case: Case, growth: Growth, comm: MPI.Comm) -> list[Candidate]:
    """Return the channels that join the network of a case's plate, with what a problem's objective gains, the best first;
    walls are not checked."""
    plate = _plate(case)
    radius = growth.radius or plate.radius
    ends = np.array(list(itertools.combinations(_places(plate, growth, radius), 2)))
    shares = np.linspace(0.0, 1.0, 2 * PLACES_ALONG + 1)[:, None]
    points = ends[:, None, 0] + shares * (ends[:, None, 1] - ends[:, None, 0])
    points = np.concatenate([points, np.full((*points.shape[:2], 1), plate.offset)], axis=2)
    away = [_distances(plate, name, points) for name in plate.drawn.cavities]
    joined = np.array([own.min(axis=1) < -JOINED_DEPTH * radius for own in away])
    kept = joined.sum(axis=0) == 1
    cavity = joined.argmax(axis=0)[kept]
    silicone = np.min(away, axis=0)[kept, 1::2] > radius  # nearer to other walls it is no thin channel in a large block
    gains = ThinChannels(problem, case, comm).gains(points[kept, 1::2], silicone, cavity, radius)
    made, known = [], list[Array]()
    for (a, b), number, gain in zip(ends[kept], cavity.tolist(), gains.tolist(), strict=True):
        if any(_same(np.array([a, b]), line) for line in known):
            continue
        known += (images := _images(plate, a, b))
        name = plate.drawn.cavities[number]
        texts = tuple(_text(line, growth.radius, name) for line in images)
        made.append(Candidate(tuple(a.tolist()), tuple(b.tolist()), name, texts, len(images) / plate.copies * gain))
    return sorted(made, key=lambda candidate: -candidate.gain)


PLACES_ALONG = 40
"""Places along a channel at which its gain is computed."""
JOINED_DEPTH = 0.5
"""How deep in the air of another channel a centre line has to reach to join it, in its radii."""


def _places(plate: ChannelPlate, growth: Growth, radius: float) -> list[network.Place]:
    """Return the nodes of the network and, with room to them, the places of the grid."""
    nodes = network.Nodes.of(plate.drawn.channels).places[:, :2]
    (low, high), margin = plate.box, plate.edge + radius
    axes = [np.linspace(a, b, n + 2)[1:-1] if n == 1 else np.linspace(a, b, n)
            for a, b, n in zip(low + margin, high - margin, growth.grid, strict=True)]  # fmt: skip
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    away = np.linalg.norm(grid[:, None] - nodes, axis=2).min(axis=1)
    return [(x, y) for x, y in np.concatenate([nodes, grid[away > 2.0 * radius + plate.least_wall]]).tolist()]


def _distances(plate: ChannelPlate, cavity: str, points: Array) -> Array:
    distance = network.Distance(plate.drawn.channels_of(cavity), 0.0)
    return distance.distances(points.reshape(-1, 3)).reshape(points.shape[:-1])


def _images(plate: ChannelPlate, a: Array, b: Array) -> list[Array]:
    """Return a line in the plane and its mirror images, each once."""
    lines: list[Array] = []
    for image in actuator.reflected(plate.normals)[:, :2, :2]:
        line = np.array([image @ a, image @ b])
        if not any(_same(line, known) for known in lines):
            lines.append(line)
    return lines


def _same(line: Array, other: Array) -> bool:
    return min(np.abs(line - other).max(), np.abs(line[::-1] - other).max()) < SAME_PLACE


SAME_PLACE = 1e-9
"""In m."""


def _text(line: Array, radius: float, cavity: str) -> str:
    """Return the text of a channel, rounded to 1e-9 m; radius 0 for that of the plate."""
    places = " to ".join(f"{x + 0.0:.6f}, {y + 0.0:.6f}" for x, y in (1e3 * line).round(6))
    return f"{places} mm" + (f" radius {1e3 * radius:.9g} mm" if radius else "") + (f" in {cavity}" if cavity else "")


def _promising(plate: ChannelPlate, growth: Growth, table: Sequence[Candidate]) -> Iterator[Candidate]:
    """Yield the best channels that leave walls and gain, at most `MAX_TRIES`."""
    tries = 0
    for candidate in table:
        if candidate.gain <= 0.0 or tries == MAX_TRIES:
            return
        if len(plate.drawn.channels) + len(candidate.channels) <= growth.most_channels:
            with contextlib.suppress(GeometryError):
                plate.with_channels(candidate.channels)
                tries += 1
                yield candidate


def map_alone(problem: DesignProblem, folder: DesignFolder | None, comm: MPI.Comm) -> list[str]:
    """Write what a channel more would do in the problem's plate as it is, and return the best of them and the worst in
    sentences; RunError if the plate cannot be solved."""
    if problem.growth is None:
        raise DesignError(f"--map needs to know which channels may be added; add [grow] with {', '.join(GROW)} to the problem")
    if folder is not None:
        folder.own.claim([MAP, str(Path(MAP).with_suffix(".svg"))])
    file = mpi.on_root(comm, lambda: None if folder is None else folder.path / MAP)
    table = make_map(problem, problem.case, problem.growth, file, comm)
    told = [candidate.sentence(problem) for candidate in dict.fromkeys([*table[:BEST_SHOWN], *table[-1:]])]
    return [*told, *doubts(problem, _plate(problem.case), table)]


def doubts(problem: DesignProblem, plate: ChannelPlate, table: Sequence[Candidate]) -> list[str]:
    """Return a sentence on gains that are beyond first order: close to a limit point all channels seem to do wonders."""
    asked = problem.terms[0].quantity
    if asked.unit != "m" or not table or table[0].gain <= plate.thickness:
        return []
    return [
        f"a gain of {in_words(asked, table[0].gain, 3)} is beyond first order: it is more than the plate's thickness, as "
        "close to a limit point; ask for the objective at a lower pressure"
    ]


BEST_SHOWN = 5
MAP = "map.csv"
"""The table of the plate as it is; stages have theirs of their designs."""


def make_map(problem: DesignProblem, case: Case, growth: Growth, file: Path | None, comm: MPI.Comm) -> list[Candidate]:
    """Return `candidates`, written as a table, with a drawing beside it, if there is a file; RunError if the plate cannot be
    solved."""
    try:
        table = candidates(problem, case, growth, comm)
    except (DesignFailure, MeshingError) as error:
        raise RunError(f"what a channel more would do is unknown: {error}", commands.EXIT_NO_EQUILIBRIUM) from error
    if file is not None:
        mpi.on_root(comm, lambda: _write(file, problem, _plate(case), table))
    return table


HEADS = ("x1 (mm)", "y1 (mm)", "x2 (mm)", "y2 (mm)", "cavity", "channels")


def _write(file: Path, problem: DesignProblem, plate: ChannelPlate, table: Sequence[Candidate]) -> None:
    """Write the table and the drawing of channels that may be added."""
    asked, out = problem.terms[0].quantity, io.StringIO()
    rows = csv.writer(out, lineterminator="\n")
    rows.writerow([*HEADS, f"predicted gain ({shown(asked)})"])
    most, lines = max((abs(each.gain) for each in table), default=0.0) or 1.0, []
    for each in table:
        places = [f"{1e3 * value:.9g}" for value in (*each.start, *each.end)]
        rows.writerow([*places, each.cavity, "; ".join(each.channels), f"{each.gain / shown_factor(asked):.9g}"])
        share, colour = (each.gain / most) ** 2, "#1b7837" if each.gain > 0.0 else "#b2182b"
        for (x1, y1), (x2, y2) in (1e3 * np.array(_images(plate, np.array(each.start), np.array(each.end)))).tolist():
            lines.append(
                f'<line x1="{x1:.4f}" y1="{-y1:.4f}" x2="{x2:.4f}" y2="{-y2:.4f}" stroke="{colour}" '
                f'stroke-width="{0.05 + 0.5 * share:.3f}" stroke-opacity="{0.15 + 0.85 * share:.3f}"/>'
            )
    files.write_text(file, out.getvalue())
    picture = drawings.svg_text(plate.drawn).replace("<polyline", '<polyline opacity="0.3"')
    files.write_text(file.with_suffix(".svg"), picture.replace("</svg>", "\n".join([*reversed(lines), "</svg>"])))


def _read(file: Path | None, problem: DesignProblem) -> list[Candidate] | None:
    """Return the channels of a table that `_write` wrote; None without one."""
    if file is None or not file.is_file():
        return None
    _, *rows = csv.reader(io.StringIO(files.read_text(file)))
    return [
        Candidate(
            (1e-3 * float(x1), 1e-3 * float(y1)), (1e-3 * float(x2), 1e-3 * float(y2)), cavity, tuple(texts.split("; ")),
            float(gain) * shown_factor(problem.terms[0].quantity),
        )
        for x1, y1, x2, y2, cavity, texts, gain in rows
    ]  # fmt: skip


# ----------------------------------------------------------------------------------------------------------------------
# What a thin channel does, to first order.


class ThinChannels:
    """The states and adjoints of a problem's objective on a mesh of a case's plate as it is, for the gains of thin
    channels."""

    def __init__(self, problem: DesignProblem, case: Case, comm: MPI.Comm):
        self.problem, self.case, self.comm = problem, case, comm
        self._weights: list[float] = []
        self._states: list[tuple[Array, Array | None]] = []
        """Pressures of the cavities and `_tensors` of each part of the objective."""
        model = DesignModel(case, (), [term.quantity for term in problem.terms], comm)
        try:
            model.evaluate(np.zeros(0))
            assert model.meshed is not None
            self._collect(model.meshed)
        finally:
            model.release()

    def _collect(self, meshed: MeshedDesign) -> None:
        """Keep the mesh and its states and adjoints."""
        system = meshed.design.system
        self._unit, self._grid = system.length_unit, state_values.Grid(system)
        numbers = mpi.gathered(self.comm, system.body.mesh.topology.original_cell_index[: len(system.cells)])
        table = _tensors(system, meshed.adjoint.multiplier)
        for term in self.problem.terms:
            composite = term.quantity if isinstance(term.quantity, targets.CompositeQuantity) else None
            values = []
            for part in composite.parts if composite else [term.quantity]:
                values.append(meshed.solve_adjoint(part))
                at = np.asarray(table.eval(system.body.mesh, system.cells)).reshape(len(system.cells), 4, 4, 3, 3)
                everywhere = mpi.gathered(self.comm, at)
                tensors = None if everywhere is None or numbers is None else everywhere[np.argsort(numbers)]
                self._states.append((np.array(system.pressures[: len(system.ratios)]), tensors))
            slopes = composite.combined(np.array(values))[1] if composite else [1.0]
            self._weights += [term.weight * float(slope) for slope in slopes]

    def gains(self, points: Array, silicone: npt.NDArray[np.bool_], cavity: npt.NDArray[np.int64], radius: float) -> Array:
        """Return what the objective gains by channels, above 0 for the better, in SI units, shape (k,).

        Args:
            points: Middles of equal pieces of each, in m, shape (k, n, 3).
            silicone: Which of them lie in the silicone, shape (k, n).
            cavity: Number of the cavity of each, shape (k,).
            radius: Of their bores, in m.
        """
        return mpi.on_root(self.comm, lambda: self._gains(points, silicone, cavity, radius))

    def _gains(self, points: Array, silicone: npt.NDArray[np.bool_], cavity: npt.NDArray[np.int64], radius: float) -> Array:
        plate, count = _plate(self.case), points.shape[1]
        along = points[:, -1] - points[:, 0]
        length = np.linalg.norm(along, axis=1)
        volume = np.pi * radius**2 * length / (count - 1) / self._unit**3
        images = actuator.reflected(plate.normals)
        there = np.einsum("gij,mj->gmi", images, points[silicone])
        outside = (there @ np.reshape(plate.normals, (-1, 3)).T).max(axis=2, initial=-np.inf)  # of the slice that is meshed
        image = outside.argmin(axis=0)
        here = there[image, np.arange(len(image))]
        owner = np.nonzero(silicone)[0]
        direction = np.einsum("mij,mj->mi", images[image], (along / length[:, None])[owner])
        places = states.Places(self._grid.points, self._grid.cells, here)
        gains = np.zeros(len(points))
        for weight, (pressures, tensors) in zip(self._weights, self._states, strict=True):
            assert tensors is not None
            A, C, dA, dC = np.einsum("mc,mctij->tmij", places.share, tensors[places.cell])
            pressure = pressures[cavity[owner], None, None]
            step = 1j * COMPLEX_STEP
            energy = channel_energy(A + pressure * C + step * (dA + pressure * dC), C + step * dC, direction)
            rate = -energy.imag / COMPLEX_STEP
            gains -= self.problem.sign * weight * np.bincount(owner, rate * volume[owner], len(points))
        return gains


COMPLEX_STEP = 1e-30
"""Into the complex plane: exact to rounding."""


def _tensors(system: System, multiplier: fem.Function) -> fem.Expression:
    """Return at the corners of cells F^T sigma F and C in device coordinates, then their derivatives along a function, of the
    loaded state in shear moduli."""
    potential = system.potential
    F = ufl.variable(system.body.deformation_gradient(potential.displacement))
    (region,), strain = potential.regions, laws.Strain(F)
    density = potential.density(region.material, region.parameters, region.bulk, strain=strain)
    A, C = F.T * ufl.diff(density, F) * strain.C / strain.J, strain.C
    tensors = [A, C, *(ufl.derivative(T, system.w, multiplier) for T in (A, C))]
    entries = ufl.as_vector([T[i, j] for T in tensors for i in range(3) for j in range(3)])
    with compiling.compiling():
        return fem.Expression(entries, np.vstack([np.zeros(3), np.eye(3)]), jit_options=compiling.JIT)


def channel_energy(A: Array, C: Array, along: Array) -> Array:
    """Return the energy e of thin channels, see above, in shear moduli, shape (m,), real or complex: by F^T (sigma + P) F and
    C, shape (m, 3, 3), and their undeformed directions, shape (m, 3)."""

    def product(T: Array, a: Array, b: Array) -> Array:
        return np.einsum("mi,mij,mj->m", a, T, b)

    axes: list[Array] = []  # unit vectors once deformed
    for start in (along, np.broadcast_to([0.0, 0.0, 1.0], along.shape), np.cross(along, [0.0, 0.0, 1.0])):
        axis = start - sum((product(C, start, known)[:, None] * known for known in axes), np.zeros(along.shape))
        axes.append(axis / np.sqrt(product(C, axis, axis))[:, None])
    third, first, second = axes
    s11, s22, s33 = (product(A, axis, axis) for axis in (first, second, third))
    s12, s13, s23 = product(A, first, second), product(A, first, third), product(A, second, third)
    m = (s11 + s22) / 2.0
    near = np.abs(m.real) < MAX_STRESS
    m = np.where(near, m, 0.0)
    L = np.exp(m)
    for _ in range(SECTION_STEPS):
        L = L - ((np.log(L) + 1.0 - 1.0 / L) / 2.0 - m) * 2.0 / (1.0 / L + 1.0 / L**2)
    grown = (L - 1.0) * m - (L - 1.0) * np.log(L) / 2.0
    energy = -grown - L * ((s11 - s22) ** 2 / 4.0 + s12**2 + (s33 - m) ** 2 / 6.0 + s13**2 + s23**2)
    return np.where(near, energy, 0.0)


MAX_STRESS = 3.0
"""Largest m that counts; more is of cells in creases that are nearly inverted."""
SECTION_STEPS = 12
"""Of Newton's method for L, from the side from which it converges."""
