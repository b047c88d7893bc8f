"""The plane of the screen: from a grid, a board or known points, and whether it moved.

- `setup`: what stays the same over a run of photographs, one TOML file; the homography from pixels to metres.
- `grid`: the printed grid, found without a click.
- `look`: the grid in each further photograph: has camera or screen moved, is the screen flat?
- `calibration`: a camera from photographs of a chessboard; a setup from one photograph, as a call.
"""
