"""Reading the HDF5 files of a folder of results, which may come from somebody else.

HDF5 takes values from other files where a dataset is stored outside (external storage), is put together from others (virtual)
or is behind a link. None of what is read here is written so, and what is so is refused: it would show other files' bytes.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from measurement.user_file import check_file

if TYPE_CHECKING:
    import h5py
    import numpy as np
    import numpy.typing as npt

LARGEST = 1 << 50
"""Bytes of a file of results: as many as there are."""
NUMBERS = "fiu"
"""Kinds of numpy's types that fields have."""


class ForeignDataError(ValueError):
    """A file of results that refers to other files; the message goes on from its name."""


@contextlib.contextmanager
def opened(path: Path) -> Iterator[h5py.File]:
    """A file of results, open for reading.

    Raises:
        OSError: It is not a regular file, or not HDF5.
    """
    import h5py

    check_file(path, LARGEST)
    with h5py.File(path, "r") as file:
        yield file


def inside(group: h5py.Group, path: str) -> Any:
    """What lies at a path in a group: a group, or a dataset of numbers that are stored in this file.

    Raises:
        KeyError: There is nothing.
        ForeignDataError: It refers to another file.
    """
    import h5py

    place = group
    for name in filter(None, path.split("/")):
        if not isinstance(place, h5py.Group):
            raise KeyError(f"no {path}")
        if not isinstance(link := place.get(name, getlink=True), h5py.HardLink):
            raise (
                KeyError(f"no {path}") if link is None else ForeignDataError(f"{path} is a link, which is not followed")
            )
        place = place[name]
    if isinstance(place, h5py.Dataset):
        if place.external is not None or place.is_virtual:
            raise ForeignDataError(f"{path} takes its values from other files, which are not read")
        if place.dtype.kind not in NUMBERS or place.size * place.dtype.itemsize > place.id.get_storage_size():
            raise ForeignDataError(
                f"{path} is packed, or holds fewer numbers than it announces; results are stored as they are"
            )
    return place


def read_values(group: h5py.Group, path: str) -> npt.NDArray[np.generic]:
    """The numbers of a dataset; see `inside`."""
    return inside(group, path)[()]  # type: ignore[no-any-return]
