"""Synthetic photographs of known truth, for demonstrations and tests.

- `photographer`: camera, screen, lamps, bodies and boards; the light in each pixel.
"""
