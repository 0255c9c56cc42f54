"""D is fitted on other places alone, and the figures are those of all candidates together."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import rescore.defaults
from recon.boxes import xywh_from_xyxy
from recon.errors import RescoreError
from recon.stereo.sgbm import write_disparity
from reports.studies.leave_one_out import places_page, write_places_study
from rescore.data.frames import DataSet, FrameRecord, Truth
from rescore.evidence.candidates import Candidates, CandidateTable
from rescore.evidence.cues import CUES, cue_column
from rescore.evidence.fit_model import EvidenceConfig
from rescore.library.bundles import write_bundle
from rescore.results.candidate_file import ALONE
from rescore.studies.leave_one_out import (
    AS_IT_IS,
    FITTED,
    LabelledPlaces,
    PlacesResult,
    leave_one_out,
    read_places,
)
from tests.recon.localization import stepped_car as car
from tests.rescore import shipped
from tests.rescore.spoiling import Run

CAR, OTHER = np.array([10.0, 10, 60, 30]), np.array([100.0, 50, 150, 70])
PLACES = tuple(tuple(range(first, first + 5)) for first in range(0, 40, 5))
"""Eight places of five frames."""


def labelled(table: CandidateTable, no_cars_in: tuple[int, ...] = ()) -> LabelledPlaces:
    """Frames with a car each, but for some."""
    frames, truth = [], {}
    for i in (i for place in PLACES for i in place):
        frames.append(FrameRecord(i, Path(f"{i}.png"), None, None, "test", 200, 100, None, None))
        boxes = CAR[None][: 0 if i in no_cars_in else 1]
        n = len(boxes)
        truth[i] = Truth(np.full(n, i), boxes, np.zeros(n, bool), np.ones(n), ("",) * n)
    return LabelledPlaces(DataSet(Path(), 1, "car", tuple(frames), truth), PLACES, table)


@pytest.fixture(scope="module")
def table() -> CandidateTable:
    """A candidate on the car and four others in each frame; two cues tell them apart, not by much."""
    rng = np.random.default_rng(0)
    boxes, tables = np.stack([CAR, *(OTHER + 3 * k for k in range(4))]), []
    for image_id in (i for place in PLACES for i in place):
        likelihood, cues = rng.uniform(0.2, 0.8, 5), rng.normal(0, 1, (5, len(CUES)))
        cues[:, cue_column("resolved")] = 1
        cues[0, [cue_column("overlap"), cue_column("foot")]] += 1.5
        found = Candidates(image_id, boxes, likelihood, likelihood)
        tables.append(replace(CandidateTable.of_candidates([found]), cues=cues))
    return CandidateTable.concatenate(tables)


def d_by_place(given: LabelledPlaces) -> list[np.ndarray]:
    judged, _ = leave_one_out(given, EvidenceConfig(), 1)
    return [judged.depth_difference[np.isin(judged.image_id, place)] for place in PLACES]


def test_labels_of_a_place_never_teach_its_own_d(table: CandidateTable) -> None:
    before = d_by_place(labelled(table))
    after = d_by_place(labelled(table, no_cars_in=PLACES[2]))
    np.testing.assert_array_equal(after[2], before[2])
    for number in set(range(len(PLACES))) - {2}:
        assert np.abs(after[number] - before[number]).max() > 0.01


def test_candidates_of_a_place_never_teach_its_own_d(table: CandidateTable) -> None:
    # all but the first candidate of the place are turned round, which would teach the opposite
    spoilt = table.cues.copy()
    own = np.flatnonzero(np.isin(table.image_id, PLACES[2]))
    spoilt[own[1:]] *= -3
    before, after = d_by_place(labelled(table)), d_by_place(labelled(replace(table, cues=spoilt)))
    assert after[2][0] == before[2][0]
    assert after[2][1] != before[2][1]
    assert all(np.abs(after[k] - before[k]).max() > 0.01 for k in (0, 1, 3, 7))


def test_facts_of_places(table: CandidateTable) -> None:
    judged, facts = leave_one_out(labelled(table, no_cars_in=PLACES[0][:2]), EvidenceConfig(), 1)
    assert judged.image_id.tolist() == table.image_id.tolist()
    assert [f.image_ids for f in facts] == list(PLACES)
    assert [f.n_cars for f in facts] == [3] + 7 * [5]
    assert {f.n_candidates for f in facts} == {25}
    assert [(f.n_cars_of_others, f.n_others) for f in facts] == [(35, 175)] + 7 * [(33, 175)]


def test_a_place_too_large_to_leave_out_is_named(table: CandidateTable) -> None:
    given = labelled(table)
    first, *rest = (tuple(range(31)), tuple(range(31, 40)))
    with pytest.raises(RescoreError) as caught:
        leave_one_out(replace(given, places=(first, *rest)), EvidenceConfig(), 1)
    message = str(caught.value)
    assert message.startswith("place 1 of 2 (31 of 40 frames), left out: depth evidence (instance): expected")
    assert "at least 10 cars" in message
    assert "got 9 cars of 45" in message
    assert "\n" not in message


def write_places(root: Path) -> tuple[Path, Path]:
    """Six places of two frames: one picture twice, and a car that a part of it outranks; and its boxes."""
    root.mkdir()
    camera, rng = car.RIG.stereo.left, np.random.default_rng(0)
    lens = {"fx": camera.fx_px, "fy": camera.fy_px, "cx": camera.cx_px, "cy": camera.cy_px}
    rig = lens | {"baseline_m": car.RIG.stereo.baseline_m, "height_m": 1.65, "pitch_rad": 0.0}
    exact = car.disparity_of(shipped.PLACE)
    whole, half, beside = shipped.boxes_px()
    half[2] -= 10
    images, annotations, rows = [], [], []
    for k in range(12):
        name = f"left_{k // 2}.png"
        _draw_texture(root / name, k // 2, camera.width_px, camera.height_px)
        noise = rng.normal(0, 0.3, exact.shape)
        write_disparity(root / f"disparity_{k}.png", (exact + noise).astype(np.float32))
        size = {"width": camera.width_px, "height": camera.height_px, "split": "test"}
        files = {"file_name": name, "disparity_file_name": f"disparity_{k}.png"}
        images.append({"id": k, "camera": rig} | files | size)
        (box,) = xywh_from_xyxy(whole[None]).tolist()
        annotations.append({"id": k, "image_id": k, "category_id": 1, "bbox": box})
        found = xywh_from_xyxy(np.stack([whole, half, beside]) + rng.uniform(-2, 2, (3, 4))).tolist()
        scores = rng.uniform((0.4, 0.5, 0.3), (0.7, 0.8, 0.6)).tolist()
        rows += [
            {"image_id": k, "category_id": 1, "bbox": b, "score": s}
            for b, s in zip(found, scores, strict=True)
        ]
    kinds = [{"id": 1, "name": "car"}]
    content = {"images": images, "annotations": annotations, "categories": kinds}
    (root / "annotations.json").write_text(json.dumps(content))
    (root / "found.json").write_text(json.dumps(rows))
    return root, root / "found.json"


def _draw_texture(path: Path, seed: int, width_px: int, height_px: int) -> None:
    rng = np.random.default_rng(seed)
    coarse = rng.integers(0, 255, (height_px // 12, width_px // 12, 3)).astype(np.uint8)
    cv2.imwrite(str(path), cv2.resize(coarse, (width_px, height_px), interpolation=cv2.INTER_CUBIC))


def test_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run: Run) -> None:
    folder = tmp_path / "defaults"
    folder.mkdir()
    monkeypatch.setattr(rescore.defaults, "FOLDER", folder)
    write_bundle(folder / f"car{rescore.defaults.SUFFIX}", shipped.bundle())
    data, found = write_places(tmp_path / "street")
    out = tmp_path / "out" / "places.json"
    code, shown, err = run("study-places", data, found, "--out", out, "--jobs", 1)
    assert code == 0, err
    told = "12 frames with 12 annotated cars are of 6 places; the largest has 2 frames with 2 cars"
    assert told in " ".join(shown.split())
    result = read_places(out)
    assert [p.image_ids for p in result.places] == [(k, k + 1) for k in range(0, 12, 2)]
    assert {(p.n_cars, p.n_candidates, p.n_cars_of_others, p.n_others) for p in result.places} == {
        (2, 6, 10, 30)
    }
    assert (result.w, result.n_images, result.n_cars, result.n_candidates) == (0.4, 12, 12, 36)
    _check_figures(result)
    page = out.with_suffix(".md")
    assert page.read_text() == places_page(result, "places.png")
    assert out.with_suffix(".png").stat().st_size > 10_000
    written = out.read_bytes()
    code, _, err = run("study-places", data, found, "--out", out, "--jobs", 2)
    assert (code, out.read_bytes()) == (0, written), err
    again = write_places_study(result, tmp_path / "again.json")
    assert (again.name, again.with_suffix(".json").read_bytes()) == ("again.md", written)


def _check_figures(result: PlacesResult) -> None:
    precision = {name: figures.average_precision.value for name, figures in result.figures.items()}
    assert precision[ALONE] < 0.9
    assert precision[AS_IT_IS] == 1
    # below a check of a hundredth D is silent
    assert precision[FITTED] > 0.98
    assert result.figures[FITTED].with_evidence > 0.8
    assert result.figures[FITTED].fppi["0.9"].value == 0 < result.figures[ALONE].fppi["0.9"].value
    gain = next(c.change for c in result.comparisons if (c.before, c.after) == (ALONE, FITTED))
    assert gain.average_precision.value == pytest.approx(precision[FITTED] - precision[ALONE])
    assert set(gain.factor) == {"0.5", "0.6", "0.7", "0.8", "0.9"}


def test_what_cannot_be_is_one_line(tmp_path: Path, run: Run) -> None:
    data, found = shipped.write_street(tmp_path / "street")
    code, _, err = run("study-places", data, found, "--out", tmp_path / "places")
    assert (code, err.count("\n")) == (1, 1)
    assert "--out: expected a name that ends in .json, got 'places'" in err
    shipped.class_model().save(tmp_path / "car.json")
    paper = tmp_path / "paper.json"
    paper.write_text(json.dumps({"format": "rescorer 1", "class_model": "car.json", "w": 0.5}))
    out = tmp_path / "places.json"
    code, _, err = run("study-places", data, found, "--out", out, "--rescorer", paper, "--jobs", 1)
    assert (code, err.count("\n")) == (1, 1)
    assert "expected a rescorer of mode instance with a class model, got mode paper" in err
    assert not out.exists()
