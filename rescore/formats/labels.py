"""What the readers of boxes share: a row a box, classes by name, and what was left out or mapped, counted."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from recon.arrays import FloatArray
from recon.errors import RescoreError
from recon.reading import read_text
from rescore.data.boxes3d import Boxes3D, BoxValues
from rescore.data.frames import FrameRecord, Truth

UNKNOWN_OCCLUSION = 3
"""KITTI's level of occlusion where nothing is known."""

SHARE_MOST = 1.001
"""Largest coordinate of a box as a share of the picture, with what rounding adds."""
MIN_EDGES = 3
"""Number of boxes from which they tell edges from sizes; one may be cut by the picture."""


@dataclass(frozen=True)
class LabelRow:
    """One box of a label or detection file."""

    name: str
    """The class as the file has it."""
    xyxy_px: tuple[float, float, float, float]
    """Left, top, right, bottom, pixel edges."""
    ignore: bool = False
    azimuth_deg: float = math.nan
    """Azimuth as in ``rescore.data.frames.Truth``; NaN where unknown."""
    truncated: float = math.nan
    """Share outside the picture, NaN where unknown."""
    occluded: int = UNKNOWN_OCCLUSION
    score: float | None = None
    """Score of a detection; None in a label."""
    bbox3d: BoxValues | None = None
    """The 3D box; None where there is none."""

    @property
    def has_size(self) -> bool:
        """Whether width and height are above 0."""
        x0, y0, x1, y1 = self.xyxy_px
        return x1 > x0 and y1 > y0

    @property
    def visibility(self) -> float:
        """Visible share: known where nothing occludes the object, since levels of occlusion are no shares."""
        return 1.0 - self.truncated if self.occluded == 0 else math.nan


@dataclass(frozen=True)
class ClassMap:
    """Map from the class names of a file to those of the data set, without regard to case."""

    target: str
    """The class of the data set."""
    renamed: Mapping[str, str] = field(default_factory=dict)
    """Names in the data set by names in the file."""
    of_several: bool = False
    """Whether the map is for labels and detections, so that one of them may lack a name: a note says so. Else
    a name that does not occur is an error."""

    @staticmethod
    def of(target: str, pairs: Sequence[str] = (), *, of_several: bool = False) -> "ClassMap":
        """A map from texts such as ``van=car``.

        Raises:
            RescoreError: a text is no such pair, or one name is mapped twice.
        """
        renamed: dict[str, str] = {}
        for pair in pairs:
            old, equals, new = (part.strip() for part in pair.partition("="))
            if not (old and equals and new):
                raise RescoreError(f"--map: expected OLD=NEW, as van=car, got {pair!r}; write it so")
            if renamed.setdefault(old.casefold(), new) != new:
                raise RescoreError(f"--map: expected each class once, got {old!r} twice; keep one")
        return ClassMap(target, renamed, of_several)

    def name(self, name: str) -> str:
        """The class that a class of a file is taken for."""
        return self.renamed.get(name.casefold(), name)

    def takes(self, name: str) -> bool:
        """Whether a class of a file is the one of the data set."""
        return self.name(name).casefold() == self.target.casefold()

    def notes(self, where: object, counts: Counter[str]) -> tuple[str, ...]:
        """What became of the boxes of each class, at most three lines.

        A class may be known and have no box: its count is 0.

        Raises:
            RescoreError: a class to map does not occur.
        """
        known = {name.casefold() for name in counts}
        strangers = sorted(set(self.renamed) - known)
        lines = []
        if strangers and counts:
            text = f"{where}: --map names class {strangers[0]!r}, the labels have {_counted(counts)}"
            if not self.of_several:
                raise RescoreError(f"{text}; mend --map")
            lines.append(text)
        counts = +counts
        mapped = Counter(
            {
                f"{_category(n)} as {self.name(n)}": c
                for n, c in counts.items()
                if n.casefold() in self.renamed
            }
        )
        left_out = Counter({n: c for n, c in counts.items() if not self.takes(n)})
        if mapped:
            lines.append(f"{where}: took boxes of {_counted(mapped)}")
        if left_out:
            lines.append(f"{where}: left out boxes of other classes: {_counted(left_out)}")
        return tuple(lines)


def _counted(counts: Counter[str]) -> str:
    named = {_category(name): n for name, n in counts.items()}
    return ", ".join(f"{n} {name}" for name, n in sorted(named.items()))


def _category(name: str) -> str:
    # a category that only its number is known of
    return f"of category {name}" if name.isdecimal() else name


def flat_note(where: object, n: int) -> tuple[str, ...]:
    """A line that counts boxes of no size, which every reader leaves out; none where there are none."""
    return (f"{where}: left out {n} {'box' if n == 1 else 'boxes'} of width or height 0",) if n else ()


def has_size(file: Path, what: str, xywh_px: Sequence[float], *, counts: bool = True) -> bool:
    """Whether a box is one: some tools write boxes of width or height 0.

    Args:
        file: where the box is, for the message.
        what: which one of it.
        xywh_px: left, top, width, height.
        counts: whether the box is of the class; others may be of any size.

    Raises:
        RescoreError: the box counts and has a negative size, as edges in place of sizes give it.
    """
    x, y, w, h = xywh_px
    if counts and min(w, h) < 0:
        raise RescoreError(
            f"{file}: {what}: expected [x, y, w, h] with positive sizes, got {list(xywh_px)}; mend bbox"
        )
    # sums, since a size far below the place adds nothing to it
    return x + w > x and y + h > y


def refuse_other_form(where: object, xyxy_px: FloatArray, size_px: FloatArray) -> None:
    """Refuse boxes that are whole in another form than left, top, width and height in pixels.

    Args:
        where: the file, for the message.
        xyxy_px: edges of the boxes as they were read, shape (n, 4).
        size_px: width and height of the picture of each, shape (n, 2).

    Raises:
        RescoreError: all are shares of the picture, or would be boxes as edges and half of them reach out of
            it as sizes.
    """
    if not len(xyxy_px):
        return
    if (np.abs(xyxy_px) <= SHARE_MOST).all():
        raise RescoreError(
            f"{where}: expected boxes in pixels, got shares of the picture in all {len(xyxy_px)}, as "
            f"{xyxy_px[0].tolist()} (edges); multiply by width and height"
        )
    sizes_px = xyxy_px[:, 2:] - xyxy_px[:, :2]
    as_edges = (sizes_px > xyxy_px[:, :2]).all(1) & (sizes_px <= size_px + 1).all(1)
    reach_out = (xyxy_px[:, 2:] > 1.05 * size_px).any(1)
    if len(xyxy_px) >= MIN_EDGES and as_edges.all() and reach_out.mean() >= 0.5:
        raise RescoreError(
            f"{where}: expected bbox as left, top, width, height, got what looks like left, top, right, "
            f"bottom in all {len(xyxy_px)} (as sizes {int(reach_out.sum())} reach out of the picture); "
            "subtract left and top"
        )


def refuse_other_truth(where: object, frames: Sequence[FrameRecord], truth: Mapping[int, Truth]) -> None:
    """Raises RescoreError where the annotated boxes are whole in another form (``refuse_other_form``)."""
    n = [len(truth[f.image_id].annotation_id) for f in frames]
    sizes_px = np.repeat(
        np.array([(f.width_px, f.height_px) for f in frames], float).reshape(-1, 2), n, axis=0
    )
    xyxy_px = [truth[f.image_id].xyxy_px for f in frames]
    refuse_other_form(where, np.concatenate([np.zeros((0, 4)), *xyxy_px]), sizes_px)


def with_size(
    where: object, rows: Sequence[Sequence[LabelRow]]
) -> tuple[list[list[LabelRow]], tuple[str, ...]]:
    """The boxes that have a size, file by file, and a line that counts the others."""
    kept = [[r for r in own if r.has_size] for own in rows]
    return kept, flat_note(where, sum(map(len, rows)) - sum(map(len, kept)))


def truth_of(rows: Sequence[LabelRow], first_id: int) -> Truth:
    """The truth of one image; annotations are numbered from ``first_id``."""
    azimuth = np.array([r.azimuth_deg for r in rows], dtype=float)
    truncated = np.array([r.truncated for r in rows], dtype=float)
    occluded = np.array([r.occluded for r in rows], dtype=np.int64)
    return Truth(
        annotation_id=np.arange(first_id, first_id + len(rows), dtype=np.int64),
        xyxy_px=np.array([r.xyxy_px for r in rows], dtype=float).reshape(-1, 4),
        ignore=np.array([r.ignore for r in rows], dtype=bool),
        visibility=np.array([r.visibility for r in rows], dtype=float),
        shape_id=("",) * len(rows),
        azimuth_deg=None if np.isnan(azimuth).all() else azimuth,
        truncated=None if np.isnan(truncated).all() else truncated,
        occluded=None if (occluded == UNKNOWN_OCCLUSION).all() else occluded,
        boxes3d=Boxes3D.of_rows([r.bbox3d for r in rows]),
    )


def checked_box(where: str, values: Sequence[float]) -> tuple[float, float, float, float]:
    """Left, top, right, bottom in this order; width and height may be 0.

    Raises:
        RescoreError: they are not; ``where`` names the place.
    """
    x0, y0, x1, y1 = values
    if not (x1 >= x0 and y1 >= y0):
        raise RescoreError(
            f"{where}: expected left < right and top < bottom, got {list(values)}; mend the box"
        )
    return (x0, y0, x1, y1)


def number(where: str, what: str, text: str) -> float:
    """The finite number that a text holds.

    Raises:
        RescoreError: it holds none.
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise RescoreError(f"{where}: expected a finite number for {what}, got {text[:40]!r}; mend it")
    return value


def text_lines(path: Path) -> list[tuple[str, str]]:
    """Place ("file:line") and text of every line of a file that is not blank.

    Raises:
        RescoreError: it is no text.
    """
    lines = read_text(path, "lines").splitlines()
    return [(f"{path}:{i}", line.strip()) for i, line in enumerate(lines, 1) if line.strip()]


def read_lines(path: Path) -> list[tuple[str, list[str]]]:
    """Place and words of the lines that ``text_lines`` gives.

    Raises:
        RescoreError: as there.
    """
    return [(where, line.split()) for where, line in text_lines(path)]


def image_ids(stems: Sequence[str]) -> list[int]:
    """The numbers that the names are, where all are different numbers; else 1, 2, ..."""
    if all(s.isdecimal() and s.isascii() and len(s) < 16 for s in stems):
        numbers = [int(s) for s in stems]
        if len(set(numbers)) == len(numbers):
            return numbers
    return list(range(1, len(stems) + 1))
