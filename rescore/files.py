"""JSON and tables in one piece, digests of files, and the versions that results depend on."""

import hashlib
import json
import math
import platform
import shutil
from collections.abc import Mapping
from contextlib import suppress
from enum import StrEnum
from functools import lru_cache
from pathlib import Path
from typing import Any

from recon.errors import RescoreError
from recon.files import atomic_path
from recon.reading import json_of

MAX_NAME_BYTES = 100
"""Longest name that is taken from a file's content: file systems have 255, and endings come behind it."""


def refuse_unsafe_name(where: object, what: str, name: str, most_bytes: int = MAX_NAME_BYTES) -> None:
    """Raises RescoreError where a name that a file holds would be no plain name of a file, or no text.

    Results are written to files and folders of such names.
    """
    plain = name.isprintable() and not name.startswith(".") and not {"/", "\\"} & set(name)
    if not (plain and 0 < len(name.encode(errors="replace")) <= most_bytes):
        told = ascii(name if len(name) <= 60 else name[:57] + "...")
        raise RescoreError(
            f"{where}: expected {what} of letters and digits that could name a file (no slash, no dot at its "
            f"beginning, at most {most_bytes} bytes), got {told}; rename it"
        )


def write_json(path: Path, value: Any) -> None:
    """Write JSON in one piece, keys in the given order, NaN refused (the standard has none)."""
    text = json.dumps(value, indent=1, allow_nan=False, ensure_ascii=False)
    with atomic_path(path) as beside:
        beside.write_text(text + "\n", encoding="utf-8")


def json_values(value: Any) -> Any:
    """The value with null for every number that JSON cannot hold, as a rate of nothing."""
    if isinstance(value, dict):
        return {k: json_values(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [json_values(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def read_json(path: Path, what: str) -> Any:
    """The value in a JSON file; ``what`` names it in the error.

    Raises:
        RescoreError: there is no such file, or it is not JSON.
    """
    return json_of(path, what, "write the file again")


def read_json_object(path: Path, what: str) -> Mapping[str, Any]:
    """The JSON object in a file of a run; ``what`` names it in the error.

    Raises:
        RescoreError: there is no such file, or it holds no JSON object.
    """
    value = read_json(path, what)
    if not isinstance(value, dict):
        raise RescoreError(f"{path}: expected a JSON object, got {type(value).__name__}; evaluate again")
    return value


def digest_of(path: Path) -> str:
    """Digest of a file, or of all files of a folder with their names; empty where there is nothing."""
    total = hashlib.sha256()
    if path.is_file():
        total.update(file_digest(path))
    elif path.is_dir():
        for file in sorted(p for p in path.rglob("*") if p.is_file()):
            total.update(file.relative_to(path).as_posix().encode() + b"\0")
            total.update(file_digest(file))
    else:
        return ""
    return total.hexdigest()


def file_digest(path: Path) -> bytes:
    """SHA-256 of a file."""
    state = path.stat()
    return _digest_at(path, state.st_size, state.st_mtime_ns)


@lru_cache(maxsize=100_000)
def _digest_at(path: Path, _size: int, _modified_ns: int) -> bytes:
    """Digest of a file, read once in a process unless it changes: stages share their inputs."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").digest()


def remove(path: Path) -> None:
    """Remove a file or a folder, if there is one."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


_VERSIONED = (
    *(
        "rescore",
        "numpy",
        "scipy",
        "opencv-python-headless",
        "numba",
        "scikit-learn",
        "joblib",
        "pydantic",
        "pyarrow",
    ),
    *("open3d", "open3d-cpu", "rerun-sdk", "matplotlib", "trimesh", "pillow", "mujoco", "mink", "ompl"),
)


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that results depend on; what is not installed is left out."""
    from importlib import metadata  # noqa: PLC0415 (it brings the parsers of e-mail)

    found = {"python": platform.python_version()}
    for name in _VERSIONED:
        with suppress(metadata.PackageNotFoundError):
            found[name] = metadata.version(name)
    return found


def write_provenance(result: Path, command: str, config: Any, seed: int | None) -> None:
    """Write ``<result>.config.json``: the effective config, seed and versions of what made a result."""
    write_json(
        result.with_name(result.name + ".config.json"),
        {"command": command, "seed": seed, "config": config, "versions": versions()},
    )


class TableFormat(StrEnum):
    """Forms of tables, by the end of the file's name."""

    CSV = "csv"
    PARQUET = "parquet"


def write_table(path: Path, columns: Mapping[str, Any]) -> None:
    """Write columns of one length as a table: CSV where the path ends with .csv, else Parquet."""
    import pyarrow as pa  # noqa: PLC0415 (a tenth of a second to import)
    import pyarrow.csv as pa_csv  # noqa: PLC0415
    import pyarrow.parquet as pq  # noqa: PLC0415

    table = pa.table(dict(columns))
    with atomic_path(path) as beside:
        if path.suffix == f".{TableFormat.CSV}":
            pa_csv.write_csv(table, beside)
        else:
            pq.write_table(table, beside, compression="zstd")
