"""Parts drawn or meshed elsewhere: STEP files, and meshes of other programs."""
