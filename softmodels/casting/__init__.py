"""The mould of a device: bodies to print or mill, and what the bench has to know to cast with them."""
