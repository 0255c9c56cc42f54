"""The Rerun recording of a run."""
