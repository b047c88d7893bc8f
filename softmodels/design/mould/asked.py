"""What a mould is asked for: a device, its silicone by name, a workshop; from Python, or from a case file."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomli_w

from geometries import Actuator
from geometries.codec import from_table, to_table
from geometries.errors import FieldError
from geometries.table import to_table as device_table
from measurement.toml_file import TomlError, read_toml
from measurement.units import brief
from measurement.wording import known_are
from softmodels.case.case import Case, CaseError
from softmodels.design.mould.settings import MouldError, Workshop
from softmodels.materials.casting import CASTING, Casting, casting_of
from softmodels.materials.silicones import named
from softmodels.materials.spread import product_of


@dataclasses.dataclass(frozen=True)
class Asked:
    """A mould that is asked for.

    Attributes:
        device: The device.
        workshop: How its mould is made.
        silicone: Name of the product that is cast; empty if it is not known.
        name: Of the case; names the folder.
    """

    device: Actuator
    workshop: Workshop
    silicone: str
    name: str

    @property
    def casting(self) -> Casting | None:
        """What the maker's sheet says of the silicone; None if it is not in the table."""
        return casting_of(self.silicone)

    def to_toml(self) -> str:
        """Text of a file that asks for the same again."""
        silicone = {"silicone": self.silicone} if self.silicone else {}
        return tomli_w.dumps(
            {"name": self.name, "geometry": device_table(self.device), "mould": {**silicone, **to_table(self.workshop)}}
        )


def asked_of(device: Actuator | Case | str | Path, silicone: str | None = None, **settings: object) -> Asked:
    """What is asked for, from Python.

    Args:
        device: A device, a case, or a case file, whose table ``[mould]`` holds settings too.
        silicone: Name of the product that is cast; the case's if not given.
        settings: Fields of `Workshop`: numbers in SI units (angles in degrees), or texts with a unit.

    Raises:
        MouldError, CaseError: What cannot be meant.
    """
    if isinstance(device, Actuator):
        return _asked(device, device.stem, None, {}, silicone, settings)
    if isinstance(device, Case):
        return _asked(device.actuator, device.name, device, {}, silicone, settings)
    if not isinstance(device, str | Path):
        raise MouldError(f"a mould is made of a device, a case or a case file, and not of {brief(device)}")
    case, table = _read(Path(device))
    try:
        return _asked(case.actuator, case.name, case, table, silicone, settings)
    except MouldError as error:
        raise MouldError(f"{device}: {error}") from None


def _asked(
    device: Actuator,
    name: str,
    case: Case | None,
    table: Mapping[str, object],
    silicone: str | None,
    settings: Mapping[str, object],
) -> Asked:
    given = {key: value for key, value in settings.items() if value is not None}
    table = dict(table)
    product = _product(silicone if silicone is not None else table.pop("silicone", None), case)
    table.pop("silicone", None)
    casting = casting_of(product)
    values: dict[str, Any] = {"shrinkage": casting.shrinkage} if casting and casting.shrinkage else {}
    try:
        values |= from_table(Workshop, table, "[mould]")
    except FieldError as error:
        raise MouldError(str(error)) from None
    unknown = given.keys() - {field.name for field in dataclasses.fields(Workshop)}
    if unknown:
        raise MouldError(
            f"{min(unknown)!r} is no setting of a mould; {known_are(min(unknown), sorted(Workshop.__dataclass_fields__))}"
        )
    values |= given
    return Asked(device, Workshop(**values), product, name)


def _product(name: object, case: Case | None) -> str:
    """The silicone's product: the one asked for, or the case's if its material is a named one.

    Raises:
        MouldError: There is none of that name.
    """
    if name is None:
        material = named(case.material) if case else None
        return product_of(material) if material else ""
    product = product_of(name) if isinstance(name, str) else ""
    if product not in CASTING:
        raise MouldError(f"silicone {brief(name)} is unknown; {known_are(name, CASTING)}")
    return product


def _read(file: Path) -> tuple[Case, dict[str, object]]:
    """A case file and its table ``[mould]``; a load is not asked for.

    Raises:
        CaseError, MouldError: It cannot be read, or is none.
    """
    try:
        tables = read_toml(file)
    except TomlError as error:
        raise CaseError(f"case file {file} {error}") from None
    table = tables.pop("mould", {})
    if not isinstance(table, dict):
        raise MouldError(f"{file}: mould is {table!r}; it must be a table, which begins with a line [mould]")
    try:
        return Case.from_toml(tomli_w.dumps({"load": {"pressure_cm": [1.0]}, **tables}), file.parent), table
    except CaseError as error:
        raise CaseError(f"{file}: {error}") from None
