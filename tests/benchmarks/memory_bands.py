"""Bands of creep, relaxation and loops: of tests held out of shared/data/memory, and of histories that were not fitted.

    python -m tests.benchmarks.memory_bands --data ../shared/data/memory        # VHB 4910, 5 s of a core
    python -m tests.benchmarks.memory_bands --data ... --repeats 200            # synthetic repeats as well, 1 minute

VHB 4910 at three rates, to stretch 2.5 and back: each rate predicted from the two others and the curve at equilibrium, and all
ways back from the ways up. Prints how many stresses lie in the band of the law, and in that of the law and the test's errors
(noise, cross-section and load cell). A repeat is a pull with its return and a hold, with noise; its band holds a relaxation, a
loop, and a history whose stretch creeps.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import softmodels as sm
from softmodels.common.units import HALF_WIDTH_95
from softmodels.fitting.comparison import FittedLaw
from softmodels.fitting.curves.curve import TensileCurve
from softmodels.fitting.curves.fit import fit_curves
from softmodels.fitting.curves.residuals import USUAL_ERROR, predicted, slopes_of
from softmodels.fitting.problem import USUAL_GAUGE_ERROR, FitOptions
from softmodels.materials.specimens import stress_in_time
from tests.softmodels.test_band_in_time import HOLD, LOOP, PULL

RATES = (0.01, 0.03, 0.05)
NOISE = 100.0


def measured(folder: Path, rate: float) -> TensileCurve:
    """Return the test at a rate in 1/s."""
    table = np.genfromtxt(folder / f"vhb_rate_{rate / 10:g}.csv", delimiter=",", names=True)
    stretch = table["stretch"]
    time = np.cumsum(np.abs(np.diff(stretch, prepend=1.0))) / rate
    return TensileCurve(f"{rate:g}/s", "uniaxial", stretch, 1e3 * table["nominal_stress_kPa"], time=time)


def way_up(curve: TensileCurve) -> TensileCurve:
    """Return a test until it turns back."""
    count = int(curve.stretch.argmax()) + 1
    return TensileCurve(curve.name, curve.mode, curve.stretch[:count], curve.stress[:count], time=curve.time[:count])  # type: ignore[index]


def half_widths(law: FittedLaw, curve: TensileCurve) -> np.ndarray:
    """Return half the 95 % band of a law's stress through a history in Pa, shape (n,)."""
    return HALF_WIDTH_95 * np.linalg.norm(slopes_of(law.material, curve, law.errors.names) @ law.errors.roots, axis=1)


def held(law: FittedLaw, curve: TensileCurve) -> np.ndarray:
    """Return whether each stress is in the band of the law, in that with the test's errors, and loading; shape (3, n)."""
    off, half = np.abs(predicted(law.material, curve) - curve.stress), half_widths(law, curve)
    own = HALF_WIDTH_95 * np.hypot(USUAL_ERROR.of(curve), USUAL_GAUGE_ERROR * curve.stress)
    return np.array([off <= half, off <= np.hypot(half, own), np.arange(len(off)) <= curve.stretch.argmax()])


def of_vhb(folder: Path, law: str) -> None:
    """Print the coverage of the held-out tests of VHB 4910."""
    table = np.genfromtxt(folder / "vhb_equilibrium.csv", delimiter=",", names=True)[1:]
    rest = TensileCurve("rest", "uniaxial", table["stretch"], 1e3 * table["nominal_stress_kPa"])
    tests, options = [measured(folder, rate) for rate in RATES], FitOptions(memory=True, profiles=False)
    rates = [(test, fit_curves([rest, *(o for o in tests if o is not test)], law, options).chosen) for test in tests]
    up = fit_curves([rest, *map(way_up, tests)], law, options).chosen
    parts = {f"rates held out, {law}": np.hstack([held(fit, test) for test, fit in rates])}
    returns = np.hstack([held(up, test) for test in tests])
    parts[f"ways back held out, {law}"] = returns[:, ~returns[2]]
    for name, (band, whole, loading) in parts.items():
        ways = ", ".join(
            f"{np.mean(whole[way]):.1%} {word}" for word, way in (("up", loading), ("back", ~loading)) if way.any()
        )
        both = f"{np.mean(band):.1%} in the band, {np.mean(whole):.1%} with the test's errors"
        print(f"{name}: {len(band)} stresses, {both} ({ways})")


def of_repeats(count: int) -> None:
    """Print the coverage of histories that were not fitted."""
    truth = sm.Yeoh(8e3, 90.0, 0.5, 0.5).with_memory(branches=[(0.3, 1.0), (0.2, 10.0), (0.15, 100.0)])
    random = np.random.default_rng(6)

    def test(name: str, history: tuple[np.ndarray, np.ndarray], noise: float = 0.0) -> TensileCurve:
        time, stretch = history
        stress = stress_in_time(truth, time, stretch)[0] + random.normal(0.0, noise, len(time))
        return TensileCurve(name, "uniaxial", stretch, stress, time=time)

    time = np.r_[np.linspace(0.0, 1.0, 9), 1.0 + np.geomspace(0.5, 100.0, 30)]
    ramp = np.minimum(time, 1.0)
    looks = {
        "relaxation": test("relaxation", (time, 1.0 + 0.9 * ramp)),
        "loop": test("loop", LOOP),
        "creep": test("creep", (time, 1.0 + 0.6 * ramp + 0.1 * np.log10(np.maximum(time, 1.0)))),
    }
    inside: dict[str, list[bool]] = {name: [] for name in looks}
    options = FitOptions(memory=True, profiles=False, gauge_error=0.0, stress_error=f"{NOISE:g}Pa")
    for _ in range(count):
        law = fit_curves([test("pull", PULL, NOISE), test("hold", HOLD, NOISE)], "yeoh", options).chosen
        for name, look in looks.items():
            off = np.abs(predicted(law.material, look) - look.stress)
            inside[name] += (off <= half_widths(law, look))[look.stretch != 1.0].tolist()
    for name, values in inside.items():
        print(f"{name}: {len(values)} stresses of {count} repeats, {np.mean(values):.1%} in the band")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--laws", default="gent,yeoh")
    parser.add_argument("--repeats", type=int, default=0)
    options = parser.parse_args()
    for law in options.laws.split(","):
        of_vhb(options.data, law)
    if options.repeats:
        of_repeats(options.repeats)


if __name__ == "__main__":
    main()
