"""Fits to curves of test machines."""
