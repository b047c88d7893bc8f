"""How far the sources of one named silicone lie apart, in words and as the two ends to compute with."""

from __future__ import annotations

import statistics

from softmodels.materials.material import Material
from softmodels.materials.silicones import OTHER_NAMES, PRODUCTS, SILICONES, Silicone, named


def product_of(name: str) -> str:
    """The product of a name such as ``"ecoflex-00-30/liao-2021"``."""
    return OTHER_NAMES.get(name, name).partition("/")[0]


def full_name(product: str, source: Silicone) -> str:
    """``product/source``."""
    return f"{product}/{source.origin.key}"


def ends(product: str) -> tuple[Silicone, Silicone] | None:
    """The softest and the stiffest source in tension, by their shear modulus at small strain; None if there is one alone."""
    pulled = sorted(
        (source for source in PRODUCTS[product] if source.pulled), key=lambda source: source.material.shear_modulus_0
    )
    return (pulled[0], pulled[-1]) if len(pulled) > 1 else None


def factor(product: str) -> float | None:
    """Largest modulus of a product's sources over the smallest; None for one source alone."""
    moduli = [source.material.shear_modulus_0 for source in PRODUCTS[product]]
    return max(moduli) / min(moduli) if len(moduli) > 1 else None


def usual_factors() -> tuple[float, float, float]:
    """Least, median and largest `factor` of the products that have several sources."""
    found = [f for f in map(factor, PRODUCTS) if f is not None]
    return min(found), statistics.median(found), max(found)


def spread_sentence(name: str) -> str:
    """What is known of the spread between the sources of a named silicone."""
    product = product_of(name)
    used = SILICONES[OTHER_NAMES.get(name, name)]
    many = PRODUCTS[product]
    if len(many) == 1:
        low, middle, high = usual_factors()
        return (
            f"{product} has one source here ({used.origin.key}), so its spread between batches and laboratories is unknown; "
            f"the shear moduli of products with several sources differ by a factor of {low:.2g} to {high:.2g} (median "
            f"{middle:.2g}): fit a cast of your own before you rely on it"
        )
    ordered = sorted(many, key=lambda source: source.material.shear_modulus_0)
    moduli = ", ".join(f"{source.origin.key} {source.material.shear_modulus_0 / 1e3:.3g}" for source in ordered)
    others = [full_name(product, source) for source in ends(product) or () if source is not used]
    return (
        f"{product} is {used.origin.key}'s here, and its sources differ: shear modulus at small strain in kPa {moduli} (a "
        f"factor of {factor(product):.2g} between batches, rates and laboratories); run it with --material "
        f"{' and '.join(others)} too, or fit a cast of your own"
    )


def material_spread(material: Material) -> str | None:
    """`spread_sentence` of the silicone that a material is; None if it is none of the library."""
    name = named(material)
    return spread_sentence(name) if name else None
