"""What is in the disparity of a car beyond that of a plane, and how much of it a fitted instance finds."""
