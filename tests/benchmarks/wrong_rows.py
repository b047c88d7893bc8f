"""Wrong rows in lists of photographs: how many are named, how many clean series stay sound, and what heights alone are worth.

    uv run python tests/benchmarks/wrong_rows.py [--series 20] [--heights 100]

Each series is simulated with a silicone, a number of photographs and bench errors of its own, and fitted as
``softmodels fit --material yeoh --fix c3=0Pa --silicone ecoflex-00-30`` does: clean, with each of 13 kinds of wrong rows, and
with each of 5 wrong units of all pressures. A wrong one counts as refused if the fit is not sound, and as named if the reason
names its row (or a unit).

A series is estimated at half a minute of processor time, 20 of them at ten minutes (never run to their end); a fit of
heights alone takes 0.7 s. Of the first 31 repeats with five heights, 30 intervals of c1 and 30 of c2 hold the truth.
"""

from __future__ import annotations

import argparse
import collections
import dataclasses
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from geometries import HollowDisk
from measurement.outline.outline import Outline
from softmodels.fitting.comparison import FittedLaw, expected, hold_against
from softmodels.fitting.outlines.fit import try_outlines
from softmodels.fitting.outlines.residuals import (
    LEAK_ERROR,
    PRESSURE_SCALE_ERROR,
    SCALE_ERROR,
    ZERO_ERROR,
    Height,
    HeightResiduals,
    OutlineResiduals,
    check_heights,
    least_squares_of_heights,
)
from softmodels.fitting.outlines.shapes import prepare
from softmodels.fitting.problem import BENCH, FitError, LawChoice
from softmodels.materials.specimens import judge
from softmodels.mechanics.mpi import start
from tests.support.simulated import SimulatedCamera, simulated_outlines

HOLD = {"c3": {"start": 0.0, "fixed": True}}
CM = 95.1
SIZES = {
    "leak": LEAK_ERROR, "scale": SCALE_ERROR, "zero": ZERO_ERROR, "pressure_offset": 10.0,
    "pressure_scale": PRESSURE_SCALE_ERROR, "centre": 1e-3,
}  # fmt: skip

Series = list[Outline]
Damage = Callable[[Series, np.random.Generator], tuple[Series, set[str]]]


def device(cell_size: float = 0.006):
    from softmodels.fitting.outlines.device import DeviceModel
    from softmodels.mechanics.body import Body
    from softmodels.mechanics.solver import Solver
    from softmodels.mechanics.system import System

    comm = start()
    disk = HollowDisk(section="axisymmetric", cell_size=cell_size, fillet=0.0, base_fillet=0.0)
    with tempfile.TemporaryDirectory() as folder:
        body = Body.from_file(disk, disk.write(Path(folder) / "disk.msh"), comm)
    choice = LawChoice.from_text("yeoh", 0.49)
    return DeviceModel(Solver(System(body, choice.material(choice.from_modulus(30e3)))), choice)


def bench_of(rng: np.random.Generator) -> dict[str, float]:
    return {name: size * float(rng.standard_normal()) for name, size in SIZES.items()}


def clean_series(inflation, rng: np.random.Generator) -> tuple[Series, dict[str, float]]:
    """Outlines of a silicone as published curves of Ecoflex 00-30 have it, and its numbers."""
    truth = {"c1": rng.uniform(11.5e3, 14.5e3), "c2": rng.uniform(50.0, 900.0), "c3": 0.0}
    pressures = np.linspace(rng.uniform(15.0, 25.0), rng.uniform(120.0, 177.0), int(rng.integers(6, 11))) * CM
    camera = SimulatedCamera(spacing=5e-5, error=8e-6, run=8.0, pressure_error=10.0, bench=bench_of(rng))
    made = simulated_outlines(inflation, truth, pressures, camera, rng=rng)
    return [dataclasses.replace(one, source=f"{i}.jpg") for i, one in enumerate(made)], truth


# -- damages ----------------------------------------------------------------------------------------------------------


def one_row(by: Callable[[float, Series, int], float]) -> Damage:
    def damage(series: Series, rng: np.random.Generator) -> tuple[Series, set[str]]:
        i = int(rng.integers(len(series)))
        changed = dataclasses.replace(series[i], pressure=by(series[i].pressure, series, i))
        return [*series[:i], changed, *series[i + 1 :]], {series[i].source}

    return damage


def exchanged(neighbours: bool) -> Damage:
    def damage(series: Series, rng: np.random.Generator) -> tuple[Series, set[str]]:
        i = int(rng.integers(len(series) - 1))
        j = i + 1 if neighbours else int((i + 2 + rng.integers(len(series) - 3)) % len(series))
        made = list(series)
        made[i] = dataclasses.replace(series[i], pressure=series[j].pressure)
        made[j] = dataclasses.replace(series[j], pressure=series[i].pressure)
        return made, {series[i].source, series[j].source}

    return damage


def one_outline(by: Callable[[Outline], Outline]) -> Damage:
    def damage(series: Series, rng: np.random.Generator) -> tuple[Series, set[str]]:
        i = int(rng.integers(len(series)))
        return [*series[:i], by(series[i]), *series[i + 1 :]], {series[i].source}

    return damage


def same_photograph(series: Series, rng: np.random.Generator) -> tuple[Series, set[str]]:
    """A photograph is listed a second time, in place of another one's."""
    i = int(rng.integers(len(series) - 1))
    here, other = series[i], series[i + 1]
    again = dataclasses.replace(other, pressure=here.pressure, pressure_error=here.pressure_error, source=here.source)
    return [*series[:i], again, *series[i + 1 :]], {here.source}


def transposed(pressure: float) -> float:
    """The first two unequal neighbouring digits of a height in mm change places."""
    digits = list(f"{pressure / CM * 10:.0f}")
    for i in range(len(digits) - 1):
        if abs(int(digits[i]) - int(digits[i + 1])) >= 3:
            digits[i], digits[i + 1] = digits[i + 1], digits[i]
            break
    else:
        digits[0] = str(int(digits[0]) + 3)
    return float("".join(digits)) * CM / 10


ROWS: dict[str, Damage] = {
    "ten times": one_row(lambda p, *_: 10 * p),
    "a tenth": one_row(lambda p, *_: p / 10),
    "twice": one_row(lambda p, *_: 2 * p),
    "only one tube": one_row(lambda p, *_: p / 2),
    "sign": one_row(lambda p, *_: -p),
    "neighbours exchanged": exchanged(neighbours=True),
    "two exchanged": exchanged(neighbours=False),
    "30 cm more": one_row(lambda p, *_: p + 30 * CM),
    "digits transposed": one_row(lambda p, *_: transposed(p)),
    "the next row's pressure": one_row(lambda p, series, i: series[i + 1 if i + 1 < len(series) else i - 1].pressure * 1.0005),
    "one photograph twice": same_photograph,
    "outline 0.3 mm too high": one_outline(lambda o: dataclasses.replace(o, z=o.z + 3e-4)),
    "outline 8 % too large": one_outline(lambda o: dataclasses.replace(o, x=1.08 * o.x, z=1.08 * o.z)),
}
UNITS = {
    "mm listed as cm": 10.0,
    "cm listed as mm": 0.1,
    "cm listed as kPa": 10.3,
    "kPa as cm": 1 / 10.3,
    "one tube": 0.5,
}


# -- verdicts ---------------------------------------------------------------------------------------------------------


def verdict(inflation, series: Sequence[Outline]) -> tuple[bool, str, FittedLaw | None]:
    """Whether the command would write fitted.toml, the reason if not, and the fit."""
    known = expected("ecoflex-00-30")
    try:
        shapes, _ = prepare(series, inflation.system.body.actuator, inflation.silhouette.width)
        trial = try_outlines([OutlineResiduals(inflation, shapes)], BENCH, changes=HOLD)
    except FitError as error:
        return False, str(error), None
    material = inflation.material(trial.fit.values)
    judgement = hold_against(material, 1.5, known, trial.judgement)
    one = FittedLaw(inflation.choice, trial.fit, material, judge(material, 0.5), {}, judgement)
    return one.sound, "" if one.sound else one.warnings[0], one


def heights_alone(inflation, repeats: int) -> None:
    rng, truth = np.random.default_rng(7), {"c1": 14e3, "c2": 600.0, "c3": 0.0}
    for count in (5, 10):
        inside: dict[str, list[bool]] = {"c1": [], "c2": []}
        scatter: dict[str, list[bool]] = {"c1": [], "c2": []}
        for _ in range(repeats):
            camera = SimulatedCamera(spacing=5e-5, error=8e-6, run=8.0, pressure_error=10.0, bench=bench_of(rng))
            made = simulated_outlines(inflation, truth, np.linspace(18.0, 177.0, count) * CM, camera, rng=rng)
            heights = [Height(o.source, o.pressure, o.height, o.pressure_error, o.height_error) for o in made]
            found = least_squares_of_heights(
                HeightResiduals(inflation, check_heights(heights, inflation.silhouette.width)), changes=HOLD
            )
            for kept, fit in ((inside, found), (scatter, dataclasses.replace(found, shared=None))):
                for name, hits in kept.items():
                    low, high = fit.interval(name)
                    hits.append(low <= truth[name] <= high)
        told = ", ".join(f"{n} {np.mean(inside[n]):.1%} (scatter alone {np.mean(scatter[n]):.1%})" for n in inside)
        print(f"{count} heights alone, 95 % intervals that hold the truth: {told} of {repeats}")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--series", type=int, default=20)
    parser.add_argument("--heights", type=int, default=100)
    chosen = parser.parse_args()
    inflation, begin = device(), time.perf_counter()
    counts: collections.Counter[tuple[str, str]] = collections.Counter()
    held: list[bool] = []
    for seed in range(chosen.series):
        rng = np.random.default_rng(seed)
        series, truth = clean_series(inflation, rng)
        sound, reason, one = verdict(inflation, series)
        counts["clean", "sound"] += sound
        if not sound:
            print(f"  series {seed}, clean: {reason}")
        if one:
            held += [low <= truth[n] <= high for n in ("c1", "c2") for low, high in [one.interval(n)]]
        for kind, damage in ROWS.items():
            wrong, names = damage(series, rng)
            sound, reason, _ = verdict(inflation, wrong)
            counts[kind, "refused"] += not sound
            named = not sound and all(name in reason for name in names)
            counts[kind, "named"] += named
            if not named:
                print(f"  series {seed} of {len(series)}, {kind}, {', '.join(sorted(names))}: {reason or 'sound'}")
        for kind, factor in UNITS.items():
            wrong = [dataclasses.replace(o, pressure=factor * o.pressure) for o in series]
            sound, reason, _ = verdict(inflation, wrong)
            counts[kind, "refused"] += not sound
            counts[kind, "named"] += "Check the unit of the pressures" in reason and "likely" in reason
            if sound:
                print(f"  series {seed}, {kind}: sound")
        sys.stdout.flush()
    print(
        f"of {chosen.series} clean series {counts['clean', 'sound']} are sound; {np.mean(held):.1%} of intervals hold the truth"
    )
    for kind in (*ROWS, *UNITS):
        print(f"{kind:26s} refused {counts[kind, 'refused']:4d}, named {counts[kind, 'named']:4d} of {chosen.series}")
    print(f"in {time.perf_counter() - begin:.0f} s")
    sys.stdout.flush()
    if chosen.heights:
        heights_alone(inflation, chosen.heights)


if __name__ == "__main__":
    main()
