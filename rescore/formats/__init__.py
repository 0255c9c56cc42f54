"""Reading and writing data sets and detections."""
