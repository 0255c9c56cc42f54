"""Objects of other classes: chairs, bicycles, airplanes, baskets; and the list of all classes."""
