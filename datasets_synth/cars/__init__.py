"""The parametric car and imported car meshes, with the parts that class models are learned from."""

MESH_FORMS = "OBJ, GLB, glTF, PLY, STL or OFF"
"""Forms of the mesh files that are read, in words."""
