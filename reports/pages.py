"""A folder with a page, mostly ``README.md``, and the figures that it shows."""

from pathlib import Path

from matplotlib.figure import Figure

from recon.files import atomic_path


def write_page(folder: Path, text: str, name: str = "README.md") -> Path:
    """Write the page of a folder, which is made where it is missing; returns the page."""
    page = folder / name
    with atomic_path(page) as beside:
        beside.write_text(text, encoding="utf-8")
    return page


def write_figure(path: Path, figure: Figure, dpi: int = 110) -> None:
    """Write a figure as PNG; the same figure gives the same bytes."""
    with atomic_path(path) as beside:
        figure.savefig(beside, format="png", dpi=dpi, metadata={"Software": ""})
