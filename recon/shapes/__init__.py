"""Shapes of outlines: how alike two are, and the warp from one to the other."""
