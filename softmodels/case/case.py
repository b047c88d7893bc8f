"""`Case`: all input of a run, as a Python value and as a TOML file that reproduces it exactly; which numbers designs vary."""

from __future__ import annotations

import dataclasses
import functools
import inspect
import math
import re
import types
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, TypedDict, Unpack

from geometries import Actuator, faces, meshing, registry as geometry_table
from geometries.actuator import changed, parameter, parameter_names
from softmodels.case import load, materials, tolerances
from softmodels.case.entries import (
    MISSING,
    NO_PROBES,
    PART_ERRORS,
    CaseError,
    Entry,
    Missing,
    Option,
    Probes,
    SupplyEntry,
    Tables,
    Value,
    Written,
    factor_of,
    probes_from_tables,
    probes_to_tables,
    split_text,
    table_of,
)
from softmodels.case.load import (
    CM,
    IN_TIME,
    ONE_REQUEST,
    STIFFNESS_RANGE,
    Load,
    StepsEntry,
    Values,
    at_times,
    listed,
    prescribed,
    settled,
    steps_in_time,
)
from softmodels.common import errors, files, names, schema, tables, units
from softmodels.common.names import checked
from softmodels.components.loads import Gravity
from softmodels.materials import laws, silicones, specimens
from softmodels.materials.laws import Material
from softmodels.mechanics import memory
from softmodels.mechanics.component import Component
from softmodels.mechanics.regions import RATIO_PREFIX, RegionPart, number_of, variable_numbers, with_number
from softmodels.mechanics.solver import METHODS
from softmodels.mechanics.system import FORMULATIONS
from softmodels.path.steps import MIN_STRESS_TOLERANCE, PRESSURE, STRESS_TOLERANCE, STROKE, VOLUME, Step, Steps, timed
from softmodels.path.supply import AirSupply

__all__ = ["CONTROLS", "FORMULATIONS", "STIFFNESS_RANGE", "Case", "CaseError", "entries"]


# ----------------------------------------------------------------------------------------------------------------------
# Entries of a case with their own tables: name, device, material, programs and gauges.


class NameEntry(Entry[object]):
    """The case's name, outside all tables; `Case` checks it."""

    def read(self, tables: Tables) -> object:
        return tables.get("name", MISSING)

    def write(self, value: object, text: schema.Text) -> Written:
        return {}


class DeviceEntry(Entry[Actuator]):
    """The device."""

    tables = ("geometry",)

    def read(self, tables: Tables) -> Actuator:
        return geometry_table.from_table(table_of(tables, "geometry"))

    def write(self, value: Actuator, text: schema.Text) -> Written:
        return {"geometry": geometry_table.to_table(value, text)}


class MaterialEntry(Entry[Material]):
    """The silicone."""

    tables = ("material",)

    def read(self, tables: Tables) -> Material | Missing:
        return materials.from_table(table_of(tables, "material")) if "material" in tables else MISSING

    def write(self, value: Material, text: schema.Text) -> Written:
        return {"material": materials.to_table(value, text)}


class GaugesEntry(Entry[Probes]):
    """Named points, angles and the profile's plane."""

    tables = ("points", "angles", "profile")

    def read(self, tables: Tables) -> Probes:
        return probes_from_tables({name: table_of(tables, name) for name in self.tables})

    def write(self, value: Probes, text: schema.Text) -> Written:
        return probes_to_tables(value)


# ----------------------------------------------------------------------------------------------------------------------
# Reject materials with implausible parameters, or unsuitable for the formulation.


MODULI = (laws.MIN_SHEAR_MODULUS, 1e9)
"""Accepted shear moduli in Pa, from the softest gels to the hardest elastomers, with a margin."""
LEAST_ACCURACY = 1e-5
"""Smallest accuracy relative to the number that cells are chosen for."""
MOST_APART = 1e6
"""Maximum ratio of a region's shear modulus to the main one's that is solved accurately."""


def check_materials(material: Material, components: Sequence[Component], formulation: str) -> None:
    """Raise `CaseError` for a material, or one of a region, that is unsuitable for the formulation or has parameters in a
    wrong unit."""
    mu = material.shear_modulus_0
    if not MODULI[0] <= mu <= MODULI[1]:
        raise CaseError(
            f"the material's shear modulus is {mu:.4g} Pa; silicones have 5 to 500 kPa, so check the units of its "
            f"parameters ({MODULI[0] / 1e3:g} to {MODULI[1] / 1e3:g} kPa are accepted)"
        )
    _check_volume("", material, formulation)
    for part in components:
        if isinstance(part, RegionPart):
            _check_volume(f"{part.where}: ", part.material, formulation)
            apart = part.material.shear_modulus_0 / mu
            if not 1 / MOST_APART <= apart <= MOST_APART:
                raise CaseError(
                    f"{part.where}: its shear modulus is {apart:.3g} times the main material's; "
                    f"{1 / MOST_APART:g} to {MOST_APART:g} times are accepted. Make a stiffer one a rigid part"
                )


def _check_volume(where: str, material: Material, formulation: str) -> None:
    if formulation == "displacement" and math.isinf(material.bulk):
        raise CaseError(
            f"{where}poisson = 0.5 is incompressible and needs the mixed formulation; use --formulation mixed, or "
            "--poisson 0.49"
        )
    if formulation == "mixed" and material.bulk <= 0.0:
        raise CaseError(
            f"{where}poisson = {material.poisson:g} gives {material.name} zero bulk stiffness, which the "
            f"mixed formulation cannot handle; use --formulation displacement"
        )


# ----------------------------------------------------------------------------------------------------------------------
# A case: everything that determines a run's numbers, from and to text.


CONTROLS = ("auto", "pressure", "volume", "arc-length")


class _Shown(TypedDict, total=False):
    """Further attributes of a `Value`."""

    key: str
    hidden: bool
    metavar: str
    option: str


def _written[V](entry: Entry[V]) -> dict[str, object]:
    """Return the metadata of a field: its entry in case files, and what it is."""
    return {"entry": entry, "about": entry.about}


def _value[V](table: str, kind: schema.Kind, text: str, default: V, **more: Unpack[_Shown]) -> V:
    return dataclasses.field(default=default, metadata=_written(Value(table, schema.About(kind, text), default, **more)))


@checked
@dataclasses.dataclass(frozen=True)
class Case:
    """A run: everything that determines its numbers.

    Raises:
        CaseError: From the constructor, if the case is invalid.
    """

    needed_tables: ClassVar[tuple[str, ...]] = ("geometry", "load")
    """Tables that a case file must have."""

    name: str = dataclasses.field(metadata=_written(NameEntry("stem of the result files")))
    actuator: Actuator = dataclasses.field(metadata=_written(DeviceEntry("the device")))
    material: Material = dataclasses.field(
        metadata=_written(MaterialEntry("its silicone, or the name of one, such as ecoflex-00-30"))
    )
    steps: Steps = dataclasses.field(default=(), metadata=_written(StepsEntry(
        "load steps; softmodels.case.load.steps_of makes them of the keys of a case file's [load], such as "
        "steps_of(force_N='0:10'), or a series for each of several cavities")))  # fmt: skip
    water_density: float = _value(
        "load", schema.Quantity("kg/m^3"), f"density of the column's liquid; the default is {units.DENSITY_NOTE}",
        units.WATER_DENSITY,
    )  # fmt: skip
    control: str = _value("load", schema.Choice(CONTROLS), "control of the continuation", "auto")
    formulation: str = _value(
        "solver", schema.Choice(FORMULATIONS), "displacement and pressure, or only displacement (compressible studies)",
        "mixed",
    )  # fmt: skip
    supply: AirSupply | None = dataclasses.field(default=None, metadata=_written(SupplyEntry(
        "air supply, such as a Syringe driven by strokes, or a Reservoir, whose source has the pressures then; None where "
        "pressure or volume are imposed")))  # fmt: skip
    load_unload: bool = _value(
        "load", schema.Flag(),
        "simulate loading and unloading under pressure control, through the same values, with snap-through at limit points",
        False, hidden=True,
    )  # fmt: skip
    gauges: Probes = dataclasses.field(default=NO_PROBES, metadata=_written(GaugesEntry(
        "named points and angles reported in every state, and a plane whose section is drawn")))  # fmt: skip
    components: materials.Parts = dataclasses.field(default=(), metadata=_written(materials.PartsEntry(
        "one or several components added to the device, such as Gravity, Rigid, RigidShape or Fibres")))  # fmt: skip
    band: materials.AnyBand | None = dataclasses.field(default=None, metadata=_written(materials.ErrorsEntry(
        "errors of the material, whose 95 % band is computed for every state; or the name of a silicone, each of whose sources "
        "is solved too; or the file of a fit")))  # fmt: skip
    tolerance: tolerances.Tolerances | None = dataclasses.field(default=None, metadata=_written(tolerances.TolerancesEntry(
        "how well lengths of the device and readings of the bench are known, as half widths of 95 % intervals, such as "
        "{'membrane': '0.1 mm', 'gauge': '1 %'}; they widen the bands of every state")))  # fmt: skip
    solver: str = _value(
        "solver", schema.Choice(METHODS),
        "linear solver: factorisation (direct), multigrid iterations (iterative, with memory linear "
        "in the model size), or chosen by the available memory (auto)",
        "auto", key="method", hidden=True, option="solver",
    )  # fmt: skip
    time_tolerance: float = _value(
        "solver", schema.Quantity(),
        "error of the stress by one step in time, over the largest stress, and with "
        "--inertia of the displacement", STRESS_TOLERANCE, hidden=True,
    )  # fmt: skip
    mesh_error: bool = _value(
        "solver", schema.Flag(),
        "estimate the mesh error of the last state and of limit points: the path is solved again with smaller cells, of a "
        "solid also with larger ones", False, hidden=True,
    )  # fmt: skip
    accuracy: float = _value(
        "solver", schema.Quantity(),
        "largest mesh error relative to the number, such as 1%, of the last state's main rise and added volume and of limit "
        "pressures: the cells are made small enough for it; 0 for the cells as they are", 0.0, hidden=True,
    )  # fmt: skip
    inertia: bool = _value(
        "load", schema.Flag(),
        "let mass count in time (--rate, --hold): the device swings, and is followed through jumps", False, hidden=True,
    )  # fmt: skip
    spectral_radius: float = _value(
        "solver", schema.Quantity(),
        "with --inertia, what one step leaves of a vibration that it is far too long for, 0 to 0.99",
        memory.SPECTRAL_RADIUS, hidden=True,
    )  # fmt: skip
    fields: tuple[str, ...] = _value(
        "output", schema.Several(schema.Words()),
        "further fields in every state, such as cauchy_stress, deformation_gradient or principal_stresses", (), hidden=True,
    )  # fmt: skip

    def __post_init__(self) -> None:
        if why := names.unusable_name(self.name):
            raise CaseError(why)
        try:
            self._settle()
            self._check_load()
            self._check_inertia()
            self.gauges.check(self.actuator)
            walled = materials.with_walls(self.components, self.actuator, self.load.draws())
            object.__setattr__(self, "components", walled)
            materials.check_parts(self.components, self.actuator)
            check_materials(self.material, self.components, self.formulation)
            if self.band is not None:
                self.band.check(self.material)
                self.load.check_band()
            if self.tolerance is not None:
                self._check_tolerance()
            if not (self.accuracy == 0.0 or LEAST_ACCURACY <= self.accuracy <= 1.0):
                raise CaseError(f"--accuracy is {self.accuracy:g}; it must be 0 (none), or from {LEAST_ACCURACY:.4%} to 100%")
            if (self.mesh_error or self.accuracy) and not self.actuator.refinable:
                asks = "--accuracy" if self.accuracy else "--mesh-error"
                raise CaseError(f"{asks} needs another mesh, but {meshing.NOT_REFINED}")
            self.load.check_size(self.material.shear_modulus_0, self.actuator.cavity_volume)
            specimens.check_rest(self.material)
        except PART_ERRORS as error:
            raise CaseError(str(error)) from None

    def _check_load(self) -> None:
        self.load.check()

    def _settle(self) -> None:
        """Convert each field to its type: read texts with units, look up silicones by name; `ArgumentError`, or an error of
        `PART_ERRORS`, for a value that is invalid."""
        for name, entry in entries().items():
            if isinstance(entry, Value):
                object.__setattr__(self, name, entry.settled(getattr(self, name)))
        names.one_of("device", self.actuator, Actuator, "a device, such as sm.HollowDisk()")
        object.__setattr__(self, "material", silicones.material_of("material", self.material))
        object.__setattr__(
            self,
            "components",
            names.several("components", self.components, Component, "a part, such as sm.Gravity('-z')"),
        )
        if isinstance(self.band, str | Path):
            object.__setattr__(self, "band", materials.band_of(self.band))
        for name, (kinds, wanted) in _KINDS.items():
            names.one_of(name, getattr(self, name), (*kinds, types.NoneType), wanted)
        if isinstance(self.tolerance, Mapping):
            object.__setattr__(self, "tolerance", tolerances.Tolerances.of(self.tolerance))
        if self.gauges is None:
            object.__setattr__(self, "gauges", NO_PROBES)
        object.__setattr__(
            self, "steps", names.several("steps", self.steps, Step, "load steps, such as steps_of(pressure='0:5 kPa')")
        )
        object.__setattr__(self, "steps", settled(self))

    def _check_tolerance(self) -> None:
        """Reject tolerances of other lengths than the device's, and loads that have none."""
        self.load.check_band()
        if self.program or self.quantity not in (PRESSURE, VOLUME):
            raise CaseError("[tolerance] is available for requested pressures and volumes only, not in programs; leave it out")
        _ = self.deviations

    @functools.cached_property
    def deviations(self) -> list[tolerances.Deviation]:
        """The tolerances in SI; empty without any."""
        return self.tolerance.deviations(self.actuator, self.column.pascal) if self.tolerance else []

    def _check_inertia(self) -> None:
        """Reject tolerances out of range, and inertia without times or mass, or with volumes or travels in time."""
        if not MIN_STRESS_TOLERANCE <= self.time_tolerance < 1.0:
            raise CaseError(
                f"time_tolerance is {self.time_tolerance:g}; it must be {MIN_STRESS_TOLERANCE:g} or more and below 1, such as "
                f"{STRESS_TOLERANCE:g} (states are solved no closer, and the number of steps grows as 1 over its square root)"
            )
        if not 0.0 <= self.spectral_radius <= memory.MAX_SPECTRAL_RADIUS:
            raise CaseError(
                f"spectral_radius is {self.spectral_radius:g}; it must be from 0 to {memory.MAX_SPECTRAL_RADIUS:g}, "
                f"such as {memory.SPECTRAL_RADIUS:g}"
            )
        if not self.inertia:
            return
        if not self.timed:
            raise CaseError("--inertia needs a load in time; add --rate or --hold, or a program with time_s")
        held = next((driver for step in self.steps for driver in step.prescribed if driver.held), None)
        if held is not None:
            raise CaseError(
                f"--inertia needs pressures, forces or an air supply in time: {held.quantity} that starts at a rate would "
                "need an infinite pressure; use --supply reservoir, or leave out --inertia"
            )
        weighing = next((part.density for part in self.components if isinstance(part, Gravity)), None)
        if weighing == 0.0:
            raise CaseError("--inertia needs a mass, but the silicone's density is 0; leave out --gravity-density, or raise it")
        if resting := next((part.where for part in self.components if part.lifted and part.weighs), ""):
            raise CaseError(
                f"{resting} rests on the device, and --inertia knows no mass that may leave it; leave out the mass, or bond it "
                "([mass], [rigid])"
            )

    # -- the load -----------------------------------------------------------------------------------------------------

    @functools.cached_property
    def load(self) -> Load:
        """What the load steps say."""
        return Load(self)

    @property
    def program(self) -> bool:
        """Whether the load is a program: several steps, which name each cavity and dead load that they drive."""
        return self.load.program

    @property
    def column(self) -> units.Column:
        """The column of liquid in whose heights its pressures are shown."""
        return units.Column(self.water_density)

    @property
    def timed(self) -> bool:
        """Whether the load has times, so that silicone with a memory creeps."""
        return timed(self.steps)

    @property
    def remembers(self) -> bool:
        """Whether a silicone of it has a memory."""
        regions = [part.material for part in self.components if isinstance(part, RegionPart)]
        return any(material.memory is not None for material in (self.material, *regions))

    @property
    def quantity(self) -> str:
        """The requested quantity: ``"pressure"``, ``"volume"``, ``"stroke"`` or a program's ``"step"``."""
        return self.load.requested.name

    @property
    def values(self) -> tuple[float, ...]:
        """Requested values in SI units, with their texts; of a program the numbers of its steps."""
        return self.load.values

    @property
    def variable(self) -> str:
        """Variable of the run's table that is requested."""
        return self.load.requested.variable

    # -- as text ------------------------------------------------------------------------------------------------------

    @property
    def files(self) -> tuple[str, ...]:
        """Files of which the device and its parts are made, each once."""
        named = [self.actuator.files, *(part.files for part in self.components)]
        return tuple(dict.fromkeys(file for files in named for file in files.values()))

    def to_toml(self, files: Mapping[str, str] | None = None) -> str:
        """Return the text of a case file that repeats this case exactly.

        Args:
            files: What stands there for some of `files`, such as a copy's path from the case file's folder.
        """
        import tomli_w

        tables: dict[str, dict[str, object]] = {}
        for name, entry in entries().items():
            for table, values in entry.write(getattr(self, name), units.exact_text).items():
                tables.setdefault(table, {}).update(values)
        return tomli_w.dumps({"name": self.name, **_with_files(tables, lambda file: (files or {}).get(file, file))})

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
            return cls._from_tables(tables.parse_toml(text), folder)
        except tables.TomlError as error:
            raise CaseError(f"the case {error}") from None

    @classmethod
    def from_file(cls, path: Path | str, instead: Tables | None = None, changes: Iterable[str] = ()) -> Case:
        """Read a case file with some tables replaced, and fields as of `with_changes`; see `from_toml`. Messages name the
        file."""
        path = Path(path)
        _check_case_file(path)
        try:
            return cls._from_tables({**with_changes(tables.read_toml(path), changes), **(instead or {})}, path.parent)
        except tables.TomlError as error:
            raise CaseError(f"case file {path} {error}") from None
        except CaseError as error:
            raise CaseError(f"{path}: {error}") from None

    @classmethod
    def _from_tables(cls, tables: Tables, folder: Path | None) -> Case:
        try:
            _check_tables(tables, cls.needed_tables)
            tables = _with_absolute_paths(tables, folder)
            read = {name: entry.read(tables) for name, entry in entries().items()}
        except PART_ERRORS as error:
            raise CaseError(str(error)) from None
        given = {name: value for name, value in read.items() if value is not MISSING}
        return cls(**{"name": given["actuator"].stem, "material": materials.DEFAULT, **given})


def with_changes(table: Tables, changes: Iterable[str]) -> Tables:
    """Return the tables of a case file with changed fields, each as ``"load.pressure=0:5 kPa"``: a text, or a value as TOML has
    it. Another request takes the place of the file's. `CaseError` for a text without a field or a value."""
    made = dict(table)
    for text in changes:
        name, equals, value = text.partition("=")
        path = name.strip().split(".")
        if not (equals and value.strip() and all(path)):
            raise CaseError(f"--set {text!r} is no change; write a field and its value, such as load.pressure='0:5 kPa'")
        inner = made
        for key in path[:-1]:
            nested = inner.get(key, {})
            if not isinstance(nested, Mapping):
                raise CaseError(f"--set {name}: {key} is a value, not a table")
            inner[key] = inner = dict(nested)
        if path[:-1] == ["load"] and path[-1] in load.request_keys():
            kept = load.kept_with(path[-1])
            for key in [key for key in inner if key not in kept]:
                del inner[key]
        try:
            inner[path[-1]] = tables.parse_toml(f"value = {value}")["value"]
        except tables.TomlError:
            inner[path[-1]] = value.strip()
    return made


def _check_case_file(path: Path) -> None:
    """Reject a path that is not a case file (a part, a folder, a misspelt name), and say how to fix it."""
    if (kind := path.suffix.lower()) in faces.FILE_DEVICES:
        device, field = faces.FILE_DEVICES[kind]
        what = "a drawing" if kind in faces.DRAWINGS else "a part file"
        raise CaseError(
            f"{path} is {what}, not a case, which also says what holds it and its load; type softmodels run --device {device} "
            f"--{field} {path} --support 'x = 0 mm' --pressure-cm 0:10, or write the same into a text file part.toml: "
            f"[geometry] device = '{device}', {field} = '{path.name}', support = 'x = 0 mm', and [load] pressure_cm = '0:10', "
            "one to a line"
        )
    if path.is_dir() and (path / "case.toml").is_file():
        raise CaseError(f"case file {path} cannot be read (it is a results folder; its case file is {path / 'case.toml'})")
    if not path.exists():
        near = errors.near_paths(path) or "; softmodels examples writes some to begin with"
        raise CaseError(f"case file {path} cannot be read (No such file or directory{near})")


_KINDS: dict[str, tuple[tuple[type, ...], str]] = {
    "supply": ((AirSupply,), "a supply of air, such as sm.Syringe()"),
    "gauges": ((Probes,), "gauges"),
    "tolerance": ((tolerances.Tolerances, Mapping), "a table such as {'membrane': '0.1 mm', 'gauge': '1 %'}"),
    "band": (
        (materials.MaterialErrors, materials.SourceBand),
        "errors of a fitted material, or the name of a silicone",
    ),
}
"""Fields that hold an instance of a class, or None."""


@functools.cache
def entries() -> Mapping[str, Entry[Any]]:
    """Return the entry of each field of a case, by name."""
    return {field.name: field.metadata["entry"].of_field(field.name) for field in dataclasses.fields(Case)}


for _name, _entry in entries().items():
    for _option, _argument in _entry.arguments(_name).items():
        errors.call(_option.replace("_", "-"), _argument)


def arguments() -> dict[str, Option]:
    """Return the arguments of calls that make a case, by name: its fields, and how its load goes in time."""
    options = [(name, entry.about, getattr(Case, name, None)) for name, entry in entries().items()]
    options += [(time_entry.key, time_entry.about, time_entry.default) for time_entry in IN_TIME]
    return {name: Option(name, about, default) for name, about, default in options}


def listed_options[Call: Callable[..., object]](options: type) -> Callable[[Call], Call]:
    """Give a call with ``**options`` of a `TypedDict` the signature and the docstring that list them; a decorator."""

    def described(call: Any) -> Any:
        call.options = [option for name, option in arguments().items() if name in options.__annotations__]
        signature = inspect.signature(call)
        named = [
            inspect.Parameter(
                option.name, inspect.Parameter.KEYWORD_ONLY, default=option.default,
                annotation=options.__annotations__[option.name].__forward_arg__,
            )
            for option in call.options
        ]  # fmt: skip
        call.__signature__ = signature.replace(parameters=[*list(signature.parameters.values())[:-1], *named])
        lines = [f"\\g<1>{option.name}: {errors.spoken(option.about.text)}." for option in call.options]
        call.__doc__ = re.sub(r"(?m)^( +)options: .*$", "\n".join(lines), call.__doc__)
        return call

    return described


FILE_KEYS = ("file", "air")
"""Entries of tables that are files, or lists of them; so is a ``network`` that is a drawing, not a family."""


def _with_files(table: Mapping[str, object], renamed: Callable[[str], str]) -> dict[str, object]:
    """Return the tables with other names of files."""

    def written(key: str, value: object) -> object:
        if isinstance(value, Mapping):
            return _with_files(value, renamed)
        if isinstance(value, list | tuple) and key in FILE_KEYS:
            return [written(key, file) for file in value]
        drawn = key == "network" and isinstance(value, str) and value.lower().endswith(faces.DRAWINGS)
        return renamed(value) if isinstance(value, str) and value and (key in FILE_KEYS or drawn) else value

    return {key: written(key, value) for key, value in table.items()}


def _check_tables(tables: Tables, needed: tuple[str, ...]) -> None:
    """Reject unknown tables and entries, and a case without its needed tables."""
    known = list(dict.fromkeys(table for entry in entries().values() for table in entry.tables))
    _known(tables, "the case", ("name", *known))
    for table in known:
        given = table_of(tables, table)
        values = [entry for entry in entries().values() if isinstance(entry, Value) and entry.table == table]
        if values:
            owners = [entry for entry in entries().values() if table in entry.tables]
            rest = (key for key in given if any(entry.known(key) for entry in owners))
            _known(given, f"[{table}]", (*(key for entry in owners for key in entry.keys), *rest))
    for table in needed:
        if table not in tables:
            raise CaseError(f"the case has no [{table}] table")


def _known(table: Mapping[str, object], where: str, names: tuple[str, ...]) -> None:
    for key in table:
        if key not in names:
            raise CaseError(f"{where} has an unknown entry {key!r}; {errors.known_are(key, names)}")


def _with_absolute_paths(tables: Tables, folder: Path | None) -> Tables:
    """Return the tables with absolute file paths, because the case.toml of the results is in another folder. Files are counted
    from the case's folder; those of fitted materials, which commands name from where they run, from there too where the case's
    folder has none."""
    home = (folder or Path()).resolve()

    def absolute(file: str) -> str:
        return str(home / file)

    def absolute_if_there(file: str) -> str:
        return absolute(file) if (home / file).is_file() else file

    given = {
        name: value for name in ("material", "band", "region", "contact") if isinstance(value := tables.get(name), Mapping)
    }
    return {
        **tables,
        **{name: _with_files(value, absolute_if_there) for name, value in given.items()},
        "geometry": _with_files(table_of(tables, "geometry"), absolute),
    }


# ----------------------------------------------------------------------------------------------------------------------
# Identity of a run: all input that its results depend on, as texts by name. Equal texts give equal results.
#
# Every field of a case counts, except those of `MAY_GROW`, with all its content, so that a new field
# cannot be forgotten. Files count by content, not by path.


ALIKE = ("solver",)
"""Fields of a case that affect the solution method but not the results."""
MAY_GROW = "steps"
"""The field with the requested values, which a resumed run may extend; they are checked separately."""


def identity(case: Case) -> dict[str, str]:
    """Return all input that a case's results depend on: texts by dotted names, such as ``"material.c1"``; `CaseError` for a
    file that cannot be read."""
    texts = {name: text for name, text in _texts("", case) if name not in ALIKE}
    if case.load.driven is not None:
        texts |= {
            "load": f"{case.load.driven.quantity} of {case.load.driven_part.where}",
            "load.preload": f"{case.load.preload!r} Pa",
        }
    for path in case.actuator.files.values():
        digest = f"SHA-256 {files.file_digest(path)}"
        texts |= {name: text.replace(repr(path), digest) for name, text in texts.items() if name.startswith("actuator.")}
    return texts


def difference(old: Mapping[str, str], new: Mapping[str, str]) -> str | None:
    """Return the first name under which two identities differ, requested values aside; None if there is none."""
    names = [*new, *(name for name in old if name not in new)]
    for name in sorted(names, key="components".__eq__):  # which one it is says more than that there are none
        if name != MAY_GROW and old.get(name) != new.get(name):
            return name
    return None


def _texts(name: str, value: object) -> Iterator[tuple[str, str]]:
    if isinstance(value, tuple) and any(isinstance(part, Component) for part in value):
        yield from ((f"{name}.{part.where.strip('[]')}", _text(part)) for part in value)
        return
    if not dataclasses.is_dataclass(value):
        yield name, _text(value)
        return
    if name:
        yield name, type(value).__name__
    for field in dataclasses.fields(value):
        if not field.compare:
            continue
        yield from _texts(f"{name}.{field.name}" if name else field.name, getattr(value, field.name))


def _text(value: object) -> str:
    if isinstance(value, tuple | list):
        return f"({', '.join(map(_text, value))})"
    if isinstance(value, int | float) and not isinstance(value, bool):
        return repr(float(value))  # 10 and 10.0 are one number
    text = repr(value)
    if isinstance(value, Component):
        for path in value.files.values():
            text = text.replace(repr(path), f"SHA-256 {files.file_digest(path)}")
    return text


# ----------------------------------------------------------------------------------------------------------------------
# What is asked of a device as Python writes it, made into a case: arrays in SI units, or texts with a unit.


LEAST_PRESSURE = 200.0
"""Pa; if all pressures given as numbers are below this, their unit is doubtful: most devices hardly move."""


class SolveOptions(TypedDict, total=False):
    """The fields of a `Case` that every call may give."""

    components: Component | Sequence[Component]
    formulation: str
    solver: str
    mesh_error: bool
    accuracy: float | str


class ErrorOptions(SolveOptions, total=False):
    """These, and the errors of material, lengths and readings."""

    band: materials.AnyBand | str | Path | None
    tolerance: tolerances.Tolerances | Mapping[str, str] | None


class RequestOptions(ErrorOptions, total=False):
    """The fields of a `Case`, and of its load in time, that a call may give."""

    rate: str
    hold: float | str
    cycles: int
    time_tolerance: float
    inertia: bool
    spectral_radius: float
    steps: Sequence[Step]
    supply: AirSupply | None
    control: str
    gauges: Probes | None
    load_unload: bool
    water_density: float | str
    fields: Sequence[str]
    name: str | None


def case_of(
    device: Actuator,
    material: Material | str,
    pressures: Values | None = None,
    volumes: Values | None = None,
    times: Values | None = None,
    strokes: Values | None = None,
    valve: Values | None = None,
    **options: Unpack[RequestOptions],
) -> Case:
    """Return a case as `softmodels.api.calls.inflate` describes it; `ArgumentError` or `CaseError` for invalid input."""
    names.one_of("device", device, Actuator, "a device, such as sm.HollowDisk()")
    in_time = {key: value for key in ("rate", "hold", "cycles") if (value := options.pop(key, None))}  # type: ignore[misc]
    asked = {PRESSURE: pressures, VOLUME: volumes, STROKE: strokes}
    chosen = {key: value for key, value in options.items() if value is not None}
    try:
        density = schema.Quantity("kg/m^3").settled("water_density", options.get("water_density", units.WATER_DENSITY))
        cm = units.Column(density).pascal
        made = [prescribed(quantity, values, cm, times is not None) for quantity, values in asked.items() if values is not None]
        steps = tuple(Step((driver,)) for driver in made)
        if times is not None:
            steps = at_times(made, times, options.get("supply"), valve)
        elif valve is not None:
            raise CaseError("the valve opens and closes at times; give times too, one for each value")
        if len(made) > 1 or (steps and chosen.get("steps")):
            raise CaseError(ONE_REQUEST)
        steps = tuple(chosen.pop("steps", ())) or steps  # type: ignore[arg-type]
        steps = steps_in_time(steps, cm, **in_time) if in_time else steps  # type: ignore[arg-type]
    except errors.FieldError as error:
        raise CaseError(str(error)) from None
    fields = {"name": device.stem, "steps": steps, **chosen}
    case = Case(actuator=device, material=material, **fields)  # type: ignore[arg-type]
    _doubt_numbers(pressures, case)
    return case


def _doubt_numbers(pressures: Values | None, case: Case) -> None:
    """Warn of pressures so small, and of values of components and supply so large, that their unit is doubtful."""
    for part in (*case.components, *([case.supply] if case.supply else [])):
        if text := schema.doubt_of(part):
            names.doubt(text)
    given = [] if pressures is None else listed(pressures, "pressure")
    typed = [value for value in given if not isinstance(value, str)]
    highest = max(typed, key=abs, default=LEAST_PRESSURE) if len(typed) == len(given) else LEAST_PRESSURE
    if abs(highest) < LEAST_PRESSURE:
        names.doubt(
            f"the highest pressure is {highest:.4g} Pa, {case.column.full(highest, '.2g')}; "
            "numbers are in Pa, so "
            f"write another unit as a text such as '{highest:g} kPa' or '{highest:g} cm'"
        )


def one_value(text: str, pascal_in_cm: float) -> tuple[str, float]:
    """Return whether a text such as ``"70 cm"`` is a ``"pressure"`` (Pa) or a ``"volume"`` (m3), and its value; else
    `CaseError`."""
    unit = split_text(text)[1]
    for quantity, own, si in ((PRESSURE, CM, "Pa"), (VOLUME, "ml", "m^3")):
        if unit == own or factor_of(unit, si) is not None:
            return quantity, prescribed(quantity, [text], pascal_in_cm, falls=True).values[0]
    raise CaseError(
        f"{units.brief(text)} is neither a pressure nor a volume; write it like 70 cm, 7 kPa or 40 ml"
        + errors.meant(unit, ["cm", *units.FACTORS["Pa"], *units.FACTORS["m^3"]])
    )


# ----------------------------------------------------------------------------------------------------------------------
# The numbers of a case that a design may vary: of its device, its silicone, and its parts.
#
# Those of the device have their own names (`geometries.actuator.parameter_names`). A number of a part is called by the part's
# table, such as ``fibres.angle``, ``fibres.braid.angle`` or ``region.base.c1``; one of the silicone is ``material.c1``.


MATERIAL = "material"


def variable_names(case: Case) -> dict[str, str]:
    """Return the SI units of all numbers that may vary by their names; angles in degrees, empty units of pure numbers."""
    units = {name: _unit_of(case, name) for name in parameter_names(case.actuator)}
    units |= {f"{MATERIAL}.{name}": unit for name, unit in variable_numbers(case.material).items()}
    return units | {f"{part.key}.{name}": unit for part in case.components for name, unit in part.variable.items()}


def _unit_of(case: Case, name: str) -> str:
    """Return the unit of a device's number; a list's entries are pure numbers unless their kind has a unit."""
    kind = schema.about(case.actuator)[name.partition("[")[0]].kind
    return kind.unit or str(getattr(getattr(kind, "of", None), "unit", ""))


def of_shape(case: Case, name: str) -> bool:
    """Return whether a number decides the device's shape."""
    return "." not in name and name not in case.actuator.ratio_parameters


def value_of(case: Case, name: str) -> float:
    """Return a number's value; `GeometryError` if the device has no such parameter."""
    where, _, own = name.rpartition(".")
    if not where:
        return parameter(case.actuator, name)
    return number_of(case.material, own) if where == MATERIAL else _part(case, where).number(own)


def varied(case: Case, values: Mapping[str, float]) -> Case:
    """Return a case with other values of its numbers; an error of the device, part, material or case if they are invalid."""
    device = {name: value for name, value in values.items() if "." not in name}
    material, components = case.material, {part.key: part for part in case.components}
    for name, value in values.items():
        where, _, own = name.rpartition(".")
        if where == MATERIAL:
            material = with_number(material, own, value)
        elif where:
            components[where] = components[where].varied(own, value)
    actuator = changed(case.actuator, device) if device else case.actuator
    return dataclasses.replace(case, actuator=actuator, material=material, components=tuple(components.values()))


def _part(case: Case, key: str) -> Component:
    return next(part for part in case.components if part.key == key)


def in_equations(case: Case, name: str) -> dict[str, float]:
    """Return the numbers of the equations (`Sensitivity.force`) that a number of no length sets, with their derivatives by
    it."""
    where, _, own = name.rpartition(".")
    if where:
        return {own if where == MATERIAL else name: 1.0}
    value = parameter(case.actuator, name)
    step = 1e-3 * max(abs(value), 1.0)
    ends = [changed(case.actuator, {name: value + sign * step}).ratios for sign in (1.0, -1.0)]
    rates = [(high - low) / (2 * step) for high, low in zip(*ends, strict=True)]
    return {f"{RATIO_PREFIX}.{i}": rate for i, rate in enumerate(rates) if rate}
