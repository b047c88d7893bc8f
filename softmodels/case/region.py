"""A region of a device in a material of its own: a table ``[region.NAME]`` with the entries of ``[material]`` and a density."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import ClassVar

from geometries.kinds import Quantity, Text
from softmodels.case import material_table
from softmodels.materials.casting import sheet_of
from softmodels.materials.material import SOFTEST, parameter_fields
from softmodels.materials.stability import check_rest
from softmodels.mechanics.loads import check_density
from softmodels.mechanics.parts import PartError, register_part
from softmodels.mechanics.regions import RegionPart

DENSITY = Quantity("kg/m^3")
MODULI = (SOFTEST, 1e12)
"""Shear moduli in Pa that a region can have, from the softest gels to hard metals."""


@register_part
@dataclasses.dataclass(frozen=True)
class Region(RegionPart):
    """A region in another material, bonded to its neighbours.

    Attributes:
        material: Its law and parameters.
        density: In kg/m3; if None that of the named silicone's data sheet, or else of `softmodels.mechanics.loads.Gravity`.
        name: Physical group of its cells, one of `Actuator.regions`.

    Raises:
        PartError: No name, or a density that no solid has.
        MaterialError: A material that is stiffer or softer than any, or not stable at rest.
    """

    density: float | None = None

    table: ClassVar[str] = "region"

    def check(self) -> None:
        if not self.name:
            raise PartError("[region] has no name; write it as [region.base], where base is a region of the device")
        mu = self.material.shear_modulus_0
        if not MODULI[0] <= mu <= MODULI[1]:
            raise PartError(
                f"{self.where}: the shear modulus is {mu:.4g} Pa, and {MODULI[0]:g} to {MODULI[1]:g} Pa are taken; check "
                "the units of its parameters"
            )
        check_rest(self.material)
        if self.density is not None:
            density = DENSITY.settled(f"{self.where} density", self.density)
            check_density(density, self.where)
            object.__setattr__(self, "density", density)

    @property
    def own_density(self) -> float | None:
        sheet = sheet_of(self.material)
        return self.density if self.density is not None else sheet.density if sheet else None

    @classmethod
    def read_table(cls, name: str, table: Mapping[str, object]) -> Region:
        law = {key: value for key, value in table.items() if key != "density"}
        given = table.get("density")
        density = None if given is None else DENSITY.read(f"[region.{name}] density", given)
        return cls(material_table.from_table(law), density, name=name)

    def write_table(self, text: Text) -> dict[str, object]:
        density = {} if self.density is None else {"density": text(self.density, DENSITY.unit)}
        return {**material_table.to_table(self.material, text), **density}

    @property
    def explained(self) -> Mapping[str, str]:
        law = {field.name: field.metadata["help"] for field in parameter_fields(self.material)}
        return {
            **law,
            "density": "density of the region; by its silicone's data sheet, or that of [gravity], if left out",
        }

    @property
    def label(self) -> str:
        """Not its name alone, which a hold or fibres in it may bear too."""
        return f"region_{self.name}"
