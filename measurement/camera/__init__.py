"""Pictures as light, and the camera as a map between its pixels and those of an ideal pinhole."""
