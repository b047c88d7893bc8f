"""The shadow and its edge in raw pixels.

Begin with `tracing`: what is measured of a photograph, down to the edge on the screen.

- `shadow`: which pixels are shadow (Mahalanobis distance). `profiles`: light across the edge and the shape fitted to it.
- `edge`: the edge between the pixels, smoothed along its length, with gaps bridged.
"""
