"""A body, its one potential, and the solver of its equilibrium."""
