"""What designs are judged by, one idea a file; `QUANTITIES` has them by name."""

from softmodels.design.quantities import composite, forces, gaps, geometric, limits, outline, peaks, places, volumes
from softmodels.design.quantities.base import QUANTITIES, Quantity, quantity

__all__ = [
    "QUANTITIES",
    "Quantity",
    "composite",
    "forces",
    "gaps",
    "geometric",
    "limits",
    "outline",
    "peaks",
    "places",
    "quantity",
    "volumes",
]
