"""The end of a run's folder: its steps in one file, and a summary of it."""

from __future__ import annotations

import json
from collections.abc import Sequence

from softmodels.case.case import Case
from softmodels.materials.silicones import stretch_at_break
from softmodels.results.row import Row
from softmodels.results.stability_report import events, stability_text
from softmodels.results.state_words import state_words
from softmodels.results.store import Results
from softmodels.results.writing import write_text


def gather(case: Case, results: Results, status: int, message: str, notes: Sequence[str]) -> None:
    """Bring all steps into one file and write ``summary.json``, with the notes of `notes_of`.

    Raises:
        OSError: There is no room; the steps stay where they are.
    """
    results.finish()
    words = state_words(case)
    text = {
        "status": status, "message": message, "steps": len(results.stored), "last": results.rows[-1].cells,
        "events": events(results.rows, words), "stretch_at_break": stretch_at_break(case.material),
        "notes": list(notes), "stability": stability_text(results.rows, case.actuator, words, branch_rows(results)),
    }  # fmt: skip
    results.own.claim(["summary.json"])
    write_text(results.folder / "summary.json", json.dumps(text, indent=2) + "\n")


def branch_rows(results: Results) -> list[Row]:
    """The rows of the branch that was followed; none if none was."""
    branch = results.branch()
    if branch.heavy.exists():
        branch.load()
    return branch.rows


def not_gathered(error: Exception) -> str:
    """Why the steps stay in files of their own, and what to do."""
    return (
        f"the steps could not be gathered in one file ({getattr(error, 'strerror', None) or error}); "
        "make room and run again with --resume"
    )
