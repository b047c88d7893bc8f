"""Draw the pictures of runs on the pages again, small: ``uv run python docs/pictures.py [NAME ...]``.

Each is a default picture of a command's run, or of what the commands of its page write.
"""

import re
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path

import matplotlib
import numpy as np
from PIL import Image

from softmodels.cli.examples import BENCH

DISK, RUN = ("softmodels.disk",), ("softmodels", "run", "--device")
BALL = '[contact.ball]\nshape = "sphere"\nfaces = "top"\nat = ["0 mm", "0 mm", "26.5 mm"]\nradius = "10 mm"\n'
GUIDED = BALL + 'guide = "z"\nspring = "50 N/m"\nmass = "20 g"\n[gravity]\ndirection = "-z"\n'
TABLE = '[contact.table]\nshape = "plane"\nfaces = "bottom, tip"\nat = ["0 mm", "0 mm", "-4.5 mm"]\nalong = [0, 0, 1]\n'
TABLE += "friction = 0.6\n"
CASE = 'name = "case"\n[geometry]\ndevice = "{}"\n[load]\npressure_cm = {}\n'
RUNS: dict[tuple[str, ...], tuple[str, ...] | str] = {
    ("disk",): (*DISK, "--pressure-cm", "0:177"),
    ("balloon",): (*RUN, "Balloon", "--volume-ml", "0:40:10"),
    ("bellows",): (*RUN, "Bellows", "--pressure-cm", "0:30"),
    ("membrane",): (*RUN, "Membrane", "--volume-ml", "0:20:5"),
    ("cylinder",): (*RUN, "Cylinder", "--pressure-cm", "0:40"),
    ("beam",): (*RUN, "Beam", "--gravity", "-z", "--weight-share", "0,0.25,1"),
    ("bending-bellows",): (*RUN, "BendingBellows", "--pressure-cm", "0,10,25"),
    ("pneunet", "pneunet-stress"): (*RUN, "PneuNet", "--pressure-cm", "0,3,6,9"),
    ("contact-ball",): CASE.format("HollowDisk", "[0, 20, 40, 60]") + BALL,
    ("contact-lifted",): CASE.format("HollowDisk", "[0, 30, 50, 70, 90]") + GUIDED,
    ("contact-friction",): CASE.format("PneuNet", "[0, 6, 12]") + TABLE,
    ("network",): (*RUN, "ChannelPlate", "--pressure-cm", "0:60"),
    ("suction-cup",): BENCH["cup.toml"],
    ("grasp",): BENCH["grasp.toml"],
    ("seminar", "lift"): ("softmodels.seminar", "--pressure-cm", "0,70,130,177"),
}
"""The pages' pictures, and the command or the case of their run."""
FROM = {"disk": "cut", "pneunet": "cut", "seminar": "cut", "contact-friction": "stress-2", "grasp": "grasp"}
"""The run's picture, if it is not the stress at the shown pressures."""
PAGES = Path(__file__).parent / "pages"
WRITTEN = {
    "tutorials/first-hour.md": {
        "hour-heights": "outlines/heights.png",
        "hour-fit": "results/fit/outlines-yeoh.png",
        "hour-predicted": "results/predicted/apex.png",
        "fit": "results/fit/outlines-yeoh.png",
    },
    "howto/fit-memory.md": {"memory-creep": "results/held/creep-yeoh.png"},
    "howto/design.md": {"design": "results/higher/shapes.png"},
}
"""Pictures that the commands of a page write."""
WIDE = 1000


def draw(names: tuple[str, ...], run: tuple[str, ...] | str, folder: Path) -> None:
    """Run a command or a case and write its pictures on the pages."""
    if isinstance(run, str):
        (folder / "case.toml").write_text(run)
        verb = ("grasp", "--load", "8mN") if names == ("grasp",) else ("run",)
        run = ("softmodels", *verb, str(folder / "case.toml"))
    done = subprocess.run([sys.executable, "-m", *run, "--quiet", "-o", folder / "run"], check=False)
    assert done.returncode in (0, 3), names  # 3: the path ends, as at a cup's leak
    for name in names:
        shrink(name, folder / "run" / f"{FROM.get(name, 'stress')}.png")


def follow(page: str, pictures: dict[str, str], folder: Path) -> None:
    """Run a page's commands until its pictures are there, and write them on the pages."""
    for line in re.findall("^uv run (.*)", (PAGES / page).read_text(), re.MULTILINE):
        if not all((folder / path).exists() for path in pictures.values()):
            words = re.sub("^(python -m )?", f"{sys.executable} -m ", line)
            subprocess.run(["bash", "-c", words], cwd=folder, check=True)
    for name, path in pictures.items():
        shrink(name, folder / path)


def shrink(name: str, source: Path) -> None:
    """Write a picture on the pages, with few colours."""
    with Image.open(source) as picture:
        small = picture.resize((WIDE, round(picture.height * WIDE / picture.width)), Image.Resampling.LANCZOS)
    of_maps = (matplotlib.colormaps["viridis"](np.linspace(0, 1, 200))[:, :3] * 255).astype(np.uint8).tobytes()
    palette = Image.new("P", (1, 1))
    palette.putpalette(of_maps + bytes([255, 255, 255, *(small.convert("RGB").quantize(55).getpalette() or [])[:165]]))
    few = small.convert("RGB").quantize(palette=palette, dither=Image.Dither.NONE)
    few.save(PAGES / f"img/{name}.png", optimize=True)
    print(name, flush=True)


def asked(names: Iterable[str]) -> bool:
    """Return whether the command line names one of these, or none at all."""
    return len(sys.argv) == 1 or not set(names).isdisjoint(sys.argv[1:])


if __name__ == "__main__":
    for names, run in RUNS.items():
        if asked(names):
            with tempfile.TemporaryDirectory() as folder:
                draw(names, run, Path(folder))
    for page, pictures in WRITTEN.items():
        if asked(pictures):
            with tempfile.TemporaryDirectory() as folder:
                follow(page, pictures, Path(folder))
