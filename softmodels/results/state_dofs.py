"""A state's dofs over the grid's nodes and back, to the last bit: what a restart needs."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.system import State
from softmodels.mechanics.tangent import Tangent
from softmodels.results.state_values import Sampling

Array = npt.NDArray[np.float64]

RAW = (("restart_state_u", "restart_state_p"), ("restart_rate_u", "restart_rate_p"))
"""Names of a state's dofs, and of the path's direction there, among a step's fields: dimensionless, for a restart alone."""


class StateDofs:
    """Takes a state's dofs apart over the grid's nodes, and makes states of such arrays again.

    Args:
        sampling: The mesh and the numbering of its nodes.
    """

    def __init__(self, sampling: Sampling):
        self._sampling, self._grid, self._eq = sampling, sampling.grid, sampling.system

    def raw(self, state: State, tangent: Tangent) -> dict[str, Array] | None:
        """Dofs of a state and of the path's direction there over the grid's nodes; on rank 0, None elsewhere.

        A path magnifies what its states differ by, three to five times in a step, as far as Newton's tolerance lets it: at a
        sharp corner a rounded last digit of a state would be 1e-6 of the largest stress after 15 steps.
        """
        found: dict[str, Array | None] = {}
        for (u, p), w in zip(RAW, (state.w, tangent.w), strict=True):
            found[u] = self._grid.collect(w[self._sampling.skew[: self._grid.owned]])
            found[p] = self._grid.collect(self._vertex_values(w))
        whole = {name: values for name, values in found.items() if values is not None}
        return whole if len(whole) == len(found) else None

    def dofs(self, u: Array | None, p: Array | None) -> Array:
        """The dofs that `raw` took apart, from its two arrays on rank 0, None elsewhere."""
        if self._sampling.pressures is None:
            return self._filled(self._grid.distribute(u), None)
        here = self._grid.distribute(p)
        return self._filled(self._grid.distribute(u), here if here.ndim == 2 else here[:, None])

    def state(self, nodal: Mapping[str, Array] | None, P: float, V: float) -> State:
        """The state that nodal fields were made of.

        Args:
            nodal: At least ``displacement`` and ``p`` on rank 0; None elsewhere.
            P: Its cavity pressure, dimensionless.
            V: Its cavity volume, dimensionless.
        """
        eq, grid = self._eq, self._grid
        u = grid.distribute(None if nodal is None else nodal["displacement"]) / eq.length_unit
        p = grid.distribute(None if nodal is None else nodal["p"])[:, None] / eq.stress_unit
        u = u if grid.dimension == 3 else u[:, [0, 2]]
        return State(self._filled(u @ eq.body.skew.T, p), P, V)

    def _filled(self, skew: Array, p: Array | None) -> Array:
        """Dofs from skew components and p at owned nodes, where one value of p may stand for those of all regions."""
        from dolfinx import fem

        function = fem.Function(self._eq.space)
        function.x.array[self._sampling.skew[: self._grid.owned]] = skew
        if self._sampling.pressures is not None and p is not None:
            at = self._sampling.pressures[: self._grid.owned]
            function.x.array[at[at >= 0]] = np.broadcast_to(p, at.shape)[at >= 0]
        function.x.scatter_forward()
        return function.x.array.copy()

    def _vertex_values(self, w: Array) -> Array:
        """The unknown p at owned nodes that have one, 0 elsewhere; one for each region where there are several."""
        if self._sampling.pressures is None:
            return np.zeros(self._grid.owned)
        at = self._sampling.pressures[: self._grid.owned]
        found = np.where(at >= 0, w[at], 0.0)
        return found if found.shape[1] > 1 else found[:, 0]
