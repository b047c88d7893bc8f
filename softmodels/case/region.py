"""A region of a device in a material of its own, as a table ``[region.NAME]`` with the entries of ``[material]``."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import ClassVar

from geometries.kinds import Text
from softmodels.case import material_table
from softmodels.materials.stability import check_rest
from softmodels.mechanics.parts import PartError, register_part
from softmodels.mechanics.regions import RegionPart

MODULI = (500.0, 1e12)
"""Shear moduli in Pa that a region can have, from the softest gels to hard metals."""


@register_part
@dataclasses.dataclass(frozen=True)
class Region(RegionPart):
    """A region in another material, bonded to its neighbours.

    Attributes:
        material: Its law and parameters.
        name: Physical group of its cells, one of `Actuator.regions`.

    Raises:
        PartError: No name.
        MaterialError: A material that is stiffer or softer than any, or not stable at rest.
    """

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

    @classmethod
    def read_table(cls, name: str, table: Mapping[str, object]) -> Region:
        return cls(material_table.from_table(table), name=name)

    def write_table(self, text: Text) -> dict[str, object]:
        return material_table.to_table(self.material, text)

    @property
    def explained(self) -> Mapping[str, str]:
        return {field.name: field.metadata["help"] for field in dataclasses.fields(self.material)}

    @property
    def label(self) -> str:
        """Not its name alone, which a hold or fibres in it may bear too."""
        return f"region_{self.name}"
