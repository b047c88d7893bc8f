"""A case for other programs.

- `deck`: the same mesh, silicones, supports and loads. `programs`: in the words of CalculiX and FEBio.
"""
