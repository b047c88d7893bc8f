"""A case for other programs: the same mesh, silicone, supports and pressures in CalculiX's and in FEBio's words."""
