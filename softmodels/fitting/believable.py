"""A fitted law held against what is known of its silicone: a wrong unit or factor of all pressures shows nowhere else."""

from __future__ import annotations

import dataclasses

import numpy as np

from measurement.units import brief
from measurement.wording import known_are
from softmodels.fitting.problem import FitError
from softmodels.fitting.soundness import Judgement
from softmodels.materials.homogeneous import secant_modulus
from softmodels.materials.material import Material
from softmodels.materials.silicones import PRODUCTS, named, silicone_called
from softmodels.materials.spread import product_of

CASTABLE = (5e3, 1.5e6)
"""Secant shear moduli in Pa of silicones that parts are cast of, from Ecoflex 00-10 (7 kPa) to hard PDMS (1 MPa)."""
ANY = "any"
"""In place of a silicone's name: any that can be cast."""
STRETCH = 1.5
"""Uniaxial stretch at which moduli are compared, or the largest that was fitted."""
ROOM = (1.05, 1.25)
"""Factors below and above the published values of a product that several laboratories have measured; parts get stiffer."""
ALONE = (1.7, 1.7)
"""The same for a product with one published curve: laboratories differ by up to a factor two."""
GUESS = (4.0, 4.0)
"""The same for a case's own law that is no named silicone."""
FACTORS = (
    (0.1, "a tenth of what is likely: were they in mm listed as cm, cm of water listed as mm, or kPa listed as cm of water?"),
    (10.0, "ten times what is likely: were they in mm listed as cm, or cm of water or mbar listed as kPa?"),
    (0.5, "half of what is likely: was the level of one tube alone listed?"),
    (2.0, "twice what is likely: was the difference of the two tubes doubled?"),
    (0.01, "a hundredth of what is likely: were they in hPa or mbar listed as Pa?"),
    (100.0, "a hundred times what is likely: were they in Pa listed as hPa or mbar?"),
)  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Expected:
    """What is known of a silicone.

    Attributes:
        label: Whose modulus it is, in words.
        curves: Laws that have been published for it, or the one that the case has.
        room: Factors below and above.
        known: Whether the silicone is named.
    """

    label: str
    curves: tuple[Material, ...]
    room: tuple[float, float]
    known: bool

    def range(self, stretch: float) -> tuple[float, float]:
        """Lowest and highest believable secant shear modulus in Pa at a stretch."""
        if not self.curves:
            return CASTABLE
        moduli = [secant_modulus(curve, stretch) for curve in self.curves]
        return min(moduli) / self.room[0], max(moduli) * self.room[1]


def expected(silicone: str | None, material: Material | None = None) -> Expected:
    """What a named silicone, or else a case's own material, leads to.

    Args:
        silicone: Name of a silicone, or `ANY`; None to go by the material.
        material: The case's; None if there is no case.

    Raises:
        FitError: No silicone of this name is known.
    """
    name = silicone or (named(material) if material is not None else None)
    if name == ANY or (name is None and material is None):
        return Expected("silicones that can be cast", (), (1.0, 1.0), silicone == ANY)
    if name is None:
        assert material is not None
        return Expected("the case's own material", (material,), GUESS, False)
    curves = published(name)
    if not curves:
        raise FitError(f"silicone {brief(name)} is unknown; {known_are(name, PRODUCTS, ', and any')}")
    return Expected(f"published curves of {name}", curves, ROOM if len(curves) > 1 else ALONE, True)


def published(name: str) -> tuple[Material, ...]:
    """Laws of all sources that have pulled the product that a name means, whichever source the name stands for."""
    sources = PRODUCTS.get(product_of(name), ()) if silicone_called(name) else ()
    return tuple(one.material for one in sources if one.pulled)


def objection(material: Material, largest: float, known: Expected) -> str:
    """A sentence if a fitted law is none of its silicone's, empty if it may be.

    Args:
        material: The fitted law.
        largest: Largest stretch that it was fitted to.
        known: What its silicone leads to.
    """
    stretch = min(STRETCH, max(largest, 1.05))
    modulus, (low, high) = secant_modulus(material, stretch), known.range(stretch)
    if low <= modulus <= high:
        return ""
    side = f"{low / modulus:.3g} times below" if modulus < low else f"{modulus / high:.3g} times above"
    hints = [words for factor, words in FACTORS if modulus > 0.0 and low <= modulus / factor <= high]
    hint = f"; the pressures would then be {hints[0]}" if hints else ""
    kind = "have" if known.known or not known.curves else "leads to"
    return (
        f"its shear modulus at stretch {stretch:.3g} is {modulus / 1e3:.3g} kPa, {side} what {known.label} {kind} "
        f"({low / 1e3:.3g} to {high / 1e3:.3g} kPa){hint}. Check the unit of the pressures, or name the silicone (--silicone "
        "NAME, or --silicone any if it is in no list)"
    ).replace("?.", "?")


def hold_against(law: Material, largest: float, known: Expected, judgement: Judgement) -> Judgement:
    """A judgement that knows the silicone too; where something else is wrong already, the modulus need not be right."""
    said = "" if judgement.objections else objection(law, largest, known)
    return dataclasses.replace(judgement, objections=(said,)) if said else judgement


def stretch_of(strain: float) -> float:
    """Uniaxial stretch in tension with this I1 - 3."""
    return float(max(np.roots([1.0, 0.0, -(strain + 3.0), 2.0]).real))


def caution(known: Expected) -> str:
    """What cannot be noticed where nobody says which silicone it is, empty if that is known."""
    if known.known:
        return ""
    return (
        "nothing tells which silicone this is, so a wrong factor that is common to all pressures, such as the level of one "
        "tube alone, is not noticed; name it with --silicone"
    )
