"""Which parameters of a dear test run by default, and which only in campaigns."""

from __future__ import annotations

from collections.abc import Container, Iterable
from typing import Any

import pytest


def sampled(values: Iterable[Any], by_default: int | Container[Any] = 1) -> list[Any]:
    """Return the parameters of a test, of which campaigns alone run all.

    Args:
        values: Of ``parametrize``: of one argument, or tuples of several.
        by_default: How many of the first run by default, or which ones.
    """
    return [
        value
        if (k < by_default if isinstance(by_default, int) else value in by_default)
        else pytest.param(*(value if isinstance(value, tuple) else [value]), marks=pytest.mark.campaign)
        for k, value in enumerate(values)
    ]
