"""Points of a load path, and where it ends."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.causes import Cause
from softmodels.mechanics.controls import Control, volume_control
from softmodels.mechanics.system import State
from softmodels.mechanics.tangent import Tangent
from softmodels.path.stability import Signature

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True, eq=False)
class Point:
    """One state of a path.

    Attributes:
        state: The state (dimensionless).
        tangent: Direction of the path there.
        requested: Whether this is one of the requested values.
        limit: Whether this is a limit point of the pressure.
        step: Length of the next step in units of ``line``.
        line: What the path is following here: pressure, volume or arc-length.
        factorised: Whether the factorisation that the path goes on with is that of this state (a restart has to do the same).
        age: How far that factorisation has aged here, in iterations of the linear solver.
        stiffest: Least |dV/dP| on the path so far.
        signature: Number of negative eigenvalues and the lowest eigenvalue.
        mode: At a bifurcation the shape in which the device leaves the path: local dofs, largest entry 1 or -1; else None.
        jump: Whether the device has jumped here: from the state before, or from the last turn of a supply's stroke.
        turn: Whether this is a limit point of a supply's stroke.
        worn: Whether the last linear solve took so long that the factorisation is replaced at once.
        largest: Largest of the lowest eigenvalues on the path so far, without its sign.
    """

    state: State
    tangent: Tangent
    requested: bool
    limit: bool
    step: float
    line: str
    factorised: bool
    age: int
    stiffest: float
    signature: Signature = dataclasses.field(default_factory=Signature)
    mode: Array | None = None
    jump: bool = False
    turn: bool = False
    worn: bool = False
    largest: float = 0.0

    @property
    def bifurcation(self) -> bool:
        return self.mode is not None

    @property
    def stable_under_pressure(self) -> bool:
        return self.signature.negative_eigenvalues == 0

    @property
    def stable_under_volume(self) -> bool:
        """Whether no direction that keeps the cavity's volume lowers the energy."""
        return self.stable_under(volume_control(self.state.V))

    def stable_under(self, control: Control) -> bool:
        """Whether the state is stable where pressure and volume can only move along a control's line a V + b P = d.

        What drives the air then gives way by dP = -k dV, k = a/b, and adds k q q^T to K. That takes one of the negative
        eigenvalues away where 1 + k q.K^-1 q = 1 + k dV/dP is negative, and else changes nothing (Sylvester's law again).

        Args:
            control: The line, neither a nor b negative; of a gas law its tangent at this state.
        """
        t = self.tangent
        rate = control.volume_coefficient * t.V + control.pressure_coefficient * t.P
        return self.signature.negative_eigenvalues == int(rate * t.P < 0)


class PathEnd(Exception):
    """The path cannot go on to what was requested.

    Args:
        why: A clause.
        limit: The limit point met, or None.
        cause: What happens there, where that is an end of the device's own and no limit point of what drives it.
    """

    def __init__(self, why: str, limit: Point | None = None, cause: Cause | None = None):
        super().__init__(why)
        self.limit, self.cause = limit, cause

    @property
    def physical(self) -> bool:
        """Whether the device has no state of rest beyond it, and it is not the method that has lost it."""
        return self.limit is not None or (self.cause is not None and not self.cause.of_mesh)
