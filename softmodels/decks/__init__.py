"""A case for other programs: the same mesh, silicones, supports and loads in CalculiX's and in FEBio's words."""
