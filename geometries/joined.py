"""What hangs together, by pairs of things that do."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Numbers = npt.NDArray[np.int64]


def joined(pairs: Numbers, count: int) -> Numbers:
    """The group of each of a number of things, of which pairs are in one group.

    SciPy's `connected_components` gives the same; loading its sparse tree takes a third of a short run's time.

    Args:
        pairs: Shape (n, 2).
        count: How many things there are.

    Returns:
        Numbers of the groups from 0, in the order of their first members, shape (count,).
    """
    label = np.arange(count)
    one, other = np.asarray(pairs, dtype=np.int64).reshape(-1, 2).T
    while (apart := label[one] != label[other]).any():
        one, other = one[apart], other[apart]
        low, high = np.sort([label[one], label[other]], axis=0)
        np.minimum.at(label, high, low)  # a group's head follows the lowest head that it is paired with
        while not np.array_equal(head := label[label], label):
            label = head
    return np.unique(label, return_inverse=True)[1]


def joined_by(shared: Numbers) -> Numbers:
    """The group of each row of a table, where rows with a value in common are in one group.

    Args:
        shared: Values, such as the nodes of edges, shape (n, k).

    Returns:
        Numbers of the groups from 0, in the order of their first rows, shape (n,).
    """
    rows, width = shared.shape
    value = np.unique(shared, return_inverse=True)[1].ravel()
    row = np.repeat(np.arange(rows), width)
    group = joined(np.column_stack([row, rows + value]), rows + int(value.max(initial=-1)) + 1)[:rows]
    return np.unique(group, return_inverse=True)[1]
