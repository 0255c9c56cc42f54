"""The library as a user has it: what docs/library.md shows, from files, from threads."""

import json
import re
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from scipy.special import logit

from recon.reconstruction.reconstruct import Reconstruction
from rescore import Boxes, Camera, Rescored, RescoreError, Rescorer, StereoFrame
from rescore.data.frames import DataSet, FrameRecord
from rescore.data.pictures import read_rgb
from rescore.evidence.registration import Registration
from rescore.formats.coco import read_detections
from rescore.formats.coco_dataset import read_dataset
from rescore.parallel import one_thread
from rescore.results.run_folder import RunFolder
from tests.bank_judge import stored_judge
from tests.single_car import car_from

ROOT = Path(__file__).resolve().parents[3]
MODES = [m.value for m in Registration if m is not Registration.INSTANCE]
"""Those of the run, whose class model was learned from too few cars to fit instances."""


@dataclass(frozen=True, eq=False)
class Given:
    """A frame of the run, with its boxes and what the run itself made of them."""

    frame: StereoFrame
    boxes: Boxes
    posterior: np.ndarray
    depth_difference: np.ndarray
    status: list[str]


def code_blocks(language: str) -> list[str]:
    text = (ROOT / "docs" / "library.md").read_text()
    return re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)


def arrays_of(record: FrameRecord) -> StereoFrame:
    left = read_rgb(record.left_path, record.width_px, record.height_px)
    assert record.disparity_path is not None
    disparity = cv2.imread(str(record.disparity_path), cv2.IMREAD_UNCHANGED) / np.float32(256)
    assert record.camera is not None
    c = record.camera.left
    camera = Camera(c.fx_px, c.fy_px, c.cx_px, c.cy_px, record.camera.baseline_m)
    return StereoFrame(left, disparity_px=disparity, camera=camera, ground=record.ground)


def given_of(run: Path, data: DataSet, mode: str) -> list[Given]:
    table = read_detections(RunFolder(run).rescored("hog", mode), data)
    assert table.posterior is not None
    t, out = table.table, []
    for record in data.frames:
        rows = np.flatnonzero(t.image_id == record.image_id)
        boxes = Boxes(t.xyxy_px[rows], score=t.score[rows])
        out.append(
            Given(
                arrays_of(record),
                boxes,
                table.posterior[rows],
                t.depth_difference[rows],
                t.status[rows].tolist(),
            )
        )
    return out


@pytest.fixture(scope="module")
def data(tiny_run: Path) -> DataSet:
    return read_dataset(tiny_run / "data").split("test")


@pytest.fixture(scope="module")
def first(tiny_run: Path, data: DataSet) -> Given:
    return given_of(tiny_run, data, "metric")[0]


@pytest.fixture
def folder(tmp_path: Path, tiny_run: Path, data: DataSet, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder as the documentation has it: runs/demo, left.png and right.png."""
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / "demo").symlink_to(tiny_run)
    right = data.frames[0].right_path
    assert right is not None
    (tmp_path / "left.png").symlink_to(data.frames[0].left_path)
    (tmp_path / "right.png").symlink_to(right)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("mode", MODES)
def test_arrays_give_what_the_run_gave(tiny_run: Path, data: DataSet, mode: str) -> None:
    rescorer = Rescorer.from_run(tiny_run, "hog", mode)
    assert rescorer.mode == mode
    for given in given_of(tiny_run, data, mode):
        with one_thread():
            found = rescorer.rescore(given.frame, given.boxes)
        np.testing.assert_allclose(found.posterior, given.posterior, rtol=1e-9)
        assert list(found.status) == given.status
        assert [not r for r in found.reasons] == found.has_evidence.tolist()
        has = found.has_evidence
        np.testing.assert_allclose(found.depth_difference[has], given.depth_difference[has], rtol=1e-9)
        assert found.cues.shape == found.log_odds.shape == (len(given.boxes), len(found.cue_names))
        assert found.instances is None
        if rescorer.evidence_model is None:
            assert not found.log_odds.any()
        else:
            odds = rescorer.evidence_model.bias + found.log_odds.sum(axis=1)
            # where there is no evidence, D is that of silent cues, and so are the log odds
            np.testing.assert_allclose(found.depth_difference, 1 / (1 + np.exp(odds)), rtol=1e-9)


def same(a: Rescored, b: Rescored) -> bool:
    arrays = ("posterior", "likelihood", "depth_difference", "cues", "log_odds", "view_bin")
    return (a.status, a.reasons) == (b.status, b.reasons) and all(
        np.array_equal(getattr(a, n), getattr(b, n), equal_nan=True) for n in arrays
    )


def test_threads_share_a_rescorer(tiny_run: Path, data: DataSet) -> None:
    # in one mode of each kind of bin, so that threads meet in what is remembered of the class model
    plain = Rescorer.from_run(tiny_run, "hog", "metric")
    chosen = replace(plain, config=replace(plain.config, view_bin="model"))
    few = [replace_boxes(g, 3) for g in given_of(tiny_run, data, "metric")]
    work = [(r, g) for r in (plain, chosen) for g in few] * 2
    before = cv2.getNumThreads()
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda w: w[0].rescore(w[1].frame, w[1].boxes), work))
    alone = [r.rescore(g.frame, g.boxes) for r, g in work]
    assert all(same(a, b) for a, b in zip(together, alone, strict=True))
    assert not same(alone[0], alone[len(few)]), "the two rescorers differ"
    assert cv2.getNumThreads() == before


def replace_boxes(given: Given, n: int) -> Given:
    assert given.boxes.score is not None
    return replace(given, boxes=Boxes(given.boxes.xyxy_px[:n], score=given.boxes.score[:n]))


def test_order_and_input_stay_as_they_were(tiny_run: Path, first: Given) -> None:
    rescorer = Rescorer.from_run(tiny_run, "hog", "metric")
    frame, boxes = first.frame, first.boxes
    assert boxes.score is not None
    copies = frame.left_rgb.copy(), np.array(frame.disparity_px), boxes.xyxy_px.copy()
    found = rescorer.rescore(frame, boxes)
    back = rescorer.rescore(frame, Boxes(boxes.xyxy_px[::-1], score=boxes.score[::-1]))
    np.testing.assert_allclose(back.posterior[::-1], found.posterior, rtol=1e-6)
    assert back.status[::-1] == found.status
    for now, then in zip((frame.left_rgb, frame.disparity_px, boxes.xyxy_px), copies, strict=True):
        np.testing.assert_array_equal(now, then)


def test_depth_a_pair_and_azimuths(tiny_run: Path, data: DataSet, first: Given) -> None:
    rescorer = Rescorer.from_run(tiny_run, "hog", "metric")
    frame, camera = first.frame, first.frame.camera
    assert camera is not None
    assert frame.disparity_px is not None
    assert camera.baseline_m is not None
    with np.errstate(divide="ignore"):
        depth = camera.fx * camera.baseline_m / frame.disparity_px.astype(float)
    by_depth = rescorer.rescore(replace(frame, disparity_px=None, depth_m=depth), first.boxes)
    np.testing.assert_allclose(by_depth.posterior, first.posterior, rtol=0.02)
    assert by_depth.baseline_m == camera.baseline_m
    alone = replace(camera, baseline_m=None)
    unstated = rescorer.rescore(replace(frame, disparity_px=None, depth_m=depth, camera=alone), first.boxes)
    assert unstated.baseline_m is not None
    assert 0.5 < unstated.baseline_m / camera.baseline_m < 2
    assert np.abs(unstated.posterior - first.posterior).mean() < 0.05
    right_path = data.frames[0].right_path
    assert right_path is not None
    right = read_rgb(right_path, data.frames[0].width_px, data.frames[0].height_px)
    matched = replace(frame, disparity_px=None, right_rgb=right).loaded(rescorer.config.stereo, 2.0)
    both = np.isfinite(matched.disparity_px) & (frame.disparity_px > 0)
    # the run's disparity is that of the same matcher, though it searched another range
    assert both.mean() > 0.5
    assert np.median(np.abs(matched.disparity_px - frame.disparity_px)[both]) <= 1 / 16
    turned = replace(first.boxes, azimuth_deg=np.full(len(first.boxes), 60.0))
    seen = rescorer.rescore(frame, turned, instances=True)
    assert set(seen.view_bin.tolist()) == {2}
    assert seen.instances is not None
    assert any(isinstance(i, Reconstruction) for i in seen.instances)


def test_a_car_seen_from_its_front_is_believed_once_that_is_known(tmp_path: Path) -> None:
    judge = stored_judge(tmp_path)
    plain = Rescorer(judge.class_model, 0.5, judge.models[Registration.METRIC])
    car = car_from(0.0, seed=1, width_px=640)
    fx = car.seen_from.camera.fx_px
    disparity = fx * 0.35 / car.depth_m + np.random.default_rng(0).normal(0, 0.25, car.depth_m.shape)
    camera = Camera(
        fx, car.seen_from.camera.fy_px, car.seen_from.camera.cx_px, car.seen_from.camera.cy_px, 0.35
    )
    frame = StereoFrame(car.rgb, disparity_px=disparity, camera=camera, ground=car.seen_from.ground)
    boxes = Boxes(np.tile(car.box_px, (2, 1)), likelihood=np.ones(2), azimuth_deg=np.array([np.nan, 0]))
    side, front = plain.rescore(frame, boxes).depth_difference
    assert front < 0.4
    assert side > 0.7


def test_no_boxes(tiny_run: Path, first: Given) -> None:
    rescorer = Rescorer.from_run(tiny_run, "hog", "metric")
    for none in (np.zeros((0, 4)), np.array([])):
        found = rescorer.rescore(first.frame, Boxes(none, likelihood=np.zeros(0)))
        assert found.posterior.shape == (0,)
        assert found.cues.shape == (0, len(found.cue_names))


def test_the_example_of_the_documentation(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    example = code_blocks("python")[0]
    assert len(example.strip().splitlines()) <= 20
    names: dict[str, Any] = {}
    exec(example, names)
    shown = capsys.readouterr().out.splitlines()
    assert len(shown) == 2
    found, boxes = names["found"], names["boxes"]
    assert isinstance(found, Rescored)
    assert [line.split()[1] for line in shown] == list(found.status)
    assert ((found.posterior >= 0) & (found.posterior <= 1)).all()
    assert not np.array_equal(found.posterior, boxes.likelihood)


def test_the_camera_loop_of_the_documentation(tiny_run: Path, first: Given) -> None:
    names: dict[str, Any] = {}
    exec(code_blocks("python")[1], names)
    camera = first.frame.camera
    assert camera is not None
    assert first.frame.disparity_px is not None
    disparity = first.frame.disparity_px
    depth = np.where(disparity > 0, camera.fx * 0.1 / np.maximum(disparity, 0.1), 0).astype(np.float32)

    def pictures() -> Iterator[tuple[np.ndarray, np.ndarray]]:
        yield first.frame.left_rgb, depth
        yield np.zeros_like(first.frame.left_rgb), np.zeros_like(depth)
        yield first.frame.left_rgb, depth

    def detect(rgb: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        n = 3 if rgb.any() else 0
        return first.boxes.xyxy_px[:n], np.linspace(0.2, 0.8, n)

    shown: list[np.ndarray] = []
    rescorer = Rescorer.from_run(tiny_run, "hog", "metric")
    depth_camera = replace(camera, baseline_m=None)
    names["watch"](pictures(), detect, rescorer, depth_camera, lambda _rgb, _boxes, p: shown.append(p))
    assert [len(p) for p in shown] == [3, 0, 3]
    np.testing.assert_array_equal(shown[0], shown[2])
    assert not np.array_equal(shown[0], np.linspace(0.2, 0.8, 3))


def test_the_file_of_the_documentation(folder: Path, first: Given) -> None:
    (text,) = code_blocks("json")
    (folder / "car.json").write_text(text)
    chosen = Rescorer.from_file("car.json")
    assert chosen.config.view_bin == "model"
    (folder / "car.json").write_text(json.dumps(json.loads(text) | {"settings": {}}))
    plain, run = Rescorer.from_file(folder / "car.json"), Rescorer.from_run("runs/demo", "hog", "metric")
    assert plain.w == run.w
    assert same(plain.rescore(first.frame, first.boxes), run.rescore(first.frame, first.boxes))
    (folder / "car.json").write_text(json.dumps(json.loads(text) | {"settings": {}, "log_odds_shift": 2.0}))
    moved = Rescorer.from_file(folder / "car.json").rescore(first.frame, first.boxes)
    before = run.rescore(first.frame, first.boxes)
    np.testing.assert_allclose(logit(before.depth_difference) - logit(moved.depth_difference), 2.0)


def test_the_network_of_the_documentation() -> None:
    """A prediction that is the disparity itself: D is what the percentiles clip."""
    names: dict[str, Any] = {}
    exec(code_blocks("python")[2], names)
    y, x = np.mgrid[:40, :60].astype(float)
    disparity = (8 + np.cos(x / 9) * np.sin(y / 7)).astype(np.float32)
    box, rgb = np.array([[5.0, 5, 50, 35]]), np.zeros((40, 60, 3), np.uint8)
    found = names["compare"](rgb, disparity, box, np.array([0.5]), lambda _rgb: 3 * disparity - 40)
    assert found.status == ("ok",)
    assert 0 < found.depth_difference[0] < 0.06


BAD_FILES: list[tuple[dict[str, Any], str]] = [
    ({"w": 0.5}, "expected either w or tuned, got both; w is the weight itself"),
    ({"tuned": None}, "expected either w or tuned, got neither"),
    ({"tuned": None, "w": 2}, "expected a rescorer, got w: input should be less than or equal to 1"),
    ({"tuned": "runs/demo/tuned/hog.json"}, "expected a weight tuned for registration metric, got one for"),
    (
        {"evidence_model": None},
        "expected evidence_model for registrations guarded, metric, instance alone, got",
    ),
    ({"settings": {"view": 3}}, "got settings: unknown setting 'view', known are align, camera"),
    ({"settings": {"view_bin": "all"}}, "expected settings of rescoring, got view_bin"),
    ({"settings": {"view_bin": 12}}, "view bin: expected 0 to 11, got 12"),
    ({"class_model": "none.json"}, "none.json: expected a class model, found no file"),
    (
        {"registration": "paper", "evidence_model": None, "tuned": None, "w": 0.5, "log_odds_shift": 2.0},
        "expected log_odds_shift beside an evidence_model, got 2 without",
    ),
    ({"colour": 1}, "expected a rescorer, got colour: extra inputs are not permitted"),
]


@pytest.mark.parametrize(("change", "message"), BAD_FILES)
def test_files_say_what_is_wrong(folder: Path, change: dict[str, Any], message: str) -> None:
    value = json.loads(code_blocks("json")[0]) | change
    (folder / "car.json").write_text(json.dumps({k: v for k, v in value.items() if v is not None}))
    with pytest.raises(RescoreError, match=re.escape(message)) as raised:
        Rescorer.from_file("car.json")
    assert "\n" not in str(raised.value)


def test_runs_say_what_is_wrong(tiny_run: Path, tmp_path: Path) -> None:
    for arguments, message in (
        ((tiny_run, "yolo", "paper"), "expected a run with detector 'yolo', found boosted, hog"),
        ((tiny_run, "hog", "metre"), "mode: expected paper, guarded, metric, instance, got 'metre'"),
        ((tmp_path, "hog", "paper"), "expected a run with detector 'hog', found none"),
    ):
        with pytest.raises(RescoreError, match=re.escape(message)):
            Rescorer.from_run(*arguments)


def test_bad_rescorers(tiny_run: Path, first: Given) -> None:
    good = Rescorer.from_run(tiny_run, "hog", "metric")
    with pytest.raises(RescoreError, match=r"rescorer: expected w in \[0, 1\], got nan"):
        replace(good, w=float("nan"))
    with pytest.raises(RescoreError, match="score: expected a rescorer with Platt scaling"):
        replace(good, scaling=None).rescore(first.frame, first.boxes)


WATCHED = """
import sys
before = set(sys.modules)
import rescore
heavy = {"numpy", "scipy", "cv2", "sklearn", "pydantic"} & (set(sys.modules) - before)
assert not heavy, heavy
from rescore import Boxes, Camera, GroundPlane, Rescorer, StereoFrame
of_others = {"joblib", "matplotlib", "open3d", "pyarrow", "pydantic", "rerun", "sklearn"}
of_others |= {"importlib.metadata", "numba", "scipy"}
assert not of_others & set(sys.modules), of_others & set(sys.modules)
assert all(getattr(rescore, name) for name in rescore.__all__)
try:
    rescore.nothing
except AttributeError:
    pass
from dataclasses import replace
import cv2
import numpy as np
run, left, right, xyxy = sys.argv[1:]
rescorer = rescore.Rescorer.from_run(run, "hog", "metric")
chosen = replace(rescorer, config=replace(rescorer.config, view_bin="model"))
left, right = (cv2.imread(path)[..., ::-1] for path in (left, right))
boxes = np.fromstring(xyxy, sep=",").reshape(-1, 4)
camera = rescore.Camera(620, 620, 319.5, 239.5, 0.35)
frame = rescore.StereoFrame(left, right_rgb=right, camera=camera, ground=rescore.GroundPlane(1.5))
likely = rescore.Boxes(boxes, likelihood=np.full(len(boxes), 0.5))
for one in (rescorer, chosen):
    print(*one.rescore(frame, likely, instances=True).status)
opened = []
sys.addaudithook(lambda event, args: opened.append(args) if event == "open" else None)
for one in (rescorer, chosen):
    one.rescore(frame, likely, instances=True)
assert not opened, opened
"""


def test_importing_is_light_and_rescoring_opens_no_file_after_the_first_frame(
    tiny_run: Path, data: DataSet, first: Given
) -> None:
    record = data.frames[0]
    boxes = ",".join(map(str, first.boxes.xyxy_px[:4].ravel()))
    arguments = [str(tiny_run), str(record.left_path), str(record.right_path), boxes]
    command = [sys.executable, "-c", WATCHED, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stderr
    status = done.stdout.split()
    assert len(status) == 8
    assert "ok" in status, "all of the way to D was gone"


def test_packages_say_that_they_are_typed() -> None:
    for package in ("recon", "rescore"):
        assert (ROOT / package / "py.typed").is_file()
