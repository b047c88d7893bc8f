"""What all terms have in common whose faces are pressed on, by each other or by a wall that stands still."""

from __future__ import annotations

import abc
from typing import TYPE_CHECKING, Protocol

from softmodels.mechanics.assembled import AssembledTerm
from softmodels.mechanics.walls.surface import Array

if TYPE_CHECKING:
    import scipy

SOON = 0.2
"""Gap below which nodes are coupled in the matrix's pattern before they touch, in what a kind calls near: for walls the
kernel's radius."""


class Pressing(Protocol):
    """Faces in one shape, pressed on: energy, its derivatives by the nodes' places, and which nodes are coupled."""

    @property
    def energy(self) -> float: ...
    @property
    def forces(self) -> Array: ...
    @property
    def stiffness(self) -> scipy.sparse.csr_array: ...
    def coupled(self, soon: float) -> scipy.sparse.csr_array: ...


class PressingTerm[P: Pressing](AssembledTerm):
    """The energy of faces that are pressed on; a kind says by what."""

    _pressed: P

    @abc.abstractmethod
    def pressed(self, places: Array) -> P:
        """The faces with their nodes at places, shape (n, d)."""

    def move(self, places: Array) -> None:
        self._pressed = self.pressed(places)

    def energy_here(self) -> float:
        return self._pressed.energy

    def forces_here(self) -> Array:
        return self._pressed.forces

    def stiffness_here(self) -> scipy.sparse.csr_array:
        return self._pressed.stiffness

    def coupled(self) -> scipy.sparse.csr_array:
        return self._pressed.coupled(SOON)
