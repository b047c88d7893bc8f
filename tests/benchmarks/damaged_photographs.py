"""Damaged photographs: how many are measured wrongly and trusted all the same.

    OMP_NUM_THREADS=1 uv run python tests/benchmarks/damaged_photographs.py --count 1000
    OMP_NUM_THREADS=1 uv run python tests/benchmarks/damaged_photographs.py --count 200 --kind "second lamp,dent" --list

Random benches (`tests/support/photographs/damaged_run.py`), random damages of random size and
place (`tests/support/photographs/damages.py`), the same for the same seed. A photograph is wrong if it is trusted and its apex,
or more than 2 % of its outline, lies off by more than 25 um and more than three times what is stated, or if more than 1 mm of
outline is missing. A photograph takes about 0.8 s of one core.

Found on 1,019 of `--seed 20`: 313 right, 309 refused, 397 untrusted, none wrong; all 133 good ones were right and trusted.
With lamps and cameras of all kinds (`--seed 61`, stopped after 108): 35 right, 18 refused, 54 untrusted, one wrong: a body
tilted by 0.15 degrees in one photograph, of which 3 % lay up to 29 um off; measured again it is right, as 32 um
are stated now. Since the first campaign gaps of four to six points
in an edge are smoothed over like shorter ones; these 1,019 were not repeated with it.
Seven were wrong when the campaign was first run: two drops of water that moved the edge smoothly by 59 and 110 um, a body
moved by 0.16 mm in three photographs in which its own sinking made up for it, a fibre of 30 um flat on the membrane (26 um),
and one out of focus by 9 px (37 um), whose edge the grid's lines drew to themselves.

Left out, because nothing in the pictures tells them: the body along the light where its sides are not in the picture,
and bulges of the screen smaller than 0.45 of the grid's pitch, which lie between its lines.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import os
import time
from collections.abc import Iterator

import cv2

from measurement.screen.grid import GridError
from tests.support.photographs.bench import Bench
from tests.support.photographs.damaged_run import Run
from tests.support.photographs.damages import KINDS
from tests.support.photographs.verdict import Verdict

OUTCOMES = ("right", "refused", "untrusted", "wrong")


def main() -> int:
    """Try them, print each wrong one and the table; exit status 1 if there is a wrong one."""
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("--count", type=int, default=1000, help="damaged photographs")
    words.add_argument("--seed", type=int, default=0, help="first bench")
    words.add_argument("--kind", default=",".join(KINDS), help="kinds of damage, with commas")
    words.add_argument("--tries", type=int, default=1, help="damages of each kind on each bench")
    words.add_argument("--list", action="store_true", help="print every photograph")
    asked = words.parse_args()
    cv2.setNumThreads(1)
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    verdicts: list[Verdict] = []
    started, number, without = time.monotonic(), asked.seed, 0
    with contextlib.suppress(KeyboardInterrupt):  # Ctrl-C ends it with what it has
        while sum(verdict.kind != "none" for verdict in verdicts) < asked.count:
            try:
                run = Run(Bench.random(number, mixed=True))
            except GridError as error:
                without += 1
                print(f"bench {number}  has no setup: {error}", flush=True)
                run = None
            number += 1
            for verdict in bench(run, asked.kind.split(","), asked.tries) if run is not None else ():
                verdicts.append(verdict)
                if asked.list or verdict.outcome == "wrong" or (verdict.kind == "none" and verdict.outcome != "right"):
                    print(described(verdict), flush=True)
    table(verdicts)
    print(f"{number - asked.seed} benches, {without} of them without a setup, in {time.monotonic() - started:.0f} s")
    return int(any(verdict.outcome == "wrong" for verdict in verdicts))


def bench(run: Run, kinds: list[str], tries: int) -> Iterator[Verdict]:
    """All damages on one bench."""
    yield from run.good_ones()
    for kind in kinds:
        for seed in range(tries):
            yield from run.damaged(kind, seed)


def described(one: Verdict) -> str:
    """A verdict in a line."""
    return f"bench {one.seed}  {one.kind} ({one.what})  {one.height * 1e3:.2f} mm  {one.outcome}: {one.why}"


def table(verdicts: list[Verdict]) -> None:
    """Print a row per kind in Markdown."""
    rows: dict[str, collections.Counter[str]] = {}
    for one in verdicts:
        rows.setdefault(one.kind, collections.Counter()).update([one.outcome, "harmless" if one.harmless else "harmful"])
    total = collections.Counter[str]()
    print(f"| kind | photographs | {' | '.join(OUTCOMES)} | untrusted, though right |\n|---|{'---|' * 6}")
    for kind, row in rows.items():
        count = sum(row[outcome] for outcome in OUTCOMES)
        needless = sum(one.kind == kind and one.harmless and one.outcome == "untrusted" for one in verdicts)
        print(f"| {kind} | {count} | {' | '.join(str(row[outcome]) for outcome in OUTCOMES)} | {needless} |")
        if kind != "none":
            total += collections.Counter({**{name: row[name] for name in OUTCOMES}, "needless": needless})
    counts = [str(total[outcome]) for outcome in OUTCOMES]
    print(f"| all damaged | {sum(total[name] for name in OUTCOMES)} | {' | '.join(counts)} | {total['needless']} |")


if __name__ == "__main__":
    raise SystemExit(main())
