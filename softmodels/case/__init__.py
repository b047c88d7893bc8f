"""A case: everything that decides a run's numbers, and its way to and from text."""
