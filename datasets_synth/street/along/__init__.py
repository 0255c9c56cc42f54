"""Streets seen along their length: roads, traffic, plants and fronts at both sides, and their truth."""
