"""Measurements about the method, one module a study; reports/studies draws a page for each."""
