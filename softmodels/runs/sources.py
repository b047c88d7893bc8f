"""A case solved with every other source of its silicone: the rows of their paths, on the mesh of the run."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from softmodels.case.material_errors import SourceBand
from softmodels.results.outcomes import STOPPED, RunError
from softmodels.results.row import Row
from softmodels.runs.simulation import Simulation
from softmodels.runs.step import PathEnded


def solve_sources(simulation: Simulation, mesh: Path) -> dict[str, list[Row]]:
    """Follow the path of each other source of a case's band; all ranks call it.

    Args:
        simulation: The case, prepared.
        mesh: Its mesh's file.

    Returns:
        Rows by the sources' names, on all ranks; empty where the case has no such band. A path that ends early has the rows up
        to there.

    Raises:
        RunError: It was stopped by the user.
    """
    case, band = simulation.case, simulation.case.band
    if not isinstance(band, SourceBand):
        return {}
    found: dict[str, list[Row]] = {}
    others = band.others(case.material)
    for number, (name, material) in enumerate(others.items(), 1):
        simulation.listener.say(f"solving with {name}, source {number} of {len(others)} beside the run's own")
        aside = Simulation(
            dataclasses.replace(case, material=material, band=None), simulation.comm, None, simulation.stopped
        )
        rows = found[name] = []
        try:
            aside.prepare(mesh)
            for step in aside.steps():
                rows.append(step.row)
        except PathEnded as end:
            simulation.listener.say(f"  {end}")
        except RunError as error:
            if error.status == STOPPED:
                raise
            simulation.listener.say(f"  {name} was followed no further: {error}")
        finally:
            aside.release()
    return {name: rows for name, rows in found.items() if rows}
