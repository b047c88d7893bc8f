"""How a result shows itself: one line on a terminal, a card with a picture and a table in a notebook."""

from __future__ import annotations

import importlib
from collections.abc import Iterable

from softmodels.common import errors, files

PICTURES = "softmodels.api.views"
"""Draws the pictures. It stands above every room that has results, so it is imported by its name, and only by a notebook."""
type Table = list[tuple[str, str]]
"""Rows of a table: what it is, and its value with the unit."""


class ResultCard:
    """A result that shows itself. A class says what its line, its table and its remarks are; nothing is solved for them."""

    def _line(self) -> str:
        """Return the main figures with their units, in one line."""
        raise NotImplementedError

    def _figures(self) -> Table:
        """Return the rows of the table."""
        return []

    def _remarks(self) -> Iterable[str]:
        """Return the sentences below the table."""
        return ()

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self._line()}>"

    def _repr_html_(self) -> str:
        """Return the card that notebooks show. It never fails: what cannot be shown is a sentence on the card."""
        title, picture = type(self).__name__, ""
        figures: Table = []
        remarks: list[str] = []
        try:
            title, figures = f"{title} {self._line()}", self._figures()
            remarks += map(errors.spoken, self._remarks())
            if drawn := importlib.import_module(PICTURES).picture(self):
                picture = files.data_uri(drawn, "image/webp")
        except Exception as error:  # whatever it is, the result is there and the notebook goes on
            known = isinstance(error, errors.OptionMessage | OSError)
            remarks.append(f"not all can be shown: {error if known else f'{type(error).__name__}: {error}'}")
        return files.render("card.html", "softmodels.common", title=title, figures=figures, remarks=remarks, picture=picture)
