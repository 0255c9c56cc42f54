"""What people look at: curves, tables, the HTML report and the Rerun recording."""
