"""Measures of strain, the base class of material laws, and the table of laws by name.

A law is a frozen dataclass below `Material`. It has to define `Material.shape`, its energy, and
`Material.shear_modulus_0`. Its parameters are fields made by `parameter`, each with its unit, a help text and the bounds that
a fit keeps. All else has a default that a law may override: linearity in its parameters, starting
values of a fit, other parameters or conventions, locking strain. So a law is a single class, also outside this
library; `register` makes it available by name to command lines and files.
"""

from __future__ import annotations

import cmath
import dataclasses
import functools
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Self

import numpy as np

from softmodels.common import errors, names, schema, units
from softmodels.common.lazy import ufl
from softmodels.common.names import checked
from softmodels.materials.memory import Expression, Memory

__all__ = [
    "LAWS", "Carroll", "FungDemiray", "Gent", "Material", "MaterialError", "MooneyRivlin", "NeoHookean", "Ogden", "Polynomial",
    "Yeoh",
]  # fmt: skip


# ----------------------------------------------------------------------------------------------------------------------
# Measures of strain under one set of names, for UFL fields and for numpy numbers.
#
# An energy is written once against these names. `Strain` builds them from a deformation gradient in UFL, and
# `HomogeneousStrain` from principal stretches in numpy: numbers, or `Dual` numbers, which carry a derivative.


class StrainMeasures:
    """Strain measures available to an energy, in UFL and numpy. All dimensionless.

    Attributes:
        J: Volume ratio det F.
        I1: First invariant tr C.
        I2: Second invariant of C.
        I1_bar: First invariant of the isochoric part, J^(-2/3) I1.
        I2_bar: Second invariant of the isochoric part, J^(-4/3) I2.
        stretches_bar: The three isochoric principal stretches J^(-1/3) lambda_i.
        uniaxial_I2: ``I2_bar`` of the uniaxial tension that has the same ``I1_bar``.
        log, exp: The natural logarithm and the exponential of numbers of this kind.
    """

    J: Expression
    I1: Expression
    I2: Expression
    stretches_bar: Expression
    uniaxial_I2: Expression
    log: Expression
    exp: Expression

    @functools.cached_property
    def I1_bar(self) -> Expression:
        return self.J ** (-2 / 3) * self.I1

    @functools.cached_property
    def I2_bar(self) -> Expression:
        return self.J ** (-4 / 3) * self.I2


@dataclasses.dataclass(frozen=True, eq=False)
class Strain(StrainMeasures):
    """Strain measures of a UFL deformation gradient ``F`` (3 x 3)."""

    F: Expression

    @functools.cached_property
    def C(self) -> Expression:
        return self.F.T * self.F

    @functools.cached_property
    def J(self) -> Expression:
        return ufl.det(self.F)

    @functools.cached_property
    def I1(self) -> Expression:
        return ufl.tr(self.C)

    @functools.cached_property
    def I2(self) -> Expression:
        return (self.I1**2 - ufl.inner(self.C, self.C)) / 2

    @functools.cached_property
    def stretches_bar(self) -> tuple[Expression, Expression, Expression]:
        return tuple(ufl.sqrt(value) for value in eigenvalues(self.J ** (-2 / 3) * self.C))  # type: ignore[return-value]

    @functools.cached_property
    def uniaxial_I2(self) -> Expression:
        return _uniaxial_I2(uniaxial_stretch(self.I1_bar, ufl.acos, ufl.cos))

    @staticmethod
    def log(x: Expression) -> Expression:
        return ufl.ln(x)

    @staticmethod
    def exp(x: Expression) -> Expression:
        return ufl.exp(x)


def uniaxial_stretch(I1: Expression, acos: Expression = np.arccos, cos: Expression = np.cos, gap: float = 1e-8) -> Expression:
    """Return the stretch above 1 of the uniaxial tension with an invariant I1 = l^2 + 2 / l (Viete's form of the cubic's root);
    a ``gap`` keeps its derivative finite at rest."""
    return 2 * (I1 / 3) ** 0.5 * cos(acos((gap - 1) * (3 / I1) ** 1.5) / 3)


def _uniaxial_I2(stretch: Expression) -> Expression:
    return 2 * stretch + stretch**-2


def eigenvalues(A: Expression, gap: float = 1e-4) -> tuple[Expression, Expression, Expression]:
    """Return the eigenvalues of a symmetric 3 x 3 UFL tensor near the identity's size, differentiable where they coincide.

    The trigonometric closed form (Smith 1961, doi 10.1145/355578.366316) has no derivative at repeated eigenvalues, which
    is where every simulation starts. Its radius and its cosine are kept ``gap`` away from their singular values; since
    they stay isotropic functions of A, sums over the eigenvalues are off by about ``gap**2`` only, and a second derivative
    loses about ``1e-16 / gap**2``: the two meet at the default.
    """
    mean = ufl.tr(A) / 3
    deviator = A - mean * ufl.Identity(3)
    radius = ufl.sqrt(ufl.inner(deviator, deviator) / 6 + gap**2)
    cosine = (1 - gap**2) * ufl.det(deviator) / (2 * radius**3)
    angle = ufl.acos(cosine) / 3
    first, second = (mean + 2 * radius * ufl.cos(angle + shift) for shift in (0.0, 2 * np.pi / 3))
    return first, second, 3 * mean - first - second


@dataclasses.dataclass(frozen=True, eq=False)
class HomogeneousStrain(StrainMeasures):
    """Strain measures of principal stretches: numpy arrays of one shape, real or complex, or `Dual`."""

    stretches: tuple[Expression, Expression, Expression]

    @functools.cached_property
    def J(self) -> Expression:
        a, b, c = self.stretches
        return a * b * c

    @functools.cached_property
    def I1(self) -> Expression:
        a, b, c = self.stretches
        return a * a + b * b + c * c

    @functools.cached_property
    def I2(self) -> Expression:
        a, b, c = self.stretches
        return (a * b) ** 2 + (b * c) ** 2 + (c * a) ** 2

    @functools.cached_property
    def stretches_bar(self) -> tuple[Expression, Expression, Expression]:
        scale = self.J ** (-1 / 3)
        a, b, c = self.stretches
        return scale * a, scale * b, scale * c

    @functools.cached_property
    def uniaxial_I2(self) -> Expression:
        if not isinstance(self.I1_bar, Dual):
            return _uniaxial_I2(uniaxial_stretch(self.I1_bar))
        stretch = uniaxial_stretch(self.I1_bar.value)
        return Dual(_uniaxial_I2(stretch), self.I1_bar.slope / stretch)

    @staticmethod
    def log(x: Expression) -> Expression:
        return x.log() if isinstance(x, Dual) else np.log(x)

    @staticmethod
    def exp(x: Expression) -> Expression:
        return x.exp() if isinstance(x, Dual) else np.exp(x)


# ----------------------------------------------------------------------------------------------------------------------
# Dual numbers: forward differentiation of the energies, exact to rounding.
#
# An energy accepts them instead of stretches. Complex values are allowed, so that a complex step through the same energy gives
# a second derivative: by another stretch, or by a parameter of the law.


@dataclasses.dataclass(frozen=True, eq=False)
class Dual:
    """A value and its slope; numpy arrays of one shape, real or complex."""

    value: Expression
    slope: Expression
    __array_ufunc__ = None  # numpy's arrays defer the operation to this class

    def __add__(self, other: Expression) -> Dual:
        if isinstance(other, Dual):
            return Dual(self.value + other.value, self.slope + other.slope)
        return Dual(self.value + other, self.slope)

    __radd__ = __add__

    def __neg__(self) -> Dual:
        return Dual(-self.value, -self.slope)

    def __sub__(self, other: Expression) -> Dual:
        return self + -other

    def __rsub__(self, other: Expression) -> Dual:
        return -self + other

    def __mul__(self, other: Expression) -> Dual:
        if isinstance(other, Dual):
            return Dual(self.value * other.value, self.slope * other.value + self.value * other.slope)
        return Dual(self.value * other, self.slope * other)

    __rmul__ = __mul__

    def __truediv__(self, other: Expression) -> Dual:
        return self * other**-1.0

    def __rtruediv__(self, other: Expression) -> Dual:
        return self**-1.0 * other

    def __pow__(self, power: Expression) -> Dual:
        lower = self.value ** (power - 1)  # a single power for both, because powers take most of the time
        return Dual(lower * self.value, power * lower * self.slope)

    def log(self) -> Dual:
        return Dual(np.log(self.value), self.slope / self.value)

    def exp(self) -> Dual:
        value = np.exp(self.value)
        return Dual(value, value * self.slope)


# ----------------------------------------------------------------------------------------------------------------------
# What a law is, the table of laws, and every law.


Values = Mapping[str, Any]
"""Numbers by the names of a law's fields; tuples of numbers for fields with one per term."""

Parameters = Any
"""A law's parameters by name: a material (numbers), or UFL constants, so that new values do not recompile."""

MIN_SHEAR_MODULUS = 500.0
"""Minimum shear modulus in Pa of a silicone: of the softest gels, with a margin."""
MAX_SHEAR_MODULUS = 5e6
"""Maximum shear modulus in Pa of a silicone or soft rubber, with a margin; above it a wrong unit is likely."""


FORM = "law_form"
"""Name of the factor of `form_energy` beside the parameters of a law, where only derivatives by it are meant."""
SHARE = "law_share"
"""The same of `share_energy`."""
FORM_RANGE = 0.0, 0.5
"""Factors of `form_energy` that rubbers have beside a law of I1: shares of I2 in the small-strain modulus, as in plots of
Mooney from swollen to dry rubber (Gumbrell, Mullins & Rivlin 1953, doi 10.1039/TF9534901495)."""


def form_energy(strain: StrainMeasures) -> Expression:
    """Return the energy in small-strain shear moduli by which laws with one curve in uniaxial tension may differ.

    It is sqrt(3) (sqrt(I2) - sqrt(I2 of the uniaxial tension with the same I1)): an energy of I2 whose part falls with the
    strain as it does in rubber (Carroll 2011, doi 10.1007/s10659-010-9279-0), minus the energy of I1 that has the same
    uniaxial curve.
    """
    return math.sqrt(3.0) * (strain.I2_bar**0.5 - strain.uniaxial_I2**0.5)


def share_energy(strain: StrainMeasures) -> Expression:
    """Return the energy in small-strain shear moduli by which laws with one small-strain modulus may differ, whatever their
    curves in uniaxial tension: that of I2 in `form_energy`, minus one of I1.

    A law of I1 with this energy is a rubber with a share of I2; with `form_energy` it is not quite: in small tension I1 - 3
    goes as the square of the strain, I2 - I1 as its cube, and no rubber's energy has a power of 3/2 of I1 - 3. Where no pull
    says what the law's own curve is, data would see that power long before they see the share.
    """
    return math.sqrt(3.0) * strain.I2_bar**0.5 - 0.5 * strain.I1_bar - 1.5  # 0 at rest


FORM_ENERGIES = {FORM: form_energy, SHARE: share_energy}
"""Energies beside a law by the name of their factor."""


class MaterialError(errors.OptionMessage, ValueError):
    """An invalid or unknown material; the message is for the user."""


def parameter(
    unit: str,
    text: str,
    default: object = dataclasses.MISSING,
    bounds: tuple[float, float] = (-math.inf, math.inf),
    many: bool = False,
    grid: tuple[float, ...] = (),
) -> Any:
    """Return a field of a law.

    Args:
        unit: ``"Pa"`` or ``""``.
        text: What it is, for help texts.
        default: Its value where none is given.
        bounds: Within which a fit keeps it.
        many: Whether it is a tuple with a number for each term.
        grid: Of a shape parameter of terms: values that a fit tries first.
    """
    return dataclasses.field(
        default=default, metadata={"unit": unit, "help": text, "bounds": bounds, "many": many, "grid": grid}
    )


def poissons_ratio() -> float:
    """Return the field ``poisson``, the last one of every law."""
    return parameter("", "Poisson's ratio at small strain, -1 to 0.5", DEFAULT_POISSON_RATIO, bounds=(-1.0, 0.5))


def parameter_fields(law: Material | type[Material]) -> list[dataclasses.Field[Any]]:
    """Return the fields of a law that are its `parameter`s, in their order."""
    return [field for field in dataclasses.fields(law) if "unit" in field.metadata]


def _check_range(law: str, stretches: tuple[float, float] | None) -> None:
    if stretches is None:
        return
    try:
        low, high = map(float, stretches)
    except (TypeError, ValueError):
        low, high = math.nan, math.nan
    if not 0.0 < low < high < math.inf:
        raise MaterialError(f"{law}: fitted_stretch = {stretches} is not a range of stretch; write it like [1.02, 3.0]")


# ----------------------------------------------------------------------------------------------------------------------
# Interface of a law.


DEFAULT_POISSON_RATIO = 0.5
"""Poisson's ratio where none is given: rubber's bulk modulus is some 1e5 times its shear modulus."""


@dataclasses.dataclass(frozen=True)
class Material:
    """Interface of a law. Parameters are in Pa or dimensionless; see each class.

    Attributes:
        name: What command lines and files call it.
        title: What sentences call it; the name if empty.
        source: Its publication, for reports; empty if there is none.
        linear: Whether the energy is linear in all parameters but Poisson's ratio.
        most_terms: Most terms that a fit can tell apart, of a law that is a sum of terms of one form; 0 for other laws. Each
            term has one factor in Pa, which enters linearly, and one shape parameter, which has a grid.
        usual_terms: Default number of terms.
        compared_terms: Numbers of terms that are compared where all laws are.
        alternatives: Numbers that stand in for parameters, see `from_values`: unit and help by name.
        isochoric: Whether `shape` depends only on the isochoric strain.
        conventions: Ways in which the same parameters are written, the law's own first; empty if there is only one.
        convention_help: What the conventions are.
        forms: Factors of `FORM_ENERGIES` by name, of copies nudged for a derivative by them.
        fitted_stretch: Range of stretch that the parameters were fitted over; None where that is not known. It is no part of
            the law: two materials that differ only in it are equal.
        memory: Relaxation and softening, where loads have times; the law itself is that of equilibrium. See `with_memory`.
    """

    name: ClassVar[str]
    title: ClassVar[str] = ""
    source: ClassVar[str] = ""
    linear: ClassVar[bool] = False
    most_terms: ClassVar[int] = 0
    usual_terms: ClassVar[int] = 0
    compared_terms: ClassVar[tuple[int, ...]] = (0,)
    alternatives: ClassVar[Mapping[str, tuple[str, str]]] = {}
    isochoric: ClassVar[bool] = True
    conventions: ClassVar[tuple[str, ...]] = ()
    convention_help: ClassVar[str] = ""
    forms: ClassVar[Mapping[str, complex]] = {}
    fitted_stretch: tuple[float, float] | None = dataclasses.field(default=None, kw_only=True, compare=False, repr=False)
    memory: Memory | None = dataclasses.field(default=None, kw_only=True, repr=False)

    def __post_init__(self) -> None:
        if type(self) is Material:
            raise MaterialError("Material is the base class of all laws; use one of them, such as Yeoh")
        _check_range(self.name, self.fitted_stretch)
        if not (self.memory is None or isinstance(self.memory, Memory)):
            raise MaterialError(f"{self.name}: memory is not a Memory; use with_memory(branches=..., softening=...)")
        for field in parameter_fields(self):
            of = schema.Quantity(field.metadata["unit"])
            kind = schema.Several(of) if field.metadata["many"] else of
            try:
                object.__setattr__(self, field.name, kind.settled(field.name, getattr(self, field.name)))
            except errors.FieldError as error:
                raise MaterialError(f"{self.name}: {error}") from None
        if not -1.0 < self.poisson <= 0.5:
            raise MaterialError(f"{self.name}: poisson = {self.poisson:g} is outside -1 to 0.5")
        self.check()
        if not self.shear_modulus_0 > 0.0:
            raise MaterialError(
                f"{self.name}: the shear modulus at small strain is {self.shear_modulus_0:g} Pa; it must be above zero"
            )

    @property
    def misread(self) -> str:
        """A sentence if its numbers look like those of another of its `conventions`; empty for most materials."""
        return ""

    # -- the energy ---------------------------------------------------------------------------------------------------

    def check(self) -> None:
        """Raise `MaterialError` for invalid parameters of this law."""

    @staticmethod
    def shape(strain: StrainMeasures, m: Parameters) -> Expression:
        """Return the energy of the change of shape in Pa.

        Args:
            strain: Measures of strain, in numpy or UFL.
            m: The parameters by name.
        """
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

    def energy(self, strain: StrainMeasures) -> Expression:
        """Return the energy in Pa of a compressible deformation. With an infinite bulk only J = 1 is possible, with the
        shape's energy."""
        shape = self.shape(strain, self)
        return shape if cmath.isinf(self.bulk) else shape + self.bulk / 2 * (strain.J - 1) ** 2

    def derivative(self, stretches: Sequence[Expression], change: Sequence[Expression], compressible: bool = False) -> Dual:
        """Return the energy at principal stretches with its derivative along their change, in Pa: all stresses in numpy.

        Args:
            stretches: The three; numpy arrays of one shape. A complex step in them or in a parameter gives the derivative of
                the derivative, exact to rounding (Squire & Trapp 1998, doi 10.1137/S003614459631241X).
            change: Of each, per unit of what is differentiated by.
            compressible: Whether the bulk's energy counts.
        """
        a, b, c = map(Dual, stretches, change)
        strain = HomogeneousStrain((a, b, c))
        energy = self.energy(strain) if compressible else self.shape(strain, self)
        for name, factor in self.forms.items():
            energy += factor * self.shear_modulus_0 * FORM_ENERGIES[name](strain)
        return energy

    @property
    def strain_limit(self) -> float:
        """I1 - 3 at which the chains lock; infinite without locking."""
        return math.inf

    @property
    def invariant_terms(self) -> Mapping[tuple[int, int], float]:
        """Factors in Pa of (I1_bar - 3)^i (I2_bar - 3)^j by (i, j), of a law that is their sum; empty for others."""
        return {}

    @property
    def stretch_terms(self) -> tuple[tuple[float, float], ...]:
        """Pairs (mu in Pa, alpha) of a law that is Ogden's sum over isochoric stretches, mu/alpha (...); empty for others."""
        return ()

    @checked
    def with_memory(self, branches: object = (), softening: object = None) -> Self:
        """Return the material with a memory, which acts where loads have times.

        Args:
            branches: Pairs of a share of the law's shear modulus at small strain, which stays that of equilibrium, and a
                relaxation time in s or as a text: ``[(0.2, 1.0), (0.1, "30 s")]``; or mappings of what
                `softmodels.materials.memory.Branch` has, for a viscosity that depends on stress and creep.
            softening: Mullins softening r, m in Pa and beta, perhaps with a recovery time: ``(1.6, "2 kPa", 0.1, "8 h")``.

        Raises:
            MaterialError: Numbers that make none.
        """
        try:
            memory = Memory.of(branches, softening)
        except errors.FieldError as error:
            raise MaterialError(f"{self.name}: {error}") from None
        return dataclasses.replace(self, memory=memory)

    @property
    def relaxed(self) -> Self:
        """The material without its memory: what it is after a long time."""
        return self if self.memory is None else dataclasses.replace(self, memory=None)

    # -- how it is written --------------------------------------------------------------------------------------------

    @classmethod
    def from_values(cls, values: Values, convention: str = "") -> Material:
        """Return a material from its parameters, or from numbers that stand in for them.

        Args:
            values: Fields and `alternatives` by name, in Pa or dimensionless.
            convention: One of `conventions`; empty for the law's own.

        Raises:
            MaterialError: No such combination, or the law cannot take them.
        """
        return cls(**values)

    @property
    def remark(self) -> str:
        """A remark on its parameters, such as their values in another convention; mostly empty."""
        return ""

    # -- how it is fitted ---------------------------------------------------------------------------------------------

    @property
    def terms(self) -> int:
        """Its number of terms; 0 for a law that is not a sum of similar terms."""
        return len(getattr(self, _term_fields(type(self))[0])) if self.most_terms else 0

    @classmethod
    def parameter_names(cls, terms: int = 0) -> tuple[str, ...]:
        """Return the names of its parameters without Poisson's ratio, numbered by term: ``mu1``, ``alpha1``, ``mu2``
        ..."""
        single = [f.name for f in parameter_fields(cls) if not f.metadata["many"] and f.name != "poisson"]
        return (*single, *(f"{name}{i + 1}" for i in range(terms) for name in _term_fields(cls)))

    @classmethod
    def parameter_unit(cls, name: str) -> str:
        """Return the unit of one of `parameter_names`."""
        return str(_field(cls, name).metadata["unit"])

    @classmethod
    def parameter_bounds(cls, name: str, start: Mapping[str, float]) -> tuple[float, float]:
        """Return the bounds of one of `parameter_names` in a fit that starts at ``start``."""
        low, high = _field(cls, name).metadata["bounds"]
        return low, high

    @classmethod
    def from_parameters(cls, values: Mapping[str, float], terms: int = 0, poisson: float = DEFAULT_POISSON_RATIO) -> Material:
        """Return a material from numbers by `parameter_names`; `MaterialError` if the law cannot take them."""
        single = {name: values[name] for name in cls.parameter_names()}
        many = {name: tuple(values[f"{name}{i + 1}"] for i in range(terms)) for name in _term_fields(cls)}
        return cls(**single, **many, poisson=poisson)  # type: ignore[call-arg, arg-type]

    @property
    def parameters(self) -> dict[str, float]:
        """Its numbers by `parameter_names`."""
        values = {name: float(getattr(self, name)) for name in self.parameter_names()}
        for i in range(self.terms):
            values |= {f"{name}{i + 1}": float(getattr(self, name)[i]) for name in _term_fields(type(self))}
        return values

    @classmethod
    def starting_values(cls, modulus: float, strain: float = 10.0, terms: int = 0) -> dict[str, float]:
        """Return starting values of a fit from the small-strain shear modulus.

        By default parameters in Pa that have no default value share the modulus, and numbers without one are 1, or twice the
        bound that 1 is beyond.

        Args:
            modulus: In Pa.
            strain: Largest I1 - 3 expected.
            terms: Number of terms.
        """
        fields = {name: _field(cls, name) for name in cls.parameter_names(terms)}
        plain = {k: _plain(f) if f.default is dataclasses.MISSING else float(f.default) for k, f in fields.items()}
        factor = modulus / cls.from_parameters(plain, terms).shear_modulus_0
        return {name: value * (factor if cls.parameter_unit(name) == "Pa" else 1.0) for name, value in plain.items()}

    @classmethod
    def starting_grid(cls, modulus: float, strain: float) -> list[dict[str, float]]:
        """Return several starts for a law that is neither linear nor a sum of terms; see `starting_values`."""
        return [cls.starting_values(modulus, strain)]


def _term_fields(law: type[Material]) -> list[str]:
    return [field.name for field in parameter_fields(law) if field.metadata["many"]]


def _plain(field: dataclasses.Field[Any]) -> float:
    low, high = field.metadata["bounds"]
    return 1.0 if low <= 1.0 <= high else 2.0 * float(low if low > 1.0 else high)


def _field(law: type[Material], name: str) -> dataclasses.Field[Any]:
    fields = {field.name: field for field in parameter_fields(law)}
    return fields[name] if name in fields else fields[name.rstrip("0123456789")]


LAWS: names.Registry[type[Material]] = names.Registry("law", lambda law: law.name)
"""Every law by the name that a command line or a case file uses."""
register_law = LAWS.register


def law_called(name: str) -> tuple[type[Material], int] | None:
    """Return the law of a name, and the number of its terms where the name ends in one, as of ``"ogden3"``, else 0; None if
    there is none. Large letters and separators do not count."""
    laws = {_plain_name(known): law for known, law in LAWS.items()}
    plain = _plain_name(name)
    if plain in laws:
        return laws[plain], 0
    law = laws.get(plain[:-1])
    return (law, int(plain[-1])) if law is not None and law.most_terms and plain[-1] in "123456789" else None


def _plain_name(name: str) -> str:
    return re.sub(r"[\W_]", "", name.lower())


# ----------------------------------------------------------------------------------------------------------------------
# Hyperelastic laws, a frozen dataclass each.
#
# Every law is an energy per reference volume W = shape(F) + bulk/2 (J - 1)^2, stress-free at F = I. The shape part defines
# a law; the volumetric part is common, and becomes p (J - 1) - p^2 / (2 bulk) in the mixed form, so that
# ``poisson = 0.5`` (an infinite bulk) is an ordinary value there.


MODULUS_BOUNDS = (1.0, 1e9)
"""Bounds of a fit on a shear modulus in Pa."""


@register_law
@dataclasses.dataclass(frozen=True)
class NeoHookean(Material):
    """Neo-Hookean silicone, compressible: the thesis' law made stress-free.

    W = mu/2 (I1 - 3) - mu ln J + lambda/2 (J - 1)^2, with lambda = 2 mu nu / (1 - 2 nu). The thesis prints (3.1)
    W = C1 (I1 - 3) + D1 (J - 1)^2 with C1 = mu/2 and D1 = lambda/2; as it stands that has the stress 2 C1 F at F = I. The
    term -2 C1 ln J takes it away and leaves Lame's constants what they are (Bonet & Wood 2008, section 6.4.3).
    """

    name: ClassVar[str] = "neo-hookean"
    source: ClassVar[str] = "Bonet & Wood 2008, Nonlinear continuum mechanics, doi 10.1017/CBO9780511755446"
    linear: ClassVar[bool] = True
    isochoric: ClassVar[bool] = False
    alternatives: ClassVar[Mapping[str, tuple[str, str]]] = {
        "young": ("Pa", "Young's modulus, instead of the shear modulus"),
        "c1": ("Pa", "the thesis' C1 = mu/2"),
        "d1": ("Pa", "the thesis' D1 = lambda/2, with --c1 = mu/2, instead of modulus and Poisson's ratio"),
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
        """Lame's first constant lambda in Pa, because the shape part also resists changes of volume here."""
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
            f"neo-hookean takes shear_modulus and poisson, or young and poisson, or c1 and d1; got {', '.join(sorted(values))}"
        )

    @classmethod
    @checked
    def from_young(cls, young: float, poisson: float = DEFAULT_POISSON_RATIO) -> NeoHookean:
        """From Young's modulus in Pa: mu = E / (2 (1 + nu))."""
        young, poisson = _number(cls, "young", young), _number(cls, "poisson", poisson, "")
        if poisson == -1.0:
            raise MaterialError("neo-hookean: poisson = -1 is outside -1 to 0.5")  # avoids a division by zero
        return cls(young / (2 * (1 + poisson)), poisson)

    @classmethod
    @checked
    def from_c1_d1(cls, c1: float, d1: float) -> NeoHookean:
        """From the thesis' constants in Pa: mu = 2 C1, lambda = 2 D1."""
        c1, d1 = _number(cls, "c1", c1), _number(cls, "d1", d1)
        if c1 + d1 == 0.0:
            raise MaterialError("neo-hookean: c1 + d1 is zero, so Poisson's ratio does not exist")
        return cls(2 * c1, d1 / (2 * (c1 + d1)))


@register_law
@dataclasses.dataclass(frozen=True)
class MooneyRivlin(Material):
    """Mooney-Rivlin: W = c10 (I1_bar - 3) + c01 (I2_bar - 3); mu = 2 (c10 + c01). Rivlin 1948, doi 10.1098/rsta.1948.0024."""

    name: ClassVar[str] = "mooney-rivlin"
    source: ClassVar[str] = "Rivlin 1948, Phil. Trans. R. Soc. A 241:379, doi 10.1098/rsta.1948.0024"
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


@register_law
@dataclasses.dataclass(frozen=True)
class Polynomial(Material):
    """Rivlin's polynomial of second order, with a = I1_bar - 3 and b = I2_bar - 3:
    W = c10 a + c01 b + c20 a^2 + c11 a b + c02 b^2; mu = 2 (c10 + c01). With c11 = c02 = 0 it is Signorini's.

    The numbers are those of ``*HYPERELASTIC, POLYNOMIAL, N=2`` in Abaqus and CalculiX, in their order. Five factors need tests
    of two kinds: one pull determines combinations of them only.
    """

    name: ClassVar[str] = "polynomial"
    title: ClassVar[str] = "the polynomial of second order"
    source: ClassVar[str] = "Rivlin & Saunders 1951, Phil. Trans. R. Soc. A 243:251, doi 10.1098/rsta.1951.0004"
    linear: ClassVar[bool] = True
    compared_terms: ClassVar[tuple[int, ...]] = ()
    c10: float = parameter("Pa", "factor of I1 - 3")
    c01: float = parameter("Pa", "factor of I2 - 3", 0.0)
    c20: float = parameter("Pa", "factor of (I1 - 3)^2", 0.0)
    c11: float = parameter("Pa", "factor of (I1 - 3) (I2 - 3)", 0.0)
    c02: float = parameter("Pa", "factor of (I2 - 3)^2", 0.0)
    poisson: float = poissons_ratio()  # type: ignore[assignment]

    @staticmethod
    def shape(strain: StrainMeasures, m: Parameters) -> Expression:
        a, b = strain.I1_bar - 3, strain.I2_bar - 3
        return m.c10 * a + m.c01 * b + m.c20 * a**2 + m.c11 * a * b + m.c02 * b**2

    @property
    def shear_modulus_0(self) -> float:
        return 2 * (self.c10 + self.c01)

    @property
    def invariant_terms(self) -> Mapping[tuple[int, int], float]:
        return {(1, 0): self.c10, (0, 1): self.c01, (2, 0): self.c20, (1, 1): self.c11, (0, 2): self.c02}

    @classmethod
    def starting_values(cls, modulus: float, strain: float = 10.0, terms: int = 0) -> dict[str, float]:
        second = 0.005 * modulus / strain
        return {"c10": 0.4 * modulus, "c01": 0.1 * modulus, "c20": second, "c11": 0.0, "c02": 0.0}


@register_law
@dataclasses.dataclass(frozen=True)
class Yeoh(Material):
    """Yeoh: W = c1 k + c2 k^2 + c3 k^3 with k = I1_bar - 3; mu = 2 c1. Yeoh 1993, doi 10.5254/1.3538343."""

    name: ClassVar[str] = "yeoh"
    source: ClassVar[str] = "Yeoh 1993, Rubber Chem. Technol. 66:754, doi 10.5254/1.3538343"
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


@register_law
@dataclasses.dataclass(frozen=True)
class Carroll(Material):
    """Carroll: W = a (I1_bar - 3) + b (I1_bar^4 - 81) + c (sqrt(I2_bar) - sqrt(3)); mu = 2 a + 216 b + c / sqrt(3).

    Three factors that follow rubber in pull, shear and sheet alike: the part of I2 falls with the strain as it does there, and
    I1^4 stiffens like chains that become straight. Carroll 2011, doi 10.1007/s10659-010-9279-0, who writes A, B, C.
    """

    name: ClassVar[str] = "carroll"
    title: ClassVar[str] = "Carroll's law"
    source: ClassVar[str] = "Carroll 2011, J. Elast. 103:173, doi 10.1007/s10659-010-9279-0"
    linear: ClassVar[bool] = True
    a: float = parameter("Pa", "factor of I1")
    b: float = parameter("Pa", "factor of I1^4", 0.0)
    c: float = parameter("Pa", "factor of the root of I2", 0.0)
    poisson: float = poissons_ratio()  # type: ignore[assignment]

    @staticmethod
    def shape(strain: StrainMeasures, m: Parameters) -> Expression:
        return m.a * (strain.I1_bar - 3) + m.b * (strain.I1_bar**4 - 81) + m.c * (strain.I2_bar**0.5 - math.sqrt(3.0))

    @property
    def shear_modulus_0(self) -> float:
        return 2 * self.a + 216 * self.b + self.c / math.sqrt(3.0)

    @classmethod
    def starting_values(cls, modulus: float, strain: float = 10.0, terms: int = 0) -> dict[str, float]:
        return {"a": 0.4 * modulus, "b": 1e-4 * modulus / (3 + strain) ** 3, "c": 0.2 * math.sqrt(3.0) * modulus}


@register_law
@dataclasses.dataclass(frozen=True)
class Ogden(Material):
    """Ogden: W = sum_i mu_i/alpha_i (l1^alpha_i + l2^alpha_i + l3^alpha_i - 3), isochoric stretches; mu = sum mu_i alpha_i / 2.

    Ogden 1972, doi 10.1098/rspa.1972.0026. Many programs write 2 mu_i / alpha_i^2 instead of mu_i / alpha_i: see
    `from_two_mu`. The same numbers read in the other way are another rubber.
    """

    name: ClassVar[str] = "ogden"
    source: ClassVar[str] = "Ogden 1972, Proc. R. Soc. A 326:565, doi 10.1098/rspa.1972.0026"
    title: ClassVar[str] = "Ogden's law"
    most_terms: ClassVar[int] = 4
    usual_terms: ClassVar[int] = 2
    compared_terms: ClassVar[tuple[int, ...]] = (1, 2, 3)
    conventions: ClassVar[tuple[str, ...]] = ("mu/alpha", "2mu/alpha^2")
    convention_help: ClassVar[str] = "convention of mu and alpha: W = sum mu/alpha (...) or sum 2mu/alpha^2 (...)"
    mu: tuple[float, ...] = parameter(
        "Pa", "factors mu_i of W = sum mu_i/alpha_i (...), separated by commas", bounds=(1e-6, 1e12), many=True
    )
    alpha: tuple[float, ...] = parameter(
        "", "exponents alpha_i, separated by commas", bounds=(0.05, 30.0), many=True,
        grid=(0.7, 1.3, 2.0, 3.0, 4.5, 7.0, 11.0, -0.7, -1.3, -2.0, -4.0),
    )  # fmt: skip
    poisson: float = poissons_ratio()  # type: ignore[assignment]

    def check(self) -> None:
        if len(self.mu) != len(self.alpha) or not self.mu:
            raise MaterialError(f"ogden: {len(self.mu)} values of mu but {len(self.alpha)} of alpha; give equal numbers")
        if 0.0 in self.alpha:
            raise MaterialError("ogden: an exponent alpha is zero; it must not be")

    @property
    def misread(self) -> str:
        falling = [i for i, (mu, alpha) in enumerate(self.stretch_terms, 1) if mu * alpha < 0.0]
        if not falling:
            return ""
        own, other = self.conventions
        terms = f"term {falling[0]}" if len(falling) == 1 else f"terms {', '.join(map(str, falling))}"
        return (
            f"ogden: mu * alpha is below 0 in {terms} of W = sum {own} (...), so that the stiffness falls there; published "
            f"tables that look so mostly follow sum {other} (...): check which one yours follows (convention = '{other}', "
            "in Python Ogden.from_two_mu)"
        )

    @staticmethod
    def shape(strain: StrainMeasures, m: Parameters) -> Expression:
        a, b, c = strain.stretches_bar
        return sum(m.mu[i] / m.alpha[i] * (a ** m.alpha[i] + b ** m.alpha[i] + c ** m.alpha[i] - 3) for i in _terms(m.mu))

    @property
    def shear_modulus_0(self) -> float:
        return sum(mu * alpha for mu, alpha in zip(self.mu, self.alpha, strict=True)) / 2

    @property
    def stretch_terms(self) -> tuple[tuple[float, float], ...]:
        return tuple(zip(self.mu, self.alpha, strict=True))

    @classmethod
    def parameter_bounds(cls, name: str, start: Mapping[str, float]) -> tuple[float, float]:
        """Keep the sign of alpha_i, and the same sign for mu_i, so that every term is stable (Ogden 1972)."""
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
        factors = (" ".join(units.with_prefix(mu * a / 2, "Pa")) for mu, a in zip(self.mu, self.alpha, strict=True))
        own, other = self.conventions
        return f"convention of mu: W = sum {own} (...); in the convention {other} the factors are {', '.join(factors)}"

    @classmethod
    def from_values(cls, values: Values, convention: str = "") -> Ogden:
        return cls.from_two_mu(**values) if convention == cls.conventions[1] else cls(**values)

    @classmethod
    @checked
    def from_two_mu(cls, mu: tuple[float, ...], alpha: tuple[float, ...], poisson: float = DEFAULT_POISSON_RATIO) -> Ogden:
        """From the convention W = sum 2 mu_i/alpha_i^2 (...), in which the shear modulus is the sum of the mu_i (Pa)."""
        try:
            mu = schema.Several(schema.Quantity("Pa")).settled("mu", mu)  # type: ignore[assignment]
            alpha = schema.Several(schema.Quantity()).settled("alpha", alpha)  # type: ignore[assignment]
        except errors.FieldError as error:
            raise MaterialError(f"ogden: {error}") from None
        if len(mu) != len(alpha) or 0.0 in alpha:
            raise MaterialError("ogden: give equal numbers of mu and alpha, and no alpha of zero")
        return cls(tuple(2 * m / a for m, a in zip(mu, alpha, strict=True)), tuple(alpha), poisson)


def _number(law: type[Material], name: str, value: object, unit: str = "Pa") -> float:
    """Return a number that replaces a parameter; raise `MaterialError` if it is invalid."""
    try:
        return schema.Quantity(unit).settled(name, value)
    except errors.FieldError as error:
        raise MaterialError(f"{law.name}: {error}") from None


def _terms(values: Expression) -> range:
    shape = getattr(values, "ufl_shape", None)
    return range(shape[0] if shape else len(values))


@register_law
@dataclasses.dataclass(frozen=True)
class Gent(Material):
    """Gent: W = -mu/2 Jm ln(1 - (I1_bar - 3)/Jm); chains lock at I1_bar = 3 + Jm. Gent 1996, doi 10.5254/1.3538357."""

    name: ClassVar[str] = "gent"
    source: ClassVar[str] = "Gent 1996, Rubber Chem. Technol. 69:59, doi 10.5254/1.3538357"
    shear_modulus: float = parameter("Pa", "shear modulus mu", bounds=MODULUS_BOUNDS)
    limit: float = parameter("", "Jm: the I1 - 3 at which the chains lock", bounds=(1e-2, 1e5))
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


@register_law
@dataclasses.dataclass(frozen=True)
class FungDemiray(Material):
    """Fung-Demiray: W = mu/(2 b) (exp(b (I1_bar - 3)) - 1), which stiffens exponentially. Demiray 1972, doi
    10.1016/0021-9290(72)90047-4, and Fung 1967 for the exponential.

    Convex, so stable, for every mu and b above zero; b towards 0 is the neo-Hookean law. Other texts write a for mu.
    """

    name: ClassVar[str] = "fung-demiray"
    title: ClassVar[str] = "Fung and Demiray's law"
    source: ClassVar[str] = "Demiray 1972, J. Biomech. 5:309, doi 10.1016/0021-9290(72)90047-4"
    compared_terms: ClassVar[tuple[int, ...]] = ()
    shear_modulus: float = parameter("Pa", "shear modulus mu", bounds=MODULUS_BOUNDS)
    stiffening: float = parameter("", "b: the rate of the exponential in I1 - 3", bounds=(1e-6, 20.0))
    poisson: float = poissons_ratio()  # type: ignore[assignment]

    def check(self) -> None:
        if self.stiffening <= 0.0:
            raise MaterialError(f"fung-demiray: stiffening = {self.stiffening:g}; it must be above zero")

    @staticmethod
    def shape(strain: StrainMeasures, m: Parameters) -> Expression:
        return m.shear_modulus / (2 * m.stiffening) * (strain.exp(m.stiffening * (strain.I1_bar - 3)) - 1)

    @property
    def shear_modulus_0(self) -> float:
        return self.shear_modulus

    @classmethod
    def starting_values(cls, modulus: float, strain: float = 10.0, terms: int = 0) -> dict[str, float]:
        return {"shear_modulus": modulus, "stiffening": min(0.5 / strain, 10.0)}

    @classmethod
    def starting_grid(cls, modulus: float, strain: float) -> list[dict[str, float]]:
        return [
            {"shear_modulus": modulus / math.sqrt(1 + share), "stiffening": min(share / strain, 10.0)}
            for share in (0.02, 0.2, 0.6, 1.5, 3.5)
        ]
