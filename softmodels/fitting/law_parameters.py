"""A law as something to fit: its numbers by name, their bounds, and where to start.

A law that is a sum of terms, such as ``ogden``, with a number behind its name has that many of them. Poisson's ratio is not
fitted: tension alone hardly sees it.
"""

from __future__ import annotations

import dataclasses
import itertools
import re
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import numpy.typing as npt
from scipy.optimize import nnls

from measurement.units import brief
from measurement.wording import meant
from softmodels.fitting.problem import FitError, Parameter
from softmodels.materials.material import LAWS, Material, MaterialError, parameter_fields

Array = npt.NDArray[np.float64]
Design = Callable[[Material, Sequence[str]], Array]
"""Slopes of all standardised stresses by the named parameters of a material, shape (n, m)."""

STARTS = 6
"""Starts of a law of several terms that are kept, of all combinations of its grid."""


@dataclasses.dataclass(frozen=True)
class LawChoice:
    """A law with its number of terms and Poisson's ratio.

    Attributes:
        name: As asked for, such as ``"ogden2"``.
        law: Its class.
        terms: Terms of a law that is a sum of them; 0 for the others.
        poisson: Poisson's ratio of the fitted material.
    """

    name: str
    law: type[Material]
    terms: int
    poisson: float

    @classmethod
    def from_text(cls, text: str, poisson: float = 0.5) -> LawChoice:
        """Read ``"yeoh"`` or ``"ogden2"``.

        Raises:
            FitError: No such law, or too many terms.
        """
        if text in LAWS:
            return cls.from_law(LAWS[text], poisson)
        found = re.fullmatch(r"(.*\D)([1-9])", text)
        law = LAWS.get(found[1]) if found else None
        if found is None or law is None or not law.most_terms:
            raise FitError(f"law {text!r} is unknown; known are {known_laws()} and all{meant(text, [*LAWS, 'all'])}")
        terms = int(found[2])
        if terms > law.most_terms:
            raise FitError(f"law {text!r}: at most {law.most_terms} terms of {law.title or law.name} can be told apart")
        return cls(text, law, terms, poisson)

    @classmethod
    def from_law(cls, law: type[Material], poisson: float = 0.5) -> LawChoice:
        """A law's class, with as many terms as are usual."""
        name = f"{law.name}{law.usual_terms}" if law.usual_terms else law.name
        return cls(name, law, law.usual_terms, poisson)

    @classmethod
    def of(cls, material: Material) -> LawChoice:
        """The law of a material, with its number of terms and its Poisson's ratio."""
        name = f"{material.name}{material.terms}" if material.terms else material.name
        return cls(name, type(material), material.terms, material.poisson)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the numbers that a fit may change, Poisson's ratio left out."""
        return self.law.parameter_names(self.terms)

    def unit(self, name: str) -> str:
        """Unit of one of `names`."""
        return self.law.parameter_unit(name)

    def material(self, values: Mapping[str, float], stretches: tuple[float, float] | None = None) -> Material:
        """The material with these numbers, which were fitted over a range of stretch.

        Raises:
            MaterialError: The law cannot take them.
        """
        made = self.law.from_parameters(values, self.terms, self.poisson)
        return made if stretches is None else dataclasses.replace(made, fitted_stretch=stretches)

    def parameters(self, start: Mapping[str, float]) -> tuple[Parameter, ...]:
        """Parameters with the law's own bounds about a start."""
        return tuple(
            Parameter(name, self.unit(name), start[name], *self.law.parameter_bounds(name, start))
            for name in self.names
        )

    def from_modulus(self, modulus: float, most: float = 10.0) -> dict[str, float]:
        """A start from the small-strain shear modulus in Pa alone; ``most`` is the largest I1 - 3 expected."""
        return self.law.starting_values(modulus, most, self.terms)


Laws = str | type[Material] | Sequence[str | type[Material]]
"""One law or several: names with their numbers of terms, with commas between, or classes; ``"all"`` for all."""


def law_choices(laws: Laws, poisson: float = 0.5) -> list[LawChoice]:
    """Read ``"yeoh,ogden2"``, ``"all"``, or classes of laws.

    Raises:
        FitError: No such law, or one is named twice.
    """
    if not -1.0 < poisson <= 0.5:
        raise FitError(f"poisson = {poisson:g} is outside -1 to 0.5")
    if isinstance(laws, str):
        laws = all_laws() if laws.strip() == "all" else [part.strip() for part in laws.split(",")]
    chosen: list[str | type[Material]] = list(laws) if isinstance(laws, list | tuple) else [laws]  # type: ignore[list-item]
    for law in chosen:
        if not isinstance(law, str) and not (
            isinstance(law, type) and issubclass(law, Material) and law is not Material
        ):
            hint = "; give its class, without its numbers" if isinstance(law, Material) else ""
            raise FitError(f"law {brief(law)} is none; it is a name such as 'yeoh', or a class such as sm.Yeoh{hint}")
    if not chosen:
        raise FitError(f"there is no law to fit; known are {known_laws()} and all")
    choices = [
        LawChoice.from_text(law, poisson) if isinstance(law, str) else LawChoice.from_law(law, poisson)
        for law in chosen
    ]
    names = [choice.name for choice in choices]
    if len(set(names)) < len(names):
        raise FitError(f"a law is named twice in {','.join(names)!r}")
    return choices


def all_laws() -> tuple[str, ...]:
    """Names of the laws, with their numbers of terms, that ``all`` compares; the order decides between equally simple ones."""
    return tuple(f"{name}{terms or ''}" for name, law in LAWS.items() for terms in law.compared_terms)


def known_laws() -> str:
    """The names that `LawChoice.from_text` knows."""
    several = [f"{name}1 to {name}{law.most_terms}" for name, law in LAWS.items() if law.most_terms]
    return ", ".join([*LAWS, *several])


def all_parameters() -> dict[str, str]:
    """Units of all parameters of all laws, however many terms these have, by name."""
    return {name: law.parameter_unit(name) for law in LAWS.values() for name in law.parameter_names(law.most_terms)}


def closed_starts(
    choice: LawChoice, design: Design, target: Array, modulus: float, most: float
) -> list[dict[str, float]]:
    """Starts by linear least squares, where a law is linear in its numbers, or over a grid of those in which it is not.

    Args:
        choice: The law.
        design: Gives the slopes of all standardised stresses.
        target: Standardised measured stresses, shape (n,).
        modulus: Small-strain shear modulus in Pa of the data.
        most: Largest I1 - 3 of the data.

    Returns:
        Best first.
    """
    plain = choice.from_modulus(modulus, most)
    if choice.terms:
        return [*_term_starts(choice, design, target, modulus), plain]
    if not choice.law.linear:
        return choice.law.starting_grid(modulus, most)
    A = design(choice.material(plain), choice.names)
    size = np.linalg.norm(A, axis=0)
    found, *_ = np.linalg.lstsq(A / size, target, rcond=None)
    start = dict(zip(choice.names, (found / size).tolist(), strict=True))
    for name, value in plain.items():
        low, high = choice.law.parameter_bounds(name, start)
        if not low < start[name] < high:
            start[name] = 0.1 * modulus if choice.unit(name) == "Pa" else value
    return [start, plain]


def _term_starts(choice: LawChoice, design: Design, target: Array, modulus: float) -> list[dict[str, float]]:
    """Non-negative least squares for the terms' factors over combinations of their shape parameters' grid; the best few.

    Each factor has the sign that gives its term a shear modulus above zero (Ogden's mu_i alpha_i).
    """
    fields = {field.name: field.metadata for field in parameter_fields(choice.law) if field.metadata["many"]}
    factor = next(name for name, about in fields.items() if about["unit"] == "Pa")
    shape = next(name for name, about in fields.items() if about["grid"])
    grid = fields[shape]["grid"]
    signs, columns, moduli = {}, {}, {}
    for value in grid:
        for sign in (1.0, -1.0):
            try:
                term = choice.law.from_parameters({f"{factor}1": sign * modulus, f"{shape}1": value}, 1)
            except MaterialError:
                continue
            signs[value], moduli[value] = sign, term.shear_modulus_0 / modulus
            columns[value] = sign * design(term, (f"{factor}1",))[:, 0]
    tried = []
    for shapes in itertools.combinations(columns, choice.terms):
        A = np.column_stack([columns[value] for value in shapes])
        size = np.linalg.norm(A, axis=0)
        found, misfit = nnls(A / size, target)
        # A term that the grid leaves out starts small, not at its bound.
        sizes = np.maximum(found / size, 5e-4 * modulus / np.array([moduli[value] for value in shapes]))
        tried.append((misfit, shapes, np.array([signs[value] for value in shapes]) * sizes))
    tried.sort(key=lambda one: one[0])
    return [
        {key: value for i, pair in enumerate(zip(factors.tolist(), shapes, strict=True), 1)
         for key, value in zip((f"{factor}{i}", f"{shape}{i}"), pair, strict=True)}
        for _, shapes, factors in tried[:STARTS]
    ]  # fmt: skip


def by_bounds(choice: LawChoice, starts: Sequence[Mapping[str, float]]) -> list[list[Mapping[str, float]]]:
    """Starts in groups that one set of bounds holds: the signs of Ogden's exponents stay what they are where a fit starts."""
    grouped: dict[tuple[tuple[float, float], ...], list[Mapping[str, float]]] = {}
    for start in starts:
        bounds = tuple(choice.law.parameter_bounds(name, start) for name in choice.names)
        grouped.setdefault(bounds, []).append(start)
    return list(grouped.values())
