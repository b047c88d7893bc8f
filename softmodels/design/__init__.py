"""Design: from what a device should do to its shape, and from its shape to the mould that it is cast in."""
