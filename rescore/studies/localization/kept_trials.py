"""Trials in a folder, a file each with a small picture, so that a run that was stopped goes on."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from pydantic import TypeAdapter

from recon.arrays import UInt8Array
from recon.errors import RescoreError
from recon.files import atomic_path
from rescore.files import read_json_object, remove, write_json
from rescore.formats.checked_json import read_checked
from rescore.studies.localization.result_file import ScoredPlacement


class KeptTrials:
    """The trials that a folder holds of one study; those of another study are removed."""

    def __init__(self, folder: Path, settings: dict[str, Any]) -> None:
        self._folder = folder
        file = folder / "settings.json"
        if not _same(file, settings):
            for old in folder.glob("[0-9]*.*"):
                remove(old)
            write_json(file, settings)

    def missing(self, count: int) -> list[int]:
        """Numbers of the first ``count`` trials that are still to do."""
        return [i for i in range(count) if not (self._row_file(i).is_file() and self._tile_file(i).is_file())]

    def add(self, index: int, row: ScoredPlacement, tile: UInt8Array) -> None:
        """Keep a trial with its small picture (h, w, 3)."""
        _, png = cv2.imencode(".png", tile[..., ::-1])
        with atomic_path(self._tile_file(index)) as beside:
            beside.write_bytes(png.tobytes())
        write_json(self._row_file(index), row.as_json())

    def rows(self, count: int) -> list[ScoredPlacement]:
        """The numbers of the first ``count`` trials.

        Raises:
            RescoreError: a trial is not there, or damaged.
        """
        adapter = TypeAdapter(ScoredPlacement)
        return [read_checked(self._row_file(i), adapter, "a trial") for i in range(count)]

    def tiles(self, indices: Sequence[int]) -> list[UInt8Array]:
        """Small pictures (h, w, 3) of trials.

        Raises:
            RescoreError: a picture is damaged.
        """
        return [_picture(self._tile_file(i)) for i in indices]

    def _row_file(self, index: int) -> Path:
        return self._folder / f"{index:04d}.json"

    def _tile_file(self, index: int) -> Path:
        return self._folder / f"{index:04d}.png"


def _picture(path: Path) -> UInt8Array:
    found = cv2.imdecode(np.frombuffer(path.read_bytes(), np.uint8), cv2.IMREAD_COLOR)
    if found is None:
        raise RescoreError(f"{path}: expected the picture of a trial, got something else; remove it")
    return np.ascontiguousarray(found[..., ::-1])


def _same(file: Path, settings: object) -> bool:
    try:
        return read_json_object(file, "settings") == settings
    except RescoreError:
        return False
