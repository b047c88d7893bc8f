"""The command ``silicones``: list every named silicone with all its sources."""

from __future__ import annotations

import click

from softmodels.cli.options import fail
from softmodels.common.errors import known_are
from softmodels.common.processes import say
from softmodels.materials.silicones import (
    PRODUCTS,
    SILICONE_DENSITY,
    SILICONES,
    Silicone,
    casting_of,
    full_name,
    product_of,
    spread_sentence,
)
from softmodels.materials.specimens import nominal_stress

HEAD = f"  {'--material':42s} {'modulus':>10s} {'stress at stretch 1.5, 2':>26s}   {'fitted over stretch':20s}"
PLAIN = "*"
"""Mark of the source used for the plain name."""


@click.command("silicones")
@click.argument("products", nargs=-1, metavar="[PRODUCT...]")
def silicones(products: tuple[str, ...]) -> None:
    """List the named silicones: shear modulus at small strain, stresses in uniaxial tension, range and source.

    With a PRODUCT, such as ecoflex-00-30, where and how each of its sources was measured, and its density. A product's plain
    name means the source with a star: of its sources in tension, from the softest to the stiffest by their secant modulus at
    stretch 1.5, the middle one, and of an even number the stiffer of the two in the middle.

    \b
    Exit status: 0 done; 2 no such silicone.
    """
    names = [product_of(name) for name in products]
    for name in names:
        if name not in PRODUCTS:
            fail(f"{name!r} is not a silicone of the library; {known_are(name, PRODUCTS)}")
    say(HEAD)
    for name in names or PRODUCTS:
        for one in PRODUCTS[name]:
            say(_line(name, one))
            if names:
                say(_origin(one))
        if names:
            say(f"  {spread_sentence(name)}")
            say(f"  {_weight(name)}")
    if not names:
        say(f"{PLAIN} source used for the plain name: the median one by tensile stress at stretch "
                   "1.5 (the stiffer of the middle two)")  # fmt: skip
        say("softmodels silicones PRODUCT prints how each source was measured")


def _line(product: str, one: Silicone) -> str:
    stresses = "only in compression"
    if one.pulled:
        stresses = ", ".join(f"{stress / 1e3:.4g}" for stress in nominal_stress(one.material, [1.5, 2.0])) + " kPa"
    span = "not published" if one.stretches is None else f"{one.stretches[0]:g} to {one.stretches[1]:g}"
    modulus = f"{one.material.shear_modulus_0 / 1e3:.4g} kPa"
    mark = PLAIN if one is SILICONES[product] else " "
    return f"{mark} {full_name(product, one):42s} {modulus:>10s} {stresses:>26s}   {span:20s}"


def _weight(product: str) -> str:
    """Return the density used under gravity."""
    sheet = casting_of(product)
    return (
        f"density {sheet.density:g} kg/m^3: {sheet.source}"
        if sheet
        else f"density not published, {SILICONE_DENSITY:g} kg/m^3 assumed"
    )


def _origin(one: Silicone) -> str:
    o = one.origin
    return "\n".join(
        f"      {text}" for text in (o.text, f"laboratory: {o.laboratory}", f"test: {o.test}", o.history, o.made)
    )
