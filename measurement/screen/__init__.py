"""The screen's plane: from a grid, a board or known points, and whether it is where it was."""
