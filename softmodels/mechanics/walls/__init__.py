"""Contact of deformable walls with each other: an energy of the smooth gap between their deformed surfaces."""
