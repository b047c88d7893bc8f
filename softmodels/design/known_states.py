"""States of one design as guesses for the next one, or for another mesh."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from softmodels.design.bifurcations import Bifurcation
    from softmodels.design.loads import Load
    from softmodels.design.transfer import Transfer
    from softmodels.mechanics.system import State
    from softmodels.mechanics.tangent import Tangent

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True, eq=False)
class LimitPoint:
    """A limit point of the pressure: the state, and the path's direction there, which is K's null vector."""

    state: State
    tangent: Tangent


@dataclasses.dataclass(frozen=True, eq=False)
class Known:
    """States of one design, as guesses for the next: values, which nothing changes.

    Attributes:
        rest: Volume of its undeformed cavity.
        states: By load.
        limit: Its limit point, if there is one.
        witness: The state at the highest pressure, where there is none up to it.
        bifurcation: Its first bifurcation, if there is one.
    """

    rest: float
    states: dict[Load, State]
    limit: LimitPoint | None
    witness: State | None
    bifurcation: Bifurcation | None

    def ahead(self, before: Known, share: float) -> Known:
        """What lies ahead on the straight line from an earlier design's states through these, by a share of their distance."""

        def state(here: State, there: State) -> State:
            w = here.w + share * (here.w - there.w)
            P, V = here.P + share * (here.P - there.P), here.V + share * (here.V - there.V)
            return dataclasses.replace(here, w=w, P=P, V=V)

        limit, witness = self.limit, self.witness
        if limit is not None and before.limit is not None:
            limit = LimitPoint(state(limit.state, before.limit.state), limit.tangent)
        if witness is not None and before.witness is not None:
            witness = state(witness, before.witness)
        states = {load: state(here, before.states[load]) for load, here in self.states.items()}
        return Known(self.rest + share * (self.rest - before.rest), states, limit, witness, self.bifurcation)

    def transferred(self, transfer: Transfer) -> Known:
        """The same on another mesh of the same device."""

        def state(known: State) -> State:
            return dataclasses.replace(known, w=transfer.dofs(known.w), V=transfer.volume(known.V, self.rest))

        limit, witness, fork = self.limit, self.witness, self.bifurcation
        if fork is not None:
            modes = tuple(transfer.dofs(mode) for mode in fork.modes)
            V = transfer.volume(fork.V, self.rest)
            fork = dataclasses.replace(fork, V=V, states=tuple(map(state, fork.states)), modes=modes)
        return Known(
            transfer.rest, {load: state(known) for load, known in self.states.items()},
            None if limit is None else LimitPoint(state(limit.state), limit.tangent),
            None if witness is None else state(witness), fork,
        )  # fmt: skip
