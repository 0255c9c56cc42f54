"""Files that results live in: written beside and moved into place, so nobody ever reads half a file."""

import ast
import hashlib
import json
import math
import os
import platform
import shutil
import uuid
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from enum import StrEnum
from functools import lru_cache
from importlib import metadata
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq
from numpy.typing import NDArray

from recon.errors import RescoreError


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """A path beside ``path`` to write to; on success it becomes ``path``, on failure nothing is left.

    The temporary name keeps the suffix, since many writers choose the format by it. Its name is unique, so
    two processes that write the same file do not meet; the last one wins, with a whole file.

    Raises:
        RescoreError: the folder cannot be written.
    """
    beside = path.with_name(f".{uuid.uuid4().hex[:12]}.partial{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield beside
        if not beside.exists():
            raise ValueError(f"{path}: nothing was written to the path that atomic_path gave")
        with beside.open("rb") as written:
            os.fsync(written.fileno())
        os.replace(beside, path)
    except OSError as error:
        # what the caller reads meanwhile can fail too, and is not for here
        if error.filename not in {None, str(beside), str(path), *map(str, path.parents)}:
            raise
        raise RescoreError(
            f"{path}: expected to write here, got {error.strerror!r}; "
            "choose another place or mend the permissions"
        ) from error
    finally:
        with suppress(OSError):
            beside.unlink()


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
    if not path.is_file():
        raise RescoreError(f"{path}: expected {what}, found no file; check the path")
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise RescoreError(f"{path}: expected {what} as JSON, got {error}; write the file again") from error


def digest_of(path: Path) -> str:
    """Digest of a file, or of all files of a folder with their names; empty where there is nothing."""
    total = hashlib.sha256()
    if path.is_file():
        total.update(_file_digest(path))
    elif path.is_dir():
        for file in sorted(p for p in path.rglob("*") if p.is_file()):
            total.update(file.relative_to(path).as_posix().encode() + b"\0")
            total.update(_file_digest(file))
    else:
        return ""
    return total.hexdigest()


def _file_digest(path: Path) -> bytes:
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


def source_digest(*modules: str) -> str:
    """Digest of the source of modules and of everything of this project that they import, at any depth.

    The code version of a cached stage: an edit of what the stage runs makes a new key, an edit elsewhere does
    not.
    """
    total = hashlib.sha256()
    for name, file in sorted(_closure(modules).items()):
        total.update(name.encode() + b"\0" + _file_digest(file))
    return total.hexdigest()


PACKAGES = ("recon", "rescore", "datasets_synth", "reports")


def _closure(modules: Iterable[str]) -> dict[str, Path]:
    """Files of modules and of all modules of the project that they import, by module name."""
    found: dict[str, Path] = {}
    todo = list(modules)
    while todo:
        name = todo.pop()
        file = module_file(name)
        if file is None or name in found:
            continue
        found[name] = file
        todo += imported_modules(file)
    return found


def module_file(name: str) -> Path | None:
    """The source file of a module of this project; None where the name is no such module."""
    if name.partition(".")[0] not in PACKAGES:
        return None
    base = Path(__file__).resolve().parent.parent.joinpath(*name.split("."))
    return next((f for f in (base.with_suffix(".py"), base / "__init__.py") if f.is_file()), None)


def imported_modules(file: Path) -> tuple[str, ...]:
    """Names of modules (or members of them) that a source file imports anywhere in it, by its syntax tree."""
    state = file.stat()
    return _imports_at(file, state.st_size, state.st_mtime_ns)


@lru_cache(maxsize=10_000)
def _imports_at(file: Path, _size: int, _modified_ns: int) -> tuple[str, ...]:
    """Imports of a file, parsed once in a process unless it changes: stages share most of their code."""
    names: list[str] = []
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return tuple(names)


_VERSIONED = (
    *("rescore", "numpy", "scipy", "opencv-python-headless", "scikit-learn", "joblib", "pydantic", "pyarrow"),
    *("open3d", "open3d-cpu", "rerun-sdk", "matplotlib", "trimesh", "pillow"),
)


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that results depend on; what is not installed is left out."""
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


CANDIDATE_COLUMNS = {
    "detector": pa.string(),
    "image_id": pa.int64(),
    "rank": pa.int64(),
    **dict.fromkeys(("x0", "y0", "x1", "y1", "detector_score", "likelihood"), pa.float64()),
    "status": pa.string(),
    "reason_detail": pa.string(),
    **dict.fromkeys(("depth_difference", "scale", "offset", "valid_share"), pa.float64()),
    **dict.fromkeys(("stereo_low", "stereo_span", "posterior_paper", "w"), pa.float64()),
    "outcome_detector": pa.string(),
    "outcome_paper": pa.string(),
    "annotation_id_detector": pa.int64(),
    "annotation_id_paper": pa.int64(),
    "kind": pa.string(),
}
"""Columns of candidates.parquet that are always there: a row a candidate."""

_ADDED_COLUMNS = {
    **dict.fromkeys(("cue", "difference", "posterior", "w"), pa.float64()),
    **dict.fromkeys(("status", "outcome"), pa.string()),
    "annotation_id": pa.int64(),
}
"""Kind of further columns by what their name begins with: ``cue_<name>`` of each part of the evidence;
``difference_<mode>`` (D), ``posterior_<mode>``, ``w_<mode>``, ``status_<mode>``, ``outcome_<mode>`` and
``annotation_id_<mode>`` of each mode but that of the paper."""


def write_candidates(path: Path, columns: Mapping[str, Any]) -> None:
    """Write candidates.parquet.

    Raises:
        ValueError: a column of ``CANDIDATE_COLUMNS`` is missing, or one is unknown.
    """
    kinds = dict(CANDIDATE_COLUMNS)
    for name in columns:
        for start, kind in _ADDED_COLUMNS.items():
            if name.startswith(f"{start}_"):
                kinds.setdefault(name, kind)
    if set(columns) != set(kinds):
        raise ValueError(f"candidates: columns differ: {sorted(set(columns) ^ set(kinds))}")
    write_table(path, {name: pa.array(columns[name], type=kind) for name, kind in kinds.items()})


class TableFormat(StrEnum):
    """Forms of tables, by the end of the file's name."""

    CSV = "csv"
    PARQUET = "parquet"


def write_table(path: Path, columns: Mapping[str, Any]) -> None:
    """Write columns of one length as a table: CSV where the path ends with .csv, else Parquet."""
    table = pa.table(dict(columns))
    with atomic_path(path) as beside:
        if path.suffix == f".{TableFormat.CSV}":
            pa_csv.write_csv(table, beside)
        else:
            pq.write_table(table, beside, compression="zstd")


def read_candidates(path: Path, needed: Iterable[str] = tuple(CANDIDATE_COLUMNS)) -> dict[str, NDArray[Any]]:
    """The columns of candidates.parquet as arrays of one length.

    Raises:
        RescoreError: no such file, not a table of candidates, or a column of ``needed`` is missing.
    """
    if not path.is_file():
        raise RescoreError(f"{path}: expected a table of candidates, found no file; run `rescore evaluate`")
    try:
        table = pq.read_table(path)
    except (pa.ArrowException, OSError) as error:
        raise RescoreError(f"{path}: expected a table of candidates, got {error}; write it again") from error
    missing = [name for name in needed if name not in table.column_names]
    if missing:
        raise RescoreError(
            f"{path}: expected column {missing[0]!r}, found none; run `rescore evaluate` again"
        )
    return {name: table[name].to_numpy(zero_copy_only=False) for name in table.column_names}
