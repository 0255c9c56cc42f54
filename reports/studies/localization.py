"""The published page of section 5.1: ``python -m reports.studies.localization RUN FOLDER COMMAND``.

Copies numbers and reduced pictures of a finished ``rescore localize`` and writes a page from the numbers.
"""

import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

import cv2

from recon.errors import Failure, RescoreError
from recon.files import atomic_path
from reports.pages import write_page
from rescore.studies.localization.result_file import (
    LocalizationResult,
    ScoredPlacement,
    outside_remark,
    read_localization,
    scores_by_car,
)
from rescore.studies.localization.scores import METHOD_NAME, METHODS, Score, markdown_table

_MOST_BYTES = 400_000
_FLIPPED_DEG = 90.0

PICTURES = {
    "table": "Cars on the table with true boxes and those of the joint fit",
    "reconstruction": "One reconstruction in 3D, as in figure 7 of the report, beside its picture",
    "placements": "The first placements with overlap, centroid error and orientation error of the joint fit",
    "worst": "The placements with the largest errors of the joint fit",
}
"""Pictures of a run with what a person reads in their place."""

_WHAT = """## What is measured

Model cars 1:18 of shapes that nothing was learned from, racers with wings and free wheels, open, small, old
and working cars among them, stand one at a time on a black table of 1.2 m by
1 m, at random and in any direction. One calibrated camera, 1.4 m from the middle of the table and 35
degrees above it, takes a rendered picture of 1600 x 1200 pixels with noise. The true box holds the body
without its mirrors (nor aerials, where a mesh has them): length along the car, width across, height from
the table. Overlap is the volume of the intersection over that of the union of true and estimated box;
the centroid error is the distance of their middles; the orientation error is the angle between their
noses, up to 180 degrees. The single plane has no front, so that its error is at most 90 degrees, and no
box. Placements that a method loses are counted and have no error.

- *3DP, joint fit*: pose and shape are fitted together, so that every ray through the outline grazes the
  object. The shape is one of a linear space, learned from part-labelled views. It is fitted both ways
  round; which end is the nose is told by outline and borders of the parts, and by windows and lamps, as
  pictures of the training cars in usual and unusual looks taught. An outline that no shape of the
  space explains is expected to err by as much as the fit leaves; where it takes much bending, the car is
  marked as outside what was learned. This goes beyond the report.
- *3DP, the report's construction*: parts are registered to the outline for the likeliest view bins,
  their planes are placed from the ground line up (section 4.3), and the class model is carried onto them
  (section 4.4), sized to the outline on all sides and standing on the table. Overlap with the outline and
  borders of parts choose among the view bins and a few turns within each, with how usual the proportions of
  the box are. The report has its view bin from a detector; here the nose of the joint fit says, to within 90
  degrees, which end is the front, and nothing more of the joint fit is used. The class model is that of the
  training car whose size is the most usual.
- *Single plane*: one upright plane on the ground line, as in the report's comparison.

What is known before: the camera and the table plane; twelve labelled views at each of three elevations
of each training car, and its length, width and height in metres, from which the joint fit takes its
sizes; 12 pictures of each training car on the table with its place, for the looks of front and rear, and 4
of each car of the splits "calibration" and "validation", by which the cues are weighed; the scale 1:18. The
report's construction knows no sizes. Settings were chosen on other shapes than those that are learned from
or tested on.

Segmentation is by colour: the empty table is known from averaged pictures. On the table a pixel is the
car where it is brighter, of another colour, or darker than shade can be; beside the table, where no
shade falls, where it differs at all. What is as dark as shade between pieces of the car, inside their
convex hull, is a dark panel if it is large. Cars painted black or dark grey, as dark as the table, get
another paint."""


def publish(run_dir: Path, folder: Path, command: str) -> Path:
    """Copy the numbers and pictures of a run to a folder, with a page that shows them; returns the page.

    Args:
        run_dir: the folder of a finished ``rescore localize``.
        folder: where to publish; made where it is missing.
        command: what made the run, for the page.

    Raises:
        RescoreError: no finished run there.
    """
    source = run_dir / "localization.json"
    result = read_localization(source)
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(source, folder / source.name)
    drawn = [name for name in PICTURES if (run_dir / f"{name}.png").is_file()]
    for name in drawn:
        _reduce(run_dir / f"{name}.png", folder / f"{name}.jpg")
    return write_page(folder, page(result, command, drawn))


def page(result: LocalizationResult, command: str, drawn: Sequence[str]) -> str:
    """The page from the numbers of ``localization.json``."""
    rows = result.placements
    parts = [
        "# Localization of model cars (section 5.1 of the report)",
        f"Made by `{command}`: {len(rows)} placements of {len({r.car for r in rows})} cars.\n"
        "`localization.json` holds the numbers of every placement.",
        _summary(result),
        _WHAT,
        "## Flipped, lost and outside\n\n" + "\n".join([*_remarks(rows), f"- {outside_remark(rows)}"]),
        "## By car\n\n" + markdown_table(scores_by_car(rows)).rstrip(),
        *(f"![{PICTURES[name]}]({name}.jpg)\n\n{PICTURES[name]}." for name in drawn),
    ]
    return "\n\n".join(parts) + "\n"


def mean_without_flips(result: LocalizationResult, method: str) -> float | None:
    """The mean error of orientation of a method without exchanged front and rear; None where none is left."""
    scores = [row.methods[method] for row in result.placements]
    right = [s.orientation_deg for s in scores if isinstance(s, Score) and s.orientation_deg <= _FLIPPED_DEG]
    return sum(right) / len(right) if right else None


def _summary(result: LocalizationResult) -> str:
    """A row a method, the report's own figures beside ours."""
    lines = [
        "| method | overlap % | centroid mm | orientation deg | without flips deg | flipped | lost | "
        "report: overlap % | mm | deg |",
        "|---|" + "---:|" * 9,
    ]
    for method in METHODS:
        mean = result.methods[method]
        # both of ours answer to the one 3DP row of the report
        theirs = result.report["single_plane" if method == "single_plane" else "3dp"]
        scores = [r.methods[method] for r in result.placements]
        turns = [s.orientation_deg for s in scores if isinstance(s, Score)]
        n_flipped = sum(t > _FLIPPED_DEG for t in turns)
        cells = [
            METHOD_NAME[method],
            _percent(mean.overlap),
            _number(mean.centroid_mm),
            _number(mean.orientation_deg),
            _number(mean_without_flips(result, method)),
            str(n_flipped),
            str(mean.lost),
            _percent(theirs.overlap),
            _number(theirs.centroid_mm),
            _number(theirs.orientation_deg),
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _remarks(rows: Sequence[ScoredPlacement]) -> list[str]:
    """A line a method that names placements turned the wrong way, and those lost with their reasons."""
    lines = []
    for method in METHODS:
        flipped, lost = [], []
        for i, row in enumerate(rows):
            found = row.methods[method]
            if isinstance(found, Failure):
                lost.append(f"{i} {row.car} ({found.reason})")
            elif found.orientation_deg > _FLIPPED_DEG:
                flipped.append(f"{i} {row.car}")
        lines.append(
            f"- {METHOD_NAME[method]}: turned by more than {_FLIPPED_DEG:.0f} degrees: "
            f"{', '.join(flipped) or 'none'}; lost: {', '.join(lost) or 'none'}."
        )
    return lines


def _percent(value: float | None) -> str:
    return "" if value is None else f"{100 * value:.1f}"


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"


def _reduce(source: Path, target: Path) -> None:
    """A JPEG of a picture, of the best quality below the limit."""
    picture = cv2.imread(str(source))
    if picture is None:
        raise RescoreError(f"{source}: expected a picture, could not read it; call `rescore localize` again")
    for quality in range(92, 20, -6):
        _, jpeg = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])
        if len(jpeg) < _MOST_BYTES:
            break
    with atomic_path(target) as beside:
        beside.write_bytes(jpeg.tobytes())


if __name__ == "__main__":
    print(publish(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3]))
