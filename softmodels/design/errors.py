"""What can go wrong with a design before anything is solved, and what the user may ask for."""

from __future__ import annotations


class DesignError(ValueError):
    """Bad input, found before anything is solved; the message is a sentence for the user."""


class DesignStopped(Exception):
    """The user asked to stop; all that was evaluated is kept."""
