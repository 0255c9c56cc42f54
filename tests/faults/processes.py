"""Processes that a process started, and whether they run, as Linux tells."""

from pathlib import Path


def descendants(process: int) -> list[int]:
    """Processes that a process started, and what they started."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(stat.read_text().rpartition(")")[2].split()[1])
        except OSError:
            continue
        if parent == process:
            found += [int(stat.parent.name), *descendants(int(stat.parent.name))]
    return found


def alive(process: int) -> bool:
    """Whether a process runs; one that only waits to be asked for its exit code does not."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
