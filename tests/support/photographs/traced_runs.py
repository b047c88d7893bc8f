"""Random runs of ray-traced photographs, measured as a user's would be, and how far their outlines lie off.

A run is a photograph of the grid, one of the undeformed body and some of the raised one, all by the independent renderer of
`ray_tracer`. Lamps are discs, squares and frosted bulbs; cameras store light by sRGB's curve, by one with an S curve on top,
in proportion, or as a phone does, which sharpens as well.
"""

from __future__ import annotations

import contextlib
import dataclasses
from pathlib import Path

import numpy as np

from measurement.camera import Camera
from measurement.outline.outline import Outline
from measurement.outline.zero import with_known_body
from measurement.pictures import Unmeasurable
from measurement.screen.grid import find_grid
from measurement.screen.setup import Setup
from measurement.series.measuring import AUTO, Refusal, Result, judged, outline_of, trace_image, zero_of
from measurement.series.photo_list import Photograph
from tests.support.photographs import ray_tracer as rays

LAMPS, CAMERAS = ("disc", "square", "gaussian"), ("srgb", "s curve", "phone", "linear")
SHARES = (0.0, 0.35, 0.7, 1.0)
"""Heights of a run's photographs over the highest."""


@dataclasses.dataclass(frozen=True)
class Case:
    """A run before it is photographed: lamp and camera by name, bench, sensor, and the body at its highest."""

    lamp: str
    camera: str
    bench: rays.Bench
    sensor: rays.Sensor
    body: rays.Body


def random_case(seed: int, lamp: str | None = None, camera: str | None = None) -> Case:
    """The run of a seed."""
    rng = np.random.default_rng([31, seed])
    lamp, camera = lamp or LAMPS[seed % 3], camera or CAMERAS[seed // 3 % 4]
    far, near = rng.uniform(0.8, 3.0), rng.uniform(20e-3, 45e-3)
    spread = rng.uniform(40e-6, 90e-6) * far / near  # standard deviation of the lamp itself
    size = {"disc": 4.0, "square": np.sqrt(12.0), "gaussian": 1.0}[lamp] * spread
    bench = rays.Bench(
        lamp=rays.Lamp(lamp, size, rng.uniform(0.0, 45.0)), lamp_distance=far, screen_distance=near,
        pixel=rng.uniform(24e-6, 30e-6), aside=rng.uniform(-25.0, 25.0), above=rng.uniform(-5.0, 15.0),
        turned=rng.uniform(-2.0, 2.0), looks_at=(rng.uniform(-1e-3, 1e-3), rng.uniform(0.0, 1.5e-3)),
        pitch=float(rng.choice([4.5e-3, 3.5e-3])), line=rng.uniform(0.3e-3, 0.6e-3), ink=rng.uniform(0.15, 0.4),
        ambient=rng.uniform(0.05, 0.2), falloff=rng.uniform(0.0, 0.3),
    )  # fmt: skip
    phone = camera == "phone"
    sensor = rays.Sensor(
        blur=rng.uniform(0.7, 1.3), exposure=rng.uniform(0.3, 0.75), noise=rng.uniform(0.004, 0.012),
        tone="linear" if camera == "linear" else "srgb",
        s_curve=rng.uniform(0.05, 0.3) if camera in ("s curve", "phone") else 0.0,
        sharpening=rng.uniform(0.3, 1.2) if phone else 0.0, radius=rng.uniform(0.8, 2.0),
        quality=int(rng.integers(88, 98)),
    )  # fmt: skip
    sides = bool(rng.integers(0, 2))
    height, dome, width = rng.uniform(3e-3, 7e-3), rng.uniform(8e-3, 10e-3), rng.uniform(11e-3, 12e-3)
    # What is beside the bulge shows whether the body has moved, so some of it stays in the picture.
    dome, width = (min(dome, 0.76 * width), width) if sides else (dome, 0.2)
    floor, pitch = rng.uniform(-5.5e-3, -4.5e-3), rng.uniform(1.5, 3.0)
    # Nobody lays the surface along a grid line, which hides it.
    line = bench.pitch * np.rint(floor / bench.pitch)
    floor = floor if abs(floor - line) > 0.6e-3 else line - 1.1e-3
    body = rays.Body(height, dome, width, floor=floor, pitch=pitch)
    return Case(lamp, camera, bench, sensor, body)


def deep_case(case: Case, half: float = 10.5e-3) -> Case:
    """The run with a level round body as deep along the light as wide, 1.5 mm from the screen."""
    body = dataclasses.replace(case.body, width=half, depth=half, dome=min(case.body.dome, 0.76 * half))
    bench = dataclasses.replace(case.bench, screen_distance=half + 1.5e-3)
    return dataclasses.replace(case, body=body, bench=bench)


LARGE, SHAPES = ("disc", "ring", "diodes", "sun", "square"), ("sheet", "block", "round")
"""Lamps that are large for their distance, and bodies along the light, of `large_case`."""


def large_case(seed: int, lamp: str | None = None, shape: str | None = None, camera: str | None = None) -> Case:
    """The run of a seed, in small pictures, with a large lamp and a lens whose depth of field the screen exceeds."""
    case, rng = random_case(seed, "disc", camera), np.random.default_rng([48, seed])
    lamp, shape = lamp or LARGE[seed % 5], shape or SHAPES[seed % 3]
    width = rng.uniform(9e-3, 10e-3) if shape != "sheet" or rng.integers(0, 2) else 0.2
    body = rays.Body(
        rng.uniform(3e-3, 5.5e-3), rng.uniform(6.3e-3, 7.2e-3), width, 0.0 if shape == "sheet" else min(width, 10e-3),
        shape == "round", floor=rng.uniform(-3.2e-3, -2.4e-3), pitch=rng.uniform(1.5, 3.0),
    )  # fmt: skip
    far, near = case.bench.lamp_distance, body.depth + rng.uniform(8e-3, 25e-3)
    size = rng.uniform(80e-6, 170e-6) * far / near  # standard deviation of the lamp itself, along one direction
    size *= {"disc": 4.0, "ring": 4.0 / np.hypot(1.0, 0.75)}.get(lamp, np.sqrt(12.0))
    if lamp == "sun":
        far, size = 1e3, 2e3 * np.tan(np.radians(0.265))
    bench = dataclasses.replace(
        case.bench, lamp=rays.Lamp(lamp, size, rng.uniform(0.0, 45.0), points=324 if lamp == "diodes" else 256),
        lamp_distance=far, screen_distance=near, size=(720, 460), pixel=32e-6, pitch=3.5e-3, looks_at=(0.0, 0.0),
        opening=rng.uniform(1e-3, 3e-3), focus=rng.normal(0.0, 2e-3),
    )  # fmt: skip
    return Case(lamp, case.camera, bench, case.sensor, body)


PHONES = ("noise", "compressed", "moved", "denoised", "gamma", "halo")
"""What is other with the camera of `other_case`."""


def other_case(seed: int, kind: str | None = None) -> Case:
    """The run of a seed, in small pictures, with a camera whose noise or blur is not that of `random_case`."""
    case, rng = random_case(seed, None, "srgb"), np.random.default_rng([27, seed])
    kind = kind or PHONES[seed % len(PHONES)]
    changes = {
        "noise": {"noise": rng.uniform(0.02, 0.05)},
        "compressed": {"quality": int(rng.integers(70, 86))},
        "moved": {"motion": rng.uniform(1.5, 2.5), "towards": rng.uniform(0.0, 180.0)},
        "denoised": {"denoised": rng.uniform(1.0, 2.0), "noise": rng.uniform(0.01, 0.03)},
        "gamma": {"tone": f"{rng.uniform(1.8, 2.6):.3f}"},
        "halo": {"sharpening": rng.uniform(1.2, 2.5), "radius": rng.uniform(1.5, 3.0)},
    }[kind]
    bench = dataclasses.replace(case.bench, size=(720, 460), pixel=32e-6, pitch=3.5e-3, looks_at=(0.0, 0.0))
    body = dataclasses.replace(
        case.body, height=rng.uniform(3e-3, 5.5e-3), dome=rng.uniform(6.3e-3, 7.2e-3),
        width=rng.uniform(9e-3, 10e-3) if case.body.width < 0.1 else 0.2, floor=rng.uniform(-3.2e-3, -2.4e-3),
    )  # fmt: skip
    return Case(case.lamp, kind, bench, dataclasses.replace(case.sensor, **changes), body)


THINGS = ("ball", "peg", "hand", "hose", "ruler", "cable")
"""Second things of `thing_beside`."""


def thing_beside(case: Case, kind: str, seed: int) -> rays.Thing:
    """A second thing at one side of a body: its shadow touches the body's, or it crosses the picture beside it."""
    rng = np.random.default_rng([16, seed, THINGS.index(kind)])
    side, top, edge = float(rng.choice([-1.0, 1.0])), case.body.floor, case.body.width

    def at(*places: tuple[float, float]) -> tuple[tuple[float, float], ...]:
        return tuple((side * (edge + beyond), top + above) for beyond, above in places)

    nearer, radius = rng.uniform(-5e-3, 5e-3), rng.uniform(1.5e-3, 5e-3)
    if kind == "ball":  # it lies against the side, its middle above or below the surface
        return rays.Thing(kind, at((0.8 * radius, rng.uniform(-0.6, 0.6) * radius)), radius, nearer)
    if kind == "peg":  # it stands on the table with a round head
        return rays.Thing(kind, at((0.8 * radius, -30e-3), (0.8 * radius, rng.uniform(-0.5e-3, 2e-3))), radius, nearer)
    if kind == "hand":  # three fingers from beside
        tips = [(rng.uniform(-0.5e-3, 1e-3), height) for height in (-2.5e-3, 0.5e-3, 3.5e-3)]
        path = [place for tip in tips for place in ((20e-3, tip[1]), tip, (20e-3, tip[1]))]
        return rays.Thing(kind, at(*path), 1.8e-3, nearer)
    if kind == "hose":  # it rises from the table beside the body and leaves the picture
        path = [(0.5e-3 + 4e-3 * (1.0 - np.cos(t)), -4e-3 + 6e-3 * t) for t in np.linspace(0.0, 1.5, 9)]
        return rays.Thing(kind, at((0.5e-3, -30e-3), *path, (25e-3, 6e-3)), rng.uniform(0.8e-3, 2e-3), nearer)
    if kind == "ruler":  # it stands upright beside the body and leaves the picture
        return rays.Thing(kind, at((3e-3, -30e-3), (3e-3, 30e-3)), 3.2e-3, nearer)
    return rays.Thing(kind, at((0.3e-3, -30e-3), (1e-3, -1e-3), (4e-3, 30e-3)), rng.uniform(0.2e-3, 0.5e-3), nearer)


def beside_case(seed: int, size: tuple[int, int] = (720, 460), pixel: float = 32e-6) -> Case:
    """The run of a seed with a disc lamp, in small pictures that show the body's sides and room beside them."""
    case = random_case(seed, "disc", "srgb")
    bench = dataclasses.replace(
        case.bench, lamp=dataclasses.replace(case.bench.lamp, points=120), size=size, pixel=pixel, pitch=3.5e-3,
        looks_at=(0.0, 0.0),
    )  # fmt: skip
    return dataclasses.replace(case, bench=bench, body=rays.Body(2.5e-3, 5e-3, 7e-3, floor=-2.6e-3, pitch=2.2))


def pictures_of(case: Case, seed: int, shares: tuple[float, ...] | None = None) -> list[np.ndarray]:
    """The grid's photograph, and those of the body at shares of its height, `SHARES` unless given."""
    shares = SHARES if shares is None else shares
    bodies = [None, *(dataclasses.replace(case.body, height=share * case.body.height) for share in shares)]
    return [rays.photograph(case.bench, case.sensor, body, 100 * seed + k) for k, body in enumerate(bodies)]


def setup_of(case: Case, grid: np.ndarray) -> Setup:
    """The setup by the grid's photograph, with the lamp's distance as it is."""
    camera = Camera.ideal(*case.bench.size, case.bench.focal)
    plane = find_grid(grid, camera, case.bench.pitch).plane(camera)
    return Setup(camera, plane, case.bench.magnification, grid_pitch=case.bench.pitch)


def measured(case: Case, pictures: list[np.ndarray], setup: Setup | None = None, tone: str = AUTO):
    """Setup and outcomes (`Outline` or `Refusal`) of a run's photographs, judged together."""
    setup = setup or setup_of(case, pictures[0])
    raised = list(pictures[2:])
    try:
        zero = _zero_line(pictures[1], raised[-1], setup, tone)
        if zero.sides is not None:
            setup = with_known_body(setup, zero, 2.0 * case.body.width)
            zero = _zero_line(pictures[1], raised[-1], setup, tone)
    except Unmeasurable as error:
        return setup, [Refusal(f"zero: {error}", Path())] * len(raised)
    results = []
    for k, picture in enumerate(raised, 1):
        photo = Photograph(Path(f"{k}"), 1000.0 * k, 5.0)
        try:
            traced = trace_image(picture, setup, tone, likely=zero.tone)
            outcome = outline_of(traced, zero, photo.pressure, photo.pressure_error, photo.file.name)
        except Unmeasurable as error:
            outcome = Refusal(str(error), photo.file)
        results.append(Result(photo, outcome, f"{k}"))
    return setup, [result.outcome for result in judged(results)]


def _zero_line(picture: np.ndarray, raised: np.ndarray, setup: Setup, tone: str):
    """The undeformed surface, as `measuring.zero_line` finds it."""
    clear = None
    with contextlib.suppress(Unmeasurable):
        top = trace_image(raised, setup, tone)
        clear = None if top.doubts else top
    zero = zero_of(trace_image(picture, setup, tone), clear)
    return zero_of(trace_image(picture, setup, clear.tone), clear) if zero.doubts and clear is not None else zero


def across(case: Case, setup: Setup, outline: Outline, height: float) -> np.ndarray:
    """Distances (n,) in m of an outline's points from the true one, square to it, wherever it stands along x."""
    body = dataclasses.replace(case.body, height=height)
    x = outline.x + _aside(case, setup)
    aside, rest = 0.0, np.zeros(len(x))
    for _ in range(8):
        slope = (body.rise(x - aside + 5e-6) - body.rise(x - aside - 5e-6)) / 10e-6
        lever = slope / np.sqrt(1.0 + slope**2)
        rest = (outline.z - body.rise(x - aside)) / np.sqrt(1.0 + slope**2)
        aside -= float(np.clip(lever @ rest / max(lever @ lever, 1e-9), -2e-4, 2e-4))
    return rest


def _aside(case: Case, setup: Setup) -> float:
    """X in m of the setup's origin, which is a crossing of its own, seen in the body's plane."""
    at = case.bench.on_screen(setup.to_pixels([[0.0, 0.0]]))[0, 0]
    return float(np.rint(at / case.bench.pitch) * case.bench.pitch) / case.bench.magnification
