"""What is run to make the published pages and pictures; not part of an installed package."""
