"""The files of a folder of results beside the steps' own: the light ones, and the one HDF5 file of a run that has ended."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import h5py

from softmodels.results.reading import opened
from softmodels.results.stored_step import KEPT, RESTART, StoredStep
from softmodels.results.vtkhdf import HERE, Shapes, link_vtkhdf, write_vtkhdf
from softmodels.results.writing import replace, replace_hdf5
from softmodels.results.xdmf import xdmf


def write_light(heavy: Path, shapes: Shapes, stored: Sequence[StoredStep], gathered: bool) -> None:
    """Write ``path.csv``, the XDMF and the light VTKHDF of a run; each is replaced whole.

    Args:
        heavy: The HDF5 file with the grid.
        shapes: Of the grid.
        stored: Where each step's fields are.
        gathered: Whether they are all in that file.
    """
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, fieldnames=list(stored[0].row), lineterminator="\n")
    writer.writeheader()
    writer.writerows(step.row.cells for step in stored)
    replace(heavy.with_name("path.csv"), lambda path: path.write_text(text.getvalue()))
    light = xdmf(heavy.stem, heavy.name, shapes, stored)
    replace(heavy.with_suffix(".xdmf"), lambda path: path.write_bytes(light))

    def fill(file: h5py.File) -> None:
        if gathered:
            link_vtkhdf(file, heavy.name)
        else:
            write_vtkhdf(file, heavy.name, shapes, stored)

    replace_hdf5(heavy.with_suffix(".vtkhdf"), fill)


def write_gathered(
    path: Path, heavy: Path, shapes: Shapes, stored: Sequence[StoredStep], gathered: Sequence[StoredStep]
) -> None:
    """Write all steps into one HDF5 file with the grid.

    Args:
        path: Where to.
        heavy: The file with the grid as it is.
        shapes: Of the grid.
        stored: Where each step's fields are.
        gathered: Where they will be.
    """
    with h5py.File(path, "w") as file:
        with opened(heavy) as old:
            old.copy("mesh", file)
            file.attrs["format"] = old.attrs.get("format", 0)
        for number, (step, place) in enumerate(zip(stored, gathered, strict=True)):
            with opened(heavy.parent / step.file) as source:
                group = file.create_group(place.group)
                part = source[step.group] if step.group else source
                kept = number >= len(stored) - KEPT
                for name in part:
                    if kept or not name.startswith(RESTART):
                        part.copy(name, group)
                for key, value in part.attrs.items():
                    group.attrs[key] = value
        write_vtkhdf(file, HERE, shapes, gathered)
