"""Detectors on disk: one npz file of plain arrays and a JSON header. Nothing in it can run code."""

import json
import zipfile
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.errors import RescoreError
from recon.files import atomic_path

FORMAT = "rescore-detector"
FORMAT_VERSION = 1
_HEADER = "header_json"


def write_detector(
    path: Path, kind: str, name: str, config: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]
) -> None:
    """Write a detector beside ``path`` and move it there, so that no half file bears the name."""
    header = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "kind": kind,
        "name": name,
        "config": config,
        "versions": {
            "numpy": np.__version__,
            "opencv": cv2.__version__,
            "scikit-learn": metadata.version("scikit-learn"),
        },
    }
    text = np.frombuffer(json.dumps(header, sort_keys=True).encode(), np.uint8)
    with atomic_path(path) as beside, beside.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **{_HEADER: text}, **arrays)


def read_detector_file(path: Path) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Header and arrays of a detector file.

    Raises:
        RescoreError: no such file, not a detector, or written by a newer version.
    """
    advice = "train the detector again (rescore train)"
    if not path.is_file():
        raise RescoreError(f"{path}: expected a detector file, found no file; {advice}")
    try:
        with np.load(path, allow_pickle=False) as stored:
            arrays = {key: stored[key] for key in stored.files}
        header = json.loads(arrays.pop(_HEADER).tobytes().decode())
    except (ValueError, KeyError, OSError, EOFError, zipfile.BadZipFile, AttributeError, TypeError) as error:
        raise RescoreError(
            f"{path}: expected a detector file, could not read it ({_one_line(error)}); {advice}"
        ) from error
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise RescoreError(f"{path}: expected a detector file, got another kind of npz; {advice}")
    if header.get("format_version") != FORMAT_VERSION:
        raise RescoreError(
            f"{path}: expected detector format {FORMAT_VERSION}, got {header.get('format_version')}; {advice}"
        )
    return header, arrays


def damaged(path: Path, kind: str, error: Exception) -> RescoreError:
    """What to raise where the content of a detector file does not make a detector of its kind."""
    return RescoreError(
        f"{path}: expected a whole {kind} detector, got damaged content ({_one_line(error)}); "
        "train the detector again (rescore train)"
    )


def _one_line(error: Exception) -> str:
    return f"{type(error).__name__}: {error}".replace("\n", " ")
