"""Named silicones: a law, the stretches it was fitted over, and whose measurement it is.

A modulus without its fit range means nothing: the neo-Hookean modulus of one and the same Ecoflex 00-30 specimen is 15 kPa
up to stretch 1.5 and 58 kPa over its whole curve. Batches differ too: two published curves of Ecoflex 00-30 lie a factor
1.75 apart. Use these to begin with, and your own fit to conclude.
"""

from __future__ import annotations

import dataclasses

from softmodels.materials import Material, Yeoh

MARECHAL = "uniaxial data of Marechal et al. 2021, Soft Robotics 8(3):284, doi 10.1089/soro.2019.0115"
LIAO = "uniaxial first cycle of Liao, Yang & Hossain 2021, Int. J. Mech. Sci. 206:106624, doi 10.1016/j.ijmecsci.2021.106624"

RUBBER = 0.5
"""Poisson's ratio: rubber's bulk modulus is some 1e5 times its shear modulus, and the fits take it for incompressible."""


@dataclasses.dataclass(frozen=True)
class Silicone:
    """A material with its origin.

    Attributes:
        material: The law.
        stretches: Range of uniaxial stretch that the law was fitted over.
        source: Whose measurement it is.
        elongation_at_break: Engineering strain at the last point of the same specimen's pull to failure; None if the
            measurement ended before. One specimen's: others of the same product differ by a tenth or more.
    """

    material: Material
    stretches: tuple[float, float]
    source: str
    elongation_at_break: float | None = None


def _marechal(c1: float, c2: float, elongation: float, top: float = 3.0, c3: float = 0.0) -> Silicone:
    """Least squares on the nominal stress (Pa), c2 and c3 not below zero so that the law stays stable."""
    return Silicone(Yeoh(c1, c2, c3, RUBBER), (1.02, top), MARECHAL, elongation)


SILICONES: dict[str, Silicone] = {
    "ecoflex-00-10": _marechal(3670.0, 126.0, 17.09),
    "ecoflex-00-30": _marechal(7859.0, 94.3, 16.07),
    "ecoflex-00-30-liao": Silicone(Yeoh(13892.0, 61.2, 29.5, RUBBER), (1.0, 3.01), LIAO),
    "ecoflex-00-35-fast": _marechal(13590.0, 515.0, 6.23),
    "ecoflex-00-50": _marechal(10740.0, 231.0, 16.41),
    "dragon-skin-10-medium": _marechal(21850.0, 2753.0, 10.41, 2.0),
    "dragon-skin-20": _marechal(61170.0, 7956.0, 9.20, 2.0),
    "dragon-skin-30": _marechal(90410.0, 9082.0, 7.09, 2.0),
    "dragon-skin-fx-pro": _marechal(15280.0, 598.0, 16.48),
    "mold-star-16-fast": _marechal(41210.0, 2988.0, 8.18, 2.0),
    "mold-star-20t": _marechal(54390.0, 3501.0, 8.14, 2.0),
    "platsil-gel-10": _marechal(27100.0, 3802.0, 10.59, 2.0),
    "rtv615": _marechal(163200.0, 13860.0, 1.93, 2.9, 939.0),
    "sortaclear-40": _marechal(139700.0, 5450.0, 5.07),
}
"""Yeoh fits by name. The strain of Marechal's curves is the crosshead's: the first few percent are less sure."""


def named(material: Material) -> str | None:
    """Name of the silicone that a material is, its Poisson's ratio left free; None if it is none of them."""
    for name, silicone in SILICONES.items():
        known = silicone.material
        if type(known) is type(material) and dataclasses.replace(known, poisson=material.poisson) == material:  # type: ignore[call-arg]
            return name
    return None


def stretch_at_break(material: Material) -> float | None:
    """Uniaxial stretch at which the silicone that a material is broke; None if that is not known."""
    name = named(material)
    elongation = SILICONES[name].elongation_at_break if name else None
    return None if elongation is None else 1.0 + elongation
