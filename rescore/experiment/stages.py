"""Cached stages: one whose config, inputs and code are those of its last finished run is not run again."""

import hashlib
import json
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

from recon.errors import RescoreError
from recon.files import clear_partials
from rescore.experiment.source_digest import source_digest
from rescore.files import digest_of, read_json, remove, write_json
from rescore.speech import doing

RECORDS = ".stages"
"""Folder of a run folder that holds a record of each finished stage."""


@dataclass(frozen=True)
class Stage:
    """One step of a run: what it is made from, and where its results go."""

    name: str
    config: Any
    """The part of the config that the stage depends on, as JSON values."""
    inputs: tuple[Path, ...]
    """Files and folders that the stage reads."""
    outputs: tuple[Path, ...]
    """Files and folders that the stage makes."""
    code: tuple[ModuleType, ...]
    """Modules that do the work; an edit of one, or of a module that one imports, makes the result stale."""
    resumes: bool = False
    """Whether the work can go on in the folder that a killed run left."""

    def key(self, root: Path) -> str:
        """Hash of name, config, code and the content of all inputs (paths relative to the run folder)."""
        description = {
            "name": self.name,
            "config": self.config,
            "code": source_digest(*self.code),
            "inputs": [[os.path.relpath(p, root), digest_of(p)] for p in self.inputs],
        }
        text = json.dumps(description, sort_keys=True, default=str)
        return hashlib.sha256(text.encode()).hexdigest()


@dataclass(frozen=True)
class Done:
    """What became of a stage: done now, or reused from an earlier run."""

    name: str
    reused: bool
    seconds: float
    """Time of the work itself, also where an earlier run did it."""


def run_stage(root: Path, stage: Stage, work: Callable[[Path], None]) -> Done:
    """Do the work of a stage with one output, unless its result is there already.

    ``work`` gets a path beside the output to write to (for a folder, it makes the folder). Only when it is
    through does that become the output, and only then is the record of the stage written: a run that is
    killed leaves either the old result or the new one, and the next run does what is missing.
    """
    (output,) = stage.outputs
    key = stage.key(root)
    # work that goes on must find its folder again; any other has a name of this process alone
    unique = "" if stage.resumes else f".{os.getpid()}"
    beside = output.with_name(f".{output.stem}.{key[:12]}{unique}.partial{output.suffix}")

    def build() -> None:
        _remove_leftovers(output, keep=beside if stage.resumes else None)
        beside.parent.mkdir(parents=True, exist_ok=True)
        work(beside)
        remove(output)
        os.replace(beside, output)

    return _run(root, stage, key, build)


def run_stage_in_place(root: Path, stage: Stage, work: Callable[[], None]) -> Done:
    """Like ``run_stage``, for work that writes several outputs directly to their final paths."""

    def build() -> None:
        # what a killed run was writing through atomic_path
        for folder in {root, *(p for p in stage.outputs if p.is_dir())}:
            clear_partials(folder)
        work()

    return _run(root, stage, stage.key(root), build)


def _run(root: Path, stage: Stage, key: str, build: Callable[[], None]) -> Done:
    record_file = root / RECORDS / f"{stage.name}.json"
    record = _record(record_file)
    present = all(p.exists() for p in stage.outputs)
    if record.get("key") == key and present and record.get("outputs") == _digests(stage):
        return Done(stage.name, True, float(record["seconds"]))
    # without its record, nothing under the final names is taken for the result of this key
    record_file.unlink(missing_ok=True)
    started = time.perf_counter()
    with doing(stage.name):
        build()
    seconds = time.perf_counter() - started
    write_json(record_file, {"key": key, "outputs": _digests(stage), "seconds": seconds})
    return Done(stage.name, False, seconds)


def _digests(stage: Stage) -> list[str]:
    return [digest_of(p) for p in stage.outputs]


def _record(file: Path) -> Mapping[str, Any]:
    """The record of a stage; none where it is missing or damaged, so that the stage runs again."""
    try:
        value = read_json(file, "the record of a stage")
    except RescoreError:
        return {}
    return value if isinstance(value, dict) and isinstance(value.get("seconds"), int | float) else {}


def _remove_leftovers(output: Path, keep: Path | None) -> None:
    """Remove what killed runs left, but not what this run can go on with."""
    pattern = f".{output.stem}.*.partial{output.suffix}"
    leftovers: Sequence[Path] = sorted(output.parent.glob(pattern)) if output.parent.is_dir() else []
    for path in leftovers:
        if path != keep:
            remove(path)
