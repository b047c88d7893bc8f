"""What makes a grid, and the error of a picture that shows none."""

FEWEST = 6
"""Crossings that make a grid: the thesis' six points, two more than a homography needs."""


class GridError(ValueError):
    """A picture in which no grid or board can be trusted; the message is a sentence for the user."""
