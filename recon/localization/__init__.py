"""Section 5.1 of the report: where an object stands and how large it is, from one picture of a known ground."""
