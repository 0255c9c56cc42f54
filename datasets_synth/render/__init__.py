"""Rays to bytes: a scene in, a stereo pair with its truth out."""
