"""Searches of designs against scans of their parameter: fibre angles, chambers in contact, and even stress.

    uv run python tests/benchmarks/design_scans.py [twist] [elongation] [finger] [even]

Each line has the best of a scan (15 values, refined between the best three), that of the search, and how much it missed.
"""

from __future__ import annotations

import sys

import numpy as np
from scipy.optimize import minimize_scalar

import softmodels as sm
from geometries import Cylinder, HollowDisk, PneuNet
from softmodels.components.fibres import Fibres
from softmodels.design.model import DesignModel
from softmodels.mechanics.mpi import start

VALUES = 15
LAW = sm.NeoHookean(30e3, 0.49)


def compare(name: str, problem: sm.DesignProblem) -> None:
    """Print the best of a scan over the only parameter, and that of the search."""
    (free,), sign, asked = problem.free, problem.sign, problem.terms[0].quantity
    model = DesignModel(problem.case, (free.name,), (asked,), start())

    def value(theta: float) -> float:
        return sign * model.evaluate(np.array([theta])).values[asked.key]

    places = np.linspace(free.low, free.high, VALUES)
    k = int(np.argmin([value(place) for place in places]))
    ends = places[max(k - 1, 0)], places[min(k + 1, len(places) - 1)]
    found = minimize_scalar(value, bounds=ends, method="bounded", options={"xatol": 1e-4 * free.width})
    scanned = min((found.fun, found.x), *((value(end), end) for end in ends))
    shown = model.meshed.design.system
    contact = {
        key: one
        for term in shown.potential.terms.values()
        for key, one in term.figures(shown).items()
        if key.endswith("_contact_N")
    }
    model.release()
    result = sm.optimise(problem)
    best = sign * result.best.values[asked.key]
    missed = (best - scanned[0]) / abs(scanned[0])
    print(
        f"{name}: scan {sign * scanned[0]:.5g} at {scanned[1]:.5g}, search {sign * best:.5g} at {result.best.theta[0]:.5g} in "
        f"{len(result.trials)} designs, {missed:.3%} missed; fresh mesh {result.values[asked.key]:.5g} {contact}",
        flush=True,
    )


def twist() -> None:
    """The angle of one helix of fibres for the largest twist of a tube."""
    tube = Cylinder(section="whole", length=0.020, cell_size=0.006)
    case = sm.Case("twist", tube, LAW, pressures_cm=(32.0,), components=(Fibres(angle=30.0, modulus=3e5, helices=1),))
    asked = {"quantity": "figure", "of": "twist_deg", "at": "3 kPa"}
    compare("twist, deg", sm.DesignProblem(case, {"fibres.angle": (10.0, 80.0)}, minimise=asked))


def elongation() -> None:
    """The angle of two helices that go slack for the largest elongation of a tube."""
    tube = Cylinder(length=0.020, cell_size=0.003)
    case = sm.Case("long", tube, LAW, pressures_cm=(32.0,), components=(Fibres(angle=50.0, modulus=3e5),))
    asked = {"quantity": "figure", "of": "elongation_percent", "at": "3 kPa"}
    compare("elongation, %", sm.DesignProblem(case, {"fibres.angle": (40.0, 90.0)}, maximise=asked))


def finger() -> None:
    """The base of a finger whose chambers press on each other at 30 kPa, for the largest bend."""
    device = PneuNet(
        chambers=2, chamber_length=0.004, cell_size=0.006, gap=0.0003, wall=0.0012, base=0.002, least_wall=0.0001
    )
    case = sm.Case("finger", device, sm.NeoHookean(150e3, 0.49), pressures_cm=(320.0,))
    asked = {"quantity": "figure", "of": "bend_angle_deg", "at": "30 kPa"}
    compare("bend, deg", sm.DesignProblem(case, {"base": (0.0008, 0.004)}, maximise=asked))


def even() -> None:
    """The profile of a disk's membrane for even stress, at a given mass."""
    disk = HollowDisk(section="axisymmetric", profile=(1.0, 1.0, 1.0, 1.0))
    case = sm.Case("even", disk, LAW, pressures_cm=(150.0,))
    for quantity in ("stress_unevenness", "stress_deviation", "von_mises_norm"):
        problem = sm.DesignProblem(
            case,
            {"profile": (0.6, 1.7)},
            minimise={"quantity": quantity, "at": "150 cm", "above": "10 mm", "within": "10 mm"},
            keep=[{"quantity": "mass", "at_most": 20.5e-3}, {"quantity": "rise", "at": "150 cm", "at_least": 0.003}],
        )
        result = sm.optimise(problem)
        print(quantity, result.headline, [f"{x:.3f}" for x in result.best.theta], flush=True)


if __name__ == "__main__":
    for name in sys.argv[1:] or ("twist", "elongation", "finger", "even"):
        globals()[name]()
