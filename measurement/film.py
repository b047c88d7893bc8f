"""Films of a device beside a log of its pressure: frames and their times, plateaus of the pressure, a list of photographs.

Camera and log have clocks of their own. How fast the picture changes and how fast the pressure changes are correlated at every
offset between both, and the best one aligns them. Where picture and pressure rest is a plateau. Its last frames, their median,
are a photograph like any other, and so is each frame of a history in time.
"""

from __future__ import annotations

import collections
import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
from PIL import Image
from scipy import fft
from scipy.ndimage import median_filter, uniform_filter1d
from skimage.filters import threshold_otsu

from measurement import pictures, robust
from softmodels.common import columns, files
from softmodels.common.arrays import Array


class FilmError(ValueError):
    """A film or a log that cannot be used; the message is for the user."""


ENDINGS = (".mp4", ".mov", ".avi", ".m4v", ".mkv", ".webm")


def is_film(path: Path) -> bool:
    """Return whether a file is named like a film."""
    return path.suffix.lower() in ENDINGS


def frames(path: Path, wanted: Callable[[int], bool] = lambda number: True) -> Iterator[tuple[float, pictures.Pixels | None]]:
    """Yield the time in s of each frame, also where they are not equally far apart, and its pixels (h, w, 3), turned as
    players show it; None for a frame that is not wanted. `FilmError` for a file that is no film."""
    if not path.is_file():
        raise FilmError(f"there is no film {path}; check its name and folder")
    film = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    try:
        last, number = -math.inf, 0
        while film.grab():
            time = 1e-3 * film.get(cv2.CAP_PROP_POS_MSEC)
            if not time > last:  # a container without times
                time = max(last, 0.0) + 1.0 / max(film.get(cv2.CAP_PROP_FPS), 1.0) if number else 0.0
            good, image = film.retrieve() if wanted(number) else (False, None)
            yield time, cv2.cvtColor(image, cv2.COLOR_BGR2RGB) if good else None  # type: ignore[misc]
            last, number = time, number + 1
        if not number:
            raise FilmError(f"{path} has no frames that can be read; save it as MP4 (H.264), MOV or AVI")
    finally:
        film.release()


def first_frame(path: Path) -> pictures.Pixels:
    """Return the first frame (h, w, 3) of a film; `FilmError` for none."""
    image = next(frames(path))[1]
    if image is None:
        raise FilmError(f"the first frame of {path} cannot be decoded; save the film as MP4 (H.264), MOV or AVI")
    return image


def frame_count(path: Path) -> int:
    """Return about how many frames a film has, as its head says; 0 where it does not."""
    film = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    count = film.get(cv2.CAP_PROP_FRAME_COUNT)
    film.release()
    return max(0, int(count))


# ----------------------------------------------------------------------------------------------------------------------
# How fast the picture changes.


SMALL_PX, MIDDLE_PX = 160, 640
"""Longer sides in px of the picture whose changes are taken, and of one on the way to it, whose rounding averages out."""

CHANGE_SPANS = (1, 2, 4, 8)
"""Frames before and after a frame between which a change is taken: the first span whose changes stand out from noise."""

CLEAR_RATIO = 20.0
"""Ratio of the fastest changes to those at rest from which they stand out."""

LEAST_RATIO, MAX_STILL = 3.0, 10.0
"""The same from which anything moves at all, and stored numbers up to which noise and compression change a still picture."""


@dataclasses.dataclass(frozen=True, eq=False)
class Motion:
    """How fast a film's picture changes.

    Attributes:
        times: Of all frames in s, shape (n,).
        rate: Change of the picture at each frame, in stored numbers per s, shape (n,); what noise makes is taken away.
        half: Half the time in s over which a change is taken.
        rest: Rate up to which the picture is at rest.
    """

    times: Array
    rate: Array
    half: float
    rest: float

    @property
    def step(self) -> float:
        """Usual time between two frames in s."""
        return float(np.median(np.diff(self.times)))


def motion_of(path: Path, done: Callable[[], None] = lambda: None) -> Motion:
    """Return how fast the picture of a film changes; ``done`` is called after each frame. `FilmError` where nothing moves, or
    everything does all the time."""
    times: list[float] = []
    recent: collections.deque[Array] = collections.deque(maxlen=2 * CHANGE_SPANS[-1] + 1)
    changes: dict[int, list[float]] = {span: [] for span in CHANGE_SPANS}
    first: Array | None = None
    for time, image in frames(path):
        if image is None:
            continue
        small = _small(image)
        first = small if first is None else first
        lit = first > 8.0
        small = small / max(float(np.median(small[lit] / first[lit])) if lit.any() else 1.0, 1e-3)  # a lamp that flickers
        times.append(time)
        recent.append(small)
        for span in CHANGE_SPANS:
            if len(recent) > 2 * span:
                # The fourth power weighs the few places where an edge passes.
                change = (recent[-1] - recent[-1 - 2 * span]) ** 4
                changes[span].append(float(np.mean(change)) ** 0.25)
        done()
    if len(times) < 4 * CHANGE_SPANS[-1]:
        raise FilmError(f"{path} has {len(times)} frames; a film of a device has at least {4 * CHANGE_SPANS[-1]}")
    at, motion, ratio = np.array(times), None, 0.0
    for span in CHANGE_SPANS:
        motion, ratio = _motion(at, np.array(changes[span]), span)
        if ratio > CLEAR_RATIO:
            break
    if motion is None or ratio < LEAST_RATIO:
        if first is not None and float(np.mean((recent[-1] - first) ** 4)) ** 0.25 > MAX_STILL:
            raise FilmError(
                f"the picture of {path} never comes to rest: the camera is held by hand, or the pressure always changes; fix "
                "the camera and hold a pressure for a second, or save single pictures of it and list those with their pressures"
            )
        raise FilmError(f"nothing moves in {path}; film the device while its pressure changes")
    return motion


def _small(image: pictures.Pixels) -> Array:
    """Return a frame (h, w, 3) grey and reduced."""
    for longest in (MIDDLE_PX, SMALL_PX):
        factor = longest / max(image.shape[:2])
        if factor < 1.0:
            image = cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)  # type: ignore[assignment]
        if longest == MIDDLE_PX:
            image = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float32)  # type: ignore[assignment]
    return np.asarray(image, dtype=np.float32)


def _motion(times: Array, change: Array, span: int) -> tuple[Motion, float]:
    """Return the motion by changes (n - 2 span,), and by how much the fastest of them stand out."""
    change = median_filter(change, min(2 * span + 3, 9), mode="nearest")  # a key frame of the compression is no motion
    floor = float(np.percentile(change, 5))
    fastest = float(np.mean(np.sort(change)[-max(3, len(change) // 100) :]))
    parted = float(np.exp(threshold_otsu(np.log(np.maximum(change, 1e-9)))))
    low = change[change <= parted]
    middle = float(np.median(low))
    scatter = 1.4826 * float(np.median(np.abs(low - middle)))
    rest = max(min(parted, middle + REST_SCATTER * scatter), RESTING_SHARE * fastest)
    took = times[2 * span :] - times[: -2 * span]
    rate = np.sqrt(np.maximum(change**2 - floor**2, 0.0)) / took
    at = 0.5 * (times[2 * span :] + times[: -2 * span])
    half = 0.5 * float(np.median(took))
    limit = math.sqrt(max(rest**2 - floor**2, 0.0)) / (2.0 * half)
    return Motion(times, np.interp(times, at, rate), half, limit), fastest / max(floor, 1e-9)


REST_SCATTER, RESTING_SHARE = 6.0, 0.03
"""Scatter of the changes at rest, and share of the fastest ones, above which something moves."""


# ----------------------------------------------------------------------------------------------------------------------
# The log, and the offset between both clocks.


@dataclasses.dataclass(frozen=True, eq=False)
class Log:
    """Pressures in Pa at times in s of its own clock, both (m,)."""

    times: Array
    pressures: Array
    source: str = ""

    def at(self, times: Array) -> Array:
        """Return the pressures (n,) in Pa at times (n,) of its clock; NaN outside."""
        return np.interp(times, self.times, self.pressures, left=np.nan, right=np.nan)

    def rate(self, times: Array, half: float) -> Array:
        """Return the magnitude (n,) in Pa/s of the pressure's change about times (n,) over twice ``half``; 0 outside."""
        inside = np.clip(times, self.times[0], self.times[-1]) == times
        later, earlier = (np.interp(times + side, self.times, self.pressures) for side in (half, -half))
        return np.where(inside, np.abs(later - earlier) / (2.0 * half), 0.0)


def read_log(path: Path, told: str = "") -> Log:
    """Read a table of pressures over time; ``told`` is such as ``"time=1[s],pressure=2[kPa]"``, empty to go by its headers.
    `FilmError` for none."""
    try:
        given = columns.columns_of_text(told, columns.LOG) if told else {}
        read = columns.read_tables(path, given, columns.LOG)
        if len(read) > 1:
            raise FilmError(f"{path} has {len(read)} logs; choose the columns of one with --columns")
        table = read[0]
        times = columns.in_si(table.x, table.deformation) if table.deformation.unit else table.x
        pressures = columns.in_si(table.y, table.load)
    except columns.TensileError as error:
        raise FilmError(f"{path}: {error}") from None
    falls = np.flatnonzero(np.diff(times) < 0.0)
    if len(falls):
        raise FilmError(f"{path}, line {table.lines[falls[0] + 1]}: its time is before that of the row above it")
    times, rows = np.unique(times, return_index=True)
    if len(times) < columns.LEAST_POINTS or not np.ptp(pressures) > 0.0:
        raise FilmError(f"{path}: the pressure never changes; give the log of the time in which the film was taken")
    return Log(times, pressures[rows], f"{table.deformation.sentence}, {table.load.sentence}")


@dataclasses.dataclass(frozen=True)
class Clocks:
    """The log's time in s at which the film's is 0, the correlation of both changes there, and the next best offset with its
    correlation over the best (NaN for none)."""

    offset: float
    correlation: float
    second: float = math.nan
    second_share: float = math.nan


MIN_OVERLAP = 0.3
"""Share of the shorter one, film or log, that both have to have in common."""

MAX_STEPS = 5_000_000
"""Frames that would take as long as the log."""

MIN_OFFSET_DISTANCE = 1.0
"""Time in s between two offsets that are not the same, beyond the width of the peak."""


def align(motion: Motion, log: Log, near: tuple[float, float] | None = None) -> Clocks:
    """Return the offset between the clocks of a film and a log; ``near`` is a known one and its standard error in s, 0 to take
    it as it is. `FilmError` where both never run at the same time."""
    step = motion.step
    seen = np.arange(motion.times[0], motion.times[-1], step)
    if not 8 <= np.ptp(log.times) / step <= MAX_STEPS:
        raise FilmError(
            f"the log takes {np.ptp(log.times):.3g} s; it needs the time in which the film was taken, and little more"
        )
    logged = np.arange(log.times[0], log.times[-1], step)
    moving = np.maximum(np.interp(seen, motion.times, motion.rate) - 0.5 * motion.rest, 0.0)
    rate = log.rate(logged, motion.half)
    y = np.sqrt(np.maximum(rate - 0.01 * rate.max(), 0.0))
    offsets = log.times[0] - seen[0] + step * (np.arange(len(seen) + len(y) - 1) - (len(seen) - 1))
    # In the log a sudden change is one from row to row: in the picture it is made as long, but for its place.
    rows = max(1, round(float(np.median(np.diff(log.times))) / step))
    score = _score(np.maximum(uniform_filter1d(moving, rows + 1 - rows % 2, mode="constant"), 0.0), y)
    if near is not None and near[1] == 0.0:
        return Clocks(near[0], float(np.interp(near[0], offsets, score, left=0.0, right=0.0)))
    if near is not None:
        score = np.where(np.abs(offsets - near[0]) <= 3.0 * near[1], score, 0.0)
    best = int(np.argmax(score))
    if not 0 < best < len(score) - 1 or score[best] <= 0.0:
        raise FilmError("film and log have no motion in common; check the times of the log, or give --clock-offset")
    most, sharp = float(score[best]), _score(moving, y) if rows > 1 else score
    place = max(1, best - rows) + int(np.argmax(sharp[max(1, best - rows) : best + rows + 1]))
    place = min(place, len(score) - 2)
    before, middle, after = sharp[place - 1 : place + 2]
    bend = before - 2.0 * middle + after
    offset = float(offsets[place] + step * (0.5 * (before - after) / bend if bend < 0.0 else 0.0))
    below = score < 0.5 * most
    left = best - int(np.argmax(below[best::-1])) if below[: best + 1].any() else 0
    right = best + int(np.argmax(below[best:])) if below[best:].any() else len(score) - 1
    far = np.ones(len(score), dtype=bool)
    far[max(0, left - round(MIN_OFFSET_DISTANCE / step)) : right + round(MIN_OFFSET_DISTANCE / step) + 1] = False
    if not far.any():
        return Clocks(offset, most)
    second = int(np.argmax(np.where(far, score, -1.0)))
    return Clocks(offset, most, float(offsets[second]), float(score[second] / most))


def _score(moving: Array, y: Array) -> Array:
    """Return the correlation of the picture's changes (n,) and the roots y (m,) of the log's at every offset, (n + m - 1,)."""
    # Roots weigh small steps nearly as much as large ones: how far a device moves by a pressure changes with it.
    x = np.sqrt(moving)
    together, common = _correlation(y, x), _correlation(np.ones_like(y), np.ones_like(x))
    # What a film shows has to be in the log; of a longer log only that part counts which was filmed.
    whole = len(y) <= len(x)
    energy = np.full(len(together), np.sum(y**2)) if whole else _correlation(y**2, np.ones_like(x))
    scale = np.sqrt(np.maximum(energy, 1e-3 * np.sum(y**2)) * max(float(np.sum(moving)), 1e-12))
    return np.where(common >= MIN_OVERLAP * min(len(x), len(y)), together / scale, 0.0)


def _correlation(y: Array, x: Array) -> Array:
    """Return the sums (n + m - 1,) of the products of y (m,) with x (n,) at every offset, from x before y to x behind it."""
    count = len(x) + len(y) - 1
    size = fft.next_fast_len(count, real=True)
    return np.asarray(fft.irfft(fft.rfft(y, size) * fft.rfft(x[::-1], size), size)[:count])


MIN_CORRELATION, MAX_SECOND_SHARE = 0.75, 0.92
"""Correlation of the changes of picture and pressure from which a log is that of the film, and the largest share of it that
another offset may have."""


def check_clocks(clocks: Clocks, given: bool) -> None:
    """Raise `FilmError` for a log that does not fit the motion, or fits it at several offsets."""
    if clocks.correlation < MIN_CORRELATION:
        where = "at the given --clock-offset" if given else "at no offset between the clocks"
        raise FilmError(
            f"the log does not fit the motion: {where} the picture changes when the pressure does (correlation "
            f"{clocks.correlation:.2f}, at least {MIN_CORRELATION:g}); give the log of this film, or its units and "
            "columns with --columns"
        )
    if clocks.second_share > MAX_SECOND_SHARE:
        raise FilmError(
            f"the log fits the motion at two offsets nearly as well: the film begins at {clocks.offset:.2f} s or at "
            f"{clocks.second:.2f} s of the log; give --clock-offset, such as {clocks.offset:.1f}s+-0.5s, or hold the "
            "pressures for unequal times"
        )


# ----------------------------------------------------------------------------------------------------------------------
# Plateaus, and the frames of a list.


@dataclasses.dataclass(frozen=True)
class Plateau:
    """From when to when, in s of the film, the picture rests."""

    begin: float
    end: float


MIN_HOLD = 0.5
"""Shortest plateau in s."""

SAME_PRESSURE, NOISE_REACH = 0.01, 6.0
"""Range of pressures over two plateaus side by side, as a share of the log's, up to which they are one; and the range of a held
pressure in standard deviations of the log's noise."""


def plateaus(motion: Motion, log: Log | None, offset: float = 0.0) -> list[Plateau]:
    """Return the plateaus of a film in the order of time; with a log those are joined between which the pressure stays.
    `FilmError` for none."""
    rests = motion.rate <= motion.rest
    edges = np.flatnonzero(np.diff(np.r_[False, rests, False].astype(int)))
    held: list[Plateau] = []
    for first, after in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        # A change is seen half its span before and after.
        begin = motion.times[first] - (motion.half if first > 0 else 0.0)
        end = motion.times[after - 1] + (motion.half if after < len(rests) else 0.0)
        if end - begin < MIN_HOLD:
            continue
        if held and log is not None:
            there = log.at(np.linspace(held[-1].begin, end, 200) + offset)
            if np.ptp(there) < SAME_PRESSURE * np.ptp(log.pressures):  # somebody touched the device
                held[-1] = Plateau(held[-1].begin, float(end))
                continue
        held.append(Plateau(float(begin), float(end)))
    if not held:
        raise FilmError(
            f"the picture rests nowhere for {MIN_HOLD:g} s; hold each pressure, or give --every to measure frames of "
            "the whole film"
        )
    return held


@dataclasses.dataclass(frozen=True)
class Shot:
    """A photograph to be made of a film: the numbers of the frames whose median it is, its time in s, its pressure and the
    standard error in Pa, how long in s this was held before, and how long the change to it took (NaN where not known)."""

    frames: tuple[int, ...]
    time: float
    pressure: float
    error: float
    hold: float = math.nan
    rise: float = math.nan

    @property
    def name(self) -> str:
        """Name of its file."""
        return f"{self.time:08.3f}s.png"


MEDIAN_FRAMES = 5
"""Frames of a plateau whose median is its photograph."""

GAUGE_SHARE = 0.01
"""Standard error of a logged pressure as a share of the largest one of the log, as of a simple sensor."""


def shots_of(
    motion: Motion, held: Sequence[Plateau], pressure_of: Callable[[int, float, float], tuple[float, float]]
) -> list[Shot]:
    """Return the photograph at the end of each plateau; ``pressure_of`` gives the pressure and its error in Pa of a plateau by
    its number, between two times of the film."""
    made: list[Shot] = []
    for number, plateau in enumerate(held):
        long = plateau.end - plateau.begin
        last = plateau.end - min(max(0.1 * long, 2.0 * motion.step), 0.4 * long)
        inside = np.flatnonzero((motion.times >= last - min(0.5, 0.4 * long)) & (motion.times <= last))
        if not len(inside):
            inside = np.array([int(np.argmin(np.abs(motion.times - last)))])
        chosen = inside[np.unique(np.linspace(0, len(inside) - 1, MEDIAN_FRAMES).round().astype(int))]
        time = float(motion.times[chosen[len(chosen) // 2]])
        pressure, own = pressure_of(number, 0.5 * (plateau.begin + time), time)
        rise = max(0.0, plateau.begin - held[number - 1].end) if number else 0.0
        made.append(Shot(tuple(chosen.tolist()), time, pressure, own, time - plateau.begin, rise))
    return made


def logged(log: Log, first: float, last: float, error: float | None) -> tuple[float, float]:
    """Return the mean pressure of a log between two of its times, and its standard error, both in Pa; by default that of a
    simple sensor."""
    own = log.pressures[(log.times >= first) & (log.times <= last)]
    values = own if len(own) else log.at(np.array([0.5 * (first + last)]))
    return float(values.mean()), math.hypot(_usual_error(log, error), float(values.std()))


def _usual_error(log: Log, error: float | None) -> float:
    return GAUGE_SHARE * float(np.abs(log.pressures).max()) if error is None else error


def history_of(motion: Motion, log: Log, offset: float, every: float, error: float | None) -> list[Shot]:
    """Return a photograph of a single frame every so many s of the film, as far as the log goes. Those between which the log
    stays at a pressure have its mean, and belong to one hold; all others have the pressure of their moment."""
    wanted = np.arange(motion.times[0], motion.times[-1] + 0.5 * motion.step, every)
    numbers = np.unique([int(np.argmin(np.abs(motion.times - time))) for time in wanted])
    numbers = numbers[np.isfinite(log.at(motion.times[numbers] + offset))]
    times = motion.times[numbers] + offset
    pressures = log.at(times)
    usual, rate = _usual_error(log, error), log.rate(times, motion.step)
    noise = robust.deviation(np.diff(log.pressures)) / math.sqrt(2.0)
    same = max(SAME_PRESSURE * float(np.ptp(log.pressures)), NOISE_REACH * noise)
    errors = np.hypot(usual, 0.5 * motion.step * rate)
    levels: list[list[int]] = []
    for k, (time, pressure) in enumerate(zip(times, pressures, strict=True)):
        first = levels[-1][0] if levels else k
        between = log.at(np.linspace(times[max(0, k - 1)], time, 50))
        if levels and np.ptp(between) < same and abs(pressure - pressures[first]) < same:
            levels[-1].append(k)
        else:
            levels.append([k])
    made: list[Shot] = []
    before = math.nan
    for level in levels:
        first, last = level[0], level[-1]
        mean = logged(log, times[first], times[last], error)[0] if last > first else float(pressures[first])
        way = np.linspace(times[max(0, first - 1)], times[first], 200)
        away = np.flatnonzero(np.abs(log.at(way) - mean) > same)  # until it comes to the level for good
        reached = way[-1 if len(level) < 2 else min(away[-1] + 1, len(way) - 1) if len(away) else 0]
        stayed = np.flatnonzero((np.abs(log.at(way) - before) <= same) & (way < reached))
        left = way[stayed[-1] if len(stayed) else 0]
        for k in level:
            told = times[k] - offset, mean, errors[k], times[k] - reached, reached - left
            made.append(Shot((int(numbers[k]),), *map(float, told)))
        before = mean
    return made


LIST = "photos.csv"


def write_shots(path: Path, shots: Sequence[Shot], folder: Path, done: Callable[[], None] = lambda: None) -> None:
    """Write the photographs of a film and their list into a folder; ``done`` is called after each of them."""
    waiting = collections.defaultdict[int, list[Shot]](list)
    for shot in shots:
        for number in shot.frames:
            waiting[number].append(shot)
    parts = collections.defaultdict[str, list[pictures.Pixels]](list)
    for number, (_, image) in enumerate(frames(path, waiting.__contains__)):
        for shot in waiting.pop(number, ()):
            if image is not None:
                parts[shot.name].append(image)
            if number == shot.frames[-1] and shot.name in parts:
                seen = parts.pop(shot.name)
                middle = seen[0] if len(seen) == 1 else np.median(np.array(seen), axis=0).round().astype(np.uint8)
                Image.fromarray(middle).save(folder / shot.name, compress_level=1)
                done()
        if not waiting:
            break
    timed = all(math.isfinite(shot.hold) for shot in shots)
    rows = [
        (shot.name, f"{shot.pressure:.9g} Pa", f"{shot.error:.6g} Pa", f"{shot.time:.6f} s")
        + ((f"{shot.hold:.6g} s", f"{shot.rise:.6g} s") if timed else ())
        for shot in shots
    ]
    head = ("file", "pressure", "error", "time", *(("hold", "rise") if timed else ()))
    files.write_text(folder / LIST, files.csv_text(head, rows))
