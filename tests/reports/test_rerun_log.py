import json
import shutil
import subprocess
from collections import defaultdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
import pytest
import rerun_cli
from rerun.chunk import RrdReader

from reports.curves import curve_sets
from reports.evidence_view import frame_views
from reports.overlay import apply_transform, points_of_depth, world_from_camera
from reports.rerun_frame import (
    DEPTH_UNIT,
    HOLE_CLASS,
    OUTCOME_CLASSES,
    SHOWN_MODELS,
    label_spots,
    shown_models,
)
from reports.rerun_log import choose_frames, write_recording
from reports.rerun_plot import ASPECT
from reports.run_folder import Run, boxes_px

IMAGE = "/world/camera/image"
RERUN = Path(rerun_cli.__file__).parent / "rerun"


@pytest.fixture(scope="module")
def recording(run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_recording(run.root, tmp_path_factory.mktemp("rrd") / "recording.rrd", show=False)


def read(path: Path, entity: str) -> dict[int, dict[str, Any]]:
    """Component lists of an entity by frame; static ones at frame -1."""
    rows: dict[int, dict[str, Any]] = defaultdict(dict)
    for chunk in RrdReader(str(path)).stream().filter(content=entity):
        table = pa.Table.from_batches([chunk.to_record_batch()])
        frames = table["frame"].to_pylist() if "frame" in table.column_names else [-1] * table.num_rows
        for name in table.column_names:
            for frame, value in zip(frames, table[name].to_pylist(), strict=True):
                if value is not None and not name.startswith("rerun.controls"):
                    rows[frame][name] = value
    return rows


def test_boxes_and_scores_equal_the_match_table(run: Run, recording: Path):
    ids = choose_frames(run, None)
    for detector in run.detectors:
        rows = run.of(detector)
        parts = [read(recording, f"{IMAGE}/{detector}/candidates/{name}") for name in ("first", "rest")]
        seen = 0
        for frame, image_id in enumerate(ids):
            of_frame = rows["image_id"] == image_id
            for part in (p[frame] for p in parts if len(p[frame].get("rank", []))):
                centres, halves = np.array(part["Boxes2D:centers"]), np.array(part["Boxes2D:half_sizes"])
                for i, rank in enumerate(part["rank"]):
                    (row,) = np.flatnonzero(of_frame & (rows["rank"] == rank))
                    box = boxes_px({k: rows[k][[row]] for k in ("x0", "y0", "x1", "y1")})[0]
                    np.testing.assert_allclose(
                        [*(centres - halves)[i], *(centres + halves)[i]], box, atol=1e-3
                    )
                    assert part["likelihood"][i] == rows["likelihood"][row]
                    assert part["posterior"][i] == rows["posterior_paper"][row]
                    assert part["depth_difference"][i] == pytest.approx(
                        rows["depth_difference"][row], nan_ok=True
                    )
                    assert part["annotation_id"][i] == rows["annotation_id_paper"][row]
                    outcome = OUTCOME_CLASSES[part["Boxes2D:class_ids"][i]]
                    assert outcome == rows["outcome_paper"][row]
                    seen += 1
        assert seen == len(rows["rank"])


def test_annotated_cars_are_all_there_and_told_found_from_missed(run: Run, recording: Path):
    for detector in run.detectors:
        cars = read(recording, f"{IMAGE}/{detector}/candidates/cars")
        classes = [OUTCOME_CLASSES[c] for frame in cars.values() for c in frame.get("Boxes2D:class_ids", [])]
        assert len(classes) == run.metrics["n_cars"]
        ceiling = run.row(detector, "paper")["recall_ceiling"]
        assert classes.count("found") == round(ceiling * run.metrics["n_cars"])


def test_measured_depth_is_metres_and_holes_are_marked(run: Run, recording: Path):
    depths = read(recording, f"{IMAGE}/measured_depth/depth")
    masks = read(recording, f"{IMAGE}/measured_depth/holes")
    for frame, view in enumerate(frame_views(run, "paper")):
        (blob,) = depths[frame]["EncodedDepthImage:blob"]
        picture = cv2.imdecode(np.array(blob, np.uint8), cv2.IMREAD_UNCHANGED)
        seen = np.isfinite(view.measured)
        np.testing.assert_allclose(picture[seen] / DEPTH_UNIT, view.measured[seen], atol=0.501 / DEPTH_UNIT)
        assert (picture[~seen] == 0).all()
        assert depths[frame]["EncodedDepthImage:meter"] == [DEPTH_UNIT]
        (mask,) = masks[frame]["SegmentationImage:buffer"]
        np.testing.assert_array_equal(np.array(mask, np.uint8).reshape(seen.shape) == HOLE_CLASS, ~seen)


def test_models_lie_on_the_measured_points_of_the_cars_they_fit(run: Run, recording: Path):
    models = read(recording, "/world/hog/models/first")
    checked = 0
    for frame, view in enumerate(frame_views(run, "paper")):
        best = [c for c in view.candidates["hog"] if c.new_rank < 3]
        fits = [c for c in best if c.depth_difference < 0.01]
        vertices = np.array(models[frame]["Mesh3D:vertex_positions"])
        for c in fits:
            assert c.instance is not None
            world = apply_transform(
                world_from_camera(view.ground), points_of_depth(view.measured, view.camera)
            )
            measured = world[c.instance.depth.window][np.isfinite(c.registered)]
            measured = measured[np.isfinite(measured[:, 0])]
            gap = np.linalg.norm(vertices[:, None] - measured[None], axis=2).min(axis=1)
            # the vertices of this candidate lie on its points; those of the two others need not
            assert (gap < 0.03).sum() > 150
            checked += 1
    assert checked >= 2


def test_the_file_is_whole_and_blueprint_and_guide_are_inside(run: Run, recording: Path):
    done = subprocess.run(
        [RERUN, "rrd", "verify", str(recording)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    reader = RrdReader(str(recording))
    assert len(reader.blueprints()) == 1
    (guide,) = read(recording, "/guide")[-1]["TextDocument:text"]
    for row in run.metrics["rows"]:
        assert f"{row['auc']:.3f}" in guide


def test_curves_in_the_recording_are_those_of_the_run(run: Run, recording: Path):
    for c in curve_sets(run):
        strips = read(recording, f"/curves/candidate_roc/{c.detector}_{c.mode}")[-1]["LineStrips2D:strips"]
        points = np.concatenate([np.array(s) for s in strips])
        if c.mode != "detector":
            np.testing.assert_allclose(points[:, 0] / ASPECT, c.candidate.x, atol=1e-6)
            np.testing.assert_allclose(-points[:, 1], c.candidate.y, atol=1e-6)


def test_the_same_run_gives_the_same_content(run: Run, recording: Path, tmp_path: Path):
    again = write_recording(run.root, tmp_path / "again.rrd", show=False)
    summaries = [RrdReader(str(p)).store().summary() for p in (recording, again)]
    assert summaries[0] == summaries[1]
    assert read(recording, f"{IMAGE}/left") == read(again, f"{IMAGE}/left")
    assert [p.name for p in tmp_path.iterdir()] == ["again.rrd"]


def test_fewer_frames_are_spread_over_the_test_set(run: Run, tmp_path: Path):
    assert choose_frames(run, 3).tolist() == [1, 3, 5]
    assert choose_frames(run, 99).tolist() == [1, 2, 3, 4, 5]
    small = write_recording(run.root, tmp_path / "small.rrd", max_frames=1, show=False)
    assert sorted(read(small, f"{IMAGE}/left")) == [0]


def test_labels_do_not_lie_on_one_another():
    boxes = np.array([[10, 10, 60, 50], [12, 12, 62, 52], [15, 10, 70, 51], [400, 100, 500, 470]], float)
    spots = label_spots(boxes, 640, 480)
    for i, a in enumerate(spots):
        for b in spots[:i]:
            assert abs(a[0] - b[0]) >= 200 or abs(a[1] - b[1]) >= 20
    assert label_spots(np.zeros((0, 4)), 640, 480).shape == (0, 2)


def test_pictures_of_several_sizes_store_depth_plain(run_dir: Path, tmp_path: Path):
    # Rerun takes PNGs of one entity for a video, whose frames must have one size
    shutil.copytree(run_dir, tmp_path / "run")
    file = tmp_path / "run" / "data" / "annotations.json"
    value = json.loads(file.read_text())
    image = value["images"][0]
    for name in ("file_name", "disparity_file_name"):
        path = file.parent / image[name]
        cv2.imwrite(str(path), cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[:-8])
    image["height"] -= 8
    file.write_text(json.dumps(value))
    out = write_recording(tmp_path / "run", tmp_path / "mixed.rrd", max_frames=2, show=False)
    depth = read(out, f"{IMAGE}/measured_depth/depth")
    assert all("DepthImage:buffer" in row for row in depth.values())
    assert len(depth) == 2


def test_models_shown_are_the_best_that_there_are(run: Run):
    for view in frame_views(run, "paper"):
        for candidates in view.candidates.values():
            shown = shown_models(candidates)
            able = [c for c in candidates if np.isfinite(c.depth_difference)]
            assert len(shown) == min(SHOWN_MODELS, len(able))
            for c in shown:
                assert sum(o.new_rank < c.new_rank for o in able) < SHOWN_MODELS


def test_labels_of_a_wide_picture_keep_their_distance():
    # a label is about as high in picture pixels as the picture is wide, times 0.042: 52 pixels at 1242
    boxes = np.array([[600, 170, 660, 220], [610, 170, 690, 225]], float)
    spots = label_spots(boxes, 1242, 375)
    assert abs(spots[0, 1] - spots[1, 1]) >= 50
