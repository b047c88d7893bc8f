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
    "Stay below; if the part that snaps is no more than a cell or two, at a sharp edge that is pressed on, round the edge, or "
    "let the faces beside it meet what it is pressed on",
)
