"""From a case to a run: solving it state by state, keeping it in a folder or in memory, and the calls of a notebook."""
