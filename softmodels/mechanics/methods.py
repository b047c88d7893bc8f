"""How a device's linear systems are solved, chosen in one place: by a factorisation, or by iterations with multigrid.

A factorisation takes memory that grows faster than the model (as n^(4/3) in three dimensions), iterations what grows as it
does. Both are known before they are allocated: the first from MUMPS' analysis, the second from the matrix' entries.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

from measurement import wording
from softmodels.mechanics.factorisation import Factorisation, entries_here
from softmodels.mechanics.inverse import Inverse
from softmodels.mechanics.memory import GIGA, TooLargeError, available, needed
from softmodels.mechanics.multigrid import PER_UNKNOWN, Multigrid
from softmodels.mechanics.rigid_cycle import RigidCycle
from softmodels.mechanics.stiffest import spread

if TYPE_CHECKING:
    from softmodels.mechanics.system import System

METHODS = ("auto", "direct", "iterative")
wording.choices(METHODS)
AMPLE = 1e3
"""Bytes that are more than enough for a factorisation, times the unknowns to the power 4/3: three times what a cube's takes in
double precision (307, 297 and 295 at 15,468, 49,072 and 93,469 unknowns), and ten times a slab's. Where there is as much, it is
not looked at more closely, which takes an assembly and an analysis."""
MASS_ENTRY = 6
"""Bytes that the mass matrix, by which modes are measured, takes per entry of K: it has two fifths of these."""


@dataclasses.dataclass(frozen=True)
class Method:
    """What was chosen.

    Attributes:
        name: ``"direct"`` or ``"iterative"``.
        memory: Estimate of what it takes beside the model itself, bytes on all ranks; 0 if it was not looked at.
        why: Why it is not the other one, a clause; empty where that was not asked.
    """

    name: str
    memory: float = 0.0
    why: str = ""

    @property
    def told(self) -> str:
        """What a user wants to know of it; empty where nothing was decided."""
        if not self.memory:
            return ""
        how = "iterations with multigrid" if self.name == "iterative" else "a factorisation"
        return f"linear equations: {how}, about {self.memory / GIGA:.2g} GB" + (f" ({self.why})" if self.why else "")

    def inverse(self, system: System) -> Inverse:
        """What stands for the inverse of a system's tangent."""
        return cycle_of(system)(system) if self.name == "iterative" else Factorisation(system.K, spread(system.matter))


def cycle_of(system: System) -> type[Multigrid]:
    """The kind of cycle that a system takes."""
    return RigidCycle if system.unknowns.moving else Multigrid


def chosen(system: System, method: str) -> Method:
    """The method that is taken where this one is asked for.

    Args:
        system: What is to be solved; assembled at rest and analysed where memory could be short.
        method: One of `METHODS`.

    Raises:
        TooLargeError: The machine's memory holds neither, or not the one asked for.
        ValueError: No such method.
    """
    if method not in METHODS:
        raise ValueError(f"solver {method!r} is not one of {', '.join(METHODS)}")
    unknowns, room = system.K.getSize()[0], available(system.comm)
    if AMPLE * unknowns ** (4 / 3) < room * system.comm.size:
        return Method("direct" if method == "auto" else method)
    system.rest()
    system.assemble_tangent()
    mass = MASS_ENTRY * entries_here(system.K)
    iterative = needed(system.comm, mass + cycle_of(system).memory(system))
    fits = iterative[0] <= room
    if fits and method == "iterative":  # the analysis of a factorisation takes time and memory of its own
        return Method("iterative", iterative[1])
    usual, most = Factorisation.memory(system.K, spread(system.matter))
    beside = mass + 8 * PER_UNKNOWN * system.n  # GMRES and modes have as many vectors
    direct = needed(system.comm, beside + most)
    if direct[0] <= room and method != "iterative":
        return Method("direct", needed(system.comm, beside + usual)[1])
    if fits and method == "auto":
        told = f"about {direct[1] / GIGA:.2g} GB, where {room * system.comm.size / GIGA:.2g} GB are free"
        return Method("iterative", iterative[1], f"a factorisation would take {told}")
    least = iterative if method == "iterative" else direct
    advice = ", or --solver iterative" if fits else ""
    raise TooLargeError(
        f"the model has {unknowns} unknowns, and the solution of its equations would take about {least[1] / GIGA:.2g} GB "
        f"of memory, where {room * system.comm.size / GIGA:.2g} GB are free; use a larger --cell-size, a smaller slice of "
        f"the device{advice}"
    )
