"""The edge of the shadow in raw pixels, and the outline of an inflated surface above its zero plane.

Begin with `edge`: what is measured of a photograph, down to the edge on the screen.

- `profiles`: which pixels are shadow (Mahalanobis distance); light across the edge and the shape fitted to it.
- `edge`: the edge between the pixels, smoothed along its length, with gaps bridged; traced on the screen.
- `zero`: the zero plane from which heights count; where the edge lies beside the bulge, its turns and ripples.
- `outline`: points in metres with standard errors; the file.
- `dots`: markers on a device: dots of a colour, and AprilTags.
- `silhouette`: a device seen from the side: its outline as a curve, centre line, tip and angle.
"""
