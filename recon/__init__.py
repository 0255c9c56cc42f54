"""3D class models and single-image reconstruction (Chiu, Kaelbling, Lozano-Perez 2009, sections 3 and 4)."""
