"""A rescorer in one file, as it comes with the package: class model, evidence model, w and settings."""

import gzip
import json
from dataclasses import dataclass
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from recon.class_model import ClassModel
from recon.files import atomic_path
from recon.reading import reading
from rescore.defaults import default_rescorer_file
from rescore.evidence.model import EvidenceModel, models_as_json, models_of_json
from rescore.evidence.registration import Registration
from rescore.evidence.settings import RescoreConfig
from rescore.results.run_config_file import rescore_config

FORMAT = "rescorer bundle 1"


@dataclass(frozen=True, eq=False)
class Bundle:
    """All that rescoring needs, for boxes of any detector that come with likelihoods."""

    class_model: ClassModel
    evidence_model: EvidenceModel
    w: float
    config: RescoreConfig
    made_with: tuple[str, ...]
    """The commands that made it, first to last."""

    @property
    def words(self) -> str:
        """What it is, in one line."""
        return (
            f"class model, evidence (mode {self.evidence_model.registration}) and w {self.w:.2f} that come "
            f"with the package for class {self.class_model.class_name!r}, made by `{self.made_with[-1]}`"
        )


def default_bundle(class_name: str) -> Bundle:
    """The bundle that comes with the package for a class.

    Raises:
        RescoreError: none comes with it for this class, or its file is damaged.
    """
    return read_bundle(default_rescorer_file(class_name))


def read_bundle(file: Traversable) -> Bundle:
    """What ``write_bundle`` wrote.

    Raises:
        RescoreError: something else.
    """
    where = Path(str(file))
    with reading(where, f"a rescorer ({FORMAT!r})", "install the package again"):
        value = json.loads(gzip.decompress(file.read_bytes()))
        if value["format"] != FORMAT:
            raise ValueError(f"format {value['format']!r}")
        mode = Registration(value["registration"])
        return Bundle(
            class_model=ClassModel.from_json(value["class_model"], where),
            evidence_model=models_of_json(value["evidence_model"], where)[mode],
            w=float(value["w"]),
            config=rescore_config(value["settings"]),
            made_with=tuple(str(command) for command in value["made_with"]),
        )


def write_bundle(path: Path, bundle: Bundle) -> None:
    """Write a bundle as one compressed JSON file; the same bundle gives the same bytes."""
    mode = bundle.evidence_model.registration
    value: dict[str, Any] = {
        "format": FORMAT,
        "made_with": list(bundle.made_with),
        "registration": mode.value,
        "w": bundle.w,
        "settings": TypeAdapter(RescoreConfig).dump_python(bundle.config, mode="json"),
        "evidence_model": models_as_json({mode: bundle.evidence_model}),
        "class_model": bundle.class_model.as_json(),
    }
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    with atomic_path(path) as beside:
        beside.write_bytes(gzip.compress(text.encode(), mtime=0))
