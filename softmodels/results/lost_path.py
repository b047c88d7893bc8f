"""Why a path could be followed no further, as far as it is known: sentences that name the cause and what mends it."""

from __future__ import annotations

from collections.abc import Mapping

from softmodels.case.case import Case
from softmodels.materials.stability import described, last_stretch, weakest, weakness
from softmodels.mechanics.causes import Cause
from softmodels.mechanics.sheet import locking
from softmodels.results.row import Row

NEAR = 0.95
"""Share of the stretch where a law loses its stability, or its chains are taut, from which that is what ended the path."""
SQUEEZED = 100.0
"""Shear moduli of pressure from which it is the silicone's volume that gives way, and no longer the device's shape."""
FOLDED = 0.3
"""Volume ratio at a vertex below which cells have all but folded."""


def unstable_law(case: Case, stretch: float) -> str:
    """A sentence without its full stop if the law has lost its stability at a stretch; else empty."""
    weak = weakest(case.material)
    if weak is None or stretch < NEAR * weak.stretch:
        return ""
    return (
        f"{weakness(case.material)}, and the last state has stretch {stretch:.3g}: there the silicone itself has no "
        "stable state, which no mesh and no step mends. Take a law that is stable over the stretches of this run "
        "(softmodels curve shows them; a fit over a wider range, or neo-hookean), or stay below"
    )


def known_causes(case: Case, figures: Row | Mapping[str, float], petsc: bool = False) -> list[str]:
    """What may have ended a path, the surest first; empty if nothing is conspicuous.

    Args:
        case: The case.
        figures: ``max_stretch``, ``J_min`` and ``pressure_Pa`` of the last state, ``contact_force_N`` where a plane stops
            faces, and the columns of parts.
        petsc: Whether PETSc's own options were given.
    """
    stretch = float(figures["max_stretch"])
    found = []
    if petsc:
        found.append("PETSc was given options of its own: leave them out first (what follows --)")
    if weak := unstable_law(case, stretch):
        found.append(weak)
    if stretch >= NEAR * last_stretch(case.material, "equibiaxial"):
        ends = ", ".join(f"{last_stretch(case.material, mode):.3g} ({mode})" for mode in ("uniaxial", "equibiaxial"))
        found.append(
            f"the chains of the law {described(case.material)} are taut at stretch {ends}, and the last state has "
            f"{stretch:.3g}: it can be deformed no further. Take a larger limit, or stay below"
        )
    modulus = case.material.shear_modulus_0
    if (pressure := float(figures.get("pressure_Pa") or 0.0)) > SQUEEZED * modulus:
        found.append(
            f"the pressure is {pressure / modulus:.3g} times the silicone's shear modulus: what holds or stiffens the device "
            "leaves it hardly any way to give, so that the silicone itself is squeezed. Hold less of it, or stay below"
        )
    if float(figures["J_min"]) < FOLDED:
        found.append(
            f"the smallest volume ratio (J) is {figures['J_min']:.3g}, so cells have all but folded: refine the mesh "
            "(--cell-size) or round its corners (--fillet)"
        )
    if case.obstacle is not None and figures.get("contact_force_N"):
        found.append(
            f"faces press on the contact's plane: try a --contact-stiffness below {case.obstacle.stiffness:g}, and smaller "
            "cells where they touch"
        )
    parts = (part.hindrance(case.actuator, lambda column: float(figures.get(column) or 0.0)) for part in case.parts)
    found += [sentence for sentence in parts if sentence]
    if case.sheet is not None:
        found.append(
            f"a sheet of {case.sheet.stiffness / 1e3:.4g} kN/m is bonded to {case.sheet.face}: see whether the run goes on "
            f"with a softer one (--sheet-stiffness){locking(case.sheet.stiffness, case.actuator)}"
        )
    return found


def mended(case: Case, cause: Cause, stretch: float) -> str:
    """What to do about a known end: its own advice, but where the law and not the device has become unstable."""
    weak = unstable_law(case, stretch)
    return weak[0].upper() + weak[1:] if weak else cause.advice


def advice(case: Case, figures: Row | Mapping[str, float], petsc: bool = False) -> str:
    """What is known of a lost path and what to do about it: sentences, the last without its full stop."""
    stretch, J = float(figures["max_stretch"]), float(figures["J_min"])
    if causes := known_causes(case, figures, petsc):
        return ". ".join(cause[0].upper() + cause[1:] for cause in causes)
    checked = (
        f"the law is stable at stretch {stretch:.3g} by Drucker's check and no cell has folded (smallest J {J:.3g})"
    )
    return (
        f"Nothing conspicuous was found: {checked}. If the curve was flattening, use --control auto or arc-length, which pass "
        "limit points; otherwise refine the mesh (--cell-size)"
    )
