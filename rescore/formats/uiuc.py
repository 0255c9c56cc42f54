"""The UIUC side-view car set: training crops of 100 x 40 px and test pictures with cars of one size.

Agarwal, Awan and Roth, Learning to Detect Objects in Images via a Sparse, Part-Based Representation, PAMI
2004. The set's README describes the files and the rule of its evaluation.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from recon.arrays import FloatArray
from recon.errors import RescoreError

CAR_WIDTH_PX, CAR_HEIGHT_PX = 100, 40
"""Size of the window of every car."""
CARS_PATTERN, STREET_PATTERN = "TrainImages/pos-*.pgm", "TrainImages/neg-*.pgm"

_ROW = re.compile(r"(\d{1,9})\s*:((?:\s*\(\s*-?\d{1,9}\s*,\s*-?\d{1,9}\s*\))*)\s*")
_PLACE = re.compile(r"\(\s*(-?\d+)\s*,\s*(-?\d+)\s*\)")


@dataclass(frozen=True, eq=False)
class TestPicture:
    """A test picture and where its cars are."""

    __test__ = False  # no test of pytest's

    path: Path
    left_top_px: FloatArray
    """Shape (n, 2): x, y of the top left corner of each car's window; may lie outside the picture."""


def read_uiuc(root: Path) -> tuple[TestPicture, ...]:
    """The single-scale test pictures of a folder with ``TestImages`` and ``trueLocations.txt``, in order.

    Raises:
        RescoreError: no such files, a row of another form, or a picture without its row.
    """
    locations = read_locations(root / "trueLocations.txt")
    pictures = []
    for number, places in locations.items():
        path = root / "TestImages" / f"test-{number}.pgm"
        if not path.is_file():
            raise RescoreError(f"{path}: expected the picture of row {number} of trueLocations.txt, got none")
        pictures.append(TestPicture(path, places))
    extra = len(list((root / "TestImages").glob("test-*.pgm"))) - len(pictures)
    if extra > 0:
        raise RescoreError(
            f"{root / 'trueLocations.txt'}: expected a row for every picture of TestImages, {extra} have none"
        )
    return tuple(pictures)


def read_locations(file: Path) -> dict[int, FloatArray]:
    """Corners (n, 2) of x, y by picture number; the file has rows ``n: (row,column) (row,column)``.

    Raises:
        RescoreError: no such file, a row of another form, or a picture named twice.
    """
    if not file.is_file():
        raise RescoreError(f"{file}: expected the locations of the UIUC car set, found none; give its folder")
    found: dict[int, FloatArray] = {}
    for at, line in enumerate(file.read_text(encoding="utf-8", errors="replace").splitlines(), start=1):
        if not line.strip():
            continue
        row = _ROW.fullmatch(line.strip())
        if row is None or int(row[1]) in found:
            raise RescoreError(
                f"{file}, line {at}: expected '<picture>: (row,column) ...', a picture a line, got "
                f"{line.strip()[:60]!r}; mend the line"
            )
        places = [(float(column), float(y)) for y, column in _PLACE.findall(row[2])]
        found[int(row[1])] = np.array(places, dtype=float).reshape(-1, 2)
    return found
