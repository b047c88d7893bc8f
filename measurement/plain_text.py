"""Names of files in pictures, as they are: matplotlib takes dollars for formulas and leaves some labels out of legends."""

from __future__ import annotations


def plain(text: str) -> str:
    """A text that matplotlib shows letter by letter; what cannot be shown, such as a line's end, is a space."""
    shown = "".join(letter if letter.isprintable() else " " for letter in text).replace("$", r"\$")
    return f" {shown}" if shown.startswith("_") else shown
