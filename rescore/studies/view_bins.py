"""How often the class model chooses the right view bin: photographs of test shapes, and tables of choices."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from pydantic import ValidationError, field_validator

from datasets_synth.objects.object_classes import ObjectClass, labelled_views, object_class
from datasets_synth.photos.single_object import Viewpoint, photograph
from recon.arrays import BoolArray, FloatArray, IntArray, UInt8Array
from recon.camera import PinholeCamera
from recon.class_model import ClassModel
from recon.errors import Failure, RescoreError
from recon.learning.learn import LearnConfig, learn_class_model
from recon.outlines import largest_outline
from recon.reconstruction.view_selection import best_view_bin
from recon.view_bins import ViewBins
from rescore.engines.executor import Workers
from rescore.engines.map_frames import map_frames
from rescore.files import read_json, write_json
from rescore.formats.checked_json import first_difference
from rescore.results.sweep_file import StudyPart
from rescore.speech import say

FORMAT = "view-confusion 1"
VIEW_STUDIES = {"car": ("car", 20), "car_5_degrees": ("car", 5), "chair": ("chair", 20)}
"""Class and elevation in degrees of each table of ``study-views``."""
CAMERA = PinholeCamera(250.0, 250.0, 79.5, 59.5, 160, 120)
"""Objects fill most of its picture: a car of 4.4 m is 128 pixels long from the side, at 9 m."""
LEARNED_SHAPES = 3
"""Training shapes that a class model is learned from."""
_LABELLED_PX = 240


class ViewShares(StudyPart):
    """Shares of all photographs; the last three are kinds of mistake, of which one may be two."""

    exact: float
    """The true bin."""
    within_one: float
    """The true bin or a neighbour."""
    mirrored: float
    """Bin -b for b: the other side of the object and its picture mirrored."""
    ends_exchanged: float
    """Bin k/2 - b: the same side with front and rear exchanged."""
    opposite: float
    """Bin b + k/2."""


@dataclass(frozen=True, eq=False)
class Confusion:
    """Counts of photographs by the true view bin and the view bin that was chosen."""

    counts: IntArray
    """Shape (k, k): photographs by true bin (row) and chosen bin (column)."""
    failures: dict[str, int]
    """Photographs without a choice by reason."""

    def __post_init__(self) -> None:
        if self.counts.ndim != 2 or self.counts.shape[0] != self.counts.shape[1]:
            raise ValueError(f"confusion: expected counts (k, k), got {self.counts.shape}")

    @property
    def photos(self) -> int:
        """Number of all photographs, with and without a choice."""
        return int(self.counts.sum()) + sum(self.failures.values())

    def shares(self) -> ViewShares:
        """Shares of all photographs, with and without a choice."""
        k = len(self.counts)
        true, chosen = np.mgrid[:k, :k]
        wrong = true != chosen

        def share(use: BoolArray) -> float:
            return float(self.counts[use].sum() / max(self.photos, 1))

        return ViewShares(
            exact=share(~wrong),
            within_one=share(np.isin((chosen - true) % k, [0, 1, k - 1])),
            mirrored=share(wrong & ((chosen + true) % k == 0)),
            ends_exchanged=share(wrong & ((chosen + true - k // 2) % k == 0)),
            opposite=share((chosen - true) % k == k // 2),
        )


@dataclass(frozen=True, eq=False)
class _Shot:
    """A photograph of a known view."""

    view_bin: int
    rgb: UInt8Array
    """Shape (h, w, 3)."""
    xyxy_px: FloatArray
    """The true box, shape (4,)."""
    outline_px: FloatArray | None
    """The true outline, shape (k, 2); None where nothing of the object is seen."""


def view_confusion(
    object_class: ObjectClass, model: ClassModel, n: int, rng: np.random.Generator, jobs: Workers = 1
) -> dict[str, Confusion]:
    """Choices of view bins on photographs of test shapes from the elevation of the model's views, true boxes.

    Args:
        object_class: the class.
        model: a model of the class, learned from training shapes.
        n: photographs; their azimuths go through the bins in turn, each anywhere in its bin.
        rng: source of shapes, azimuths and everything in the pictures.
        jobs: who chooses; photographs are taken one after another.

    Returns:
        "level_set": as with any picture; "true_outline": with the true outline in place of the level set.
    """
    shots = _photographs(object_class, model.bins, n, rng)
    found = list(map_frames(_choices, shots, model, jobs))
    true = [view_bin for view_bin, _ in found]
    return {
        name: count_choices(true, [choices[name] for _, choices in found], model.bins.count)
        for name in ("level_set", "true_outline")
    }


def _photographs(
    object_class: ObjectClass, bins: ViewBins, n: int, rng: np.random.Generator
) -> Iterator[_Shot]:
    setting = "room" if object_class.indoors else "street"
    half_bin = np.pi / bins.count
    for i in range(n):
        view_bin = i % bins.count
        azimuth = bins.azimuth_rad(view_bin) + float(rng.uniform(-half_bin, half_bin))
        shape = object_class.test[int(rng.integers(len(object_class.test)))]
        viewpoint = Viewpoint(azimuth, bins.elevation_rad)
        photo = photograph(object_class, shape, viewpoint, CAMERA, rng, setting)
        yield _Shot(view_bin, photo.rgb, photo.xyxy_px, largest_outline(photo.part_labels > 0))


def _choices(shot: _Shot, model: ClassModel) -> tuple[int, dict[str, int | Failure]]:
    """The true bin of a photograph, and what is chosen from the level set and with the true outline."""
    chosen: dict[str, int | Failure] = {}
    for name, outline in (("level_set", None), ("true_outline", shot.outline_px)):
        choice = best_view_bin(shot.rgb, shot.xyxy_px, model, outline_px=outline)
        chosen[name] = choice if isinstance(choice, Failure) else choice.view_bin
    return shot.view_bin, chosen


def learned_for_views(object_class: ObjectClass, elevation_rad: float) -> ClassModel:
    """A model of a class from a few training shapes, seen from an elevation in all view bins."""
    step = max(1, len(object_class.train) // LEARNED_SHAPES)
    shapes = object_class.train[::step][:LEARNED_SHAPES]
    views = labelled_views(object_class, shapes, ViewBins(elevation_rad=elevation_rad), _LABELLED_PX)
    # the planes, which refining turns, play no role in the choice of a view
    return learn_class_model(views, object_class.name, object_class.part_names, LearnConfig(refine_rounds=0))


def count_choices(true: Sequence[int], chosen: Sequence[int | Failure], count: int) -> Confusion:
    """The table for ``count`` bins from true bins and what was chosen for each."""
    counts = np.zeros((count, count), np.int64)
    for b, found in zip(true, chosen, strict=True):
        if not isinstance(found, Failure):
            counts[b, found] += 1
    failures = Counter(found.reason.value for found in chosen if isinstance(found, Failure))
    return Confusion(counts, dict(sorted(failures.items())))


class ConfusionRecord(StudyPart):
    """A table of choices as the file holds it."""

    photos: int
    """Number of all photographs, with and without a choice."""
    shares: ViewShares
    failures: dict[str, int]
    """Photographs without a choice by reason."""
    counts: tuple[tuple[int, ...], ...]
    """Photographs by true bin (row) and chosen bin (column)."""

    @classmethod
    def of(cls, table: Confusion) -> Self:
        """What the file holds of a table."""
        return cls(
            photos=table.photos,
            shares=table.shares(),
            failures=table.failures,
            counts=tuple(map(tuple, table.counts.tolist())),
        )

    @field_validator("counts")
    @classmethod
    def _square(cls, counts: tuple[tuple[int, ...], ...]) -> tuple[tuple[int, ...], ...]:
        if any(len(row) != len(counts) for row in counts):
            raise ValueError(f"expected as many columns as rows, {len(counts)}")
        return counts

    def table(self) -> Confusion:
        """The counts as an array, and the failures."""
        return Confusion(np.array(self.counts, np.int64), self.failures)


class ViewBinsFile(StudyPart):
    """The content of a file of `rescore study-views`."""

    format: str = FORMAT
    title: str
    """Class and elevation in words."""
    tables: dict[str, ConfusionRecord]
    """By name, as of ``view_confusion``."""


def save_confusions(path: Path, tables: Mapping[str, Confusion], title: str) -> None:
    """Write tables by name, with their shares, as JSON."""
    records = {name: ConfusionRecord.of(table) for name, table in tables.items()}
    write_json(path, ViewBinsFile(title=title, tables=records).as_json())


def load_confusions(path: Path) -> tuple[dict[str, Confusion], str]:
    """The tables of a file by name, and their title.

    Raises:
        RescoreError: no such file, or another format.
    """
    data = read_json(path, "confusion tables")
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        found = data.get("format") if isinstance(data, dict) else type(data).__name__
        raise RescoreError(
            f"{path}: expected format {FORMAT!r}, got {found!r}; write it with rescore study-views"
        )
    try:
        file = ViewBinsFile.model_validate(data)
    except ValidationError as error:
        raise RescoreError(
            f"{path}: expected {FORMAT!r}, got {first_difference(error)}; write it again"
        ) from error
    return {name: record.table() for name, record in file.tables.items()}, file.title


def study_views(out: Path, photos: int, seed: int, jobs: Workers = 1) -> None:
    """Write the tables of ``VIEW_STUDIES`` to a folder, each of so many photographs of test shapes."""
    for name, (class_name, elevation_deg) in VIEW_STUDIES.items():
        title = f"{class_name}, {elevation_deg} degrees"
        say(f"{title}: learning the class model, {photos} photographs")
        shown = object_class(class_name)
        model = learned_for_views(shown, float(np.deg2rad(elevation_deg)))
        tables = view_confusion(shown, model, photos, np.random.default_rng(seed), jobs)
        save_confusions(out / f"{name}.json", tables, title)
