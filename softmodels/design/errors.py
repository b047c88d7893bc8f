"""What can go wrong with a design: a problem that cannot be meant, and a device that has no state where it is asked."""

from __future__ import annotations


class DesignError(ValueError):
    """Bad input, found before anything is solved; the message is a sentence for the user."""


class DesignFailure(RuntimeError):
    """A design that cannot be judged: no device, or no state at a pressure it is asked at; the message says why."""


class DesignStopped(Exception):
    """The user asked to stop; all that was evaluated is kept."""
