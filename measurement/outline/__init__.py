"""From an edge to the outline of an inflated surface above its zero plane.

- `outline`: points in metres with standard errors; the file. `zero`: the zero plane from which heights count.
- `checks`: can this edge be the outline of one inflated surface? Ripples, a body that moved or sank.
"""
