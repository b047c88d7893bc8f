"""How often openings are found on random parts: ``uv run --group dev python -m tests.benchmarks.random_inlets --count 200``.

Prints parts whose air spaces, openings, radii or places differ from those that were drawn.
"""

from __future__ import annotations

import argparse
import time

from geometries import inlets
from tests.support.open_parts import OpenPart, random_part


def wrong(part: OpenPart) -> str:
    """Return what is found wrong on a part; empty if nothing."""
    found = inlets.air_spaces(*part.surface())
    if len(found) != len(part.bores):
        return f"{len(found)} air spaces for {len(part.bores)}"
    left = [list(bores) for bores in part.bores]
    for space in found:
        for inlet in space.inlets:
            place = [1e3 * x for x in inlet.middle]
            own = next((b for bores in left for b in bores if _at(b, place, 1e3 * inlet.radius)), None)
            if own is None:
                return f"an opening {inlet.text} that was not drawn"
            next(bores for bores in left if own in bores).remove(own)
    return f"{sum(map(len, left))} openings were not found" if any(left) else ""


def _at(bore, place: list[float], radius: float) -> bool:
    offset = [x - y for x, y in zip(place, bore.place, strict=True)]
    along = sum(x * y for x, y in zip(offset, bore.axis, strict=True))
    across = sum((x - along * y) ** 2 for x, y in zip(offset, bore.axis, strict=True)) ** 0.5
    return -1.0 < along < bore.length and across < 0.15 * bore.radius and abs(radius - bore.radius) < 0.1 * bore.radius


def main() -> None:
    """Count them."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--count", type=int, default=200)
    options.add_argument("--first", type=int, default=0)
    asked = options.parse_args()
    faults, started = 0, time.perf_counter()
    for seed in range(asked.first, asked.first + asked.count):
        try:
            part = random_part(seed)
            fault = wrong(part)
        except AssertionError:
            continue
        if fault:
            faults += 1
            print(f"{seed}: {fault}; drawn {part.bores}", flush=True)
    print(f"{faults} of {asked.count} wrong, {(time.perf_counter() - started) / asked.count:.1f} s each")


if __name__ == "__main__":
    main()
