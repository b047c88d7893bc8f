"""Figures of a suction cup that is pulled off a plane until its seal opens, on any number of ranks."""

from __future__ import annotations


def figures() -> list[float]:
    """Forces, areas and depth of its states."""
    import softmodels as sm
    from geometries import SuctionCup
    from softmodels.case.load import steps_of
    from softmodels.materials.laws import NeoHookean

    seal = sm.RigidShape("plane", "lip", at=(0.0, 0.0, 0.0), along=(0.0, 0.0, 1.0), friction=0.5, seal=True, name="plane")
    pulled = steps_of(travel_mm=(0.0, 6.0), at_pressure_cm=-30.0)
    parts = (sm.Force("top", "z", name="pull"), seal)
    run = sm.run(sm.Case("cup", SuctionCup(), NeoHookean(200e3, 0.49), components=parts, steps=pulled))
    assert run.limit is not None and "leak" in run.limit.why
    return [row[name] for row in run.rows for name in ("force_pull_N", "plane_hold_N", "plane_force_z_N", "plane_slip_mm")]
