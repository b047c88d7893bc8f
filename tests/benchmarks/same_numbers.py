"""Twelve reference cases: do they give the same numbers as they did before?

    OMP_NUM_THREADS=1 uv run python tests/benchmarks/same_numbers.py store /tmp/before
    OMP_NUM_THREADS=1 uv run python tests/benchmarks/same_numbers.py compare /tmp/before

``store`` runs the cases of this checkout into a folder (some minutes on one core), ``compare`` runs them again and holds every
number of path.csv, fits and outlines against the stored one, to 1e-10 of the column's largest. For rebuilding: store before the
first change, compare after the last, on the same machine. Exit status 1 if one differs.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

TOLERANCE = 1e-10
RENAMED: dict[str, str] = {
    "path.csv:falling_directions": "path.csv:negative_eigenvalues",
    "path.csv:following": "path.csv:control",
}
"""Columns and keys that have another name now: old to new."""
SECTION = ("--variant", "shadow", "--section", "axisymmetric")
HARDENING = ("--material", "yeoh", "--c1", "10kPa", "--c2", "20Pa", "--c3", "3Pa", "--poisson", "0.495")
DISK, SEMINAR = ("softmodels.disk",), ("softmodels.seminar", "--around", "6", "--cell-size", "8mm", "--channels", "2")
CASES: dict[str, tuple[str, ...]] = {
    "disk": (*DISK, "--section", "axisymmetric", "--pressure-cm", "0:177"),
    "wedge": (*DISK, "--cell-size", "6mm", "--refinement", "1", "--pressure-cm", "0:177"),
    "seminar": (*SEMINAR, "--pressure-cm", "0,30,60"),
    "step": ("softmodels", "run", "examples/mypart.toml"),
    "program": ("softmodels", "run", "examples/program.toml"),
    "cycle": (*DISK, *SECTION, *HARDENING, "--pressure-cm", "0,20,36", "--load-unload"),
    "syringe": (*DISK, *SECTION, "--supply", "syringe", "--stroke-ml", "0:20", "--dead-volume", "5ml"),
    "branch": (*DISK, *SECTION, *HARDENING, "--volume-ml", "0:90:30", "--branch", "--base", "2mm", "--wall", "15mm"),
    "sheet": (*SEMINAR, "--pressure-cm", "0,30", "--sheet", "bottom", "--sheet-stiffness", "100N/m"),
    "contact": (*DISK, "--section", "axisymmetric", "--pressure-cm", "0:177", "--support", "base", "--contact", "top",
                "--contact-plane", "z = 17mm"),
    "fit": ("softmodels", "fit", "examples/disk.toml", "photographs", "--untrusted", "--material", "neo-hookean,yeoh"),
    "photographs": ("measurement", "photos", "examples/photographs/photos.csv", "--setup", "setup.toml", "--jobs", "1"),
}  # fmt: skip
"""Words after ``python -m``; run in a folder that has the examples, a setup and, by then, the cases before."""
ORDER = ("photographs", *(name for name in CASES if name != "photographs"))


def main() -> int:
    """Store or compare; see above."""
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("what", choices=("store", "compare"))
    words.add_argument("folder", type=Path)
    words.add_argument("--case", default=",".join(ORDER), help="cases, with commas")
    asked = words.parse_args()
    names = asked.case.split(",")
    if asked.what == "store":
        asked.folder.mkdir(parents=True)
        run_cases(asked.folder, names)
        return 0
    with tempfile.TemporaryDirectory() as new:
        run_cases(Path(new), names)
        worst = [compare(name, asked.folder / name, Path(new) / name) for name in names]
    return int(not max(worst) <= TOLERANCE)


def run_cases(folder: Path, names: list[str]) -> None:
    """Run cases in a folder, each into a folder of its name."""
    prepare(folder)
    for name in names:
        module, *rest = CASES[name]
        flag = "-o" if module == "measurement" or "fit" in rest else "--output"
        quiet = [] if name == "step" else ["--quiet"]
        pictures = [] if module == "measurement" else ["--no-pictures"]
        done = run(folder, module, *rest, flag, name, *quiet, *pictures)
        print(f"{name}: exit status {done.returncode}", flush=True)
        (folder / f"{name}.status").write_text(f"{done.returncode}\n{done.stderr}")


def prepare(folder: Path) -> None:
    """Write the examples and the setup of their photographs."""
    for words in (
        ("softmodels", "examples", "-o", "examples"),
        ("measurement", "setup", "examples/photographs/grid.jpg", "--grid-pitch", "9mm", "--lens", "none", "-o", "setup.toml"),
    ):  # fmt: skip
        done = run(folder, *words)
        if done.returncode:
            raise SystemExit(f"{' '.join(words)} ended with {done.returncode}: {done.stderr}")


def run(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", *words],
        cwd=folder,
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        check=False,
    )


def compare(name: str, old: Path, new: Path) -> float:
    """Print and return the largest difference between two folders' tables, in shares of each column's largest number."""
    before, after = dict(columns(old)), dict(columns(new))
    before = {RENAMED.get(key, key): values for key, values in before.items()}
    worst, where = 0.0, ""
    for key, values in before.items():
        now = after.get(key)
        if now is None or len(now) != len(values):
            worst, where = math.inf, f"{key}: {'gone' if now is None else f'{len(values)} and {len(now)} values'}"
            break
        size = max((abs(value) for value in values if math.isfinite(value)), default=0.0) or 1.0
        for a, b in zip(values, now, strict=True):
            apart = 0.0 if a == b or (math.isnan(a) and math.isnan(b)) else abs(a - b) / size
            if not apart <= worst:
                worst, where = apart, key
    added = sorted(after.keys() - before.keys())
    print(f"{name}: {len(before)} columns, largest difference {worst:.1e} {where}", f"(new: {added})" if added else "")
    return worst if before else math.inf


def columns(folder: Path) -> Iterator[tuple[str, list[float]]]:
    """All numbers of a folder's tables: each CSV by columns, a fit's JSON as one list a law."""
    for file in sorted(folder.rglob("*.csv")):
        lines = [line for line in file.read_text().splitlines() if not line.startswith("#")]
        for row in zip(*csv.reader(lines), strict=False):
            numbers = [number(text) for text in row[1:]]
            if row[0] != "iterations" and any(value is not None for value in numbers):
                yield f"{file.name}:{row[0]}", [math.nan if value is None else value for value in numbers]
    for file in sorted(folder.rglob("fit.json")):
        yield file.name, [value for value in leaves(json.loads(file.read_text())) if value is not None]


def number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def leaves(thing: object) -> Iterator[float]:
    """All numbers of a JSON document, in order."""
    if isinstance(thing, dict):
        for value in thing.values():
            yield from leaves(value)
    elif isinstance(thing, list):
        for value in thing:
            yield from leaves(value)
    elif isinstance(thing, int | float) and not isinstance(thing, bool):
        yield float(thing)


if __name__ == "__main__":
    sys.exit(main())
