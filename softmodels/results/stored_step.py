"""Where one step of a run is on disk."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Protocol

from softmodels.results.reading import inside
from softmodels.results.row import Row

if TYPE_CHECKING:
    import h5py

    from softmodels.results.restart import Restart

RESTART = "restart"
"""What of a step is for a restart alone: its attribute, and the beginning of its fields' names."""
KEPT = 8
"""Steps at the end of a gathered run that keep what a restart needs: it is gone on with from there."""
ROW = "row"


@dataclasses.dataclass(frozen=True)
class StoredStep:
    """Where one step's fields are, and what else is known of it.

    Attributes:
        file: HDF5 file, relative to the folder of results.
        group: Its group in there.
        row: Its row of ``path.csv``.
        restart: What a `Point` needs to be made again, beside its fields.
        shapes: Shapes of its nodal fields by name, (n,) or (n, 3), but for those that are for a restart alone.
    """

    file: str
    group: str
    row: Row
    restart: Restart
    shapes: Mapping[str, tuple[int, ...]]


class Shaped(Protocol):
    """An array, or a dataset of a file."""

    @property
    def shape(self) -> tuple[int, ...]: ...


def shapes_of(fields: Mapping[str, Shaped]) -> dict[str, tuple[int, ...]]:
    """Shapes of nodal fields or of datasets, sorted by name, without those for a restart alone."""
    return {name: fields[name].shape for name in sorted(fields) if not name.startswith(RESTART)}


def read_step(group: h5py.Group, file: str, path: str) -> StoredStep:
    """A step as a group of an HDF5 file has it; the file is named relative to the folder of results.

    Raises:
        ForeignDataError: One of its fields is not in this file.
    """
    fields = {name: inside(group, name) for name in group}
    return StoredStep(
        file, path, Row(json.loads(group.attrs[ROW])), json.loads(group.attrs[RESTART]), shapes_of(fields)
    )
