"""A street: ground, houses, furniture, vehicles, look-alikes, light, and the frame drawn of them."""
