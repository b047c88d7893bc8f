"""Tell whether two path.csv hold the same path: ``python -m tests.support.same_path one/path.csv two/path.csv``."""

from __future__ import annotations

import csv
import sys
from pathlib import Path

TOLERANCE = 1e-8


def largest_difference(one: Path, two: Path) -> float:
    """Largest relative difference of any number in two tables; ValueError where rows, columns or words differ."""
    tables = [list(csv.DictReader(path.read_text().splitlines())) for path in (one, two)]
    if len(tables[0]) != len(tables[1]):
        raise ValueError(f"{len(tables[0])} rows against {len(tables[1])}")
    worst = 0.0
    for row, other in zip(*tables, strict=True):
        if row.keys() != other.keys():
            raise ValueError("the columns differ")
        for name, text in row.items():
            try:
                a, b = float(text), float(other[name])
            except ValueError:
                if text != other[name]:
                    raise ValueError(f"{name}: {text!r} against {other[name]!r}") from None
                continue
            worst = max(worst, abs(a - b) / max(abs(a), abs(b), 1e-12))
    return worst


if __name__ == "__main__":
    difference = largest_difference(Path(sys.argv[1]), Path(sys.argv[2]))
    print(f"largest relative difference {difference:.1e} (allowed {TOLERANCE:g})")
    sys.exit(difference > TOLERANCE)
