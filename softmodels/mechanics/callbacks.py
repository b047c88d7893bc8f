"""Callbacks that PETSc may keep without keeping alive what they belong to."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from petsc4py import PETSc

type Product[A] = Callable[[A, PETSc.Vec, PETSc.Vec], None]


def weakly[**P, T](method: Callable[P, T]) -> Callable[P, T]:
    """Return a function that calls a bound method without holding its object.

    PETSc's objects hold what they call. If that in turn holds them, the two are a cycle that Python's collector cannot see
    through PETSc, and neither memory nor MPI's communicators are ever given back.

    Raises:
        ReferenceError: On a call after the object is gone.
    """
    reference = weakref.WeakMethod(method)

    def call(*arguments: P.args, **named: P.kwargs) -> T:
        bound = reference()
        if bound is None:
            raise ReferenceError("the object that this callback belonged to has been given back")
        return bound(*arguments, **named)

    return call


class Shell:
    """Context of a PETSc shell matrix and shell preconditioner whose products are methods of an object that owns both."""

    def __init__(self, mult: Product[PETSc.Mat], apply: Product[PETSc.PC]):
        self.mult, self.apply = weakly(mult), weakly(apply)
