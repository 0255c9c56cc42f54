"""Measured depth: disparity of a rectified pair, the ground plane in it, and how far it can be trusted."""
