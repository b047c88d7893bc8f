"""Hyperelastic laws: one frozen dataclass each, its energy in two lines.

Every law is an energy per reference volume W = shape(F) + bulk/2 (J - 1)^2, stress-free at F = I. The shape part is what a
law states; the volumetric part is common, and becomes p (J - 1) - p^2 / (2 bulk) in the mixed form, so that
``poisson = 0.5`` (an infinite bulk) is an ordinary value there.

`shape` is a static method of the strain and of anything that carries the law's parameters by name: the dataclass itself
(numpy) or UFL constants of the same names (so a new parameter value compiles nothing).

A new law is one class here and one line in `LAWS`.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, ClassVar

from softmodels.materials.strain import StrainMeasures


class MaterialError(ValueError):
    """An impossible or unknown material; the message is a sentence for the user."""


def _parameter(unit: str, text: str, default: Any = dataclasses.MISSING) -> Any:
    return dataclasses.field(default=default, metadata={"unit": unit, "help": text})


def _poisson() -> Any:
    return _parameter("", "Poisson's ratio at small strain, -1 to 0.5", 0.49)


@dataclasses.dataclass(frozen=True)
class Material:
    """Interface of a law. Parameters are in Pa or dimensionless; see each class."""

    name: ClassVar[str]

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            values = getattr(self, field.name)
            for value in values if isinstance(values, tuple) else (values,):
                if not math.isfinite(value):
                    raise MaterialError(f"{self.name}: {field.name} = {value} is not a finite number")
        if not -1.0 < self.poisson <= 0.5:
            raise MaterialError(f"{self.name}: poisson = {self.poisson:g} is outside -1 to 0.5")
        self.check()
        if not self.shear_modulus_0 > 0.0:
            raise MaterialError(
                f"{self.name}: the shear modulus at small strain is {self.shear_modulus_0:g} Pa; it must be above zero"
            )

    def check(self) -> None:
        """Raise `MaterialError` for parameters this law cannot take."""

    @staticmethod
    def shape(strain: StrainMeasures, m: Any) -> Any:
        """Energy of the change of shape in Pa; ``m`` carries the parameters by name."""
        raise NotImplementedError

    @property
    def poisson(self) -> float:
        raise NotImplementedError

    @property
    def shear_modulus_0(self) -> float:
        """Shear modulus in Pa at small strain."""
        raise NotImplementedError

    @property
    def bulk(self) -> float:
        """Factor in Pa of (J - 1)^2 / 2; infinite at ``poisson = 0.5``. The bulk modulus, where `shape` is isochoric."""
        if self.poisson == 0.5:
            return math.inf
        return 2 * self.shear_modulus_0 * (1 + self.poisson) / (3 * (1 - 2 * self.poisson))

    def energy(self, strain: StrainMeasures) -> Any:
        """Energy in Pa of a compressible deformation. With an infinite bulk only J = 1 has one, and it is the shape's."""
        shape = self.shape(strain, self)
        return shape if math.isinf(self.bulk) else shape + self.bulk / 2 * (strain.J - 1) ** 2


@dataclasses.dataclass(frozen=True)
class NeoHookean(Material):
    """Neo-Hookean silicone, compressible: the thesis' law made stress-free.

    W = mu/2 (I1 - 3) - mu ln J + lambda/2 (J - 1)^2, with lambda = 2 mu nu / (1 - 2 nu). The thesis prints (3.1)
    W = C1 (I1 - 3) + D1 (J - 1)^2 with C1 = mu/2 and D1 = lambda/2; as it stands that has the stress 2 C1 F at F = I. The
    term -2 C1 ln J takes it away and leaves Lame's constants what they are (Bonet & Wood 2008, section 6.4.3).
    """

    name: ClassVar[str] = "neo-hookean"
    shear_modulus: float = _parameter("Pa", "shear modulus mu")
    poisson: float = _poisson()  # type: ignore[assignment]

    @staticmethod
    def shape(strain: StrainMeasures, m: Any) -> Any:
        return m.shear_modulus / 2 * (strain.I1 - 3) - m.shear_modulus * strain.log(strain.J)

    @property
    def shear_modulus_0(self) -> float:
        return self.shear_modulus

    @property
    def bulk(self) -> float:
        """Lame's first constant lambda in Pa: here the shape part resists a change of volume too."""
        nu = self.poisson
        return math.inf if nu == 0.5 else 2 * self.shear_modulus * nu / (1 - 2 * nu)

    @classmethod
    def from_young(cls, young: float, poisson: float = 0.49) -> NeoHookean:
        """From Young's modulus in Pa: mu = E / (2 (1 + nu))."""
        return cls(young / (2 * (1 + poisson)), poisson)

    @classmethod
    def from_c1_d1(cls, c1: float, d1: float) -> NeoHookean:
        """From the thesis' constants in Pa: mu = 2 C1, lambda = 2 D1."""
        if c1 + d1 == 0.0:
            raise MaterialError("neo-hookean: c1 + d1 is zero, so Poisson's ratio does not exist")
        return cls(2 * c1, d1 / (2 * (c1 + d1)))


@dataclasses.dataclass(frozen=True)
class MooneyRivlin(Material):
    """Mooney-Rivlin: W = c10 (I1_bar - 3) + c01 (I2_bar - 3); mu = 2 (c10 + c01). Rivlin 1948, doi 10.1098/rsta.1948.0024."""

    name: ClassVar[str] = "mooney-rivlin"
    c10: float = _parameter("Pa", "factor of I1 - 3")
    c01: float = _parameter("Pa", "factor of I2 - 3", 0.0)
    poisson: float = _poisson()  # type: ignore[assignment]

    @staticmethod
    def shape(strain: StrainMeasures, m: Any) -> Any:
        return m.c10 * (strain.I1_bar - 3) + m.c01 * (strain.I2_bar - 3)

    @property
    def shear_modulus_0(self) -> float:
        return 2 * (self.c10 + self.c01)


@dataclasses.dataclass(frozen=True)
class Yeoh(Material):
    """Yeoh: W = c1 k + c2 k^2 + c3 k^3 with k = I1_bar - 3; mu = 2 c1. Yeoh 1993, doi 10.5254/1.3538343."""

    name: ClassVar[str] = "yeoh"
    c1: float = _parameter("Pa", "factor of I1 - 3: half the shear modulus")
    c2: float = _parameter("Pa", "factor of (I1 - 3)^2", 0.0)
    c3: float = _parameter("Pa", "factor of (I1 - 3)^3", 0.0)
    poisson: float = _poisson()  # type: ignore[assignment]

    @staticmethod
    def shape(strain: StrainMeasures, m: Any) -> Any:
        k = strain.I1_bar - 3
        return m.c1 * k + m.c2 * k**2 + m.c3 * k**3

    @property
    def shear_modulus_0(self) -> float:
        return 2 * self.c1


@dataclasses.dataclass(frozen=True)
class Ogden(Material):
    """Ogden: W = sum_i mu_i/alpha_i (l1^alpha_i + l2^alpha_i + l3^alpha_i - 3), isochoric stretches; mu = sum mu_i alpha_i / 2.

    Ogden 1972, doi 10.1098/rspa.1972.0026. Many programs write 2 mu_i / alpha_i^2 in place of mu_i / alpha_i: see
    `from_two_mu`. The same numbers read in the other way are another rubber.
    """

    name: ClassVar[str] = "ogden"
    mu: tuple[float, ...] = _parameter("Pa", "factors mu_i of W = sum mu_i/alpha_i (...), with commas")
    alpha: tuple[float, ...] = _parameter("", "exponents alpha_i, with commas")
    poisson: float = _poisson()  # type: ignore[assignment]

    def check(self) -> None:
        if len(self.mu) != len(self.alpha) or not self.mu:
            raise MaterialError(
                f"ogden: {len(self.mu)} values of mu and {len(self.alpha)} of alpha; they come in pairs"
            )
        if 0.0 in self.alpha:
            raise MaterialError("ogden: an exponent alpha is zero")

    @staticmethod
    def shape(strain: StrainMeasures, m: Any) -> Any:
        a, b, c = strain.stretches_bar
        return sum(
            m.mu[i] / m.alpha[i] * (a ** m.alpha[i] + b ** m.alpha[i] + c ** m.alpha[i] - 3) for i in _terms(m.mu)
        )

    @property
    def shear_modulus_0(self) -> float:
        return sum(mu * alpha for mu, alpha in zip(self.mu, self.alpha, strict=True)) / 2

    @classmethod
    def from_two_mu(cls, mu: tuple[float, ...], alpha: tuple[float, ...], poisson: float = 0.49) -> Ogden:
        """From the convention W = sum 2 mu_i/alpha_i^2 (...), in which the shear modulus is the sum of the mu_i (Pa)."""
        if len(mu) != len(alpha) or 0.0 in alpha:
            raise MaterialError("ogden: mu and alpha come in pairs, and no alpha is zero")
        return cls(tuple(2 * m / a for m, a in zip(mu, alpha, strict=True)), tuple(alpha), poisson)


def _terms(values: Any) -> range:
    shape = getattr(values, "ufl_shape", None)
    return range(shape[0] if shape else len(values))


@dataclasses.dataclass(frozen=True)
class Gent(Material):
    """Gent: W = -mu/2 Jm ln(1 - (I1_bar - 3)/Jm); chains are taut at I1_bar = 3 + Jm. Gent 1996, doi 10.5254/1.3538357."""

    name: ClassVar[str] = "gent"
    shear_modulus: float = _parameter("Pa", "shear modulus mu")
    limit: float = _parameter("", "Jm: the largest I1 - 3 the chains allow")
    poisson: float = _poisson()  # type: ignore[assignment]

    def check(self) -> None:
        if self.limit <= 0.0:
            raise MaterialError(f"gent: limit = {self.limit:g}; it must be above zero")

    @staticmethod
    def shape(strain: StrainMeasures, m: Any) -> Any:
        return -m.shear_modulus / 2 * m.limit * strain.log(1 - (strain.I1_bar - 3) / m.limit)

    @property
    def shear_modulus_0(self) -> float:
        return self.shear_modulus


LAWS: dict[str, type[Material]] = {law.name: law for law in (NeoHookean, MooneyRivlin, Yeoh, Ogden, Gent)}
"""Every law by the name that a command line or a case file uses."""
