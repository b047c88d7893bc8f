"""Materials that a case cannot be meant to have, or that its formulation cannot take."""

from __future__ import annotations

import math
from collections.abc import Sequence

from softmodels.case.errors import CaseError
from softmodels.materials.material import SOFTEST, Material
from softmodels.mechanics.parts import Part
from softmodels.mechanics.regions import RegionPart

MODULI = (SOFTEST, 5e6)
"""Shear moduli in Pa that a silicone can have, from the softest gels to the hardest rubbers, with room on both sides."""
MOST_APART = 1e6
"""Shear modulus of a region over the main one's up to which the equations are solved to their usual digits."""


def check_materials(material: Material, parts: Sequence[Part], formulation: str) -> None:
    """Refuse a material that the formulation cannot take, or whose numbers are of another unit.

    Args:
        material: The main one.
        parts: What is added, regions in other materials among it.
        formulation: ``mixed`` or ``displacement``.

    Raises:
        CaseError: Which, and why.
    """
    mu = material.shear_modulus_0
    if not MODULI[0] <= mu <= MODULI[1]:
        raise CaseError(
            f"the material's shear modulus is {mu:.4g} Pa; silicones have 5 to 500 kPa, so check the units of its "
            f"parameters ({MODULI[0] / 1e3:g} to {MODULI[1] / 1e3:g} kPa are taken)"
        )
    _check_volume("", material, formulation)
    for part in parts:
        if isinstance(part, RegionPart):
            _check_volume(f"{part.where}: ", part.material, formulation)
            apart = part.material.shear_modulus_0 / mu
            if not 1 / MOST_APART <= apart <= MOST_APART:
                raise CaseError(
                    f"{part.where}: its shear modulus is {apart:.3g} times the main material's, and {1 / MOST_APART:g} to "
                    f"{MOST_APART:g} times are solved; what is stiffer keeps its shape, and is better made a rigid part"
                )


def _check_volume(where: str, material: Material, formulation: str) -> None:
    if formulation == "displacement" and math.isinf(material.bulk):
        raise CaseError(
            f"{where}poisson = 0.5 is incompressible and needs the mixed formulation; use --formulation mixed, or "
            "--poisson 0.49"
        )
    if formulation == "mixed" and material.bulk <= 0.0:
        raise CaseError(
            f"{where}poisson = {material.poisson:g} leaves {material.name} no stiffness of volume, which the mixed "
            "formulation divides by; use --formulation displacement"
        )
