"""Section 4 of the report: one box in one picture in, a 3D instance with depth out."""
