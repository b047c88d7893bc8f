"""Runs as tables of pandas and as datasets of xarray, with the unit and the name of every column."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from softmodels.common.arrays import Array
from softmodels.common.errors import required
from softmodels.runs.columns import term
from softmodels.runs.fields import OUTPUTS, OutputField, split
from softmodels.runs.store import States

if TYPE_CHECKING:
    import pandas
    import xarray

EXTRA = "notebook"
"""The extra of this project that brings both libraries."""


def _texts(states: States, column: str) -> dict[str, str]:
    """Return the unit and the name in words of a column of ``path.csv``."""
    known = term(column, states.actuator, states.words.driver)
    return {"units": split(column)[1], "long_name": known.name}


def _columns(states: States) -> dict[str, np.ndarray]:
    return {name: np.array([row[name] for row in states.rows]) for name in states.rows[0]}


def dataframe(states: States) -> pandas.DataFrame:
    """Return the rows of ``path.csv`` as a DataFrame; see `Run.to_dataframe`."""
    frame: pandas.DataFrame = required("pandas", EXTRA).DataFrame(_columns(states))
    texts = {column: _texts(states, column) for column in frame.columns}
    frame.attrs = {name: {column: text[name] for column, text in texts.items()} for name in ("units", "long_name")}
    return frame


def dataset(states: States, fields: Sequence[str]) -> xarray.Dataset:
    """Return the rows of ``path.csv``, and some nodal fields, as a Dataset over the steps; see `Run.to_xarray`."""
    library = required("xarray", EXTRA)
    columns = {name: ("step", values, _texts(states, name)) for name, values in _columns(states).items()}
    places: dict[str, object] = {"step": columns.pop("step"), "pressure": columns.pop("pressure_Pa")}
    if fields:
        words = "place of the node, undeformed"
        places |= {
            axis: ("node", states.points[:, k], {"units": "m", "long_name": f"{axis}, {words}"})
            for k, axis in enumerate("xyz")
        }
        section = " of a section: x radial, y hoop" if states.actuator.dimension == 2 else ""
        for axis in ("component", "component2"):
            places[axis] = (axis, np.array([*"xyz"]), {"long_name": f"direction in device coordinates{section}"})
        places["principal"] = (
            "principal",
            np.arange(1, 4),
            {"long_name": "number of the principal value, the largest first"},
        )
    nodal = {}
    for name in fields:
        known = OUTPUTS.get(name)
        told = (
            {"units": known.unit, "long_name": known.title} if isinstance(known, OutputField) else {"long_name": name}
        )
        values = _over_steps(states, name)
        axes = known.axes if isinstance(known, OutputField) else ("component",)
        nodal[name] = (("step", "node", *axes)[: values.ndim], values, told)
    found: xarray.Dataset = library.Dataset({**columns, **nodal}, coords=places, attrs={"case": states.case.name})
    return found


def _over_steps(states: States, name: str) -> Array:
    """Return a nodal field of all states, shape (states, n, ...); nan in states without it."""
    kept = {}
    for step in range(len(states.rows)):
        try:
            kept[step] = states.field(step, name)
        except KeyError:
            continue
    found = np.full((len(states.rows), *next(iter(kept.values())).shape), np.nan)
    for step, values in kept.items():
        found[step] = values
    return found
