"""Materials and parts from and to text: command-line values, TOML tables, names of the library, the user's own modules."""

from __future__ import annotations

import dataclasses
import importlib.util
import os
import re
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, MutableMapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from geometries import Actuator, registry
from geometries.actuator import cavity_roles
from softmodels.case import entries
from softmodels.case.entries import Entry
from softmodels.common import errors, files, names, schema, units
from softmodels.common.arrays import Array
from softmodels.common.names import checked
from softmodels.common.tables import TomlError, read_toml
from softmodels.components import contact, loads
from softmodels.components.contact import BodyContact, Obstacle, RigidShape, Walls
from softmodels.components.fibres import Fabric, Fibres, Sheet
from softmodels.components.loads import Force, Gravity, Mass, Moment
from softmodels.components.rigid import Clamp, Rigid, Spring
from softmodels.materials import laws, silicones, specimens
from softmodels.materials.laws import Material, MaterialError, NeoHookean
from softmodels.materials.memory import Memory
from softmodels.mechanics import component, regions
from softmodels.mechanics.body import Body, cells_within
from softmodels.mechanics.component import Component, ComponentError

DEFAULT = NeoHookean(shear_modulus=30e3)
CONVENTION = "convention"
"""Key of the convention of a law's parameters, if there are several."""
FITTED = "fitted_stretch"
"""Key of the fitted range of stretch."""
MEMORY = "memory"
"""Key of the table of relaxation and softening."""


def material_options_of() -> dict[str, tuple[str, list[str]]]:
    """Return help text and laws of each key of a material's table: fields first, then their alternatives."""
    entries: dict[str, tuple[str, list[str]]] = {}
    for law in laws.LAWS.values():
        for field in laws.parameter_fields(law):
            entries.setdefault(field.name, (field.metadata["help"], []))[1].append(law.name)
    for law in laws.LAWS.values():
        for name, (_, text) in law.alternatives.items():
            entries.setdefault(name, (text, []))[1].append(law.name)
    for law in laws.LAWS.values():
        if law.conventions:
            entries.setdefault(CONVENTION, (law.convention_help, []))[1].append(law.name)
    return entries


def material_from(name: str | None, values: Mapping[str, object]) -> Material:
    """Return the material of a command line, from a law, perhaps with its numbers (``"yeoh:c1=8kPa,c2=90Pa"``), a silicone, a
    TOML file or None for the default law, and parameters as texts with units; `MaterialError` for an unknown name, or a
    parameter that is missing, foreign or impossible."""
    given = {key: value for key, value in values.items() if value is not None}
    if name is None and not given:
        return DEFAULT
    law, own = (DEFAULT.name, {}) if name is None else _with_numbers(name)
    if twice := own.keys() & given.keys():
        raise MaterialError(f"material {name!r} has {min(twice)} already; leave out {registry.flag(min(twice))}")
    given = {**own, **given}
    if named := laws.law_called(law):
        if named[0] is type(DEFAULT) and not {*DEFAULT.parameters, *DEFAULT.alternatives} & set(given):
            given["shear_modulus"] = units.exact_text(DEFAULT.shear_modulus, "Pa")
        return from_table({"law": law, **given})
    if silicone := silicones.silicone_called(law):
        table = to_table(silicone.material)
        if mixed := _mixed(given):
            flags = " and ".join(map(registry.flag, mixed))
            raise MaterialError(
                f"the silicone {law} already defines its law and parameters, which {flags} would mix; leave "
                f"out {flags}, or name a law instead of the silicone, such as --material yeoh"
            )
    elif law.endswith(".toml") or Path(law).is_file():
        return _from_file(law, given)
    else:
        known = errors.known_are(law, [*laws.LAWS, *silicones.PRODUCTS])
        raise MaterialError(f"material {law!r} is neither a law, a silicone nor a TOML file; {known}")
    return from_table({**table, **given})


def _with_numbers(text: str) -> tuple[str, dict[str, object]]:
    """Return the name and the numbers of ``"yeoh:c1=8kPa,c2=90Pa"``; commas within a number's text separate terms."""
    name, separator, numbers = text.partition(":")
    if not separator or Path(text).is_file():
        return text, {}
    own: dict[str, object] = {}
    for part in re.split(r",(?=\s*[\w-]+\s*=)", numbers):
        key, separator, value = part.partition("=")
        if not separator:
            raise MaterialError(f"material {text!r}: {part!r} is not KEY=VALUE; write it like yeoh:c1=8kPa,c2=90Pa")
        own[key.strip().replace("-", "_")] = value.strip()
    return name.strip(), own


def _from_file(file: object, changes: Mapping[str, object]) -> Material:
    """Return the material of a TOML file, such as ``fitted.toml``, optionally with another Poisson's ratio."""
    if not isinstance(file, str) or not file:
        raise MaterialError(f"material file {file!r} is not a file name; write it like file = 'results/fit/fitted.toml'")
    if mixed := _mixed(changes):
        raise MaterialError(
            f"material file {file}: it already defines the law and its parameters; delete {' and '.join(mixed)}, "
            f"or delete the file and name a law"
        )
    try:
        return from_table({**_read_file(Path(file)), **changes})
    except MaterialError as error:
        raise MaterialError(f"material file {file}: {error}") from None


def _read_file(path: Path) -> dict[str, object]:
    try:
        table = read_toml(path)
    except TomlError as error:
        raise MaterialError(f"it {error}") from None
    if not isinstance(table.get("material"), dict):
        raise MaterialError("it has no [material] table")
    return dict(table["material"])


def to_table(material: Material, text: schema.Text = units.exact_text) -> dict[str, object]:
    """Return a material as a TOML table: its law and parameters with units. `from_table` gives back an equal one.

    ``text`` writes the quantities; `softmodels.common.units.readable` is for people.
    """
    table: dict[str, object] = {"law": material.name}
    for field in laws.parameter_fields(material):
        value, unit = getattr(material, field.name), field.metadata["unit"]
        if isinstance(value, tuple):
            table[field.name] = [text(v, unit) if unit else v for v in value]
        else:
            table[field.name] = text(value, unit) if unit else value
    if material.conventions:
        table[CONVENTION] = material.conventions[0]  # the same numbers in the other convention are another rubber
    if material.fitted_stretch is not None:
        table[FITTED] = list(material.fitted_stretch)
    if material.memory is not None:
        table[MEMORY] = material.memory.to_table(text)
    return table


def from_table(table: Mapping[str, object]) -> Material:
    """Return the material of a TOML table: ``law`` (or ``silicone``, or the ``file`` of a fitted one) and its parameters;
    `MaterialError` as `material_from`."""
    values = dict(table)
    if "file" in values:
        return _from_file(values.pop("file"), values)
    if "silicone" in values:
        silicone = values.pop("silicone")
        listed = silicones.silicone_called(silicone) if isinstance(silicone, str) else None
        if listed is None:
            known = errors.known_are(silicone, silicones.PRODUCTS, ", and their sources (softmodels silicones)")
            raise MaterialError(f"silicone {silicone!r} is unknown; {known}")
        if mixed := _mixed(values):
            names = " and ".join(mixed)
            raise MaterialError(
                f"silicone = {silicone!r} already defines its law and parameters, which {names} would mix; delete "
                f"{names} to use the silicone, or delete silicone to use your own law"
            )
        return from_table({**to_table(listed.material), **values})
    if "law" not in values:
        known = f"a law (law = one of {', '.join(laws.LAWS)})"
        raise MaterialError(
            f"the material names neither a silicone (silicone = '{next(iter(silicones.PRODUCTS))}') nor {known} "
            "nor a fitted one "
            "(file = 'fitted.toml')"
        )
    text = values.pop("law")
    named = laws.law_called(text) if isinstance(text, str) else None
    if named is None:
        raise MaterialError(f"law {text!r} is unknown; {errors.known_are(text, laws.LAWS)}")
    (law, terms), name = named, named[0].name
    further: dict[str, object] = {
        FITTED: _range(name, values.pop(FITTED, None)),
        MEMORY: _memory(name, values.pop(MEMORY, None)),
    }
    fields = {field.name: field for field in laws.parameter_fields(law)}
    convention = values.pop(CONVENTION, law.conventions[0]) if law.conventions else ""
    if not isinstance(convention, str) or (convention and convention not in law.conventions):
        raise MaterialError(f"{name}: convention {convention!r} is not one of {', '.join(law.conventions)}")
    parameters: dict[str, float | tuple[float, ...]] = {}
    for key, value in values.items():
        if key in fields:
            about = fields[key].metadata
            parameters[key] = (_many if about["many"] else _number)(name, key, value, about["unit"])
        elif key in law.alternatives:
            parameters[key] = _number(name, key, value, law.alternatives[key][0])
        else:
            raise MaterialError(f"{name} has no parameter {key!r}; it has {', '.join(fields)}")
    if not parameters.keys() & law.alternatives.keys():
        for key, field in fields.items():
            if key not in parameters and field.default is dataclasses.MISSING:
                raise MaterialError(f"{name} needs {key} ({field.metadata['help']}); give it with {registry.flag(key)}")
    made = law.from_values(parameters, convention)
    if terms and made.terms != terms:
        raise MaterialError(f"law {text!r} has {made.terms} terms here; give {terms} values of each of its parameters")
    further = {key: value for key, value in further.items() if value is not None}
    return dataclasses.replace(made, **further) if further else made  # type: ignore[arg-type]


def _memory(law: str, table: object) -> Memory | None:
    try:
        return None if table is None else Memory.from_table(table)
    except errors.FieldError as error:
        raise MaterialError(f"{law}: {error}") from None


def _range(law: str, value: object) -> tuple[float, float] | None:
    if value is None:
        return None
    if not isinstance(value, list | tuple) or len(value) != 2 or not all(isinstance(v, int | float) for v in value):
        raise MaterialError(f"{law}: {FITTED} = {value!r} is not a range of stretch; write it like {FITTED} = [1.02, 3.0]")
    return float(value[0]), float(value[1])


def _mixed(beside: Mapping[str, object]) -> list[str]:
    """Return the keys that conflict with a silicone's name or a material's file: all except Poisson's ratio and memory."""
    return [name for name in beside if name not in ("poisson", MEMORY)]


def _many(law: str, key: str, value: object, unit: str) -> tuple[float, ...]:
    parts = value.split(",") if isinstance(value, str) else value
    return tuple(_number(law, key, part, unit) for part in (parts if isinstance(parts, list | tuple) else [parts]))


def _number(law: str, key: str, value: object, unit: str) -> float:
    try:
        return schema.Quantity(unit).read(f"{law}: {key}", value)
    except errors.FieldError as error:
        raise MaterialError(str(error)) from None


# ----------------------------------------------------------------------------------------------------------------------
# Uncertainty of a material: parameter covariance of a fitted one, or the sources of a named one.


MATERIAL = "material"
"""The cause of errors that the parameters of a material have."""


def _roots(covariance: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    size = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(size, size))
    return np.asarray(size[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))


@checked
@dataclasses.dataclass(frozen=True)
class MaterialErrors:
    """The uncertainty of a fitted material: the covariance of its law's n parameters, SI units, n rows of n numbers, a clause
    on where it comes from, and the material around which they were found, if that is known."""

    names: tuple[str, ...]
    covariance: tuple[tuple[float, ...], ...]
    how: str = dataclasses.field(default="", compare=False, repr=False)
    around: Material | None = dataclasses.field(default=None, compare=False, repr=False)

    @property
    def matrix(self) -> npt.NDArray[np.float64]:
        """The covariance, shape (n, n)."""
        return names.read_only(np.array(self.covariance))

    @property
    def roots(self) -> npt.NDArray[np.float64]:
        """Independent parameter changes of one standard deviation each, shape (n, m)."""
        return names.read_only(_roots(self.matrix))

    @property
    def by_cause(self) -> dict[str, npt.NDArray[np.float64]]:
        """The same by cause, ``"material"`` and `laws.FORM`, shape (n, m) each; what changes with the law's form is its."""
        form = next((name for name in self.names if name in laws.FORM_ENERGIES), "")
        if not form:
            return {MATERIAL: self.roots}
        k = self.names.index(form)
        along = self.matrix[:, k : k + 1] / np.sqrt(self.matrix[k, k])
        rest = np.delete(np.delete(self.matrix - along @ along.T, k, 0), k, 1)
        return {MATERIAL: names.read_only(np.insert(_roots(rest), k, 0.0, axis=0)), laws.FORM: names.read_only(along)}

    @property
    def directions(self) -> list[tuple[str, tuple[tuple[str, float], ...]]]:
        """Independent changes of one standard deviation each: their cause, and by how much each parameter changes."""
        return [
            (cause, tuple(zip(self.names, root, strict=True)))
            for cause, roots in self.by_cause.items()
            for root in roots.T.tolist()
        ]

    @classmethod
    def from_file(cls, path: Path) -> MaterialErrors:
        """From ``fitted.toml``; with ``fit.json`` beside it the full covariance, else only that of the 95 % intervals.
        `MaterialError` without a fit or errors."""
        try:
            tables = read_toml(path)
        except TomlError as error:
            raise MaterialError(f"the fitted material {path} {error}") from None
        fit = tables.get("fit")
        if not isinstance(fit, dict) or not isinstance(tables.get("material"), dict):
            raise MaterialError(f"{path} contains no fit; give the fitted.toml written by softmodels fit")
        try:
            fitted = from_table(tables["material"])
        except MaterialError as error:
            raise MaterialError(f"{path}: {error}") from None
        known = next(filter(None, (cls.of_fit(fitted, *told) for told in _told(path, fitted, fit))), None)
        if known is None:
            raise MaterialError(f"{path} has no errors of the numbers of {fitted.name}; a fit with free parameters is needed")
        return known

    @classmethod
    def beside(cls, material: str) -> MaterialErrors | None:
        """From the file that a material is given by, if it is that of a fit with errors; None for names and other files."""
        try:
            return cls.from_file(path) if (path := Path(material)).is_file() else None
        except MaterialError:
            return None

    @classmethod
    def of_fit(
        cls, material: Material, free: Sequence[str], covariance: Array, values: Mapping[str, float], how: str
    ) -> MaterialErrors | None:
        """From the covariance of a fit's free parameters, and its values; of bench parameters, and of a memory's numbers that
        ended at a bound, there is nothing. None if nothing is left, or it is not finite."""
        from softmodels.mechanics import sensitivity

        law, memory = sensitivity.known_parameters(material), _memory_names(material, values)
        known = {**memory, **{name: name for name in (*law, *laws.FORM_ENERGIES)}}
        at_bound = {name for k, name in enumerate(free) if name in memory and not np.isfinite(covariance[k, k])}
        kept = [k for k, name in enumerate(free) if name in known and name not in at_bound]
        rows = covariance[np.ix_(kept, kept)]
        if not {free[k] for k in kept} - {*laws.FORM_ENERGIES} or not np.isfinite(rows).all():
            return None
        return cls(tuple(known[free[k]] for k in kept), tuple(map(tuple, rows.tolist())), how, material)

    def check(self, material: Material) -> None:
        """Raise `MaterialError` for errors of another material, or an invalid covariance."""
        if self.around is not None and self.around != material:
            raise MaterialError(
                f"the errors ({self.how}) belong to another material than the case's; use the fitted "
                "material there too: file = ... in [material], or --material"
            )
        from softmodels.mechanics import sensitivity

        known = (*sensitivity.known_parameters(material), *sensitivity.memory_parameters(material), *laws.FORM_ENERGIES)
        if unknown := [name for name in self.names if name not in known]:
            raise MaterialError(f"errors of {unknown[0]} are given, but {material.name} has no such parameter")
        square = len(self.names) > 0 and all(len(row) == len(self.names) for row in self.covariance)
        matrix = self.matrix if square and len(self.covariance) == len(self.names) else np.full((1, 1), np.nan)
        if not np.isfinite(matrix).all() or (np.diag(matrix) <= 0.0).any() or not np.allclose(matrix, matrix.T):
            raise MaterialError(
                "the covariance is invalid; it must be finite and symmetric, with positive variances and a row per parameter"
            )


@dataclasses.dataclass(frozen=True)
class SourceBand:
    """The sources of a silicone named without a source; the case is solved with each."""

    product: str

    def __post_init__(self) -> None:
        if self.product not in silicones.PRODUCTS:
            raise MaterialError(f"silicone {self.product!r} is unknown; known are {', '.join(silicones.PRODUCTS)}")
        if not silicones.spanning(self.product):
            raise MaterialError(
                f"{self.product} has only one source, so no band over sources exists; leave out --band, or fit your own cast"
            )

    @property
    def how(self) -> str:
        """Its description, as a clause."""
        return f"the sources of {self.product}"

    def check(self, material: Material) -> None:
        """Raise `MaterialError` for a material that is none of the sources."""
        name = silicones.named(material)
        if name is None or silicones.product_of(name) != self.product:
            raise MaterialError(
                f"the band is over the sources of {self.product}, but the case's material is none of "
                f"them; use that silicone (--material {self.product}), or leave out --band"
            )

    def others(self, material: Material) -> dict[str, Material]:
        """Return the other sources by name, from the softest to the stiffest, with a material's own Poisson's ratio."""
        own = silicones.named(material)
        names = [name for name in silicones.source_names(self.product) if name != own]
        by_name = {name: silicones.silicone_called(name) for name in names}
        return {
            name: dataclasses.replace(silicone.material, poisson=material.poisson)  # type: ignore[call-arg]
            for name, silicone in by_name.items()
            if silicone is not None
        }


type AnyBand = MaterialErrors | SourceBand


def band_of(text: str | Path) -> AnyBand:
    """Return the band of a silicone's sources by its name, or of a fitted material by its ``fitted.toml``; else
    `MaterialError`."""
    if silicones.silicone_called(str(text)) is not None:
        return SourceBand(silicones.product_of(str(text)))
    return MaterialErrors.from_file(Path(text))


def _memory_names(material: Material, values: Mapping[str, float]) -> dict[str, str]:
    """Return what a material calls the numbers of its memory, by what a fit calls them, of whose values it is made: a fit has
    ``share_10s`` of a time that it does not fit, and branches of no share, which the material leaves out."""
    from softmodels.mechanics import sensitivity

    own = material.memory
    called = {name: name for name in sensitivity.memory_parameters(material)}
    numbers = [name.removeprefix("time") for name in values if re.fullmatch(r"time\d+", name)]
    for k, branch in enumerate(own.branches if own else (), 1):
        called[f"share_{branch.time:g}s"] = f"share{k}"
        same = (n for n in numbers if (values[f"share{n}"], values[f"time{n}"]) == (branch.share, branch.time))
        if number := next(same, None):
            called |= {f"share{number}": f"share{k}", f"time{number}": f"time{k}"}
    return called


type FitErrors = tuple[tuple[str, ...], npt.NDArray[np.float64], Mapping[str, float], str]
"""Free parameters of a fit, their covariance, all values, and a clause on where they come from."""


def _told(path: Path, fitted: Material, fit: Mapping[str, object]) -> Iterator[FitErrors]:
    """Yield what is known of a fitted material's errors, the best first."""
    if (whole := _whole(path, fitted)) is not None:
        yield whole
    yield _intervals(path, fit)


def _whole(path: Path, fitted: Material) -> FitErrors | None:
    """Return what the ``fit.json`` beside a fitted material says; None if there is none.

    Of several laws it is the one with the material's own numbers: fits call a sum of one term ``ogden1``, materials ``ogden``.
    """
    try:
        laws = files.read_json(path.with_name("fit.json"))["laws"]
        told = [law for law in laws if "material" in law]
        same = (law for law in told if from_table(law["material"]) == fitted)
        chosen = next(same, None) or next(law for law in laws if law["law"] == fitted.name)
        covariance = np.array(chosen["covariance"], dtype=float)
        names = tuple(map(str, chosen["free"]))
        values = {str(p["name"]): float(p["value"]) for p in chosen.get("parameters", ())}
    except (OSError, ValueError, KeyError, TypeError, StopIteration, MaterialError):
        return None
    if covariance.shape != (len(names), len(names)):
        return None
    return names, covariance, values, f"covariance of {path.with_name('fit.json')}"


def _intervals(path: Path, fit: Mapping[str, object]) -> FitErrors:
    given = fit.get("intervals_95")
    intervals = given if isinstance(given, dict) else {}
    try:
        widths = {str(name): float(high) - float(low) for name, (low, high) in intervals.items()}
    except (TypeError, ValueError):
        raise MaterialError(f"{path}: the intervals of the fit cannot be read") from None
    if not widths or not all(0.0 < width < np.inf for width in widths.values()):
        raise MaterialError(f"{path} has no finite 95 % intervals, so the material's errors are unknown")
    sigma = np.array(list(widths.values())) / (2 * units.HALF_WIDTH_95)
    return tuple(widths), np.diag(sigma**2), {}, f"95 % intervals of {path}, as if they were independent"


class ErrorsEntry(Entry[AnyBand | None]):
    """The table ``[band]``: a fitted material's ``file``, its ``parameters`` and their ``covariance``, or a ``silicone``."""

    tables = ("band",)

    def read(self, tables: entries.Tables) -> AnyBand | entries.Missing:
        if "band" not in tables:
            return entries.MISSING
        table = entries.table_of(tables, "band")
        if unknown := set(table) - {"file", "parameters", "covariance", "silicone"}:
            raise errors.FieldError(
                f"[band] has an unknown entry {min(unknown)!r}; known are file, parameters, covariance, silicone"
            )
        if isinstance(silicone := table.get("silicone"), str) and set(table) == {"silicone"}:
            return SourceBand(silicones.product_of(silicone))
        file = table.get("file")
        if isinstance(file, str) and set(table) == {"file"}:
            return MaterialErrors.from_file(Path(file))
        names, rows = table.get("parameters"), table.get("covariance")
        try:
            covariance = tuple(tuple(float(value) for value in row) for row in rows)  # type: ignore[attr-defined, union-attr]
            return MaterialErrors(tuple(map(str, names)), covariance, "[band] of the case")  # type: ignore[call-overload]
        except (TypeError, ValueError):
            raise errors.FieldError(
                "[band] needs a fitted material (file = 'results/fit/fitted.toml'), parameters and their covariance in SI, "
                "or the sources of a silicone (silicone = 'ecoflex-00-30')"
            ) from None

    def write(self, value: AnyBand | None, text: schema.Text) -> entries.Written:
        if value is None:
            return {}
        if isinstance(value, SourceBand):
            return {"band": {"silicone": value.product}}
        return {"band": {"parameters": list(value.names), "covariance": [list(row) for row in value.covariance]}}

    def options(self) -> Iterator[entries.Option]:
        text = (
            "fitted.toml of a fitted material: adds the 95 % band from its errors to path.csv and the curves; or a "
            "silicone's name: each of its sources is solved, and the curves show the band they span"
        )
        yield entries.Option("band", schema.About(schema.Words(), text), None, "FILE|NAME")

    def arguments(self, field: str) -> dict[str, str]:
        return {"band": "band='fitted.toml', or a silicone's name"}

    def take(self, options: MutableMapping[str, object]) -> AnyBand | entries.Missing:
        given = options.pop("band", None)
        return entries.MISSING if given is None else band_of(str(given))


# ----------------------------------------------------------------------------------------------------------------------
# Regions with another material: a table ``[region.NAME]`` with the entries of ``[material]`` and a density.


DENSITY = schema.Quantity("kg/m^3")
MODULI = (laws.MIN_SHEAR_MODULUS, 1e12)
"""Accepted shear moduli of a region in Pa, from the softest gels to hard metals."""


@component.register_component
@dataclasses.dataclass(frozen=True)
class Region(regions.RegionPart):
    """A region in another material, bonded to its neighbours.

    Attributes:
        material: Its law and parameters.
        density: In kg/m3; if None that of the named silicone's data sheet, or else of `softmodels.components.loads.Gravity`.
        within: Condition of its cells' middles, such as ``"8 mm < r < 10 mm"``, instead of the name of a region of the device.
        name: Physical group of its cells, one of `Actuator.regions`; with ``within`` any name.

    Raises:
        ComponentError: No name, or a density that no solid has.
        MaterialError: A material that is stiffer or softer than any, or not stable at rest.
    """

    density: float | None = None
    within: str = ""

    table: ClassVar[str] = "region"

    def check(self) -> None:
        if not self.name:
            raise ComponentError("[region] has no name; write it as [region.base], where base is a region of the device")
        mu = self.material.shear_modulus_0
        if not MODULI[0] <= mu <= MODULI[1]:
            raise self.error(
                f"the shear modulus is {mu:.4g} Pa; {MODULI[0]:g} to {MODULI[1]:g} Pa are accepted, "
                f"so check the units of its parameters"
            )
        specimens.check_rest(self.material)
        if self.density is not None:
            density = DENSITY.settled(f"{self.where} density", self.density)
            loads.check_density(density, self.where)
            object.__setattr__(self, "density", density)

    def check_on(self, actuator: Actuator) -> None:
        if self.within:
            component.check_condition(self.where, self.within, actuator)
        else:
            super().check_on(actuator)

    def cells(self, body: Body) -> npt.NDArray[np.int32]:
        if not self.within:
            return super().cells(body)
        try:
            return cells_within(body.mesh, body.actuator, self.within)
        except ComponentError as error:
            raise self.error(f"within = {error}") from None

    @property
    def own_density(self) -> float | None:
        sheet = silicones.sheet_of(self.material)
        return self.density if self.density is not None else sheet.density if sheet else None

    @classmethod
    def read_table(cls, name: str, table: Mapping[str, object]) -> Region:
        law = {key: value for key, value in table.items() if key not in ("density", "within")}
        given = table.get("density")
        density = None if given is None else DENSITY.read(f"[region.{name}] density", given)
        return cls(
            from_table(law),
            density,
            schema.Words().settled(f"[region.{name}] within", table.get("within", "")),
            name=name,
        )

    def write_table(self, text: schema.Text) -> dict[str, object]:
        density = {} if self.density is None else {"density": text(self.density, DENSITY.unit)}
        return {**to_table(self.material, text), **density, **({"within": self.within} if self.within else {})}

    @property
    def explained(self) -> Mapping[str, str]:
        law = {field.name: field.metadata["help"] for field in laws.parameter_fields(self.material)}
        return {
            **law,
            "density": "density of the region; default: from its silicone's data sheet, or that of [gravity]",
            "within": "its cells by their middles, such as 8 mm < r < 10 mm; default: the device's region of this name",
        }

    @property
    def label(self) -> str:
        """Label with its kind, because a clamp or fibres may have the same name."""
        return f"region_{self.name}"


# ----------------------------------------------------------------------------------------------------------------------
# Entries for the parts of a case: tables ``[kind]`` or ``[kind.name]`` of each registered kind; the user's own modules.


Parts = tuple[Component, ...]


component.COMPONENTS.put_first(
    (
        Gravity,
        Mass,
        Force,
        Moment,
        Region,
        RigidShape,
        BodyContact,
        Obstacle,
        Walls,
        Sheet,
        Fibres,
        Fabric,
        Rigid,
        Clamp,
        Spring,
    )
)  # the order of a case's tables and options


class PartsEntry(Entry[Parts]):
    """The components of the device."""

    @property
    def tables(self) -> tuple[str, ...]:  # type: ignore[override]
        return tuple(dict.fromkeys(kind.table for kind in component.COMPONENTS.values()))

    def read(self, tables: entries.Tables) -> Parts | entries.Missing:
        parts = [part for kind in component.COMPONENTS.values() if kind.table in tables for part in _of_table(kind, tables)]
        return tuple(parts) or entries.MISSING

    def write(self, value: Parts, text: schema.Text) -> entries.Written:
        written: dict[str, dict[str, object]] = {}
        for part in value:
            table = written.setdefault(part.table, {})
            (table.setdefault(part.name, {}) if part.name else table).update(part.write_table(text))  # type: ignore[attr-defined]
        return written

    def options(self) -> Iterator[entries.Option]:
        for kind in _optional():
            defaults = {field.name: field.default for field in dataclasses.fields(kind)}
            for name, option in _options(kind).items():
                field = schema.about(kind)[name]
                default = None if defaults[name] is dataclasses.MISSING else defaults[name]
                yield entries.Option(option, field, default, name.upper() if isinstance(field.kind, schema.Words) else None)

    def arguments(self, field: str) -> dict[str, str]:
        return {option: f"{kind.__name__}.{name}" for kind in _optional() for name, option in _options(kind).items()}

    def take(self, options: MutableMapping[str, object]) -> Parts | entries.Missing:
        parts = []
        for kind in _optional():
            given = {name: options.pop(option, None) for name, option in _options(kind).items()}
            table = {name: value for name, value in given.items() if value is not None}
            if table:
                kind.check_required("", table)
                parts.append(kind(**table))  # type: ignore[arg-type]
        return tuple(parts) or entries.MISSING


def _optional() -> list[type[Component]]:
    """Return the kinds of parts that command lines have options for."""
    return [kind for kind in component.COMPONENTS.values() if kind.optional]


def _options(kind: type[Component]) -> dict[str, str]:
    """Return the options by field."""
    first, *others = schema.about(kind)
    return {first: kind.table, **{name: f"{kind.table}_{name}" for name in others}}


def _of_table(kind: type[Component], tables: entries.Tables) -> list[Component]:
    table = entries.table_of(tables, kind.table)
    if kind.always_named:
        others = {other.distinct for other in component.COMPONENTS.values() if other.table == kind.table} - {"", kind.distinct}
        own_tables = {name: entries.table_of(table, name) for name, value in table.items() if isinstance(value, Mapping)}
        return [
            kind.read_table(name, own)
            for name, own in own_tables.items()
            if kind.distinct in (*own, "") and not others & own.keys()
        ]
    if f"{kind.table}." in component.COMPONENTS:  # tables with a name are of another kind
        own = {key: value for key, value in table.items() if not isinstance(value, Mapping)}
        return [kind.read_table("", own)] if own or not table else []
    named = [isinstance(value, Mapping) for value in table.values()]
    if not any(named):
        return [kind.read_table("", table)]
    if not all(named):
        raise errors.FieldError(
            f"[{kind.table}] mixes entries with [{kind.table}.name] tables; put each {kind.table} in a named table"
        )
    return [kind.read_table(name, entries.table_of(table, name)) for name in table]


def with_walls(components: Sequence[Component], actuator: Actuator, draws: bool) -> Parts:
    """Return the parts of a case, with self-contact of walls unless it is disabled; if air is drawn out, the cavities' own
    walls may touch too."""
    inside = cavity_roles(actuator) if draws else []
    if (actuator.meeting == () and not inside) or any(isinstance(part, Walls) for part in components):
        return tuple(components)
    kinds = list(component.COMPONENTS.values())
    behind = kinds[kinds.index(Walls) + 1 :]
    at = next((number for number, part in enumerate(components) if type(part) in behind), len(components))
    return (*components[:at], Walls(", ".join([contact.AUTO, *inside])), *components[at:])  # as read from a case file


def without_walls(components: Sequence[Component]) -> Parts:
    """Return the parts without the default self-contact, for designs and decks."""
    return tuple(Walls("none") if isinstance(part, Walls) and part.automatic else part for part in components)


def check_parts(components: Sequence[Component], actuator: Actuator) -> None:
    """Raise `ComponentError` for parts unsuitable for the device, or with duplicate names."""
    twice = [label for label, count in Counter(part.label for part in components).items() if count > 1]
    if twice:
        raise ComponentError(f"several parts are called {twice[0]}; give each its own name, which is used in its columns")
    gravity = component.gravity_of(components)
    for part in components:
        if part.weighs and not gravity.any():
            raise ComponentError(f"{part.where} has a mass, but gravity has no direction; add it ([gravity], --gravity -z)")
        part.check_under(gravity)
        part.check_on(actuator)


# ----------------------------------------------------------------------------------------------------------------------
# Import user-defined devices, laws, supplies and parts, for commands and their child processes.
#
# A script that defines and runs a device does not need this. A command such as ``softmodels run case.toml`` knows only
# the library's classes; the environment variable `errors.OWN_MODULES` names the Python files to import first.


class OwnModuleError(ValueError):
    """A file cannot be imported; the message is for the user."""


def import_own_modules() -> None:
    """Import the files that `errors.OWN_MODULES` names, each once; `OwnModuleError` if one is no Python file, or raises an
    exception."""
    for text in filter(None, os.environ.get(errors.OWN_MODULES, "").split(os.pathsep)):
        path = Path(text).resolve()
        if path not in map(_file, list(sys.modules.values())):
            _import(path)


def own_modules(*things: object) -> str:
    """Return the value of `errors.OWN_MODULES` with which another process can import the classes of these objects and their
    contents.

    So it does what their fields name (`Component.looked_up`).
    """
    names = {value.__module__: None for value in _within(things)}
    files = [_file(sys.modules.get(name)) for name in names if name.split(".")[0] not in errors.OWN_PACKAGES]
    named = filter(None, os.environ.get(errors.OWN_MODULES, "").split(os.pathsep))
    return os.pathsep.join(dict.fromkeys([*named, *(str(file) for file in files if file is not None)]))


def _within(value: object) -> Iterator[object]:
    """Yield the frozen dataclasses in a value: a case, its device, its parts, their materials; and what parts name."""
    if isinstance(value, tuple | list):
        for part in value:
            yield from _within(part)
    elif dataclasses.is_dataclass(value):
        yield value
        for field in dataclasses.fields(value):
            yield from _within(getattr(value, field.name))
        if isinstance(value, Component):
            yield from value.looked_up


def _file(module: ModuleType | None) -> Path | None:
    file = getattr(module, "__file__", None)
    return Path(file).resolve() if isinstance(file, str) else None


def _import(path: Path) -> None:
    spec = importlib.util.spec_from_file_location(path.stem, path) if path.is_file() else None
    if spec is None or spec.loader is None:
        raise OwnModuleError(f"{errors.OWN_MODULES} names {path}, which is not a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module  # dataclasses look up their module
    if str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))  # the meshing process gets this list and imports it by name
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        del sys.modules[path.stem]
        raise OwnModuleError(f"{path}, which {errors.OWN_MODULES} names, cannot be imported ({error!r})") from error
