"""Callbacks that PETSc may keep without keeping alive what they belong to."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import Any


def weakly(method: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function that calls a bound method without holding its object.

    PETSc's objects hold what they call. If that in turn holds them, the two are a cycle that Python's collector cannot see
    through PETSc, and neither memory nor MPI's communicators are ever given back.

    Raises:
        ReferenceError: On a call after the object is gone.
    """
    reference = weakref.WeakMethod(method)

    def call(*arguments: Any) -> Any:
        bound = reference()
        if bound is None:
            raise ReferenceError("the object that this callback belonged to has been given back")
        return bound(*arguments)

    return call


class Shell:
    """Context of a PETSc shell matrix and shell preconditioner whose products are methods of an object that owns both."""

    def __init__(self, mult: Callable[..., Any], apply: Callable[..., Any]):
        self.mult, self.apply = weakly(mult), weakly(apply)
