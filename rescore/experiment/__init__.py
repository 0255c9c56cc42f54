"""The whole experiment as cached stages, from rendered scenes to the report."""
