"""Which pictures, measured files and calibrations of plain folders belong together."""
