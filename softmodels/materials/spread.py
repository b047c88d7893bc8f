"""How far the sources of one named silicone lie apart, in words and as the sources to compute with."""

from __future__ import annotations

import statistics

from softmodels.materials.material import Material
from softmodels.materials.silicones import (
    OTHER_NAMES,
    PRODUCTS,
    SILICONES,
    WORKING_STRETCH,
    Silicone,
    in_tension,
    named,
    working_modulus,
)


def product_of(name: str) -> str:
    """The product of a name such as ``"ecoflex-00-30/liao-2021"``."""
    return OTHER_NAMES.get(name, name).partition("/")[0]


def full_name(product: str, source: Silicone) -> str:
    """``product/source``."""
    return f"{product}/{source.origin.key}"


def name_of(product: str, source: Silicone) -> str:
    """The shortest name of a source: the product's alone for its middle one."""
    return product if source is SILICONES[product] else full_name(product, source)


def spanning(product: str) -> list[Silicone]:
    """The sources that a product's band spans, from the softest to the stiffest in tension; none if there is only one."""
    pulled = in_tension(PRODUCTS[product])
    return pulled if len(pulled) > 1 else []


def source_names(name: str) -> list[str]:
    """The names of all sources in tension of a named silicone's product, from the softest to the stiffest."""
    product = product_of(name)
    return [name_of(product, one) for one in in_tension(PRODUCTS[product])]


def factor(product: str) -> float | None:
    """Stiffest over softest of `spanning`, by their secant modulus at the working stretch; None for a single source."""
    many = spanning(product)
    return working_modulus(many[-1].material) / working_modulus(many[0].material) if many else None


def usual_factors() -> tuple[float, float, float]:
    """Least, median and largest `factor` of the products that have several sources."""
    found = [f for f in map(factor, PRODUCTS) if f is not None]
    return min(found), statistics.median(found), max(found)


def spread_sentence(name: str) -> str:
    """What is known of the spread between the sources of a named silicone."""
    product = product_of(name)
    used = SILICONES[OTHER_NAMES.get(name, name)]
    many = spanning(product)
    if not many:
        low, middle, high = usual_factors()
        return (
            f"{product} has one source here ({used.origin.key}), so its spread between batches and laboratories is unknown; "
            f"the shear moduli of products with several sources differ by a factor of {low:.2g} to {high:.2g} (median "
            f"{middle:.2g}): fit a cast of your own before you rely on it"
        )
    moduli = ", ".join(f"{source.origin.key} {working_modulus(source.material) / 1e3:.3g}" for source in many)
    return (
        f"{product} is {used.origin.key}'s here{_meant(product, used, len(many))}; published sources disagree: secant shear "
        f"modulus at stretch {WORKING_STRETCH:g} in kPa {moduli} (a factor of {factor(product):.2g} between batches, rates and "
        f"laboratories); --band {product} computes all of them, or fit a cast of your own"
    )


def _meant(product: str, used: Silicone, count: int) -> str:
    """Why a plain name means this source; empty for a source that was named."""
    if used is not SILICONES[product]:
        return ""
    return " (the stiffer of two)" if count == 2 else f" (the middle of {count} in tension)"


def material_spread(material: Material) -> str | None:
    """`spread_sentence` of the silicone that a material is; None if it is none of the library."""
    name = named(material)
    return spread_sentence(name) if name else None
