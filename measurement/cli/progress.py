"""The bar that commands of the measurement show on a terminal while they work."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator


@contextlib.contextmanager
def bar(words: str, total: int, quiet: bool) -> Iterator[Callable[[], None]]:
    """Show a bar with the time taken and left, on a terminal only; gone at the end of the block.

    Args:
        words: What is done.
        total: Number of its steps.
        quiet: Show nothing.

    Yields:
        A function to call at each step.
    """
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    console = Console(stderr=True, quiet=quiet)
    parts = (
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("left"),
        TimeRemainingColumn(),
    )  # fmt: skip
    with Progress(*parts, console=console, disable=quiet or not console.is_terminal, transient=True) as shown:
        task = shown.add_task(words, total=total)
        yield lambda: shown.advance(task)
