"""Calibration files of other tools, what they say of cameras as they stand, and rectification by it."""
