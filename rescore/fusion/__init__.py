"""Eq. 7 of the report: detector and depth evidence put together, and the choice of its weight w."""
