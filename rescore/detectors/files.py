"""Detectors on disk: one npz file of plain arrays and a JSON header. Nothing in it can run code."""

import json
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.errors import RescoreError
from recon.files import atomic_path
from recon.reading import arrays_of, reading

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
    with reading(path, "a detector file", advice):
        arrays = arrays_of(path)
        header = json.loads(arrays.pop(_HEADER).tobytes().decode())
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise RescoreError(f"{path}: expected a detector file, got another kind of npz; {advice}")
    if header.get("format_version") != FORMAT_VERSION:
        raise RescoreError(
            f"{path}: expected detector format {FORMAT_VERSION}, got {header.get('format_version')}; {advice}"
        )
    return header, arrays
