"""What can be added to a device: one file, one physics."""
