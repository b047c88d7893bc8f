"""The design problem: a device, what may change of it, what it should do, and what it must never do."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

from measurement.arguments import checked, place
from measurement.toml_file import TomlError, parse_toml, read_toml
from measurement.units import brief
from measurement.wording import known_are
from softmodels.case.case import Case
from softmodels.case.errors import INPUT_ERRORS
from softmodels.case.material_errors import MaterialErrors
from softmodels.design.asked import (
    CLEARANCES,
    MARGIN,
    Asked,
    Keep,
    Reader,
    Term,
    check_limits,
    highest_pressure,
    in_words,
)
from softmodels.design.errors import DesignError
from softmodels.design.free import Free, crossed_corners, free_parameters
from softmodels.design.loads import Load
from softmodels.design.quantities.base import Quantity
from softmodels.design.quantities.gaps import LeastGap
from softmodels.design.tolerances import tolerances_of
from softmodels.design.units import read
from softmodels.mechanics.walls.part import Walls

OBJECTIVES = {"maximise": -1.0, "minimise": 1.0, "follow": 1.0}
"""What can be asked for, with the sign under which it is minimised."""
TABLES = ("name", "case", "parameters", *OBJECTIVES, "keep", "tolerances", "material_errors")
LIMITS = ("at_least", "at_most")
ROOM = 1.15
"""How far above the limit pressure that is asked for a limit point is looked for: where it lies farther, it is no limit."""


@checked
@dataclasses.dataclass(frozen=True, eq=False)
class DesignProblem:
    """A design problem. Numbers are in SI units, texts carry a unit.

    Attributes:
        case: The device at the start with its material, or a case file; its last pressure is the highest that is asked at.
        parameters: Free parameters with their bounds: ``{"membrane": ("1 mm", "3 mm")}``. A list's name stands for all of its
            entries.
        maximise, minimise, follow: One of these: a quantity of `softmodels.design.quantities`, or a table that names one, such
            as ``{"quantity": "rise", "of": "tip", "at": "177 cm"}``. Several pressures make a mean, with optional ``weights``.
        keep: What must hold: `Keep`, or tables with a quantity and ``at_least``, ``at_most`` or both. Where walls of the device
            can meet, ``least_gap`` has to be at least 0 at every state that is asked for, unless it is limited here.
        tolerances: Standard deviations of fabrication by parameter; with them limits hold with 95 %.
        material_errors: A fitted material (``fitted.toml`` of `softmodels fit`), whose errors count likewise.
        name: Of the results; the case's if empty.
        folder: From which files are counted; None for the current one.

    Raises:
        DesignError: From the constructor, in one sentence.
    """

    case: Case
    parameters: Mapping[str, object]
    maximise: Quantity | Mapping[str, object] | None = None
    minimise: Quantity | Mapping[str, object] | None = None
    follow: Quantity | Mapping[str, object] | None = None
    keep: Sequence[Keep | Mapping[str, object]] = ()
    tolerances: Mapping[str, object] | None = None
    material_errors: object = None
    name: str = ""
    folder: Path | None = dataclasses.field(default=None, repr=False)
    bare: bool = dataclasses.field(default=True, repr=False)
    written: Mapping[str, object] = dataclasses.field(default_factory=dict, repr=False)
    """The case's tables as its file has them; empty of a case from Python."""
    free: tuple[Free, ...] = dataclasses.field(init=False, default=())
    terms: tuple[Term, ...] = dataclasses.field(init=False, default=())
    objective: str = dataclasses.field(init=False, default="")
    limits: tuple[Keep, ...] = dataclasses.field(init=False, default=())
    spreads: Mapping[str, float] = dataclasses.field(init=False, default_factory=dict)
    errors: MaterialErrors | None = dataclasses.field(init=False, default=None)
    notes: tuple[str, ...] = dataclasses.field(init=False, default=())

    def __post_init__(self) -> None:
        try:
            self._settle()
        except INPUT_ERRORS as error:
            raise DesignError(str(error)) from None

    def _settle(self) -> None:
        if not isinstance(self.name, str):
            raise DesignError(f"name is {brief(self.name)}; it must be a text that can name files")
        if self.folder is not None:
            object.__setattr__(self, "folder", place("folder", self.folder, "a folder"))
        case = self.case
        if not isinstance(case, Case):
            file = _place(case, self.folder)
            case = Case.from_file(file)
            object.__setattr__(self, "written", read_toml(file))
        _check_load(case)
        reader = Reader(case, _registry(), self.bare, self.folder)
        free = free_parameters(case.actuator, _table(self.parameters, "parameters"), self.bare)
        objective, terms = self._objective(reader)
        errors = _errors(self.material_errors, case, self.folder)
        deviations = {} if self.tolerances is None else self.tolerances
        limits = [keep for k, entry in enumerate(_list(self.keep), 1) for keep in _keeps(reader, entry, f"keep {k}")]
        settled: dict[str, object] = {
            "case": case, "free": free, "objective": objective, "terms": terms,
            "limits": (*limits, *_walls_apart(case, terms, limits)),
            "spreads": tolerances_of(case.actuator, _table(deviations, "tolerances"), self.bare),
            "errors": errors, "name": self.name or case.name,
            "notes": tuple(filter(None, [crossed_corners(case.actuator, free)])),
        }  # fmt: skip
        for name, value in settled.items():
            object.__setattr__(self, name, value)
        dataclasses.replace(case, name=self.name)  # a name that can name files
        for keep in self.limits:
            _check_walls(case, keep)
        if not self.working and any(one.name == MARGIN for one in self.quantities):
            raise DesignError(
                f"{MARGIN} is over the highest pressure that is asked at, and nothing is asked at a pressure"
            )

    def _objective(self, reader: Reader) -> tuple[str, tuple[Term, ...]]:
        given = [name for name in OBJECTIVES if getattr(self, name) is not None]
        if not given:
            raise DesignError(f"nothing is asked for; give one of {', '.join(OBJECTIVES)}")
        if len(given) > 1:
            raise DesignError(
                f"{' and '.join(given)} are two objectives; give one of them, and a limit (keep) for the other"
            )
        entry = getattr(self, given[0])
        found = reader.quantities(entry, given[0], ("weights",))
        if isinstance(entry, Mapping) and entry.get("quantity") == CLEARANCES:
            raise DesignError(
                f"{given[0]}: {CLEARANCES} are many values; keep them at least as thick as the workshop needs"
            )
        weights = entry.get("weights") if isinstance(entry, Mapping) else None
        weights = [1.0] * len(found) if weights is None else [read("a weight", w, "1") for w in _list(weights)]
        if len(weights) != len(found) or min(weights) < 0.0 or sum(weights) <= 0.0:
            raise DesignError(
                f"{given[0]}: {len(weights)} weights for {len(found)} pressures; give one above zero for each, or none"
            )
        return given[0], tuple(Term(one, w / sum(weights)) for one, w in zip(found, weights, strict=True))

    @property
    def sign(self) -> float:
        """-1 where more is better."""
        return OBJECTIVES[self.objective]

    @property
    def names(self) -> tuple[str, ...]:
        """Parameters that gradients are needed by: the free ones, then those that only have a tolerance."""
        free = [one.name for one in self.free]
        return (*free, *(name for name in self.spreads if name not in free))

    @property
    def highest(self) -> float | None:
        """Pressure in Pa up to which a limit point is looked for: well above what is asked of it; None for the usual."""
        kept = {
            MARGIN: self.working,
            "limit_pressure": 1.0,
            "bifurcation_margin": self.working,
            "bifurcation_pressure": 1.0,
        }
        if any(term.quantity.name in kept for term in self.terms):
            return None
        most = [
            (keep.at_most or keep.at_least or 0.0) * kept[keep.quantity.name]
            for keep in self.limits
            if keep.quantity.name in kept
        ]
        return ROOM * max(*most, self.working) if most else None

    @property
    def working(self) -> float:
        """The highest pressure in Pa at which anything is asked; 0 for none."""
        return max((highest_pressure(one) or 0.0 for one in self.quantities), default=0.0)

    @property
    def quantities(self) -> list[Asked]:
        """All quantities, each once."""
        found = {
            one.key: one for one in (*(term.quantity for term in self.terms), *(keep.quantity for keep in self.limits))
        }
        return list(found.values())

    @classmethod
    def from_toml(cls, text: str, folder: Path | None = None) -> DesignProblem:
        """Read a problem file; files in it are counted from ``folder``.

        Raises:
            DesignError: Not TOML, unknown entries, or a problem that cannot be meant.
        """
        try:
            return cls._from_tables(parse_toml(text), folder)
        except TomlError as error:
            raise DesignError(f"the problem {error}") from None

    @classmethod
    def from_file(cls, path: Path | str) -> DesignProblem:
        """Read a problem file; the messages name it."""
        path = Path(path)
        try:
            return cls._from_tables(read_toml(path), path.parent)
        except TomlError as error:
            raise DesignError(f"problem file {path} {error}") from None
        except DesignError as error:
            raise DesignError(f"{path}: {error}") from None

    @classmethod
    def _from_tables(cls, tables: dict[str, object], folder: Path | None) -> DesignProblem:
        for key in tables:
            if key not in TABLES:
                raise DesignError(f"the problem has an unknown entry {key!r}; {known_are(key, TABLES)}")
        if "case" not in tables:
            raise DesignError('the problem has no case; give a case file, case = "slab.toml", or a [case] table')
        values = {key: value for key, value in tables.items() if key != "case"}
        case = tables["case"]
        try:
            written = case if isinstance(case, dict) else {}
            if isinstance(case, dict):
                case = Case._from_tables(dict(case), folder)
            return cls(**{"parameters": {}, **values}, case=case, folder=folder, bare=False, written=written)  # type: ignore[arg-type]
        except INPUT_ERRORS as error:
            raise DesignError(str(error)) from None


def _registry() -> Mapping[str, type]:
    from softmodels.design.quantities import QUANTITIES

    return QUANTITIES


def _place(case: object, folder: Path | None) -> Path:
    if not isinstance(case, str | Path):
        raise DesignError(f"case is {brief(case)}; it must be a case, a case file or a [case] table")
    return (folder or Path()) / case


def _table(value: object, what: str) -> Mapping[str, object]:
    if not isinstance(value, Mapping):
        raise DesignError(f"{what} is {brief(value)}; it must be a table, which begins with a line [{what}]")
    return value


def _list(value: object) -> Sequence[object]:
    if isinstance(value, list | tuple):
        return value
    if isinstance(value, Keep):
        return [value]
    raise DesignError(f"{brief(value)} is no list; each limit begins with a line [[keep]]")


def _errors(given: object, case: Case, folder: Path | None) -> MaterialErrors | None:
    """The errors of the case's material: as they are, or a fitted material's file."""
    if given is None:
        return None
    if isinstance(given, Mapping) and set(given) == {"file"}:
        given = given["file"]
    if isinstance(given, str | Path):
        given = MaterialErrors.from_file((folder or Path()) / given)
    if not isinstance(given, MaterialErrors):
        raise DesignError(
            f'material_errors is {brief(given)}; give a fitted material, file = "results/fit/fitted.toml"'
        )
    given.check(case.material)
    return given


def _check_load(case: Case) -> None:
    """Refuse loads that a design cannot be judged under."""
    if not case.pressures_cm:
        raise DesignError(
            f"the case asks for {case.load.requested.words}; a design is judged at pressures (pressure_cm)"
        )
    if case.cycle:
        raise DesignError(
            "the case lowers its pressure again (cycle); a design is judged on the way up, so leave it out"
        )
    for part in case.parts:
        if why := part.undesigned(case.actuator):
            raise DesignError(f"the case has a {part.where}, {why}; leave it out")
    if case.obstacle is not None:
        raise DesignError("the case has a rigid plane to rest on, and gradients do not know contact; leave it out")


def _keeps(reader: Reader, entry: object, where: str) -> list[Keep]:
    if isinstance(entry, Keep):
        sides = {side: getattr(entry, side) for side in LIMITS}
        found = [
            Keep(one, *(reader.limit(sides, side, one, where) for side in LIMITS))
            for one in reader.quantities(entry.quantity, where)
        ]
    else:
        table = _table(entry, where)
        found = [
            Keep(one, *(reader.limit(table, side, one, where) for side in LIMITS))
            for one in reader.quantities(table, where, LIMITS)
        ]
    for keep in found:
        check_limits(keep, where)
    return found


def _walls_apart(case: Case, terms: Sequence[Term], limits: Sequence[Keep]) -> list[Keep]:
    """Limits that keep walls apart at every state where anything is asked of a device whose walls can meet.

    None where the case lets walls pass through each other (walls = "none"), or limits the gap itself.
    """
    given = [keep.quantity for keep in limits]
    if not any(isinstance(part, Walls) and part.automatic for part in case.parts) or any(
        isinstance(one, LeastGap) for one in given
    ):
        return []
    asked = [one for whole in (*(term.quantity for term in terms), *given) for one in getattr(whole, "parts", (whole,))]
    loads = sorted({load for one in asked if isinstance(load := getattr(one, "load", None), Load)})
    return [Keep(LeastGap(at=load), at_least=0.0) for load in loads]


def _check_walls(case: Case, keep: Keep) -> None:
    """Refuse a least wall that the device as given does not have."""
    if keep.quantity.name != CLEARANCES or keep.at_least is None:
        return
    for wall, value in case.actuator.clearances.items():
        if value < keep.at_least:
            raise DesignError(
                f"the workshop's least wall is {in_words(keep.quantity, keep.at_least)}, and at the start {wall} is "
                f"{in_words(keep.quantity, value)}; start from a device that can be made"
            )
