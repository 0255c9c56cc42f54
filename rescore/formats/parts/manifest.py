"""How a folder with a table in parts is recognised, without what reads it."""

from pathlib import Path

MANIFEST = "parts.json"
"""Name of the file that makes a folder a table."""


def is_parts(path: Path) -> bool:
    """Whether a folder holds a table in parts."""
    return path.suffix not in {".json", ".txt"} and (path / MANIFEST).is_file()
