"""Triangle meshes: solids, lofts, materials and textures that all objects are built of."""
