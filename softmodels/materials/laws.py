"""Hyperelastic laws: one frozen dataclass each, which carries all that is known of it.

Every law is an energy per reference volume W = shape(F) + bulk/2 (J - 1)^2, stress-free at F = I. The shape part is what a
law states; the volumetric part is common, and becomes p (J - 1) - p^2 / (2 bulk) in the mixed form, so that
``poisson = 0.5`` (an infinite bulk) is an ordinary value there. See `softmodels.materials.material` for how to add a law.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import ClassVar

from geometries.errors import FieldError
from geometries.kinds import Quantity, Several
from measurement.arguments import checked
from softmodels.materials.material import (
    LAWS,
    Material,
    MaterialError,
    Parameters,
    Values,
    parameter,
    poissons_ratio,
    register,
)
from softmodels.materials.quantities import with_prefix
from softmodels.materials.strain import Expression, StrainMeasures

__all__ = ["LAWS", "Gent", "Material", "MaterialError", "MooneyRivlin", "NeoHookean", "Ogden", "Yeoh"]

MODULUS_BOUNDS = (1.0, 1e9)
"""Bounds of a fit on a shear modulus in Pa."""


@register
@dataclasses.dataclass(frozen=True)
class NeoHookean(Material):
    """Neo-Hookean silicone, compressible: the thesis' law made stress-free.

    W = mu/2 (I1 - 3) - mu ln J + lambda/2 (J - 1)^2, with lambda = 2 mu nu / (1 - 2 nu). The thesis prints (3.1)
    W = C1 (I1 - 3) + D1 (J - 1)^2 with C1 = mu/2 and D1 = lambda/2; as it stands that has the stress 2 C1 F at F = I. The
    term -2 C1 ln J takes it away and leaves Lame's constants what they are (Bonet & Wood 2008, section 6.4.3).
    """

    name: ClassVar[str] = "neo-hookean"
    linear: ClassVar[bool] = True
    isochoric: ClassVar[bool] = False
    alternatives: ClassVar[Mapping[str, tuple[str, str]]] = {
        "young": ("Pa", "Young's modulus, in place of the shear modulus"),
        "c1": ("Pa", "the thesis' C1 = mu/2"),
        "d1": ("Pa", "the thesis' D1 = lambda/2, with --c1 = mu/2, in place of modulus and Poisson's ratio"),
    }
    shear_modulus: float = parameter("Pa", "shear modulus mu", bounds=MODULUS_BOUNDS)
    poisson: float = poissons_ratio()  # type: ignore[assignment]

    @staticmethod
    def shape(strain: StrainMeasures, m: Parameters) -> Expression:
        return m.shear_modulus / 2 * (strain.I1 - 3) - m.shear_modulus * strain.log(strain.J)

    @property
    def shear_modulus_0(self) -> float:
        return self.shear_modulus

    @property
    def bulk(self) -> float:
        """Lame's first constant lambda in Pa: here the shape part resists a change of volume too."""
        nu = self.poisson
        return math.inf if nu == 0.5 else 2 * self.shear_modulus * nu / (1 - 2 * nu)

    @property
    def invariant_terms(self) -> Mapping[tuple[int, int], float]:
        return {(1, 0): self.shear_modulus / 2}

    @classmethod
    def from_values(cls, values: Values, convention: str = "") -> NeoHookean:
        if values.keys() <= {"shear_modulus", "poisson"}:
            return cls(**values)
        if values.keys() <= {"young", "poisson"}:
            return cls.from_young(**values)
        if values.keys() == {"c1", "d1"}:
            return cls.from_c1_d1(**values)
        raise MaterialError(
            "neo-hookean takes shear_modulus and poisson, or young and poisson, or c1 and d1; "
            f"got {', '.join(sorted(values))}"
        )

    @classmethod
    @checked
    def from_young(cls, young: float, poisson: float = 0.49) -> NeoHookean:
        """From Young's modulus in Pa: mu = E / (2 (1 + nu))."""
        young, poisson = _number(cls, "young", young), _number(cls, "poisson", poisson, "")
        if poisson == -1.0:
            raise MaterialError("neo-hookean: poisson = -1 is outside -1 to 0.5")  # ahead of a division by zero
        return cls(young / (2 * (1 + poisson)), poisson)

    @classmethod
    @checked
    def from_c1_d1(cls, c1: float, d1: float) -> NeoHookean:
        """From the thesis' constants in Pa: mu = 2 C1, lambda = 2 D1."""
        c1, d1 = _number(cls, "c1", c1), _number(cls, "d1", d1)
        if c1 + d1 == 0.0:
            raise MaterialError("neo-hookean: c1 + d1 is zero, so Poisson's ratio does not exist")
        return cls(2 * c1, d1 / (2 * (c1 + d1)))


@register
@dataclasses.dataclass(frozen=True)
class MooneyRivlin(Material):
    """Mooney-Rivlin: W = c10 (I1_bar - 3) + c01 (I2_bar - 3); mu = 2 (c10 + c01). Rivlin 1948, doi 10.1098/rsta.1948.0024."""

    name: ClassVar[str] = "mooney-rivlin"
    linear: ClassVar[bool] = True
    c10: float = parameter("Pa", "factor of I1 - 3")
    c01: float = parameter("Pa", "factor of I2 - 3", 0.0)
    poisson: float = poissons_ratio()  # type: ignore[assignment]

    @staticmethod
    def shape(strain: StrainMeasures, m: Parameters) -> Expression:
        return m.c10 * (strain.I1_bar - 3) + m.c01 * (strain.I2_bar - 3)

    @property
    def shear_modulus_0(self) -> float:
        return 2 * (self.c10 + self.c01)

    @property
    def invariant_terms(self) -> Mapping[tuple[int, int], float]:
        return {(1, 0): self.c10, (0, 1): self.c01}

    @classmethod
    def starting_values(cls, modulus: float, strain: float = 10.0, terms: int = 0) -> dict[str, float]:
        return {"c10": 0.4 * modulus, "c01": 0.1 * modulus}


@register
@dataclasses.dataclass(frozen=True)
class Yeoh(Material):
    """Yeoh: W = c1 k + c2 k^2 + c3 k^3 with k = I1_bar - 3; mu = 2 c1. Yeoh 1993, doi 10.5254/1.3538343."""

    name: ClassVar[str] = "yeoh"
    linear: ClassVar[bool] = True
    c1: float = parameter("Pa", "factor of I1 - 3: half the shear modulus", bounds=(0.0, math.inf))
    c2: float = parameter("Pa", "factor of (I1 - 3)^2", 0.0)
    c3: float = parameter("Pa", "factor of (I1 - 3)^3", 0.0)
    poisson: float = poissons_ratio()  # type: ignore[assignment]

    @staticmethod
    def shape(strain: StrainMeasures, m: Parameters) -> Expression:
        k = strain.I1_bar - 3
        return m.c1 * k + m.c2 * k**2 + m.c3 * k**3

    @property
    def shear_modulus_0(self) -> float:
        return 2 * self.c1

    @property
    def invariant_terms(self) -> Mapping[tuple[int, int], float]:
        return {(1, 0): self.c1, (2, 0): self.c2, (3, 0): self.c3}

    @classmethod
    def starting_values(cls, modulus: float, strain: float = 10.0, terms: int = 0) -> dict[str, float]:
        return {"c1": modulus / 2, "c2": 0.01 * modulus / strain, "c3": 0.0}


@register
@dataclasses.dataclass(frozen=True)
class Ogden(Material):
    """Ogden: W = sum_i mu_i/alpha_i (l1^alpha_i + l2^alpha_i + l3^alpha_i - 3), isochoric stretches; mu = sum mu_i alpha_i / 2.

    Ogden 1972, doi 10.1098/rspa.1972.0026. Many programs write 2 mu_i / alpha_i^2 in place of mu_i / alpha_i: see
    `from_two_mu`. The same numbers read in the other way are another rubber.
    """

    name: ClassVar[str] = "ogden"
    title: ClassVar[str] = "Ogden's law"
    most_terms: ClassVar[int] = 4
    usual_terms: ClassVar[int] = 2
    compared_terms: ClassVar[tuple[int, ...]] = (1, 2, 3)
    conventions: ClassVar[tuple[str, ...]] = ("mu/alpha", "2mu/alpha^2")
    convention_help: ClassVar[str] = "how mu and alpha are meant: W = sum mu/alpha (...) or sum 2mu/alpha^2 (...)"
    mu: tuple[float, ...] = parameter(
        "Pa", "factors mu_i of W = sum mu_i/alpha_i (...), with commas", bounds=(1e-6, 1e12), many=True
    )
    alpha: tuple[float, ...] = parameter(
        "", "exponents alpha_i, with commas", bounds=(0.05, 30.0), many=True,
        grid=(0.7, 1.3, 2.0, 3.0, 4.5, 7.0, 11.0, -0.7, -1.3, -2.0, -4.0),
    )  # fmt: skip
    poisson: float = poissons_ratio()  # type: ignore[assignment]

    def check(self) -> None:
        if len(self.mu) != len(self.alpha) or not self.mu:
            raise MaterialError(
                f"ogden: {len(self.mu)} values of mu and {len(self.alpha)} of alpha; they come in pairs"
            )
        if 0.0 in self.alpha:
            raise MaterialError("ogden: an exponent alpha is zero")

    @staticmethod
    def shape(strain: StrainMeasures, m: Parameters) -> Expression:
        a, b, c = strain.stretches_bar
        return sum(
            m.mu[i] / m.alpha[i] * (a ** m.alpha[i] + b ** m.alpha[i] + c ** m.alpha[i] - 3) for i in _terms(m.mu)
        )

    @property
    def shear_modulus_0(self) -> float:
        return sum(mu * alpha for mu, alpha in zip(self.mu, self.alpha, strict=True)) / 2

    @property
    def stretch_terms(self) -> tuple[tuple[float, float], ...]:
        return tuple(zip(self.mu, self.alpha, strict=True))

    @classmethod
    def parameter_bounds(cls, name: str, start: Mapping[str, float]) -> tuple[float, float]:
        """mu_i keeps the sign of its alpha_i, and this its own, which is what makes every term stable (Ogden 1972)."""
        low, high = super().parameter_bounds(name, start)
        number = name.removeprefix("alpha").removeprefix("mu")
        return (low, high) if start[f"alpha{number}"] > 0.0 else (-high, -low)

    @classmethod
    def starting_values(cls, modulus: float, strain: float = 10.0, terms: int = 2) -> dict[str, float]:
        shares = (0.9, 0.05, 0.05, 0.01)[:terms] if terms > 1 else (1.0,)
        values: dict[str, float] = {}
        for i, (alpha, share) in enumerate(zip((2.0, 5.0, -2.0, 9.0)[:terms], shares, strict=True), 1):
            values |= {f"mu{i}": 2 * modulus * share / alpha, f"alpha{i}": alpha}
        return values

    @property
    def remark(self) -> str:
        factors = (" ".join(with_prefix(mu * a / 2, "Pa")) for mu, a in zip(self.mu, self.alpha, strict=True))
        own, other = self.conventions
        return f"mu is meant as W = sum {own} (...); in the convention {other} the factors are {', '.join(factors)}"

    @classmethod
    def from_values(cls, values: Values, convention: str = "") -> Ogden:
        return cls.from_two_mu(**values) if convention == cls.conventions[1] else cls(**values)

    @classmethod
    @checked
    def from_two_mu(cls, mu: tuple[float, ...], alpha: tuple[float, ...], poisson: float = 0.49) -> Ogden:
        """From the convention W = sum 2 mu_i/alpha_i^2 (...), in which the shear modulus is the sum of the mu_i (Pa)."""
        try:
            mu = Several(Quantity("Pa")).settled("mu", mu)  # type: ignore[assignment]
            alpha = Several(Quantity()).settled("alpha", alpha)  # type: ignore[assignment]
        except FieldError as error:
            raise MaterialError(f"ogden: {error}") from None
        if len(mu) != len(alpha) or 0.0 in alpha:
            raise MaterialError("ogden: mu and alpha come in pairs, and no alpha is zero")
        return cls(tuple(2 * m / a for m, a in zip(mu, alpha, strict=True)), tuple(alpha), poisson)


def _number(law: type[Material], name: str, value: object, unit: str = "Pa") -> float:
    """A number that stands in for a parameter; `MaterialError` if it is none."""
    try:
        return Quantity(unit).settled(name, value)
    except FieldError as error:
        raise MaterialError(f"{law.name}: {error}") from None


def _terms(values: Expression) -> range:
    shape = getattr(values, "ufl_shape", None)
    return range(shape[0] if shape else len(values))


@register
@dataclasses.dataclass(frozen=True)
class Gent(Material):
    """Gent: W = -mu/2 Jm ln(1 - (I1_bar - 3)/Jm); chains are taut at I1_bar = 3 + Jm. Gent 1996, doi 10.5254/1.3538357."""

    name: ClassVar[str] = "gent"
    shear_modulus: float = parameter("Pa", "shear modulus mu", bounds=MODULUS_BOUNDS)
    limit: float = parameter("", "Jm: the largest I1 - 3 the chains allow", bounds=(1e-2, 1e5))
    poisson: float = poissons_ratio()  # type: ignore[assignment]

    def check(self) -> None:
        if self.limit <= 0.0:
            raise MaterialError(f"gent: limit = {self.limit:g}; it must be above zero")

    @staticmethod
    def shape(strain: StrainMeasures, m: Parameters) -> Expression:
        return -m.shear_modulus / 2 * m.limit * strain.log(1 - (strain.I1_bar - 3) / m.limit)

    @property
    def shear_modulus_0(self) -> float:
        return self.shear_modulus

    @property
    def strain_limit(self) -> float:
        return self.limit

    @classmethod
    def starting_values(cls, modulus: float, strain: float = 10.0, terms: int = 0) -> dict[str, float]:
        return {"shear_modulus": modulus, "limit": 5 * strain}

    @classmethod
    def starting_grid(cls, modulus: float, strain: float) -> list[dict[str, float]]:
        return [{"shear_modulus": modulus, "limit": share * strain} for share in (1.02, 1.2, 2.0, 6.0, 40.0)]
