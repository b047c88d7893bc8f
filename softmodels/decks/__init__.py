"""A case, or what a run found, for other programs.

- `deck`: the same mesh, silicones, supports and loads, in the words of CalculiX and FEBio.
- `reduction`: a run reduced to its tip. `chains`: that as tables, and in the words of MuJoCo, SOFA and FONSim.
"""
