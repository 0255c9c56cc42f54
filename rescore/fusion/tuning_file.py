"""A tuned weight w as a file."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from recon.errors import RescoreError
from recon.reading import reading
from rescore.evidence.registration import CLASS_MODEL, Registration, check_depth_of
from rescore.files import read_json, refuse_unsafe_name
from rescore.fusion.fuse import LearnedFusion
from rescore.fusion.tune import OBJECTIVES, Tuning
from rescore.fusion.weight_interval import WeightInterval, WeightUncertainty


def tuning_as_json(tuning: Tuning) -> dict[str, Any]:
    """The choice of w with its curve, as JSON values; an undefined or infinite objective is null."""
    return {
        "detector": tuning.detector,
        "registration": tuning.registration.value,
        "w": tuning.w,
        "objective_name": tuning.objective,
        "w_grid": tuning.grid.tolist(),
        "objective": [v if np.isfinite(v) else None for v in tuning.value.tolist()],
        "n_images": tuning.n_images,
        "n_cars": tuning.n_cars,
        "uncertainty": None if (u := tuning.uncertainty) is None else WeightInterval.of(u).model_dump(),
        "sentence": tuning.sentence,
        "learned": None if tuning.learned is None else asdict(tuning.learned),
        "depth_of": tuning.depth_of,
    }


def load_tuning(path: Path) -> Tuning:
    """Read what ``tuning_as_json`` made.

    Raises:
        RescoreError: no such file, or something else in it.
    """
    value = read_json(path, "a tuned weight")
    with reading(path, "a tuned weight", "run `rescore tune` again"):
        refuse_unsafe_name(path, "the name of a detector", str(value["detector"]))
        if value["objective_name"] not in OBJECTIVES:
            raise ValueError(f"by objective {value['objective_name']!r}")
        tuning = Tuning(
            detector=str(value["detector"]),
            w=float(value["w"]),
            grid=np.array(value["w_grid"], dtype=float),
            value=np.array(value["objective"], dtype=float),
            n_images=int(value["n_images"]),
            n_cars=int(value["n_cars"]),
            registration=Registration(value.get("registration", Registration.PAPER)),
            uncertainty=_uncertainty(value.get("uncertainty")),
            learned=None if value.get("learned") is None else LearnedFusion(**value["learned"]),
            objective=str(value["objective_name"]),
            depth_of=str(value.get("depth_of", CLASS_MODEL)),
        )
    if not 0 <= tuning.w <= 1:
        raise RescoreError(f"{path}: expected w in [0, 1], got {tuning.w}; run `rescore tune` again")
    return tuning


def _uncertainty(value: Any) -> WeightUncertainty | None:
    """None where there is none, as in files of older versions."""
    if value is None:
        return None
    try:
        return WeightInterval.model_validate(value).uncertainty()
    except ValidationError as error:
        first = error.errors()[0]
        raise ValueError(f"uncertainty.{first['loc'][0]}: {first['msg']}") from error


def tuned_weight(path: Path, mode: Registration, depth_of: str = CLASS_MODEL) -> float:
    """The w that was tuned for a mode with someone's depth.

    Raises:
        RescoreError: no such file, or a weight for another mode or with another's depth.
    """
    tuning = load_tuning(path)
    if tuning.registration is not mode:
        raise RescoreError(
            f"{path}: expected a weight tuned for registration {mode}, got one for {tuning.registration}; "
            "tune again in this mode"
        )
    check_depth_of(str(path), tuning.depth_of, depth_of)
    return tuning.w
