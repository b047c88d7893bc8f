"""Stability of a law: Drucker's criterion, locking chains, and the balloon's limit point.

Drucker: in a sheet, an increment of logarithmic strain must raise the Kirchhoff stress along it. A fit that violates
it within its range makes simulations fail, however small its residuals.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from softmodels.common.arrays import Array
from softmodels.materials.laws import Material, MaterialError, parameter_fields
from softmodels.materials.specimens import MODE_NAMES, Response, balloon_limit, log_strain_stiffness, respond, strain_of

FURTHEST = 10.0
"""Range of stretch, up to this value and down to its inverse, over which a law is checked."""
POINTS = 600
REST = 0.01
"""Stretch near 1 below which an instability counts as initial."""
_WORDS = {"uniaxial": "uniaxial", "planar": "planar", "equibiaxial": "equibiaxial"}


@dataclasses.dataclass(frozen=True)
class Instability:
    """The first unstable state along a mode, from rest.

    Attributes:
        mode: Of `softmodels.materials.specimens.MODE_NAMES`.
        stretch: Below 1 in compression.
        strain: I1 - 3 of that state.
    """

    mode: str
    stretch: float
    strain: float

    def __str__(self) -> str:
        way = "tension" if self.stretch > 1 else "compression"
        return f"{_WORDS[self.mode]} {way} at stretch {self.stretch:.3g}"


def instabilities(material: Material, furthest: float = FURTHEST) -> tuple[Instability, ...]:
    """Return the first states along every mode, in tension and compression, that violate Drucker's criterion, the smallest
    strain first.

    Args:
        material: Taken as incompressible.
        furthest: Largest stretch looked at; 1/furthest is the smallest.
    """
    found = []
    for mode in MODE_NAMES:
        for way in (1.0, -1.0):
            first = _first(
                material, mode, np.exp(way * np.linspace(min(1e-3, math.log(furthest) / 2), math.log(furthest), POINTS))
            )
            if first:
                found.append(first)
    return tuple(sorted(found, key=lambda one: one.strain))


def weakest(material: Material) -> Instability | None:
    """Return the instability at the smallest stretch in tension, over all modes; None up to `FURTHEST`."""
    return min((one for one in instabilities(material) if one.stretch > 1), key=lambda one: one.stretch, default=None)


def weakness(material: Material) -> str:
    """Return at which stretch a law becomes unstable in tension, as a clause with its name; empty if stable up to
    `FURTHEST`."""
    found = {one.mode: one.stretch for one in instabilities(material) if one.stretch > 1}
    if not found:
        return ""
    places = ", ".join(f"{found[mode]:.3g} ({_WORDS[mode]})" for mode in MODE_NAMES if mode in found)
    return f"the law {described(material)} becomes unstable (Drucker's criterion) in tension at stretch {places}"


def described(material: Material) -> str:
    """Return a law with its parameters: ``yeoh (c1 = 10 kPa, c2 = -0.1 kPa)``."""
    parts = []
    for field in parameter_fields(material):
        if field.name == "poisson":
            continue
        value = getattr(material, field.name)
        several = isinstance(value, tuple)
        for i, number in enumerate(value if several else (value,), 1):
            name = f"{field.name}{i}" if several else field.name
            unit = field.metadata["unit"]
            parts.append(f"{name} = {number / 1e3:.4g} kPa" if unit == "Pa" else f"{name} = {number:.4g}")
    return f"{material.name} ({', '.join(parts)})"


def check_rest(material: Material) -> None:
    """Reject a law that is unstable at small strain.

    Raises:
        MaterialError: It is not stable (Drucker) within `REST` of its state of rest.
    """
    if weak := instabilities(material, furthest=1 + REST):
        raise MaterialError(
            f"the law {described(material)} is unstable at small strain (Drucker's criterion: {weak[0]}); check the "
            f"signs and units of its parameters, or fit another law"
        )


def _first(material: Material, mode: str, stretches: Array) -> Instability | None:
    H, k = log_strain_stiffness(material, stretches, mode)
    alive = np.isfinite(H).all(axis=(1, 2))  # no state exists beyond locking: `last_stretch`
    least = np.full(len(k), np.inf)
    least[alive] = np.linalg.eigvalsh(H[alive])[:, 0]
    bad = np.flatnonzero(least <= 0.0)
    if not len(bad):
        return None
    i = int(bad[0])
    if i == 0:
        return Instability(mode, float(stretches[0]), float(k[0]))
    share = least[i - 1] / (least[i - 1] - least[i])
    stretch = float(stretches[i - 1] + share * (stretches[i] - stretches[i - 1]))
    return Instability(mode, stretch, float(log_strain_stiffness(material, np.array([stretch]), mode)[1][0]))


def last_stretch(material: Material, mode: str) -> float:
    """Return the locking stretch in a mode (`Material.strain_limit`); infinite without
    locking."""
    limit = material.strain_limit
    if math.isinf(limit):
        return math.inf
    from scipy.optimize import brentq

    def left(stretch: float) -> float:
        power = {
            "uniaxial": (2.0, -1.0, 1.0, 2.0),
            "planar": (2.0, -2.0, 1.0, 1.0),
            "equibiaxial": (2.0, -4.0, 2.0, 1.0),
        }
        a, b, many, others = power[mode]
        return many * stretch**a + others * stretch**b + (mode == "planar") - 3 - limit

    return float(brentq(left, 1.0, 2 + 2 * math.sqrt(limit + 3)))


@dataclasses.dataclass(frozen=True)
class Verdict:
    """Stability of a law within and beyond a range of deformation.

    Attributes:
        flags: Sentences that forbid its use within the range.
        notes: Sentences on what lies beyond.
    """

    flags: tuple[str, ...]
    notes: tuple[str, ...]


def judge(material: Material, strain: float) -> Verdict:
    """Check the stability of a law up to the largest fitted (or shown) I1 - 3.

    Args:
        material: The law.
        strain: Largest I1 - 3.
    """
    flags, notes = [], []
    weak = instabilities(material)
    inside = [one for one in weak if one.strain <= strain]
    if inside:
        where = "; ".join(map(str, inside))
        flags.append(f"the law is unstable (Drucker) within this range: {where}")
    elif weak:
        notes.append(f"stable (Drucker) within this range; unstable beyond it in {weak[0]}")
    else:
        notes.append(f"stable (Drucker) in every mode from stretch {1 / FURTHEST:g} to {FURTHEST:g}")
    if math.isfinite(material.strain_limit):
        ends = ", ".join(f"{mode} {last_stretch(material, mode):.3g}" for mode in MODE_NAMES)
        notes.append(f"the chains lock at stretch: {ends}")
    try:
        limit = balloon_limit(material, 1.0)
    except ValueError:
        limit = None
    if limit:
        notes.append(f"a thin balloon has its limit point at stretch {limit[0]:.4g}")
    else:
        notes.append("a thin balloon has no limit point up to stretch 10")
    return Verdict(tuple(flags), tuple(notes))


# ----------------------------------------------------------------------------------------------------------------------
# A material's curves in all test specimens, and as a balloon.


@dataclasses.dataclass(frozen=True, eq=False)
class MaterialCurves:
    """A material's curves.

    Attributes:
        name: As asked for.
        material: The law.
        stretch: Shape (n,).
        responses: By mode.
        verdict: Its stability over the stretches.
    """

    name: str
    material: Material
    stretch: Array
    responses: dict[str, Response]
    verdict: Verdict

    @classmethod
    def of(cls, name: str, material: Material, stretch: Array) -> MaterialCurves:
        responses = {mode: respond(material, stretch, mode) for mode in MODE_NAMES}
        ends = np.array([stretch[0], stretch[-1]])
        return cls(name, material, stretch, responses, judge(material, float(strain_of("uniaxial", ends).max())))

    def true_stress(self, mode: str) -> Array:
        """Return the force per deformed area in Pa, shape (n,)."""
        response = self.responses[mode]
        across = {"uniaxial": response.side**2, "planar": response.side, "equibiaxial": response.side * self.stretch}
        return response.stress / across[mode]

    def balloon(self, thickness_over_radius: float) -> Array:
        """Return the pressure in Pa in a thin spherical balloon, shape (n,): P = 2 (t/R) S / stretch^2, S of equibiaxial
        tension."""
        return 2 * thickness_over_radius * self.responses["equibiaxial"].stress / self.stretch**2
