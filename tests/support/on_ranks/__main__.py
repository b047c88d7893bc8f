"""See the package."""

import json
import sys
from pathlib import Path

from softmodels.mechanics.mpi import is_root, start
from tests.support.on_ranks import found_by

if __name__ == "__main__":
    comm = start()
    folder, *programs = sys.argv[1:]
    found = {program: found_by(program, comm, Path(folder)) for program in programs}
    if is_root(comm):
        print(json.dumps({**found, "ranks": comm.size}))
