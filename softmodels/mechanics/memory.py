"""Histories of a region's silicone at the integration points, and its energy over one time step; see `materials.memory`.

What a step begins with are functions: the displacement there, and at the points each branch's Cv and the largest energy Wm of
the softening. With a step of no length the energy is that of the state itself, where nothing creeps.
"""

from __future__ import annotations

import itertools
import math
import types
from typing import TYPE_CHECKING

import numpy as np

from softmodels.common.arrays import Array
from softmodels.materials import memory
from softmodels.materials.laws import Material
from softmodels.materials.memory import IDENTITY, Branch, InUfl, Memory, Six, six
from softmodels.materials.strain import Strain
from softmodels.mechanics.body import QUADRATURE_DEGREE, Body
from softmodels.mechanics.compiling import JIT
from softmodels.mechanics.mpi import largest, total

if TYPE_CHECKING:
    from dolfinx import fem
    from dolfinx.mesh import Mesh
    from ufl.core.expr import Expr

    from softmodels.mechanics.regions import MaterialRegion

SIX = len(IDENTITY)


FLOW = ("onset", "exponent", "least", "growth", "growth_exponent")


def _constants(mesh: Mesh, branch: Branch) -> types.SimpleNamespace:
    """Return what `memory.fluidity` takes of a branch, as constants for `_set`."""
    from dolfinx import fem

    spring = [tuple(fem.Constant(mesh, value) for value in term) for term in branch.spring]
    flow = types.SimpleNamespace(**{name: fem.Constant(mesh, 1.0) for name in FLOW}, spring=spring)
    _set(flow, branch)
    return flow


def _set(flow: types.SimpleNamespace, branch: Branch) -> None:
    for name in FLOW:
        getattr(flow, name).value = getattr(branch, name)
    for constants, term in zip(flow.spring, branch.spring, strict=True):
        for constant, value in zip(constants, term, strict=True):
            constant.value = value


class History:
    """History of one region.

    Args:
        body: Mesh and roles.
        region: Where, and the constants of its law.
        displacement: Skew components of the displacement, in UFL.
        before: The same where the step begins.
        step: Length of the step in s.

    Attributes:
        memory: What its silicone remembers.
        values: Of each integration point the branches' Cv, one after the other, and behind them Wm.
        density: Energy at the end of the step without that of the change of volume; its derivatives are those of the stress.
        free: Energy stored in the state where the step begins and ends, at no length of it.
    """

    def __init__(self, body: Body, region: MaterialRegion, displacement: Expr, before: Expr, step: fem.Constant):
        import basix.ufl
        from dolfinx import fem

        assert region.material.memory is not None
        self.body, self.region, self.step = body, region, step
        self.memory: Memory = region.material.memory
        mesh = body.mesh
        branches, softening = self.memory.branches, self.memory.softening
        self.size = SIX * len(branches) + (softening is not None)
        element = basix.ufl.quadrature_element(
            mesh.basix_cell(), value_shape=(self.size,), degree=QUADRATURE_DEGREE, scheme="default"
        )
        space = fem.functionspace(mesh, element)
        self.values = fem.Function(space)
        self._places = np.array(space.dofmap.list)[region.cells]
        self._starts = [0, *itertools.accumulate(SIX + 1 + bool(one.spring) for one in branches)]
        self._width = self._starts[-1] + (softening is not None)
        wider = basix.ufl.quadrature_element(
            mesh.basix_cell(), value_shape=(self._width,), degree=QUADRATURE_DEGREE, scheme="default"
        )
        self._begun = fem.Function(fem.functionspace(mesh, wider))
        self.times = fem.Constant(mesh, np.array([one.time for one in branches] or [1.0]))
        self.moduli = fem.Constant(mesh, np.zeros(max(1, len(branches))))
        self.flows = [None if one.linear else _constants(mesh, one) for one in branches]
        self.softening = types.SimpleNamespace(
            **{name: fem.Constant(mesh, 1.0) for name in ("r", "m", "beta", "recovery") if softening is not None}
        )
        self.strain, self._before = (Strain(body.deformation_gradient(u)) for u in (displacement, before))
        self._make()
        self.begin()

    def _make(self) -> None:
        """Make the energies and the expressions of a step."""
        import basix
        import ufl
        from dolfinx import fem

        law, parameters = self.region.material, self.region.parameters
        C, C0 = (six(strain.J ** (-2 / 3) * strain.C) for strain in (self.strain, self._before))
        W = law.shape(self.strain, parameters)
        density, error = W, 0.0
        spent: Expr = ufl.as_ufl(0.0)
        begin: list[Expr] = []
        after: list[Expr] = []
        for k in range(len(self.flows)):
            own = self._branch(k, C0, C)
            begin += own.begin
            after += own.after
            density, error, spent = density + own.energy, error + own.error, spent + own.lost
        hurt: Expr = ufl.as_ufl(0.0)
        if self.memory.softening is not None:
            before = Wm = self.values[self.size - 1]
            if math.isfinite(self.memory.softening.recovery):
                W0 = law.shape(self._before, parameters)
                before = W0 + (Wm - W0) * ufl.exp(-self.step / self.softening.recovery)
            begin.append(before)
            at_end = self._begun[self._width - 1]
            density += memory.softened(W, at_end, self.softening, InUfl) - W
            hurt = memory.softened(ufl.as_ufl(0.0), Wm, self.softening, InUfl)
            after.append(InUfl.below(W, at_end, at_end, W))
        stretch = [c - one for c, one in zip(C, IDENTITY, strict=True)]
        size = (1.0 + sum(self.moduli[k] for k in range(len(self.memory.branches)))) / 2
        self.density, self.free = density, self._stored(self.strain) - hurt
        self._spent, self._hurt = (
            fem.form(one * self.body.hoop * self.region.dx, jit_options=JIT) for one in (spent, hurt)
        )
        found = ufl.as_vector([*after, error, size * ufl.sqrt(memory.contracted(stretch, stretch))])
        points, _ = basix.make_quadrature(self.body.mesh.basix_cell(), QUADRATURE_DEGREE)
        self._found = fem.Expression(found, points, jit_options=JIT)
        self._begin = fem.Expression(ufl.as_vector(begin), points, jit_options=JIT)
        self._stress = fem.Expression(self._von_mises(), points, jit_options=JIT)

    def _branch(self, k: int, C0: Six, C: Six) -> types.SimpleNamespace:
        """Return what the energy of a step takes of a branch and of its beginning, the branch's Cv at the end, the error of its
        stress there, and what it dissipates in the step.

        Args:
            k: Number of the branch.
            C0, C: Cbar at the beginning and at the end.
        """
        import ufl

        flow, start = self.flows[k], self._starts[k]
        Cv, G, x = [self.values[SIX * k + i] for i in range(SIX)], self.moduli[k], self.step / self.times[k]
        rate = memory.fluidity(C0, Cv, flow, InUfl) if flow else 1.0
        H, b = memory.step_of(C0, Cv, x * rate, InUfl)
        begin = [*H, b]
        if flow and flow.spring:
            begin.append(3 * memory.growth(C0, memory.crept(C0, H, b)) - memory.step_invariant(C0, 1.0, H, b))
        H, b = [self._begun[start + i] for i in range(SIX)], self._begun[start + SIX]
        at_end = six(self.strain.C), self.strain.J, H, b
        if flow and flow.spring:
            I1 = memory.step_invariant(*at_end) + self._begun[start + SIX + 1]
            energy = memory.spring_energy(I1, flow.spring)
        else:
            energy = memory.step_energy(*at_end)
        new = memory.crept(C, H, b)
        if flow:
            better = memory.crept(C, *memory.corrected_step(C0, C, Cv, x, flow, InUfl, new))
        else:
            mean = (memory.growth(C0, Cv) + memory.growth(C, new)) / 2
            better = memory.crept(C, *memory.step_of(C0, Cv, x, InUfl, mean))
        off = [p - q for p, q in zip(memory.cofactors(new), memory.cofactors(better), strict=True)]
        error = G / 2 * ufl.sqrt(memory.contracted(off, off)) * memory.contracted(C, IDENTITY) / 3
        new = better if flow else new
        half = [(c + c0) / 2 for c, c0 in zip(C, C0, strict=True)]
        middle = memory.crept(half, *memory.step_of(C0, Cv, x * rate / 2, InUfl))
        powers = [memory.dissipated(*state, flow, InUfl) for state in ((C0, Cv), (half, middle), (C, new))]
        lost = G * x * (powers[0] + 4 * powers[1] + powers[2]) / 6  # Simpson's rule
        return types.SimpleNamespace(begin=begin, energy=G * energy, error=error, lost=lost, after=new)

    def _stored(self, strain: Strain) -> Expr:
        """Return the energy of a state where a step begins and ends, above that which softening has spent."""
        found = self.region.material.shape(strain, self.region.parameters)
        if self.memory.softening is not None:
            found = memory.softened(found, self.values[self.size - 1], self.softening, InUfl)
        C = six(strain.J ** (-2 / 3) * strain.C)
        for k, flow in enumerate(self.flows):
            spring = flow.spring if flow else ()
            found += self.moduli[k] * memory.stored(C, [self.values[SIX * k + i] for i in range(SIX)], spring)
        return found

    def _von_mises(self) -> Expr:
        """Return the von Mises stress of that state; a hydrostatic part changes nothing."""
        import ufl

        F = ufl.variable(self.strain.F)
        strain = Strain(F)
        stress = ufl.dev(ufl.diff(self._stored(strain), F) * F.T / strain.J)
        return ufl.sqrt(1.5 * ufl.inner(stress, stress))

    def take(self, material: Material, mu: float) -> None:
        """Set a material's parameters, in units of a shear modulus in Pa; the number of branches stays."""
        found = material.memory
        assert found is not None
        if found.branches:
            self.times.value = [one.time for one in found.branches]
            self.moduli.value = [one.share * material.shear_modulus_0 / mu for one in found.branches]
            for flow, one in zip(self.flows, found.branches, strict=True):
                if flow:
                    _set(flow, one)
        if found.softening is not None:
            soft = self.softening
            soft.r.value, soft.m.value, soft.beta.value = (
                found.softening.r,
                found.softening.m / mu,
                found.softening.beta,
            )
            soft.recovery.value = found.softening.recovery if math.isfinite(found.softening.recovery) else 1.0

    # -- what is remembered -------------------------------------------------------------------------------------------

    def begin(self) -> None:
        """Forget everything: at rest for ever."""
        rest = [*IDENTITY * len(self.memory.branches), *([0.0] if self.memory.softening else [])]
        self.values.x.array.reshape(-1, self.size)[:] = rest
        self._creep = 0.0
        self.prepare()

    def prepare(self) -> None:
        """Compute what the energy of a step has of its beginning, once, because the step's length or beginning has changed."""
        begun = self._begun.x.array.reshape(-1, self._width)
        if self.step.value:
            found = self._begin.eval(self.body.mesh, self.region.cells)
            begun[self._places] = found.reshape(*self._places.shape, self._width)
            return
        kept = self.values.x.array.reshape(-1, self.size)
        begun[:] = 0.0
        for k, at in enumerate(self._starts[:-1]):
            begun[:, at : at + SIX], begun[:, at + SIX] = kept[:, SIX * k : SIX * (k + 1)], memory.LEAST
        if self.memory.softening is not None:
            begun[:, -1] = kept[:, -1]

    def trial(self) -> tuple[float, float]:
        """Look at the end of the step, in the state that the functions hold.

        Returns:
            Largest error of the branches' stress in the step, and largest stress, in shear moduli, on all ranks.
        """
        mesh, comm = self.body.mesh, self.body.mesh.comm
        values = self._found.eval(mesh, self.region.cells)
        self._next = values.reshape(len(self.region.cells), -1, self.size + 2)
        error, size = (largest(comm, float(self._next[..., i].max(initial=0.0))) for i in (-2, -1))
        return error, size

    def advance(self) -> None:
        """Make the end of the step that `trial` has looked at the beginning of the next."""
        self._creep += self._integral(self._spent)
        self.values.x.array.reshape(-1, self.size)[self._places] = self._next[..., :-2]

    @property
    def dissipated(self) -> float:
        """Energy that branches and softening have dissipated until the step began, dimensionless, on all ranks."""
        return self._creep + self._integral(self._hurt)

    def _integral(self, form: fem.Form) -> float:
        from dolfinx import fem

        return total(self.body.mesh.comm, fem.assemble_scalar(form))

    def von_mises(self) -> Array:
        """Return the von Mises stress in the state where the step begins, shape (cells, points), in shear moduli."""
        return self._stress.eval(self.body.mesh, self.region.cells).reshape(len(self.region.cells), -1)

    def copied(self) -> tuple[Array, float]:
        """Return a copy of all that is remembered, for `restore`."""
        return self.values.x.array.copy(), self._creep

    def restore(self, kept: tuple[Array, float]) -> None:
        self.values.x.array[:], self._creep = kept
        self.prepare()
