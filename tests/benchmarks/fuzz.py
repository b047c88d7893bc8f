"""Random inputs to every command: each has to end in a result or in a sentence with the right status.

Five kinds: options, case files, material files, lists of photographs, setups (`fuzz_inputs`). A command is right if it ends
with status 0, 1, 2 or 3, without a traceback, with a sentence where the status is not 0, within 20 s of work, and if it
leaves all files as they were but for those in the folder it was given. Valid sections are solved, one in three of them;
fits, limits and solid devices are read and checked, and end there.

    uv run python tests/benchmarks/fuzz.py --count 2000 --seed 1

prints a line for each fault and a table; ``--kind`` takes one kind alone, and a campaign never takes more than 8 GB. Measured
with seed 1, 400 inputs of each kind in two campaigns: no traceback, no hang, no file touched.
Hypothesis makes the inputs; the same seed makes the same ones.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import dataclasses
import faulthandler
import hashlib
import io
import os
import resource
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any
from unittest import mock

import cv2
import numpy as np
from hypothesis import HealthCheck, Phase, given, seed as seeded, settings

from tests.benchmarks import fuzz_inputs as inputs

LONGEST = 20.0
"""Seconds of its own work after which a command hangs; other programs on the machine do not count."""
LONGEST_WAIT = 300.0
"""Seconds by the clock after which the whole campaign is given up, with the place where it hangs."""
MOST_MEMORY = 8 << 30
"""Bytes that the whole campaign may take at a time."""
MOST_CELLS, MOST_STEPS, SOLVED = 1500, 12, 3
"""Sections of at most so many cells and values are solved, and of those one in so many."""


@dataclasses.dataclass(frozen=True)
class Outcome:
    """How an attempt ended.

    Attributes:
        kind: Of input.
        attempt: What was tried.
        status: Exit status; None after a traceback or a hang.
        fault: What was wrong, or empty.
        told: The last words on standard error.
        seconds: Time taken.
    """

    kind: str
    attempt: inputs.Attempt
    status: int | None
    fault: str
    told: str
    seconds: float


class Hang(BaseException):
    """A command that took longer than `LONGEST`."""


class Bench:
    """Runs attempts in this process.

    Args:
        folder: An empty folder for the attempts.
        watch: Whether to end what hangs; only in a main thread.
        measure: Whether the photographs show something that takes its time to be measured; else they are blank.
    """

    def __init__(self, folder: Path, watch: bool = False, measure: bool = True):
        self.folder, self.watch, self.runs, self.number = folder, watch, 0, 0
        from geometries.__main__ import main as geometries
        from measurement.__main__ import main as measurement
        from softmodels.__main__ import softmodels
        from softmodels.disk import command as disk
        from softmodels.seminar import command as seminar

        self.programs = {"geometries": geometries, "measurement": measurement, "softmodels": softmodels, "disk": disk,
                         "seminar": seminar}  # fmt: skip
        self.pictures = _pictures(measure)
        self.setup = self._setup(() if measure else ("--scale", "10px/mm"))

    def _setup(self, more: tuple[str, ...]) -> str:
        words = ("setup", "grid.jpg", "--lens", "none", *more, "-o", "out/setup.toml")
        done = self.tried("options", inputs.Attempt("measurement", words, self.pictures))
        assert not done.fault and done.status == 0, done
        return (self.folder / "out" / "setup.toml").read_text()

    def strategy(self, kind: str) -> Any:
        """Attempts of one kind."""
        if kind == "options":
            rows = "".join(f"{1 + k / 20},{k * 600}\n" for k in range(1, 30))
            files = {"pull.csv": f"stretch,stress (Pa)\n1,0\n{rows}".encode(), "setup.toml": self.setup.encode(),
                     "photos.csv": b"file,pressure\nrest.jpg,0 cm\nsecond.jpg,10 cm\n", **self.pictures}  # fmt: skip
            commands = {}
            for start in inputs.STARTS:
                command = self.programs[start[0]]
                commands[start] = command.get_command(None, start[1]) if len(start) > 1 else command
            return inputs.options(commands, files)
        return {
            "case": inputs.cases, "material": inputs.materials,
            "photos": lambda: inputs.photos(self.setup, self.pictures),
            "setup": lambda: inputs.setups(self.setup, self.pictures),
        }[kind]()  # fmt: skip

    def tried(self, kind: str, attempt: inputs.Attempt) -> Outcome:
        """Carry out an attempt."""
        for path in sorted(self.folder.rglob("*"), reverse=True):
            path.rmdir() if path.is_dir() and not path.is_symlink() else path.unlink()
        (self.folder / "out").mkdir()
        for name, content in attempt.files.items():
            (self.folder / name).write_bytes(content)
        before, began = _digests(self.folder), time.monotonic()
        out, err = io.StringIO(), io.StringIO()
        status, fault = None, ""
        self.number += 1
        with _inside(self.folder), self._shortened(), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            try:
                with self._watched():
                    status = self._status(attempt)
            except Hang:
                fault = f"hangs for {LONGEST:g} s"
            except Exception:
                fault = f"traceback: {traceback.format_exc()}"
        told = err.getvalue().strip()
        if not fault:
            fault = _judged(status, told)
        if not fault and _digests(self.folder) != before:
            fault = "files of the user were touched"
        return Outcome(kind, attempt, status, fault, told[-300:], time.monotonic() - began)

    def _status(self, attempt: inputs.Attempt) -> int:
        from softmodels.cli.ending import main
        from softmodels.common.commands import run_command

        command, words = self.programs[attempt.program], list(attempt.words)
        try:
            with mock.patch.object(sys, "argv", [attempt.program, *words]):
                if attempt.program in ("measurement", "geometries"):
                    run_command(command, attempt.program)
                else:
                    main(command)
        except SystemExit as end:
            return int(end.code or 0)
        return 0

    @contextlib.contextmanager
    def _shortened(self) -> Iterator[None]:
        """Read and check everything, solve some small sections, and fit and mesh nothing large."""
        import softmodels.cli.run

        solve = softmodels.cli.run.run

        def run(case: Any, folder: Path, *how: Any) -> int:
            small = case.actuator.dimension == 2 and _cells(case.actuator) < MOST_CELLS
            if not small or len(case.values) > MOST_STEPS or getattr(case.values[-1], "number", 0.0) > 50.0:
                return 0
            self.runs += 1
            return solve(case, folder, *how) if self.runs % SOLVED == 0 else 0

        def accepted(*_: Any, **__: Any) -> None:
            raise SystemExit(0)

        def write(actuator: Any, path: Path, *rest: Any) -> Any:
            return wrote(actuator, path, *rest) if _cells(actuator) < 10 * MOST_CELLS else accepted()

        from geometries.actuator import Actuator

        wrote = Actuator.write
        with (
            mock.patch("softmodels.cli.run.run", run), mock.patch("softmodels.runs.analyses.find_limit", accepted),
            mock.patch("softmodels.cli.material_commands.fit_curves", accepted),
            mock.patch("softmodels.cli.material_commands.fit", accepted),
            mock.patch("softmodels.fitting.outlines.fit.fit_heights", accepted),
            mock.patch.object(Actuator, "write", write),
        ):  # fmt: skip
            yield

    @contextlib.contextmanager
    def _watched(self) -> Iterator[None]:
        if not self.watch:
            yield
            return

        def end(number: int, frame: Any) -> None:
            raise Hang

        before = signal.signal(signal.SIGPROF, end)
        faulthandler.dump_traceback_later(LONGEST_WAIT, exit=True, file=sys.__stderr__)  # compiled code that hears nothing
        signal.setitimer(signal.ITIMER_PROF, LONGEST, 1.0)
        try:
            yield
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            faulthandler.cancel_dump_traceback_later()
            signal.signal(signal.SIGPROF, before)


def _cells(actuator: Any) -> float:
    return float(actuator.expected_cells)


def _pictures(measure: bool) -> dict[str, bytes]:
    """Small photographs of the bench: its grid, a body at rest, an inflated one."""
    from measurement.photographer import Scene, dome, photograph, save

    if not measure:
        blank = cv2.imencode(".jpg", np.full((60, 80, 3), 180, np.uint8))[1].tobytes()
        return {"grid.jpg": blank, "rest.jpg": blank, "second.jpg": blank}
    scene = Scene(width=700, height=467, focal_px=1400.0, pixel_size=60e-6)
    shadows = {"grid.jpg": None, "rest.jpg": dome(1e-9, floor=-0.003), "second.jpg": dome(0.005, floor=-0.003)}
    with tempfile.TemporaryDirectory() as folder:
        for name, shadow in shadows.items():
            save(Path(folder) / name, photograph(scene, shadow, seed=1)[0])
        return {name: (Path(folder) / name).read_bytes() for name in shadows}


def _digests(folder: Path) -> dict[str, str]:
    """Digests of all files but those in the folder that the command was given."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else "folder"
        for path in folder.rglob("*")
        if path.relative_to(folder).parts[0] != "out"
    }


def _judged(status: int | None, told: str) -> str:
    """What is wrong with how a command ended; empty if nothing is."""
    if status not in (0, 1, 2, 3):
        return f"status {status}"
    if "Traceback" in told:
        return "traceback on standard error"
    last = told.splitlines()[-1] if told else ""
    if status and len(last.split()) < 5:
        return f"status {status} without a sentence"
    return "a sentence without end" if len(last) > 2000 else ""


@contextlib.contextmanager
def _inside(folder: Path) -> Iterator[None]:
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def campaign(
    bench: Bench,
    count: int,
    seed: int,
    tell: Callable[[Outcome], Any] = lambda outcome: None,
    kinds: Sequence[str] = inputs.KINDS,
) -> list[Outcome]:
    """Try ``count`` inputs, as many of each kind."""
    found: list[Outcome] = []
    for kind in kinds:
        found += _of_kind(bench, kind, count // len(kinds), seed, tell)
    return found


def _summary(kind: str, mine: Sequence[Outcome]) -> str:
    ends = collections.Counter(outcome.status for outcome in mine)
    faults, longest = sum(map(bool, (o.fault for o in mine))), max(o.seconds for o in mine)
    return f"{kind:9s} {len(mine):5d} inputs, {faults} faults, longest {longest:.1f} s, by status {dict(ends)}"


def _of_kind(bench: Bench, kind: str, count: int, seed: int, tell: Callable[[Outcome], Any]) -> list[Outcome]:
    found: list[Outcome] = []
    quiet = settings(max_examples=count, database=None, deadline=None, phases=[Phase.generate],
                     suppress_health_check=list(HealthCheck))  # fmt: skip

    @seeded(f"{seed} {kind}")
    @quiet
    @given(bench.strategy(kind))
    def every(attempt: inputs.Attempt) -> None:
        found.append(bench.tried(kind, attempt))
        tell(found[-1])

    every()
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--blank", action="store_true", help="blank photographs, refused at once: a third of the time")
    parser.add_argument("--kind", action="append", choices=inputs.KINDS, help="of these alone, in this order")
    chosen = parser.parse_args()
    # More is a fault with a place, and no other program on the machine is ended for it.
    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))

    def tell(outcome: Outcome) -> None:
        if outcome.fault:
            attempt = outcome.attempt
            print(f"FAULT {outcome.kind}: {attempt.program} {' '.join(attempt.words)[:300]}", flush=True)
            print(f"  {outcome.fault[-1500:]}\n  {outcome.told}", flush=True)
            for name, content in attempt.files.items():
                if not name.endswith(".jpg"):
                    print(f"  {name}: {content[:600]!r}", flush=True)

    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(Path(folder), watch=True, measure=not chosen.blank)
        kinds, found = chosen.kind or inputs.KINDS, []
        for kind in kinds:
            mine = campaign(bench, chosen.count // len(kinds), chosen.seed, tell, (kind,))
            print(_summary(kind, mine), flush=True)
            found += mine
        solved = bench.runs // SOLVED
    print(f"{len(found)} inputs, {sum(bool(outcome.fault) for outcome in found)} faults; {solved} sections solved")


if __name__ == "__main__":
    main()
