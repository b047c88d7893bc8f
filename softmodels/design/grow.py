"""Networks that grow: what a channel more at any place would do, or one less, and the stages of a search that takes the best.

A thin channel at the air's pressure P changes the potential per volume of its bore by (incompressible, shear modulus 1)

        e = -int_0^m (L - 1) ds - L ((s11 - s22)^2 / 4 + s12^2 + (s33 - m)^2 / 6 + s13^2 + s23^2)

where s is the Cauchy stress plus P, the channel's direction is 3, m = (s11 + s22) / 2, and L the growth of a bore's section
under m: m = (ln L + 1 - 1 / L) / 2. The first term is exact (a thick tube of neo-Hookean silicone), the rest is of a hole in a
linear solid (Eshelby 1957, doi 10.1098/rspa.1957.0133). The first-order gain of a quantity is minus the derivative of e along
its adjoint, times the bore's volume: the topological derivative of the network. A channel that is there is worth half of the
slope by a factor on its radii, because a thin one's effect is as the square of them.

Where limits hold a design back, what a channel does to them is priced by their multipliers: it is ranked by the Lagrangian.
"""

from __future__ import annotations

import contextlib
import csv
import dataclasses
import functools
import io
import itertools
import math
from collections import Counter
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
from softmodels.design.problem import GROW, MOTIONS, DesignProblem, Growth, in_words, label, shown, shown_factor
from softmodels.design.result import DesignResult, Variant
from softmodels.design.trials import DesignError, DesignFailure
from softmodels.materials import laws
from softmodels.mechanics import compiling, mpi
from softmodels.runs import state_values
from softmodels.runs.outcomes import RunError

if TYPE_CHECKING:
    from softmodels.design.quantities import DesignQuantity
    from softmodels.mechanics.system import System


def stages(
    problem: DesignProblem,
    ended: Sequence[Variant],
    folder: DesignFolder | None,
    comm: MPI.Comm,
    resume: bool,
    tell: Callable[[str], object],
) -> Iterator[tuple[str, DesignProblem]]:
    """Yield the problem of the network as it is, with its words, then with the channel more, or less, or in place of another
    that promises most, and so on, as long as the search of each gains. Each has to be in ``ended`` before the next is asked
    for."""
    growth, base = problem.growth, dataclasses.replace(problem, grow=None)
    assert growth is not None
    count = len(_plate(base.case).drawn.channels)
    yield stage_name(count), base
    best, names, maps = ended[-1], Counter({count: 1}), Counter[int]()
    while best.result is not None:
        before, case = best, best.result.case
        count = len(_plate(case).drawn.channels)
        maps[count] += 1
        file = None if folder is None else _map_file(folder.path, count, maps[count])
        known = mpi.on_root(comm, functools.partial(_read, file, base)) if resume else None
        table = known or make_map(base, case, growth, file, comm, prices(best.result), folder)
        for doubt in doubts(base, _plate(case), table):
            tell(doubt)
        distance = best.result.end.objective if base.of_target else np.inf
        tries = 0.0
        for candidate, plate in _promising(_plate(case), growth, table, distance):
            if tries >= MAX_TRIES:
                break
            try:
                grown = dataclasses.replace(base, case=dataclasses.replace(case, actuator=plate))
            except (DesignError, *entries.INPUT_ERRORS) as error:
                tell(f"{candidate.sentence(base)}, but is not tried: {error}")
                continue
            tell(candidate.sentence(base))
            names[len(plate.drawn.channels)] += 1
            yield stage_name(len(plate.drawn.channels), names[len(plate.drawn.channels)]), grown
            tries += 1.0 if ended[-1].result is not None else UNSOLVED_TRY
            if gained(ended[-1], before):
                best = ended[-1]
                break
        if best is before:
            tell(f"no channel more or less gains; the network stays at {stage_name(count)}")
            return


MAX_TRIES = 3
"""Changes of the network that are tried in turn, until one gains."""
UNSOLVED_TRY = 0.5
"""What a network counts that has no state at the pressure."""
MIN_RELATIVE_GAIN = 1e-3
"""Gain of the objective above which a change stays."""


def prices(result: DesignResult) -> list[tuple[DesignQuantity, float]]:
    """Return the limits that hold a design back, and what the objective, as it is minimised, loses by a unit more of each."""
    rows = [(holder.row, holder.multiplier) for holder in result.holding.holders if holder.row and result.feasible]
    return [
        (row.keep.quantity, result.form.size * multiplier * row.sign / row.scale)
        for row, multiplier in rows
        if row.keep.quantity.name in (*MOTIONS, *PRICED) and row.key == row.keep.quantity.key
    ]


PRICED = ("limit_margin", "limit_pressure", "peak_stretch", "peak_von_mises")
"""Limits that a channel changes through the state alone, as long as other places are the most stretched ones."""


def stage_name(channels: int, attempt: int = 1) -> str:
    """Return the words of a stage."""
    return f"{channels} channel" + "s" * (channels > 1) + (f", try {attempt}" if attempt > 1 else "")


def _map_file(folder: Path, channels: int, number: int) -> Path:
    """Return the table of what a change of the network would do; a drawing lies beside it."""
    return folder / f"more-than-{channels}{f'-{number}' if number > 1 else ''}.csv"


def gained(after: Variant, before: Variant) -> bool:
    """Return whether a stage is better than another by more than `MIN_RELATIVE_GAIN`, or keeps limits that it violates."""
    if after.result is None or after.result.stopped:
        return False
    new, old = after.order, before.order
    return new[:-1] < old[:-1] or (new[:-1] == old[:-1] and old[-1] - new[-1] > MIN_RELATIVE_GAIN * abs(old[-1]))


def _plate(case: Case) -> ChannelPlate:
    return cast("ChannelPlate", case.actuator)


# ----------------------------------------------------------------------------------------------------------------------
# Candidates: straight channels between places of a grid and nodes of the network, that join it and leave walls; and channels
# that may go, because the rest stays together.


@dataclasses.dataclass(frozen=True)
class Candidate:
    """A channel that may be added, removed, or put in the place of ``removed`` ones (numbers from 1): both ends (m), its cavity
    and height (m), the texts of it and its mirror images where it is added, the predicted gain of the objective in SI units,
    above 0 for the better, and what the limits take of it."""

    start: network.Place
    end: network.Place
    cavity: str
    channels: tuple[str, ...]
    gain: float = 0.0
    price: float = 0.0
    offset: float = 0.0
    removed: tuple[int, ...] = ()

    @property
    def worth(self) -> float:
        """The gain minus the price."""
        return self.gain - self.price

    def on(self, plate: ChannelPlate) -> ChannelPlate:
        """Return a plate with the change; GeometryError if it leaves no walls, or parts of the network without air."""
        kept = plate.without_channels(self.removed) if self.removed else plate
        return kept.with_channels(self.channels) if self.channels else kept

    def bore(self, plate: ChannelPlate, radius: float) -> float:
        """Return the volume of the bores that are added and removed, in m3."""
        added = np.pi * radius**2 * math.dist(self.start, self.end) * len(self.channels)
        return added + sum(plate.drawn.channels[number - 1].bore for number in self.removed)

    def sentence(self, problem: DesignProblem) -> str:
        """Return what it is predicted to do."""
        asked = problem.terms[0].quantity
        where = " to ".join(f"({1e3 * x:.4g}, {1e3 * y:.4g})" for x, y in (self.start, self.end))
        count = len(self.channels or self.removed)
        both = "" if count == 1 else f" and its mirror image{'s' if count > 2 else ''}"
        numbers = "channel" + "s" * (len(self.removed) > 1) + " " + ", ".join(map(str, self.removed))
        place = f" at {1e3 * self.offset:.4g} mm" if problem.growth and problem.growth.heights else ""
        what = f"a channel from {where} mm{place}{both}" if self.channels else f"to remove the channel from {where} mm{both}"
        what += f" in place of {numbers}" if self.channels and self.removed else ""
        does = "improve" if self.gain >= 0.0 else "worsen"
        by = in_words(asked, abs(self.gain), 3)
        limits = f", of which the limits take {in_words(asked, self.price, 3)}" if self.price > 0.0 else ""
        limits = f", and to leave room in the limits worth {in_words(asked, -self.price, 3)}" if self.price < 0.0 else limits
        return f"{what} is predicted to {does} {label(asked, problem.case)} by {by}{limits}"


def candidates(problem: DesignProblem, case: Case, growth: Growth, comm: MPI.Comm, limits: Limits = ()) -> list[Candidate]:
    """Return the channels that join the network of a case's plate, and those that may go, with what a problem's objective
    gains, and loses by ``limits`` of `prices`, the best first; walls are not checked."""
    plate = _plate(case)
    radius = growth.radius or plate.radius
    pairs = [itertools.combinations(_places(plate, growth, radius, z), 2) for z in growth.heights or (plate.offset,)]
    ends = np.array(list(itertools.chain(*pairs)))
    shares = np.linspace(0.0, 1.0, 2 * PLACES_ALONG + 1)[:, None]
    points = ends[:, None, 0] + shares * (ends[:, None, 1] - ends[:, None, 0])
    away = [_distances(plate, name, points) for name in plate.drawn.cavities]
    joined = np.array([own.min(axis=1) < -JOINED_DEPTH * radius for own in away])
    kept = joined.sum(axis=0) == 1
    cavity = joined.argmax(axis=0)[kept]
    silicone = np.min(away, axis=0)[kept, 1::2] > radius  # nearer to other walls it is no thin channel in a large block
    thin = ThinChannels(problem, case, comm, limits)
    gains = thin.gains(points[kept, 1::2], silicone, cavity, radius)
    made, known = [], set[frozenset[object]]()
    for line, number, (gain, price) in zip(ends[kept], cavity.tolist(), gains.tolist(), strict=True):
        if _key(line) in known:
            continue
        images = {_key(image): image for image in _images(plate, line)}
        known |= images.keys()
        name, share = plate.drawn.cavities[number], len(images) / plate.copies
        texts = tuple(_text(image, growth, name) for image in images.values())
        (a, b), offset = line[:, :2].tolist(), float(line[0, 2])
        made.append(Candidate(tuple(a), tuple(b), name, texts, share * gain, share * price, offset))
    for numbers, (gain, price) in thin.without.items():
        own = plate.drawn.channels[numbers[0] - 1]
        (x1, y1, offset), (x2, y2, _) = own.points[0], own.points[-1]
        made.append(Candidate((x1, y1), (x2, y2), own.cavity, (), gain, price, offset, numbers))
    return sorted(made, key=lambda candidate: -candidate.worth)


Limits = Sequence[tuple["DesignQuantity", float]]
PLACES_ALONG = 40
"""Places along a channel at which its gain is computed."""
JOINED_DEPTH = 0.5
"""How deep in the air of another channel a centre line has to reach to join it, in its radii."""


def _places(plate: ChannelPlate, growth: Growth, radius: float, height: float) -> list[list[float]]:
    """Return the nodes of the network near a height (m) and, with room to them, the places of the grid, all at that height."""
    nodes = network.Nodes.of(plate.drawn.channels).places
    nodes = nodes[np.abs(nodes[:, 2] - height) < radius][:, :2]
    (low, high), margin = plate.box, plate.edge + radius
    axes = [np.linspace(a, b, n + 2)[1:-1] if n == 1 else np.linspace(a, b, n)
            for a, b, n in zip(low + margin, high - margin, growth.grid, strict=True)]  # fmt: skip
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    away = np.linalg.norm(grid[:, None] - nodes, axis=2).min(axis=1, initial=np.inf)
    room = (away > 2.0 * radius + plate.least_wall) & (network.depths(grid, plate.paths) > radius + plate.least_wall)
    return [[x, y, height] for x, y in np.concatenate([nodes, grid[room]]).tolist()]


def _distances(plate: ChannelPlate, cavity: str, points: Array) -> Array:
    distance = network.Distance(plate.drawn.channels_of(cavity), 0.0)
    return distance.distances(points.reshape(-1, 3)).reshape(points.shape[:-1])


def _images(plate: ChannelPlate, line: Array) -> Array:
    """Return a line (m, shape (n, 3)) and its mirror images."""
    return np.einsum("gij,nj->gni", actuator.reflected(plate.normals), line)


def _key(line: Array) -> frozenset[object]:
    """Return the same for lines through the same places, either way."""
    return frozenset(map(tuple, (line / SAME_PLACE).round().astype(int).tolist()))


SAME_PLACE = 1e-7
"""In m."""


def _text(line: Array, growth: Growth, cavity: str) -> str:
    """Return the text of a channel, rounded to 1e-9 m; one of the plate's radius and height leaves them out."""
    places = " to ".join(f"{x + 0.0:.6f}, {y + 0.0:.6f}" for x, y in (1e3 * line[:, :2]).round(6))
    radius = f" radius {1e3 * growth.radius:.9g} mm" if growth.radius else ""
    offset = f" offset {1e3 * line[0, 2]:.9g} mm" if growth.heights else ""
    return f"{places} mm{radius}{offset}" + (f" in {cavity}" if cavity else "")


def removable(plate: ChannelPlate) -> list[tuple[int, ...]]:
    """Return the numbers, from 1, of written channels with their mirror images, without which the others are one network."""
    channels, groups = plate.drawn.channels, dict[tuple[int, ...], None]()
    keys = [(_key(np.array(each.points)), each.cavity) for each in channels]
    for each in channels[len(channels) - len(plate.channels) :]:
        images = {(_key(image), each.cavity) for image in _images(plate, np.array(each.points))}
        groups[tuple(number for number, key in enumerate(keys, 1) if key in images)] = None
    kept = []
    for numbers in groups:
        with contextlib.suppress(GeometryError):
            plate.without_channels(numbers)
            kept.append(numbers)
    return kept


def _promising(
    plate: ChannelPlate, growth: Growth, table: Sequence[Candidate], distance: float
) -> Iterator[tuple[Candidate, ChannelPlate]]:
    """Yield the best changes that leave walls and gain, with the plate; also one channel for another
    where there may be no more. Of a distance from a target the gain is at most that which would be left of it."""
    count, radius = len(plate.drawn.channels), growth.radius or plate.radius
    added = [each for each in table if each.channels]
    room = [each for each in added if count + len(each.channels) <= growth.most_channels]
    gone = [each for each in table if not each.channels]
    swaps = [
        dataclasses.replace(new, gain=new.gain + old.gain, price=new.price + old.price, removed=old.removed)
        for new in added
        for old in gone
        if new not in room and count + len(new.channels) - len(old.removed) <= growth.most_channels
    ]
    bores = {each: each.bore(plate, radius) for each in (*room, *gone, *swaps)}
    strength = max((abs(each.gain) / bores[each] for each in (*room, *gone)), default=0.0)

    def expected(each: Candidate) -> float:
        if not np.isfinite(distance):
            return each.worth
        # The square of the distance with the least second-order term that the strongest channel of this table has.
        square = distance**2 - 2.0 * distance * each.gain + (strength * bores[each]) ** 2
        return distance - np.sqrt(max(square, 0.0)) - each.price

    for worth, _, each in sorted(((expected(each), -k, each) for k, each in enumerate(bores)), reverse=True):
        if worth <= 0.0:
            return
        try:
            changed = each.on(plate)
        except GeometryError:
            continue
        yield each, changed


def map_alone(problem: DesignProblem, folder: DesignFolder | None, comm: MPI.Comm) -> list[str]:
    """Write what a channel more would do in the problem's plate as it is, and return the best of them and the worst in
    sentences; RunError if the plate cannot be solved."""
    if problem.growth is None:
        raise DesignError(f"--map needs to know which channels may be added; add [grow] with {', '.join(GROW)} to the problem")
    file = mpi.on_root(comm, lambda: None if folder is None else folder.path / MAP)
    table = make_map(problem, problem.case, problem.growth, file, comm, (), folder)
    told = [candidate.sentence(problem) for candidate in dict.fromkeys([*table[:BEST_SHOWN], *table[-1:]])]
    if problem.of_target:
        told.append(
            "gains are to first order: channels overshoot a target, and a search ranks them by what would be left of it"
        )
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


def make_map(
    problem: DesignProblem,
    case: Case,
    growth: Growth,
    file: Path | None,
    comm: MPI.Comm,
    limits: Limits,
    folder: DesignFolder | None,
) -> list[Candidate]:
    """Return `candidates`, written as a table, with a drawing beside it, into a folder if there is one; RunError if the plate
    cannot be solved."""
    try:
        table = candidates(problem, case, growth, comm, limits)
    except (DesignFailure, MeshingError) as error:
        raise RunError(f"what a channel more would do is unknown: {error}", commands.EXIT_NO_EQUILIBRIUM) from error
    if file is not None and folder is not None:
        folder.own.claim([file.name, file.with_suffix(".svg").name])
        _write(file, problem, _plate(case), table)
    return table


HEADS = ("x1 (mm)", "y1 (mm)", "x2 (mm)", "y2 (mm)", "offset (mm)", "cavity", "channels", "removed")


def _write(file: Path, problem: DesignProblem, plate: ChannelPlate, table: Sequence[Candidate]) -> None:
    """Write the table and the drawing of channels that may be added or, dashed, removed."""
    asked, out = problem.terms[0].quantity, io.StringIO()
    rows, factor = csv.writer(out, lineterminator="\n"), shown_factor(asked)
    rows.writerow([*HEADS, f"predicted gain ({shown(asked)})", f"taken by limits ({shown(asked)})"])
    most, lines = max((abs(each.worth) for each in table), default=0.0) or 1.0, []
    for each in table:
        places = [f"{1e3 * value:.9g}" for value in (*each.start, *each.end, each.offset)]
        texts = "; ".join(each.channels), "; ".join(map(str, each.removed))
        rows.writerow([*places, each.cavity, *texts, *(f"{value / factor:.9g}" for value in (each.gain, each.price))])
        share, colour = (each.worth / most) ** 2, "#1b7837" if each.worth > 0.0 else "#b2182b"
        dashes = "" if each.channels else 'stroke-dasharray="0.6 0.4" '
        for (x1, y1, _), (x2, y2, _) in (1e3 * _images(plate, np.array([(*each.start, 0.0), (*each.end, 0.0)]))).tolist():
            lines.append(
                f'<line x1="{x1:.4f}" y1="{-y1:.4f}" x2="{x2:.4f}" y2="{-y2:.4f}" stroke="{colour}" {dashes}'
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
    factor = shown_factor(problem.terms[0].quantity)
    return [
        Candidate(
            (1e-3 * float(x1), 1e-3 * float(y1)), (1e-3 * float(x2), 1e-3 * float(y2)), cavity,
            tuple(filter(None, texts.split("; "))), float(gain) * factor, float(price) * factor, 1e-3 * float(offset),
            tuple(map(int, filter(None, removed.split("; ")))),
        )
        for x1, y1, x2, y2, offset, cavity, texts, removed, gain, price in rows
    ]  # fmt: skip


# ----------------------------------------------------------------------------------------------------------------------
# What a thin channel does, to first order.


class ThinChannels:
    """The states and adjoints of a problem's objective and of ``limits`` of `prices` on a mesh of a case's plate as it is, for
    what thin channels do: ``without`` has it of those that may go, by their numbers, as `gains` of those that may come."""

    def __init__(self, problem: DesignProblem, case: Case, comm: MPI.Comm, limits: Limits = ()):
        self.case, self.comm, self.without = case, comm, dict[tuple[int, ...], Array]()
        self._states: list[tuple[Array, Array, Array | None]] = []
        """Rates of the gain and the price by each part of the objective or limit, pressures of the cavities, and `_tensors`."""
        asked = [(term.quantity, np.array([-problem.sign * term.weight, 0.0])) for term in problem.terms]
        asked += [(quantity, np.array([0.0, weight])) for quantity, weight in limits]
        model = DesignModel(case, (), [quantity for quantity, _ in asked], comm, highest=problem.highest)
        try:
            model.evaluate(np.zeros(0))
            assert model.meshed is not None
            self._collect(model.meshed, asked)
        finally:
            model.release()

    def _collect(self, meshed: MeshedDesign, asked: Sequence[tuple[DesignQuantity, Array]]) -> None:
        """Keep the mesh and its states and adjoints."""
        system, plate = meshed.design.system, _plate(self.case)
        self._unit, self._grid = system.length_unit, state_values.Grid(system)
        numbers = mpi.gathered(self.comm, system.body.mesh.topology.original_cell_index[: len(system.cells)])
        table = _tensors(system, meshed.adjoint.multiplier)
        groups = removable(plate)
        smaller = {str(k): meshed.design.motion.toward(_shrunk(plate, group)) / SHRUNK_SHARE for k, group in enumerate(groups)}
        without = np.zeros((len(groups), 2))
        for quantity, rates in asked:
            composite = quantity if isinstance(quantity, targets.CompositeQuantity) else None
            values, at, slopes = [], [], []
            for part in composite.parts if composite else [quantity]:
                value, by_group = meshed.solve_adjoint(part, smaller)
                values.append(value)
                slopes.append(list(by_group.values()))
                own = np.asarray(table.eval(system.body.mesh, system.cells)).reshape(len(system.cells), 4, 4, 3, 3)
                everywhere = mpi.gathered(self.comm, own)
                tensors = None if everywhere is None or numbers is None else everywhere[np.argsort(numbers)]
                at.append((np.array(system.pressures[: len(system.ratios)]), tensors))
            weights = composite.combined(np.array(values))[1] if composite else np.ones(1)
            without += 0.5 * np.outer(weights @ np.array(slopes).reshape(len(values), len(groups)), rates)
            self._states += [(weight * rates, *own) for weight, own in zip(weights, at, strict=True)]
        self.without = dict(zip(groups, without, strict=True))

    def gains(self, points: Array, silicone: npt.NDArray[np.bool_], cavity: npt.NDArray[np.int64], radius: float) -> Array:
        """Return what the objective gains by channels, above 0 for the better, and what the limits take, in SI units, shape
        (k, 2).

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
        gains = np.zeros((len(points), 2))
        for rates, pressures, tensors in self._states:
            assert tensors is not None
            A, C, dA, dC = np.einsum("mc,mctij->tmij", places.share, tensors[places.cell])
            pressure = pressures[cavity[owner], None, None]
            step = 1j * COMPLEX_STEP
            energy = channel_energy(A + pressure * C + step * (dA + pressure * dC), C + step * dC, direction)
            change = -energy.imag / COMPLEX_STEP
            gains += np.outer(np.bincount(owner, change * volume[owner], len(points)), rates)
        return gains


def _shrunk(plate: ChannelPlate, numbers: Sequence[int]) -> ChannelPlate:
    """Return a plate whose channels of these numbers, from 1, have radii smaller by `SHRUNK_SHARE`."""
    lists = {name: np.array(plate.entries(name)) for name in ("start_radii", "end_radii")}
    for values in lists.values():
        values[np.array(numbers) - 1] *= 1.0 - SHRUNK_SHARE
    return plate.replaced(**{name: tuple(values.tolist()) for name, values in lists.items()})


SHRUNK_SHARE = 1e-4
"""Share of a radius by which it is changed for a slope."""
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


MAX_STRESS = 1.0
"""Largest m that counts, by which a section grows 3.5 times; more is beside a wall that balloons, or of cells in creases that
are nearly inverted."""
SECTION_STEPS = 12
"""Of Newton's method for L, from the side from which it converges."""
