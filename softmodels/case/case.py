"""A case: everything that decides a run's numbers, as a value and as a TOML file that repeats it exactly."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from geometries import Actuator, GeometryError
from geometries import table as geometry_table
from measurement.toml_file import TomlError, parse_toml, read_toml
from measurement.units import WATER_DENSITY, UnitError, exact_text, pascal_per_cm, quantity
from softmodels.case import gauges as gauge_tables
from softmodels.case import material_table, supply_table
from softmodels.case.gauges import GaugeError, Gauges
from softmodels.case.ranges import SeriesError, series
from softmodels.materials.laws import Material, MaterialError
from softmodels.materials.stability import check_rest
from softmodels.mechanics.contact import STIFFNESS, Obstacle, ObstacleError
from softmodels.mechanics.sheet import Sheet
from softmodels.path import schedule as programs
from softmodels.path.schedule import Program, ProgramError
from softmodels.path.syringe import SupplyError, Syringe

CONTROLS = ("auto", "pressure", "volume", "arc-length")
FORMULATIONS = ("mixed", "displacement")
STIFFNESS_RANGE = 30.0
"""Pressures above this many shear moduli are taken for a mistake in a unit: no silicone device holds a tenth of it."""
SHEAR_MODULUS_RANGE = (500.0, 5e6)
"""Shear moduli in Pa that a silicone can have, from the softest gels to the hardest rubbers, with room on both sides."""
TABLES = ("geometry", "material", "load", "solver", "sheet", "contact", "supply", "points", "angles", "profile")
VOLUME_RANGE = 1000.0
"""Added volumes above this many cavities are taken for a mistake in a unit: a silicone tears at a tenth of that stretch."""


class CaseError(ValueError):
    """Bad input, found before anything is solved; the message is a sentence for the user."""


@dataclasses.dataclass(frozen=True)
class Case:
    """A run.

    Attributes:
        name: Stem of the result files.
        actuator: The device.
        material: The silicone.
        pressures_cm: Requested heights of the water column in cm, rising; empty if volumes are requested.
        volumes_ml: Requested added volumes of the cavity in ml, rising; empty if pressures are requested.
        water_density: Density in kg/m3 of the column's liquid.
        control: What the path follows.
        formulation: ``mixed`` or ``displacement``.
        sheet: A thin sheet bonded to a face of the device.
        strokes_ml: Requested strokes of the syringe in ml, rising; empty unless there is one.
        supply: The syringe, or None where pressure or volume are imposed.
        cycle: Whether the pressure is lowered again through the same values, and the device jumps at limit points.
        program: What each of several cavities goes through by itself, in place of one requested quantity; else empty.
        obstacle: A rigid plane that faces of the device come to rest on.
        gauges: Named points and angles that are told in every state, and a plane whose cut is drawn.
    """

    name: str
    actuator: Actuator
    material: Material
    pressures_cm: tuple[float, ...] = ()
    volumes_ml: tuple[float, ...] = ()
    water_density: float = WATER_DENSITY
    control: str = "auto"
    formulation: str = "mixed"
    sheet: Sheet | None = None
    strokes_ml: tuple[float, ...] = ()
    supply: Syringe | None = None
    cycle: bool = False
    program: Program = ()
    obstacle: Obstacle | None = None
    gauges: Gauges = gauge_tables.NONE

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not re.fullmatch(r"\w[\w.+-]*", self.name):
            raise CaseError(f"name {self.name!r} cannot name files; use letters, digits, '_', '-', '+' and '.'")
        if sum(map(bool, (self.pressures_cm, self.volumes_ml, self.strokes_ml, self.program))) != 1:
            raise CaseError(
                "request either pressures (--pressure-cm) or added volumes (--volume-ml), or strokes of a syringe "
                "(--supply syringe --stroke-ml), or in a case file a series for each cavity (cavity1.pressure_cm), one of these"
            )
        if self.program:
            self._check_program()
        if self.cycle and not self.pressures_cm:
            raise CaseError("--cycle raises and lowers a pressure; give --pressure-cm with it")
        if self.cycle and self.control != "auto":
            raise CaseError("--cycle chooses by itself what it follows; leave out --control")
        if bool(self.strokes_ml) != (self.supply is not None):
            raise CaseError("a syringe (--supply syringe) and its strokes (--stroke-ml) belong together")
        if self.supply is not None:
            if self.strokes_ml[-1] * 1e-6 > self.supply.syringe * (1 + 1e-9):
                raise CaseError(
                    f"a stroke of {self.strokes_ml[-1]:g} ml is more than the syringe holds, "
                    f"{self.supply.syringe * 1e6:g} ml; take a larger one (--syringe)"
                )
            if self.supply.leak * self.supply.gas_at_rest(self.actuator.cavity_volume) >= 1:
                raise CaseError(
                    "the leak loses all gas before the cavity is filled; --leak-per-ml is a share such as 0.005"
                )
            if self.control not in ("auto", "arc-length"):
                raise CaseError("strokes are followed under --control auto or arc-length")
        if self.control not in CONTROLS:
            raise CaseError(f"control {self.control!r} is not one of {', '.join(CONTROLS)}")
        if self.volumes_ml and self.control == "pressure":
            raise CaseError("added volumes cannot be requested under pressure control; use --control auto or volume")
        if self.formulation not in FORMULATIONS:
            raise CaseError(f"formulation {self.formulation!r} is not one of {', '.join(FORMULATIONS)}")
        if self.sheet is not None and self.sheet.face not in self.actuator.faces:
            raise CaseError(
                f"sheet {self.sheet.face!r} is no face of {type(self.actuator).__name__}; a sheet goes on "
                f"{' or '.join(self.actuator.faces) or 'none of its faces'}"
            )
        if self.obstacle is not None:
            try:
                self.obstacle.place(self.actuator)
            except ObstacleError as error:
                raise CaseError(str(error)) from None
        try:
            self.gauges.check(self.actuator)
        except GaugeError as error:
            raise CaseError(str(error)) from None
        if self.formulation == "displacement" and math.isinf(self.material.bulk):
            raise CaseError(
                "poisson = 0.5 is incompressible and needs the mixed formulation; use --formulation mixed, or --poisson 0.49"
            )
        if self.formulation == "mixed" and self.material.bulk <= 0.0:
            raise CaseError(
                f"poisson = {self.material.poisson:g} leaves {self.material.name} no stiffness of volume, which the mixed "
                "formulation divides by; use --formulation displacement"
            )
        if not 100.0 <= self.water_density <= 20000.0:
            raise CaseError(f"a water density of {self.water_density:g} kg/m^3 is no liquid's; the thesis measured 970")
        self._check_sizes()
        try:
            check_rest(self.material)
        except MaterialError as error:
            raise CaseError(str(error)) from None

    def _check_program(self) -> None:
        count = len(self.actuator.ratios)
        if len(self.program) != count:
            raise CaseError(
                f"[load] tells of {len(self.program)} cavities and the device has {count}; give a series for each"
            )
        if self.actuator.ratios != (1.0,) * count:
            raise CaseError(
                "pressure_ratios and a series for each cavity say the same thing twice; leave out the ratios"
            )
        if self.cycle or self.control not in ("auto", "arc-length"):
            raise CaseError("a series for each cavity is followed under control auto or arc-length, and without cycle")

    def _check_sizes(self) -> None:
        """Refuse numbers that only a mistaken unit gives: the solver would take them, or fail without saying why."""
        mu = self.material.shear_modulus_0
        if not SHEAR_MODULUS_RANGE[0] <= mu <= SHEAR_MODULUS_RANGE[1]:
            raise CaseError(
                f"the material's shear modulus is {mu:.4g} Pa; silicones have 5 to 500 kPa, so check the units of its "
                f"parameters ({SHEAR_MODULUS_RANGE[0] / 1e3:g} to {SHEAR_MODULUS_RANGE[1] / 1e3:g} kPa are taken)"
            )
        given = {is_volume: [v for one in self.program if one.is_volume == is_volume for v in one.values]
                 for is_volume in (False, True)}  # fmt: skip
        highest = max([*self.pressures_cm, *given[False]], default=0.0)
        if (most := highest * self.cm) > STIFFNESS_RANGE * mu:
            raise CaseError(
                f"a pressure of {highest:g} cm ({most / 1e3:.4g} kPa) against a shear modulus of {mu / 1e3:.4g} kPa cannot "
                "be meant: check the units of both (silicones have 5 to 500 kPa)"
            )
        cavity = self.actuator.cavity_volume
        largest = max([*self.volumes_ml, *given[True]], default=0.0)
        if largest * 1e-6 > VOLUME_RANGE * cavity:
            raise CaseError(
                f"an added volume of {largest:g} ml against a cavity of {cavity * 1e6:.4g} ml cannot be meant; "
                f"at most {VOLUME_RANGE:g} times the cavity is taken"
            )

    @property
    def cm(self) -> float:
        """Pa in one cm of the column."""
        return pascal_per_cm(self.water_density)

    @property
    def goals(self) -> tuple[float, ...]:
        """Requested pressures in Pa, added volumes or strokes in m3; none of a program."""
        return tuple(p * self.cm for p in self.pressures_cm) or tuple(v * 1e-6 for v in self.values)

    @property
    def quantity(self) -> str:
        """What is requested: ``"pressure"``, ``"volume"``, ``"stroke"`` or a program's ``"step"``."""
        if self.program:
            return "step"
        return "pressure" if self.pressures_cm else "volume" if self.volumes_ml else "stroke"

    @property
    def values(self) -> tuple[float, ...]:
        """Requested values in `unit`; of a program the numbers of its steps."""
        if self.program:
            rest = programs.begins_at_rest(self.program)
            return tuple(float(k) for k in range(1 - rest, len(self.program[0].values) + 1 - rest))
        return self.pressures_cm or self.volumes_ml or self.strokes_ml

    @property
    def column(self) -> str:
        """Column of ``path.csv`` that holds what is requested."""
        return {"pressure": "pressure_cm", "volume": "added_volume_ml", "stroke": "stroke_ml", "step": "load_step"}[
            self.quantity
        ]

    @property
    def unit(self) -> str:
        return {"pressure": "cm", "step": ""}.get(self.quantity, "ml")

    def to_toml(self) -> str:
        """Text of a case file that repeats this case exactly."""
        import tomli_w

        keys = {"pressure": "pressure_cm", "volume": "volume_ml", "stroke": "stroke_ml"}
        load: dict[str, Any] = programs.to_tables(self.program) or {keys[self.quantity]: list(self.values)}
        load["water_density"] = exact_text(self.water_density, "kg/m^3")
        tables: dict[str, Any] = {
            "name": self.name,
            "geometry": geometry_table.to_table(self.actuator),
            "material": material_table.to_table(self.material),
            "load": {**load, "control": self.control, **({"cycle": True} if self.cycle else {})},
            "solver": {"formulation": self.formulation},
        }
        if self.sheet is not None:
            tables["sheet"] = {"face": self.sheet.face, "stiffness": exact_text(self.sheet.stiffness, "N/m")}
        if self.obstacle is not None:
            tables["contact"] = dataclasses.asdict(self.obstacle)
        if self.supply is not None:
            tables["supply"] = supply_table.to_table(self.supply)
        return tomli_w.dumps(tables | gauge_tables.to_tables(self.gauges))

    @classmethod
    def from_toml(cls, text: str, folder: Path | None = None) -> Case:
        """Read a case file; what is left out has its default.

        Args:
            text: The file's text.
            folder: The file's folder, from which a part's own file is counted.

        Raises:
            CaseError: Not TOML, unknown tables or names, or an impossible case.
        """
        try:
            return cls._from_tables(parse_toml(text), folder)
        except TomlError as error:
            raise CaseError(f"the case {error}") from None

    @classmethod
    def _from_tables(cls, tables: dict[str, Any], folder: Path | None) -> Case:
        _known(tables, "the case", ("name", *TABLES))
        for table in TABLES:
            if not isinstance(tables.get(table, {}), dict):
                raise CaseError(f"{table} is {tables[table]!r}; it must be a table, which begins with a line [{table}]")
        load, solver = tables.get("load", {}), tables.get("solver", {})
        program = {name: load[name] for name in load if name.startswith("cavity")}
        _known(load, "[load]", ("pressure_cm", "volume_ml", "stroke_ml", "water_density", "control", "cycle", *program))
        _known(solver, "[solver]", ("formulation",))
        for table in ("geometry", "load"):
            if table not in tables:
                raise CaseError(f"the case has no [{table}] table")
        try:
            actuator = geometry_table.from_table(_found(tables["geometry"], folder))
            return cls(
                name=tables.get("name", actuator.stem),
                actuator=actuator,
                material=material_table.from_table(tables["material"])
                if "material" in tables
                else material_table.DEFAULT,
                pressures_cm=series(load.get("pressure_cm", ()), "pressure"),
                volumes_ml=series(load.get("volume_ml", ()), "volume"),
                water_density=_density(load.get("water_density", exact_text(WATER_DENSITY, "kg/m^3"))),
                control=load.get("control", "auto"),
                formulation=solver.get("formulation", "mixed"),
                sheet=_sheet(tables["sheet"]) if "sheet" in tables else None,
                obstacle=_obstacle(tables["contact"]) if "contact" in tables else None,
                cycle=_flag(load.get("cycle", False)),
                strokes_ml=series(load.get("stroke_ml", ()), "stroke"),
                supply=supply_table.from_table(tables["supply"]) if "supply" in tables else None,
                program=programs.from_tables(program) if program else (),
                gauges=gauge_tables.from_tables(tables),
            )
        except (
            GaugeError,
            GeometryError,
            MaterialError,
            ObstacleError,
            ProgramError,
            SeriesError,
            SupplyError,
        ) as error:
            raise CaseError(str(error)) from None

    @classmethod
    def from_file(cls, path: Path) -> Case:
        """Read a case file; see `from_toml`. The messages name the file."""
        try:
            return cls._from_tables(read_toml(path), path.parent)
        except TomlError as error:
            raise CaseError(f"case file {path} {error}") from None
        except CaseError as error:
            raise CaseError(f"{path}: {error}") from None


def _known(table: Mapping[str, Any], where: str, names: tuple[str, ...]) -> None:
    for key in table:
        if key not in names:
            raise CaseError(f"{where} has an unknown entry {key!r}; known are {', '.join(names)}")


def _sheet(table: Mapping[str, Any]) -> Sheet:
    _known(table, "[sheet]", ("face", "stiffness"))
    return sheet_from(table.get("face"), table.get("stiffness"))


def _obstacle(table: Mapping[str, Any]) -> Obstacle:
    _known(table, "[contact]", ("faces", "plane", "stiffness"))
    return Obstacle(table.get("faces", ""), table.get("plane", ""), table.get("stiffness", STIFFNESS))


def sheet_from(face: Any, stiffness: Any) -> Sheet:
    """The sheet of a table or a command line: a face's name, and a stiffness with its unit.

    Raises:
        CaseError: One without the other, or no stiffness.
        MaterialError: A stiffness that no sheet has.
    """
    if not isinstance(face, str) or stiffness is None:
        raise CaseError("a sheet needs both its face and its stiffness (--sheet top --sheet-stiffness 50kN/m)")
    try:
        return Sheet(face, quantity(stiffness, "N/m"))
    except UnitError as error:
        raise CaseError(f"sheet stiffness: {error}") from None


def _found(geometry: dict[str, Any], folder: Path | None) -> dict[str, Any]:
    """A geometry table whose ``file`` is an absolute path: the case.toml of the results lies in another folder."""
    file = geometry.get("file")
    if not isinstance(file, str) or not file:
        return geometry
    return {**geometry, "file": str((folder or Path()).resolve() / file)}


def _flag(value: Any) -> bool:
    if not isinstance(value, bool):
        raise CaseError(f"cycle is {value!r}; it must be true or false")
    return value


def _density(value: Any) -> float:
    try:
        return quantity(value, "kg/m^3")
    except UnitError as error:
        raise CaseError(f"water_density: {error}") from None
