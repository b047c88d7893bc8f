"""Parts drawn or meshed elsewhere: STEP files, and meshes of other programs.

- `step`: `ImportedActuator`, a STEP file. `mesh`: `ImportedMesh`, a mesh file of Gmsh, Abaqus or CalculiX, or STL surfaces.
- `part`: what both have in common: faces and points chosen by short texts, names of regions, labels of STEP faces.
"""
