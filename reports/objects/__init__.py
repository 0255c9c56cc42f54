"""Objects in 3D as files: meshes with texture, pop-ups, overlays."""
