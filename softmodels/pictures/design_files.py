"""File names of a design's pictures."""

from __future__ import annotations

CAPTIONS = {
    "shapes.png": "The given and the optimised device at the largest pressure: same camera, same colour scale",
    "sections.png": "Half sections at rest and at the largest pressure",
    "paths.png": "Both paths",
    "parameters.png": "The free parameters within their bounds",
    "history.png": "The designs in the order of their evaluation",
}
"""Pictures in the order of the report, with their captions."""
REPORT = "report.html"
FILES = (*CAPTIONS, REPORT)
