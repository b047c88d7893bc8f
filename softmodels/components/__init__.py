"""What can be added to a device: one file, one physics.

A component is a frozen dataclass that is registered with `register_component`; see `softmodels.mechanics.component`.

- `contact`: planes and rigid shapes, with friction and guides. `walls`: walls of the device that press on each other.
- `pressing`: the penalty energy that both share: gaps, samples, friction.
- `fibres`: fibres and fabrics. `sheets`: membranes bonded to a face. `loads`: gravity, masses, forces, moments.
- `rigid`: plates and rings. `clamps`: faces that are held.
"""
