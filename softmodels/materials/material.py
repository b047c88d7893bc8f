"""What a law is, and the table of laws by name.

A law is a frozen dataclass below `Material`. Two things it has to state: `Material.shape`, its energy, and
`Material.shear_modulus_0`. Its parameters are fields made by `parameter`, each with its unit, a help text and the bounds that
a fit keeps. All else has a default that a law may replace: whether it is linear in its parameters, where a fit starts, in
which other parameters or conventions it is written, at which strain it ends. So a law is one class, also outside of this
library; `register` lets command lines and files find it by its name.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, ClassVar

from geometries.errors import FieldError
from geometries.kinds import Quantity, Several
from measurement.arguments import checked
from measurement.wording import Spoken
from softmodels.materials.strain import Expression, StrainMeasures

Values = Mapping[str, Any]
"""Numbers by the names of a law's fields; tuples of numbers for fields that have one for each term."""


Parameters = Any
"""Carries a law's parameters by name: a material (numbers), or UFL constants, so that new values compile nothing."""


SOFTEST = 500.0
"""Shear modulus in Pa below which no silicone is: of the softest gels, with room."""


class MaterialError(Spoken, ValueError):
    """An impossible or unknown material; the message is a sentence for the user."""


def parameter(
    unit: str,
    text: str,
    default: object = dataclasses.MISSING,
    bounds: tuple[float, float] = (-math.inf, math.inf),
    many: bool = False,
    grid: tuple[float, ...] = (),
) -> Any:
    """A field of a law.

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
    """The field ``poisson`` that every law ends with."""
    return parameter("", "Poisson's ratio at small strain, -1 to 0.5", 0.49, bounds=(-1.0, 0.5))


def parameter_fields(law: Material | type[Material]) -> list[dataclasses.Field[Any]]:
    """The fields of a law that are its `parameter`s, in their order."""
    return [field for field in dataclasses.fields(law) if "unit" in field.metadata]


def _check_range(law: str, stretches: tuple[float, float] | None) -> None:
    if stretches is None:
        return
    try:
        low, high = map(float, stretches)
    except (TypeError, ValueError):
        low, high = math.nan, math.nan
    if not 0.0 < low < high < math.inf:
        raise MaterialError(f"{law}: fitted_stretch = {stretches} is no range of stretch; write it like [1.02, 3.0]")


@dataclasses.dataclass(frozen=True)
class Material:
    """Interface of a law. Parameters are in Pa or dimensionless; see each class.

    Attributes:
        name: What command lines and files call it.
        title: What sentences call it; the name if empty.
        linear: Whether the energy is linear in all parameters but Poisson's ratio.
        most_terms: Most terms that a fit can tell apart, of a law that is a sum of terms of one form; 0 for other laws. Each
            term has one factor in Pa, which enters linearly, and one shape parameter, which has a grid.
        usual_terms: Terms where nobody says how many.
        compared_terms: Numbers of terms that are compared where all laws are.
        alternatives: Numbers that stand in for parameters, see `from_values`: unit and help by name.
        isochoric: Whether `shape` is of the isochoric strain alone.
        conventions: Ways in which the same parameters are written, the law's own first; empty where there is one alone.
        convention_help: What the conventions are.
        fitted_stretch: Range of stretch that the parameters were fitted over; None where that is not known. It is no part of
            the law: two materials that differ in it alone are equal.
    """

    name: ClassVar[str]
    title: ClassVar[str] = ""
    linear: ClassVar[bool] = False
    most_terms: ClassVar[int] = 0
    usual_terms: ClassVar[int] = 0
    compared_terms: ClassVar[tuple[int, ...]] = (0,)
    alternatives: ClassVar[Mapping[str, tuple[str, str]]] = {}
    isochoric: ClassVar[bool] = True
    conventions: ClassVar[tuple[str, ...]] = ()
    convention_help: ClassVar[str] = ""
    fitted_stretch: tuple[float, float] | None = dataclasses.field(
        default=None, kw_only=True, compare=False, repr=False
    )

    def __post_init__(self) -> None:
        if type(self) is Material:
            raise MaterialError("Material is what all laws have in common; take one of them, such as Yeoh")
        _check_range(self.name, self.fitted_stretch)
        for field in parameter_fields(self):
            of = Quantity(field.metadata["unit"])
            kind = Several(of) if field.metadata["many"] else of
            try:
                object.__setattr__(self, field.name, kind.settled(field.name, getattr(self, field.name)))
            except FieldError as error:
                raise MaterialError(f"{self.name}: {error}") from None
        if not -1.0 < self.poisson <= 0.5:
            raise MaterialError(f"{self.name}: poisson = {self.poisson:g} is outside -1 to 0.5")
        self.check()
        if not self.shear_modulus_0 > 0.0:
            raise MaterialError(
                f"{self.name}: the shear modulus at small strain is {self.shear_modulus_0:g} Pa; it must be above zero"
            )

    @property
    def doubt(self) -> str:
        """Why its numbers are hardly meant: a sentence, empty for those of a silicone or of what is stiffer."""
        if self.shear_modulus_0 >= SOFTEST:
            return ""
        return (
            f"{self.name}: the shear modulus is {self.shear_modulus_0:.4g} Pa, and silicones have 5 to 500 kPa; numbers are in "
            "Pa, so write kPa as a text such as '14 kPa'"
        )

    # -- the energy ---------------------------------------------------------------------------------------------------

    def check(self) -> None:
        """Raise `MaterialError` for parameters this law cannot take."""

    @staticmethod
    def shape(strain: StrainMeasures, m: Parameters) -> Expression:
        """Energy of the change of shape in Pa.

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
        """Energy in Pa of a compressible deformation. With an infinite bulk only J = 1 has one, and it is the shape's."""
        shape = self.shape(strain, self)
        return shape if math.isinf(self.bulk) else shape + self.bulk / 2 * (strain.J - 1) ** 2

    @property
    def strain_limit(self) -> float:
        """I1 - 3 at which the energy ends (chains are taut); infinite where it does not."""
        return math.inf

    @property
    def invariant_terms(self) -> Mapping[tuple[int, int], float]:
        """Factors in Pa of (I1_bar - 3)^i (I2_bar - 3)^j by (i, j), of a law that is their sum; empty for others."""
        return {}

    @property
    def stretch_terms(self) -> tuple[tuple[float, float], ...]:
        """Pairs (mu in Pa, alpha) of a law that is Ogden's sum over isochoric stretches, mu/alpha (...); empty for others."""
        return ()

    # -- how it is written --------------------------------------------------------------------------------------------

    @classmethod
    def from_values(cls, values: Values, convention: str = "") -> Material:
        """A material from its parameters, or from numbers that stand in for them.

        Args:
            values: Fields and `alternatives` by name, in Pa or dimensionless.
            convention: One of `conventions`; empty for the law's own.

        Raises:
            MaterialError: No such combination, or the law cannot take them.
        """
        return cls(**values)

    @property
    def remark(self) -> str:
        """What a reader of its parameters has to know, such as their values in another convention; mostly empty."""
        return ""

    # -- how it is fitted ---------------------------------------------------------------------------------------------

    @property
    def terms(self) -> int:
        """Its number of terms; 0 for a law that is no sum of terms of one form."""
        return len(getattr(self, _term_fields(type(self))[0])) if self.most_terms else 0

    @classmethod
    def parameter_names(cls, terms: int = 0) -> tuple[str, ...]:
        """Names of its numbers but for Poisson's ratio, those of terms counted through: ``mu1``, ``alpha1``, ``mu2`` ..."""
        single = [f.name for f in parameter_fields(cls) if not f.metadata["many"] and f.name != "poisson"]
        return (*single, *(f"{name}{i + 1}" for i in range(terms) for name in _term_fields(cls)))

    @classmethod
    def parameter_unit(cls, name: str) -> str:
        """Unit of one of `parameter_names`."""
        return str(_field(cls, name).metadata["unit"])

    @classmethod
    def parameter_bounds(cls, name: str, start: Mapping[str, float]) -> tuple[float, float]:
        """Within which a fit that begins at ``start`` keeps one of `parameter_names`."""
        low, high = _field(cls, name).metadata["bounds"]
        return low, high

    @classmethod
    def from_parameters(cls, values: Mapping[str, float], terms: int = 0, poisson: float = 0.5) -> Material:
        """A material from numbers by `parameter_names`.

        Raises:
            MaterialError: The law cannot take them.
        """
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
        """Where a fit may start, from the small-strain shear modulus alone.

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
        """Several starts of a law that is neither linear nor a sum of terms; see `starting_values`."""
        return [cls.starting_values(modulus, strain)]


def _term_fields(law: type[Material]) -> list[str]:
    return [field.name for field in parameter_fields(law) if field.metadata["many"]]


def _plain(field: dataclasses.Field[Any]) -> float:
    low, high = field.metadata["bounds"]
    return 1.0 if low <= 1.0 <= high else 2.0 * float(low if low > 1.0 else high)


def _field(law: type[Material], name: str) -> dataclasses.Field[Any]:
    fields = {field.name: field for field in parameter_fields(law)}
    return fields[name] if name in fields else fields[name.rstrip("0123456789")]


LAWS: dict[str, type[Material]] = {}
"""Every law by the name that a command line or a case file uses."""


def register[Law: type[Material]](law: Law) -> Law:
    """Let command lines and files find a law by its name; a class decorator.

    Raises:
        ValueError: Another law has this name.
    """
    checked(law)
    if LAWS.get(law.name, law) is not law:
        raise ValueError(f"there is a law of the name {law.name!r} already: {LAWS[law.name].__name__}")
    LAWS[law.name] = law
    return law
