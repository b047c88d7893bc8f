"""Random kills: what takes long is killed at random moments, loses nothing stored, and ends in the numbers of one left alone.

Run it with ``python tests/benchmarks/kills.py`` (50 kills over all kinds, half an hour on two cores), with ``--count`` and
``--kind`` for fewer. Of each kind one run is left alone; another is killed (SIGKILL; every third SIGTERM or SIGINT) at a random
share of the time that took, and resumed, two or three times. The page's server is killed with its job, and resumes it when it
starts again. Then every column of path.csv is compared, each number to 1e-9 of the column's largest (a run in time, whose
steps are chosen anew: each requested state to 1e-4); the numbers of a design to 1e-5, because a resumed search differs in the
seventh digit; a fit's, study's or measurement's tables, or the bodies of a mould, byte by byte. After a kill every file that is
there is whole, and no state that was stored before is missing; of a fit, a measurement and a mould complete results lie there
from the beginning, and have to stay until the new ones are whole.

Measured: 50 kills, 8 of runs in time, 7 of the page's jobs, 7 of designs, 5 of studies, 9 of measured photographs, 6 of moulds
and 8 of fits (seeds 11 and 12). No stored state was lost, and every resumed run ended in the numbers of the run left alone.

Exit status: 0 if nothing differs, else 1.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

TOLERANCE, IN_TIME, OF_SEARCH = 1e-9, 1e-4, 1e-5
FEWEST_KILLS, MOST_KILLS = 2, 3
"""Of one run before it is let through."""
WORDS = ("control",)
"""Columns that hold words."""
UNCOMPARED = ("newton_iterations",)
"""How a state was reached, not what it is."""

DISK = ("-m", "softmodels.disk", "--no-pictures", "--quiet")
SHADOW = ("--variant", "shadow", "--section", "axisymmetric")
COARSE = ("--cell-size", "6mm", "--refinement", "1")


@dataclasses.dataclass(frozen=True)
class Kind:
    """What is killed.

    Attributes:
        words: Of the command; the folder follows after ``flag``.
        flag: The option that names the folder.
        resume: Whether the command goes on with ``--resume``; else it is begun again.
        replaces: Whether the folder holds complete results from the beginning, which have to stay until new ones are whole.
        tables: Files that are compared.
        stored: Files with what is stored, a pattern in the folder; lines of them count.
        in_time: Whether only requested states are compared: steps in time depend on where a run was resumed.
    """

    words: tuple[str, ...]
    flag: str = "--output"
    resume: bool = True
    replaces: bool = False
    tables: tuple[str, ...] = ("path.csv",)
    stored: str = "path.csv"
    in_time: bool = False


CASE = """
[case.geometry]
device = "HollowDisk"
section = "axisymmetric"
cell_size = "6 mm"
refinement = 1.0
[case.material]
law = "yeoh"
c1 = "14 kPa"
c2 = "60 Pa"
[case.load]
"""
TIME = CASE.replace("case.", "").replace(
    "[load]",
    """[material.memory]
branches = [[0.15, "1 s"], [0.1, "30 s"]]
[load]
pressure_cm = "0:20"
rate = "4 cm/s"
hold = "20 s"
cycles = 2
""",
)
STUDY = f"""{CASE}pressure_cm = "0:40"
[vary]
geometry.membrane = "4:6 mm"
"""
DESIGN = f"""{CASE}pressure_cm = "0:60"
[parameters]
membrane = {{ from = "4 mm", to = "8 mm" }}
base = {{ from = "4 mm", to = "8 mm" }}
[maximise]
quantity = "rise"
of = "apex"
at = "60 cm"
[[keep]]
quantity = "mass"
at_most = "20 g"
"""
JOB = """
import asyncio, shutil, sys
from pathlib import Path
from softmodels.app.jobs import Jobs
case, _, folder = map(Path, sys.argv[1:])
async def serve():
    folder.mkdir(exist_ok=True)
    if not (folder / "case.toml").exists():
        shutil.copyfile(case, folder / "case.toml")
    jobs = Jobs(folder)
    jobs.begin()
    if not jobs.all:
        jobs.start(["softmodels", "run", "case.toml", "-o", "results"], "results", resumable=True)
    while jobs._tasks:
        await asyncio.sleep(0.02)
    sys.exit({"done": 0}.get(jobs.all[-1].state, jobs.log(jobs.all[-1])))
asyncio.run(serve())
"""
"""What the page's server does with its jobs: a case file, ``--output`` and the project's folder."""


def kinds(inputs: Path) -> dict[str, Kind]:
    """All kinds; what they read is what `make_inputs` has written."""
    measured = inputs / "demo"
    return {
        "time": Kind(("-m", "softmodels", "run", str(inputs / "time.toml"), "--no-pictures", "--quiet"), in_time=True),
        "study": Kind(("-m", "softmodels", "study", str(inputs / "study.toml"), "--jobs", "1", "--no-pictures", "--quiet"),
                      "-o", tables=(), stored="samples.jsonl"),
        "design": Kind(("-m", "softmodels", "design", str(inputs / "design.toml"), "--no-pictures", "--quiet"), "-o",
                       tables=("design.toml",), stored="iterates/*.json"),
        "mould": Kind(("-m", "softmodels", "mould", str(inputs / "mould.toml"), "--quiet"), "-o", False,
                      True, ("mould.toml", "*.stl")),
        "app": Kind(("-c", JOB, str(inputs / "app.toml")), resume=False, tables=("results/path.csv",),
                    stored="results/path.csv"),
        "section": Kind((*DISK, "--section", "axisymmetric", "--pressure-cm", "0:177:3")),
        "wedge": Kind((*DISK, *COARSE, "--pressure-cm", "0:177:40")),
        "volume": Kind((*DISK, *SHADOW, "--volume-ml", "0:60:5")),
        "limit": Kind((*DISK, *SHADOW, "--support", "base", "--shear-modulus", "20kPa", "--pressure-cm", "0,20,34,40")),
        "seminar": Kind(("-m", "softmodels.seminar", "--no-pictures", "--quiet", "--around", "6", "--cell-size", "8mm",
                         "--channels", "2", "--pressure-cm", "0,30,60")),
        "cycle": Kind((*DISK, *SHADOW, "--load-unload", "--pressure-cm", "0,20,36", "--material", "yeoh", "--c1", "10kPa",
                       "--c2", "20Pa", "--c3", "3Pa", "--poisson", "0.495")),
        "fit": Kind(("-m", "softmodels", "fit", str(inputs / "case.toml"), str(measured / "outlines"), "--material", "yeoh",
                     "--fix", "c3=0Pa", "--poisson", "0.49", "--no-pictures", "--quiet", "--untrusted"), "-o", False,
                    True, ("fitted.toml", "fit.json", "curves.csv")),
        "photographs": Kind(("-m", "measurement", "photos", str(measured / "photographs" / "photos.csv"), "--setup",
                             str(measured / "setup.toml"), "--jobs", "1", "--no-pictures", "--quiet"), "-o", False,
                            True, ("heights.csv", "IMG_0105.csv")),
    }  # fmt: skip


def write_files(folder: Path) -> None:
    """Write the small cases, study and design that are killed."""
    plain = CASE.replace("case.", "")
    texts = {"time": TIME, "study": STUDY, "design": DESIGN, "app": f'{plain}pressure_cm = "0:120:4"\n',
             "mould": '[geometry]\ndevice = "HollowDisk"\n[load]\npressure_cm = "0:20"\n'}  # fmt: skip
    for name, text in texts.items():
        more = 'sampling = "sobol"\nsamples = 8\nanswer = "path"\n' if name == "study" else ""
        (folder / f"{name}.toml").write_text(f'name = "{name}"\n{more}{text}')


def make_inputs(folder: Path) -> None:
    """Photographs, outlines and the case that they are of; `softmodels demo` in small."""
    words = ["-m", "softmodels", "demo", "--megapixels", "1", "-o", str(folder / "demo")]
    subprocess.run([sys.executable, *words], capture_output=True, check=False)
    shutil.copy(folder / "demo" / "case.toml", folder / "case.toml")


def command(kind: Kind, folder: Path, again: bool) -> list[str]:
    more = ["--resume"] if again and kind.resume else []
    return [sys.executable, *kind.words, kind.flag, str(folder), *more]


def left_alone(kind: Kind, folder: Path) -> float:
    """Run a kind to its end; the seconds it took. The status of a limit point, 3, is an end as well."""
    begun = time.monotonic()
    done = subprocess.run(command(kind, folder, False), capture_output=True, text=True, check=False)
    if done.returncode not in (0, 3):
        raise SystemExit(f"{' '.join(done.args)} ended with {done.returncode}: {done.stderr}")
    return time.monotonic() - begun


def killed(kind: Kind, folder: Path, seconds: float, states: int, how: signal.Signals, rng: random.Random, again: bool) -> bool:
    """Run a kind and kill it at a random moment; whether it had not ended before.

    Most of a run's time is its beginning, where nothing is written: three of four kills wait for a random number of states.
    """
    wanted = rng.randint(1, states) if states and rng.random() < 0.75 else 0
    moment = time.monotonic() + seconds * rng.uniform(0.02, 1.0)
    # A session of its own, so that what it starts ends with it.
    process = subprocess.Popen(
        command(kind, folder, again), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )
    while process.poll() is None and (rows_in(kind, folder) < wanted if wanted else time.monotonic() < moment):
        time.sleep(0.002)
    time.sleep(0.05 * rng.random() if wanted else 0.0)
    if process.poll() is not None:
        return False
    os.killpg(process.pid, signal.SIGKILL) if how is signal.SIGKILL else process.send_signal(how)
    process.wait(timeout=300)
    return True


def rows_in(kind: Kind, folder: Path) -> int:
    """Count what is stored in a folder: lines, of a table below its head, or files."""
    files = sorted(folder.glob(kind.stored))
    try:
        return len(files) if "*" in kind.stored else sum(map(_lines_in, files))
    except OSError:  # replaced at this moment
        return 0


def _lines_in(file: Path) -> int:
    return max(len(file.read_text().splitlines()) - (file.suffix == ".csv"), 0)


def whole(folder: Path) -> list[str]:
    """What is wrong with the files that are there: each must be whole."""
    faults = []
    for file in sorted(folder.rglob("*")):
        try:
            if file.suffix == ".csv":
                widths = {len(row) for row in csv.reader(file.read_text().splitlines()) if row and row[0][:1] != "#"}
                faults += [] if len(widths) == 1 else [f"{file.name} has rows of unlike lengths"]
            elif file.suffix == ".json":
                json.loads(file.read_text())
            elif file.suffix == ".h5" and ".softmodels" not in str(file):
                import h5py

                with h5py.File(file) as opened:
                    opened.visititems(lambda name, item: item[:1] if isinstance(item, h5py.Dataset) else None)
        except FileNotFoundError:
            continue
        except (OSError, ValueError) as error:
            faults.append(f"{file.name}: {error}")
    return faults


def differences(one: Path, other: Path, in_time: bool = False) -> dict[str, float]:
    """By column of two tables the largest difference over the column's largest number, where it is above the tolerance; in time
    of requested states only, by their pressures and what moves."""
    tables = [list(csv.DictReader(path.read_text().splitlines())) for path in (one, other)]
    if in_time:
        kept = ("time_s", "pressure_cm", "apex_mm", "added_volume_ml")
        tables = [
            [{name: row[name] for name in kept} for row in table if row["requested"] in ("1", "True")] for table in tables
        ]
    if len(tables[0]) != len(tables[1]) or tables[0][0].keys() != tables[1][0].keys():
        return {f"rows ({len(tables[0])} against {len(tables[1])})": float("inf")}
    found = {}
    for name in tables[0][0] if tables[0] else ():
        if name in UNCOMPARED:
            continue
        columns = [[row[name] for row in table] for table in tables]
        if name in WORDS:
            found[name] = float(columns[0] != columns[1])
            continue
        if [not text for text in columns[0]] != [not text for text in columns[1]]:  # empty: no value there
            found[name] = float("inf")
            continue
        numbers = [[float(text) for text in column if text] for column in columns]
        largest = max(map(abs, numbers[1]), default=0.0)
        most = max((abs(a - b) for a, b in zip(*numbers, strict=True)), default=0.0)
        found[name] = 0.0 if most == 0.0 else most / largest if largest else float("inf")
    return {name: value for name, value in found.items() if value > (IN_TIME if in_time else TOLERANCE)}


NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")


def alike(one: Path, other: Path) -> bool:
    """Whether two files are equal; of a design the words, and the numbers to the tolerance of a search."""
    if one.name != "design.toml":
        return one.read_bytes() == other.read_bytes()
    texts = [path.read_text() for path in (one, other)]
    numbers = [np.array(NUMBER.findall(text), dtype=float) for text in texts]
    words = [NUMBER.sub("", text) for text in texts]
    return words[0] == words[1] and np.allclose(*numbers, rtol=OF_SEARCH, atol=0.0)


def compare(kind: Kind, folder: Path, wanted: Path) -> list[str]:
    faults = []
    files = [file.relative_to(wanted) for table in kind.tables for file in sorted(wanted.glob(table))]
    for file in files:
        if file.name == "path.csv":
            off = differences(folder / file, wanted / file, kind.in_time)
            faults += [f"{name} {value:.1e}" for name, value in off.items()]
        elif not (folder / file).exists() or not alike(folder / file, wanted / file):
            faults.append(f"{file} differs")
    if kind.tables and not files:
        faults.append("nothing to compare")
    if (count := rows_in(kind, folder)) != (all_ := rows_in(kind, wanted)) and not kind.in_time:
        faults.append(f"{count} of {all_} stored")
    return faults


def campaign(
    chosen: Sequence[str],
    count: int,
    seed: int,
    place: Path,
    tell: Callable[[str], None] = print,
    given: Path | None = None,
) -> tuple[int, list[str]]:
    """Kill each chosen kind in turn until there were ``count`` kills.

    Args:
        chosen: Names of kinds.
        count: Kills in all.
        seed: Of kinds of signals, and of moments.
        place: An empty folder.
        tell: Takes a line on each run.
        given: What `make_inputs` has written before; None to write it.

    Returns:
        The number of kills, and a sentence on each fault.
    """
    rng = random.Random(seed)
    inputs = given or place / "inputs"
    inputs.mkdir(parents=True, exist_ok=True)
    write_files(inputs)
    if {"fit", "photographs"} & set(chosen) and not (inputs / "case.toml").exists():
        make_inputs(inputs)
    every = kinds(inputs)
    seconds = {name: left_alone(every[name], place / f"{name}-alone") for name in chosen}
    states = {name: max(rows_in(every[name], place / f"{name}-alone"), 0) for name in chosen}
    kills, faults, round_ = 0, [], 0
    while kills < count:
        for name in chosen:
            kind, folder = every[name], place / f"{name}-{round_}"
            before, again, stored = kills, False, 0
            if kind.replaces:
                shutil.copytree(place / f"{name}-alone", folder)
            for _ in range(min(rng.randint(FEWEST_KILLS, MOST_KILLS), count - kills)):
                how = rng.choice([signal.SIGKILL, signal.SIGKILL, rng.choice([signal.SIGTERM, signal.SIGINT])])
                if not killed(kind, folder, seconds[name], states[name], how, rng, again):
                    break
                kills, again = kills + 1, folder.exists()
                if (now := rows_in(kind, folder)) < stored:
                    faults.append(f"{name}: kill {kills} by {how.name} left {now} of {stored} stored")
                stored = now
                wrong = whole(folder) + (compare(kind, folder, place / f"{name}-alone") if kind.replaces else [])
                faults += [f"{name}: after kill {kills} by {how.name}: {fault}" for fault in wrong]
            done = subprocess.run(command(kind, folder, again), capture_output=True, text=True, check=False)
            wrong = [] if done.returncode in (0, 3) else [f"ended with {done.returncode}: {done.stderr.strip()[-300:]}"]
            wrong = wrong or compare(kind, folder, place / f"{name}-alone")
            faults += [f"{name}, round {round_}: {fault}" for fault in wrong]
            tell(f"{name}: {kills - before} kills, {'; '.join(wrong) or 'as if left alone'}")
            shutil.rmtree(folder, ignore_errors=True)
            if kills >= count:
                break
        round_ += 1
    return kills, faults


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    every = list(kinds(Path()))
    parser.add_argument("--count", type=int, default=50)
    parser.add_argument("--kind", action="append", choices=every)
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--inputs", type=Path, help="folder for the photographs and outlines, to use them again; else they go")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        kills, faults = campaign(
            given.kind or every,
            given.count,
            given.seed,
            Path(place),
            lambda text: print(text, flush=True),
            given.inputs,
        )
    print(f"{kills} kills, {len(faults)} faults")
    for fault in faults:
        print(f"  {fault}")
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main())
