"""Ends of a path that are the device's own, beside limit points of what drives it: there is no state of rest beyond them."""

from __future__ import annotations

from softmodels.mechanics.causes import Cause

EMPTIED = Cause(
    "a cavity is pressed empty, so that its walls would pass through each other",
    "Take less of the load, a stiffer silicone or thicker walls, or let the cavity's walls rest on each other ([walls] with "
    "faces = 'cavity')",
)
LOCKED = Cause(
    "what is asked to change cannot, whatever the pressure or force: what is held leaves the device no way to give",
    "Hold less of it; a cavity in incompressible silicone (poisson = 0.5) that is held all around keeps its volume, and "
    "takes a pressure alone",
)
SNAPPED = Cause(
    "the device snaps: the pressures and forces have a limit point, and the volumes and travels that they work on turn back "
    "there too, so that neither can be raised further",
    "Stay below, or leave out what turns it over",
)


def folded(cells: float, place: str, at: str) -> Cause:
    """The end of a path at which nothing but a cell or a few of them turn over.

    Args:
        cells: How many take part in it.
        place: Undeformed place of the one that moves most, with its unit.
        at: What it is at, a clause that begins with a comma; empty inside.
    """
    few = "one cell" if cells < 1.5 else f"{cells:.0f} cells"
    return Cause(
        f"{few} of the mesh would fold at {place} of the undeformed device{at}, and what is asked for turns back with that: a "
        "fold of the mesh at a sharp edge, and no limit of the device",
        "Round that edge (--fillet, --rounding or --clamp-rounding, as the device has it), let the faces beside it meet what "
        "they are pressed on, or take larger cells there (--cell-size, fewer cells --through); the states up to here are not "
        "affected",
        of_mesh=True,
    )
