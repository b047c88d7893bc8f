"""From an edge to the outline of an inflated surface above its zero plane.

- `outline`: points in metres with standard errors; the file. `zero`: the zero plane from which heights count.
- `shape`: what the edge's shape shows: where it lies beside the bulge, its turns and ripples.
"""
