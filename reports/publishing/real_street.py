"""The real example in pictures: ``python -m reports.publishing.real_street RUN FOLDER COMMAND``.

RUN is what ``rescore evaluate`` wrote of ``examples/real_street``. Draws a picture of each of its frames, and
a page that shows them with a table of all boxes.
"""

import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from recon.errors import RescoreError
from reports.pages import write_page
from reports.publishing.street_boxes import StreetBox, StreetFrame, street_frames
from reports.publishing.street_card import draw_street
from reports.run.tables import Table
from reports.templating import render
from rescore.results.run_folder import load_run
from rescore.results.words import status_text

PICTURES: Mapping[str, tuple[int, int, int, int]] = {
    "sun": (0, 230, 980, 720),
    "snow": (0, 230, 760, 600),
    "rain": (0, 190, 1280, 560),
}
"""Name of each frame's picture, in the order of frames, and the part of the frame that it shows: left, top,
right and bottom in pixel edges."""


def publish_street(run_dir: Path, folder: Path, command: str) -> Path:
    """Draw the frames of a run into a folder, with a page that shows them; returns the page.

    Args:
        run_dir: a run of the frames of ``examples/real_street``.
        folder: where to publish; made where it is missing.
        command: what makes it, for the page.

    Raises:
        RescoreError: a run of other frames, or one that is not rescored.
    """
    frames = street_frames(load_run(run_dir))
    if len(frames) != len(PICTURES):
        raise RescoreError(
            f"{run_dir}: expected a run of {len(PICTURES)} frames, got {len(frames)}; take the example's"
        )
    for (name, crop_px), frame in zip(PICTURES.items(), frames, strict=True):
        draw_street(folder / f"{name}.webp", frame, np.array(crop_px, float))
    tables = {name: _table(frame).markdown() for name, frame in zip(PICTURES, frames, strict=True)}
    values = {"command": command, "count": sum(len(f.boxes) for f in frames), "tables": tables}
    text = render("reports.publishing", "real_street_page.md.j2", **values)
    return write_page(folder, text + "\n")


def _table(frame: StreetFrame) -> Table:
    """A row a box."""
    head = ("box", "shows", "fitted 3D box", "detector", "depth", "together", "place before", "after")
    return Table("Boxes", head, tuple(_row(b) for b in frame.boxes), text_columns=3)


def _row(b: StreetBox) -> tuple[str, ...]:
    c = b.view
    numbers = (f"{v:.2f}" for v in (c.likelihood, 1 - c.depth_difference, c.posterior))
    return (str(b.number), b.shows, _solid(b), *numbers, *map(str, b.places))


def _solid(b: StreetBox) -> str:
    """Distance and size of the fitted 3D box in words, or why there is none."""
    box = b.view.box3d
    if box is None:
        return status_text(b.view.status)
    length, width, height = box.size_m[0].tolist()
    return f"{box.distance_m[0]:.0f} m away, {length:.1f} x {width:.1f} x {height:.1f} m"


if __name__ == "__main__":
    print(publish_street(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3]))
