"""Simulation of pneumatic soft actuators on FEniCSx: from a case to a load path that ends in results, not in divergence."""

__version__ = "0.1.0"
