"""Named silicones: a law, its fitted range of stretch, and its source; several sources per product.

A modulus is meaningless without its fitted range: the neo-Hookean modulus of one and the same Ecoflex 00-30 specimen is 15 kPa
up to stretch 1.5 and 58 kPa over its whole curve. Batches, rates and laboratories differ too: the sources of one product lie
a factor of two and more apart. A product's plain name selects its median source (`middle`). Use these for first estimates, over
their whole spread, and your own fit for conclusions.

Parameters of measured curves are least-squares fits made here, and marked so; published parameters are given unchanged.
"""

from __future__ import annotations

import dataclasses
import statistics
from collections.abc import Sequence

from softmodels.common import errors, names, units
from softmodels.common.names import checked
from softmodels.materials import laws, specimens
from softmodels.materials.laws import Material, MaterialError, Ogden, Yeoh


@dataclasses.dataclass(frozen=True)
class Silicone:
    """A material with its origin.

    Attributes:
        material: The law.
        stretches: Range of uniaxial stretch that the law was fitted over; None if that was not published.
        origin: Whose measurement it is.
        elongation_at_break: Engineering strain at the last point of the same specimen's pull to failure; None if the
            measurement ended before. One specimen's, by the crosshead: makers' sheets give half of it to as much
            (`MAKERS_ELONGATION`).
    """

    material: Material
    stretches: tuple[float, float] | None
    origin: Origin
    elongation_at_break: float | None = None

    @property
    def source(self) -> str:
        """The publication."""
        return self.origin.text

    @property
    def pulled(self) -> bool:
        """Whether the source covers tension."""
        return self.stretches is None or self.stretches[1] > 1.0


PSI = 6894.757293168
"""Pa."""
WORKING_STRETCH = 1.5
"""Uniaxial stretch at which the sources of a product are compared: in the working range of actuators, and in the range of every
source in tension (except `JOHNSTON`'s, whose law is neo-Hookean)."""


@dataclasses.dataclass(frozen=True)
class Origin:
    """Source of a measurement.

    Attributes:
        key: Short name of the source, such as ``"marechal-2021"``.
        text: Publication.
        laboratory: Where it was measured.
        test: Kind of test with its rate, as far as published.
        history: Batch, conditioning and cycle, as far as published.
        made: How the numbers came about.
    """

    key: str
    text: str
    laboratory: str
    test: str
    history: str
    made: str


MARECHAL = Origin(
    "marechal-2021",
    "uniaxial data of Marechal et al. 2021, Soft Robotics 8(3):284, doi 10.1089/soro.2019.0115",
    "SYMME, Universite Savoie Mont Blanc, Annecy",
    "uniaxial tension (ASTM D412), crosshead 450 mm/min (WagnerSil 500) on 33 mm",
    "first loading, one specimen pulled to failure; batch not published",
    "Yeoh law fitted here to the measured curve",
)
LIAO = Origin(
    "liao-2021",
    "uniaxial first cycle of Liao, Yang & Hossain 2021, Int. J. Mech. Sci. 206:106624, doi 10.1016/j.ijmecsci.2021.106624",
    "Swansea University",
    "uniaxial tension; digitised from a figure",
    "first cycle; batch not published",
    "Yeoh law fitted here to 12 digitised points",
)
SPARKS = Origin(
    "sparks-2015",
    "Sparks et al. 2015, Advances in Skin & Wound Care 28(2):59-68, table 2",
    "see the publication",
    "unconfined compression to 25 %, 1 %/s",
    "batch and conditioning not known here",
    "Ogden law of one term as published (convention 2mu/alpha^2)",
)
SMOOTH_ON = Origin(
    "smooth-on",
    "manufacturer's technical bulletin (Smooth-On), 100 % modulus",
    "Smooth-On, Macungie, Pennsylvania",
    "uniaxial tension (ASTM D412), one reading at 100 % strain",
    "rounded typical value; batch, rate and conditioning not published",
    "neo-Hookean law (Yeoh with c2 = c3 = 0) through that reading, made here",
)
SOROTOKI = Origin(
    "sorotoki",
    "material sample of Caasenbrood's Sorotoki (GitHub, BJCaasenbrood/SorotokiCode)",
    "not stated",
    "not stated",
    "not stated",
    "Yeoh law as given there; range and measurement not stated",
)
JOHNSTON = Origin(
    "johnston-2014",
    "Johnston et al. 2014, J. Micromech. Microeng. 24:035017, doi 10.1088/0960-1317/24/3/035017",
    "see the publication",
    "tension to ASTM standards, to 40 % strain",
    "Young's modulus 1.32 to 2.97 MPa as the cure rises from 25 to 200 C",
    "neo-Hookean law (Yeoh with c2 = c3 = 0) of that Young's modulus",
)
PNEUNETS = Origin(
    "pneunets",
    "finite-element models of bellows bending actuators (Soft Robotics Toolkit, softroboticstoolkit.com): C1 0.11, C2 0.02 MPa",
    "not stated",
    "not stated",
    "not stated",
    "Yeoh law as published; range and measurement not stated",
)


def _marechal(c1: float, c2: float, elongation: float, top: float = 3.0, c3: float = 0.0) -> Silicone:
    """Return the least squares on the nominal stress (Pa), c2 and c3 not below zero so that the law stays stable."""
    return Silicone(Yeoh(c1, c2, c3, laws.DEFAULT_POISSON_RATIO), (1.02, top), MARECHAL, elongation)


def _data_sheet(psi: float) -> Silicone:
    """From the nominal stress at stretch 2: S = 2 c1 (2 - 1/4)."""
    return Silicone(Yeoh(round(psi * PSI / 3.5, 1), 0.0, 0.0, laws.DEFAULT_POISSON_RATIO), (1.0, 2.0), SMOOTH_ON)


def _compressed(modulus: float, alpha: float) -> Silicone:
    return Silicone(Ogden.from_two_mu((modulus,), (alpha,), laws.DEFAULT_POISSON_RATIO), (0.75, 1.0), SPARKS)


def _sorotoki(c1: float, c2: float) -> Silicone:
    return Silicone(Yeoh(c1, c2, 0.0, laws.DEFAULT_POISSON_RATIO), None, SOROTOKI)


def _johnston(young: float, cure: str) -> Silicone:
    origin = dataclasses.replace(JOHNSTON, key=f"johnston-2014-{cure}", history=f"cured at {cure.upper()[:-1]} C")
    return Silicone(Yeoh(young / 6, 0.0, 0.0, laws.DEFAULT_POISSON_RATIO), (1.0, 1.4), origin)


PRODUCTS: dict[str, tuple[Silicone, ...]] = {
    "ecoflex-00-10": (_marechal(3670.0, 126.0, 17.09), _compressed(12605.0, 4.32), _data_sheet(8.0)),
    "ecoflex-00-30": (
        _marechal(7859.0, 94.3, 16.07),
        Silicone(Yeoh(13892.0, 61.2, 29.5, laws.DEFAULT_POISSON_RATIO), (1.0, 3.01), LIAO),
        _compressed(22081.0, 0.825),
        _sorotoki(8400.0, 100.0),
        _data_sheet(10.0),
    ),
    "ecoflex-00-35-fast": (_marechal(13590.0, 515.0, 6.23),),
    "ecoflex-00-50": (_marechal(10740.0, 231.0, 16.41), _sorotoki(14500.0, 100.0), _data_sheet(12.0)),
    "dragon-skin-10-medium": (_marechal(21850.0, 2753.0, 10.41, 2.0), _data_sheet(22.0)),
    "dragon-skin-20": (_marechal(61170.0, 7956.0, 9.20, 2.0), _data_sheet(49.0)),
    "dragon-skin-30": (_marechal(90410.0, 9082.0, 7.09, 2.0), _data_sheet(86.0)),
    "dragon-skin-fx-pro": (_marechal(15280.0, 598.0, 16.48),),
    "dragon-skin-fx-pro-slacker": (_marechal(1333.4, 8.4, 18.18),),
    "mold-star-16-fast": (_marechal(41210.0, 2988.0, 8.18, 2.0),),
    "mold-star-20t": (_marechal(54390.0, 3501.0, 8.14, 2.0),),
    "platsil-gel-10": (_marechal(27100.0, 3802.0, 10.59, 2.0),),
    "rtv615": (_marechal(163200.0, 13860.0, 1.93, 2.9, 939.0),),
    "sortaclear-40": (_marechal(139700.0, 5450.0, 5.07),),
    "body-double-silk": (_marechal(59495.0, 3292.0, 5.89, 2.0),),
    "psycho-paint": (_marechal(59129.0, 3230.6, 6.93, 2.0),),
    "rebound-25": (_marechal(48694.0, 4434.5, 6.27, 2.0),),
    "soloplast-150318": (_marechal(33279.0, 2054.3, 7.39, 2.0),),
    "wagnersil-20-nf": (_marechal(55737.0, 9028.0, 3.27, 2.0),),
    "elastosil-m4601": (Silicone(Yeoh(110e3, 20e3, 0.0, laws.DEFAULT_POISSON_RATIO), None, PNEUNETS),),
    "sylgard-184": (_johnston(1.32e6, "25c"), _johnston(2.97e6, "200c")),
}
"""Every source of every product. The strain of Marechal's curves is the crosshead's: the first few percent are less sure."""


def working_modulus(material: Material) -> float:
    """Return the secant shear modulus in Pa at `WORKING_STRETCH`, by which sources are compared."""
    return specimens.secant_modulus(material, WORKING_STRETCH)


def in_tension(many: Sequence[Silicone]) -> list[Silicone]:
    """Return the tension sources, from the softest to the stiffest by `working_modulus`; compression ones only if there are no
    others."""
    pulled = [silicone for silicone in many if silicone.pulled] or list(many)
    return sorted(pulled, key=lambda silicone: working_modulus(silicone.material))


def middle(many: Sequence[Silicone]) -> Silicone:
    """Return the source selected by a product's plain name: the median one in tension, the stiffer of the middle two.

    The stiffer, since crosshead strain counts slip in the grips as strain, so that curves err on the soft side: measured
    membranes of Ecoflex 00-30 and a measured beam of Dragon Skin 10 lie by the stiffer one.
    """
    ordered = in_tension(many)
    return ordered[len(ordered) // 2]


SILICONES: dict[str, Silicone] = {
    product if silicone is middle(many) else f"{product}/{silicone.origin.key}": silicone
    for product, many in PRODUCTS.items()
    for silicone in many
}
"""By name: only the product for its `middle` source, ``product/source`` for the others."""

OTHER_NAMES = {f"{product}/{middle(many).origin.key}": product for product, many in PRODUCTS.items()}
"""Full names of the sources listed in `SILICONES` by the product's name."""
OTHER_NAMES["ecoflex-00-30-liao"] = OTHER_NAMES.get("ecoflex-00-30/liao-2021", "ecoflex-00-30/liao-2021")

_SPELLINGS = {names.spelling(name): OTHER_NAMES.get(name, name) for name in (*SILICONES, *OTHER_NAMES)}
LONGEST_NAME = 100


def listed_name(name: str) -> str:
    """Return the name in `SILICONES` of one that people write, such as ``"Ecoflex 00-30"`` or ``"ecoflex30"``, or of the full
    name of a source that is listed by its product's; the name itself if there is none."""
    known = OTHER_NAMES.get(name, name)
    return known if known in SILICONES or len(name) > LONGEST_NAME else _SPELLINGS.get(names.spelling(name), known)


def silicone_called(name: str) -> Silicone | None:
    """Return the silicone of a name; None if there is none."""
    return SILICONES.get(listed_name(name)) if isinstance(name, str) else None


def named(material: Material) -> str | None:
    """Return the name of a material's silicone, for any Poisson's ratio; None if there is none."""
    for name, silicone in SILICONES.items():
        known = silicone.material
        if type(known) is type(material) and dataclasses.replace(known, poisson=material.poisson) == material:  # type: ignore[call-arg]
            return name
    return None


def stretches_of(material: Material) -> tuple[float, float] | None:
    """Return the range of stretch that a material was fitted over: its own, else its silicone's; None if unknown."""
    name = named(material)
    return material.fitted_stretch or (SILICONES[name].stretches if name else None)


def publications(material: Material) -> list[str]:
    """Return the sources of a material's law and, if it is a named silicone, of its numbers."""
    origins, name = [f"law: {material.source}"] if material.source else [], named(material)
    return [*origins, f"material: {name}, {SILICONES[name].source}"] if name else origins


def extrapolated(material: Material, stretch: float) -> str:
    """Return a warning if a stretch exceeds a material's fitted range; empty if not, or if the range is
    unknown."""
    stretches = stretches_of(material)
    if stretches is None or stretch <= stretches[1]:
        return ""
    return (
        f"the largest stretch, {stretch:.3g}, exceeds {stretches[1]:.4g}, the end of "
        f"the fitted range of {named(material) or f'this {material.name} law'}: results beyond are an extrapolation"
    )


def stretches_at_break(material: Material) -> list[tuple[float, str]]:
    """Return the uniaxial stretches at break of a material's silicone with their sources, in words, from the least to the
    largest: that of its maker's sheet, and those of single specimens of any laboratory; none if unknown."""
    name = named(material)
    if name is None:
        return []
    product = product_of(name)
    breaks = [
        (1.0 + silicone.elongation_at_break, f"{silicone.origin.key}, one specimen")
        for silicone in PRODUCTS[product]
        if silicone.elongation_at_break is not None
    ]
    if product in MAKERS_ELONGATION:
        breaks.append((1.0 + MAKERS_ELONGATION[product][0], "maker's sheet"))
    return sorted(breaks)


def stretch_at_break(material: Material) -> float | None:
    """Return the least of `stretches_at_break`; None if unknown."""
    stretches = stretches_at_break(material)
    return stretches[0][0] if stretches else None


def break_words(material: Material) -> str:
    """Return the stretches at break with their sources, such as ``stretch at break 10 (maker's sheet), 17 (marechal-2021, one
    specimen)``; empty if unknown."""
    texts = ", ".join(f"{stretch:.2g} ({source})" for stretch, source in stretches_at_break(material))
    return f"stretch at break {texts}" if texts else ""


def material_of(name: str, value: object) -> Material:
    """Return a material, given as such or by a silicone's name; ``name`` is what the argument is called.

    Raises:
        MaterialError: There is no silicone of that name.
        ArgumentError: It is neither.
    """
    if isinstance(value, str):
        return silicone(value)
    wanted = "a material, such as sm.Yeoh('14 kPa'), or the name of a silicone, such as 'ecoflex-00-30'"
    return names.one_of(name, value, Material, wanted)


@checked
def silicone(name: str) -> Material:
    """Return the material of a named silicone.

    Args:
        name: A product, such as ``"ecoflex-00-30"``, for the `middle` of its sources, or one of them, such as
            ``"ecoflex-00-30/marechal-2021"``.

    Raises:
        MaterialError: There is none of that name.
    """
    silicone = silicone_called(name)
    if silicone is None:
        raise MaterialError(
            f"silicone {units.brief(name)} is unknown; "
            f"{errors.known_are(name, PRODUCTS, ', and their sources (softmodels silicones)')}"
        )
    return silicone.material


# ----------------------------------------------------------------------------------------------------------------------
# Spread between the sources of a named silicone.


def product_of(name: str) -> str:
    """Return the product of a name such as ``"ecoflex-00-30/liao-2021"``."""
    return listed_name(name).partition("/")[0]


def full_name(product: str, source: Silicone) -> str:
    """Return ``product/source``."""
    return f"{product}/{source.origin.key}"


def name_of(product: str, source: Silicone) -> str:
    """Return the shortest name of a source: only the product's for its median one."""
    return product if source is SILICONES[product] else full_name(product, source)


def spanning(product: str) -> list[Silicone]:
    """Return the sources of a product's band, from the softest to the stiffest in tension; none if there is
    only one."""
    pulled = in_tension(PRODUCTS[product])
    return pulled if len(pulled) > 1 else []


def source_names(name: str) -> list[str]:
    """Return the names of all sources in tension of a named silicone's product, from the softest to the stiffest."""
    product = product_of(name)
    return [name_of(product, silicone) for silicone in in_tension(PRODUCTS[product])]


def factor(product: str) -> float | None:
    """Return the stiffest over softest of `spanning`, by their secant modulus at the working stretch; None for a single
    source."""
    many = spanning(product)
    return working_modulus(many[-1].material) / working_modulus(many[0].material) if many else None


def usual_factors() -> tuple[float, float, float]:
    """Return the least, median and largest `factor` of the products that have several sources."""
    factors = [f for f in map(factor, PRODUCTS) if f is not None]
    return min(factors), statistics.median(factors), max(factors)


def spread_sentence(name: str) -> str:
    """Return a sentence on the spread between the sources of a named silicone."""
    product = product_of(name)
    used = SILICONES[listed_name(name)]
    many = spanning(product)
    if not many:
        low, middle, high = usual_factors()
        return (
            f"{product} has only one source ({used.origin.key}), so its spread between batches and laboratories "
            f"is unknown; shear moduli of products with several sources differ by a factor of {low:.2g} to {high:.2g} "
            f"(median {middle:.2g}): fit your own cast before relying on it"
        )
    moduli = ", ".join(f"{source.origin.key} {working_modulus(source.material) / 1e3:.3g}" for source in many)
    return (
        f"{product} is {used.origin.key}'s here{_meant(product, used, len(many))}; published sources disagree: secant shear "
        f"modulus at stretch {WORKING_STRETCH:g} in kPa {moduli} (a factor of {factor(product):.2g} between batches, rates and "
        f"laboratories); use --band {product} to compute all of them, or fit your own cast"
    )


def _meant(product: str, used: Silicone, count: int) -> str:
    """Return why a plain name selects this source; empty for an explicitly named one."""
    if used is not SILICONES[product]:
        return ""
    return " (the stiffer of two)" if count == 2 else f" (the median of {count} in tension)"


def material_spread(material: Material) -> str | None:
    """Return `spread_sentence` of a material's silicone; None if it is not in the library."""
    name = named(material)
    return spread_sentence(name) if name else None


# ----------------------------------------------------------------------------------------------------------------------
# Elongation at break of named silicones, from their makers' data sheets.


def _bulletin(series: str) -> str:
    return f"Smooth-On technical bulletin, {series} (ASTM D412)"


MAKERS_ELONGATION: dict[str, tuple[float, str]] = {
    "ecoflex-00-10": (8.0, _bulletin("Ecoflex Series")),
    "ecoflex-00-30": (9.0, _bulletin("Ecoflex Series")),
    "ecoflex-00-50": (9.8, _bulletin("Ecoflex Series")),
    "dragon-skin-10-medium": (10.0, _bulletin("Dragon Skin Series")),
    "dragon-skin-20": (6.2, _bulletin("Dragon Skin Series")),
    "dragon-skin-30": (3.64, _bulletin("Dragon Skin Series")),
    "elastosil-m4601": (7.0, "Wacker data sheet, ELASTOSIL M 4601 A/B (ISO 37)"),
}
"""Engineering strain and source by product, of those whose sheet was read: a typical value of several specimens, for a margin
against tearing."""


# ----------------------------------------------------------------------------------------------------------------------
# Mixing and curing data of named silicones, from their makers' data sheets.
#
# Figures are the makers' typical values at 23 C. Missing values have to be taken from the data sheet of the batch.


@dataclasses.dataclass(frozen=True)
class Casting:
    """Casting data of a silicone.

    Attributes:
        parts: Of component A and of component B.
        by: ``"weight"``, or ``"weight or volume"`` where both are the same.
        density: Of the mixture in kg/m3.
        pot_life: Time in s in which it can be poured.
        cure_time: Time in s after which it can be taken out of the mould, at 23 C.
        shrinkage: Linear, 0 if the sheet gives only a bound; None if it gives nothing.
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
    """Return Smooth-On's series of one to one; their bulletins give a shrinkage below 0.001."""
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
"""By product; None for values to take from the data sheet of the batch."""

SILICONE_DENSITY = 1070.0
"""Default density in kg/m3 without a data sheet; those above have 1030 to 1130."""


def sheet_of(material: Material) -> Casting | None:
    """Return the data sheet of a material's silicone; None if it is not in the library, or has no data sheet
    here."""
    name = named(material)
    return casting_of(name.partition("/")[0]) if name else None


def density_of(material: Material) -> float:
    """Return the density in kg/m3 from the data sheet of a material's silicone, else `SILICONE_DENSITY`."""
    sheet = sheet_of(material)
    return sheet.density if sheet else SILICONE_DENSITY


def casting_of(product: str) -> Casting | None:
    """Return the casting data of a product; None if unknown."""
    return CASTING.get(product)
