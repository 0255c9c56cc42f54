import json
import shutil
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest
import rerun_cli
from rerun.chunk import RrdReader

from recon.errors import RescoreError
from reports.page.report import build_report
from reports.recording import log
from reports.recording.entities import HOLE_CLASS, OUTCOME_CLASSES, THRESHOLD_STEPS
from reports.recording.frame import DEPTH_UNIT
from reports.recording.log import write_recording
from reports.recording.plot import HEIGHT, WIDTH
from reports.recording.story import Frames, Story, choose_frames
from reports.run.curves import curve_sets
from reports.run.frame_view import frame_views
from reports.run.overlay import apply_transform, points_of_depth, world_from_camera
from rescore.results.metrics_file import read_metrics, write_metrics
from rescore.results.run_folder import Run, boxes_px, load_run, missing_evidence
from tests.reports.metric_run import make_metric_run
from tests.reports.recording_reader import colours_of, every_row, read

IMAGE = "/world/camera/image"
RERUN = Path(rerun_cli.__file__).parent / "rerun"


@pytest.fixture(scope="module")
def metric_run(run_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> Run:
    return load_run(make_metric_run(run_dir, tmp_path_factory.mktemp("metric") / "run"))


@pytest.fixture(scope="module")
def story(metric_run: Run) -> Story:
    return Story.of(metric_run)


@pytest.fixture(scope="module")
def recording(metric_run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_recording(metric_run.root, tmp_path_factory.mktemp("rrd") / "recording.rrd", show=False)


def test_boxes_scores_and_what_is_accepted_equal_the_match_table_in_every_mode(story: Story, recording: Path):
    ids = choose_frames(story)
    for detector, mode in story.tables:
        rows = story.run.of(detector)
        score = rows["likelihood" if mode == "detector" else f"posterior_{mode}"]
        difference = rows["difference_metric" if mode == "metric" else "depth_difference"]
        seen = 0
        for part, accepted in (("accepted", True), ("rejected", False)):
            frames = read(recording, f"{IMAGE}/{detector}/{mode}/{part}")
            for frame, image_id in enumerate(ids):
                found = frames[frame]
                corners = np.array(found["Boxes2D:centers"]).reshape(-1, 2)
                halves = np.array(found["Boxes2D:half_sizes"]).reshape(-1, 2)
                for i, rank in enumerate(found.get("rank", [])[: len(corners)]):
                    (row,) = np.flatnonzero((rows["image_id"] == image_id) & (rows["rank"] == rank))
                    box = boxes_px({k: rows[k][[row]] for k in ("x0", "y0", "x1", "y1")})[0]
                    np.testing.assert_allclose(
                        [*(corners - halves)[i], *(corners + halves)[i]], box, atol=1e-3
                    )
                    assert found["likelihood"][i] == rows["likelihood"][row]
                    assert found["score"][i] == score[row]
                    assert found["depth_difference"][i] == pytest.approx(difference[row], nan_ok=True)
                    assert found["annotation_id"][i] == rows[f"annotation_id_{mode}"][row]
                    name = OUTCOME_CLASSES[found["Boxes2D:class_ids"][i]]
                    assert name.partition(",")[0] == rows[f"outcome_{mode}"][row]
                    assert (name in rows[f"outcome_{mode}"]) is accepted
                    assert story.accepted(detector, mode)[row] == accepted
                    seen += 1
        assert seen == len(rows["rank"])


def test_cars_found_and_missed_add_up_to_the_point_of_the_curve(story: Story, recording: Path):
    for detector, mode in story.tables:
        classes = [OUTCOME_CLASSES[c] for c in colours_of(recording, f"{IMAGE}/{detector}/{mode}/cars")]
        assert len(classes) == story.run.metrics.n_cars
        _, recall, *_ = story.rates(detector, mode, story.accepted(detector, mode))
        assert classes.count("found") == round(recall * len(classes))
        assert classes.count("missed") == len(classes) - classes.count("found")


def test_each_step_of_the_threshold_moves_the_points_and_recolours_the_frames(story: Story, recording: Path):
    n_images, n_cars = story.run.metrics.n_images, story.run.metrics.n_cars
    for detector in story.run.detectors:
        rows, modes = story.run.of(detector), story.modes_of(detector)
        points = read(recording, f"/curves/{detector}/cars_found/operating_point", "threshold")
        sheet = read(recording, f"/threshold/{detector}/sheet/boxes", "threshold")
        assert min(points) == 0
        assert len(points) > 10
        for step, point in points.items():
            for i, mode in enumerate(modes):
                score = rows["likelihood" if mode == "detector" else f"posterior_{mode}"]
                outcome = rows[f"outcome_{mode}"][score >= step / THRESHOLD_STEPS]
                false = np.isin(outcome.astype(str), ("false_alarm", "duplicate")).sum()
                assert point["x"][i] == pytest.approx(false / n_images)
                assert point["y"][i] == pytest.approx((outcome == "hit").sum() / n_cars)
            names = [OUTCOME_CLASSES[c] for c in sheet[step]["Boxes2D:class_ids"]]
            # the sheet holds all five frames, in the mode that is explained
            accepted = rows["posterior_metric"] >= step / THRESHOLD_STEPS
            for kind in ("hit", "false_alarm", "duplicate"):
                assert names.count(kind) == (rows["outcome_metric"][accepted] == kind).sum()
            assert names.count("missed") == n_cars - names.count("hit")


def test_the_threshold_recolours_the_first_frame(story: Story, recording: Path):
    first = choose_frames(story)[0]
    for detector in story.run.detectors:
        rows = story.run.of(detector)
        accepted = read(recording, f"{IMAGE}/{detector}/metric/accepted", "threshold")
        for step, row in accepted.items():
            of_frame = rows["posterior_metric"][rows["image_id"] == first]
            assert len(row["Boxes2D:class_ids"]) == (of_frame >= step / THRESHOLD_STEPS).sum()
    assert 0 in read(recording, f"{IMAGE}/left", "threshold")


def test_measured_depth_is_metres_and_holes_are_marked(story: Story, recording: Path):
    depths = read(recording, f"{IMAGE}/measured_depth/depth")
    masks = read(recording, f"{IMAGE}/measured_depth/holes")
    for frame, view in enumerate(frame_views(story.run, "paper", choose_frames(story))):
        (blob,) = depths[frame]["EncodedDepthImage:blob"]
        picture = cv2.imdecode(np.array(blob, np.uint8), cv2.IMREAD_UNCHANGED)
        seen = np.isfinite(view.measured)
        np.testing.assert_allclose(picture[seen] / DEPTH_UNIT, view.measured[seen], atol=0.501 / DEPTH_UNIT)
        assert (picture[~seen] == 0).all()
        assert depths[frame]["EncodedDepthImage:meter"] == [DEPTH_UNIT]
        (mask,) = masks[frame]["SegmentationImage:buffer"]
        np.testing.assert_array_equal(np.array(mask, np.uint8).reshape(seen.shape) == HOLE_CLASS, ~seen)


def test_models_lie_on_the_measured_points_of_the_cars_they_fit(run: Run, tmp_path: Path):
    # eq. 6 fits these cars exactly
    out = write_recording(run.root, tmp_path / "paper.rrd", show=False)
    models = read(out, "/world/hog/models/parts")
    checked = 0
    for frame, view in enumerate(frame_views(run, "paper", choose_frames(Story.of(run)))):
        fits = [c for c in view.candidates["hog"] if c.new_rank < 3 and c.depth_difference < 0.01]
        vertices = np.array(models[frame]["Mesh3D:vertex_positions"])
        for c in fits:
            assert c.instance is not None
            world = apply_transform(
                world_from_camera(view.seen_from.ground),
                points_of_depth(view.measured, view.seen_from.camera),
            )
            measured = world[c.instance.depth.window][np.isfinite(c.registered)]
            measured = measured[np.isfinite(measured[:, 0])]
            gap = np.linalg.norm(vertices[:, None] - measured[None], axis=2).min(axis=1)
            # the vertices of this candidate lie on its points; those of the two others need not
            assert (gap < 0.03).sum() > 150
            checked += 1
    assert checked >= 2


def test_the_file_is_whole_and_blueprint_and_words_are_inside(story: Story, recording: Path):
    done = subprocess.run(
        [RERUN, "rrd", "verify", str(recording)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert len(RrdReader(str(recording)).blueprints()) == 1
    (results,) = read(recording, "/results")[-1]["TextDocument:text"]
    for row in story.run.metrics.rows:
        assert f"{row.auc:.3f}" in results
    (guide,) = read(recording, "/guide")[-1]["TextDocument:text"]
    assert "with depth (metric)" in guide


def test_curves_in_the_recording_are_those_of_the_run(story: Story, recording: Path):
    left = 0.5 / story.run.metrics.n_images
    for c in curve_sets(story.run):
        path = f"/curves/{c.detector}/cars_found/{c.mode}"
        points = np.concatenate([np.array(s) for s in read(recording, path)[-1]["LineStrips2D:strips"]])
        fppi = left * (20 / left) ** (points[:, 0] / WIDTH)
        if c.mode == "detector":
            # dashes: their ends lie between the corners, on a tread or on a riser
            on_tread = np.isclose(1 - points[:, 1:] / HEIGHT, c.cars.y, atol=1e-6).any(axis=1)
            on_riser = np.isclose(fppi[:, None], np.maximum(c.cars.x, left), rtol=1e-4).any(axis=1)
            assert (on_tread | on_riser).all()
            continue
        # steps: every point but the first has its corner before it
        np.testing.assert_allclose(fppi[::2], np.maximum(c.cars.x, left), rtol=1e-5)
        np.testing.assert_allclose(1 - points[::2, 1] / HEIGHT, c.cars.y, atol=1e-6)
        np.testing.assert_allclose(points[1::2, 0], points[2::2, 0], atol=1e-4)
        np.testing.assert_allclose(points[1::2, 1], points[:-2:2, 1], atol=1e-4)


def test_each_candidate_has_its_own_time_with_words_bars_and_pictures(story: Story, recording: Path):
    stride, ids = 10, choose_frames(story)
    for detector in story.run.detectors:
        rows = story.run.of(detector)
        words = read(recording, f"/why/{detector}/text", "candidate rank")
        bars = read(recording, f"/why/{detector}/bars/bars", "candidate rank")
        root = f"/world/camera/{detector}_candidate"
        residual = read(recording, f"{root}/residual", "candidate rank")
        assert set(words) == set(residual)
        assert len(words) == len(rows["rank"])
        for time, row in words.items():
            frame, place = divmod(time, stride)
            (i,) = np.flatnonzero((rows["image_id"] == ids[frame]) & (rows["rank"] == place - 1))
            (said,) = row["TextDocument:text"]
            assert f"*l* = {rows['likelihood'][i]:.3f}" in said
            assert f"D = {rows['difference_metric'][i]:.3f}" in said
            assert f"score {rows['posterior_metric'][i]:.3f}" in said
            # log odds of D are the bias of the model and the bars: -1 + 0.7 height - 0.5 foot
            d = rows["difference_metric"][i]
            assert sum(bars[time]["log_odds"]) - 1 == pytest.approx(np.log((1 - d) / d), abs=1e-6)


def test_on_the_timeline_of_frames_the_most_telling_candidate_shows(story: Story, recording: Path):
    chosen = choose_frames(story)
    for detector in story.run.detectors:
        words = read(recording, f"/why/{detector}/text", "frame")
        for frame, view in enumerate(frame_views(story.run, "metric", chosen)):
            best = story.most_telling(detector, view.candidates[detector])
            assert best is not None
            (said,) = words[frame]["TextDocument:text"]
            assert f"place {best.rank + 1} → {best.new_rank + 1} of this image" in said


def test_the_pinhole_of_a_candidate_sees_its_box_where_it_is_drawn(story: Story, recording: Path):
    root = "/world/camera/hog_candidate"
    pinholes = read(recording, root, "candidate rank")
    boxes = read(recording, f"{root}/box", "candidate rank")
    (view,) = frame_views(story.run, "metric", choose_frames(story)[:1])
    for c in view.candidates["hog"]:
        # a ray through the corner of the box, by the camera of the frame, seen through the pinhole
        ray = view.seen_from.camera.rays(c.xyxy_px[:2] - 0.5)
        matrix = np.array(pinholes[c.rank + 1]["Pinhole:image_from_camera"][0]).reshape(3, 3).T
        corner = boxes[c.rank + 1]["LineStrips2D:strips"][0][0]
        np.testing.assert_allclose((matrix @ ray)[:2] / ray[2], corner, atol=1e-3)


def test_the_same_run_gives_the_same_content(story: Story, recording: Path, tmp_path: Path):
    again = write_recording(story.run.root, tmp_path / "again.rrd", show=False)
    summaries = [RrdReader(str(p)).store().summary() for p in (recording, again)]
    assert summaries[0] == summaries[1]
    assert read(recording, f"{IMAGE}/left") == read(again, f"{IMAGE}/left")
    assert [p.name for p in tmp_path.iterdir()] == ["again.rrd"]


def test_frames_are_chosen_by_what_happened_in_them(story: Story, tmp_path: Path):
    assert sorted(choose_frames(story).tolist()) == [1, 2, 3, 4, 5]
    assert sorted(choose_frames(story, max_frames=3).tolist()) == [1, 3, 5]
    flips = choose_frames(story, Frames.FLIPS).tolist()
    changed = {
        int(i)
        for d in story.run.detectors
        for i, g in zip(story.run.of(d)["image_id"], story.changes[d, "metric"].group, strict=True)
        if g not in ("kept_car", "kept_false_alarm", "rejected", "ignored")
    }
    assert set(flips) == changed
    assert choose_frames(story, Frames.FLIPS, 2).tolist() == flips[:2]
    small = write_recording(story.run.root, tmp_path / "small.rrd", max_frames=1, show=False)
    assert sorted(read(small, f"{IMAGE}/left")) == [0]
    with pytest.raises(RescoreError, match="--frames: expected all, flips, worst, got 'best'"):
        Frames.named("best")


def test_where_nothing_changed_there_is_no_frame_of_flips(metric_run: Run):
    with pytest.raises(RescoreError, match="expected some with flips, found none"):
        choose_frames(Story.of(metric_run, "detector"), Frames.FLIPS)


def test_a_run_of_a_detector_alone_has_a_recording(run_dir: Path, tmp_path: Path):
    shutil.copytree(run_dir, tmp_path / "run")
    file = tmp_path / "run" / "metrics.json"
    metrics = read_metrics(file)
    rows = tuple(r for r in metrics.rows if r.mode == "detector" and r.detector == "hog")
    write_metrics(file, metrics.model_copy(update={"rows": rows, "tuning": {}}))
    out = write_recording(tmp_path / "run", tmp_path / "alone.rrd", show=False)
    assert len(read(out, f"{IMAGE}/hog/detector/cars")) == 5


def test_without_calibration_and_evidence_there_is_a_recording(run_dir: Path, tmp_path: Path):
    shutil.copytree(run_dir, tmp_path / "run")
    shutil.rmtree(tmp_path / "run" / "evidence")
    file = tmp_path / "run" / "data" / "annotations.json"
    value = json.loads(file.read_text())
    for image in value["images"]:
        del image["camera"]
    file.write_text(json.dumps(value))
    out = write_recording(tmp_path / "run", tmp_path / "plain.rrd", max_frames=2, show=False)
    (said,) = read(out, "/why/hog/text")[0]["TextDocument:text"]
    assert "The camera is not calibrated" in said
    assert "No model could be registered here" in said


def test_a_right_picture_is_shown_where_there_is_one(run_dir: Path, recording: Path, tmp_path: Path):
    assert not read(recording, "/world/right_camera/image/right")
    shutil.copytree(run_dir, tmp_path / "run")
    data = tmp_path / "run" / "data"
    value = json.loads((data / "annotations.json").read_text())
    for image in value["images"]:
        image["right_file_name"] = image["file_name"]
    (data / "annotations.json").write_text(json.dumps(value))
    out = write_recording(tmp_path / "run", tmp_path / "pair.rrd", max_frames=1, show=False)
    assert 0 in read(out, "/world/right_camera/image/right")
    left, right = (
        np.array(read(out, f"/world/{name}")[0]["Transform3D:translation"][0])
        for name in ("camera", "right_camera")
    )
    # the right eye is one baseline of 0.25 m to the right
    np.testing.assert_allclose(right - left, [0.25, 0, 0], atol=1e-6)


def test_pictures_of_several_sizes_are_stored_with_one(run_dir: Path, tmp_path: Path):
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
    sizes = {
        cv2.imdecode(np.array(row["EncodedDepthImage:blob"][0], np.uint8), cv2.IMREAD_UNCHANGED).shape
        for row in depth.values()
    }
    assert (len(depth), sizes) == (2, {(240, 320)})
    # the room below the lower picture holds no depth
    (small,) = np.flatnonzero(choose_frames(Story.of(load_run(tmp_path / "run")), max_frames=2) == 1)
    (mask,) = read(out, f"{IMAGE}/measured_depth/holes")[int(small)]["SegmentationImage:buffer"]
    assert (np.array(mask, np.uint8).reshape(240, 320)[-8:] == HOLE_CLASS).all()


def test_the_same_run_gives_the_same_rows_by_any_number_of_jobs(
    metric_run: Run, recording: Path, tmp_path: Path
):
    again = write_recording(metric_run.root, tmp_path / "again.rrd", show=False, jobs=2)
    one, other = every_row(recording), every_row(again)
    assert len(one) == len(other) > 1000
    assert one == other
    # a row that differs is seen
    other[-1][1]["new"] = 0
    assert one != other
    assert RrdReader(str(recording)).recordings() == RrdReader(str(again)).recordings()
    views = [
        [
            row["ViewBlueprint:display_name"]
            for _, row in every_row(path, blueprint=True)
            if row.get("ViewBlueprint:display_name")
        ]
        for path in (recording, again)
    ]
    assert len(views[0]) > 10
    assert views[0] == views[1]


def test_report_and_recording_say_which_evidence_is_missing(
    run_dir: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    copy = tmp_path / "run"
    shutil.copytree(run_dir, copy)
    lost = sorted((copy / "evidence" / "hog").glob("*.npz"))[1:3]
    for path in lost:
        path.unlink()
    words = (
        f"{copy / 'evidence' / 'hog'}: expected evidence of 5 frames, 2 are missing, such as {lost[0].name}"
    )
    assert len(missing_evidence(load_run(copy))) == 1
    assert missing_evidence(load_run(run_dir)) == ()
    recording = write_recording(copy, tmp_path / "a.rrd", show=False)
    assert f"note: {words}" in capsys.readouterr().err
    assert words in str(read(recording, "/guide"))
    page = build_report(copy)
    assert f"note: {words}" in capsys.readouterr().err
    assert words in page.read_text()


def test_a_recording_without_its_end_gets_no_name(
    metric_run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    write = log._Writer.write

    def cut(self: object, path: Path, *rest: object) -> None:
        write(self, path, *rest)
        # nothing more reaches the file
        path.unlink()
        path.write_bytes(b"RRF2")

    monkeypatch.setattr(log._Writer, "write", cut)
    with pytest.raises(RescoreError, match=r"a\.rrd: expected to write .* 'a recording without its end'"):
        write_recording(metric_run.root, tmp_path / "out" / "a.rrd", show=False)
    assert list((tmp_path / "out").iterdir()) == []


def test_a_recording_begins_only_where_there_is_room(
    metric_run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    room = shutil.disk_usage(tmp_path)._replace(free=log._ROOM_BYTES - 1)
    monkeypatch.setattr(log.shutil, "disk_usage", lambda _path: room)
    with pytest.raises(RescoreError, match=r"got 'a disk with 64 MB left, at least 64 are needed'; m"):
        write_recording(metric_run.root, tmp_path / "a.rrd", show=False)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("change", ["ids", "fewer"])
def test_a_data_set_that_was_changed_since_is_one_line(run_dir: Path, tmp_path: Path, change: str):
    copy = tmp_path / "run"
    shutil.copytree(run_dir, copy)
    file = copy / "data" / "annotations.json"
    value = json.loads(file.read_text())
    if change == "ids":
        for row, key in [(i, "id") for i in value["images"]] + [
            (a, "image_id") for a in value["annotations"]
        ]:
            row[key] += 100
    else:
        last = value["images"].pop()["id"]
        value["annotations"] = [a for a in value["annotations"] if a["image_id"] != last]
    file.write_text(json.dumps(value))
    with pytest.raises(RescoreError, match=r"data: expected the 5 frames that were evaluated, got no image"):
        write_recording(copy, tmp_path / "a.rrd", show=False)
    assert "the data set was changed since" in build_report(copy).read_text()
