"""Quantities of designs; `QUANTITIES` lists them by name."""

from softmodels.design.quantities import composite, forces, gaps, geometric, limits, outline, peaks, places
from softmodels.design.quantities.base import QUANTITIES, DesignQuantity, register_quantity

__all__ = [
    "QUANTITIES",
    "DesignQuantity",
    "composite",
    "forces",
    "gaps",
    "geometric",
    "limits",
    "outline",
    "peaks",
    "places",
    "register_quantity",
]
