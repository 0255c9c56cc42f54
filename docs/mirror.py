"""Lays the site out as the repository is, so that a link that works in the one works in the other.

Called by the site generator. Pages of ``docs/`` keep that folder in their address, and the pages beside it
(README, published results) join them where they lie.
"""

from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parent.parent
PAGES = (
    *("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "LICENSE", "CITATION.cff"),
    "examples/real_street/README.md",
)
"""Single files of the repository that the site shows."""
FOLDERS = ("docs", "reports/published")
"""Folders that it shows whole, but for code."""


def on_files(files: Files, config: Any) -> Files:
    """The files of the site: those of the theme as they are, all others by their path in the repository."""
    # what does not lie in docs/ comes from the theme or a plugin
    kept = [f for f in files if f.src_dir != config["docs_dir"]]
    found = [ROOT / page for page in PAGES]
    for folder in FOLDERS:
        found += (p for p in sorted((ROOT / folder).rglob("*")) if p.is_file() and p.suffix != ".py")
    return Files([*kept, *(_file(path, config) for path in found if "__pycache__" not in path.parts)])


def _file(path: Path, config: Any) -> File:
    return File(
        path.relative_to(ROOT).as_posix(), str(ROOT), config["site_dir"], config["use_directory_urls"]
    )
