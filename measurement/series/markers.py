"""Markers on a device over a list of photographs: which is which, their places and how far they turned.

Bending moves a marker by many times its distance from the next one, but hardly along the device's centre line and across it.
In these coordinates each marker is looked for where it was in the photograph before. One that is covered, lost, doubled or
stuck elsewhere is named, and not used.
"""

from __future__ import annotations

import csv
import dataclasses
import math
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from measurement.outline import silhouette
from measurement.series.photo_list import Photograph
from softmodels.common.arrays import Array


@dataclasses.dataclass(frozen=True, eq=False)
class Marker:
    """A marker in one photograph.

    Attributes:
        name: Its number along the device, or a tag's own.
        place: Where its middle is (2,) in m, on the face towards the camera.
        error: Standard error (2,) of that from the middle of the base in m.
        own_error: The part of it on each axis in m that is this photograph's own: noise and lens, not the scale.
        parallax: By how much in m its place (2,) appears to move if it moves towards the camera, per m.
        boundary: Points (k, 2) around it in px.
        rotation: By how much in rad it turned since the reference, from x to z, and the standard error of that: a tag itself,
            of dots the line from this one to the next; NaN where it is not known.
        reasons: What speaks against it, one sentence each.
    """

    name: str
    place: Array
    error: Array
    own_error: float
    parallax: Array
    boundary: Array
    rotation: tuple[float, float] = (math.nan, math.nan)
    reasons: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True, eq=False)
class Sighting:
    """What a photograph shows of a marker before it has a name: the marker, what repeats of the evaluation give for its place
    from the base's middle (r, 2) in m, its place along the device and across it (2,) in m, the direction of a tag in rad, its
    mean radius in m, the width of its edge in px, and the number of a tag."""

    marker: Marker
    repeats: Array
    along: Array
    direction: float
    radius: float
    width: float
    tag: str


MIN_GATE, GATE_SHARE = 1.0e-3, 0.4
"""How far in m along the device and across it a marker may move from one photograph to the next, and the same as a share of the
least distance between two markers."""

MAX_SIZE_RATIO = 1.35
"""Ratio of a marker's radii in two photographs from which a part of it is hidden, or it is another."""

MAX_WIDTH_RATIO = 2.0
"""Ratio of the widths of a marker's edge from which it moved, or is out of focus."""

ASTRAY_SHARE, ASTRAY_ERRORS, MIN_NEIGHBOURS = 0.02, 4.0, 3
"""Share of the device's length by which a marker may move otherwise along it than its neighbours, the same in standard errors,
and how many others it takes to judge that."""


def along_line(shape: silhouette.Shape, places: Array, length: float) -> Array:
    """Return places (n, 2) in m along a device's centre line, as of one of a length in m, and across it, shape (n, 2)."""
    line, normal = shape.line, silhouette.normals(shape.line)
    dense = np.linspace(0.0, len(line) - 1.0, 20 * len(line))
    fine, across = (
        np.column_stack([np.interp(dense, np.arange(len(line)), axis) for axis in part.T]) for part in (line, normal)
    )
    nearest = cKDTree(fine).query(places)[1]
    return np.column_stack([
        dense[nearest] / (len(line) - 1.0) * length, np.einsum("ni,ni->n", places - fine[nearest], across[nearest])
    ])  # fmt: skip


class Tracker:
    """Names the markers of photographs, in the order in which they are seen; the first one is the reference."""

    def __init__(self) -> None:
        self.first: dict[str, Sighting] = {}
        self.last: dict[str, Sighting] = {}

    def track(self, sightings: Sequence[Sighting], shape: silhouette.Shape, length: float) -> tuple[Marker, ...]:
        """Return the markers of a photograph of a device of a shape, and of a length in m in the reference; those that are lost
        have no place (NaN)."""
        sightings = [
            dataclasses.replace(sighting, along=along_line(shape, sighting.marker.place[None], length)[0])
            for sighting in sightings
        ]
        if not self.first:
            by_name: dict[str, list[Sighting]] = {}
            for number, sighting in enumerate(sorted(sightings, key=lambda sighting: sighting.along.tolist())):
                by_name.setdefault(sighting.tag or str(number + 1), []).append(sighting)
            self.first = self.last = {
                name: _doubted(same[0], name, [_doubled(name)] if len(same) > 1 else []) for name, same in by_name.items()
            }
            chosen = self.first
        else:
            chosen = self._named(sightings)
            self.last = self.last | {name: sighting for name, sighting in chosen.items() if not sighting.marker.reasons}
            chosen = self._astray(chosen, length)
        return tuple(self._marker(name, chosen) for name in self.first)

    def _named(self, sightings: Sequence[Sighting]) -> dict[str, Sighting]:
        """Return the sightings by the markers' names; of those that are doubled the nearest one, doubted."""
        known = np.array([self.last[name].along for name in self.first])
        gaps = np.linalg.norm(known[:, None] - known[None], axis=2) + np.diag(np.full(len(known), np.inf))
        gate = max(MIN_GATE, GATE_SHARE * float(gaps.min())) if len(known) > 1 else math.inf
        named = {}
        for name, before in zip(self.first, known, strict=True):
            near = [part for part in sightings if not part.tag and np.linalg.norm(part.along - before) < gate]
            same = [part for part in sightings if part.tag == name] or near
            if not same:
                continue
            closest = min(same, key=lambda part: float(np.linalg.norm(part.along - before)))
            doubts = [_doubled(name)] if len(same) > 1 else []
            moved = float(np.linalg.norm(closest.along - before))
            if moved > gate:
                doubts.append(
                    f"it moved {moved * 1e3:.2g} mm along the device since it was last seen: it is another, or came off"
                )
            rivals = [
                other for other, there in zip(self.first, known, strict=True) if np.linalg.norm(closest.along - there) < gate
            ]
            if not closest.tag and len(rivals) > 1:
                doubts.append(f"it may be marker {' or '.join(rivals)}: keep dots farther apart, or photograph smaller steps")
            first = self.first[name]
            ratio = closest.radius / first.radius
            if not 1.0 / MAX_SIZE_RATIO < ratio < MAX_SIZE_RATIO:
                doubts.append(
                    f"it is {ratio:.2f} times as large as in the first photograph: a part of it is hidden, or it is another"
                )
            if closest.width > MAX_WIDTH_RATIO * max(first.width, 0.5):
                doubts.append("its edge is twice as wide as in the first photograph: it moved, or is out of focus")
            doubts += [reason for reason in first.marker.reasons if reason not in doubts]
            named[name] = _doubted(closest, name, doubts)
        return named

    def _astray(self, chosen: dict[str, Sighting], length: float) -> dict[str, Sighting]:
        """Return the sightings, doubted where a marker moved along the device otherwise than the others."""
        names = list(chosen)
        moved = np.array([chosen[name].along - self.first[name].along for name in names]).reshape(-1, 2)
        at = np.array([self.first[name].along[0] for name in names])
        off = np.zeros(len(names))
        left = list(range(len(names)))
        while len(left) > MIN_NEIGHBOURS:
            missed = np.array([_missed(at, moved, k, [j for j in left if j != k]) for k in left])
            worst = int(np.argmax(missed))
            error = float(np.linalg.norm(chosen[names[left[worst]]].marker.error))
            if missed[worst] < max(ASTRAY_SHARE * length, ASTRAY_ERRORS * error):
                break
            off[left[worst]] = missed[worst]
            left.pop(worst)
        return {
            name: _doubted(chosen[name], name, [
                f"it moved {off[k] * 1e3:.2g} mm along the device otherwise than its neighbours: it is another, or came off"
            ] if off[k] else []) for k, name in enumerate(names)
        }  # fmt: skip

    def _marker(self, name: str, chosen: dict[str, Sighting]) -> Marker:
        """Return a marker with its rotation since the reference."""
        if name not in chosen:
            lost = "it is not seen where it was: covered, lost, or another thing is on it"
            nowhere = np.full(2, np.nan)
            return Marker(name, nowhere, nowhere, math.nan, nowhere, np.empty((0, 2)), reasons=(lost,))
        now, first, names = chosen[name], self.first[name], list(self.first)
        if now.tag:
            turned, arm = now.direction - first.direction, math.sqrt(2.0) * now.radius
            error = math.hypot(*now.marker.error) / arm
        else:
            following = names[names.index(name) + 1 : names.index(name) + 2]
            if not following or following[0] not in chosen or chosen[following[0]].marker.reasons:
                return now.marker
            (other,) = following
            ways = [chosen[other].repeats - now.repeats, self.first[other].repeats - first.repeats]
            angles = [np.arctan2(way[:, 1], way[:, 0]) for way in ways]
            turned = float(np.angle(np.mean(np.exp(1j * (angles[0] - angles[1])))))
            error = math.hypot(*(float(np.std(_small(part - part[0]), ddof=1)) for part in angles))
        return dataclasses.replace(now.marker, rotation=(float(_small(turned)), error))


def _small(angle: Array | float) -> Array:
    """Return angles in rad from -pi to pi."""
    return np.asarray(np.angle(np.exp(1j * np.asarray(angle))))


def _doubled(name: str) -> str:
    return f"marker {name} is seen twice; cover the other thing of its colour or number"


def _doubted(sighting: Sighting, name: str, doubts: Sequence[str]) -> Sighting:
    marker = dataclasses.replace(sighting.marker, name=name, reasons=(*sighting.marker.reasons, *doubts))
    return dataclasses.replace(sighting, marker=marker)


def _missed(at: Array, moved: Array, k: int, others: Sequence[int]) -> float:
    """Return how far in m a marker's motion (n, 2) along the device is from a line through that of others, by their places."""
    terms = np.column_stack([np.ones(len(others)), at[others]])
    fit = np.linalg.lstsq(terms, moved[others], rcond=None)[0]
    return float(np.linalg.norm(moved[k] - np.array([1.0, at[k]]) @ fit))


COLUMNS = (
    "file", "pressure_Pa", "pressure_error_Pa", "marker", "x_m", "x_error_m", "z_m", "z_error_m", "own_error_m",
    "parallax_x", "parallax_z", "rotation_deg", "rotation_error_deg", "trusted", "remarks", "time_s",
)  # fmt: skip
TABLE = "markers.csv"
"""Table of the markers of a list of photographs."""


def write(path: Path, seen: Iterable[tuple[Photograph, str, Sequence[str], Sequence[Marker]]], origin: Array) -> None:
    """Write markers, whose places count from an origin (2,) in m: of each photograph whether it is trusted, what speaks
    against it, and its markers."""
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(COLUMNS)
        for photo, trust, doubts, present in seen:
            for marker in present:
                told = (*(doubts if trust == "no" else ()), *marker.reasons)
                (x, z), (x_error, z_error) = marker.place - origin, marker.error
                numbers = (
                    x, x_error, z, z_error, marker.own_error, *marker.parallax, *np.degrees(marker.rotation),
                )  # fmt: skip
                table.writerow((
                    photo.file.name, repr(photo.pressure), repr(photo.pressure_error), marker.name,
                    *("" if math.isnan(value) else f"{value:.7g}" for value in numbers), "no" if told else "yes",
                    "; ".join(told), "" if photo.time is None else f"{photo.time:.9g}",
                ))  # fmt: skip
