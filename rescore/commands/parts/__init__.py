"""What commands do with tables in parts beside files."""
