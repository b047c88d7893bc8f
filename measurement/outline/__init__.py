"""From an edge to the outline of one inflated surface above its zero plane, and whether it can be one."""
