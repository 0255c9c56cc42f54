"""How a folder with a table in parts is recognised, without what reads it."""

from pathlib import Path

from recon.errors import RescoreError

MANIFEST = "parts.json"
"""Name of the file that makes a folder a table."""


def is_parts(path: Path) -> bool:
    """Whether a folder holds a table in parts."""
    return path.suffix not in {".json", ".txt"} and (path / MANIFEST).is_file()


def refuse_data_set(folder: Path, *more: str) -> None:
    """Raises RescoreError where a folder holds a data set, a table in parts or a file of ``more`` names."""
    for name in ("annotations.json", MANIFEST, *more):
        if (folder / name).exists():
            raise RescoreError(
                f"{folder / name}: expected no data set here yet, found this file; choose another --out"
            )
