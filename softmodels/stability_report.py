"""What the user is told about stability: sentences for the end of a run, and a table for ``summary.json``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from geometries import Actuator

Row = Mapping[str, Any]


def events(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Limit points, bifurcations and jumps of a path, in order, as ``summary.json`` lists them."""
    kinds = ("limit", "bifurcation", "jump")
    keys = ("step", "pressure_cm", "pressure_Pa", "added_volume_ml")
    return [{"kind": kind, **{key: row[key] for key in keys}} for row in rows for kind in kinds if row.get(kind)]


def unseen(actuator: Actuator) -> str:
    """What a symmetric slice cannot show, and how to see it; empty for a whole device."""
    if actuator.dimension == 2:
        return (
            "a section shows no mode that varies around the axis; --section wedge --angle 180 (or 360) shows those too"
        )
    if actuator.copies > 1:
        return f"a slice of which {actuator.copies} make the device shows only modes with its symmetry; --angle 360 shows all"
    return ""


def stability_text(rows: Sequence[Row], actuator: Actuator) -> str:
    """One or two sentences on how the last state stands and where it changed; for the closing message."""
    if not rows or "falling_directions" not in rows[-1]:
        return ""
    last, found = rows[-1], [row for row in rows if row.get("bifurcation")]
    if last["stable_under_pressure"]:
        text = "stable under pressure and under volume"
    elif last["stable_under_volume"]:
        text = "unstable under a pressure, stable under a given volume"
    else:
        count = last["falling_directions"]
        text = f"unstable: the energy falls in {count} direction{'s' if count > 1 else ''}"
    text = f"the last state is {text}"
    if found:
        at = ", ".join(f"{row['pressure_cm']:.4g} cm ({row['added_volume_ml']:.4g} ml)" for row in found)
        text += (
            f"; bifurcation{'s' if len(found) > 1 else ''} at {at}, beyond which the device leaves this shape "
            "(mode.png; --branch follows where it goes)"
        )
    hidden = unseen(actuator)
    return f"{text} ({hidden})" if hidden else text
