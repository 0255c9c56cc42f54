from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from recon.camera import DEFAULT_GROUND, GroundedCamera, default_camera
from recon.class_model import ClassModel
from recon.errors import Failure, Reason, RescoreError
from recon.reconstruction.reconstruct import Reconstruction
from recon.stereo.sgbm import SgbmConfig
from rescore.data.frames import DataSet, Frame, load_frame
from rescore.evidence.align_depth import DepthAlignment
from rescore.evidence.candidates import Candidates
from rescore.evidence.files import evidence_path, read_evidence, write_evidence
from rescore.evidence.instances import assumed_camera
from rescore.evidence.settings import CameraChoice, RescoreConfig
from rescore.formats.coco import read_detections
from rescore.formats.coco_dataset import read_dataset
from rescore.fusion.rescore_frame import Rescoring, rescore_frame
from rescore.fusion.rescore_frames import rescore_frames


@pytest.fixture(scope="module")
def model(tiny_run: Path) -> ClassModel:
    return ClassModel.load(tiny_run / "models" / "class_model.json")


@pytest.fixture(scope="module")
def data(tiny_run: Path) -> DataSet:
    return read_dataset(tiny_run / "data").split("test")


@pytest.fixture(scope="module")
def frame(data: DataSet) -> Frame:
    return load_frame(data.frames[0], SgbmConfig())


@pytest.fixture(scope="module")
def candidates(tiny_run: Path, data: DataSet) -> dict[int, Candidates]:
    return read_detections(tiny_run / "detections" / "hog_test.json", data).candidates(data)


def with_outside_box(c: Candidates) -> Candidates:
    """The candidates with one more that lies outside the picture."""
    box = np.array([[5000.0, 10, 5100, 50]])
    return Candidates(
        c.image_id,
        np.concatenate([c.xyxy_px, box]),
        np.append(c.score, c.score.min() - 1),
        np.append(c.likelihood, 0.01),
    )


def test_each_candidate_gets_evidence_or_a_reason(
    frame: Frame, candidates: dict[int, Candidates], model: ClassModel
) -> None:
    given = with_outside_box(candidates[frame.image_id])
    got = rescore_frame(frame, given, model, Rescoring(w=0.5))
    assert len(got.alignments) == len(got.posterior) == len(given)
    assert any(isinstance(a, DepthAlignment) for a in got.alignments)
    last = got.alignments[-1]
    assert isinstance(last, Failure)
    assert last.reason is Reason.BOX_OUTSIDE_IMAGE
    assert got.posterior[-1] == 0.01
    for a, likelihood, posterior in zip(got.alignments, given.likelihood, got.posterior, strict=True):
        if isinstance(a, DepthAlignment):
            assert 0 <= a.difference <= 0.5
            assert posterior == pytest.approx(np.sqrt(likelihood * (1 - a.difference)))


def test_no_candidates(frame: Frame, model: ClassModel) -> None:
    none = Candidates(frame.image_id, np.zeros((0, 4)), np.zeros(0), np.zeros(0))
    assert len(rescore_frame(frame, none, model, Rescoring(w=0.5)).posterior) == 0


def test_a_scene_of_the_predicted_shape_has_difference_zero(
    frame: Frame, candidates: dict[int, Candidates], model: ClassModel
) -> None:
    given = candidates[frame.image_id]
    for k, instance in enumerate(rescore_frame(frame, given, model, Rescoring()).instances):
        if isinstance(instance, Failure):
            continue
        # measure just what is predicted, at another scale; without a camera, depth is 1 / disparity
        disparity = np.full(frame.disparity_px.shape, np.nan, np.float32)
        disparity[instance.depth.window] = 3 / instance.depth.depth
        one = Candidates(frame.image_id, given.xyxy_px[[k]], given.score[[k]], given.likelihood[[k]])
        exact = replace(frame, disparity_px=disparity, camera=None)
        (got,) = rescore_frame(exact, one, model, Rescoring()).alignments
        assert isinstance(got, DepthAlignment)
        # percentiles clip 4 % of the pixels, which leaves a little
        assert got.difference < 0.06
        assert got.scale > 0
        return
    pytest.fail("no candidate has a reconstruction")


def test_the_assumed_camera(frame: Frame) -> None:
    h, w = frame.left_rgb.shape[:2]
    assert assumed_camera(frame, CameraChoice.DEFAULT) == GroundedCamera(default_camera(w, h), DEFAULT_GROUND)
    assert frame.camera is not None
    assert assumed_camera(frame, CameraChoice.CALIBRATED) == GroundedCamera(frame.camera.left, frame.ground)
    unknown = replace(frame, camera=None, ground=None)
    assert assumed_camera(unknown, CameraChoice.CALIBRATED) == GroundedCamera(
        default_camera(w, h), DEFAULT_GROUND
    )


def test_where_the_ground_came_from_goes_with_the_candidates(
    frame: Frame, candidates: dict[int, Candidates], model: ClassModel
) -> None:
    given = candidates[frame.image_id]
    for changed, source in ((frame, "stated"), (replace(frame, ground=None), "default")):
        table = rescore_frame(changed, given, model, Rescoring()).candidates
        assert table.ground.tolist() == [source] * len(given)


def test_the_calibrated_camera_predicts_metres(
    frame: Frame, candidates: dict[int, Candidates], model: ClassModel
) -> None:
    given = candidates[frame.image_id]
    by = {
        choice: rescore_frame(frame, given, model, Rescoring(RescoreConfig(camera=choice))).candidates
        for choice in CameraChoice
    }
    solved = [(t.status == "ok").sum() for t in by.values()]
    assert min(solved) > 0
    assert not np.array_equal(
        by[CameraChoice.DEFAULT].scale, by[CameraChoice.CALIBRATED].scale, equal_nan=True
    )


def test_frames_in_parallel_equal_frames_one_by_one(
    tmp_path: Path, data: DataSet, candidates: dict[int, Candidates], model: ClassModel
) -> None:
    some = {i: c for i, c in candidates.items() if i != data.frames[1].image_id}  # one frame has none
    tables = [
        rescore_frames(data, some, model, Rescoring(), jobs=jobs, evidence_dir=tmp_path / "hog").candidates
        for jobs in (1, 2)
    ]
    assert set(tables[0].image_id.tolist()) == set(some)
    np.testing.assert_array_equal(tables[0].depth_difference, tables[1].depth_difference)
    assert tables[0].status.tolist() == tables[1].status.tolist()
    assert read_evidence(evidence_path(tmp_path / "hog", data.frames[1].image_id)) == ()


def test_evidence_files_give_back_what_was_written(
    tmp_path: Path, frame: Frame, candidates: dict[int, Candidates], model: ClassModel
) -> None:
    found = rescore_frame(frame, with_outside_box(candidates[frame.image_id]), model, Rescoring()).instances
    write_evidence(tmp_path / "e.npz", found)
    back = read_evidence(tmp_path / "e.npz")
    assert len(back) == len(found)
    assert back[-1] == found[-1]
    pairs = [(a, b) for a, b in zip(found, back, strict=True) if isinstance(a, Reconstruction)]
    assert pairs
    for a, b in pairs:
        assert isinstance(b, Reconstruction)
        np.testing.assert_array_equal(a.part_labels, b.part_labels)
        np.testing.assert_allclose(a.outline_px, b.outline_px, atol=1e-3)
        np.testing.assert_allclose(a.depth.depth, b.depth.depth, rtol=5e-4)
        assert (a.depth.x0_px, a.x0_px, a.placed_share) == (b.depth.x0_px, b.x0_px, b.placed_share)
        assert list(a.part_planes) == list(b.part_planes)
        np.testing.assert_array_equal(list(a.part_planes.values()), list(b.part_planes.values()))


def test_evidence_files_say_what_is_wrong(tmp_path: Path) -> None:
    with pytest.raises(RescoreError, match="expected an evidence file, found none"):
        read_evidence(tmp_path / "none.npz")
    (tmp_path / "bad.npz").write_bytes(b"PK no zip")
    with pytest.raises(RescoreError, match="expected an evidence file, could not read it"):
        read_evidence(tmp_path / "bad.npz")
