"""A law as something to fit: its numbers by name, their bounds, and where to start.

``ogden`` with a number behind it has that many terms. Poisson's ratio is not fitted: tension alone hardly sees it.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import nnls

from softmodels.fitting.least_squares import FitError, Parameter
from softmodels.materials.laws import LAWS, Gent, Material, NeoHookean, Ogden, Yeoh
from softmodels.materials.specimens import parameter_names

Array = npt.NDArray[np.float64]

MODULUS_BOUNDS = (1.0, 1e9)
MU_BOUNDS = (1e-6, 1e12)
ALPHA_BOUNDS = (0.05, 30.0)
LIMIT_BOUNDS = (1e-2, 1e5)
EXPONENTS = (0.7, 1.3, 2.0, 3.0, 4.5, 7.0, 11.0, -0.7, -1.3, -2.0, -4.0)
"""Exponents that starts of Ogden's law are combined from."""
TAUT = (1.02, 1.2, 2.0, 6.0, 40.0)
"""Starts of Gent's limit, in units of the largest I1 - 3 measured."""
MOST_TERMS = 4
STARTS = 6
ALL = ("neo-hookean", "mooney-rivlin", "yeoh", "ogden1", "ogden2", "ogden3", "gent")


@dataclasses.dataclass(frozen=True)
class LawChoice:
    """A law with its number of terms and Poisson's ratio.

    Attributes:
        name: As asked for, such as ``"ogden2"``.
        law: Its class.
        terms: Terms of Ogden's law; 0 for the others.
        poisson: Poisson's ratio of the fitted material.
    """

    name: str
    law: type[Material]
    terms: int
    poisson: float

    @classmethod
    def from_text(cls, text: str, poisson: float = 0.5) -> LawChoice:
        """Read ``"yeoh"`` or ``"ogden2"``."""
        found = re.fullmatch(r"ogden([1-9])?", text)
        if found:
            terms = int(found[1] or 2)
            if terms > MOST_TERMS:
                raise FitError(f"law {text!r}: at most {MOST_TERMS} terms of Ogden's law can be told apart")
            return cls(f"ogden{terms}", Ogden, terms, poisson)
        if text not in LAWS:
            raise FitError(f"law {text!r} is unknown; known are {', '.join(LAWS)}, ogden1 to ogden{MOST_TERMS} and all")
        return cls(text, LAWS[text], 0, poisson)

    @property
    def names(self) -> tuple[str, ...]:
        if self.law is Ogden:
            return tuple(f"{key}{i + 1}" for i in range(self.terms) for key in ("mu", "alpha"))
        return parameter_names(self.law(**{f.name: 1.0 for f in dataclasses.fields(self.law) if f.name != "poisson"}))

    def unit(self, name: str) -> str:
        fields = {field.name: field.metadata["unit"] for field in dataclasses.fields(self.law)}
        return str(fields[name] if name in fields else fields[name.rstrip("0123456789")])

    def material(self, values: Mapping[str, float]) -> Material:
        """The material with these numbers.

        Raises:
            MaterialError: The law cannot take them.
        """
        if self.law is Ogden:
            mu, alpha = (tuple(values[f"{key}{i + 1}"] for i in range(self.terms)) for key in ("mu", "alpha"))
            return Ogden(mu, alpha, self.poisson)
        make: Any = self.law
        return make(**{name: values[name] for name in self.names}, poisson=self.poisson)  # type: ignore[no-any-return]

    def parameters(self, start: Mapping[str, float]) -> tuple[Parameter, ...]:
        """Parameters with the law's own bounds about a start.

        Ogden's mu_i keeps the sign of its alpha_i, which is what makes every term stable (Ogden 1972).
        """
        return tuple(Parameter(name, self.unit(name), start[name], *self._bounds(name, start)) for name in self.names)

    def _bounds(self, name: str, start: Mapping[str, float]) -> tuple[float, float]:
        if name == "shear_modulus":
            return MODULUS_BOUNDS
        if name == "limit":
            return LIMIT_BOUNDS
        if self.law is Ogden:
            positive = start[f"alpha{name[-1]}"] > 0.0
            low, high = ALPHA_BOUNDS if name.startswith("alpha") else MU_BOUNDS
            return (low, high) if positive else (-high, -low)
        return (0.0, math.inf) if name == "c1" else (-math.inf, math.inf)

    def from_modulus(self, modulus: float, most: float = 10.0) -> dict[str, float]:
        """A start from the small-strain shear modulus in Pa alone; ``most`` is the largest I1 - 3 expected."""
        if self.law in (NeoHookean, Gent):
            return {"shear_modulus": modulus, "limit": 5 * most} if self.law is Gent else {"shear_modulus": modulus}
        if self.law is Ogden:
            alphas = (2.0, 5.0, -2.0, 9.0)[: self.terms]
            shares = (0.9, 0.05, 0.05, 0.01)[: self.terms] if self.terms > 1 else (1.0,)
            pairs = zip(alphas, shares, strict=True)
            return {
                key: value
                for i, (alpha, share) in enumerate(pairs, 1)
                for key, value in ((f"mu{i}", 2 * modulus * share / alpha), (f"alpha{i}", alpha))
            }
        if self.law is Yeoh:
            return {"c1": modulus / 2, "c2": 0.01 * modulus / most, "c3": 0.0}
        return {"c10": 0.4 * modulus, "c01": 0.1 * modulus}


def closed_starts(choice: LawChoice, design: Any, target: Array, modulus: float, most: float) -> list[dict[str, float]]:
    """Starts by linear least squares, where a law is linear in its numbers, or over a grid of those in which it is not.

    Args:
        choice: The law.
        design: Function of a material and names that gives the slopes of all standardised stresses by them, (n, m).
        target: Standardised measured stresses, shape (n,).
        modulus: Small-strain shear modulus in Pa of the data.
        most: Largest I1 - 3 of the data.

    Returns:
        Best first.
    """
    plain = choice.from_modulus(modulus, most)
    if choice.law is Gent:
        return [{"shear_modulus": modulus, "limit": factor * most} for factor in TAUT]
    if choice.law is Ogden:
        return [*_ogden_starts(choice, design, target, modulus), plain]
    A = design(choice.material(plain), choice.names)
    size = np.linalg.norm(A, axis=0)
    found, *_ = np.linalg.lstsq(A / size, target, rcond=None)
    start = dict(zip(choice.names, (found / size).tolist(), strict=True))
    first = choice.names[0]
    if choice.law is not LAWS["mooney-rivlin"] and start[first] <= 0.0:
        start[first] = 0.1 * modulus
    return [start, plain]


def _ogden_starts(choice: LawChoice, design: Any, target: Array, modulus: float) -> list[dict[str, float]]:
    """Non-negative least squares for mu_i alpha_i over combinations of exponents; the best few."""
    columns = {a: np.sign(a) * design(Ogden((a * modulus,), (a,), 0.5), ("mu1",))[:, 0] for a in EXPONENTS}
    tried = []
    for alphas in itertools.combinations(EXPONENTS, choice.terms):
        A = np.column_stack([columns[a] for a in alphas])
        size = np.linalg.norm(A, axis=0)
        found, misfit = nnls(A / size, target)
        # A term that the grid leaves out starts small, not at its bound.
        sizes = np.maximum(found / size, 1e-3 * modulus / np.abs(alphas))
        tried.append((misfit, alphas, np.sign(alphas) * sizes))
    tried.sort(key=lambda one: one[0])
    starts = []
    for _, alphas, mus in tried[:STARTS]:
        pairs = zip(mus.tolist(), alphas, strict=True)
        starts.append({k: v for i, (mu, a) in enumerate(pairs, 1) for k, v in ((f"mu{i}", mu), (f"alpha{i}", a))})
    return starts


def signs(start: Mapping[str, float]) -> tuple[bool, ...]:
    """The signs of Ogden's exponents in a start, which its bounds keep; empty for the other laws."""
    return tuple(value > 0.0 for name, value in start.items() if name.startswith("alpha"))


def distinct(starts: Sequence[Mapping[str, float]]) -> dict[tuple[bool, ...], list[Mapping[str, float]]]:
    """Starts by `signs`: those that one set of bounds holds."""
    grouped: dict[tuple[bool, ...], list[Mapping[str, float]]] = {}
    for start in starts:
        grouped.setdefault(signs(start), []).append(start)
    return grouped
