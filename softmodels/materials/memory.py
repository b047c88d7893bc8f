"""Silicone with a memory: relaxing branches and softening, each a closed term of the energy of one time step.

A branch is a neo-Hookean spring G behind a dashpot of relaxation time tau (Maxwell). Its internal variable Cv, symmetric with
det Cv = 1, is the strain at which the spring carries nothing, and creeps after the strain (bar: the isochoric part):

    dCv/dt = (1/tau) (Cbar - (Cbar : Cv^-1)/3 Cv),        energy G/2 (Cbar : Cv^-1 - 3)

Over a step dt the unimodular part of an H + b Cbar solves this, with H and b known where the step begins, and

    W(F) = 3 G/(2 b) det(H + b Cbar)^(1/3)   has   dW/dCbar = G/2 Cv^-1   at the end of the step

so that a branch stays a term of one potential, with a symmetric tangent and no local iterations. Only W's derivatives are
needed, which have no 1/b: `step_stress`, `step_stiffness`. With H = Cv and b = dt/tau this is implicit Euler (Shutov, Landgraf,
Ihlemann 2013, doi 10.1016/j.cma.2013.07.004); `step_of` is of second order.

tau may depend on the branch's stress and creep, and its spring be another one of I1 (Kumar and Lopez-Pamies 2016, doi
10.1016/j.crme.2015.11.004): see `Branch`. The stress of a step then takes the rate of its beginning, and Cv at its end the
mean of both ends: also of second order, and closed.

Softening is Ogden and Roxburgh's (1999, doi 10.1098/rspa.1999.0431): below the largest energy so far the law carries less.

Symmetric tensors are their six entries 11, 22, 33, 12, 13, 23, each a UFL expression or a numpy array.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from softmodels.common import errors, schema, units
from softmodels.common.lazy import scipy, ufl


@dataclasses.dataclass(frozen=True)
class Memory:
    """What a silicone remembers, in branches where it relaxes, and a softening where it softens. The softening acts on the
    law, not on the branches: its energy is then known at both ends of a step, whatever the step."""

    branches: tuple[Branch, ...] = ()
    softening: Softening | None = None

    @classmethod
    def of(cls, branches: object = (), softening: object = None) -> Memory:
        """Return the memory of numbers, or texts with units: pairs (share, time) or tables of what `Branch` has, and (r, m,
        beta) or (r, m, beta, recovery); FieldError if they are none."""
        if isinstance(branches, str | Mapping) or not isinstance(branches, Sequence):
            raise errors.FieldError(f"branches {units.brief(branches)} are no pairs of share and time, such as [[0.2, '1 s']]")
        if len(branches) > MOST_BRANCHES:
            raise errors.FieldError(
                f"the memory has {len(branches)} branches; at most {MOST_BRANCHES} are supported; one or two in each decade "
                "of time follow any relaxation"
            )
        silicone_memory = cls(
            tuple(_branch(branch) for branch in branches), None if softening is None else _softening(softening)
        )
        if not (silicone_memory.branches or silicone_memory.softening):
            raise errors.FieldError(
                "the memory has neither branches nor softening; give branches = [[0.2, '1 s']], or leave it out"
            )
        return silicone_memory

    @classmethod
    def from_table(cls, table: object) -> Memory:
        """Return the memory of a ``[material.memory]`` table; see `of`."""
        if not isinstance(table, Mapping):
            raise errors.FieldError(
                f"memory {units.brief(table)} is no table; write [material.memory] with branches = [[0.2, '1 s']]"
            )
        if unknown := set(table) - {"branches", "softening"}:
            raise errors.FieldError(f"memory has an unknown entry {min(map(str, unknown))!r}; known are branches, softening")
        return cls.of(**table)

    def to_table(self, text: schema.Text = units.exact_text) -> dict[str, object]:
        """Return the table that `from_table` takes back."""
        table: dict[str, object] = {}
        if self.branches:
            table["branches"] = [_branch_table(branch, text) for branch in self.branches]
        if self.softening:
            r, m, beta, recovery = dataclasses.astuple(self.softening)
            table["softening"] = [r, text(m, "Pa"), beta, *([] if math.isinf(recovery) else [text(recovery, "s")])]
        return table

    def stiffening(self, s: complex) -> complex:
        """Return what the branches add to the shear modulus of small strains that go as exp(s t), s in 1/s, about a relaxed
        state: over the law's at small strain. Its real part at s = 2 pi i f is storage, its imaginary part loss."""
        return sum(branch.share * s * branch.time / (1.0 + s * branch.time) for branch in self.branches)

    @property
    def shortest(self) -> float:
        """The shortest relaxation time in s; infinite without branches."""
        return min((branch.time for branch in self.branches), default=math.inf)


def _branch_table(branch: Branch, text: schema.Text) -> object:
    """Return a pair of share and time, or a table of what differs from a linear branch."""
    time = text(branch.time, "s")
    if branch.linear:
        return [branch.share, time]
    given = {field.name: getattr(branch, field.name) for field in dataclasses.fields(branch)[2:]}
    table: dict[str, object] = {"share": branch.share, "time": time}
    table |= {name: value for name, value in given.items() if value != getattr(Branch, name)}
    return table | ({"spring": [list(pair) for pair in branch.spring]} if branch.spring else {})


def _branch(given: object) -> Branch:
    if isinstance(given, Branch):
        given = dataclasses.asdict(given)
    known = [field.name for field in dataclasses.fields(Branch)]
    if isinstance(given, Mapping):
        if unknown := set(given) - set(known):
            raise errors.FieldError(f"branch has an unknown entry {min(map(str, unknown))!r}; known are {', '.join(known)}")
        table = dict(given)
    elif isinstance(given, str) or not isinstance(given, Sequence) or len(given) != 2:
        raise errors.FieldError(f"branch {units.brief(given)} is no pair of share and time, such as [0.2, '1 s']")
    else:
        table = dict(zip(known, given, strict=False))
    if missing := {"share", "time"} - set(table):
        raise errors.FieldError(f"branch has no {min(missing)}; write {{share = 0.2, time = '1 s'}}")
    spring = _spring(table.pop("spring", ()))
    values = {name: _relaxed(name, value) for name, value in table.items()}
    share, time = values["share"], values["time"]
    if not 0.0 < share <= LARGEST_SHARE:
        raise errors.FieldError(
            f"share of a branch is {share:g}; it is the branch's part of the law's shear modulus, above 0, such as 0.2"
        )
    if not time > 0.0:
        raise errors.FieldError(f"relaxation time of a branch is {time:g} s; it must be above 0")
    if (onset := values.get("onset", 1.0)) <= 0.0:
        raise errors.FieldError(
            f"onset of a branch is {onset:g}; it is a stress over the spring's modulus, above 0, such as 0.1"
        )
    if (least := values.get("least", 0.0)) > 1.0:
        raise errors.FieldError(f"least of a branch is {least:g}; it is a share of the viscosity, 0 to 1")
    if negative := next((name for name, value in values.items() if value < 0.0), None):
        raise errors.FieldError(f"{negative} of a branch is {values[negative]:g}; it must not be negative")
    return Branch(**values, spring=spring)


def _relaxed(name: str, value: object) -> float:
    if name == "onset" and value == math.inf:
        return math.inf
    return (SECONDS if name == "time" else schema.Quantity()).settled(f"{name} of a branch", value)


def _spring(given: object) -> tuple[tuple[float, float], ...]:
    """Return the terms of a spring, with weights that add up to 1."""
    like = "pairs of weight above 0 and exponent other than 0, one above 0, such as [[0.8, 1], [0.2, -2]]"
    if isinstance(given, str | Mapping) or not isinstance(given, Sequence):
        raise errors.FieldError(f"spring {units.brief(given)} of a branch is none of {like}")
    terms = []
    for branch in given:
        if isinstance(branch, str) or not isinstance(branch, Sequence) or len(branch) != 2:
            raise errors.FieldError(f"term {units.brief(branch)} of a branch's spring is none of {like}")
        terms.append(tuple(schema.Quantity().settled("spring of a branch", value) for value in branch))
    if terms and (min(w for w, _ in terms) <= 0.0 or not all(a for _, a in terms) or max(a for _, a in terms) <= 0.0):
        raise errors.FieldError(f"spring {units.brief(given)} of a branch is none of {like}")
    whole = sum(w for w, _ in terms)
    return tuple((w, a) if math.isclose(whole, 1.0) else (w / whole, a) for w, a in terms)


def _softening(given: object) -> Softening:
    if isinstance(given, Softening):
        given = [value for value in dataclasses.astuple(given) if math.isfinite(value)]
    if isinstance(given, str) or not isinstance(given, Sequence) or not 3 <= len(given) <= 4:
        raise errors.FieldError(
            f"softening {units.brief(given)} is not r, m, beta and perhaps a recovery time, such as [1.6, '2 kPa', 0.1]"
        )
    r, beta = (schema.Quantity().settled(f"softening {name}", given[at]) for name, at in (("r", 0), ("beta", 2)))
    m = schema.Quantity("Pa").settled("softening m", given[1])
    recovery = SECONDS.settled("recovery time", given[3]) if len(given) == 4 else math.inf
    if not r > 1.0:
        raise errors.FieldError(f"softening r is {r:g}; it must be above 1, or the silicone would carry nothing")
    if m < 0.0 or beta < 0.0 or m + beta == 0.0:
        raise errors.FieldError(f"softening m is {m:g} Pa and beta {beta:g}; neither may be negative, and one must be above 0")
    if not recovery > 0.0:
        raise errors.FieldError(f"recovery time is {recovery:g} s; it must be above 0")
    return Softening(r, m, beta, recovery)


Expression = Any
"""Values of an energy's arguments: UFL expressions (untyped), numpy arrays or numbers, real or complex, or `Dual`."""
Six = Sequence[Expression]

TENSOR_ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""Rows and columns of the six entries."""
ENTRY_COUNTS = (1, 1, 1, 2, 2, 2)
"""How often each of them stands in the tensor."""
IDENTITY = (1.0, 1.0, 1.0, 0.0, 0.0, 0.0)
SECONDS = schema.Quantity("s")
MOST_BRANCHES = 20
"""Each adds to the kernels, which take a minute to compile with this number."""
LARGEST_SHARE = 1e3
"""Above it a branch's share of the shear modulus is taken for a modulus in Pa."""


# ----------------------------------------------------------------------------------------------------------------------
# The data of a law.


@dataclasses.dataclass(frozen=True)
class Branch:
    """A Maxwell branch, of spring G.

    With I1e = Cbar : Cv^-1, J2 half the square of the branch's deviatoric stress, and I1v the trace of Cv, the spring's
    stress is that of a neo-Hookean one times g = sum w (I1e/3)^(a - 1), and the viscosity over G times ``time`` is

        least + (1 - least + growth ((I1v/3)^growth_exponent - 1)) / (1 + (J2/(onset G)^2)^exponent)

    ``share`` is its spring's shear modulus over the law's at small strain, which stays that of equilibrium; ``time`` the
    relaxation time in s, of small stress if it depends on it; ``onset`` infinite if viscosity never falls; ``spring`` pairs
    of w and a, with weights w that add up to 1, none for neo-Hookean.
    """

    share: float
    time: float
    onset: float = math.inf
    exponent: float = 0.5
    least: float = 0.0
    growth: float = 0.0
    growth_exponent: float = 1.0
    spring: tuple[tuple[float, float], ...] = ()

    @property
    def linear(self) -> bool:
        """Whether its relaxation time is constant and its spring neo-Hookean."""
        return math.isinf(self.onset) and not self.growth and not self.spring


@dataclasses.dataclass(frozen=True)
class Softening:
    """Mullins softening: below the largest energy Wm so far, stresses are 1 - erf((Wm - W)/(m + beta Wm))/r of the law's,
    with r above 1, the energy scale m in Pa and its growth beta with Wm 0 or more. ``recovery`` is the time in s in which Wm
    falls towards the energy of the moment; infinite for none."""

    r: float
    m: float
    beta: float
    recovery: float = math.inf


# ----------------------------------------------------------------------------------------------------------------------
# The formulas, once for UFL and numpy.


class Functions(Protocol):
    """Functions of expressions."""

    def exp(self, x: Expression) -> Expression: ...
    def erf(self, x: Expression) -> Expression: ...
    def below(self, x: Expression, y: Expression, then: Expression, other: Expression) -> Expression:
        """Return ``then`` where x < y, ``other`` elsewhere."""


class SofteningValues(Protocol):
    """`Softening`, or constants in its place."""

    @property
    def r(self) -> Expression: ...
    @property
    def m(self) -> Expression: ...
    @property
    def beta(self) -> Expression: ...


Spring = Sequence[tuple[Expression, Expression]]


class FlowValues(Protocol):
    """The flow of `Branch`, or constants in its place."""

    @property
    def onset(self) -> Expression: ...
    @property
    def exponent(self) -> Expression: ...
    @property
    def least(self) -> Expression: ...
    @property
    def growth(self) -> Expression: ...
    @property
    def growth_exponent(self) -> Expression: ...
    @property
    def spring(self) -> Spring: ...


class InUfl:
    """`Functions` of UFL."""

    @staticmethod
    def exp(x: Expression) -> Expression:
        return ufl.exp(x)

    @staticmethod
    def erf(x: Expression) -> Expression:
        return ufl.erf(x)

    @staticmethod
    def below(x: Expression, y: Expression, then: Expression, other: Expression) -> Expression:
        return ufl.conditional(ufl.lt(x, y), then, other)


class InNumpy:
    """`Functions` of numpy."""

    @staticmethod
    def exp(x: Expression) -> Expression:
        return np.exp(x)

    @staticmethod
    def erf(x: Expression) -> Expression:
        return scipy.special.erf(x)

    @staticmethod
    def below(x: Expression, y: Expression, then: Expression, other: Expression) -> Expression:
        return np.where(x < y, then, other)


def six(A: Expression) -> list[Expression]:
    """Return the entries of a symmetric 3 x 3 tensor that is indexed by A[i, j]."""
    return [A[i, j] for i, j in TENSOR_ENTRIES]


def cofactors(A: Six) -> list[Expression]:
    a, b, c, ab, ac, bc = A
    return [b * c - bc**2, a * c - ac**2, a * b - ab**2, ac * bc - ab * c, ab * bc - ac * b, ab * ac - bc * a]


def contracted(A: Six, B: Six) -> Expression:
    """Return A : B."""
    return A[0] * B[0] + A[1] * B[1] + A[2] * B[2] + 2 * (A[3] * B[3] + A[4] * B[4] + A[5] * B[5])


def determinant(A: Six) -> Expression:
    a, b, c, ab, ac, bc = A
    return a * (b * c - bc**2) - ab * (ab * c - ac * bc) + ac * (ab * bc - ac * b)


SERIES_LIMIT = 0.02
"""Argument below which the two functions of `_shares` are their series, to rounding."""


def _shares(z: Expression, of: Functions) -> tuple[Expression, Expression]:
    """Return (1 - exp(-z))/z and (z - 1 + exp(-z))/z^2."""
    series = [1 / math.factorial(5 + n) for n in (1, 2)]
    for k in reversed(range(5)):  # Horner's rule, because a compiled power takes as long as twenty products
        series = [1 / math.factorial(k + n) - z * term for n, term in zip((1, 2), series, strict=True)]
    big = of.below(z, SERIES_LIMIT, SERIES_LIMIT, z)
    first = (1 - of.exp(-big)) / big
    return of.below(z, SERIES_LIMIT, series[0], first), of.below(z, SERIES_LIMIT, series[1], (1 - first) / big)


def growth(C: Six, Cv: Six) -> Expression:
    """Return k: the rate over 1/tau at which (det A)^(1/3) grows; 1 at equilibrium, and more elsewhere."""
    return contracted(C, cofactors(Cv)) / 3


def step_of(C: Six, Cv: Six, x: Expression, of: Functions, k: Expression = None) -> tuple[list[Expression], Expression]:
    """Return H and b of a step of a length x over tau, Cbar and Cv where it begins; `growth` is that over it, or where it
    begins.

    With A' = (det A)^(1/3) Cbar/tau for Cv before it is made unimodular, (det A)^(1/3) growing at the rate k/tau that it has
    where the step begins, and Cbar linear over the step: second order in its length. Both are divided by exp(k dt/tau), which
    changes neither W nor Cv and keeps them finite for steps that are long against tau.
    """
    z = x * (growth(C, Cv) if k is None else k)
    whole, late = _shares(z, of)
    early, kept = x * (whole - late), 1 - z * whole
    return [kept * v + early * c for v, c in zip(Cv, C, strict=True)], x * late


def corrected_step(
    C: Six, end: Six, Cv: Six, x: Expression, flow: FlowValues, of: Functions, new: Six | None = None
) -> tuple[list[Expression], Expression]:
    """Return H and b of a step (see `step_of`) of a length over ``time``, of which the end Cbar is known, with the means of
    `growth` and `fluidity` over it. ``new`` is Cv at the end, as the rates of the beginning have it; computed if None."""
    rate = fluidity(C, Cv, flow, of)
    new = crept(end, *step_of(C, Cv, x * rate, of)) if new is None else new
    mean = (growth(C, Cv) + growth(end, new)) / 2
    return step_of(C, Cv, x * (rate + fluidity(end, new, flow, of)) / 2, of, mean)


def step_invariant(C: Six, H: Six, b: Expression) -> Expression:
    """Return 2 W/G minus its value at C = 0, with all digits: it has the derivative Cv^-1, and is I1e at no length of the
    step; C at its end, H and b of `step_of`.

    I1e at the end of a step of some length differs by an amount that changes little within the step, so that the energy of
    any spring of I1e, of this plus that amount where the step begins, has the spring's stress up to the square of the step.
    """
    start = determinant(H)
    rise = contracted(cofactors(H), C) + b * contracted(H, cofactors(C)) + b**2
    p, q = (start + b * rise) ** (1 / 3), start ** (1 / 3)
    return 3 * rise / (p**2 + p * q + q**2)


def spring_stiffness(I1: Expression, spring: Spring) -> Expression:
    """Return g, the stress over that of a neo-Hookean spring."""
    return sum(w * (I1 / 3) ** (a - 1) for w, a in spring) if spring else 1.0


def step_stress(C: Six, H: Six, b: Expression, spring: Spring = (), shift: Expression = 0.0) -> list[Expression]:
    """Return dW/dCbar over G of a branch at the end C of a step, H and b of `step_of`: half of Cv^-1, times g of a spring of
    I1. The shift is I1e minus `step_invariant`, where the step begins."""
    step_stress = [entry / 2 for entry in cofactors(crept(C, H, b))]
    if not spring:
        return step_stress
    g = spring_stiffness(step_invariant(C, H, b) + shift, spring)
    return [g * entry for entry in step_stress]


def step_stiffness(C: Six, H: Six, b: Expression, spring: Spring = (), shift: Expression = 0.0) -> list[list[Expression]]:
    """Return d2W/dCbar2 over G of a branch at the end of a step: of the symmetric 6 x 6 the lower triangle, by rows.

    With B = Cv^-1 and A = H + b Cbar it is b/2 det(A)^(-1/3) (B_ij B_kl / 3 - (B_ik B_jl + B_il B_jk) / 2), of a spring of I1
    times g, and dg/dI1 B_ij B_kl / 2 more. Arguments as of `step_stress`.
    """
    A = [h + b * c for h, c in zip(H, C, strict=True)]
    B, half = cofactors(crept(C, H, b)), b / 4 * determinant(A) ** (-1 / 3)
    third = half / 1.5
    if spring:
        I1 = step_invariant(C, H, b) + shift
        g = spring_stiffness(I1, spring)
        half, third = g * half, g * third + sum(w * (a - 1) / 6 * (I1 / 3) ** (a - 2) for w, a in spring)
    less, more = [half * entry for entry in B], [third * entry for entry in B]
    return [[more[p] * B[q] - _crossed(less, B, p, q) for q in range(p + 1)] for p in range(len(TENSOR_ENTRIES))]


def _crossed(A: Six, B: Six, p: int, q: int) -> Expression:
    """Return A_ik B_jl + A_il B_jk of the entries p = (i, j) and q = (k, l)."""
    (i, j), (k, m) = TENSOR_ENTRIES[p], TENSOR_ENTRIES[q]
    return _entry(A, i, k) * _entry(B, j, m) + _entry(A, i, m) * _entry(B, j, k)


def isochoric(C: Six, stress: Six, stiffness: Sequence[Six]) -> tuple[list[Expression], list[list[Expression]]]:
    """Return the first and second derivative of W(Cbar) by C, times J^(2/3) and J^(4/3), in Cbar alone, from those by Cbar,
    as of `step_stress` and `step_stiffness`."""
    inverse, t = cofactors(C), contracted(stress, C)
    slope = [s - t / 3 * i for s, i in zip(stress, inverse, strict=True)]
    along = [
        contracted([stiffness[max(p, q)][min(p, q)] for q in range(len(TENSOR_ENTRIES))], C) for p in range(len(TENSOR_ENTRIES))
    ]
    less = (contracted(along, C) - t) / 18
    u = [(a + s) / 3 - less * i for a, s, i in zip(along, slope, inverse, strict=True)]
    sixth = [t / 6 * i for i in inverse]
    return slope, [
        [entry - (u[p] * inverse[q] + inverse[p] * u[q]) + _crossed(sixth, inverse, p, q) for q, entry in enumerate(row)]
        for p, row in enumerate(stiffness)
    ]


def fluidity(C: Six, Cv: Six, flow: FlowValues, of: Functions) -> Expression:
    """Return the rate of a branch over 1/``time``, 1 of a linear one; see `Branch`."""
    g = spring_stiffness(3 * growth(C, Cv), flow.spring)
    J2 = g**2 * lost(C, Cv) / flow.onset**2
    thinned = 1 + of.below(J2, 0.0, 0.0, J2) ** flow.exponent
    crept = flow.growth * (((Cv[0] + Cv[1] + Cv[2]) / 3) ** flow.growth_exponent - 1)
    return g / (flow.least + (1 - flow.least + crept) / thinned)


def crept(C: Six, H: Six, b: Expression) -> list[Expression]:
    """Return Cv at the end of a step, of Cbar there and `step_of`."""
    A = [h + b * c for h, c in zip(H, C, strict=True)]
    scale = determinant(A) ** (-1 / 3)
    return [scale * a for a in A]


def stored(C: Six, Cv: Six, spring: Spring = ()) -> Expression:
    """Return the energy of a branch over G; that of a spring without terms is neo-Hookean."""
    I1 = contracted(C, cofactors(Cv))
    return sum(1.5 * w / a * ((I1 / 3) ** a - 1) for w, a in spring) if spring else (I1 - 3) / 2


def lost(C: Six, Cv: Six) -> Expression:
    """Return the power that a linear branch dissipates, times tau and over G, and J2 over G^2: never negative."""
    B = cofactors(Cv)  # the inverse, because det Cv = 1
    CB = [[sum(_entry(C, i, k) * _entry(B, k, j) for k in range(3)) for j in range(3)] for i in range(3)]
    square = sum(CB[i][j] * CB[j][i] for i in range(3) for j in range(3))
    return (square - sum(CB[i][i] for i in range(3)) ** 2 / 3) / 2


def dissipated(C: Six, Cv: Six, flow: FlowValues | None, of: Functions) -> Expression:
    """Return the power that a branch dissipates, times ``time`` and over G; of a linear one without a flow."""
    if flow is None:
        return lost(C, Cv)
    return spring_stiffness(3 * growth(C, Cv), flow.spring) * fluidity(C, Cv, flow, of) * lost(C, Cv)


def _entry(A: Six, i: int, j: int) -> Expression:
    return A[i] if i == j else A[2 + i + j]


AS_LARGE = 1e-10
"""Energy below the largest so far, over m + beta Wm, within which it counts as the largest: the stiffness jumps there, and on
the first loading, where both are equal but for rounding, it is that of loading on. The stress changes by less than this
share."""


def softened(W: Expression, Wm: Expression, values: SofteningValues, of: Functions) -> Expression:
    """Return the softened energy of the law's energy W and the largest so far, Wm; its derivative by W is the share of the
    stress that is left. The values are a `Softening`, or its constants by the same names."""
    s = values.m + values.beta * Wm
    y = (Wm - W) / s
    psi = W + s / values.r * (y * of.erf(y) + (of.exp(-(y**2)) - 1) / math.sqrt(math.pi))
    return of.below(W, Wm - AS_LARGE * s, psi, W)
