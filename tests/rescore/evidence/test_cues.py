"""Cues by their registry: what it holds, and a cue that is known by its entry there alone."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from recon.class_model import ClassModel
from recon.errors import RescoreError
from rescore.cues.framing import FRAMING
from rescore.cues.plausibility import CHECKS
from rescore.cues.surroundings import SURROUNDINGS
from rescore.cues.words import share
from rescore.data.frames import load_frame
from rescore.data.splits import Splits
from rescore.evidence.candidates import CandidateTable
from rescore.evidence.cues import (
    CUES,
    Columns,
    Cue,
    CueInput,
    checks_of,
    cue_column,
    cue_names,
    cues_of,
    cues_of_groups,
)
from rescore.evidence.fit_model import EvidenceConfig, fit_modes
from rescore.evidence.guarded import GUARDED
from rescore.evidence.model import load_models, save_models
from rescore.evidence.registration import Registration
from rescore.formats.coco import read_detections, write_rescored
from rescore.formats.coco_dataset import read_dataset
from rescore.fusion.rescore_frame import Rescoring, rescore_frame
from rescore.results.words import words_of
from rescore.studies.ablation import groups


def test_groups_of_cues_by_name() -> None:
    assert cues_of_groups(()) == ()
    assert set(cues_of_groups(("class model",))) == {*FRAMING, "rival"}
    with pytest.raises(RescoreError, match=r"group of cues: expected all relief, .*, got 'relief'; choose"):
        cues_of_groups(("class model", "relief"))


def test_every_cue_that_is_computed_has_an_entry() -> None:
    assert cue_names() == (
        *GUARDED,
        *SURROUNDINGS,
        "depth_ratio",
        *FRAMING,
        "rival",
        "resolved",
        *CHECKS,
        "relief_px",
        "side_on",
    )
    assert cues_of(Registration.PAPER) == ()
    assert cues_of(Registration.GUARDED) == GUARDED
    assert cues_of(Registration.METRIC) == (*GUARDED, *SURROUNDINGS, "depth_ratio")
    # what needs the size or the side that a car is taken to have is not asked beside an instance that says it
    assumed = ("width", "height", "relief", "support")
    around = tuple(name for name in SURROUNDINGS if name not in assumed)
    assert cues_of(Registration.INSTANCE) == (*around, *FRAMING, "rival")
    assert checks_of(Registration.GUARDED) == (*CHECKS[:1], "relief_px", "side_on")
    assert checks_of(Registration.INSTANCE) == ("measured", *CHECKS[1:])
    assert checks_of(Registration.METRIC) == ("measured", *CHECKS)
    for mode in (Registration.METRIC, Registration.INSTANCE):
        grouped = [name for names in groups(mode).values() for name in names]
        assert sorted(grouped) == sorted(cues_of(mode))


def brightness(given: CueInput) -> Columns:
    """Mean brightness of the picture in each box, in [0, 1]."""
    found = np.full(len(given.xyxy_px), np.nan)
    for i, (x0, y0, x1, y1) in enumerate(np.maximum(given.xyxy_px, 0).astype(int)):
        inside = given.frame.left_rgb[y0:y1, x0:x1]
        found[i] = inside.mean() / 255 if inside.size else np.nan
    return {"brightness": found}


@pytest.fixture
def bright(monkeypatch: pytest.MonkeyPatch) -> None:
    modes = frozenset({Registration.METRIC})
    monkeypatch.setitem(CUES, "brightness", Cue(brightness, share("{} bright"), "looks", modes))


@pytest.mark.usefixtures("bright")
def test_a_toy_cue_is_computed_fitted_kept_and_told(tiny_run: Path, tmp_path: Path) -> None:
    data = read_dataset(tiny_run / "data")
    model = ClassModel.load(tiny_run / "models" / "class_model.json")
    fitting = Splits.of(data).fitting_set
    file = tiny_run / "rescored" / "hog_{}_evidence.json"
    tables = []
    for split in ("train", "calibration"):
        part = data.split(split)
        candidates = read_detections(Path(str(file).format(split)), part).candidates(part)
        tables += [
            rescore_frame(
                load_frame(f, Rescoring().config.stereo), candidates[f.image_id], model, Rescoring()
            )
            for f in part.frames
        ]
    table = CandidateTable.concatenate([t.candidates for t in tables])
    column = table.cues[:, cue_column("brightness")]
    assert np.isfinite(column).all()
    assert ((column > 0) & (column < 1)).all()
    models = fit_modes(table, fitting, EvidenceConfig(min_cars=1))
    assert "brightness" in models[Registration.METRIC].knots
    assert "brightness" not in models[Registration.GUARDED].knots
    save_models(tmp_path / "d.json", models)
    metric = load_models(tmp_path / "d.json")[Registration.METRIC]
    rescored = Rescoring(evidence_model=metric, w=0.5).fuse(table)
    part = replace(fitting.data)
    write_rescored(tmp_path / "r.json", "hog", rescored, part, w=0.5, registration=Registration.METRIC)
    back = read_detections(tmp_path / "r.json", part).table
    np.testing.assert_allclose(back.cues[:, cue_column("brightness")], column)
    assert words_of("brightness").told(0.25) == "25 % bright"
    assert groups(Registration.METRIC)["looks"] == ("brightness",)
