"""A silicone of a deck and the regions that it fills."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable

from softmodels.case.errors import CaseError
from softmodels.case.region import Region
from softmodels.materials.material import Material

MAIN = "silicone"
"""Name of the case's own material, if no region has it."""


@dataclasses.dataclass(frozen=True)
class Silicone:
    """A material.

    Attributes:
        name: What the deck calls it.
        material: Law and parameters.
        regions: Regions of the mesh that it fills.
    """

    name: str
    material: Material
    regions: tuple[str, ...]

    @property
    def invariant_terms(self) -> dict[tuple[int, int], float]:
        """The law's factors in Pa of (I1_bar - 3)^i (I2_bar - 3)^j."""
        return dict(self.material.invariant_terms)

    @property
    def bulk(self) -> float:
        """Bulk modulus in Pa."""
        # Not `Material.bulk`, which is Lame's first constant where the shape part resists it too.
        nu = self.material.poisson
        return 2 * self.material.shear_modulus_0 * (1 + nu) / (3 * (1 - 2 * nu))

    @property
    def remarks(self) -> list[str]:
        """What a reader has to know of it, sentences."""
        found = [
            f"{self.name}: {self.material}",
            f"{self.name}: energy of the isochoric stretches' shape + K/2 (J - 1)^2, K = {self.bulk:.6g} Pa",
        ]
        if not self.material.isochoric:
            found.append(
                f"{self.material.name}: softmodels' energy is of the whole stretches, this one of the isochoric ones; they are "
                "the same as Poisson's ratio goes to 0.5"
            )
        return found

    def check(self, where: str) -> None:
        """Refuse a law that no deck has.

        Args:
            where: What a sentence begins with.

        Raises:
            CaseError: It is one.
        """
        material = self.material
        if not (material.invariant_terms or material.stretch_terms):
            raise CaseError(
                f"{where}{material.name} is a law that neither CalculiX nor FEBio has; fit or name one of Mooney-Rivlin, Yeoh "
                "or Ogden"
            )
        if math.isinf(material.bulk):
            raise CaseError(
                f"{where}poisson = 0.5 is incompressible and the decks' cells have displacements alone; take poisson = 0.49 in "
                "both"
            )


def silicones_of(material: Material, parts: Iterable[object], regions: Iterable[str]) -> tuple[Silicone, ...]:
    """The materials of a device, its main one first, which fills what no part names.

    Args:
        material: The main one.
        parts: What is added to the device.
        regions: Those of its mesh.
    """
    others = [Silicone(part.name, part.material, (part.name,)) for part in parts if isinstance(part, Region)]
    named = {one.name for one in others}
    main = f"main_{MAIN}" if MAIN in named else MAIN
    return (Silicone(main, material, tuple(name for name in regions if name not in named)), *others)
