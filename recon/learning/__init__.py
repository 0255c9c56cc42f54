"""Section 3 of the report: part-labelled views in, a 3D class model out."""
