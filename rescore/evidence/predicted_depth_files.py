"""Folders of predicted depth and of masks: a file a frame, named as its left picture.

A JSON file says where they lie and what they hold (``read_prediction_folder``).
"""

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from recon.errors import RescoreError
from rescore.data.content import content_digest
from rescore.data.depth_files import SUFFIXES, read_map
from rescore.data.frames import DataSet, frame_names
from rescore.data.pictures import decode_picture
from rescore.evidence.predicted_depth import PredictedAs, PredictedDepth, PredictedUnit, another_system
from rescore.files import read_json


@dataclass(frozen=True)
class PredictionFolder:
    """Where predictions lie, and what they are."""

    folder: Path
    predicted_as: PredictedAs
    unit: PredictedUnit = PredictedUnit.RELATIVE
    factor: float = 1.0
    """Value of the files for one metre (or 1 / metre), such as 1000; relative ones need none."""
    masks: Path | None = None
    """Folder of masks: PNG with one channel, not 0 on objects."""

    @property
    def depth_of(self) -> str:
        """Whose depth it is, in words: w and D fitted with another's do not fit."""
        return another_system(self.predicted_as, self.unit)

    def __post_init__(self) -> None:
        if not (np.isfinite(self.factor) and self.factor > 0):
            raise RescoreError(
                f"{self.folder}: expected a positive factor from metres to the values of the files, got "
                f"{self.factor:g}; millimetres have 1000"
            )


class _Description(BaseModel):
    """The JSON file that describes a prediction folder. Paths are relative to its own folder."""

    model_config = ConfigDict(extra="forbid")

    folder: Path
    predicted_as: str | None = Field(default=None, alias="as")
    unit: str = PredictedUnit.RELATIVE
    factor: float | None = None
    masks: Path | None = None


def read_prediction_folder(path: Path) -> PredictionFolder:
    """The prediction folder that a JSON file describes; its paths are relative to the file.

    The keys are ``folder`` and ``as``, and where needed ``unit``, ``factor`` and ``masks``.

    Raises:
        RescoreError: no such file, an unknown key, no folder, or a value that is none of those allowed.
    """
    value = read_json(path, "a description of predicted depth")
    try:
        file = _Description.model_validate(value)
    except ValidationError as error:
        raise RescoreError(
            f"{path}: expected a description of predicted depth, got {_first_problem(error)}; "
            "keys are folder, as, unit, factor and masks (docs/predicted-depth.md)"
        ) from error
    folder = path.parent / file.folder
    if file.predicted_as not in list(PredictedAs):
        raise RescoreError(
            f"{path}: as: expected {' or '.join(PredictedAs)}, got {file.predicted_as!r}; say what the files "
            f"of {folder} hold"
        )
    if file.unit not in list(PredictedUnit):
        raise RescoreError(
            f"{path}: unit: expected {' or '.join(PredictedUnit)}, got {file.unit!r}; choose one of these"
        )
    if file.factor is not None and file.unit != PredictedUnit.METRIC:
        raise RescoreError(
            f"{path}: factor: expected metric predictions, got relative ones, whose scale is free; "
            'leave it out or say "unit": "metric"'
        )
    return PredictionFolder(
        folder,
        PredictedAs(file.predicted_as),
        PredictedUnit(file.unit),
        1.0 if file.factor is None else file.factor,
        None if file.masks is None else path.parent / file.masks,
    )


def _first_problem(error: ValidationError) -> str:
    first = error.errors(include_url=False)[0]
    place = ".".join(map(str, first["loc"]))
    text = first["msg"][:1].lower() + first["msg"][1:]
    return f"{place}: {text}" if place else text


@dataclass(frozen=True)
class PredictedFile:
    """The prediction of one frame on disk."""

    path: Path
    mask_path: Path | None
    kind: PredictionFolder

    def read(self, width_px: int, height_px: int) -> PredictedDepth:
        """The prediction of a picture of a size.

        Raises:
            RescoreError: a file is damaged, or of another type or size.
        """
        kind = self.kind
        values = read_map(self.path, "predicted depth", kind.factor, width_px, height_px)
        mask = None if self.mask_path is None else _read_mask(self.mask_path, width_px, height_px)
        return PredictedDepth(values, kind.predicted_as, kind.unit, mask)


@dataclass(frozen=True)
class Predictions:
    """The predictions of some frames of a data set."""

    kind: PredictionFolder
    files: Mapping[int, PredictedFile]
    """File of each frame by image id."""

    @staticmethod
    def of(kind: PredictionFolder, data: DataSet, image_ids: Iterable[int]) -> "Predictions":
        """The files of frames of a data set, which all must be there.

        Raises:
            RescoreError: a frame has none, or several.
        """
        names = frame_names(data)
        ids = list(image_ids)
        paths = _files_of(kind.folder, [names[i] for i in ids], SUFFIXES, "predicted depth")
        masks: list[Path | None] = [None] * len(ids)
        if kind.masks is not None:
            masks = [*_files_of(kind.masks, [names[i] for i in ids], (".png",), "a mask")]
        found = zip(ids, paths, masks, strict=True)
        return Predictions(kind, {i: PredictedFile(path, mask, kind) for i, path, mask in found})

    def as_json(self) -> dict[str, Any]:
        """What was used, as JSON values: the digest changes with any name or content of a file, not with its
        packing."""
        total = hashlib.sha256()
        for path in [p for f in self.files.values() for p in (f.path, f.mask_path) if p is not None]:
            total.update(f"{path.name}\0{content_digest(path)}\0".encode())
        return {
            "folder": str(self.kind.folder),
            "predicted_as": self.kind.predicted_as.value,
            "unit": self.kind.unit.value,
            "factor": self.kind.factor,
            "masks": None if self.kind.masks is None else str(self.kind.masks),
            "n_frames": len(self.files),
            "sha256": total.hexdigest(),
        }


def _files_of(folder: Path, names: list[str], suffixes: tuple[str, ...], what: str) -> list[Path]:
    """The file of each name in a folder."""
    if not folder.is_dir():
        raise RescoreError(
            f"{folder}: expected a folder with {what} of each frame, found none; check the path"
        )
    by_name: dict[str, list[Path]] = {}
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() in suffixes:
            by_name.setdefault(path.stem, []).append(path)
    missing = [name for name in names if name not in by_name]
    if missing:
        raise RescoreError(
            f"{folder}: expected {what} of every frame with detections, found none for {len(missing)} of "
            f"{len(names)}, such as {missing[0]!r} ({', '.join(suffixes)}); name files as the left pictures"
        )
    several = [found for name in names if len(found := by_name[name]) > 1]
    if several:
        raise RescoreError(
            f"{folder}: expected one file of a name, found {several[0][0].name} and {several[0][1].name}; "
            "move those that are not meant to another folder"
        )
    return [by_name[name][0] for name in names]


def _read_mask(path: Path, width_px: int, height_px: int) -> NDArray[np.integer]:
    """Number of the object at each pixel, shape (h, w), 0 for none."""
    mask = decode_picture(path, cv2.IMREAD_UNCHANGED)
    if mask is None or mask.shape != (height_px, width_px):
        came = "no whole picture" if mask is None else f"shape {mask.shape}"
        raise RescoreError(
            f"{path}: expected a mask with one channel of {width_px} x {height_px} pixels, got {came}; write "
            "it as grey PNG of the size of the left picture"
        )
    return np.asarray(mask, np.int64)
