"""What a user waits for around the solver: commands of this tree and of another one, alternating, as ratios.

    git worktree add --detach /tmp/before COMMIT && (cd /tmp/before && uv sync)
    uv run python tests/benchmarks/waiting.py /tmp/before --repeat 5

Both trees need an environment of their own (``.venv``). Each command is run once in each to warm the caches, and then in turn.
CPU seconds are of the command and its processes together, and tell the same on a busy machine; what overlaps on two cores
shows in the wall time alone, which needs an idle machine. ``--only NAME`` takes one of the commands. ``cold`` has a cache of
its own every time, so it meshes and compiles; ``slab1`` and ``slab2`` are one and two ranks under `mpirun`. What ends in
``_drawn`` draws stored results with ``softmodels draw``, all default pictures and the report.

Against ee3d6d7, before and after in wall seconds, on one idle machine with a cache of its own (``XDG_CACHE_HOME``: FFCx lists
all of it for every module): help 0.80 and 0.20 s (4.1 times), a refused option the same, section 1.65 and 0.81 s (2.02 times;
2.04 in nine rounds), wedge with all its pictures 22.4 and 7.7 s (2.9 times), its first run 36.8 and 12.8 s (2.9 times), medians
of three; the slab, one round, 78.9 and 33.9 s on one rank, 51.2 and 22.2 s on two (2.3 times each).

Pictures without light and with the film on demand, against db512b1, medians of three: of a section 8.12 and 1.82 s of CPU (4.3
times), 7.7 and 1.6 s of wall time, of the wedge 7.66 and 3.51 s (2.2 times), 4.4 and 2.9 s.

With rendered images in pages without resampling, the bar of a scale drawn once and PNG files in reports as they are, against
db512b1, medians of three on a little busy machine: a section 7.47 and 1.32 s of CPU (5.6 times), the wedge 7.20 and 2.51 s
(2.9 times), 7.27 and 2.55 s of wall time.
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import subprocess
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).parents[2]
DISK = ("-m", "softmodels.disk")
SECTION = (*DISK, "--pressure-cm", "0:177", "--section", "axisymmetric", "--no-pictures")
SLAB = ("-m", "softmodels.seminar", "--pressure-cm", "0:177", "--no-pictures")
COMMANDS = {
    "help": ((*DISK, "--help"), 3.0),
    "refused": ((*DISK, "--pressure-cm", "5:3"), 3.0),
    "group": (("-m", "softmodels", "--help"), 3.0),
    "section": (SECTION, 2.0),
    "wedge": ((*DISK, "--pressure-cm", "0:177"), 2.5),
    "cold": ((*DISK, "--pressure-cm", "0:177"), 2.0),
    "slab1": (SLAB, 1.6),
    "slab2": (SLAB, 1.6),
    "section_drawn": (("-m", "softmodels", "draw"), 5.0),
    "wedge_drawn": (("-m", "softmodels", "draw"), 2.0),
    "slab_drawn": (("-m", "softmodels", "draw"), 2.0),
}
"""Words after ``python``, and how many times faster than before they are to be."""
RANKS = {"slab1": 1, "slab2": 2}
SOLVED = {
    "section_drawn": SECTION,
    "wedge_drawn": (*DISK, "--pressure-cm", "0:177", "--no-pictures"),
    "slab_drawn": SLAB,
}
"""Whose results are drawn."""


def spent(tree: Path, name: str, folder: Path) -> tuple[float, float]:
    """CPU and wall seconds of a command."""
    words, _ = COMMANDS[name]
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"} | {"OMP_NUM_THREADS": "1"}
    if name == "cold":
        environment["XDG_CACHE_HOME"] = tempfile.mkdtemp(dir=folder)
    more = ("-o", str(folder / tree.name)) if "--pressure-cm" in words else ()
    if name in SOLVED:
        more = (str(folder / f"{tree.name}-{name}"),)
        if not Path(*more).exists():
            solve = [tree / ".venv/bin/python", *SOLVED[name], "-o", *more]
            subprocess.run(solve, cwd=tree, env=environment, capture_output=True, check=True)
    ranks = (tree / ".venv/bin/mpirun", "-n", str(RANKS[name])) if name in RANKS else ()
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    command = [*ranks, tree / ".venv/bin/python", *words, *more]
    subprocess.run(command, cwd=tree, env=environment, capture_output=True, check=False)
    wall, after = time.monotonic() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, wall


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before", type=Path, help="the tree to compare with")
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--only", choices=COMMANDS, nargs="*", default=list(COMMANDS))
    given = parser.parse_args()
    print("command   CPU s before  after  ratio   wall s before  after  ratio   wanted")
    with tempfile.TemporaryDirectory() as folder:
        for name in given.only:
            _, wanted = COMMANDS[name]
            trees = (given.before.resolve(), HERE)
            for tree in trees if name != "cold" else ():
                spent(tree, name, Path(folder))
            runs = [[spent(tree, name, Path(folder)) for tree in trees] for _ in range(given.repeat)]
            cells = []
            for kind in (0, 1):
                old, new = ([run[k][kind] for run in runs] for k in (0, 1))
                ratio = statistics.median(a / b for a, b in zip(old, new, strict=True))
                cells.append(f"{statistics.median(old):12.2f} {statistics.median(new):6.2f} {ratio:6.2f}")
            print(f"{name:9}{cells[0]}  {cells[1]}   {wanted:.1f}", flush=True)


if __name__ == "__main__":
    main()
