"""Arrays that a caller may read and not change: what a result hands out is the result's own."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def read_only[Kind: np.generic](array: npt.NDArray[Kind]) -> npt.NDArray[Kind]:
    """Return a view that refuses to be written to; ``array.copy()`` is the caller's own."""
    view = array.view()
    view.flags.writeable = False
    return view


def keep_arrays(value: object, *, copy: bool = False) -> None:
    """Make every array that an object holds read-only, at the end of its making.

    Args:
        value: The object, of a frozen dataclass too.
        copy: Copy them first: they are the caller's, who may change them later.
    """
    for name, array in list(vars(value).items()):
        if isinstance(array, np.ndarray):
            object.__setattr__(value, name, read_only(array.copy() if copy else array))
