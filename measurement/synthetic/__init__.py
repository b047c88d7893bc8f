"""Synthetic photographs of known truth, with all kinds of bench errors."""
