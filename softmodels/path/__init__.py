"""Following a device along its load path: steps, critical points, branches, cycles, supplies and programs."""
