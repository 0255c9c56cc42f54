"""Plain folders: the pictures, measured files and calibrations that belong together."""
