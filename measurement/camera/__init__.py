"""Photographs as light, and the camera as a map between its pixels and those of an ideal pinhole.

- `pictures`: picture files of any kind as light: decoded, gamma undone, values between pixels.
- `camera`: distortion and its inverse. `lens`: lens profiles of the lensfun project.
"""
