"""Which parameters of a dear test run by default, and which only in campaigns."""

from __future__ import annotations

from collections.abc import Container, Iterable
from typing import Any

import pytest


def sampled(values: Iterable[Any], by_default: int | Container[Any] = 1, *, whole: bool = False) -> list[Any]:
    """Return the parameters of a test, of which campaigns alone run all.

    Args:
        values: Of ``parametrize`` or of a fixture's ``params``.
        by_default: How many of the first run by default, or which ones.
        whole: A tuple is the value of one argument; otherwise it has the values of several.
    """
    return [
        value
        if (k < by_default if isinstance(by_default, int) else value in by_default)
        else pytest.param(*(value if isinstance(value, tuple) and not whole else [value]), marks=pytest.mark.campaign)
        for k, value in enumerate(values)
    ]
