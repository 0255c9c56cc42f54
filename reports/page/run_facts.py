"""What was run: settings, versions, seed, and which frames, so that two runs can be told apart or matched."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from reports.palette import detector_name
from reports.run.frame_view import run_dataset
from reports.run.tables import Table, number
from rescore.data.frames import SPLITS, DataSet
from rescore.results.candidate_file import ALONE
from rescore.results.run_folder import Run

_TOLD_BY_DETECTOR = ("rescore", "rescored", "detections", "predicted")
"""Settings that are told with the detector that they rescore, and names of files."""
HASH_DIGITS = 16
"""Hexadecimal digits shown of a hash."""


@dataclass(frozen=True)
class IdList:
    """The frames of one split."""

    split: str
    n_images: int
    n_cars: int
    images: str
    """SHA-256 of the lines "image id, tab, file name", by id, as hexadecimal digits."""
    shapes: str
    """SHA-256 of the names of the car shapes, a line each, by name; empty where they have none."""


def id_lists(data: DataSet) -> tuple[IdList, ...]:
    """The lists of every split that has frames, the usual splits first."""
    splits = {f.split for f in data.frames}
    order = [*(s for s in SPLITS if s in splits), *sorted(splits - set(SPLITS))]
    return tuple(_id_list(split, data.split(split), data) for split in order)


def _id_list(name: str, part: DataSet, data: DataSet) -> IdList:
    files = {f.image_id: f.left_path for f in part.frames}
    names = [
        p.relative_to(data.root).as_posix() if p.is_relative_to(data.root) else p.name for p in files.values()
    ]
    images = sorted(zip(files, names, strict=True))
    shapes = sorted({s for t in part.truth.values() for s in t.shape_id if s})
    return IdList(
        name,
        len(images),
        sum(int((~t.ignore).sum()) for t in part.truth.values()),
        _digest(f"{i}\t{file}" for i, file in images),
        _digest(shapes) if shapes else "",
    )


def _digest(lines: Any) -> str:
    return hashlib.sha256("".join(f"{line}\n" for line in lines).encode()).hexdigest()


def id_table(run: Run) -> Table:
    """The splits of a run's data set with their hashes.

    Raises:
        RescoreError: the data set is not where the run says.
    """
    rows = tuple(
        (
            one.split or "without a split",
            one.images[:HASH_DIGITS],
            one.shapes[:HASH_DIGITS] or "–",
            str(one.n_images),
            str(one.n_cars),
        )
        for one in id_lists(run_dataset(run))
    )
    head = ("split", "hash of the image ids", "hash of the car shapes", "images", "cars")
    return Table("Frames of the data set", head, rows, text_columns=3)


def made_from(run: Run) -> list[tuple[str, str]]:
    """What was run, as name and value."""
    config = run.config
    rows = [
        ("run folder", run.root.name),
        ("command", config.command),
        ("preset", config.config.preset),
        ("seed", config.seed),
        ("evaluated", f"{run.metrics.n_images} images of split {run.split}"),
        ("versions", ", ".join(f"{n} {v}" for n, v in config.versions.items()) or None),
    ]
    return [(name, str(value)) for name, value in rows if value is not None]


def differing_settings(runs: Mapping[str, Run]) -> Table | None:
    """Table of the settings, seeds and versions that differ between runs, a row each; None where none
    does."""
    # where each has one detector alone these are compared, whatever they are called
    alone = all(len(run.detectors) == 1 for run in runs.values())
    flat = [_comparable(run, alone) for run in runs.values()]
    # what only one kind of command has cannot differ
    keys = [key for key in flat[0] if all(key in values for values in flat)]
    told: dict[tuple[str, ...], list[str]] = {}
    for detector, setting in keys:
        values = [one[detector, setting] for one in flat]
        if len(set(values)) > 1:
            # what several detectors say alike is one row
            told.setdefault((setting, *values), []).append(detector)
    rows = tuple((": ".join(filter(None, (", ".join(who), row[0]))), *row[1:]) for row, who in told.items())
    return (
        Table("Settings that differ", ("setting", *runs), rows, text_columns=1 + len(runs)) if rows else None
    )


def _comparable(run: Run, alone: bool) -> dict[tuple[str, str], str]:
    """Settings as text, by detector ("" for all) and name; what rescored first, names of files left out.

    ``alone`` has those of the only detector under "".
    """
    value, made = run.config.as_json(), run.config.config
    rest = {name: v for name, v in made.everything.items() if name not in _TOLD_BY_DETECTOR}
    general = _flat(
        {"detectors": [detector_name(d, short=True) for d in run.detectors]}
        | {name: value.get(name) for name in ("command", "seed", "stereo", "data")}
        | rest
        | {"versions": run.config.versions}
    )
    own = {("" if alone else who, name): text for (who, name), text in _rescored(run).items()}
    return own | {("", name): text for name, text in general.items()}


def _rescored(run: Run) -> dict[tuple[str, str], str]:
    """Scores and w of each detector, and the settings of its last mode."""
    told: dict[tuple[str, str], str] = {}
    for detector in run.detectors:
        rows = [row for row in run.metrics.rows if row.detector == detector]
        modes, last = [row.mode for row in rows if row.mode != ALONE], rows[-1]
        settings = {"scores": modes or "alone", "w": number(last.w, 2)}
        settings |= made_with(run, detector, last.mode) if modes else {}
        name = detector_name(detector, short=True)
        told |= {(name, key): text for key, text in _flat(settings).items()}
    return told


def made_with(run: Run, detector: str, mode: str) -> dict[str, Any]:
    """The settings that rescored in a mode, by a name for people."""
    found = dict(run.config.config.rescored_with(detector, mode))
    shift = found.pop("log_odds_shift", None)
    for told_elsewhere in ("w", "registration", "rescore", "split"):
        found.pop(told_elsewhere, None)
    return found if shift is None else {"share of cars: log odds moved by": f"{shift:+.2f}", **found}


def _flat(value: Any, name: str = "") -> dict[str, str]:
    """Settings by their dotted name, as text."""
    if isinstance(value, Mapping):
        parts = [_flat(v, f"{name}.{k}" if name else str(k)) for k, v in value.items()]
        return {k: v for part in parts for k, v in part.items()}
    text = (
        ", ".join(str(v) for v in value)
        if isinstance(value, Sequence) and not isinstance(value, str)
        else value
    )
    return {name: "–" if text is None else str(text)}
