"""The free parameters of a design, with their bounds."""

from __future__ import annotations

import dataclasses
import itertools
import re
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from geometries import Actuator, GeometryError
from geometries.fields import about
from geometries.parameters import changed, parameter, parameter_names
from measurement.units import brief
from measurement.wording import known_are
from softmodels.design.errors import DesignError
from softmodels.design.units import read, shown_unit, text

Array = npt.NDArray[np.float64]
MOST_CORNERS = 6
"""With more parameters only the corners next to the first and the last are looked at, for there are 2^n."""


@dataclasses.dataclass(frozen=True)
class Free:
    """A parameter that the design may change.

    Attributes:
        name: Such as ``"membrane"`` or ``"profile[2]"``.
        low, high: Bounds, SI units (angles in degrees).
        start: Its value in the device as given.
        unit: SI unit in Pint's spelling; empty for pure numbers.
    """

    name: str
    low: float
    high: float
    start: float
    unit: str

    @property
    def width(self) -> float:
        return self.high - self.low

    def text(self, value: float, digits: int = 4) -> str:
        return text(value, shown_unit(self.unit) or "1", self.unit or "1", digits)


def unit_of(device: Actuator, name: str) -> str:
    """SI unit of a continuous parameter; a list's entries are pure numbers unless their kind says so."""
    kind = about(device)[name.partition("[")[0]].kind
    return kind.unit or str(getattr(getattr(kind, "of", None), "unit", ""))


def expanded(device: Actuator, name: str) -> list[str]:
    """Names of the continuous parameters that a name stands for: itself, or all entries of a list.

    Raises:
        DesignError: The device has none of this name.
    """
    known = parameter_names(device)
    if name in known:
        return [name]
    entries = [one for one in known if re.fullmatch(rf"{re.escape(name)}\[\d+\]", one)]
    if entries:
        return entries
    stems = list(dict.fromkeys(one.partition("[")[0] for one in known))
    base = name.partition("[")[0]
    if base in about(device) and base not in stems:
        raise DesignError(f"{name} does not decide the shape of this {type(device).__name__}; {known_are(name, stems)}")
    if name != base and base in stems:
        count = sum(one.startswith(f"{base}[") for one in known)
        entries_text = f"has {count} entries, counted from 1" if count else "is no list"
        raise DesignError(f"parameter {name!r} is not there: {base} {entries_text}")
    raise DesignError(f"{type(device).__name__} has no parameter {name!r}; {known_are(name, stems)}")


def free_parameters(device: Actuator, table: Mapping[str, object], bare: bool = True) -> tuple[Free, ...]:
    """The free parameters of a device.

    Args:
        device: As given.
        table: By name the two bounds: a pair, or a table with ``from`` and ``to``.
        bare: Whether numbers are taken for SI units.

    Raises:
        DesignError: Names or bounds that cannot be meant.
    """
    if not table:
        example = '[parameters] membrane = { from = "1 mm", to = "3 mm" }'
        raise DesignError(f"no parameter is free; name some with their bounds, such as {example}")
    found: dict[str, Free] = {}
    for name, bounds in sorted(
        table.items(), key=lambda item: "[" in item[0]
    ):  # an entry of its own comes after its list
        low, high = _bounds(name, bounds)
        for one in expanded(device, name):
            unit = unit_of(device, one)
            least, most = (read(f"{one} {what}", end, unit, bare) for what, end in (("from", low), ("to", high)))
            found[one] = Free(one, least, most, parameter(device, one), unit)
    order = {name: place for place, name in enumerate(parameter_names(device))}
    free = tuple(sorted(found.values(), key=lambda one: order[one.name]))
    for parameter_ in free:
        _check(device, parameter_)
    return free


def _bounds(name: str, bounds: object) -> tuple[object, object]:
    if isinstance(bounds, Mapping):
        for key in bounds:
            if key not in ("from", "to"):
                raise DesignError(f"parameter {name} has an unknown entry {key!r}; a parameter has from and to")
        for key, what in (("from", "lower"), ("to", "upper")):
            if key not in bounds:
                raise DesignError(
                    f"parameter {name} has no {what} bound; give both, as {name} = {{ from = ..., to = ... }}"
                )
        return bounds["from"], bounds["to"]
    if isinstance(bounds, Sequence) and not isinstance(bounds, str) and len(bounds) == 2:
        return bounds[0], bounds[1]
    raise DesignError(
        f"parameter {name} has no bounds ({brief(bounds)}); give both, as {name} = {{ from = ..., to = ... }}"
    )


def _check(device: Actuator, one: Free) -> None:
    """Refuse bounds that cannot be, one parameter by itself."""
    if one.low > one.high:
        raise DesignError(f"the bounds of {one.name} are reversed: from {one.text(one.low)} to {one.text(one.high)}")
    if one.low == one.high:
        raise DesignError(f"both bounds of {one.name} are {one.text(one.low)}; leave it out, so that it stays as it is")
    if not one.low <= one.start <= one.high:
        raise DesignError(
            f"{one.name} starts at {one.text(one.start)}, outside of its bounds, {one.text(one.low)} to {one.text(one.high)}"
        )
    movable = device.movable
    if one.name not in movable and one.name.partition("[")[0] not in movable:
        known = f"it follows {', '.join(movable)}" if movable else "it follows none"
        raise DesignError(f"the mesh of this {type(device).__name__} cannot follow {one.name}; {known}")
    for end, what in ((one.low, "lower"), (one.high, "upper")):
        try:
            changed(device, {one.name: end})
        except GeometryError as error:
            raise DesignError(
                f"{one.name} cannot be at its {what} bound, {one.text(end)}, even with all else as it is: {error}"
            ) from None


def crossed_corners(device: Actuator, free: Sequence[Free]) -> str:
    """A sentence if some combination of bounds makes no device; empty if all that were looked at do."""
    if len(free) <= MOST_CORNERS:
        corners = [list(ends) for ends in itertools.product(*((one.low, one.high) for one in free))]
    else:
        lows, highs = [one.low for one in free], [one.high for one in free]
        corners = [lows, highs]
        for k in range(len(free)):
            corners += [[*lows[:k], highs[k], *lows[k + 1 :]], [*highs[:k], lows[k], *highs[k + 1 :]]]
    refused = []
    for corner in corners:
        try:
            changed(device, {one.name: end for one, end in zip(free, corner, strict=True)})
        except GeometryError as error:
            refused.append((corner, str(error)))
    if not refused:
        return ""
    corner, why = refused[0]
    where = ", ".join(f"{one.name} {one.text(end)}" for one, end in zip(free, corner, strict=True))
    return (
        f"{len(refused)} of {len(corners)} combinations of bounds make no device (such as {where}: {why}); the search steps "
        "back from them"
    )
