"""Fits to outlines and heights of an inflated device."""
