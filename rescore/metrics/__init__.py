"""Figures of candidates held against annotated cars: arrays in, numbers with intervals out."""
