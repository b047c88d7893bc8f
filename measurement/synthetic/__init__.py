"""A photographer whose truth is known, and everything that can go wrong on a bench."""
