"""A case for other programs.

- `deck`: the same mesh, silicones, supports and loads. `calculix`, `febio`: in the words of each program.
"""
