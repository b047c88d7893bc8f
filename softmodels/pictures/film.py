"""The film of a run: the device over its whole path, with fixed camera and colour scale, and the pressure as caption.

A GIF with 256 colours, which plays everywhere; a smaller animated WebP in full colour, which browsers play and
the report shows. An MP4 too if the package imageio-ffmpeg is installed.
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
import multiprocessing
import os
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType

import numpy as np
from PIL import Image as Picture, ImageDraw, ImageFont

from softmodels.case.entries import CaseError
from softmodels.common.files import replace, write_bytes
from softmodels.common.processes import cores
from softmodels.pictures.offscreen import Image, Look, look, studio
from softmodels.pictures.style import Scale, load
from softmodels.runs.columns import load_columns
from softmodels.runs.fields import Row
from softmodels.runs.store import ResultsError, States

FRAMES = 40
FEWER = (40, 32, 25, 19, 14, 10)
"""Numbers of frames tried until the GIF is small enough: fewer frames are better than colour banding."""
WIDE = 960
"""Width of a frame in pixels."""
SAMPLE = 4
"""Number of frames to estimate the size of one in a GIF."""
LARGEST = 6_000_000
"""Maximum size of a GIF, in bytes."""
QUALITY = 80
"""Quality of the WebP: below, shading shows blocks."""
SECONDS = 4.0
"""Seconds from the first to the last frame, and the duration of the last."""
STANDING = 1.2
HEAD, FOOT = 48, 64
"""Pixels above and below the device, for the pressure and the colours."""


def render_frames(look: Look, count: int = FRAMES) -> list[Image]:
    """Return pictures of states evenly spaced along the path (see `States.along`), interpolated linearly between steps."""
    states = look.states
    steps = list(range(len(states.rows)))
    spread = sorted({0, *states.shown(8), states.main, steps[-1]})
    scale = look.scale(spread)
    camera = look.camera(spread, WIDE, tallest=0.75)
    count = count if states.loaded and len(steps) > 1 else 1
    found = []
    with studio(camera, draft=True) as shoot:
        for place in np.linspace(0.0, 1.0, count):
            position = float(np.interp(place, states.along, steps)) if count > 1 else float(steps[-1])
            found.append(_captioned(shoot(look.coloured(position, scale)), _caption(states, position), scale))
    return found


def _caption(states: States, position: float) -> str:
    words, first = states.words, states.rows[0]
    rise = f"{words.gauge}_mm"
    names = [rise, *(["load_step"] if "load_step" in first else []), *words.pressures(first), *load_columns(first)]
    steps = range(len(states.rows))
    row = Row((name, float(np.interp(position, steps, [row[name] for row in states.rows]))) for name in names)
    return f"{load(row, words, kilopascals=False)}   {words.gauge} rise {row[rise]:+.2f} mm"


def _captioned(image: Image, text: str, scale: Scale) -> Image:
    """Return a frame with its caption above and its colour bar below."""
    height, width, _ = image.shape
    page = Picture.new("RGB", (width, 2 * ((height + HEAD + FOOT) // 2)), "white")
    page.paste(Picture.fromarray(image), (0, HEAD))
    pen, font = ImageDraw.Draw(page), ImageFont.load_default(28)
    pen.text((width / 2, HEAD / 2), text, fill="#102a43", font=font, anchor="mm")
    colours = (scale.colours(np.linspace(0, 1, width // 3))[:, :3] * 255).astype(np.uint8)
    top = page.height - FOOT + 26
    left = (width - len(colours)) // 2
    page.paste(Picture.fromarray(np.repeat(colours[None], 18, axis=0)), (left, top))
    middle, small = top + 9, ImageFont.load_default(22)
    pen.text((left - 12, middle), f"{scale.low:g}", fill="#102a43", font=small, anchor="rm")
    end = f"{scale.top:.3g} {scale.unit} and more".replace("  ", " ")
    pen.text((left + len(colours) + 12, middle), end, fill="#102a43", font=small, anchor="lm")
    return np.asarray(page)


def gif(images: list[Image]) -> bytes:
    """Return the frames as a GIF of at most `LARGEST` bytes, dropping frames if necessary."""
    # One common palette avoids flickering colours.
    sample = np.concatenate([image[::4, ::4] for image in [*images[:: max(len(images) // 10, 1)], images[-1]]])
    palette = Picture.fromarray(sample).quantize(256, Picture.Quantize.MAXCOVERAGE)
    pages: dict[int, Picture.Image] = {}

    def encoded(places: Sequence[int]) -> bytes:
        for k in places:
            if k not in pages:
                page = Picture.fromarray(images[k])
                pages[k] = page.quantize(palette=palette, dither=Picture.Dither.FLOYDSTEINBERG)
        return _gif([pages[k] for k in places])

    # A few sample frames estimate the size, to avoid encoding all of them repeatedly.
    some = sorted({int((k + 0.5) / SAMPLE * len(images)) for k in range(SAMPLE)})
    each = len(encoded(some)) / len(some)
    begin = next((k for k, count in enumerate(FEWER) if each * min(count, len(images)) <= LARGEST), len(FEWER) - 1)
    for count in FEWER[begin:]:
        data = encoded(np.unique(np.linspace(0, len(images) - 1, min(count, len(images))).round().astype(int)).tolist())
        if len(data) <= LARGEST:
            break
    return data


def _gif(pages: list[Picture.Image]) -> bytes:
    stream = io.BytesIO()
    pages[0].save(stream, "GIF", save_all=True, append_images=pages[1:], duration=_times(pages), loop=0, optimize=False)
    return stream.getvalue()


def webp(images: list[Image]) -> bytes:
    """Return the frames as an animated WebP, in all their colours."""
    pages = [Picture.fromarray(image) for image in images]
    stream = io.BytesIO()
    pages[0].save(
        stream,
        "WEBP",
        save_all=True,
        append_images=pages[1:],
        duration=_times(pages),
        loop=0,
        quality=QUALITY,
        method=0,  # 2 takes 50 % longer and saves a fifth
        kmin=0,
        kmax=1,  # encode each frame separately: skipped small differences would show as blocks
    )
    return stream.getvalue()


def _times(pages: Sequence[object]) -> list[int]:
    """Return the duration of each frame in ms."""
    return [round(1000 * SECONDS / max(len(pages), 1))] * (len(pages) - 1) + [round(1000 * STANDING)]


def can_mp4() -> bool:
    """Return whether an encoder is installed."""
    return importlib.util.find_spec("imageio_ffmpeg") is not None


def write_mp4(path: Path, images: list[Image]) -> None:
    """Write frames as an H.264 film that every browser plays.

    Raises:
        RuntimeError: The encoder failed.
    """
    import imageio_ffmpeg

    height, width, _ = images[0].shape

    def fill(aside: Path) -> None:
        rate = max(len(images) / SECONDS, 1.0)
        writer = imageio_ffmpeg.write_frames(
            str(aside), (width, height), fps=rate, codec="libx264", quality=7, macro_block_size=2,
            output_params=["-f", "mp4", "-movflags", "+faststart"],
        )  # fmt: skip
        writer.send(None)
        for image in [*images, *[images[-1]] * round(rate * STANDING)]:
            writer.send(np.ascontiguousarray(image))
        writer.close()

    try:
        replace(path, fill)
    except (OSError, StopIteration) as error:
        raise RuntimeError(f"the film could not be encoded ({error})") from error


# ----------------------------------------------------------------------------------------------------------------------
# Make the film in a second process, in parallel with the still pictures.
#
# The process is forked before anything is rendered, because a render window does not survive a fork.


Place = tuple[Path, str]
"""A folder of results, and their name."""
Made = tuple[list[Path], list[str]]
"""The written files, and sentences on skipped ones."""


class Film:
    """The maker of a run's film; as a context manager it ends its process.

    Args:
        beside: Make it in a process of its own, forked at once; else when it is asked for. Only in a program that has not
            rendered.
    """

    def __init__(self, beside: bool):
        self._process = None
        self._place: Place | None = None
        if beside and sys.platform == "linux":
            # Software rendering uses all cores per picture, so the two processes would wait
            # for each other's threads.
            os.environ.setdefault("LP_NUM_THREADS", str(max(cores() // 2 - 1, 0)))
            context = multiprocessing.get_context("fork")
            self._pipe, other = context.Pipe()
            self._process = context.Process(target=_answer_to, args=(other, self._pipe), daemon=True)
            self._process.start()
            other.close()  # otherwise its end would not be detected here

    def __enter__(self) -> Film:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._process is not None and self._process.is_alive():
            self._process.terminate()
            self._process.join()

    def rehearse(self, folder: Path, name: str) -> None:
        """Make its process open a window and render the first states once, without output."""
        self._tell((folder, name), True)

    def begin(self, folder: Path, name: str) -> None:
        """Start making the film, from results into their folder."""
        self._place = (folder, name)
        self._tell(self._place, False)

    def _tell(self, place: Place, rehearsal: bool) -> None:
        if self._process is not None:
            with contextlib.suppress(BrokenPipeError):  # its end is reported when waiting for it
                self._pipe.send((place, rehearsal))

    def made(self) -> Made:
        """Wait for the film.

        Raises:
            OSError: It could not be written.
        """
        assert self._place is not None
        if self._process is None:
            return make(look(States(*self._place)), self._place[0])
        try:
            outcome: Made | OSError = self._pipe.recv()
        except (EOFError, ConnectionResetError):
            self._process.join()
            return [], [f"the film could not be made (its process ended with status {self._process.exitcode})"]
        self._pipe.close()  # ends the process
        self._process.join()
        if isinstance(outcome, OSError):
            raise outcome
        return outcome


def make(shown: Look, folder: Path, wanted: Callable[[], bool] = lambda: True) -> Made:
    """Render the frames and write the film in each format, unless cancelled."""
    frames = render_frames(shown)
    written: list[Path] = []
    left_out: list[str] = []
    encoders = {"film.gif": gif, "film.webp": webp}
    with ThreadPoolExecutor(len(encoders)) as both:  # encoders are written in C and let each other run
        encoded = {name: both.submit(encoder, frames) for name, encoder in encoders.items()}
    for name, data in encoded.items():
        if not wanted():
            return written, left_out
        write_bytes(folder / name, data.result())
        written.append(folder / name)
    if can_mp4() and wanted():
        try:
            write_mp4(folder / "film.mp4", frames)
            written.append(folder / "film.mp4")
        except RuntimeError as error:
            left_out.append(str(error))
    return written, left_out


def _answer_to(pipe: Connection, others: Connection) -> None:
    """Rehearse and make films on request, until the pipe is closed."""
    others.close()  # an open copy here would keep the pipe open after its owner ends
    asked_by = os.getppid()
    while True:
        try:
            place, rehearsal = pipe.recv()
        except EOFError:
            return
        if rehearsal:
            with contextlib.suppress(ResultsError, CaseError, OSError):  # reported when the film is made
                render_frames(look(States(*place)), 1)
            continue
        try:
            # The folder of an aborted drawing may now belong to another run.
            pipe.send(make(look(States(*place)), place[0], lambda: os.getppid() == asked_by))
        except OSError as error:
            pipe.send(error)
        except (ResultsError, CaseError) as error:
            pipe.send(([], [f"the film could not be made ({error})"]))
