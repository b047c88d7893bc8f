"""Test specimens: nominal stress under homogeneous stretch, and its exact slopes by the stretch and by every parameter;
where a law stops being stable.

All come from `Material.derivative`, so a new law needs only an energy. Compressible specimens find their free sides from the
condition that these carry no stress; the slopes follow by the implicit function theorem. `stress_in_time` is for silicone with
a memory.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import types
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from softmodels.common.arrays import Array
from softmodels.common.lazy import scipy
from softmodels.materials import laws, memory
from softmodels.materials.laws import Material, MaterialError

# ----------------------------------------------------------------------------------------------------------------------
# Closed-form solutions without a mesh: test specimens, balloons and thick-walled spheres of any law.
#
# The material is treated as incompressible for any Poisson's ratio, except by `respond`. Stresses come back in the unit of
# the law's parameters (Pa); beyond the locking stretch of a law (Gent) they are nan.


_COMPLEX_STEP = 1e-30  # so small that its square vanishes relative to 1: no truncation error

MODES: dict[str, tuple[tuple[float, float, float], int]] = {
    "uniaxial": ((1.0, -0.5, -0.5), 1),
    "planar": ((1.0, 0.0, -1.0), 1),
    "equibiaxial": ((1.0, 1.0, -2.0), 2),
}
"""Tests of an incompressible specimen: principal stretches as powers of the imposed one, and the number of loaded sides."""
MODE_NAMES = tuple(MODES)


def _slope(
    law: Material,
    stretches: Sequence[memory.Expression],
    change: Sequence[memory.Expression],
    compressible: bool = False,
) -> memory.Expression:
    """Return `Material.derivative`; nan where the law has no energy. The logarithm of a negative number is that only for
    reals: of complex stretches it would count as a stress."""
    slope = law.derivative(stretches, change, compressible)
    return np.where(np.isfinite(slope.value), slope.slope, np.nan)


def nominal_stress(material: Material, stretch: npt.ArrayLike, mode: str = "uniaxial") -> Array:
    """Return the force per undeformed area on a loaded side, incompressible.

    Args:
        material: The law.
        stretch: Imposed stretch, any shape.
        mode: ``"uniaxial"`` (strip), ``"planar"`` (wide strip, also called pure shear) or ``"equibiaxial"`` (sheet).

    Returns:
        Nominal stress in Pa, shape of ``stretch``. Two sides share the work in ``"equibiaxial"``.
    """
    _check(mode)
    with np.errstate(all="ignore"):
        return np.asarray(_incompressible_stress(material, np.asarray(stretch, dtype=float), mode))


def _check(mode: str) -> None:
    if mode not in MODES:
        raise ValueError(f"mode {mode!r} is not one of {', '.join(MODES)}")


def _incompressible_stress(law: Material, stretch: memory.Expression, mode: str) -> memory.Expression:
    stress_and_slope = _specimen_stress(law, stretch, mode)
    return np.where(np.isfinite(stress_and_slope.value), stress_and_slope.slope, np.nan)


def _specimen_stress(law: Material, stretch: memory.Expression, mode: str) -> laws.Dual:
    """Return the energy of an incompressible specimen with its nominal stress as the slope."""
    powers, sides = MODES[mode]
    stretches = [stretch**power for power in powers]
    change = [power * side / stretch / sides for power, side in zip(powers, stretches, strict=True)]
    return law.derivative(stretches, change)


def secant_modulus(material: Material, stretch: float) -> float:
    """Return the shear modulus in Pa of the neo-Hookean specimen with the same nominal stress at a uniaxial stretch."""
    return float(nominal_stress(material, stretch)) / (stretch - stretch**-2)


def balloon_pressure(material: Material, stretch: npt.ArrayLike, thickness_over_radius: float) -> Array:
    """Return the pressure in Pa in a thin spherical balloon: P = 2 (t/R) S / stretch^2, S of equibiaxial tension.

    The work P dv on the volume 4/3 pi (stretch R)^3 is the rise of the energy of the volume 4 pi R^2 t. Terms of the order
    (t/R)^2 are dropped if R is the undeformed middle radius.

    Args:
        material: The law.
        stretch: Circumference over undeformed circumference, any shape.
        thickness_over_radius: t/R of the undeformed balloon.
    """
    stretch = np.asarray(stretch, dtype=float)
    return 2 * thickness_over_radius * nominal_stress(material, stretch, "equibiaxial") / stretch**2


def balloon_limit(material: Material, thickness_over_radius: float, most: float = 10.0) -> tuple[float, float] | None:
    """Return the first maximum of `balloon_pressure` between stretch 1 and ``most``.

    A neo-Hookean balloon has it at 7^(1/6) = 1.383.

    Returns:
        Stretch and pressure in Pa, or None where the pressure only rises.
    """

    def rise(stretch: Array | float) -> Array:
        with np.errstate(all="ignore"):
            response = _incompressible(material, np.asarray(stretch), "equibiaxial", ())
        return (response.tangent - 2 * response.stress / stretch) / material.shear_modulus_0

    scan = np.linspace(1.0, most, 2000)
    falls = np.flatnonzero(rise(scan) < 0.0)
    if not len(falls) or falls[0] == 0:
        return None
    stretch = float(scipy.optimize.brentq(rise, scan[falls[0] - 1], scan[falls[0]], xtol=1e-14))
    return stretch, float(balloon_pressure(material, stretch, thickness_over_radius))


def sphere_pressure(material: Material, inner: float, outer: float, inner_stretch: npt.ArrayLike) -> Array:
    """Return the pressure in Pa inside a thick-walled incompressible sphere, none outside.

    P = int W'(l) / (l^3 - 1) dl from the outer wall's stretch to the inner wall's (Ogden 1984, Non-linear Elastic
    Deformations, section 5.3.2; Green & Zerna 1968, section 3.10), W of equibiaxial tension. With l^3 - 1 falling as the
    cube of the radius R the same integral is int W' / (l^2 R) dR, which has no 0/0 at l = 1.

    Args:
        material: The law.
        inner: Undeformed inner radius in m.
        outer: Undeformed outer radius in m.
        inner_stretch: Inner radius over undeformed inner radius, any shape.
    """
    return _wall_pressure(material, inner, outer, inner_stretch, "equibiaxial", 3)


def _wall_pressure(
    material: Material, inner: float, outer: float, inner_stretch: npt.ArrayLike, mode: str, power: int
) -> Array:
    """Return the equilibrium through a wall in which stretch^power - 1 falls as 1 / R^power, as incompressibility has it."""

    def pressure(at_inner: float) -> float:
        def integrand(radius: float) -> float:
            stretch = (1 + (at_inner**power - 1) * (inner / radius) ** power) ** (1 / power)
            return MODES[mode][1] * float(nominal_stress(material, stretch, mode)) / (stretch ** (power - 1) * radius)

        if not np.isfinite(integrand(inner)):
            return np.nan  # the inner wall has the largest strain, so its limit ends the integration
        return float(scipy.integrate.quad(integrand, inner, outer, epsabs=1e-12 * material.shear_modulus_0, epsrel=1e-11)[0])

    return np.vectorize(pressure, otypes=[float])(np.asarray(inner_stretch, dtype=float))


_MAX_NEWTON_STEPS = 60


@dataclasses.dataclass(frozen=True, eq=False)
class Response:
    """Stress of a specimen and its slopes; nan beyond what the law allows.

    Attributes:
        stress: Nominal stress in Pa of a pulled side, shape (n,).
        slopes: Its slopes by the parameters asked for, in Pa per their unit, shape (n, m).
        side: Stretch of a free side, shape (n,).
        by_stretch: Computes `tangent`.
    """

    stress: Array
    slopes: Array
    side: Array
    by_stretch: Callable[[], Array]

    @functools.cached_property
    def tangent(self) -> Array:
        """The stress' slope by the stretch in Pa, shape (n,), computed on demand because fits do not need it."""
        with np.errstate(all="ignore"):
            return self.by_stretch()


def respond(material: Material, stretch: npt.ArrayLike, mode: str = "uniaxial", parameters: Sequence[str] = ()) -> Response:
    """Pull a specimen.

    Args:
        material: The law; at ``poisson = 0.5`` the specimen is incompressible.
        stretch: Imposed stretch, shape (n,).
        mode: One of `MODE_NAMES`.
        parameters: Names (see `Material.parameter_names`, ``poisson``, `laws.FORM`) to differentiate by.
    """
    _check(mode)
    stretch = np.asarray(stretch, dtype=float)
    with np.errstate(all="ignore"):  # beyond a law's locking stretch the numbers are nan on purpose
        if math.isinf(material.bulk):
            return _incompressible(material, stretch, mode, parameters)
        return _compressible(material, stretch, mode, parameters)


def nudged(material: Material, name: str, by: complex) -> Material:
    """Return an unchecked copy with one parameter changed, possibly to a complex value; only for evaluating its energy.

    Parameters of its memory are ``share1``, ``time1`` and so on of the branches, and `SOFTENING`; `laws.FORM_ENERGIES` have
    one too.
    """
    copy = object.__new__(type(material))
    for field in dataclasses.fields(material):
        value = getattr(material, field.name)
        if isinstance(value, memory.Memory):
            value = _nudged_memory(value, name, by)
        elif isinstance(value, tuple):
            value = tuple(v + by if name == f"{field.name}{i + 1}" else v for i, v in enumerate(value))
        elif name == field.name:
            value = value + by
        object.__setattr__(copy, field.name, value)
    if name in laws.FORM_ENERGIES:
        object.__setattr__(copy, "forms", {**material.forms, name: material.forms.get(name, 0.0) + by})
    return copy


def _nudged_memory(given: memory.Memory, name: str, by: complex) -> memory.Memory:
    branches = tuple(
        dataclasses.replace(
            branch,
            share=branch.share + by * (name == f"share{k}"),  # type: ignore[arg-type]
            time=branch.time + by * (name == f"time{k}"),  # type: ignore[arg-type]
        )
        for k, branch in enumerate(given.branches, 1)
    )
    soft = given.softening
    if soft is not None and name in SOFTENING:
        r, m, beta = SOFTENING
        soft = memory.Softening(
            1 / (1 / soft.r + by) if name == r else soft.r,  # type: ignore[arg-type]
            soft.m + by * (name == m),  # type: ignore[arg-type]
            soft.beta + by * (name == beta),  # type: ignore[arg-type]
            soft.recovery,
        )
    return memory.Memory(branches, soft)


FORM_SAMPLES = 12
"""Strains at which `form_shares` are computed."""


def form_shares(material: Material, strain: float) -> tuple[Array, Array, Array]:
    """Return equibiaxial stretches, shape (n,), up to an I1 - 3, the law's stress there over that of the law of I1 with the
    same curve in uniaxial tension, and the factor of `laws.form_energy` which that difference is; nan beyond what the law
    allows."""
    top = float(np.roots([2.0, 0.0, -(3.0 + strain), 0.0, 0.0, 0.0, 1.0]).real.max())
    stretch = np.linspace(1.0, top, FORM_SAMPLES + 1)[1:]
    response = respond(dataclasses.replace(material, poisson=0.5, memory=None), stretch, "equibiaxial", (laws.FORM,))  # type: ignore[call-arg]
    pulled = laws.uniaxial_stretch(2 * stretch**2 + stretch**-4)
    same = nominal_stress(material, pulled) * (stretch - stretch**-5) / (pulled - pulled**-2)
    return stretch, response.stress / same, (response.stress - same) / response.slopes[:, 0]


def _incompressible(material: Material, stretch: Array, mode: str, parameters: Sequence[str]) -> Response:
    def by_step(law: Material, at: memory.Expression) -> Array:
        return np.asarray(np.imag(_incompressible_stress(law, at, mode)) / _COMPLEX_STEP + dead)

    stress = np.asarray(_incompressible_stress(material, stretch, mode))
    dead = 0.0 * stress  # nan where it is
    # The stretch stays real, so that only terms with the nudged parameter are complex: complex powers take most of a fit's
    # time.
    columns = [by_step(nudged(material, name, 1j * _COMPLEX_STEP), stretch) for name in parameters]
    side = stretch ** MODES[mode][0][2]
    return Response(stress, _columns(columns, stretch), side, lambda: by_step(material, stretch + 1j * _COMPLEX_STEP))


_SIDES = {
    "uniaxial": ((1.0, 0.0, 0.0), (0.0, 1.0, 1.0)),
    "planar": ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    "equibiaxial": ((1.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
}
"""Which sides are pulled, and which are free; others keep their length."""


def _compressible(material: Material, stretch: Array, mode: str, parameters: Sequence[str]) -> Response:
    pulled, free = _SIDES[mode]

    def slopes(law: Material, a: memory.Expression, s: memory.Expression) -> tuple[memory.Expression, memory.Expression]:
        """Return dW/da and dW/ds of the loaded and the free sides."""
        stretches = [i * a + j * s + (1.0 - i - j) for i, j in zip(pulled, free, strict=True)]
        return _slope(law, stretches, pulled, True), _slope(law, stretches, free, True)

    side = _free_side(material, slopes, stretch, mode)
    stress = slopes(material, stretch, side)[0] / sum(pulled)
    dead = 0.0 * stress
    a, s = stretch.astype(complex), side.astype(complex)
    by_side = slopes(material, a, s + 1j * _COMPLEX_STEP)

    def follow(moved: tuple[memory.Expression, memory.Expression]) -> Array:
        """Return the total derivative, with the free side moving so that it stays stress-free."""
        drift = -np.imag(moved[1]) / np.imag(by_side[1])
        total: Array = (np.imag(moved[0]) / _COMPLEX_STEP + np.imag(by_side[0]) / _COMPLEX_STEP * drift) / sum(pulled) + dead
        return total

    columns = [follow(slopes(nudged(material, name, 1j * _COMPLEX_STEP), a, s)) for name in parameters]
    return Response(stress, _columns(columns, stretch), side, lambda: follow(slopes(material, a + 1j * _COMPLEX_STEP, s)))


def _free_side(material: Material, slopes: memory.Expression, stretch: Array, mode: str) -> Array:
    """Return the stretch of the free sides at which dW/ds vanishes: Newton from the incompressible side, safeguarded.

    The energy rises on both sides of the root, so that signs of the slope bracket it and a step outside is halved back in.
    """
    nu = material.poisson
    exact = stretch ** MODES[mode][0][2]  # what it would be at nu = 0.5
    side = exact ** (2 * nu if mode == "uniaxial" else nu / (1 - nu))  # Hooke's law in logarithms
    low, high = np.minimum(np.minimum(exact, 1.0), side) / 2, np.maximum(np.maximum(exact, 1.0), side) * 2
    for _ in range(_MAX_NEWTON_STEPS):
        here = slopes(material, stretch, side)[1]
        low, high = np.where(here < 0.0, side, low), np.where(here > 0.0, side, high)
        rise = np.imag(slopes(material, stretch.astype(complex), side + 1j * _COMPLEX_STEP)[1]) / _COMPLEX_STEP
        step = side - here / rise
        step = np.where((step > low) & (step < high) & (rise > 0.0), step, np.sqrt(low * high))
        moved = np.abs(step - side) > 4e-16 * side
        side = np.where(np.isfinite(here), step, side)
        if not (moved & np.isfinite(here)).any():
            break
    return side


def _columns(columns: list[Array], stretch: Array) -> Array:
    return np.stack(columns, axis=-1) if columns else np.empty((*stretch.shape, 0))


# ----------------------------------------------------------------------------------------------------------------------
# Specimens through time: incompressible, from rest, with the stretch linear between the given times.


MOST_ERROR = 1e-4
"""Largest error of integration in time, relative to the largest stress."""
_MAX_HALVINGS = 12
SOFTENING = ("softening", "softening_m", "softening_beta")
"""Names of the softening's parameters to differentiate by: 1/r, m in Pa, beta."""
FLOW = ("onset", "exponent")
"""Names of what all branches have in common, to differentiate by."""
_FLOW_STEP = 1e-3


def branch_stress(
    time: npt.ArrayLike, stretch: npt.ArrayLike, mode: str, branches: Sequence[memory.Branch], error: float = MOST_ERROR
) -> Array:
    """Return the nominal stress over G of Maxwell branches, which depends on no parameter of the law.

    Each interval is halved until two steps agree with one. What an interval may add to the error of a branch is its length
    over the relaxation time, because the branch forgets errors as it forgets strains.

    Args:
        time: In s, not falling, shape (n,). Equal times are a jump; so is a first stretch other than 1.
        stretch: Imposed stretch, shape (n,).
        mode: One of `MODE_NAMES`.
        branches: The branches; their shares do not count.
        error: See `MOST_ERROR`; relative to the largest stress of a spring G without a dashpot.

    Returns:
        Shape (n, k).
    """
    time, stretch = (np.asarray(values, dtype=float) for values in (time, stretch))
    taus = np.array([branch.time for branch in branches], dtype=float)
    powers, sides, flow = np.array(MODES[mode][0]), MODES[mode][1], _flow(branches)

    def squares(x: float) -> list[float]:
        return [*(x ** (2 * powers)).tolist(), 0.0, 0.0, 0.0]

    def stress(x: float, Cv: Sequence[memory.Expression]) -> Array:
        branch_sum = np.asarray(sum(p * x ** (2 * p - 1) / v for p, v in zip(powers, Cv, strict=False)) / sides)
        return (
            branch_sum if flow is None else branch_sum * memory.spring_stiffness(3 * memory.growth(squares(x), Cv), flow.spring)
        )

    def crossed(Cv: list[memory.Expression], at: int, steps: int) -> list[memory.Expression]:
        nodes = np.linspace(stretch[at - 1], stretch[at], steps + 1)
        x = (time[at] - time[at - 1]) / steps / taus
        C = squares(nodes[0])
        for node in nodes[1:]:
            end = squares(node)
            if flow is None:
                Cv = memory.crept(end, *memory.step_of(C, Cv, x, memory.InNumpy))
            else:
                Cv = memory.crept(end, *memory.corrected_step(C, end, Cv, x, flow, memory.InNumpy))
            C = end
        return Cv

    rest = list(memory.IDENTITY)
    allowed = 3 * error * max(float(np.abs(stress(x, rest)).max()) for x in (stretch.min(), stretch.max()))
    Cv: list[memory.Expression] = [np.full(taus.shape, other) for other in rest]
    branch_sum, steps = [stress(stretch[0], Cv)], 1
    for at in range(1, len(time)):
        coarse = crossed(Cv, at, steps)
        share = np.minimum((time[at] - time[at - 1]) / taus, 1.0)
        for _ in range(_MAX_HALVINGS):
            fine = crossed(Cv, at, 2 * steps)
            off = np.abs(stress(stretch[at], fine) - stress(stretch[at], coarse)) - allowed * share
            if (off <= 1e-13).all():
                break
            coarse, steps = fine, 2 * steps
        Cv, steps = fine, max(steps // 2, 1)
        branch_sum.append(stress(stretch[at], Cv))
    return np.array(branch_sum)


def _flow(branches: Sequence[memory.Branch]) -> types.SimpleNamespace | None:
    """Return what `memory.fluidity` takes of some branches at once; None if all are linear."""
    if all(branch.linear for branch in branches):
        return None
    names = ("onset", "exponent", "least", "growth", "growth_exponent")
    springs = [branch.spring or ((1.0, 1.0),) for branch in branches]
    terms = max(map(len, springs))
    filled = np.array([[*spring, *[(0.0, 1.0)] * (terms - len(spring))] for spring in springs])
    values = {name: np.array([getattr(branch, name) for branch in branches]) for name in names}
    return types.SimpleNamespace(**values, spring=[(filled[:, k, 0], filled[:, k, 1]) for k in range(terms)])


def stress_in_time(
    material: Material,
    time: npt.ArrayLike | None,
    stretch: npt.ArrayLike,
    mode: str = "uniaxial",
    parameters: Sequence[str] = (),
    branches: Array | None = None,
) -> tuple[Array, Array]:
    """Return the nominal stress in Pa of an incompressible specimen through a history of stretch, and its exact slopes.

    Args:
        material: The law, with or without a memory.
        time: In s, see `branch_stress`; None for a test so slow that every branch is relaxed.
        stretch: Imposed stretch, shape (n,).
        mode: One of `MODE_NAMES`.
        parameters: Names to differentiate by: the law's, ``share1`` and so on of the branches, `SOFTENING`, and by central
            differences ``time1`` and so on, and `FLOW`.
        branches: `branch_stress` of the same history, where it is known and none of the latter is asked for.

    Returns:
        Shapes (n,) and (n, m).
    """
    stretch = np.asarray(stretch, dtype=float)
    own = material.memory or memory.Memory()
    shares = np.array([branch.share for branch in own.branches])
    by_flow: dict[str, Array] = {}
    if branches is None:
        branches = np.zeros((len(stretch), len(shares)))
        if time is not None and own.branches:
            further = [name for name in parameters if name in FLOW or name.startswith("time")]
            branches, by_flow = _branch_slopes(time, stretch, mode, own.branches, further)
    with np.errstate(all="ignore"):
        stress_and_slope = _specimen_stress(material, stretch, mode)
        stress, energy = (
            np.where(np.isfinite(stress_and_slope.value), stress_and_slope.slope, np.nan),
            stress_and_slope.value,
        )
        dead = 0.0 * stress  # nan where it is
        size, viscous = material.shear_modulus_0, branches @ shares
        slopes, energy_slopes = np.zeros((2, len(stretch), len(parameters)))
        added = np.zeros((len(stretch), len(parameters)))
        for i, name in enumerate(parameters):
            if name.startswith("share"):
                added[:, i] = size * branches[:, int(name[5:]) - 1]
            elif name in by_flow:
                added[:, i] = size * by_flow[name] @ shares
            elif name not in (*SOFTENING, *FLOW):
                moved = nudged(material, name, 1j * _COMPLEX_STEP)
                change = _specimen_stress(moved, stretch, mode)
                slopes[:, i], energy_slopes[:, i] = (np.imag(v) / _COMPLEX_STEP + dead for v in (change.slope, change.value))
                added[:, i] = np.imag(moved.shear_modulus_0) / _COMPLEX_STEP * viscous
        if own.softening is not None:
            stress, slopes = _softened_curve(own.softening, time, stress, slopes, energy, energy_slopes, parameters)
    return stress + size * viscous, slopes + added


def modulus_slopes(material: Material, parameters: Sequence[str]) -> Array:
    """Return the derivatives of the small-strain shear modulus by parameters of the law, shape (m,)."""
    moved = [nudged(material, name, 1j * _COMPLEX_STEP).shear_modulus_0 for name in parameters]
    return np.asarray(np.imag(moved) / _COMPLEX_STEP)


def _branch_slopes(
    time: npt.ArrayLike, stretch: Array, mode: str, branches: Sequence[memory.Branch], names: Sequence[str]
) -> tuple[Array, dict[str, Array]]:
    """Return `branch_stress` and its slopes by a branch's time, or parameters of all branches, by central differences in the
    same steps."""
    together, steps = list(branches), []
    for name in names:
        field, own = ("time", branches[int(name[4:]) - 1]) if name.startswith("time") else (name, None)
        steps.append(_FLOW_STEP * getattr(own or branches[0], field))
        together += [
            dataclasses.replace(branch, **{field: getattr(branch, field) + d}) if own in (None, branch) else branch
            for d in (steps[-1], -steps[-1])
            for branch in branches
        ]
    base, *ends = np.split(branch_stress(time, stretch, mode, together), 1 + 2 * len(names), axis=1)
    pairs = zip(names, ends[::2], ends[1::2], steps, strict=True)
    return base, {name: (up - down) / (2 * step) for name, up, down, step in pairs}


def _softened_curve(
    soft: memory.Softening,
    time: npt.ArrayLike | None,
    stress: Array,
    slopes: Array,
    W: Array,
    W_slopes: Array,
    parameters: Sequence[str],
) -> tuple[Array, Array]:
    Wm, Wm_slopes = _largest_energy(time, W, W_slopes, soft.recovery)
    damage, s = 1 / soft.r, soft.m + soft.beta * Wm
    y = np.where(s > 0.0, (Wm - W) / np.where(s > 0.0, s, 1.0), 0.0)
    left = 1 - damage * scipy.special.erf(y)
    explicit = np.zeros_like(slopes)
    s_slopes = soft.beta * Wm_slopes
    for i, name in enumerate(parameters):
        if name == SOFTENING[0]:
            explicit[:, i] = -scipy.special.erf(y)
        elif name == SOFTENING[1]:
            s_slopes[:, i] = 1.0
        elif name == SOFTENING[2]:
            s_slopes[:, i] = Wm
    by_y = -damage * 2 / math.sqrt(math.pi) * np.exp(-(y**2))
    y_slopes = (Wm_slopes - W_slopes - y[:, None] * s_slopes) / np.where(s > 0.0, s, 1.0)[:, None]
    return left * stress, left[:, None] * slopes + stress[:, None] * (explicit + by_y[:, None] * y_slopes)


def _largest_energy(time: npt.ArrayLike | None, W: Array, W_slopes: Array, recovery: float) -> tuple[Array, Array]:
    """Return the largest energy so far, which recovers towards that of the moment, and its slopes."""
    if math.isinf(recovery) or time is None:
        places = np.arange(len(W))
        last = np.maximum.accumulate(np.where(np.maximum.accumulate(W) <= W, places, 0))
        return W[last], W_slopes[last]
    x = np.diff(np.asarray(time, dtype=float)) / recovery
    kept = np.exp(-x)
    mean = np.where(x > 1e-8, -np.expm1(-x) / np.where(x > 1e-8, x, 1.0), 1.0)
    both = np.column_stack([W, W_slopes])
    above = np.zeros_like(both)
    for i in range(1, len(W)):
        above[i] = above[i - 1] * kept[i - 1] - (both[i] - both[i - 1]) * mean[i - 1]
        if not above[i, 0] > 0.0:
            above[i] = 0.0
    largest = both + above
    return largest[:, 0], largest[:, 1:]


def log_strain_stiffness(material: Material, stretch: npt.ArrayLike, mode: str) -> tuple[Array, Array]:
    """Return the Hessian of the incompressible energy in Pa, shape (n, 2, 2), in the logarithms of two principal stretches,
    the third following, at stretches along a mode, shape (n,); and I1 - 3 of the states, shape (n,).

    It relates increments of Kirchhoff stress in a sheet to increments of logarithmic strain: Drucker's stability wants it
    positive definite.
    """
    stretch = np.asarray(stretch, dtype=float)
    e1, e2 = (np.log(stretch) * power for power in MODES[mode][0][:2])

    def gradient(a: memory.Expression, b: memory.Expression) -> list[memory.Expression]:
        sides = np.exp(a), np.exp(b), np.exp(-a - b)
        return [_slope(material, sides, (i * sides[0], j * sides[1], -sides[2])) for i, j in np.eye(2)]

    with np.errstate(all="ignore"):
        first, second = gradient(e1 + 1j * _COMPLEX_STEP, e2 + 0j), gradient(e1 + 0j, e2 + 1j * _COMPLEX_STEP)
        H = np.moveaxis(np.imag([first, second]), (0, 1), (-2, -1)) / _COMPLEX_STEP + 0.0 * gradient(e1, e2)[0][:, None, None]
        k = np.exp(2 * e1) + np.exp(2 * e2) + np.exp(-2 * (e1 + e2)) - 3
    return H, k


def strain_of(mode: str, stretch: npt.ArrayLike) -> Array:
    """Return I1 - 3 of an incompressible specimen, shape of ``stretch``."""
    powers, stretch = MODES[mode][0], np.asarray(stretch)
    return np.asarray(sum(stretch ** (2 * power) for power in powers) - 3)


# ----------------------------------------------------------------------------------------------------------------------
# Stability of a law: Drucker's criterion, locking chains, and the balloon's limit point.
#
# Drucker: in a sheet, an increment of logarithmic strain must raise the Kirchhoff stress along it. A fit that violates
# it within its range makes simulations fail, however small its residuals.


MAX_STRETCH = 10.0
"""Range of stretch, up to this value and down to its inverse, over which a law is checked."""
STRETCH_POINTS = 600
INITIAL_STRETCH_TOLERANCE = 0.01
"""Stretch near 1 below which an instability counts as initial."""


@dataclasses.dataclass(frozen=True)
class Instability:
    """The first unstable state along a mode of `MODE_NAMES`, from rest: its stretch, below 1 in compression, and I1 - 3."""

    mode: str
    stretch: float
    strain: float

    def __str__(self) -> str:
        way = "tension" if self.stretch > 1 else "compression"
        return f"{self.mode} {way} at stretch {self.stretch:.3g}"


@functools.lru_cache(maxsize=64)
def instabilities(material: Material, furthest: float = MAX_STRETCH) -> tuple[Instability, ...]:
    """Return the first states along every mode, in tension and compression, that violate Drucker's criterion, the smallest
    strain first, of a law taken as incompressible; from 1/furthest to ``furthest`` of stretch."""
    instabilities = []
    for mode in MODE_NAMES:
        for way in (1.0, -1.0):
            first = _first(
                material,
                mode,
                np.exp(way * np.linspace(min(1e-3, math.log(furthest) / 2), math.log(furthest), STRETCH_POINTS)),
            )
            if first:
                instabilities.append(first)
    return tuple(sorted(instabilities, key=lambda instability: instability.strain))


def weakest(material: Material) -> Instability | None:
    """Return the instability at the smallest stretch in tension, over all modes; None up to `MAX_STRETCH`."""
    return min(
        (instability for instability in instabilities(material) if instability.stretch > 1),
        key=lambda instability: instability.stretch,
        default=None,
    )


def weakness(material: Material) -> str:
    """Return at which stretch a law becomes unstable in tension, as a clause with its name; empty if stable up to
    `MAX_STRETCH`."""
    stretch_by_mode = {
        instability.mode: instability.stretch for instability in instabilities(material) if instability.stretch > 1
    }
    if not stretch_by_mode:
        return ""
    places = ", ".join(f"{stretch_by_mode[mode]:.3g} ({mode})" for mode in MODE_NAMES if mode in stretch_by_mode)
    return f"the law {described(material)} becomes unstable (Drucker's criterion) in tension at stretch {places}"


def described(material: Material) -> str:
    """Return a law with its parameters: ``yeoh (c1 = 10 kPa, c2 = -0.1 kPa)``."""
    parts = []
    for field in laws.parameter_fields(material):
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
    """Raise `MaterialError` for a law that is not stable (Drucker) within `INITIAL_STRETCH_TOLERANCE` of its state of rest."""
    if weak := instabilities(material, furthest=1 + INITIAL_STRETCH_TOLERANCE):
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

    def left(stretch: float) -> float:
        return float(strain_of(mode, stretch)) - limit

    return float(scipy.optimize.brentq(left, 1.0, 2 + 2 * math.sqrt(limit + 3)))


@dataclasses.dataclass(frozen=True)
class Verdict:
    """Stability of a law: sentences that forbid its use within a range of deformation, and notes on what lies beyond."""

    flags: tuple[str, ...]
    notes: tuple[str, ...]


def judge(material: Material, strain: float) -> Verdict:
    """Check the stability of a law up to the largest fitted (or shown) I1 - 3."""
    flags, notes = [], [material.misread] if material.misread else []
    weak = instabilities(material)
    inside = [instability for instability in weak if instability.strain <= strain]
    if inside:
        where = "; ".join(map(str, inside))
        flags.append(f"the law is unstable (Drucker) within this range: {where}")
    elif weak:
        notes.append(f"stable (Drucker) within this range; unstable beyond it in {weak[0]}")
    else:
        notes.append(f"stable (Drucker) in every mode from stretch {1 / MAX_STRETCH:g} to {MAX_STRETCH:g}")
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
    """A material's curves over stretches, shape (n,), by mode, and its stability over these; the name as asked for."""

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
