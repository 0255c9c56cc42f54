"""A run, evaluated: the match table, the figures, and the words that explain them."""
