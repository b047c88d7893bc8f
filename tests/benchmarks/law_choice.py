"""The choice of a law on every measured curve, sampled three ways and weighted three ways: is the verdict the same?

Each curve's smooth course is written with 37,512 readings, each with the noise that the curve has, and with 375 and 93 of
them, and fitted with all laws by the command ``fit`` under three models of the stress error. A verdict that changes with
sampling or weighting is a fault, and so is a preferred law whose misfit is three times another's. Treloar's and Meunier's
three tests are fitted jointly as they are.

    uv run python tests/benchmarks/law_choice.py                          # half an hour on one core
    uv run python tests/benchmarks/law_choice.py --only Ecoflex --range 1.02:3

Exit status 1 if any case is at fault: a verdict close to its border may turn with the noise of 93 readings.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy.interpolate import PchipInterpolator

from softmodels.fit_command import fit_material
from softmodels.tensile import TensileCurve, TensileError, read_curve
from softmodels.tensile_fit import noise
from softmodels.thinning import thinned

DATA = next(
    (found for folder in Path(__file__).resolve().parents if (found := folder / "shared" / "data").is_dir()),
    Path("none"),
)
"""The measured curves, in a folder ``shared`` beside the project or above it."""
READINGS = (37512, 375, 93)
ERRORS = ("auto", "constant", "2%+0.5kPa")
RANGES = ("", "1.02:3")
LAWS = "neo-hookean,mooney-rivlin,yeoh,ogden1,ogden2,ogden3,gent"
MOST = 3.0
SMOOTH = 30
"""Steps of stretch whose averages a smooth course goes through."""


def raw(curve: TensileCurve) -> tuple[np.ndarray, np.ndarray]:
    """A curve as a fast clock would have written it: its smooth course, and at each reading the noise that it has."""
    size = max(noise(curve), 1e-3 * float(np.abs(curve.stress).max()))
    smooth = thinned(curve, SMOOTH)
    through = np.unique(smooth.stretch, return_index=True)[1]
    course = PchipInterpolator(smooth.stretch[through], smooth.stress[through])
    stretch = np.linspace(smooth.stretch[0], smooth.stretch[-1], READINGS[0])
    return stretch, course(stretch) + np.random.default_rng(0).normal(0.0, size, READINGS[0])


def write(stretch: np.ndarray, stress: np.ndarray, count: int, path: Path) -> None:
    """Write ``count`` of the readings, equally far from each other."""
    kept = np.linspace(0, len(stretch) - 1, count).astype(int)
    rows = [f"{a:.9g},{b:.9g}" for a, b in zip(stretch[kept], stress[kept], strict=True)]
    path.write_text("\n".join(["stretch,stress (Pa)", *rows]) + "\n")


def verdict(tests: list[str], error: str, laws: str, folder: Path) -> tuple[str, float, float]:
    """The chosen law, its misfit over the least of all laws' (rms, each test counting the same), and the seconds it took."""
    folder = Path(tempfile.mkdtemp(dir=folder))  # of its own: no verdict may be an earlier fit's
    words = [word for test in tests for word in ("--tensile", test)]
    words += [
        "--material",
        laws,
        "--stress-error",
        error,
        "--no-profiles",
        "--no-pictures",
        "--quiet",
        "-o",
        str(folder),
    ]
    started = time.monotonic()
    with contextlib.suppress(SystemExit), contextlib.redirect_stderr(io.StringIO()):
        fit_material.main(words, standalone_mode=True)
    seconds = time.monotonic() - started
    told = json.loads((folder / "fit.json").read_text())
    misfit = {law["law"]: [group["rms"] for group in law["residuals"].values()] for law in told["laws"]}
    least = np.min(list(misfit.values()), axis=0)
    size = {law: float(np.sqrt(np.mean((np.array(rms) / least) ** 2))) for law, rms in misfit.items()}
    return told["preferred"], size[told["preferred"]] / min(size.values()), seconds


def one(label: str, many: list[tuple[str, list[str]]], laws: str, folder: Path) -> bool:
    """Judge one curve, or joint tests, in all ways; print a line. Returns whether it is at fault."""
    found = {(name, error): verdict(tests, error, laws, folder) for name, tests in many for error in ERRORS}
    laws_found = {law for law, _, _ in found.values()}
    worst = max(ratio for _, ratio, _ in found.values())
    slowest = max(seconds for _, _, seconds in found.values())
    fault = len(laws_found) > 1 or worst >= MOST
    print(
        f"{'FAULT' if fault else 'ok   '} {label:40s} {'/'.join(sorted(laws_found)):24s} misfit at most {worst:.2f} times the "
        f"least, {slowest:.1f} s"
    )
    if len(laws_found) > 1:
        print("      " + "; ".join(f"{n} {e}: {v[0]}" for (n, e), v in found.items()))
    sys.stdout.flush()
    return fault


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--only", default="", help="curves whose name has this in it")
    options.add_argument("--range", dest="ranges", action="append", help="stretches, such as 1.02:3; empty for all")
    options.add_argument("--laws", default=LAWS)
    told = options.parse_args()
    files = [*sorted((DATA / "silicone_tensile").glob("*.csv")), *sorted((DATA / "ecoflex_uniaxial").glob("*.csv"))]
    if not files:
        print("there are no measured curves: no folder shared/data beside the project")
        return 2
    faults = count = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file in files:
            for text in told.ranges or RANGES:
                if told.only not in file.name:
                    continue
                try:
                    curve = read_curve(file)
                    curve = curve.within(*map(float, text.split(":"))) if text else curve
                except TensileError as error:
                    print(f"      {file.stem}: {error}")
                    continue
                many = []
                readings_of = raw(curve)
                for readings in READINGS:
                    path = folder / f"{file.stem}-{readings}.csv"
                    write(*readings_of, readings, path)
                    many.append((str(readings), [str(path)]))
                count += 1
                faults += one(f"{file.stem} {text}", many, told.laws, folder)
        for rubber in ("Treloar_1944", "Meunier_2008"):
            if told.only in rubber:
                tests = [f"{DATA}/rubber/{rubber}_{key}.csv:{key}" for key in ("UT", "PS", "ET")]
                count += 1
                faults += one(f"{rubber}, three tests", [("as it is", tests)], told.laws, folder)
    print(f"{faults} of {count} at fault")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
