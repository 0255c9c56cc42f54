"""A class model and an evidence model for tests that judge rendered things.

``data/`` holds those of a run of preset "paper" with seed 1000 (HOG). They must be written anew when cues or
their format change: ``rescore reproduce --preset paper --seed 1000``.
"""

import gzip
from pathlib import Path

from recon.class_model import ClassModel
from rescore.evidence.model import load_models
from rescore.evidence.settings import RescoreConfig
from rescore.studies.distractors import Judge

DATA = Path(__file__).parent / "data"


def stored_judge(scratch: Path) -> Judge:
    """What says D of a candidate; ``scratch`` is a folder to unpack to."""
    model = scratch / "class_model.json"
    model.write_bytes(gzip.decompress((DATA / "class_model.json.gz").read_bytes()))
    return Judge(ClassModel.load(model), RescoreConfig(), load_models(DATA / "evidence.json"))
