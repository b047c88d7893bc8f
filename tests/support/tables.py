"""Tables of test machines with a single specimen."""

from __future__ import annotations

from softmodels.fitting.curves.curve import TensileCurve, read_curves


def read_curve(*given, **how) -> TensileCurve:
    """Return the only curve of a file; arguments are those of `read_curves`."""
    (curve,) = read_curves(*given, **how)
    return curve
