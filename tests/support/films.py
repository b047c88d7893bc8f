"""Films of a flat bar that bends with its pressure, drawn as polygons with edges between pixels and encoded by OpenCV, and the
log of the pressure. Shares no code with the reader of films; times, plateaus and places of the tip are known."""

from __future__ import annotations

import dataclasses
import itertools

import cv2
import numpy as np

SIZE, PIXEL = (640, 360), 2.5e-4
"""Pixels of a frame, and their size in m."""
LENGTH, THICK, CLAMP = 0.09, 0.012, 0.02
CENTRE = np.array([0.045, -0.028])
"""Place in m at the middle of the frames."""


def to_pixels(places):
    """Pixels (n, 2) of places (n, 2) in m."""
    return (np.asarray(places) - CENTRE) / PIXEL * [1.0, -1.0] + (np.array(SIZE) - 1.0) / 2.0


BASE = to_pixels([[0.0, THICK / 2], [0.0, -THICK / 2]])


def turn_at(pressure):
    """By how much in rad the bar turns at a pressure in Pa: more for each pascal as it rises."""
    return 4e-5 * pressure * (1.0 + pressure / 4e4)


def tip_at(pressure):
    """Place of the tip in m (2,) at a pressure in Pa."""
    turn = turn_at(pressure)
    return LENGTH * np.array([np.sinc(turn / np.pi), -np.sin(turn / 2) * np.sinc(turn / 2 / np.pi)])


def frame(turn, seed, shift=(0.0, 0.0), noise=2.0):
    """A frame (h, w, 3) of a bar turned by so many rad, drawn twice as fine."""
    s = np.linspace(0.0, LENGTH, 120)
    line = s[:, None] * np.column_stack(
        [np.sinc(turn * s / LENGTH / np.pi), -np.sin(turn * s / LENGTH / 2) * np.sinc(turn * s / LENGTH / 2 / np.pi)]
    )
    angle = -turn * s / LENGTH
    normal = np.column_stack([-np.sin(angle), np.cos(angle)])
    edges = [np.vstack([[-CLAMP, side], line + side * normal]) for side in (THICK / 2, -THICK / 2)]
    px = to_pixels(np.vstack([edges[0], edges[1][::-1]])) + shift
    fine = np.full((2 * SIZE[1], 2 * SIZE[0]), 209, dtype=np.uint8)
    cv2.fillPoly(fine, [np.rint((px + 0.5) * 2 * 16 - 8).astype(np.int32)], 26, cv2.LINE_AA, 4)
    light = cv2.GaussianBlur(cv2.resize(fine, SIZE, interpolation=cv2.INTER_AREA).astype(np.float32) / 255, (0, 0), 0.8)
    stored = 255 * (1.055 * light ** (1 / 2.4) - 0.055)
    stored = stored + np.random.default_rng(seed).standard_normal(stored.shape, dtype=np.float32) * noise
    return np.repeat(np.clip(np.rint(stored), 0, 255).astype(np.uint8)[..., None], 3, axis=2)


@dataclasses.dataclass(frozen=True)
class Program:
    """Levels in Pa, when in s the change to each begins and how long it takes; the first level is there from the beginning."""

    levels: tuple[float, ...] = (0.0, 8e3, 16e3, 11e3, 24e3)
    begins: tuple[float, ...] = (0.0, 2.0, 4.7, 6.4, 9.2)
    takes: float = 0.4
    until: float = 12.0

    def pressure(self, times):
        """Pressures in Pa at times in s of the film."""
        corners, values = [-1e3], [self.levels[0]]
        for before, level, begin in zip(self.levels, self.levels[1:], self.begins[1:], strict=False):
            corners += [begin, begin + self.takes]
            values += [before, level]
        return np.interp(times, corners, values)

    @property
    def plateaus(self):
        """Beginning and end of each in s."""
        ends = [*self.begins[1:], self.until]
        return [(b + (self.takes if b else 0.0), e) for b, e in zip(self.begins, ends, strict=True)]


def write(path, frames, fps, code="mp4v"):
    """Write frames (h, w, 3), by OpenCV's order of channels, as a film."""
    writer = None
    for image in frames:
        writer = writer or cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*code), fps, image.shape[1::-1])
        assert writer.isOpened()
        writer.write(image)
    writer.release()


def film(path, program=Program(), fps=25.0, seed=0, shift=lambda time: (0.0, 0.0), exposure=0.0, code="mp4v"):
    """Write a film; ``exposure`` in s over which each frame is blurred."""
    times = np.arange(round(program.until * fps)) / fps

    def frame_at(number, time):
        moments = time + exposure * np.linspace(-0.5, 0.5, 5 if exposure else 1)
        parts = [frame(turn_at(program.pressure(t)), seed + 7919 * number + k, shift(t)) for k, t in enumerate(moments)]
        return np.mean(parts, axis=0).round().astype(np.uint8)

    write(path, itertools.starmap(frame_at, enumerate(times.tolist())), fps, code)
    return times


def log(path, program=Program(), offset=0.0, step=0.1, noise=20.0, begin=-3.0, end=15.0, seed=1):
    """Write a log in kPa whose clock shows ``offset`` s when the film begins."""
    times = np.arange(begin, end, step)
    pressures = program.pressure(times) + np.random.default_rng(seed).normal(0.0, noise, len(times))
    rows = [f"{t + offset:.4f},{p / 1e3:.5f}" for t, p in zip(times, pressures, strict=True)]
    path.write_text("\n".join(["time (s),pressure (kPa)", *rows]) + "\n")
