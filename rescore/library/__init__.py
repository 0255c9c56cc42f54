"""What a program calls with its own arrays: the rescorer, its inputs, its files."""
