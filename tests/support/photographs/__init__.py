"""Photographs whose truth is known, damaged or ray-traced, and what judges their outlines."""
