"""What can be added to a device: one file, one physics.

A component is a frozen dataclass that is registered with `register_component`; see `softmodels.mechanics.component`.

- `contact`: planes and rigid shapes, with friction and guides; walls of the device that press on each other. `shapes`: the
  geometry of rigid shapes.
- `pressing`: the penalty energy of walls and shapes: gaps, samples, friction. `touching`: that of two bodies.
- `creases`: folds and creases of a compressed surface, which contact cannot see.
- `fibres`: sheets, fibres and fabrics. `loads`: gravity, masses, forces, moments.
- `rigid`: plates and rings; faces that are held; springs.
"""
