"""The command ``silicones``: every named silicone with all its sources."""

from __future__ import annotations

import click

from measurement.terminal import say
from softmodels.cli.options import fail
from softmodels.materials.casting import SILICONE_DENSITY, casting_of
from softmodels.materials.homogeneous import nominal_stress
from softmodels.materials.silicones import PRODUCTS, Silicone
from softmodels.materials.spread import full_name, product_of, spread_sentence

HEAD = f"  {'--material':42s} {'modulus':>10s} {'stress at stretch 1.5, 2':>26s}   {'fitted over stretch':20s}"


@click.command("silicones", context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("products", nargs=-1, metavar="[PRODUCT...]")
def silicones(products: tuple[str, ...]) -> None:
    """List the named silicones: shear modulus at small strain, stresses in uniaxial tension, range and source.

    With a PRODUCT, such as ecoflex-00-30, where and how each of its sources was measured, and its density. The first source is
    what the bare name means.

    \b
    Exit status: 0 done; 2 no such silicone.
    """
    names = [product_of(name) for name in products]
    for name in names:
        if name not in PRODUCTS:
            fail(f"{name!r} is no silicone of the library; known are {', '.join(PRODUCTS)}")
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
        say("softmodels silicones PRODUCT tells where and how each source was measured")


def _line(product: str, one: Silicone) -> str:
    stresses = "compressed alone"
    if one.pulled:
        stresses = ", ".join(f"{stress / 1e3:.4g}" for stress in nominal_stress(one.material, [1.5, 2.0])) + " kPa"
    span = "not published" if one.stretches is None else f"{one.stretches[0]:g} to {one.stretches[1]:g}"
    modulus = f"{one.material.shear_modulus_0 / 1e3:.4g} kPa"
    return f"  {full_name(product, one):42s} {modulus:>10s} {stresses:>26s}   {span:20s}"


def _weight(product: str) -> str:
    """What it weighs under gravity."""
    sheet = casting_of(product)
    return (
        f"density {sheet.density:g} kg/m^3: {sheet.source}"
        if sheet
        else f"density not known, {SILICONE_DENSITY:g} kg/m^3 taken"
    )


def _origin(one: Silicone) -> str:
    o = one.origin
    return "\n".join(
        f"      {text}" for text in (o.text, f"laboratory: {o.laboratory}", f"test: {o.test}", o.history, o.made)
    )
