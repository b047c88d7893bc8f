"""The commands of ``python -m measurement``."""
