"""Searches of designs against scans of their parameters: fibre angles, a tube's wall, contact, friction, and even stress.

    uv run python tests/benchmarks/design_scans.py [twist] [elongation] [cylinder] [finger] [rod] [even]

Each line has the best of a scan (15 values of each parameter, then twice as many between the neighbours of the best), that
of the search, and how much it missed.
"""

from __future__ import annotations

import itertools
import sys

import numpy as np
import numpy.typing as npt

import softmodels as sm
from geometries import Cylinder, HollowDisk, PneuNet
from softmodels.case.load import steps_of
from softmodels.components.contact import RigidShape
from softmodels.components.fibres import Fibres
from softmodels.design.model import DesignModel
from softmodels.mechanics.mpi import start

VALUES = 15
LAW = sm.NeoHookean(30e3, 0.49)


def compare(name: str, problem: sm.DesignProblem, values: int = VALUES, rounds: int = 3) -> None:
    """Print the best of a scan over all parameters, again and again around its best within a cell, and that of the search."""
    sign, asked = problem.sign, problem.terms[0].quantity
    model = DesignModel(problem.case, problem.names, problem.quantities, start())
    lows, widths = np.array([one.low for one in problem.free]), np.array([one.width for one in problem.free])
    known: dict[bytes, float] = {}

    def value(x: npt.NDArray[np.float64]) -> float:
        if (key := x.round(9).tobytes()) not in known:
            found = model.evaluate(lows + x * widths).values
            kept = all(
                (keep.at_least is None or found[keep.quantity.key] >= keep.at_least)
                and (keep.at_most is None or found[keep.quantity.key] <= keep.at_most)
                for keep in problem.limits
            )
            known[key] = sign * found[asked.key] if kept else np.inf
        return known[key]

    middle, reach = np.full(len(lows), 0.5), 0.5
    for _ in range(rounds):
        axes = [np.unique(np.clip(np.linspace(x - reach, x + reach, values), 0.0, 1.0)) for x in middle]
        middle = min((np.array(x) for x in itertools.product(*axes)), key=value)
        reach *= 2.0 / (values - 1)
    scanned, at = value(middle), lows + middle * widths
    shown = model.meshed.design.system
    contact = {
        key: one
        for term in shown.potential.terms.values()
        for key, one in term.figures(shown).items()
        if key.endswith(("_contact_N", "_sliding"))
    }
    model.release()
    result = sm.optimise(problem)
    best = sign * result.best.values[asked.key]
    missed = (best - scanned) / abs(scanned)
    print(
        f"{name}: scan {sign * scanned:.5g} at {' '.join(f'{x:.5g}' for x in at)} of {len(known)}, search {sign * best:.5g} at "
        f"{' '.join(f'{x:.5g}' for x in result.best.theta)} in {len(result.trials)} designs, {missed:.3%} missed; fresh mesh "
        f"{result.values[asked.key]:.5g} {contact}",
        flush=True,
    )


def twist() -> None:
    """The angle of one helix of fibres for the largest twist of a tube."""
    tube = Cylinder(section="whole", length=0.020, cell_size=0.006)
    case = sm.Case(
        "twist",
        tube,
        LAW,
        steps=steps_of(pressure_cm=(32.0,)),
        components=(Fibres(angle=30.0, modulus=3e5, helices=1),),
    )
    asked = {"quantity": "figure", "of": "twist_deg", "at": "3 kPa"}
    compare("twist, deg", sm.DesignProblem(case, {"fibres.angle": (10.0, 80.0)}, minimise=asked))


def elongation() -> None:
    """The angle of two helices that go slack for the largest elongation of a tube."""
    tube = Cylinder(length=0.020, cell_size=0.003)
    case = sm.Case("long", tube, LAW, steps=steps_of(pressure_cm=(32.0,)), components=(Fibres(angle=50.0, modulus=3e5),))
    asked = {"quantity": "figure", "of": "elongation_percent", "at": "3 kPa"}
    compare("elongation, %", sm.DesignProblem(case, {"fibres.angle": (40.0, 90.0)}, maximise=asked))


def cylinder() -> None:
    """Wall and angle of two helices for the largest elongation of a tube whose stress is limited (`problems/wound.toml`)."""
    tube = Cylinder(length=0.040, wall=0.003)
    thread = Fibres(angle=50.0, modulus=100e3, name="thread")
    case = sm.Case("wound", tube, LAW, steps=steps_of(pressure_cm=(110.0,)), components=(thread,))
    asked = {"quantity": "figure", "of": "elongation_percent", "at": "10 kPa"}
    limit = {"quantity": "von_mises_norm", "at": "10 kPa", "at_most": 20e3}
    bounds = {"wall": (0.002, 0.004), "fibres.thread.angle": (30.0, 85.0)}
    compare("elongation, %", sm.DesignProblem(case, bounds, maximise=asked, keep=[limit]))


def finger() -> None:
    """The base of a finger whose chambers press on each other at 30 kPa, for the largest bend."""
    device = PneuNet(chambers=2, chamber_length=0.004, cell_size=0.006, gap=0.0003, wall=0.0012, base=0.002, least_wall=0.0001)
    case = sm.Case("finger", device, sm.NeoHookean(150e3, 0.49), steps=steps_of(pressure_cm=(320.0,)))
    asked = {"quantity": "figure", "of": "bend_angle_deg", "at": "30 kPa"}
    compare("bend, deg", sm.DesignProblem(case, {"base": (0.0008, 0.004)}, maximise=asked))


def rod() -> None:
    """Where a rod with friction stands under a finger that presses on it most."""
    device = PneuNet(chambers=2, cell_size=0.006)
    place = (device.length - 0.004, 0.0, -0.5 * device.base - 0.0065)
    shape = RigidShape("cylinder", "bottom", place, 0.006, (0.0, 1.0, 0.0), friction=0.5, name="rod")
    case = sm.Case("rod", device, sm.silicone("ecoflex-00-30"), steps=steps_of(pressure_cm=(15.0,)), components=(shape,))
    asked = {"quantity": "force_on", "of": "rod", "along": "-z", "at": "1.2 kPa"}
    bounds = {"contact.rod.x": (0.6 * device.length, device.length)}
    compare("force on a rod with friction, N", sm.DesignProblem(case, bounds, maximise=asked), 9)


def even() -> None:
    """The profile of a disk's membrane for even stress, at a given mass."""
    disk = HollowDisk(section="axisymmetric", profile=(1.0, 1.0, 1.0, 1.0))
    case = sm.Case("even", disk, LAW, steps=steps_of(pressure_cm=(150.0,)))
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
    for name in sys.argv[1:] or ("twist", "elongation", "cylinder", "finger", "rod", "even"):
        globals()[name]()
