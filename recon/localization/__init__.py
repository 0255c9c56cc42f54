"""Section 5.1 of the report: the place and size of an object, from one picture of a known ground."""
