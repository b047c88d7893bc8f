"""Workshop settings of a mould: printer, walls, pins and holes."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from geometries import Actuator, registry
from softmodels.case.case import Case, with_changes
from softmodels.case.entries import CaseError
from softmodels.common import errors, schema, units
from softmodels.common.arrays import triple
from softmodels.common.names import checked
from softmodels.common.tables import TomlError, read_toml
from softmodels.components.fibres import Fibres
from softmodels.materials import silicones
from softmodels.mechanics import component


@checked
@dataclasses.dataclass(frozen=True, kw_only=True)
class Workshop:
    """Settings of a mould, lengths in m, angles in degrees; `MouldError` if no mould can be made so."""

    wall: float = schema.length_field(0.005, "thickness of the mould's floors and lids")
    rim: float = schema.length_field(0.008, "rim of the mould around the part, which holds the pins")
    draft: float = schema.angle_field(1.0, "draft angle of pins, sockets, pour opening, vents and an upright inlet")
    shrinkage: float = schema.number_field(
        0.0, "linear shrinkage of the silicone during cure, 0.001 for 0.1 %; the mould is enlarged by it"
    )
    clearance: float = schema.length_field(0.00015, "gap between a pin and its socket", zero=True)
    least_wall: float = schema.length_field(0.0005, "smallest wall or rib of the printer")
    least_gap: float = schema.length_field(0.0005, "smallest gap or hole of the printer")
    pin: float = schema.length_field(0.004, "diameter of the alignment pins at their root")
    pour: float = schema.length_field(0.0025, "diameter of the pour opening where it meets the silicone")
    vent: float = schema.length_field(0.001, "diameter of the vents where they meet the silicone")
    vents: int = schema.choice_field(3, tuple(range(1, 13)), "number of vents of each half")
    tube: float = schema.length_field(
        0.002, "outer diameter of the tube into the cavity, or of the barb; 0 for no inlet", zero=True
    )
    inlet: str = schema.choice_field(
        "tube", ("tube", "barb", "luer"),
        "hole for the tube itself, 0.8 of it to grip a barb, or the cone of a male Luer slip (ISO 80369-7)",
    )  # fmt: skip
    core: str = schema.choice_field(
        "as needed", ("as needed", "rigid", "lost", "wax"),
        "cores that are pulled; lost, which are printed to be dissolved; or wax, cast in moulds of their own to be melted out",
    )  # fmt: skip
    wax_shrinkage: float = schema.number_field(
        0.0, "linear shrinkage of a wax core as it sets, 0.01 for 1 %; its mould is enlarged by it"
    )
    thread: float = schema.length_field(
        0.0, "diameter of the thread around a tube; grooves as wide and half as deep hold it; 0 for none", zero=True
    )
    spacing: float = schema.length_field(0.004, "distance along the tube of neighbouring threads, at most about")
    lay: str = schema.text_field(
        "", "angles of the threads from the tube's axis, such as '75 deg, -75 deg'; default: those of the case's fibres"
    )
    bolt: float = schema.length_field(0.0034, "diameter of the bolts' holes; 0 for clamps only", zero=True)
    bed_width: float = schema.length_field(0.192, "width of the printer's plate")
    bed_depth: float = schema.length_field(0.120, "depth of the printer's plate")
    layer: float = schema.length_field(0.00005, "thickness of a printed layer")
    layer_time: float = schema.field_of(schema.Quantity("s"), "time that the printer takes for a layer", 8.0)
    chord: float = schema.length_field(0.00002, "largest distance of the STL from the exact surface")
    surplus: float = schema.number_field(0.15, "surplus of mixed silicone, for sprues and the mixing cup, 0.15 for 15 %")
    pull: str = schema.text_field("", "direction in which the mould of an imported part opens, such as '0, 0, 1'")
    split: str = schema.text_field(
        "", "position of the parting plane along the pull, such as '2 mm'; default: the middle of the cavities"
    )

    def __post_init__(self) -> None:
        schema.settle(self, MouldError)
        self._check_shares()
        self._check_pins()
        self._check_printer()
        _ = self.direction, self.level, self.angles

    def _check_shares(self) -> None:
        if not 0.0 <= self.draft <= MAX_DRAFT:
            raise MouldError(f"draft is {schema.shown(self.draft, 'degree')}; it must be between 0 and {MAX_DRAFT:g} deg")
        for name, what in (("shrinkage", "silicones shrink"), ("wax_shrinkage", "waxes shrink")):
            if not 0.0 <= (value := getattr(self, name)) <= MOST_SHRINKAGE:
                raise MouldError(f"{name} is {value:g}; {what} by 0 to {MOST_SHRINKAGE:g} of each length (0.001 is 0.1 %)")
        if not 0.0 <= self.surplus <= 5.0:
            raise MouldError(f"surplus is {self.surplus:g}; it must be between 0 and 5 (0.15 is 15 %)")
        if self.chord < FINEST_CHORD:
            raise MouldError(f"chord is {schema.shown(self.chord, 'm')}; it must be at least {schema.shown(FINEST_CHORD, 'm')}")

    def _check_pins(self) -> None:
        left = self.wall - self.pin_length - self.clearance
        if left < self.least_wall:
            raise MouldError(
                f"wall is {schema.shown(self.wall, 'm')}; its sockets, {schema.shown(self.pin_length + self.clearance, 'm')} "
                f"deep, leave {schema.shown(max(left, 0.0), 'm')} but the printer's smallest wall is "
                f"{schema.shown(self.least_wall, 'm')} (least_wall)"
            )
        if self.rim < self.pin + 2.0 * (self.clearance + self.least_wall):
            raise MouldError(
                f"rim is {schema.shown(self.rim, 'm')}; a pin of {schema.shown(self.pin, 'm')} with walls of "
                f"{schema.shown(self.least_wall, 'm')} "
                f"on both sides needs {schema.shown(self.pin + 2.0 * (self.clearance + self.least_wall), 'm')}"
            )
        if self.bolt and self.rim < self.bolt + 2.0 * self.least_wall:
            raise MouldError(
                f"bolt is {schema.shown(self.bolt, 'm')}; in a rim of {schema.shown(self.rim, 'm')} it leaves walls thinner "
                f"than the printer's {schema.shown(self.least_wall, 'm')} (least_wall); 0 omits the holes"
            )
        if self.tip(self.pin, self.pin_length) < self.least_wall:
            raise MouldError(
                f"draft is {schema.shown(self.draft, 'degree')}; it leaves a pin of {schema.shown(self.pin, 'm')} a tip of "
                f"{schema.shown(max(self.tip(self.pin, self.pin_length), 0.0), 'm')}, but the printer's smallest rib is "
                f"{schema.shown(self.least_wall, 'm')} (least_wall)"
            )

    def _check_printer(self) -> None:
        for name in ("vent", "pour"):
            if getattr(self, name) < self.least_gap:
                raise MouldError(
                    f"{name} is {schema.shown(getattr(self, name), 'm')}; the printer's smallest hole is "
                    f"{schema.shown(self.least_gap, 'm')} (least_gap)"
                )
        if self.pour < self.vent:
            raise MouldError(
                f"pour is {schema.shown(self.pour, 'm')} and vent {schema.shown(self.vent, 'm')}; the pour opening "
                "must be wider"
            )
        if self.tube and self.inlet_width < self.least_wall:
            raise MouldError(
                f"tube is {schema.shown(self.tube, 'm')}; its core is thinner than the printer's "
                f"{schema.shown(self.least_wall, 'm')} (least_wall); 0 omits the inlet"
            )
        if self.layer_time <= 0.0:
            raise MouldError(f"layer_time is {schema.shown(self.layer_time, 's')}; it must be larger than 0")
        if self.chord > 0.25 * self.least_gap:
            raise MouldError(
                f"chord is {schema.shown(self.chord, 'm')}; it must be at most a quarter of the printer's gap, "
                f"{schema.shown(0.25 * self.least_gap, 'm')}"
            )

    @property
    def pin_length(self) -> float:
        """Height of a pin, m."""
        return PIN_LENGTH * self.wall

    @property
    def inlet_width(self) -> float:
        """Diameter of the inlet's core in m, at the cavity."""
        return {"tube": self.tube, "barb": BARB_HOLE_RATIO * self.tube, "luer": LUER_DIAMETER}[self.inlet]

    @property
    def slope(self) -> float:
        """Draft per length."""
        return math.tan(math.radians(self.draft))

    def tip(self, diameter: float, length: float) -> float:
        """Return the diameter at the end of a core with draft, m."""
        return diameter - 2.0 * length * self.slope

    @property
    def scale(self) -> float:
        """Length in the mould over length in the device."""
        return 1.0 / (1.0 - self.shrinkage)

    @property
    def direction(self) -> tuple[float, float, float] | None:
        """The given pull as a unit vector; None if not given."""
        if not self.pull.strip():
            return None
        parts = self.pull.replace(",", " ").split()
        try:
            vector = np.array([float(part) for part in parts])
        except ValueError:
            vector = np.zeros(0)
        if len(vector) != 3 or not np.isfinite(vector).all():
            raise MouldError(f"pull is {self.pull!r}; a direction is three numbers, such as '0, 0, 1'")
        length = float(np.linalg.norm(vector))
        if not 1e-9 < length < 1e9:
            raise MouldError(f"pull is {self.pull!r}; its length must not be zero")
        return triple(vector / length)

    @property
    def angles(self) -> tuple[float, ...]:
        """The given angles of threads from the axis in degrees; empty if not given."""
        try:
            return tuple(float(units.quantity(text, "degree")) for text in self.lay.split(",") if text.strip())
        except units.UnitError as error:
            raise MouldError(f"lay: {error}") from None

    @property
    def level(self) -> float | None:
        """The given height of the parting plane along the pull in m; None if not given."""
        if not self.split.strip():
            return None
        try:
            return float(units.quantity(self.split, "m"))
        except units.UnitError as error:
            raise MouldError(f"split: {error}") from None


MAX_DRAFT = 15.0
MOST_SHRINKAGE = 0.05
"""Largest accepted shrinkage: addition-cure silicones shrink by less than 0.01, condensation-cure by up to 0.02."""
PIN_LENGTH = 0.6
"""Length of a pin relative to the wall of its socket."""
BARB_HOLE_RATIO = 0.8
"""Diameter of the hole for a barb over the barb's."""
LUER_DIAMETER = 0.00397
"""Diameter of a male Luer slip at its tip, m (ISO 80369-7: 3.925 to 4.027 mm)."""
FINEST_CHORD = 2e-6
"""Smallest accepted chord error in m, finer than any printer."""


def length_text(value: float) -> str:
    """Return a length in m to three digits, with a unit."""
    return schema.shown(float(f"{value:.3g}"), "m")


class MouldError(errors.OptionMessage, ValueError):
    """The requested mould cannot be made; the message is for the user."""


# ----------------------------------------------------------------------------------------------------------------------
# Input of a mould: a device, its silicone by name, workshop settings; from Python, or from a case file.


@dataclasses.dataclass(frozen=True)
class MouldRequest:
    """A requested mould of a device; the silicone is the product's name, empty if it is not known, and ``name`` the case's."""

    device: Actuator
    workshop: Workshop
    silicone: str
    name: str

    @property
    def casting(self) -> silicones.Casting | None:
        """Data sheet values of the silicone; None if it is not in the table."""
        return silicones.casting_of(self.silicone)

    def to_toml(self) -> str:
        """Return the text of a file that requests the same mould."""
        silicone = {"silicone": self.silicone} if self.silicone else {}
        return tomli_w.dumps(
            {
                "name": self.name,
                "geometry": registry.to_table(self.device),
                "mould": {**silicone, **schema.to_table(self.workshop)},
            }
        )


def asked_of(
    device: Actuator | Case | str | Path, silicone: str | None = None, changes: Iterable[str] = (), **settings: object
) -> MouldRequest:
    """Return the request made from Python; `MouldError` or `CaseError` for invalid input.

    Settings are fields of `Workshop`, numbers in SI units (angles in degrees) or texts with a unit; a case file's table
    ``[mould]`` holds some too. The silicone is the case's if not given.
    """
    if isinstance(device, Actuator):
        return _mould_request(device, device.stem, None, {}, silicone, settings)
    if isinstance(device, Case):
        return _mould_request(device.actuator, device.name, device, {}, silicone, settings)
    if not isinstance(device, str | Path):
        raise MouldError(f"a mould needs a device, a case or a case file, not {units.brief(device)}")
    case, table = _read(Path(device), changes)
    try:
        return _mould_request(case.actuator, case.name, case, table, silicone, settings)
    except MouldError as error:
        raise MouldError(f"{device}: {error}") from None


def _mould_request(
    device: Actuator,
    name: str,
    case: Case | None,
    table: Mapping[str, object],
    silicone: str | None,
    settings: Mapping[str, object],
) -> MouldRequest:
    given = {key: value for key, value in settings.items() if value is not None}
    table = dict(table)
    product = _product(silicone if silicone is not None else table.pop("silicone", None), case)
    table.pop("silicone", None)
    casting = silicones.casting_of(product)
    values: dict[str, Any] = {"shrinkage": casting.shrinkage} if casting and casting.shrinkage else {}
    try:
        values |= schema.from_table(Workshop, table, "[mould]")
    except errors.FieldError as error:
        raise MouldError(str(error)) from None
    unknown = given.keys() - {field.name for field in dataclasses.fields(Workshop)}
    if unknown:
        raise MouldError(
            f"{min(unknown)!r} is not a setting of a mould; "
            f"{errors.known_are(min(unknown), sorted(Workshop.__dataclass_fields__))}"
        )
    values |= given
    workshop = Workshop(**values)
    if workshop.thread and not workshop.lay and case:
        workshop = dataclasses.replace(workshop, lay=_lay_of(case))
    return MouldRequest(device, workshop, product, name)


def _lay_of(case: Case) -> str:
    """Return the angles of a case's fibres on the face "outer"; `MouldError` for ones around another axis than z."""
    angles: list[float] = []
    for part in case.components:
        if isinstance(part, Fibres) and "outer" in component.names_in(part.on):
            if part.axis[0] or part.axis[1]:
                raise MouldError(f"{part.where}: axis is not along z; threads are wound around the tube's axis")
            angles += [part.angle, -part.angle][: part.helices if part.angle < 90.0 else 1]
    return ", ".join(f"{angle:g} deg" for angle in dict.fromkeys(angles))


def _product(name: object, case: Case | None) -> str:
    """Return the silicone's product: the requested one (`MouldError` if there is none), or the case's if its material is a
    named silicone."""
    if name is None:
        material = silicones.named(case.material) if case else None
        return silicones.product_of(material) if material else ""
    product = silicones.product_of(name) if isinstance(name, str) else ""
    if product not in silicones.CASTING:
        raise MouldError(f"silicone {units.brief(name)} is unknown; {errors.known_are(name, silicones.CASTING)}")
    return product


def _read(file: Path, changes: Iterable[str]) -> tuple[Case, dict[str, object]]:
    """Return a case file and its table ``[mould]``; the load is ignored. `CaseError` or `MouldError` for a file that is
    none."""
    try:
        tables = dict(with_changes(read_toml(file), changes))
    except TomlError as error:
        raise CaseError(f"case file {file} {error}") from None
    table = tables.pop("mould", {})
    if not isinstance(table, dict):
        raise MouldError(f"{file}: mould is {table!r}; it must be a table, starting with a line [mould]")
    geometry = tables.get("geometry")
    device = geometry.get("device") if isinstance(geometry, dict) else None
    solid = isinstance(device, str) and device in registry.ACTUATORS and registry.ACTUATORS[device].ratios == ()
    load = {"gravity": {"direction": "-z"}, "load": {"share": [1.0]}} if solid else {"load": {"pressure": "100 Pa"}}
    try:
        return Case.from_toml(tomli_w.dumps({**({} if "load" in tables else load), **tables}), file.parent), table
    except CaseError as error:
        raise CaseError(f"{file}: {error}") from None
