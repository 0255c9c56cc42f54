"""The rescorer that comes with the package: its file, its errors, and what it makes of a frame."""

import gzip
import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import rescore.defaults
from recon.camera import GroundPlane
from recon.view_bins import ViewBins
from rescore import Boxes, Camera, Rescored, RescoreError, Rescorer, StereoFrame
from rescore.evidence.cues import CUES
from rescore.evidence.registration import Registration
from rescore.library.bundles import default_bundle, read_bundle, write_bundle
from tests.conftest import ROOT
from tests.recon.localization import stepped_car as car
from tests.rescore import shipped

LENS = car.RIG.stereo.left
MOST_BYTES = 1_500_000


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("defaults")
    write_bundle(folder / f"car{rescore.defaults.SUFFIX}", shipped.bundle())
    return folder


@pytest.fixture
def default(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Rescorer:
    monkeypatch.setattr(rescore.defaults, "FOLDER", folder)
    return Rescorer.default()


def frame_of(*, calibrated: bool = True) -> StereoFrame:
    camera = Camera(LENS.fx_px, LENS.fy_px, LENS.cx_px, LENS.cy_px, car.RIG.stereo.baseline_m)
    return StereoFrame(
        np.full((LENS.height_px, LENS.width_px, 3), 90, np.uint8),
        disparity_px=car.disparity_of(shipped.PLACE, noise_px=0.3),
        camera=camera if calibrated else None,
        ground=GroundPlane(1.65),
    )


def rescored(rescorer: Rescorer, *, calibrated: bool = True) -> Rescored:
    frame = frame_of(calibrated=calibrated)
    return rescorer.rescore(frame, Boxes(shipped.boxes_px(), likelihood=np.array(shipped.LIKELIHOODS)))


def test_a_file_gives_back_what_was_written(folder: Path) -> None:
    file = folder / f"car{rescore.defaults.SUFFIX}"
    written, read = shipped.bundle(), read_bundle(file)
    assert (read.w, read.config, read.made_with) == (written.w, written.config, written.made_with)
    cues = np.random.default_rng(0).uniform(0, 1, (20, len(CUES)))
    np.testing.assert_array_equal(
        read.evidence_model.difference(cues), written.evidence_model.difference(cues)
    )
    assert read.class_model.as_json() == written.class_model.as_json()
    again = folder / "again.gz"
    write_bundle(again, read)
    assert again.read_bytes() == file.read_bytes()


def test_the_default_rescorer_places_the_car_and_says_from_where_it_is_seen(default: Rescorer) -> None:
    assert default.mode is Registration.INSTANCE
    found = rescored(default)
    assert found.status == ("ok",) * 3
    # the detector has the half car first and the bare road last
    assert np.argsort(-found.posterior).tolist() == [0, 1, 2]
    assert found.boxes3d is not None
    # x right, y down, z forward; the centre of a car of 1.5 m lies 0.75 m above the ground, 0.9 m down
    np.testing.assert_allclose(found.boxes3d.centre_cam_m[0], [-2.0, 0.9, 12.0], atol=0.1)
    assert found.boxes3d.rotation_y_rad[0] == pytest.approx(-np.radians(60), abs=np.radians(3))
    assert found.boxes3d.deviations is not None
    assert (found.boxes3d.deviations[0, [0, 2]] < 0.1).all()
    # the nose points away and to the right, and the car stands 9.5 degrees to the left
    assert found.azimuth_deg[0] == pytest.approx(180 + 30 + 9.5, abs=3)
    assert found.side[0] == "rear right"


def test_suppression_is_one_argument_more(default: Rescorer) -> None:
    plain, found = rescored(default), rescored(replace(default, suppress=True))
    assert plain.status == ("ok", "ok", "ok")
    # the half car frames the same instance as the whole one
    assert found.status == ("ok", "second_box", "ok")
    assert found.reasons[1].startswith("the same car as candidate 1 at ")
    assert 0 < found.posterior[1] < 1e-14
    second = np.array([s == "second_box" for s in found.status])
    np.testing.assert_array_equal(found.posterior[~second], plain.posterior[~second])
    np.testing.assert_array_equal(found.log_odds, plain.log_odds)
    np.testing.assert_array_equal(found.has_evidence, plain.has_evidence)


class UltralyticsBoxes:
    """Boxes as Ultralytics hands them out: rows are taken by a mask."""

    def __init__(self, xyxy: np.ndarray, conf: np.ndarray, cls: np.ndarray) -> None:
        self.xyxy, self.conf, self.cls = xyxy, conf, cls

    def __getitem__(self, rows: np.ndarray) -> "UltralyticsBoxes":
        return UltralyticsBoxes(self.xyxy[rows], self.conf[rows], self.cls[rows])


def test_the_example_of_the_documentation(default: Rescorer) -> None:
    names: dict[str, Any] = {}
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "library.md").read_text(), re.DOTALL)
    (example,) = (b for b in blocks if "Rescorer.default" in b)
    exec(example, names)
    xyxy = np.concatenate([shipped.boxes_px(), [[10, 10, 50, 90]]]).astype(np.float32)
    boxes = UltralyticsBoxes(xyxy, np.array([*shipped.LIKELIHOODS, 0.9]), np.array([2, 2, 2, 0.0]))
    posterior, boxes3d, side = names["rescored"](frame_of(), [SimpleNamespace(boxes=boxes)])
    expected = rescored(replace(default, suppress=True))
    np.testing.assert_allclose(posterior, expected.posterior)
    assert len(boxes3d) == 3
    assert side == expected.side


def test_a_frame_without_calibration_has_neutral_evidence_and_says_why(default: Rescorer) -> None:
    found = rescored(default, calibrated=False)
    assert found.status == ("no_calibration",) * 3
    assert all("calibrated camera expected" in r for r in found.reasons)
    assert not found.has_evidence.any()
    assert default.evidence_model is not None
    np.testing.assert_array_equal(found.depth_difference, default.evidence_model.neutral)
    # the order of the detector stays
    assert np.argsort(-found.posterior).tolist() == [1, 0, 2]
    assert found.boxes3d is None
    assert np.isnan(found.azimuth_deg).all()
    assert found.side == ("", "", "")


def test_another_class_says_what_is_missing(default: Rescorer) -> None:
    with pytest.raises(RescoreError, match=r"class 'chair': expected .*, found car; give --model") as raised:
        Rescorer.default("chair")
    assert "\n" not in str(raised.value)
    assert default.class_model is not None


def test_without_files_the_error_says_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rescore.defaults, "FOLDER", tmp_path)
    with pytest.raises(RescoreError, match=r"class 'car': expected .*, found none; .*Rescorer.from_file"):
        Rescorer.default()


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"nothing", "BadGzipFile"),
        (gzip.compress(b"{", mtime=0), "JSONDecodeError"),
        (gzip.compress(b"[]", mtime=0), "TypeError"),
        (gzip.compress(b'{"format": "rescorer bundle 0"}', mtime=0), "format 'rescorer bundle 0'"),
    ],
)
def test_a_damaged_file_is_refused_in_one_line(tmp_path: Path, content: bytes, said: str) -> None:
    file = tmp_path / "car.gz"
    file.write_bytes(content)
    with pytest.raises(RescoreError, match=rf"expected a rescorer .*{re.escape(said)}.*; install") as raised:
        read_bundle(file)
    assert "\n" not in str(raised.value)


def test_settings_of_another_version_are_refused(tmp_path: Path, folder: Path) -> None:
    value = json.loads(gzip.decompress((folder / f"car{rescore.defaults.SUFFIX}").read_bytes()))
    value["settings"]["nearest"] = 3
    file = tmp_path / "car.gz"
    file.write_bytes(gzip.compress(json.dumps(value).encode()))
    with pytest.raises(RescoreError, match=r"nearest.*; install the package again"):
        read_bundle(file)


def test_what_comes_with_the_package_is_whole() -> None:
    for file in rescore.defaults.FOLDER.iterdir():
        if file.name.endswith(rescore.defaults.SUFFIX):
            bundle = default_bundle(file.name.removesuffix(rescore.defaults.SUFFIX))
            assert bundle.class_model.shape_space is not None
            assert bundle.evidence_model.registration is Registration.INSTANCE
            assert bundle.made_with[-1].startswith("python -m reports.publishing.defaults")
            assert len(file.read_bytes()) <= MOST_BYTES


def test_a_rescorer_that_cannot_suppress_says_so(default: Rescorer) -> None:
    assert default.class_model is not None
    with pytest.raises(RescoreError, match="expected a class model with a shape space for suppress=True"):
        replace(default, class_model=replace(default.class_model, shape_space=None), suppress=True)


def test_mode_instance_does_without_predicted_depth(default: Rescorer) -> None:
    frame, boxes = frame_of(), Boxes(shipped.boxes_px(), likelihood=np.array(shipped.LIKELIHOODS))
    plain, whole = (default.rescore(frame, boxes, instances=wanted) for wanted in (False, True))
    np.testing.assert_array_equal(plain.posterior, whole.posterior)
    assert plain.status == whole.status
    assert plain.instances is None
    assert whole.instances is not None
    assert len(whole.instances) == len(plain.posterior)
    # what the fit says of the view is that of the 3D box
    assert plain.view == whole.view
    assert plain.boxes3d is not None
    turned = [ViewBins().name(ViewBins().containing(a)) for a in np.radians(plain.boxes3d.azimuth_deg)]
    assert list(plain.view) == turned
    assert plain.view_bin.tolist() == [ViewBins().containing(a) for a in np.radians(plain.azimuth_deg)]
