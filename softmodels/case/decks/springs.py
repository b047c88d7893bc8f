"""Springs of a deck: energies of one length at integration points, as `pressing` and `threads` make them.

Each begins at a node that stands still, or gives way along a line, and ends at a node of its own, whose displacements are sums
of those of a cell's or a facet's nodes. Its force is the energy's derivative by the length, in a table: nothing is lost but
what lies between entries.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from softmodels.case.decks.supports import Terms, Tie

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True, eq=False)
class Slide:
    """A line on which the springs' beginning gives way, and what holds it there.

    Attributes:
        along: Its direction, a unit vector, shape (3,).
        carried: How the beginning moves as the line is gone along, shape (3,).
        length: In m of the spring that holds it.
        ways: Ways in m, rising, shape (m,).
        forces: With which it is held then, in N, shape (m,).
    """

    along: Array
    carried: Array
    length: float
    ways: Array
    forces: Array


@dataclasses.dataclass(frozen=True, eq=False)
class Springs:
    """Springs of one part, which begin at one node and end at one node each; all these nodes are beside the mesh's.

    Attributes:
        label: The part's name.
        what: What they are and where, a clause after the name.
        ground: Where they begin, in m, shape (3,).
        ends: Where they end, in m, shape (k, 3).
        terms: Of each end what its displacements are the sums of, by component; nothing of one that is held.
        stretches: Elongations in m, rising, shape (k, m).
        forces: With which a spring pulls then, in N, shape (k, m).
        slide: Where the beginning gives way; None where it stands still.
    """

    label: str
    what: str
    ground: Array
    ends: Array
    terms: list[tuple[Terms, Terms, Terms]]
    stretches: Array
    forces: Array

    slide: Slide | None = None

    @property
    def nodes(self) -> set[int]:
        """The mesh's nodes that move the ends."""
        return {node for own in self.terms for terms in own for node, _ in terms}

    @property
    def places(self) -> Array:
        """Of its own nodes in m: the beginning, the ends, and of a slide what moves on it and what holds that, shape (k, 3)."""
        slide = [] if self.slide is None else [self.ground, self.ground - self.slide.length * self.slide.along]
        return np.vstack([self.ground, self.ends, *slide])

    def ties(self, first: int) -> list[Tie]:
        """What moves its own nodes; a displacement without terms is held.

        Args:
            first: Number of the beginning's node.
        """
        found = [Tie(first + k, i, terms) for k, own in enumerate(self.terms, 1) for i, terms in enumerate(own)]
        if self.slide is None:
            return [*found, *(Tie(first, i, {}) for i in range(3))]
        moving, along, carried = first + len(self.ends) + 1, self.slide.along, self.slide.carried
        k = int(np.abs(along).argmax())
        for i in range(3):
            found.append(Tie(first, i, {(moving, k): carried[i] / along[k]} if abs(carried[i]) > 1e-12 else {}))
            found.append(Tie(moving + 1, i, {}))
            if i != k:
                found.append(Tie(moving, i, {(moving, k): along[i] / along[k]} if abs(along[i]) > 1e-12 else {}))
        return found

    @property
    def elements(self) -> Iterator[tuple[int, int, Array, Array]]:
        """Of each spring the places of its ends among `places`, elongations in m and forces in N."""
        for k, (stretches, forces) in enumerate(zip(self.stretches, self.forces, strict=True), 1):
            yield 0, k, stretches, forces
        if self.slide is not None:
            yield len(self.ends) + 2, len(self.ends) + 1, self.slide.ways, self.slide.forces
