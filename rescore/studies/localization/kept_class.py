"""What was learned for the table, kept in a folder: the same settings do not learn it again."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from datasets_synth.cars.shapes import CarModel
from recon.class_model import ClassModel
from recon.errors import RescoreError
from recon.localization.heading import Heading
from rescore.engines.executor import Workers
from rescore.experiment.source_digest import source_digest
from rescore.files import read_json_object, remove, versions, write_json
from rescore.speech import say
from rescore.studies.localization import learned
from rescore.studies.localization.learned import TableClass, TableClassConfig, learn_table_class

_MODEL, _HEADING, _SETTINGS = "class_model.json", "heading.json", "settings.json"


def kept_table_class(
    folder: Path,
    cars: Sequence[CarModel],
    config: TableClassConfig,
    jobs: Workers,
    others: Sequence[CarModel] = (),
) -> TableClass:
    """What training cars teach, read from a folder that holds it, else learned and written there.

    What is read equals what was learned up to the rounding of its files, which is done either way.

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
        say(f"learning from {len(cars)} cars; kept in {folder}")
        _write(folder, key, learn_table_class(cars, config, jobs, others=others))
        known = _read(folder, key)
    if known is None:
        raise RescoreError(f"{folder}: expected what was just written, got something else; try again")
    return known


def _write(folder: Path, key: dict[str, object], known: TableClass) -> None:
    # last of all the settings, by which the rest is known to be whole
    remove(folder / _SETTINGS)
    replace(known.model, shape_space=known.space).save(folder / _MODEL)
    if known.heading is None:
        remove(folder / _HEADING)
    else:
        write_json(folder / _HEADING, known.heading.as_json)
    write_json(folder / _SETTINGS, key)


def _read(folder: Path, key: dict[str, object]) -> TableClass | None:
    """What a folder keeps; None where it was learned otherwise, or is damaged."""
    try:
        if read_json_object(folder / _SETTINGS, "settings") != key:
            return None
        model = ClassModel.load(folder / _MODEL)
        heading = Heading.load(folder / _HEADING) if (folder / _HEADING).is_file() else None
    except RescoreError:
        return None
    if model.shape_space is None or (heading is None) != (key["heading"] is False):
        return None
    return TableClass(replace(model, shape_space=None), model.shape_space, heading)
