"""What was learned for the table, kept in a folder: the same settings do not learn it again."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from datasets_synth.cars.shapes import CarModel
from recon.class_model import ClassModel
from recon.errors import RescoreError
from recon.files import atomic_path
from recon.localization.heading import Heading
from recon.reading import arrays_of, reading
from rescore.engines.executor import Workers
from rescore.experiment.source_digest import source_digest
from rescore.files import read_json_object, remove, versions, write_json
from rescore.speech import say
from rescore.studies.localization import learned
from rescore.studies.localization.learned import (
    TableClass,
    TableClassConfig,
    learn_class,
    learn_front_and_rear,
)

_MODEL, _HULLS, _HEADING, _SETTINGS = "class_model.json", "hulls.npz", "heading.json", "settings.json"
_Key = Mapping[str, object]


def kept_table_class(
    folder: Path,
    cars: Sequence[CarModel],
    config: TableClassConfig,
    jobs: Workers,
    others: Sequence[CarModel] = (),
) -> TableClass:
    """What training cars teach, read from a folder that holds it, else learned and written there.

    The class model with the shape space is written as soon as it is learned, so that a run that was stopped
    goes on with front and rear. What is read equals what was learned up to the rounding of its files, which
    is done either way.

    Args:
        folder: For the class model with the shape space, front and rear, and what they were learned from.
        cars: The training cars.
        config: Settings.
        jobs: Cars at a time while learning.
        others: Cars of other shapes, by which the cues for front and rear are weighed.
    """
    key = {
        "cars": [car.shape_id for car in cars],
        "others": [car.shape_id for car in others],
        "config": repr(config),
        "heading": config.heading_pictures > 0,
        "code": source_digest(learned),
        "versions": versions(),
    }
    known = _read(folder, key)
    if known is None:
        say(f"learning from {len(cars)} cars; each step that is done is kept in {folder}")
        folder.mkdir(parents=True, exist_ok=True)
        _learn(folder, key, cars, config, jobs, others)
        known = _read(folder, key)
    if known is None:
        raise RescoreError(f"{folder}: expected what was just written, got something else; try again")
    return known


def _learn(
    folder: Path,
    key: _Key,
    cars: Sequence[CarModel],
    config: TableClassConfig,
    jobs: Workers,
    others: Sequence[CarModel],
) -> None:
    """Write what is still to learn to the folder."""
    known = _unrounded(folder, key)
    if known is None:
        known = learn_class(cars, config, jobs)
        _write_class(folder, key, known)
    if key["heading"]:
        heading = learn_front_and_rear(known.space, cars, others, config, jobs)
        write_json(folder / _HEADING, heading.as_json)
    remove(folder / _HULLS)


def _write_class(folder: Path, key: _Key, known: TableClass) -> None:
    # last of all the settings, by which the rest is known to be of them
    for name in (_SETTINGS, _HEADING):
        remove(folder / name)
    replace(known.model, shape_space=known.space).save(folder / _MODEL)
    with atomic_path(folder / _HULLS) as beside:
        np.savez(beside, mean=known.space.mean, modes=known.space.modes)
    write_json(folder / _SETTINGS, key)


def _read(folder: Path, key: _Key) -> TableClass | None:
    """What a folder keeps; None where it was learned otherwise, is damaged, or is not all there."""
    known = _read_class(folder, key)
    if known is None or not key["heading"]:
        return known
    try:
        return replace(known, heading=Heading.load(folder / _HEADING))
    except RescoreError:
        return None


def _read_class(folder: Path, key: _Key) -> TableClass | None:
    """The class without front and rear; None where it was learned otherwise, or is damaged."""
    try:
        if read_json_object(folder / _SETTINGS, "settings") != key:
            return None
        model = ClassModel.load(folder / _MODEL)
    except RescoreError:
        return None
    space = model.shape_space
    return None if space is None else TableClass(replace(model, shape_space=None), space, None)


def _unrounded(folder: Path, key: _Key) -> TableClass | None:
    """The class as it was learned, for front and rear; None where there is none, or all was done."""
    known = _read_class(folder, key)
    if known is None:
        return None
    file = folder / _HULLS
    try:
        with reading(file, "hull functions", "learn them again"):
            hulls = arrays_of(file)
            # the class model's file has them in half precision, from which front and rear would differ
            space = replace(known.space, mean=hulls["mean"], modes=hulls["modes"])
    except RescoreError:
        return None
    return replace(known, space=space)
