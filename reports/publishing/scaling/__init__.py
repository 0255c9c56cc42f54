"""How a run grows with its workers: a recorded trace replayed through a model of a cluster."""
