"""Detections, rescoring with stereo depth (eqs. 6 and 7) and evaluation."""
