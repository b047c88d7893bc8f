"""Curves of test machines as measurements."""
