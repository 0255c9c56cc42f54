"""The parametric car and imported car meshes, with the parts that class models are learned from."""
