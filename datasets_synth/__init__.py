"""Rendered stereo street scenes with truth, and part-labelled views for the class model."""
