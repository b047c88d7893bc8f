"""Design problems: a device, free parameters, objective and limits."""

from __future__ import annotations

import dataclasses
import itertools
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Protocol, TypedDict

import numpy as np
import numpy.typing as npt

from geometries import Actuator, ChannelPlate
from softmodels.case import entries, materials, tolerances
from softmodels.case.case import Case, of_shape, value_of, variable_names, varied, with_changes
from softmodels.common import errors, names, schema, tables, units
from softmodels.common.arrays import Array
from softmodels.common.lazy import MPI
from softmodels.common.names import checked
from softmodels.common.units import quantity
from softmodels.design import trials
from softmodels.design.quantities import PROBE, QUANTITIES, DesignQuantity, InflationWork, OfLimit, StoredEnergy
from softmodels.design.trials import DesignError, Trial, text
from softmodels.mechanics import controls

OBJECTIVES = {"maximise": -1.0, "minimise": 1.0, "follow": 1.0}
"""Kinds of objectives, with the sign for minimisation."""
TABLES = ("name", "case", "parameters", *OBJECTIVES, "keep", "grow", "tolerance", "material_errors")
LIMIT_SEARCH_FACTOR = 1.15
"""Factor above the required limit pressure up to which a limit point is searched; beyond it, it does not matter."""


@checked
@dataclasses.dataclass(frozen=True, eq=False)
class DesignProblem:
    """A design problem. Numbers are in SI units, strings carry a unit.

    Attributes:
        case: The device at the start with its material, or a case file; its last pressure is the highest one available.
        parameters: Free parameters with their bounds: ``{"membrane": ("1 mm", "3 mm")}``. A list's name stands for all of its
            entries.
        maximise, minimise, follow: One of these: a quantity of `softmodels.design.quantities`, or a table that names one, such
            as ``{"quantity": "rise", "of": "tip", "at": "177 cm"}``. Several pressures make a mean, with optional ``weights``.
        keep: What must hold: `Keep`, or tables with a quantity and ``at_least``, ``at_most`` or both.
        tolerance: Half widths of 95 % intervals by parameter, and the ``process`` of all other lengths, as in a case
            (`softmodels.case.tolerances`); with them limits hold with 95 %. Those of the case's lengths unless given.
        material_errors: A fitted material (``fitted.toml`` of `softmodels fit`), whose errors count likewise. Those of the
            case's band unless given.
        grow: How channels are added to a network, see `Growth`; None to keep those that it has.
        name: Of the results; the case's if empty.
        folder: From which files are counted; None for the current one.

    Raises:
        DesignError: From the constructor, in one sentence.
    """

    case: Case
    parameters: Mapping[str, object]
    maximise: DesignQuantity | Mapping[str, object] | None = None
    minimise: DesignQuantity | Mapping[str, object] | None = None
    follow: DesignQuantity | Mapping[str, object] | None = None
    keep: Sequence[Keep | Mapping[str, object]] = ()
    tolerance: Mapping[str, object] | None = None
    material_errors: object = None
    grow: Mapping[str, object] | None = None
    name: str = ""
    folder: Path | None = dataclasses.field(default=None, repr=False)
    bare: bool = dataclasses.field(default=True, repr=False)
    fixed: Mapping[str, int] = dataclasses.field(default_factory=dict, repr=False)
    """Of a variant the whole numbers that were chosen."""
    written: Mapping[str, object] = dataclasses.field(default_factory=dict, repr=False)
    """The case's tables from its file; empty for a case from Python."""
    free: tuple[Free, ...] = dataclasses.field(init=False, default=())
    counts: Mapping[str, tuple[int, int]] = dataclasses.field(init=False, default_factory=dict)
    """Whole numbers of the device that may change, with their bounds."""
    terms: tuple[ObjectiveTerm, ...] = dataclasses.field(init=False, default=())
    objective: str = dataclasses.field(init=False, default="")
    limits: tuple[Keep, ...] = dataclasses.field(init=False, default=())
    spreads: Mapping[str, float] = dataclasses.field(init=False, default_factory=dict)
    errors: materials.MaterialErrors | None = dataclasses.field(init=False, default=None)
    notes: tuple[str, ...] = dataclasses.field(init=False, default=())
    growth: Growth | None = dataclasses.field(init=False, default=None)

    def __post_init__(self) -> None:
        try:
            self._settle()
        except entries.INPUT_ERRORS as error:
            raise DesignError(str(error)) from None

    def _settle(self) -> None:
        if not isinstance(self.name, str):
            raise DesignError(f"name is {units.brief(self.name)}; it must be a valid file name")
        if self.folder is not None:
            object.__setattr__(self, "folder", names.place("folder", self.folder, "a folder"))
        case = self.case
        if not isinstance(case, Case):
            file = _place(case, self.folder)
            case = Case.from_file(file)
            object.__setattr__(self, "written", tables.read_toml(file))
        _check_load(case)
        reader = Reader(case, QUANTITIES, self.bare, self.folder)
        table = dict(_flat(_table(self.parameters, "parameters")))
        counts = {name: _count(case, name, table.pop(name)) for name in list(table) if _is_count(case.actuator, name)}
        object.__setattr__(self, "counts", counts)
        free = free_parameters(case, table, self.bare) if table or not (counts or self.fixed) else ()
        objective, terms = self._objective(reader)
        errors = _errors(self.material_errors, case, self.folder)
        limits = [keep for k, entry in enumerate(_list(self.keep), 1) for keep in _keeps(reader, entry, f"keep {k}")]
        settled: dict[str, object] = {
            "case": case, "free": free, "objective": objective, "terms": terms,
            "limits": tuple(limits),
            "spreads": spreads_of(case, self.tolerance, self.bare),
            "errors": errors, "name": self.name or case.name,
            "notes": tuple(filter(None, [crossed_corners(case, free), _unread(case) if self.tolerance is None else ""])),
        }  # fmt: skip
        for name, value in settled.items():
            object.__setattr__(self, name, value)
        dataclasses.replace(case, name=self.name)  # a valid file name
        object.__setattr__(self, "growth", None if self.grow is None else Growth.of(self, _table(self.grow, "grow")))
        for keep in self.limits:
            _check_walls(case, keep)
        _check_path(case, self.quantities)
        if not self.working and any(quantity.name == MARGIN for quantity in self.quantities):
            raise DesignError(f"{MARGIN} is relative to the highest pressure of the problem, but no quantity has a pressure")

    def _objective(self, reader: Reader) -> tuple[str, tuple[ObjectiveTerm, ...]]:
        given = [name for name in OBJECTIVES if getattr(self, name) is not None]
        if not given:
            raise DesignError(f"the problem has no objective; give one of {', '.join(OBJECTIVES)}")
        if len(given) > 1:
            raise DesignError(f"{' and '.join(given)} are two objectives; give only one, and a limit (keep) for the other")
        entry = getattr(self, given[0])
        quantities = reader.quantities(entry, given[0], ("weights",))
        if isinstance(entry, Mapping) and entry.get("quantity") == CLEARANCES:
            raise DesignError(f"{given[0]}: {CLEARANCES} has many values and cannot be an objective; use it as a limit (keep)")
        weights = entry.get("weights") if isinstance(entry, Mapping) else None
        weights = [1.0] * len(quantities) if weights is None else [trials.read("a weight", w, "1") for w in _list(weights)]
        if len(weights) != len(quantities) or min(weights) < 0.0 or sum(weights) <= 0.0:
            raise DesignError(
                f"{given[0]}: {len(weights)} weights for {len(quantities)} pressures; give each one positive weight, or none"
            )
        return given[0], tuple(
            ObjectiveTerm(quantity, w / sum(weights)) for quantity, w in zip(quantities, weights, strict=True)
        )

    def variants(self) -> Iterator[tuple[str, DesignProblem]]:
        """Yield the problem for each choice of the whole numbers, with its words, as in ``chambers 4``."""
        rest = {name: bounds for name, bounds in _flat(_table(self.parameters, "parameters")) if name not in self.counts}
        for choice in itertools.product(*(range(low, high + 1) for low, high in self.counts.values())):
            values = dict(zip(self.counts, choice, strict=True))
            words = ", ".join(f"{name} {value}" for name, value in values.items())
            try:
                case = dataclasses.replace(self.case, actuator=dataclasses.replace(self.case.actuator, **values))
                yield words, dataclasses.replace(self, case=case, parameters=rest, fixed=values)
            except entries.INPUT_ERRORS as error:
                raise DesignError(f"{words}: {error}") from None

    @property
    def sign(self) -> float:
        """-1 if larger is better."""
        return OBJECTIVES[self.objective]

    @property
    def of_target(self) -> bool:
        """Whether the objective is a distance, which cannot fall below 0."""
        return self.sign > 0.0 and all(term.quantity.name in DISTANCES for term in self.terms)

    @property
    def names(self) -> tuple[str, ...]:
        """Parameters of the gradients: the free ones, then those with only a tolerance."""
        free = [parameter.name for parameter in self.free]
        return (*free, *(name for name in self.spreads if name not in free))

    @property
    def highest(self) -> float | None:
        """Pressure in Pa up to which a limit point is searched, well above the required one; None for the default."""
        kept = dict.fromkeys((MARGIN, "bifurcation_margin"), self.working)
        kept |= dict.fromkeys(("limit_pressure", "bifurcation_pressure"), 1.0)
        if any(term.quantity.name in kept for term in self.terms):
            return None
        most = [
            (keep.at_most or keep.at_least or 0.0) * kept[keep.quantity.name]
            for keep in self.limits
            if keep.quantity.name in kept
        ]
        return LIMIT_SEARCH_FACTOR * max(*most, self.working, key=abs) if most else None

    @property
    def working(self) -> float:
        """The pressure of the problem farthest from 0 in Pa; 0 for none."""
        return max((highest_pressure(quantity) or 0.0 for quantity in self.quantities), default=0.0, key=abs)

    @property
    def quantities(self) -> list[DesignQuantity]:
        """All quantities, each once."""
        quantities = [*(term.quantity for term in self.terms), *(keep.quantity for keep in self.limits)]
        return list({quantity.key: quantity for quantity in quantities}.values())

    @classmethod
    def from_toml(cls, text: str, folder: Path | None = None) -> DesignProblem:
        """Read a problem file; files in it are counted from ``folder``.

        Raises:
            DesignError: Not TOML, unknown entries, or an invalid problem.
        """
        try:
            return cls._from_tables(tables.parse_toml(text), folder)
        except tables.TomlError as error:
            raise DesignError(f"the problem {error}") from None

    @classmethod
    def from_file(cls, path: Path | str, changes: Sequence[str] = ()) -> DesignProblem:
        """Read a problem file, with changed fields of its case (`softmodels.case.case.with_changes`); the messages name it."""
        path = Path(path)
        try:
            return cls._from_tables(tables.read_toml(path), path.parent, changes)
        except tables.TomlError as error:
            raise DesignError(f"problem file {path} {error}") from None
        except DesignError as error:
            raise DesignError(f"{path}: {error}") from None

    @classmethod
    def _from_tables(cls, problem: dict[str, object], folder: Path | None, changes: Sequence[str] = ()) -> DesignProblem:
        if "tolerances" in problem:
            raise DesignError(
                "[tolerances] held standard deviations; write [tolerance], as in a case, with half widths of 95 % intervals, "
                "which are 1.96 times as large"
            )
        for key in problem:
            if key not in TABLES:
                raise DesignError(f"the problem has an unknown entry {key!r}; {errors.known_are(key, TABLES)}")
        if "case" not in problem:
            raise DesignError('the problem has no case; give a case file, case = "slab.toml", or a [case] table')
        values = {key: value for key, value in problem.items() if key != "case"}
        case, home = problem["case"], folder
        try:
            if changes and not isinstance(case, dict):
                file = _place(case, folder)
                case, home = tables.read_toml(file), file.parent
            written = with_changes(case, changes) if isinstance(case, dict) else {}
            if isinstance(case, dict):
                case = Case._from_tables(dict(written), home)
            return cls(**{"parameters": {}, **values}, case=case, folder=folder, bare=False, written=written)  # type: ignore[arg-type]
        except entries.INPUT_ERRORS as error:
            raise DesignError(str(error)) from None


@dataclasses.dataclass(frozen=True)
class Growth:
    """How channels are added to a `ChannelPlate`: straight ones between the places of a grid and the network's nodes, with a
    radius in m, 0 for the plate's own, until there are ``most_channels``; at heights in m, none for the plate's own offset."""

    grid: tuple[int, int]
    radius: float
    most_channels: int
    heights: tuple[float, ...] = ()

    @classmethod
    def of(cls, problem: DesignProblem, table: Mapping[str, object]) -> Growth:
        """Read the table ``grow`` of a problem; DesignError for invalid entries, or a device that cannot grow."""
        for key in table:
            if key not in GROW:
                raise DesignError(f"grow has an unknown entry {key!r}; {errors.known_are(key, GROW)}")
        case, plate = problem.case, problem.case.actuator
        if not isinstance(plate, ChannelPlate):
            raise DesignError(f"grow adds channels to a ChannelPlate, and the device is a {type(plate).__name__}; leave it out")
        if problem.counts:
            raise DesignError(f"grow and the whole numbers {', '.join(problem.counts)} cannot vary together; leave out one")
        for part in case.components:
            if part.inside(plate) or part.remembers:
                raise DesignError(f"grow takes plates of one silicone without friction; leave out the {part.where}")
        for term in problem.terms:
            for asked in getattr(term.quantity, "parts", (term.quantity,)):
                if asked.name not in MOTIONS or (asked.load and asked.load.kind != trials.PRESSURE):
                    raise DesignError(
                        f"grow needs an objective that is a motion at a pressure, and {asked.title} is none; use one of "
                        f"{', '.join(MOTIONS)}, and a limit (keep) for the rest"
                    )
        written = table.get("candidates", "6 x 3")
        match = re.fullmatch(r"\s*(\d+)\s*x\s*(\d+)\s*", written) if isinstance(written, str) else None
        grid = (int(match[1]), int(match[2])) if match else (0, 0)
        if not 2 <= grid[0] * grid[1] <= MOST_PLACES:
            raise DesignError(
                f"grow: candidates is {units.brief(written)}; write the places along x and y between which channels are tried, "
                f"such as '6 x 3', from 2 to {MOST_PLACES} in all"
            )
        radius = trials.read("grow: radius", table["radius"], "m", problem.bare) if "radius" in table else 0.0
        count, most = len(plate.drawn.channels), table.get("most_channels")
        if isinstance(most, bool) or not isinstance(most, int) or not count < most <= MOST_CHANNELS:
            raise DesignError(
                f"grow: most_channels is {units.brief(most)}; the plate has {count} already, so give a whole number from "
                f"{count + 1} to {MOST_CHANNELS}"
            )
        if "radius" in table and not 0.0 < 2.0 * radius < plate.thickness:
            raise DesignError(
                f"grow: radius is {units.brief(table['radius'])}; it must be above 0 and below half the thickness"
            )
        own = radius or plate.radius
        for free in problem.free:
            if free.name.startswith(("start_radii", "end_radii")) and not free.low <= own <= free.high:
                raise DesignError(
                    f"new channels have a radius of {free.text(own)}, outside the bounds of {free.name}, {free.text(free.low)} "
                    f"to {free.text(free.high)}; give grow a radius within them"
                )
        heights = tuple(trials.read("grow: heights", z, "m", problem.bare) for z in _list(table.get("heights", ())))
        places = [z for each in plate.drawn.channels for _, _, z in each.points]
        for height in heights:
            if not any(abs(height - z) < own for z in places):
                raise DesignError(
                    f"grow: no channel lies at the height {1e3 * height:.4g} mm that others could join; give the plate a first "
                    f"one there, with offset {1e3 * height:.4g} mm"
                )
        return cls(grid, radius, most, heights)


GROW = ("candidates", "radius", "most_channels", "heights")
DISTANCES = ("outline", "surface", "tip_path", "pose")
MOTIONS = ("rise", "height", "place", "top_height", "face_place", "turn", "outline", "surface")
"""Quantities that a thin channel changes through the state alone."""
MOST_PLACES, MOST_CHANNELS = 100, 200

LIMITS = ("at_least", "at_most")


def _place(case: object, folder: Path | None) -> Path:
    if not isinstance(case, str | Path):
        raise DesignError(f"case is {units.brief(case)}; it must be a case, a case file or a [case] table")
    return (folder or Path()) / case


def _table(value: object, what: str) -> Mapping[str, object]:
    if not isinstance(value, Mapping):
        raise DesignError(f"{what} is {units.brief(value)}; it must be a table, starting with a line [{what}]")
    return value


def _list(value: object) -> Sequence[object]:
    if isinstance(value, list | tuple):
        return value
    if isinstance(value, Keep):
        return [value]
    raise DesignError(f"{units.brief(value)} is not a list; each limit starts with a line [[keep]]")


def _errors(given: object, case: Case, folder: Path | None) -> materials.MaterialErrors | None:
    """Return the errors of the case's material: as given, or from a fitted material's file."""
    if given is None:
        return case.band if isinstance(case.band, materials.MaterialErrors) else None
    if isinstance(given, Mapping) and set(given) == {"file"}:
        given = given["file"]
    if isinstance(given, str | Path):
        given = materials.MaterialErrors.from_file((folder or Path()) / given)
    if not isinstance(given, materials.MaterialErrors):
        raise DesignError(f'material_errors is {units.brief(given)}; give a fitted material, file = "results/fit/fitted.toml"')
    given.check(case.material)
    return given


def _check_load(case: Case) -> None:
    """Reject loads unsuitable for designs."""
    if not (pressures := case.load.of(trials.PRESSURE)):
        raise DesignError(f"the case asks for {case.load.requested.words}; designs need pressures (pressure = '0:5 kPa')")
    if min(pressures) < 0.0 < max(pressures):
        raise DesignError("the case asks for pressures above and below ambient; designs need one side of it")
    if case.load_unload:
        raise DesignError("the case unloads (load_unload), but designs are evaluated during loading only; leave it out")
    for part in case.components:
        if why := part.undesigned(case.actuator):
            raise DesignError(f"the case has a {part.where}, {why}; leave it out")


def _check_path(case: Case, quantities: Sequence[DesignQuantity]) -> None:
    """Reject what is not available where states depend on their path, which is followed in fixed steps of the pressure."""
    rubbing = next((part.where for part in case.components if part.remembers), "")
    if not rubbing:
        return
    loads = [part.where for part in case.components if isinstance(part, controls.LoadPart)]
    if loads:
        raise DesignError(f"{rubbing} has friction, and designs with friction take no loads; leave out {loads[0]}")
    for asked in (part for term in quantities for part in getattr(term, "parts", (term,))):
        if isinstance(asked, OfLimit | StoredEnergy | InflationWork):
            raise DesignError(f"{asked.name} is not available with friction ({rubbing}); leave it out, or set friction = 0")
        if asked.load is not None and asked.load.kind == trials.VOLUME:
            raise DesignError(f"{asked.title} is at a volume, but with friction ({rubbing}) designs need pressures")


def _keeps(reader: Reader, entry: object, where: str) -> list[Keep]:
    if isinstance(entry, Keep):
        table: Mapping[str, object] = {side: getattr(entry, side) for side in LIMITS}
        asked = reader.quantities(entry.quantity, where)
    else:
        table = _table(entry, where)
        asked = reader.quantities(table, where, LIMITS)
    keeps = [Keep(limit, *(reader.limit(table, side, limit, where) for side in LIMITS)) for limit in asked]
    for keep in keeps:
        check_limits(keep, where)
    return keeps


def _check_walls(case: Case, keep: Keep) -> None:
    """Reject a minimum wall that the given device does not satisfy."""
    if keep.quantity.name != CLEARANCES or keep.at_least is None:
        return
    for wall, value in case.actuator.clearances.items():
        if value < keep.at_least:
            raise DesignError(
                f"the workshop's smallest wall is {in_words(keep.quantity, keep.at_least)}, but at the start {wall} is "
                f"{in_words(keep.quantity, value)}; start from a device that can be made"
            )


# ----------------------------------------------------------------------------------------------------------------------
# Objectives and limits of a design, from tables or as values.


class Reader:
    """Reads quantities of a problem: their classes by name, numbers for SI units if ``bare``, their files from a folder."""

    def __init__(self, case: Case, registry: Mapping[str, type[DesignQuantity]], bare: bool, folder: Path | None):
        self.case, self.registry, self.bare, self.folder = case, registry, bare, folder

    def quantities(self, entry: object, where: str, more: Sequence[str] = ()) -> list[DesignQuantity]:
        """Return the quantities of a table that may have ``more`` entries, one for each pressure; a quantity given as a value
        is kept. DesignError for an unknown quantity or entry, or one that is missing."""
        if not isinstance(entry, Mapping):
            if not isinstance(entry, DesignQuantity):
                raise DesignError(f"{where} is {units.brief(entry)}; it must be a quantity")
            return [self._checked(entry, where)]
        kind = self._kind(entry.get("quantity"), where)
        fields = {field.name: field for field in dataclasses.fields(kind) if field.init}
        for key in entry:
            if key not in ("quantity", *fields, *more):
                names = [name for name in fields if name != "at" or kind.of_state]
                raise DesignError(f"{where} has an unknown entry {key!r}; {errors.known_are(key, [*names, *more])}")
        given = {key: self._given(key, value) for key, value in entry.items() if key in fields and key != "at"}
        if "cm" in fields:  # in whose heights a quantity's file may give pressures
            given.setdefault("cm", self.case.column.pascal)
        places: Sequence[object] = [None]
        if kind.of_state:
            if "at" not in entry:
                raise DesignError(f'{where}: {kind.name} needs a pressure, such as at = "177 cm"')
            at = entry["at"]
            places = [self._at(load, where) for load in (at if isinstance(at, list | tuple) else [at])]
            if not places:
                raise DesignError(f"{where}: at is empty; give one or more pressures")
        elif "at" in entry:
            raise DesignError(f"{where}: {kind.name} has no pressure; leave out at")
        return [self._made(kind, {**given, **({} if place is None else {"at": place})}, where) for place in places]

    def _kind(self, name: object, where: str) -> type[DesignQuantity]:
        if name is None:
            raise DesignError(f"{where} names no quantity; {errors.known_are('', self.registry)}")
        if not isinstance(name, str) or name not in self.registry:
            raise DesignError(f"{where}: quantity {units.brief(name)} is unknown; {errors.known_are(name, self.registry)}")
        return self.registry[name]

    def _given(self, key: str, value: object) -> object:
        if key == "file":
            if not isinstance(value, str):
                raise DesignError(f"file is {units.brief(value)}; it must be a file name")
            return value if self.folder is None else str(self.folder.resolve() / value)
        return _tuples(value)

    def _made(self, kind: type[DesignQuantity], values: Mapping[str, object], where: str) -> DesignQuantity:
        try:
            return self._checked(kind(**values), where)  # type: ignore[arg-type]  # the constructor checks
        except (ValueError, TypeError) as error:
            raise DesignError(str(error) if isinstance(error, DesignError) else f"{where}: {error}") from None

    def _checked(self, asked: DesignQuantity, where: str) -> DesignQuantity:
        """Reject a probe or figure missing in the device, and a pressure above the case's."""
        device, of = self.case.actuator, getattr(asked, "of", "")
        what, known = asked.named(device, self.case.components)
        if (of or what != PROBE) and of not in known:
            raise DesignError(f"{where}: this {type(device).__name__} has no {what} {of!r}; {errors.known_are(of, known)}")
        if asked.of_state and asked.at is None:
            raise DesignError(f"{where}: {asked.name} needs a pressure (at)")
        pressure, last = highest_pressure(asked), self.case.values[-1]
        if pressure is not None and pressure / last > 1 + 1e-9:
            said, told = getattr(asked.at, "text", ""), self.case.column.text
            beyond = "above" if last > 0.0 else "below"
            raise DesignError(
                f"{where}: {asked.title} is at {said or told(pressure, '.5g')}, {beyond} the case's last pressure, "
                f"{told(last, '.5g')} ({last / 1e3:.5g} kPa)"
            )
        self._check_sides(asked, where)
        return asked

    def _check_sides(self, asked: DesignQuantity, where: str) -> None:
        """Reject a state on the other side of the ambient pressure than the case's."""
        for part in (asked, *getattr(asked, "parts", ())):
            load = None if part.at is None else trials.EvaluatedLoad.of(part.at)
            if load is not None and load.value * self.case.load.direction <= 0.0:
                side = "below" if self.case.load.direction < 0 else "above"
                raise DesignError(
                    f"{where}: {asked.title} is at {load}, but the case's pressures are {side} ambient; use one of that side"
                )

    def _at(self, value: object, where: str) -> object:
        """Return a pressure in Pa, or a `Load` of a text."""
        if not isinstance(value, str):
            return trials.read(f"{where}: at", value, "Pa", self.bare)
        try:
            (amount, unit), kind = units.number_and_unit(value), trials.PRESSURE
            if unit == "cm":
                number = amount * self.case.column.pascal
            elif unit and _is_volume(value):
                kind, number = trials.VOLUME, quantity(value, "m^3")
            else:
                number = quantity(value, "Pa")
        except units.UnitError as error:
            raise DesignError(f"{where}: at is not a pressure ({error}); write it like 177 cm or 17 kPa") from None
        if number == 0.0:
            raise DesignError(f"{where}: at {value!r} must be above zero, or below it for a vacuum")
        return trials.EvaluatedLoad(kind, number, value)

    def limit(self, entry: Mapping[str, object], side: str, asked: DesignQuantity, where: str) -> float | None:
        """Return the limit ``at_least`` or ``at_most`` in SI units; None if not given."""
        if entry.get(side) is None:
            return None
        return trials.read(f"{where}: {side} of {asked.name}", entry[side], asked.unit, self.bare)


CLEARANCES = "clearances"
"""Name of the quantity with a value per wall."""

MARGIN = "limit_margin"
"""Name of the quantity relative to the highest pressure of the problem."""


@dataclasses.dataclass(frozen=True)
class ObjectiveTerm:
    """A quantity with its weight in the objective."""

    quantity: DesignQuantity
    weight: float


@checked
@dataclasses.dataclass(frozen=True)
class Keep:
    """A limit on a design.

    Attributes:
        quantity: What is limited.
        at_least, at_most: SI units; None for no limit.
    """

    quantity: DesignQuantity
    at_least: float | None = None
    at_most: float | None = None

    def keys(self, values: Mapping[str, float]) -> list[str]:
        """Return the keys of its values: one, or one for each wall."""
        if self.quantity.key in values:
            return [self.quantity.key]
        return [key for key in values if key.startswith(self.quantity.key.removesuffix("s") + ":")]


def shown(asked: DesignQuantity) -> str:
    """Return the display unit of a quantity."""
    return str(getattr(asked, "shown_unit", "") or trials.shown_unit(asked.unit))


def in_words(asked: DesignQuantity, value: float, digits: int = 4) -> str:
    """Return a value of a quantity as text."""
    return text(value, shown(asked), asked.unit, digits)


def pressure_of(asked: DesignQuantity) -> float | None:
    """Return the pressure in Pa of a quantity; None if it has none."""
    at = asked.at
    if at is None:
        return None
    load = trials.EvaluatedLoad.of(at)
    return load.value if load.kind == trials.PRESSURE else None


def highest_pressure(asked: DesignQuantity) -> float | None:
    """Return the pressure in Pa farthest from 0 of a quantity or its components; None if it has none."""
    pressures = [pressure_of(asked), *(pressure_of(part) for part in getattr(asked, "parts", ()))]
    return max((pressure for pressure in pressures if pressure is not None), default=None, key=abs)


def label(asked: DesignQuantity, case: Case) -> str:
    """Return the label of a quantity, with its pressure as written by the user, or as a height of the column if it
    was a number."""
    pressure = pressure_of(asked)
    if pressure is None or asked.at is None:
        return asked.key
    return f"{asked.title} at {trials.EvaluatedLoad.of(asked.at).text or case.column.text(pressure, '.5g')}"


def _tuples(value: object) -> object:
    return tuple(map(_tuples, value)) if isinstance(value, list | tuple) else value


def _is_volume(value: str) -> bool:
    try:
        quantity(value, "m^3")
    except units.UnitError:
        return False
    return True


def check_limits(keep: Keep, where: str) -> None:
    """Raise `DesignError` for limits of which none is given or one is above the other, and for margins below 1."""
    asked, low, high = keep.quantity, keep.at_least, keep.at_most
    if low is None and high is None:
        raise DesignError(f"{where}: {asked.title} has no limit; give at_least, at_most or both")
    if low is not None and high is not None and low > high:
        raise DesignError(
            f"{where}: {asked.title} is to be at least {in_words(asked, low)} and at most {in_words(asked, high)}, "
            "which is impossible; exchange them"
        )
    if asked.name == MARGIN and low is not None and low < 1.0:
        raise DesignError(
            f"{where}: a limit margin of at least {low:g} is below 1, but then the device snaps through before "
            f"its working pressure; give a margin above 1, such as 1.3"
        )


def shown_factor(asked: DesignQuantity) -> float:
    """Return the SI value of a quantity's display unit."""
    return trials.factor(shown(asked), asked.unit)


# ----------------------------------------------------------------------------------------------------------------------
# The free parameters of a design, with their bounds.


MOST_CORNERS = 6
"""Maximum number of parameters for checking all 2^n corners; with more, only those next to the first and the last."""


@dataclasses.dataclass(frozen=True)
class Free:
    """A free parameter of the design, such as ``"membrane"`` or ``"profile[2]"``: its bounds and its start in the device as
    given, in an SI unit in Pint's spelling (angles in degrees), empty for pure numbers."""

    name: str
    low: float
    high: float
    start: float
    unit: str

    @property
    def width(self) -> float:
        return self.high - self.low

    def text(self, value: float, digits: int = 4) -> str:
        return text(value, trials.shown_unit(self.unit) or "1", self.unit or "1", digits)


def expanded(case: Case, name: str) -> list[str]:
    """Return the names of the continuous parameters for a name: itself, or all entries of a list; DesignError if there are
    none."""
    device, every = case.actuator, variable_names(case)
    known = [own for own in every if "." not in own]
    if name in every:
        return [name]
    if "." in name:
        raise DesignError(f"the case has no parameter {name!r}; {errors.known_are(name, [own for own in every if '.' in own])}")
    entries = [known_name for known_name in known if re.fullmatch(rf"{re.escape(name)}\[\d+\]", known_name)]
    if entries:
        return entries
    stems = list(dict.fromkeys(known_name.partition("[")[0] for known_name in known))
    base = name.partition("[")[0]
    if base in schema.about(device) and base not in stems:
        raise DesignError(f"{name} does not affect the shape of this {type(device).__name__}; {errors.known_are(name, stems)}")
    if name != base and base in stems:
        count = sum(known_name.startswith(f"{base}[") for known_name in known)
        entries_text = f"has {count} entries, counted from 1" if count else "is not a list"
        raise DesignError(f"parameter {name!r} does not exist: {base} {entries_text}")
    raise DesignError(f"{type(device).__name__} has no parameter {name!r}; {errors.known_are(name, stems)}")


def free_parameters(case: Case, table: Mapping[str, object], bare: bool = True) -> tuple[Free, ...]:
    """Return the free parameters of a case from their two bounds by name: a pair, or a table with ``from`` and ``to``.
    Numbers are taken for SI units if ``bare``. DesignError for invalid names or bounds."""
    if not table:
        example = '[parameters] membrane = { from = "1 mm", to = "3 mm" }'
        raise DesignError(f"no parameter is free; add some with bounds, such as {example}")
    free_by_name: dict[str, Free] = {}
    units = variable_names(case)
    for name, bounds in sorted(_flat(table), key=lambda item: "[" in item[0]):  # a separate entry comes after its list
        low, high = _bounds(name, bounds)
        for name_of_list in expanded(case, name):
            unit = units[name_of_list]
            least, most = (
                trials.read(f"{name_of_list} {what}", end, unit, bare) for what, end in (("from", low), ("to", high))
            )
            free_by_name[name_of_list] = Free(name_of_list, least, most, value_of(case, name_of_list), unit)
    order = {name: place for place, name in enumerate(units)}
    free = tuple(sorted(free_by_name.values(), key=lambda parameter: order[parameter.name]))
    for parameter_ in free:
        _check(case, parameter_)
    if any(parameter.name.startswith("gravity.") for parameter in free) and any(
        part.lifted and part.weighs for part in case.components
    ):
        raise DesignError("gravity cannot vary while a mass rests on a stand ([contact] with a guide and a mass); leave it out")
    lengths = [parameter.name for parameter in free if of_shape(case, parameter.name)]
    if lengths and not case.actuator.carries_interfaces:
        for part in case.components:
            if part.inside(case.actuator):
                raise DesignError(
                    f"the case has a {part.where} of a region, but the mesh of this {type(case.actuator).__name__} cannot move "
                    f"the interfaces between regions with {lengths[0]}; vary other parameters, or leave the part out"
                )
    return free


def _flat(table: Mapping[str, object], before: str = "") -> Iterator[tuple[str, object]]:
    """Yield the parameters of a table with their bounds; ``fibres.angle`` may be written as a table in a table."""
    for name, bounds in table.items():
        if (
            isinstance(bounds, Mapping)
            and bounds
            and all(isinstance(bounds_of_entry, Mapping | list | tuple) for bounds_of_entry in bounds.values())
        ):
            yield from _flat(bounds, f"{before}{name}.")
        else:
            yield f"{before}{name}", bounds


MOST_VALUES = 30
"""Largest number of values of a whole number."""


def _is_count(device: Actuator, name: str) -> bool:
    """Return whether a name is of a whole number of a device, such as of its chambers."""
    known = schema.about(device).get(name)
    return known is not None and isinstance(known.kind, schema.Choice) and known.kind.ends is not None


def _count(case: Case, name: str, bounds: object) -> tuple[int, int]:
    """Return the bounds of a whole number; DesignError if they are none, or one of its devices cannot be made."""
    low, high = _bounds(name, bounds)
    if any(isinstance(end, bool) or not isinstance(end, int) for end in (low, high)):
        raise DesignError(f"the bounds of {name} are {units.brief(low)} and {units.brief(high)}; they must be whole numbers")
    assert isinstance(low, int) and isinstance(high, int)
    if not 0 <= high - low < MOST_VALUES:
        raise DesignError(f"the bounds of {name} are {low} and {high}; they must rise, with at most {MOST_VALUES} values")
    for value in range(low, high + 1):
        try:
            dataclasses.replace(case, actuator=dataclasses.replace(case.actuator, **{name: value}))
        except entries.INPUT_ERRORS as error:
            raise DesignError(f"{name} = {value} gives an invalid device: {error}") from None
    return low, high


def _bounds(name: str, bounds: object) -> tuple[object, object]:
    if isinstance(bounds, Mapping):
        for key in bounds:
            if key not in ("from", "to"):
                raise DesignError(f"parameter {name} has an unknown entry {key!r}; a parameter has from and to")
        for key, what in (("from", "lower"), ("to", "upper")):
            if key not in bounds:
                raise DesignError(f"parameter {name} has no {what} bound; give both, as {name} = {{ from = ..., to = ... }}")
        return bounds["from"], bounds["to"]
    if isinstance(bounds, Sequence) and not isinstance(bounds, str) and len(bounds) == 2:
        return bounds[0], bounds[1]
    raise DesignError(
        f"parameter {name} has no bounds ({units.brief(bounds)}); give both, as {name} = {{ from = ..., to = ... }}"
    )


def _check(case: Case, free: Free) -> None:
    """Reject invalid bounds, one parameter at a time."""
    if free.low > free.high:
        raise DesignError(f"the bounds of {free.name} are reversed: from {free.text(free.low)} to {free.text(free.high)}")
    if free.low == free.high:
        raise DesignError(f"both bounds of {free.name} are {free.text(free.low)}; leave it out to keep it constant")
    if not free.low <= free.start <= free.high:
        raise DesignError(
            f"{free.name} starts at {free.text(free.start)}, outside {free.text(free.low)} to {free.text(free.high)}"
        )
    device = case.actuator
    movable = device.movable
    if of_shape(case, free.name) and free.name not in movable and free.name.partition("[")[0] not in movable:
        raise DesignError(device.why_not_movable(free.name))
    for end, what in ((free.low, "lower"), (free.high, "upper")):
        try:
            varied(case, {free.name: end})
        except entries.INPUT_ERRORS as error:
            raise DesignError(
                f"{free.name} gives an invalid device at its {what} bound, {free.text(end)}, with all else unchanged: {error}"
            ) from None


def crossed_corners(case: Case, free: Sequence[Free]) -> str:
    """Return a sentence if some combination of bounds gives an invalid device; else ""."""
    if len(free) <= MOST_CORNERS:
        corners = [list(ends) for ends in itertools.product(*((parameter.low, parameter.high) for parameter in free))]
    else:
        lows, highs = [parameter.low for parameter in free], [parameter.high for parameter in free]
        corners = [lows, highs]
        for k in range(len(free)):
            corners += [[*lows[:k], highs[k], *lows[k + 1 :]], [*highs[:k], lows[k], *highs[k + 1 :]]]
    refused = []
    for corner in corners:
        try:
            varied(case, {parameter.name: end for parameter, end in zip(free, corner, strict=True)})
        except entries.INPUT_ERRORS as error:
            refused.append((corner, str(error)))
    if not refused:
        return ""
    corner, why = refused[0]
    where = ", ".join(f"{parameter.name} {parameter.text(end)}" for parameter, end in zip(free, corner, strict=True))
    return (
        f"{len(refused)} of {len(corners)} combinations of bounds give an invalid device (such as {where}: {why}); "
        f"the search avoids them"
    )


def _unread(case: Case) -> str:
    """Return a sentence on the case's tolerances that a design does not propagate; "" without them."""
    left_out = [own.name.replace("_", " ") for own in case.deviations if own.name in tolerances.READINGS]
    if not left_out:
        return ""
    return f"limits hold at the pressures as requested: the tolerance of {' and '.join(left_out)} is not in them"


# ----------------------------------------------------------------------------------------------------------------------
# First-order propagation of fabrication tolerances and material errors to a value.


ONE_SIDED_95 = 1.645
"""One-sided 95 % quantile of the normal distribution."""


def spreads_of(case: Case, tolerance: Mapping[str, object] | None, bare: bool) -> dict[str, float]:
    """Return the standard deviations in SI units by parameter, of a table of tolerances, or of the case's own without one;
    DesignError for an unknown parameter, or no tolerance."""
    table = {} if tolerance is None else dict(_table(tolerance, "tolerance"))
    process = table.pop(tolerances.PROCESS, None)
    made = case.deviations if tolerance is None else []
    if process is not None:
        made = tolerances.Tolerances.of({tolerances.PROCESS: process}).deviations(case.actuator, case.column.pascal)
    spreads = {own.name: own.half / units.HALF_WIDTH_95 for own in made if own.name not in tolerances.READINGS}
    device, names = case.actuator, variable_names(case)
    for name, value in trials.dotted(table):
        for name_of_list in expanded(case, name):
            what = f"tolerance of {name_of_list}"
            share = tolerances.percentage(name_of_list, value) if isinstance(value, str) else None
            if share is None:
                half = trials.read(what, value, names[name_of_list], bare)
            else:
                half = share * abs(value_of(case, name_of_list))
            if half <= 0.0:
                raise DesignError(f"{what} is {value}; half the width of a 95 % interval must be above zero")
            movable = name_of_list.partition("[")[0] in device.movable or name_of_list in device.movable
            if of_shape(case, name_of_list) and not movable:
                raise DesignError(f"{what}: {device.why_not_movable(name_of_list)}")
            spreads[name_of_list] = half / units.HALF_WIDTH_95
    return spreads


class ToleranceSpread:
    """Standard deviations of the quantities of a design, from those of parameters in SI units and errors of the material, if
    given; gradients are by ``names``."""

    def __init__(self, names: Sequence[str], spreads: Mapping[str, float], errors: materials.MaterialErrors | None):
        self.errors = errors
        self.spreads = np.array([spreads.get(name, 0.0) for name in names])

    @property
    def any(self) -> bool:
        return bool(self.spreads.any()) or self.errors is not None

    def sigma(self, trial: Trial, key: str) -> float:
        """Return the standard deviation of a value in its SI unit, to first order; 0 without scatter."""
        variance = 0.0
        if key in trial.gradients:
            variance += float(np.sum((np.asarray(trial.gradients[key]) * self.spreads) ** 2))
        errors = self.errors
        if errors is not None and key in trial.material_gradients:
            slope = np.array([trial.material_gradients[key].get(name, 0.0) for name in errors.names])
            variance += float(slope @ errors.matrix @ slope)
        return float(np.sqrt(max(variance, 0.0)))


# ----------------------------------------------------------------------------------------------------------------------
# Options of an optimisation.


MAX_EVALUATIONS = 40


class DesignEvaluator(Protocol):
    """Interface of an evaluator: `softmodels.design.model.DesignModel`, or a substitute."""

    def evaluate(self, theta: npt.NDArray[np.float64]) -> trials.Evaluation:
        """Return the values and gradients; raise `DesignFailure` if there are none."""

    def confirm(self, theta: npt.NDArray[np.float64], finer: float = 1.0) -> trials.Evaluation:
        """Return the values on a fresh mesh."""

    def release(self) -> None:
        """Release its resources; the next design is meshed anew."""


class SearchOptions(TypedDict, total=False):
    """Options of an optimisation; none changes a design's values.

    The first start is the device as given, the others are spread over the bounds by a seed; each has a most of evaluations.
    ``resume`` goes on from the trials in the folder, ``progress`` gets a line for each design, ``stopped`` is asked between
    evaluations, ``confirm`` (the default) solves the best design's whole path on a fresh mesh, ``finer`` by a factor. Files
    of ``inputs`` are never written. ``model`` makes what evaluates designs from a problem and a communicator; `DesignModel`
    unless given.
    """

    starts: int
    evaluations: int
    seed: int
    resume: bool
    progress: Callable[[str], object]
    stopped: Callable[[], bool]
    confirm: bool
    finer: float
    inputs: Sequence[Path]
    model: Callable[[DesignProblem, MPI.Comm], DesignEvaluator] | None


# ----------------------------------------------------------------------------------------------------------------------
# Scaled design problem: parameters from 0 to 1, quantities relative to their limits, constraints c <= 0.


MIN_VIOLATION_SCALE = 0.01
"""Minimum scale of a length's violation, relative to the device's size, if its limit is 0."""
LIMIT_TOLERANCE = 1e-9
"""Relative tolerance of a limit, for rounding."""
SAFETY_MARGIN = 2e-4
"""Relative safety margin to a limit in the search, so that its end satisfies the limit."""


@dataclasses.dataclass(frozen=True)
class ConstraintRow:
    """One limit on the value of a key, in its SI unit, as is the scale that a violation is counted in. The sign is 1 for at
    most, -1 for at least; ``words`` say what is limited, with its pressure."""

    keep: Keep
    key: str
    sign: float
    limit: float
    scale: float
    words: str

    @property
    def text(self) -> str:
        """The limit in words."""
        return f"{self.words} {'at most' if self.sign > 0 else 'at least'} {in_words(self.keep.quantity, self.limit)}"

    def compared(self, value: float, violation: float) -> str:
        """Return a value in SI units compared with the limit, such as ``limit margin 1.249 < 1.25``, with enough digits to
        distinguish them. The violation, in the limit's scale and below zero where it is kept, is judged with an allowance for
        tolerances and for other meshes, which is added where only the value would not show it."""
        asked = self.keep.quantity
        judged = self.limit + self.sign * violation * self.scale
        for digits in range(4, 10):
            limit, near = in_words(asked, self.limit, digits), in_words(asked, judged, digits)
            if limit != near or violation == 0.0:
                break
        above = judged > self.limit if limit != near else self.sign < 0
        sign = (">" if above else "<") if violation > 0.0 else (">=" if self.sign < 0 else "<=")
        told = in_words(asked, value, digits)
        if abs(judged - value) <= 1e-9 * self.scale or told == near:
            return f"{self.words} {near} {sign} {limit}"
        return f"{self.words} {told}, {near} with its allowance, {sign} {limit}"


@dataclasses.dataclass(frozen=True)
class Scaled:
    """A scaled design: objective f, constraints c <= 0, and their gradients by the scaled parameters."""

    f: float
    df: Array
    c: Array
    dc: Array
    fresh: bool = False
    """Whether its mesh differs from that of the designs before."""


class Formulation:
    """A problem, scaled by a first trial that could be judged: its objective is the scale of all objectives."""

    def __init__(self, problem: DesignProblem, first: Trial):
        self.problem, self.first = problem, first
        self.corrections: dict[str, tuple[float, float]] = {}
        self.safety: Array | float = 0.0
        self.spread = ToleranceSpread(problem.names, problem.spreads, problem.errors)
        self.low = np.array([free.low for free in problem.free])
        self.width = np.array([free.width for free in problem.free])
        self.rest = np.array([value_of(problem.case, name) for name in problem.names[len(problem.free) :]])
        self.rows = [row for keep in problem.limits for row in self._rows(keep, first.values)]
        slopes = np.abs(self._slope(first)) * self.width
        self.size = max(abs(self.objective(first)), float(slopes.max(initial=0.0)), 1e-300)

    def _rows(self, keep: Keep, values: Mapping[str, float]) -> list[ConstraintRow]:
        rows = []
        floor = MIN_VIOLATION_SCALE * self.problem.case.actuator.size if keep.quantity.unit == "m" else 0.0
        for key in keep.keys(values):
            words = label(keep.quantity, self.problem.case) if key == keep.quantity.key else key
            for sign, limit in ((-1.0, keep.at_least), (1.0, keep.at_most)):
                if limit is not None:
                    scale = abs(limit) or max(abs(values[key]), floor) or 1.0
                    rows.append(ConstraintRow(keep, key, sign, limit, scale, words))
        return rows

    # -- between scaled and SI ------------------------------------------------------------------------------------------

    def theta(self, x: Array) -> Array:
        """Return the values of the problem's `names` in SI units of scaled parameters."""
        ends = np.where(x >= 1.0, self.low + self.width, self.low + x * self.width)
        return np.concatenate([np.where(x <= 0.0, self.low, ends), self.rest])

    def x(self, theta: Array) -> Array:
        """Return the reverse."""
        return np.asarray((theta[: len(self.low)] - self.low) / self.width)

    # -- objective and limits of a trial
    # --------------------------------------------------------------------------------------------

    def objective(self, trial: Trial) -> float:
        """Return the objective in its SI unit."""
        return sum(term.weight * trial.values[term.quantity.key] for term in self.problem.terms)

    def _slope(self, trial: Trial) -> Array:
        """Return its gradient by the free parameters."""
        parts = [term.weight * self._gradient(trial, term.quantity.key) for term in self.problem.terms]
        return np.asarray(np.sum(parts, axis=0))

    def _gradient(self, trial: Trial, key: str) -> Array:
        """Return a value's gradient by the free parameters; empty where only whole numbers are free."""
        return np.asarray(trial.gradients.get(key, ()), dtype=float)[: len(self.problem.free)]

    def allowances(self, trial: Trial) -> Array:
        """Return the 95 % allowances of each limit for tolerances and the material's errors, SI units, shape (rows,)."""
        return np.array([ONE_SIDED_95 * self.spread.sigma(trial, row.key) for row in self.rows])

    def violations(self, trial: Trial, allowances: Array | None = None) -> Array:
        """Return the violation of each limit, in its scale; negative if satisfied. Shape (rows,)."""
        taken = self.allowances(trial) if allowances is None else allowances
        values = {}
        for row in self.rows:
            factor, shift = self.corrections.get(row.key, (1.0, 0.0))
            values[row.key] = factor * trial.values[row.key] + shift
        return self.passed(values, taken) + self.safety

    def passed(self, values: Mapping[str, float], allowances: Array) -> Array:
        """Return the violation of each limit by given values, in its scale; shape (rows,)."""
        return np.array(
            [
                (row.sign * (values[row.key] - row.limit) + allowance) / row.scale
                for row, allowance in zip(self.rows, allowances, strict=True)
            ]
        )

    def corrected(self, trial: Trial, confirmed: Mapping[str, float], safety: Array) -> Formulation:
        """Return the same with limits corrected to a fresh mesh, by the ratio known for one trial, whose values there are
        confirmed, and by a further share for safety, shape (rows,).

        Where the limit is 0, such as on a gap, they differ by the same amount, since a factor would leave it where it is.
        """
        made = Formulation(self.problem, self.first)
        made.safety = safety
        for row in self.rows:
            here, there = trial.values[row.key], confirmed[row.key]
            if not row.limit:
                made.corrections[row.key] = 1.0, there - here
            elif here and there / here > 0.0:
                made.corrections[row.key] = there / here, 0.0
        return made

    def worst(self, trial: Trial) -> tuple[float, ConstraintRow | None]:
        """Return the largest violation and its limit."""
        if not self.rows:
            return 0.0, None
        violations = self.violations(trial)
        k = int(np.argmax(violations))
        return float(violations[k]), self.rows[k]

    def feasible(self, trial: Trial) -> bool:
        """Return whether it was evaluated and satisfies every limit."""
        return not trial.failed and self.worst(trial)[0] <= LIMIT_TOLERANCE

    def scaled(self, trial: Trial, allowances: Array, fresh: bool = False) -> Scaled:
        """Return the scaled design with fixed allowances, without the derivative of a standard deviation."""
        count = len(self.problem.free)
        slopes = [row.sign / row.scale * self._gradient(trial, row.key) * self.width for row in self.rows]
        sign = self.problem.sign / self.size
        return Scaled(
            sign * self.objective(trial), sign * self._slope(trial) * self.width,
            self.violations(trial, allowances) + SAFETY_MARGIN, np.array(slopes).reshape(len(self.rows), count),
            fresh,
        )  # fmt: skip

    def best(self, trials: Sequence[Trial]) -> Trial | None:
        """Return the best of some trials: a feasible one by the objective, else that with the smallest violation; None if none
        could be evaluated."""

        def order(trial: Trial) -> tuple[bool, float]:
            if self.feasible(trial):
                return False, self.problem.sign * self.objective(trial)
            return True, self.worst(trial)[0]

        return min((trial for trial in trials if not trial.failed), key=order, default=None)


# ----------------------------------------------------------------------------------------------------------------------
# Requested quantities of a design, and their values.


@dataclasses.dataclass(frozen=True)
class EvaluatedQuantity:
    """A quantity of a design in its SI unit, its gradient by the parameters, shape (n,), empty if none was asked for, and its
    derivatives by the material's numbers."""

    value: float
    gradient: Array
    by_material: dict[str, float]
    squares: trials.Squares | None = None
    """Residuals of a target."""

    def times(self, factor: float) -> EvaluatedQuantity:
        """Return the quantity times a number."""
        by_material = {name: factor * rate for name, rate in self.by_material.items()}
        return EvaluatedQuantity(factor * self.value, factor * self.gradient, by_material)


@dataclasses.dataclass(frozen=True)
class EvaluationRequest:
    """Quantities (each of one state at most) requested of a design, by the names of the free parameters, those of them that
    decide the shape, and numbers of the material. A limit point is looked for up to a ``highest`` pressure in Pa; 0 for
    none."""

    names: tuple[str, ...]
    parts: tuple[DesignQuantity, ...]
    loads: tuple[trials.EvaluatedLoad, ...]
    highest: float
    materials: tuple[str, ...]
    shape: tuple[str, ...] = ()

    @property
    def working(self) -> float:
        """The pressure in Pa farthest from 0 at which the device is evaluated; 0 for none."""
        return max((load.value for load in self.loads if load.kind == trials.PRESSURE), default=0.0, key=abs)
