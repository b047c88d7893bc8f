"""Names of regions: short words, from whatever other programs call a solid or a set of cells."""

from __future__ import annotations

import re
import unicodedata


def region_name(text: str) -> str:
    """A name of small letters, digits and ``_`` that begins with a letter: "Base plate (2)" is ``base_plate_2``."""
    plain = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    name = re.sub(r"\W+", "_", plain).strip("_").lower()
    return name if re.match(r"[a-z]", name) else f"region_{name}".rstrip("_")
