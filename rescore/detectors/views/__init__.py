"""Detectors of cars in all views: one score a view bin over shared features, so that a find has a view."""
