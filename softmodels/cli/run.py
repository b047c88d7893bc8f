"""A case run into a folder of results by a command: what is printed, the exit status, and the process that draws.

Exit status: 0 all requested values reached; 1 the run failed; 2 bad input, found before anything was solved; 3 a requested
value is not on the path (a limit point); 130 stopped by the user. In every case all steps so far are in the folder.
"""

from __future__ import annotations

import contextlib
import json
import os
import shlex
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from softmodels.case import materials
from softmodels.case.case import Case
from softmodels.common import commands, processes
from softmodels.common.errors import OWN_MODULES, reason, spoken
from softmodels.common.lazy import MPI, PETSc, consoles, progress
from softmodels.mechanics import mpi
from softmodels.runs import fields, labels, notes, outcomes, recording, store
from softmodels.runs.simulation import accurate


def run(
    case: Case,
    folder: Path | None,
    how: commands.RunOptions = commands.DEFAULT_OPTIONS,
    inputs: Sequence[Path] = (),
    interrupts: Callable[[], contextlib.AbstractContextManager[Callable[[], bool]]] = recording.unstopped,
    drawing: DrawingProcess | None = None,
) -> int:
    """Run a case and return the exit status; all messages go to standard error, the summary to standard output. May be called
    in any thread. `StartError` if PETSc cannot take the words.

    Args:
        folder: Where the results go; None for the first of ``results/NAME``, ``results/NAME-2`` ... that is free or holds
            a run of this very case.
        how: Its options, without ``output`` and ``ranks``.
        inputs: Files that the user has given: they are never written.
        interrupts: Entered while states are solved; gives whether to stop, asked between them. No signal is handled unless
            here, as a command does by `asked_to_stop`.
        drawing: The process that draws, if it has been started; see `DrawingProcess.of`.
    """
    comm = mpi.start(how.petsc)
    quiet, goal = how.quiet or not mpi.is_root(comm), case.load.told(case.values[-1])
    progress = outcomes.Progress(labels.state_labels(case), quiet, case.variable, goal)
    if case.accuracy:
        with progress, interrupts() as stopped:
            case = accurate(case, comm, progress, stopped)
    drawing = drawing or DrawingProcess.of(case, how)
    reporter = Reporter(case, progress, drawing, how)

    @contextlib.contextmanager
    def solving() -> Iterator[Callable[[], bool]]:
        with progress, interrupts() as stopped:
            yield stopped

    place = recording.ResultsPlace(folder, how.resume, inputs, how.draws, how.budget != "none")
    try:
        recording.solved_into(place, case, comm, progress, branch=how.branch, observer=reporter, solving=solving)
    finally:
        if drawing is not None:
            drawing.leave()
    return mpi.on_root(comm, lambda: reporter.status)


class Reporter(recording.Observer):
    """Prints how a run goes on, and has its results drawn at the end; on rank 0. ``status`` is the exit status, once it has
    ended."""

    def __init__(self, case: Case, progress: outcomes.Progress, drawing: DrawingProcess | None, how: commands.RunOptions):
        self.case, self.progress, self.drawing = case, progress, drawing
        self.quiet, self.petsc, self.status = how.quiet, bool(how.petsc), commands.EXIT_DONE

    def opened(self, results: store.Results) -> None:
        self.progress.say(f"writing results to {results.own.path}")

    def begun(self, results: store.Results) -> None:
        if self.drawing is not None:
            self.drawing.begin(results)

    def closed(self, results: store.Results | None, ended: outcomes.Ended, summary: recording.Summary) -> None:
        self.status, message = self._outcome(results, ended)
        if results is None:
            processes.say(f"softmodels: {commands.bounded(message)}", err=True)
            return
        good = bool(results.stored) and self.status != commands.EXIT_BAD_INPUT
        took = self._drawn(results) if good else None
        drawn = "" if self.drawing is None or took is None else f"{self.drawing.made(results.own.path)}, in {took:.1f} s"
        if message:
            states = "1 state" if len(results.stored) == 1 else f"{len(results.stored)} states"
            where = f". The results up to this point ({states}) are in {results.own.path}" if good else ""
            processes.say(f"softmodels: {message}{where}{f': {drawn}' if drawn and not self.quiet else ''}", err=True)
        if self.quiet:
            return
        for note in summary.get("notes", ()):
            processes.say(f"softmodels: note: {note}", err=True)
        if not message:
            _summarise(self.case, results, drawn, summary["stability"])

    def _outcome(self, results: store.Results | None, ended: outcomes.Ended) -> tuple[int, str]:
        """Exit status and sentence; what PETSc refuses before anything is solved are the words it was given."""
        cause = ended.error and ended.error.__cause__
        if not isinstance(cause, PETSc.Error):
            return ended.status, spoken(ended.message)
        if self.petsc and not (results and results.stored):
            return commands.EXIT_BAD_INPUT, f"PETSc stopped ({mpi.petsc_reason(cause)}); check the options after --"
        more = "rerun with -- -snes_monitor -ksp_error_if_not_converged for details"
        return commands.EXIT_FAILED, f"PETSc stopped ({mpi.petsc_reason(cause)}); {more}"

    def _drawn(self, results: store.Results) -> float | None:
        """Draw a run that has not failed; the seconds it took, None where there are no pictures."""
        if self.drawing is None or self.status not in (commands.EXIT_DONE, commands.EXIT_NO_EQUILIBRIUM):
            return None
        if not self.quiet:
            processes.say(self.drawing.begins, err=True)
        return self.drawing.draw(results, self.quiet)


def _summarise(case: Case, results: store.Results, drawn: str, stability: str) -> None:
    """Print the last state of a run that has reached all its values, its stability, and what there is in its folder."""
    for text in (*notes.closing(case, results.rows[-1]), *results.budget(case).lines(), stability):
        if text:
            processes.say(text)
    drawn = f"; {drawn}" if drawn else ""
    processes.say(
        f"{len(results.stored)} states in {results.folder}: path.csv, {results.name}.vtkhdf for ParaView{drawn}{_solved_on()}"
    )


def _solved_on() -> str:
    ranks = MPI.COMM_WORLD.size
    return f"; solved on {ranks} ranks" if ranks > 1 else ""


# ----------------------------------------------------------------------------------------------------------------------
# The process that draws the pictures of a run; it starts with the run to hide its start-up time.


class DrawingProcess:
    """Draws pictures and report of a run in a separate process, because VTK and DOLFINx each bring their own HDF5.

    Loading what draws takes seconds, which the process spends while the path is being solved, if a core is free for that, and
    draws the device at rest there. All else has one camera and one colour scale for all states, and so waits for the last.
    """

    def __init__(self, case: Case, wanted: commands.DrawingOptions = commands.ALL_PICTURES):
        self.case, self.wanted = case, wanted
        self._process: subprocess.Popen[str] | None = None

    @classmethod
    def of(cls, case: Case, how: commands.RunOptions) -> DrawingProcess | None:
        """Return what draws a run, its process started if there are more cores than ranks; None on other ranks than the first,
        and where nothing is drawn."""
        if not (how.draws and mpi.speaks()):
            return None
        drawing = cls(case, how)
        with contextlib.suppress(OSError):  # tried again, and reported, when drawing starts
            if processes.cores() > (mpi.launched() or 1):
                drawing._process = drawing._started()
        return drawing

    @property
    def begins(self) -> str:
        """Return the message before drawing."""
        if self.wanted.few:
            return "drawing curves, stress and report (--pictures all for everything, --pictures none to skip)"
        return "drawing pictures and report (--pictures few for less, --pictures none to skip)"

    def made(self, folder: Path) -> str:
        """Return which files were drawn into a folder, in a few words, and how to get the film."""
        if self.wanted.film:
            return "pictures (*.png), film.gif, film.webp and report.html"
        return f"pictures (*.png) and report.html (the film: softmodels draw {shlex.quote(str(folder))} --film)"

    def _started(self) -> subprocess.Popen[str]:
        wanted = self.wanted
        words = ["--pictures", wanted.pictures, "--colormap", wanted.colormap, *(["--film"] if wanted.film else [])]
        return start_drawing(self.case, "softmodels.pictures.draw", *words)

    def begin(self, results: store.Results) -> None:
        """Draw the pictures of the first state, if the process runs; called once that state is stored."""
        if self._process is not None and not self.wanted.few:
            self._order(results, complete=False)

    def _order(self, results: store.Results, complete: bool) -> None:
        assert self._process is not None and self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):  # the process has died, which is reported at the end
            self._process.stdin.write(json.dumps([str(results.folder.absolute()), results.name, complete]) + "\n")
            self._process.stdin.flush()

    def draw(self, results: store.Results, quiet: bool = False) -> float | None:
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


def start_drawing(case: Case, module: str, *words: str) -> subprocess.Popen[str]:
    """Start a drawing module with words in a separate process, without MPI's environment variables, importing the case's own
    modules there too; `OSError` if no process can be started."""
    command, environment = processes.python(module, *words)
    environment[OWN_MODULES] = materials.own_modules(case, *fields.OUTPUTS.values())
    pipe = subprocess.PIPE
    return subprocess.Popen(command, env=environment, stdin=pipe, stdout=pipe, stderr=pipe, text=True)


def end(process: subprocess.Popen[str]) -> None:
    """End a process if it still runs."""
    if process.poll() is None:
        process.kill()
        process.communicate()


def tell_not_drawn(out: str, errors: str, status: int, left: str) -> None:
    """Report that drawing failed, why, and what is left."""
    reason = (errors or out).strip().splitlines() or [f"exit status {status}"]
    processes.say(f"softmodels: the pictures could not be drawn ({reason[-1]}); {left}", err=True)


def drawn_aside(case: Case, left: str, module: str, *words: str) -> bool:
    """Draw in a separate process, see `start_drawing`; return whether that succeeded, or report what is ``left``."""
    process = start_drawing(case, module, *words)
    try:
        out, errors = process.communicate()
    finally:
        end(process)
    if process.returncode:
        tell_not_drawn(out, errors, process.returncode, left)
    return process.returncode == 0


@contextlib.contextmanager
def _counter(quiet: bool) -> Iterator[Callable[[str], None]]:
    """Show the current step and the elapsed time on a terminal; nothing elsewhere."""
    width = processes.columns("stderr")
    if quiet or width is None:
        yield lambda text: None
        return
    console = consoles.Console(
        stderr=True,
        force_terminal=processes.COLUMNS["stderr"] in os.environ or None,
        width=width,
        markup=False,
        highlight=False,
    )
    parts = progress.TextColumn("{task.description}", markup=False), progress.TimeElapsedColumn()
    with progress.Progress(*parts, console=console, transient=True) as shown:
        task = shown.add_task("drawing", total=None)
        yield lambda text: shown.update(task, description=text)
