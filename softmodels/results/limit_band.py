"""The limit of a named silicone over all its sources."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from softmodels.materials.laws import Material
from softmodels.materials.silicones import PRODUCTS, SILICONES, named
from softmodels.materials.spread import full_name, product_of, spanning, spread_sentence
from softmodels.results.limits import Limit


def with_sources(materials: Mapping[str, Material]) -> tuple[dict[str, Material], dict[str, tuple[str, ...]]]:
    """Materials with every source in tension of each silicone that stands for its product.

    Args:
        materials: By name as asked for; silicones that are named with their source stay alone.

    Returns:
        All materials by name, and by product the names that its band is made of; empty for a product of one source.
    """
    every: dict[str, Material] = dict(materials)
    bands: dict[str, tuple[str, ...]] = {}
    for name, material in materials.items():
        known = named(material)
        if known is None or known not in PRODUCTS or "/" in name:
            continue
        product, band = product_of(known), []
        for one in spanning(product):
            label = name if one is SILICONES[product] else full_name(product, one)
            every.setdefault(label, _like(one.material, material))
            band.append(label)
        bands[product] = tuple(band)
    return every, bands


def _like(source: Material, asked: Material) -> Material:
    """A source with the Poisson's ratio that was asked for."""
    return dataclasses.replace(source, poisson=asked.poisson)  # type: ignore[call-arg]


def band_texts(bands: Mapping[str, tuple[str, ...]], limits: Mapping[str, Limit], cm: float) -> list[str]:
    """Between which pressures the limits of each silicone's sources lie, as sentences; how far other products scatter, where it
    has one source."""
    texts = []
    for product, names in bands.items():
        if not names:
            texts.append(f"note: {spread_sentence(product)}")
            continue
        found = sorted(((limits[name], name) for name in names), key=lambda pair: pair[0].pressure)
        low, high = (
            f"{one.pressure / cm:.4g} cm ({one.pressure / 1e3:.4g} kPa, {_what(one, name)})"
            for one, name in (found[0], found[-1])
        )
        texts.append(f"{product} over its {len(names)} sources: {low} to {high}; see softmodels silicones {product}")
    return texts


def _what(found: Limit, name: str) -> str:
    return name if found.found else f"{name}, no limit met up to there"
