"""Outlines and heights of an inflated device as measurements."""
