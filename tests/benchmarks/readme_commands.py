"""Run every command of the README in order in a fresh folder, as pasted, and print status and seconds of each.

    uv run python tests/benchmarks/readme_commands.py [--only WORD] [--folder FOLDER]

Takes most of an hour on two cores. `pytest` and `softmodels app`, which serves until it is stopped, are left out.
`uv run` finds the project of this file from the fresh folder by UV_PROJECT. Exit status 0 if every command ended with 0,
else 1.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def commands() -> list[str]:
    """The README's commands in order."""
    blocks = re.findall(r"^```sh\n(.*?)^```", (ROOT / "README.md").read_text(), flags=re.MULTILINE | re.DOTALL)
    lines = [line.strip() for block in blocks for line in block.splitlines()]
    left_out = (" pytest ", "softmodels app")
    return [line for line in lines if line.startswith("uv run") and not any(words in line for words in left_out)]


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--only", default="", help="run only commands that hold this, after the examples")
    parser.add_argument("--folder", type=Path, help="a folder to run in; a fresh one unless given")
    options = parser.parse_args()
    folder = options.folder or Path(tempfile.mkdtemp(prefix="readme-"))
    folder.mkdir(parents=True, exist_ok=True)
    environment = {**os.environ, "UV_PROJECT": str(ROOT)}
    print(f"in {folder}\n\n| status | seconds | command | last line |\n|---|---|---|---|")
    bad = 0
    for line in commands():
        if options.only not in line and "softmodels examples" not in line:
            continue
        begun = time.monotonic()
        done = subprocess.run(
            ["bash", "-c", line], cwd=folder, env=environment, capture_output=True, text=True, check=False
        )
        words = (done.stdout.strip() or done.stderr.strip()).splitlines() or [""]
        if done.returncode:
            words = done.stderr.strip().splitlines() or words
            bad += 1
        shown = line.split("  #")[0].strip()
        print(f"| {done.returncode} | {time.monotonic() - begun:.0f} | `{shown}` | {words[-1][:120]} |", flush=True)
    print(f"\n{bad} of the commands did not end with 0")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
