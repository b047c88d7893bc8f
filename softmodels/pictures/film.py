"""The film of a run: the device over its whole path, with fixed camera and colour scale, and the pressure as caption.

A GIF with 256 colours, which plays everywhere; a smaller animated WebP in full colour, which browsers play and
the report shows. An MP4 too if the package imageio-ffmpeg is installed.
"""

from __future__ import annotations

import importlib.util
import io
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from PIL import Image as Picture, ImageDraw, ImageFont

from softmodels.common.files import replace, write_bytes
from softmodels.pictures.offscreen import Image, Look, studio
from softmodels.pictures.style import Scale, load

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
    states, scale = look.states, look.scales["von_mises"]
    last = len(states.rows) - 1
    camera = look.camera(sorted({0, *states.shown(8), states.main, last}), WIDE, tallest=0.75)
    count = count if states.loaded and last else 1
    found = []
    with studio(camera) as shoot:
        for place in np.linspace(0.0, 1.0, count):
            step = float(np.interp(place, states.along, range(last + 1))) if count > 1 else float(last)
            row, words = states.row(step), states.words
            text = f"{load(row, words, kilopascals=False)}   {words.gauge} rise {row[f'{words.gauge}_mm']:+.2f} mm"
            found.append(_captioned(shoot(look.coloured(step, scale)), text, scale))
    return found


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


def make(shown: Look, folder: Path) -> tuple[list[Path], str]:
    """Render the frames and write the film in each format into a folder.

    Returns:
        The written files, and a sentence if a format was left out.
    """
    frames = render_frames(shown)
    encoders = {"film.gif": gif, "film.webp": webp}
    with ThreadPoolExecutor(len(encoders)) as both:  # encoders are written in C and let each other run
        encoded = {name: both.submit(encoder, frames) for name, encoder in encoders.items()}
    for name, data in encoded.items():
        write_bytes(folder / name, data.result())
    written = [folder / name for name in encoders]
    if can_mp4():
        try:
            write_mp4(folder / "film.mp4", frames)
        except RuntimeError as error:
            return written, str(error)
        written.append(folder / "film.mp4")
    return written, ""
