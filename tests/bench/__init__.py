"""Speed and memory, measured: ``make bench``. Asserts nothing, since a busy machine would fail it.

Each ratio is the median of paired runs on one core: both sides are timed in turn on the same input, so that a
machine that slows down slows both. Names of groups as arguments choose some rows.
"""
