"""Balloons that cannot be: checked by name and value before the mesher starts."""

from __future__ import annotations

from typing import TYPE_CHECKING

from geometries.errors import GeometryError
from geometries.fields import LONGEST, shown

if TYPE_CHECKING:
    from geometries.balloon import Balloon

FLATTEST = 0.2
"""Smallest ratio of the polar to the equatorial radius, and of that to this."""

THINNEST = 2e-3
"""Smallest thickness of a wall in radii: the cells of thinner ones become needles."""

NEEDLE = 20.0
"""Largest ratio of a cell's length to its width through the wall."""

WIDEST = 0.8
"""Largest outer radius of the neck in outer radii of the balloon."""

LONGEST_NECK = 20.0
"""Longest neck in radii."""


def check_balloon(balloon: Balloon) -> None:
    """Check a balloon's parameters against each other.

    Raises:
        GeometryError: The first parameter found impossible, with its value and the limit.
    """
    _check_wall(balloon)
    if balloon.neck_radius:
        _check_neck(balloon)
        _check_fillet(balloon)
        _check_rod(balloon)
    else:
        _check_closed(balloon)
    balloon.check_cells()


def _check_wall(balloon: Balloon) -> None:
    radius, polar, wall = balloon.radius, balloon.polar_radius or balloon.radius, balloon.wall
    if not FLATTEST <= polar / radius <= 1.0 / FLATTEST:
        raise GeometryError(
            f"polar_radius is {shown(polar, 'm')}; it must lie between {FLATTEST:g} and {1 / FLATTEST:g} times radius, "
            f"{shown(radius, 'm')}"
        )
    if max(radius, polar) + wall > LONGEST:
        raise GeometryError(f"radius is {shown(radius, 'm')}; with its wall it passes {LONGEST:g} m, a mistaken unit")
    for name in ("wall", "neck_wall"):
        value = getattr(balloon, name)
        if not value:
            continue
        if value > radius:
            raise GeometryError(f"{name} is {shown(value, 'm')}; it must not pass radius, {shown(radius, 'm')}")
        if value < THINNEST * radius:
            raise GeometryError(
                f"{name} is {shown(value, 'm')}; it must be at least {THINNEST:g} of radius, {shown(radius, 'm')}"
            )
    longest = min(NEEDLE * balloon.thinnest / max(balloon.through, 1.0), min(radius, polar))
    if balloon.cell_size > longest:
        raise GeometryError(
            f"cell_size is {shown(balloon.cell_size, 'm')}; it must not pass {shown(longest, 'm')}: {NEEDLE:g} times a cell's "
            "width through the wall, and the balloon's radii"
        )


def _check_neck(balloon: Balloon) -> None:
    outside, most = balloon.neck_radius + (balloon.neck_wall or balloon.wall), balloon.radius + balloon.wall
    if outside > WIDEST * most or balloon.neck_radius > WIDEST * balloon.radius:
        raise GeometryError(
            f"neck_radius is {shown(balloon.neck_radius, 'm')}; with its wall it must not pass {WIDEST:g} of the balloon's, "
            f"{shown(WIDEST * balloon.radius, 'm')} inside and {shown(WIDEST * most, 'm')} outside"
        )
    if balloon.neck_length > LONGEST_NECK * balloon.radius:
        raise GeometryError(
            f"neck_length is {shown(balloon.neck_length, 'm')}; more than {LONGEST_NECK:g} times radius, "
            f"{shown(balloon.radius, 'm')}, looks like a mistaken unit"
        )
    if balloon.meridian.joint[1] <= 0.1 * balloon.neck_length:
        raise GeometryError(
            f"neck_wall is {shown(balloon.neck_wall or balloon.wall, 'm')}; so thick a wall leaves no neck_length, "
            f"{shown(balloon.neck_length, 'm')}, inside"
        )


def _check_fillet(balloon: Balloon) -> None:
    if not balloon.fillet:
        return
    if balloon.fillet > balloon.radius:
        raise GeometryError(
            f"fillet is {shown(balloon.fillet, 'm')}; it must not pass radius, {shown(balloon.radius, 'm')}"
        )
    level = balloon.meridian.rounding(balloon.fillet).foot[1]
    least = 0.1 * balloon.neck_length
    if level < least or level > balloon.meridian.joint[1] - 1e-3 * balloon.wall:
        raise GeometryError(
            f"fillet is {shown(balloon.fillet, 'm')}; with neck_length {shown(balloon.neck_length, 'm')} it begins at the "
            f"height {shown(abs(level), 'm')}{' below the end' if level < 0 else ''}: it must leave {shown(least, 'm')} of the "
            f"neck and begin below where the neck opens inside, {shown(balloon.meridian.joint[1], 'm')}"
        )


def _check_rod(balloon: Balloon) -> None:
    if balloon.rod_radius > 0.95 * balloon.neck_radius:
        raise GeometryError(
            f"rod_radius is {shown(balloon.rod_radius, 'm')}; air has to pass between it and the neck: at most 0.95 times "
            f"neck_radius, {shown(balloon.neck_radius, 'm')}"
        )


def _check_closed(balloon: Balloon) -> None:
    if balloon.rod_radius:
        raise GeometryError(f"rod_radius is {shown(balloon.rod_radius, 'm')}; a rod needs a neck, and neck_radius is 0")
    if balloon.held == "outside":
        raise GeometryError("held is 'outside'; that is of a neck, and neck_radius is 0")
    if balloon.dimension == 3 and 360.0 / balloon.angle < 2.5:
        raise GeometryError(
            f"angle is {shown(balloon.angle, 'degree')}; without a neck the balloon could slide away sideways: use 120 deg or "
            "less"
        )
