"""Names of what is drawn of a design."""

from __future__ import annotations

CAPTIONS = {
    "shapes.png": "The device as given and the design, both at the largest pressure: one camera, one colour scale",
    "sections.png": "Half sections at rest and at the largest pressure",
    "paths.png": "Both paths",
    "parameters.png": "The free parameters within their bounds",
    "history.png": "The designs in the order of their evaluation",
}
"""Pictures in the order of the page, with what they show."""
REPORT = "report.html"
FILES = (*CAPTIONS, REPORT)
