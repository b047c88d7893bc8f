"""A case, or what a run found, for other programs.

- `deck`: the same mesh, silicones, supports and loads, in the words of CalculiX.
- `reduction`: a run reduced to its tip. `chains`: that as tables, for MuJoCo, and as an FMU, whose program is `tip_unit`.
  `hand`: several such chains on a wrist. `chain_check`: the chain in MuJoCo against the device.
"""
