"""Springs of a deck: energies of one length at integration points, as `pressing` and `threads` make them.

Each begins at a node that stands still and ends at a node of its own, whose displacements are sums of those of a cell's or
a facet's nodes. Its force is the energy's derivative by the length, in a table: nothing is lost but what lies between entries.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from softmodels.case.decks.supports import Terms, Tie

Array = npt.NDArray[np.float64]


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
    """

    label: str
    what: str
    ground: Array
    ends: Array
    terms: list[tuple[Terms, Terms, Terms]]
    stretches: Array
    forces: Array

    @property
    def nodes(self) -> set[int]:
        """The mesh's nodes that move the ends."""
        return {node for own in self.terms for terms in own for node, _ in terms}

    def ties(self, first: int) -> list[Tie]:
        """What moves the ends; one without terms is held.

        Args:
            first: Number of the first end's node.
        """
        return [Tie(first + k, i, terms) for k, own in enumerate(self.terms) for i, terms in enumerate(own)]
