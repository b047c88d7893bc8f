"""How named silicones are mixed and cured, from their makers' data sheets: what a workshop needs beside the law.

Figures are the makers' typical values at 23 C. What is not known here has to be read from the sheet that came with the batch.
"""

from __future__ import annotations

import dataclasses

from softmodels.materials.material import Material
from softmodels.materials.silicones import PRODUCTS, named


@dataclasses.dataclass(frozen=True)
class Casting:
    """A silicone as the workshop meets it.

    Attributes:
        parts: Of component A and of component B.
        by: ``"weight"``, or ``"weight or volume"`` where both are the same.
        density: Of the mixture in kg/m3.
        pot_life: Time in s in which it can be poured.
        cure_time: Time in s after which it can be taken out of the mould, at 23 C.
        shrinkage: Linear, 0 where the sheet gives a bound alone; None where it gives nothing.
        source: The sheet.
    """

    parts: tuple[float, float]
    by: str
    density: float
    pot_life: float
    cure_time: float
    shrinkage: float | None
    source: str


MINUTE, HOUR = 60.0, 3600.0


def _smooth_on(series: str, gravity: float, pot_minutes: float, cure_hours: float) -> Casting:
    """Smooth-On's series of one to one; their bulletins give a shrinkage below 0.001."""
    source = f"Smooth-On technical bulletin, {series} (specific gravity, pot life, cure time; shrinkage below 0.1 %)"
    return Casting((1.0, 1.0), "weight or volume", gravity * 1e3, pot_minutes * MINUTE, cure_hours * HOUR, 0.0, source)


CASTING: dict[str, Casting | None] = {
    **dict.fromkeys(PRODUCTS),
    "ecoflex-00-10": _smooth_on("Ecoflex Series", 1.04, 30, 4),
    "ecoflex-00-30": _smooth_on("Ecoflex Series", 1.07, 45, 4),
    "ecoflex-00-50": _smooth_on("Ecoflex Series", 1.07, 18, 3),
    "dragon-skin-10-medium": _smooth_on("Dragon Skin Series", 1.07, 20, 5),
    "dragon-skin-20": _smooth_on("Dragon Skin Series", 1.08, 25, 4),
    "dragon-skin-30": _smooth_on("Dragon Skin Series", 1.08, 45, 16),
    "elastosil-m4601": Casting(
        (9.0, 1.0),
        "weight",
        1130.0,
        90 * MINUTE,
        12 * HOUR,
        0.0,
        "Wacker data sheet, ELASTOSIL M 4601 A/B (shrinkage below 0.1 %)",
    ),
    "sylgard-184": Casting(
        (10.0, 1.0),
        "weight",
        1030.0,
        90 * MINUTE,
        48 * HOUR,
        None,
        "Dow data sheet, SYLGARD 184 Silicone Elastomer (48 h at 25 C, 35 min at 100 C)",
    ),
}
"""By product; None where the sheet that came with the batch has to be read."""


SILICONE_DENSITY = 1070.0
"""kg/m3 where no sheet is known; those above have 1030 to 1130."""


def sheet_of(material: Material) -> Casting | None:
    """The sheet of the silicone that a material is; None if it is none of the library, or its sheet is not known here."""
    name = named(material)
    return casting_of(name.partition("/")[0]) if name else None


def density_of(material: Material) -> float:
    """Density in kg/m3 by the sheet of the silicone that a material is, else `SILICONE_DENSITY`."""
    sheet = sheet_of(material)
    return sheet.density if sheet else SILICONE_DENSITY


def casting_of(product: str) -> Casting | None:
    """How a product is cast; None if that is not known here."""
    return CASTING.get(product)
