"""Tables in parts: frames, detections and candidates as folders of Parquet files, for a million frames."""
