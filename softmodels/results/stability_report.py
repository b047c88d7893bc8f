"""What the user is told about stability: sentences for the end of a run, and a table for ``summary.json``."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

from geometries import Actuator
from softmodels.results.row import Row
from softmodels.results.state_words import StateWords


def events(rows: Sequence[Row], words: StateWords) -> list[dict[str, float | str]]:
    """Limit points, bifurcations and jumps of a path, in order, as ``summary.json`` lists them.

    A jump tells from where it starts too: volume and the gauge's rise before, and whether the device inflates or collapses.
    """
    kinds = ("limit", "bifurcation", "stroke_limit", "jump")
    from_keys = ("pressure_cm", "added_volume_ml", f"{words.gauge}_mm")
    keys = ("step", "pressure_cm", "pressure_Pa", *from_keys[1:])
    found: list[dict[str, float | str]] = [
        {"kind": kind, **{key: row[key] for key in keys}} for row in rows for kind in kinds if row.get(kind)
    ]
    landed = [event for event in found if event["kind"] == "jump"]
    for event, (before, after) in zip(landed, jumps(rows), strict=True):
        event["way"] = _way(before, after, words)
        event |= {f"from_{key}": before[key] for key in from_keys}
    return found


def jumps(rows: Sequence[Row]) -> list[tuple[Row, Row]]:
    """The jumps of a path: the last state that held before, and the one where the device lands."""
    over, found = set(jumped_over(rows)), []
    for k, row in enumerate(rows):
        if row.get("jump"):
            held = [i for i in range(k) if i not in over]
            found.append((rows[held[-1] if held else 0], row))
    return found


def _way(before: Row, after: Row, words: StateWords) -> str:
    moved = words.along[1]
    onwards, back = ("inflates", "collapses") if words.pressure else ("gives way", "springs back")
    return onwards if after[moved] > before[moved] else back


def jumps_text(rows: Sequence[Row], words: StateWords) -> str:
    """Load, way and heights of a path's jumps, in a sentence without its stop; empty if there is none."""
    gauge, column = words.gauge, f"{words.gauge}_mm"
    parts = []
    for before, after in jumps(rows):
        same = not words.pressure or abs(after["pressure_cm"] - before["pressure_cm"]) < 1e-6
        volume = f", added volume {before['added_volume_ml']:.4g} to {after['added_volume_ml']:.4g} ml"
        parts.append(
            f"at {words.place(before)}{'' if same else f' to {words.place(after)}'} it {_way(before, after, words)}, {gauge} "
            f"rise {before[column]:.4g} to {after[column]:.4g} mm{volume if words.volume else ''}"
        )
    return f"the device jumps: {'; '.join(parts)}" if parts else ""


def jumped_over(rows: Sequence[Row]) -> list[int]:
    """Which states of a path a supply jumps over: those that its gas does not hold, and all up to where it lands."""
    found, falling = [], False
    for k, row in enumerate(rows):
        falling = falling and not row["jump"]
        if falling or not row.get("stable_under_supply", 1):
            found.append(k)
        falling = falling or bool(row.get("stroke_limit"))
    return found


def unseen(actuator: Actuator) -> str:
    """What a symmetric slice cannot show, and how to see it; empty for a whole device."""
    if actuator.dimension == 2:
        return f"a section shows no mode that varies around the axis; {actuator.fuller} shows those too"
    if actuator.copies > 1:
        parts = f"a slice of which {actuator.copies} make the device"
        return f"{parts} shows only modes with its symmetry; {actuator.fuller} shows all"
    return ""


def unlocated(rows: Sequence[Row], words: StateWords) -> str:
    """That a bifurcation was passed and not located; empty if none was.

    The number of negative eigenvalues changes at limit points and bifurcations alone, whose own rows still have the old one;
    a cycle comes to some of them from the other side.
    """
    cyclic = any(row.get("jump") for row in rows)
    for before, after in itertools.pairwise(rows):
        told = before.get("limit") or before.get("bifurcation") or (cyclic and after.get("limit"))
        if before["negative_eigenvalues"] != after["negative_eigenvalues"] and not told:
            return (
                f"a bifurcation between {_between(before, after, words)} could not be located; "
                "more requested values around it, or a finer mesh, may show it"
            )
    return ""


def _between(before: Row, after: Row, words: StateWords) -> str:
    if words.pressure:
        return f"{before['pressure_cm']:.4g} and {after['pressure_cm']:.4g} cm"
    return f"{words.place(before)} and {words.place(after)}"


def _state(row: Row, words: StateWords) -> str:
    """Where a state lies: its load, and in brackets the volume that its cavity has taken."""
    return f"{words.place(row)} ({row['added_volume_ml']:.4g} ml)" if words.volume else words.place(row)


def stability_text(rows: Sequence[Row], actuator: Actuator, words: StateWords, branch: Sequence[Row] = ()) -> str:
    """One or two sentences on how the last state stands and where it changed; for the closing message.

    Args:
        rows: The path's rows of ``path.csv``.
        actuator: The device.
        words: What is shown of a state.
        branch: Those of the branch that was followed, if one was.
    """
    if not rows or "negative_eigenvalues" not in rows[-1]:
        return ""
    last, found = rows[-1], [row for row in rows if row.get("bifurcation")]
    load, moved = words.kept
    if last["stable_under_pressure"]:
        text = f"stable under {load} and under {moved}"
    elif last["stable_under_volume"]:
        text = f"unstable under a {load}, stable under a given {moved}"
    else:
        count = last["negative_eigenvalues"]
        text = f"unstable: the energy falls in {count} direction{'s' if count > 1 else ''}"
    text = f"the last state is {text}"
    lost = [rows[k] for k in jumped_over(rows)]
    if told := jumps_text(rows, words):
        text += f"; {told}"
    if lost:
        text += (
            f"; at {lost[0]['stroke_ml']:.4g} ml of stroke ({lost[0]['pressure_cm']:.4g} cm) the gas of this {words.driver} no "
            f"longer holds the device, which jumps over {len(lost)} of the states (stroke_limit and jump in path.csv)"
        )
    if found:
        at = ", ".join(_state(row, words) for row in found)
        text += (
            f"; bifurcation{'s' if len(found) > 1 else ''} at {at}, beyond which the device leaves this shape "
            f"(mode.png; {'branch/ has where it goes' if branch else '--branch follows where it goes'})"
        )
    elif passed := unlocated(rows, words):
        text += f"; {passed}"
    if branch:
        end = branch[-1]
        rise, held = end[f"{actuator.gauge}_mm"], "stable" if end["stable_under_volume"] else "unstable"
        text += (
            f"; the branch was followed through {len(branch)} states to {_state(end, words)}, "
            f"{actuator.gauge} rise {rise:+.4g} mm, {held} under a given {moved}"
        )
    hidden = unseen(actuator)
    return f"{text} ({hidden})" if hidden else text
