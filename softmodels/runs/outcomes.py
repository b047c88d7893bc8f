"""How a run ends, with which exit status, and what it says while it works."""

from __future__ import annotations

import dataclasses
import os
import sys
import time
from html import escape
from typing import TYPE_CHECKING

from softmodels.common import commands, errors, processes
from softmodels.common.lazy import consoles, progress
from softmodels.mechanics import body, compiling, mpi

if TYPE_CHECKING:
    from collections.abc import Callable

    from IPython.display import DisplayHandle

    from softmodels.runs import labels, table


INTERRUPTED = "stopped by the user; continue with --resume"

NO_MEMORY = "out of memory; use a larger --cell-size, or a smaller slice of the device"


def no_memory(error: MemoryError) -> str:
    """Return the message for a memory that is or would be full."""
    return str(error) if isinstance(error, mpi.TooLargeError) else NO_MEMORY


class RunError(errors.OptionMessage, RuntimeError):
    """A run failed; ``status`` is the exit status, the message is for the user."""

    def __init__(self, message: str, status: int = commands.EXIT_FAILED):
        super().__init__(message)
        self.status = status


class PathEnded(RunError):
    """A requested value is not on the path, or the continuation failed; the states so far are valid."""


class UnwrittenError(RunError):
    """States, or a mesh, that could not be written."""


@dataclasses.dataclass(frozen=True)
class Ended:
    """How a run ended: its exit status on a command line, and the sentence there; none if all was reached.

    The sentence has options as the command line has them; see `softmodels.common.errors.spoken`.
    """

    status: int = commands.EXIT_DONE
    message: str = ""
    error: Exception | None = dataclasses.field(default=None, compare=False)

    @classmethod
    def by(cls, error: Exception) -> Ended:
        """The end by an error whose message is a sentence for the user; all but runs and meshers were given bad input."""
        is_run = isinstance(error, errors.MeshingError | body.BodyError | compiling.CompilingError)
        status = error.status if isinstance(error, RunError) else commands.EXIT_FAILED if is_run else commands.EXIT_BAD_INPUT
        return cls(status, errors.written(error), error)


# ----------------------------------------------------------------------------------------------------------------------
# What a run says while it works: a bar on a terminal or in a notebook, a line per step in a log, nothing when quiet.


class Listener:
    """Receives the progress of a run; passes on each row to a function, if one is given, in the columns of ``path.csv``."""

    def __init__(self, told: Callable[[dict[str, float]], object] | None = None):
        self.told = told

    def say(self, text: str) -> None:
        """Report a sentence on the current step."""

    def step(self, row: table.Row, share: float) -> None:
        """Report a solved state: its row of the table, and its share of the last requested value."""
        if self.told is not None:
            self.told(row.written)


class Progress(Listener):
    """Reports the progress of a path towards its last requested value, unless quiet: of a variable of the table to its
    ``goal``, a text."""

    def __init__(self, words: labels.StateLabels, quiet: bool, variable: str = "", goal: str = ""):
        self.words, self.quiet, self.variable, self.goal = words, quiet, variable, goal
        self.started = time.monotonic()
        self._console: consoles.Console | None = None
        self._bar: progress.Progress | None = None
        self._cell: DisplayHandle | None = None
        self._done = 0.0
        self._first: tuple[float, float] | None = None

    def __enter__(self) -> Progress:
        if processes.in_notebook() and not self.quiet:
            from IPython.display import HTML, display

            self._cell = display(HTML(""), display_id=True)
            return self
        width = processes.columns("stderr")
        if self.quiet or sys.stderr is None or width is None:
            return self  # a log has no bar, so rich need not be imported

        self._console = consoles.Console(
            stderr=True, highlight=False, markup=False, emoji=False,
            force_terminal=processes.COLUMNS["stderr"] in os.environ or None, width=width,
        )  # fmt: skip
        self._console.on_broken_pipe = self._hush  # type: ignore[method-assign]
        if self._console.is_terminal:
            parts = (
                progress.TextColumn("{task.description}"),
                progress.BarColumn(),
                progress.TimeElapsedColumn(),
                progress.TextColumn("left"),
                progress.TimeRemainingColumn(),
            )
            self._bar = progress.Progress(*parts, console=self._console)
            self._task = self._bar.add_task("starting", total=1.0)
            self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def say(self, text: str) -> None:
        """Report a line on the current step."""
        if self.quiet:
            return
        if self._cell is not None:
            from IPython.display import HTML

            bar = f'<progress value="{self._done:.6g}" max="1" style="width:20em"></progress>'
            self._cell.update(HTML(f"{bar} {escape(errors.spoken(text))}"))
            return
        try:
            if self._console is not None:
                self._console.print(processes.wrapped(errors.spoken(text), self._console.width))
            else:
                print(errors.spoken(text), file=sys.stderr, flush=True)
        except (OSError, ValueError):  # writing to a closed stream raises ValueError
            self._hush()

    def _hush(self) -> None:
        """Stop reporting if the stream is closed or its disk is full: the run goes on, where rich would end the program."""
        self.quiet = True
        if self._console is not None:
            self._console.quiet = True

    def step(self, row: table.Row, share: float) -> None:
        """Report a step: its row of the table, and its share of the last requested value."""
        gauge, done = self.words.gauge, max(0.0, min(share, 1.0))
        if self._cell is not None:
            rise = f"{gauge} rise {row.told(gauge)}"
            spent = f"{row['step'] + 1} states in {time.monotonic() - self.started:.1f} s"
            self._done = done
            self.say(f"{row.told(self.variable)} of {self.goal}: {rise}, {spent}")
            return
        volume = f"{row.told('added_volume', '+8.3f')}  " if self.words.volume else ""
        when = f"{row.told('time', '8.3g')}  " if "time" in row else ""
        text = (
            f"step {row['step']:3d}  {when}{self.words.under(row, row.told('pressure', '8.3f'))}  "
            f"{gauge} rise {row.told(gauge, '+8.3f')}  {volume}{row['newton_iterations']:2d} iterations"
        )
        if self._bar is not None:
            self.say(text)  # above the bar, where it stays
            self._bar.update(self._task, completed=done, description=f"{row.told(self.variable)} of {self.goal}")
            return
        now = time.monotonic()
        if self._first is None:
            self._first = (now, share)  # the time of meshing and compiling does not predict that of the steps
        since, first = self._first
        left = (now - since) * (1.0 - share) / (share - first) if share > first else None
        self.say(f"{text}  {now - self.started:6.1f} s{processes.time_left(left)}")
