"""Scenes of the photographer that several files of tests look at."""

import dataclasses

from measurement import photographer

COARSE = dataclasses.replace(photographer.SCENE, width=1200, height=800, focal_px=2100.0, pixel_size=40e-6)
"""The demonstration's, with a quarter of its pixels."""
