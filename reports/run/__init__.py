"""A run made ready to show: tables, curves, frames and words that the report and the recording share."""
