"""The process that draws the pictures of a run; it starts with the run to hide its start-up time."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from geometries.apart import interpreter
from softmodels.case.case import Case
from softmodels.case.own_modules import VARIABLE, own_modules
from softmodels.common.errors import reason
from softmodels.common.processes import cores
from softmodels.common.terminal import COLUMNS, columns, say
from softmodels.runs.fields import OUTPUTS
from softmodels.runs.store import Results


def start_drawing(case: Case, module: str, *words: str) -> subprocess.Popen[str]:
    """Start a drawing module in a separate process, without MPI's environment variables.

    Args:
        case: What is drawn; its own modules are imported there too.
        module: Its name.
        words: What it is given.

    Raises:
        OSError: No process can be started.
    """
    inherited = {k: v for k, v in os.environ.items() if not k.startswith(("PMI", "HYDRA", "MPI", "OMPI", "PMIX"))}
    inherited[VARIABLE] = own_modules(case, *OUTPUTS.values())
    pipe = subprocess.PIPE
    return subprocess.Popen(
        [*interpreter(), "-m", module, *words], env=inherited, stdin=pipe, stdout=pipe, stderr=pipe, text=True
    )


def end(process: subprocess.Popen[str]) -> None:
    """End a process if it still runs."""
    if process.poll() is None:
        process.kill()
        process.communicate()


def tell_not_drawn(out: str, errors: str, status: int, left: str) -> None:
    """Report that drawing failed, why, and what is left."""
    reason = (errors or out).strip().splitlines() or [f"exit status {status}"]
    say(f"softmodels: the pictures could not be drawn ({reason[-1]}); {left}", err=True)


@contextlib.contextmanager
def _counter(quiet: bool) -> Iterator[Callable[[str], None]]:
    """Show the current step and the elapsed time on a terminal; nothing elsewhere."""
    width = columns("stderr")
    if quiet or width is None:
        yield lambda text: None
        return
    from rich.console import Console
    from rich.progress import Progress, TextColumn, TimeElapsedColumn

    console = Console(
        stderr=True, force_terminal=COLUMNS["stderr"] in os.environ or None, width=width, markup=False, highlight=False
    )
    with Progress(
        TextColumn("{task.description}", markup=False), TimeElapsedColumn(), console=console, transient=True
    ) as shown:
        task = shown.add_task("drawing", total=None)
        yield lambda text: shown.update(task, description=text)


class DrawingProcess:
    """Draws pictures, film and report of a run in a separate process, because VTK and DOLFINx each bring their own HDF5.

    Loading what draws takes seconds, which the process spends while the path is being solved, if a core is free for that, and
    draws the device at rest there. All else has one camera and one colour scale for all states, and so waits for the last.

    Args:
        case: What is run.
        few: Draw only the curves, the stress and the report.
    """

    def __init__(self, case: Case, few: bool = False):
        self.case, self.few = case, few
        self._process: subprocess.Popen[str] | None = None

    @property
    def begins(self) -> str:
        """Return the message before drawing."""
        if self.few:
            return "drawing curves, stress and report (--pictures all for everything, --pictures none to skip)"
        return "drawing pictures, film and report (--pictures few for less, --pictures none to skip)"

    @property
    def made(self) -> str:
        """Return which files were drawn, in a few words."""
        return f"pictures (*.png){'' if self.few else ', film.gif, film.webp'} and report.html"

    def get_ready(self, ranks: int) -> None:
        """Start the process, if there are more cores than ranks."""
        with contextlib.suppress(OSError):  # tried again, and reported, when drawing starts
            if cores() > ranks:
                self._process = self._started()

    def _started(self) -> subprocess.Popen[str]:
        return start_drawing(self.case, "softmodels.pictures.draw", *(["--pictures", "few"] if self.few else []))

    def begin(self, results: Results) -> None:
        """Draw the pictures of the first state, if the process runs; called once that state is stored."""
        if self._process is not None and not self.few:
            self._order(results, complete=False)

    def _order(self, results: Results, complete: bool) -> None:
        assert self._process is not None and self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):  # the process has died, which is reported at the end
            self._process.stdin.write(json.dumps([str(results.folder.absolute()), results.name, complete]) + "\n")
            self._process.stdin.flush()

    def draw(self, results: Results, quiet: bool = False) -> float | None:
        """Draw the results; return the seconds it took, or None if it failed, which is reported.

        On a terminal the files are counted as they are drawn, beside the time, unless ``quiet``.
        """
        begun = time.monotonic()
        try:
            process = self._process = self._process or self._started()
        except OSError as error:
            tell_not_drawn("", reason(error), 0, "the results are complete")
            return None
        self._order(results, complete=True)
        out, errors = self._followed(process, quiet)
        if process.returncode == 0:
            print(errors, end="", file=sys.stderr)  # such as that this machine cannot render
            return time.monotonic() - begun
        tell_not_drawn(out, errors, process.returncode, "the results are complete")
        return None

    def _followed(self, process: subprocess.Popen[str], quiet: bool) -> tuple[str, str]:
        """Collect the output of a drawing process until it ends: the files drawn, and errors."""
        assert process.stdin is not None and process.stdout is not None and process.stderr is not None
        with contextlib.suppress(BrokenPipeError):
            process.stdin.close()
        drawn = []
        with ThreadPoolExecutor(1) as beside, _counter(quiet) as show:
            errors = beside.submit(process.stderr.read)
            for line in process.stdout:
                drawn.append(line)
                show(f"drawn: {len(drawn)} files, the last {Path(line.strip()).name}")
            process.wait()
            return "".join(drawn), errors.result()

    def leave(self) -> None:
        """End the process in any state."""
        if self._process is not None:
            end(self._process)
