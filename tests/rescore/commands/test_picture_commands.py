"""The commands on one picture: files, table, and one line for everything that can be wrong."""

import json
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from recon.camera import DEFAULT_GROUND
from recon.errors import RescoreError
from rescore.library.single_picture import load_class, open_photo, parse_box
from tests.rescore import own_data as own
from tests.rescore.spoiling import Run
from tests.single_car import CarPicture, car_from, quick_car_model


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A picture of a car, its class model and its camera."""
    out = tmp_path_factory.mktemp("picture")
    car = the_car()
    cv2.imwrite(str(out / "car.png"), car.rgb[..., ::-1])
    quick_car_model().save(out / "car.json")
    c = car.seen_from.camera
    camera = {"fx": c.fx_px, "fy": c.fy_px, "cx": c.cx_px, "cy": c.cy_px, "height_m": 1.5, "pitch_rad": 0.0}
    (out / "calib.json").write_text(json.dumps(camera))
    return out


@lru_cache(maxsize=1)
def the_car() -> CarPicture:
    return car_from(90, seed=3, width_px=320)


def box_of(car: CarPicture) -> str:
    x0, y0, x1, y1 = car.box_px
    return f"{x0:.2f},{y0:.2f},{x1 - x0:.2f},{y1 - y0:.2f}"


def options(folder: Path) -> list[object]:
    return ["--class", "car", "--model", folder / "car.json", "--calib", folder / "calib.json"]


def test_reconstruct_writes_its_files(run: Run, folder: Path, tmp_path: Path) -> None:
    car = the_car()
    code, table, error = run(
        "reconstruct", folder / "car.png", "--box", box_of(car), *options(folder), "--view-bin", 3,
        "--out", tmp_path / "out",
    )  # fmt: skip
    assert code == 0, error
    names = sorted(p.name for p in (tmp_path / "out").iterdir())
    assert names == ["instance.json", "object.glb", "object.ply", "overlay.png"]
    found = json.loads((tmp_path / "out" / "instance.json").read_text())
    assert np.linalg.norm(np.array(found["centroid_m"]) - car.cam_from_object[:3, 3] + [0, 0.7, 0]) < 1
    assert found["box_corners_m"][5][0] < found["box_corners_m"][1][0] + 1e-6
    assert {p["name"] for p in found["parts"] if p["seen"]} >= {"left_body", "left_windows"}
    assert cv2.imread(str(tmp_path / "out" / "overlay.png")).shape == car.rgb.shape
    assert "left_body" in table
    assert "predicted: not in the picture" in table
    assert f"{found['size_m'][0]:.2f} x" in table


def test_without_a_view_bin_the_class_model_chooses(run: Run, folder: Path, tmp_path: Path) -> None:
    code, shown, error = run(
        "reconstruct", folder / "car.png", "--box", box_of(the_car()), *options(folder),
        "--out", tmp_path / "out",
    )  # fmt: skip
    assert code == 0, error
    # the car is seen from its left
    assert "view bin 3 chosen, probability" in shown
    assert json.loads((tmp_path / "out" / "instance.json").read_text())["view_bin"] == 3


def test_json_in_place_of_the_table(run: Run, folder: Path, tmp_path: Path) -> None:
    box, out = box_of(the_car()), tmp_path / "out"
    code, shown, error = run(
        "reconstruct", folder / "car.png", "--box", box, *options(folder), "--out", out, "--json"
    )
    assert code == 0, error
    assert json.loads(shown) == json.loads((out / "instance.json").read_text())
    assert "view bin 3 chosen, probability" in error
    code, shown, error = run(
        "popup", folder / "car.png", "--box", box, *options(folder), "--view-bin", 3, "--out", out, "--json"
    )
    assert code == 0, error
    found = json.loads(shown)
    assert [one["view_bin"] for one in found["objects"]] == [3]
    assert found["structural_similarity"] > 0.9


def test_popup_of_two_boxes(run: Run, folder: Path, tmp_path: Path) -> None:
    box = box_of(the_car())
    code, shown, error = run(
        "popup", folder / "car.png", "--box", box, "--box", box, *options(folder), "--view-bin", 3,
        "--out", tmp_path / "out",
    )  # fmt: skip
    assert code == 0, error
    names = sorted(p.name for p in (tmp_path / "out").iterdir())
    assert names == ["scene.glb", "turntable.gif", "views.png"]
    likeness = float(shown.split("structural similarity ")[1].split()[0])
    assert likeness > 0.9


def test_popup_goes_on_without_a_box_in_which_nothing_is_found(
    run: Run, folder: Path, tmp_path: Path
) -> None:
    box, sky = box_of(the_car()), "5,5,100,30"
    given = ("popup", folder / "car.png", *options(folder), "--view-bin", 3, "--out", tmp_path / "out")
    code, shown, error = run(*given, "--box", sky, "--box", box, "--json")
    assert code == 0, error
    found = json.loads(shown)
    assert len(found["objects"]) == 1
    assert "above_horizon" in found["failed"][sky]
    assert "1 of 2 boxes failed and are left out of the scene" in error
    assert (tmp_path / "out" / "scene.glb").is_file()
    code, shown, error = run(*given, "--box", sky, "--box", sky)
    assert (code, shown) == (1, "")
    assert error.splitlines()[-1].endswith("got none in any of 2; mend --box")
    # what is no box at all ends it before anything is looked for
    code, _, error = run(*given, "--box", box, "--box", "10,10,50")
    assert (code, error.count("\n")) == (1, 1)


@pytest.mark.parametrize("command", ["reconstruct", "popup"])
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"--box": "10,10,50"}, "--box: expected numbers x,y,w,h"),
        ({"--box": "10,10,-50,20"}, "--box: expected a positive width"),
        ({"--box": "900,10,50,20"}, "--box: expected a box inside the picture of 320 x 240"),
        ({"--box": "5,5,100,30"}, "above_horizon"),
        ({"--box": "200,228,120,40"}, "box_outside_image"),
        ({"--class": "chair"}, "expected a model of class 'chair', got one of 'car'"),
        ({"--model": "none.json"}, "expected a class model, found no file"),
        ({"--view-bin": "12"}, "view bin: expected 0 to 11, got 12"),
        ({"--view-bin": None, "--box": "200,10,20,150"}, "none does"),
        ({"--view-bin": None, "--box": "300,20,200,80"}, "got 10%; mend --box"),
        ({"--model": None, "--class": "chair"}, "`rescore learn --class chair --out chair.json` makes"),
        ({"--height": "-1"}, "the camera must be above the ground"),
        ({"--camera": "1,2,3"}, "camera: expected --camera or --calib, got both"),
        ({"--camera": "1,2,3", "--calib": None}, "--camera: expected numbers fx,fy,cx,cy"),
        ({"--camera": "-1,2,3,4", "--calib": None}, "focal lengths and sizes must be positive"),
        ({"--calib": "none.json"}, "none.json"),
    ],
)
def test_what_is_wrong_is_one_line(
    run: Run, folder: Path, tmp_path: Path, command: str, change: dict[str, str | None], message: str
) -> None:
    given: dict[str, object] = {
        "--box": box_of(the_car()),
        "--class": "car",
        "--model": folder / "car.json",
        "--calib": folder / "calib.json",
        "--view-bin": "3",
        "--out": tmp_path / "out",
    } | change
    arguments = [str(x) for pair in given.items() if pair[1] is not None for x in pair]
    code, _, error = run(command, folder / "car.png", *arguments)
    assert code == 1
    assert error.count("\n") == 1, error
    assert message in error
    assert not (tmp_path / "out").exists()


def test_unreadable_pictures_are_one_line(run: Run, folder: Path, tmp_path: Path) -> None:
    (tmp_path / "broken.png").write_bytes((folder / "car.png").read_bytes()[:2000])
    for name, message in (("none.png", "found no file"), ("broken.png", "could not decode it")):
        code, _, error = run(
            "reconstruct", tmp_path / name, "--box", "1,1,9,9", *options(folder), "--view-bin", 3,
            "--out", tmp_path / "out",
        )  # fmt: skip
        assert (code, error.count("\n")) == (1, 1)
        assert message in error


def test_a_model_without_the_view_says_which_it_has(folder: Path, run: Run, tmp_path: Path) -> None:
    data = json.loads((folder / "car.json").read_text())
    data["part_labelled_images"] = data["part_labelled_images"][:3]
    (tmp_path / "few.json").write_text(json.dumps(data))
    code, _, error = run(
        "reconstruct", folder / "car.png", "--box", box_of(the_car()), "--class", "car",
        "--model", tmp_path / "few.json", "--view-bin", 5, "--out", tmp_path / "out",
    )  # fmt: skip
    assert code == 1
    assert "expected a labelled view of bin 5, has bins 0, 1, 2" in error


def test_the_camera_comes_from_options_file_or_default(folder: Path, tmp_path: Path) -> None:
    picture = folder / "car.png"
    default = open_photo(picture, None, None, None, None)
    assert default.seen_from.camera.fx_px == pytest.approx(1.4 * 240)
    assert default.seen_from.ground == DEFAULT_GROUND
    given = open_photo(picture, "300,310,150,120", None, 1.2, 10.0)
    assert (
        given.seen_from.camera.fx_px,
        given.seen_from.camera.fy_px,
        given.seen_from.camera.cx_px,
        given.seen_from.camera.cy_px,
    ) == (
        300,
        310,
        150,
        120,
    )
    assert (given.seen_from.ground.height_m, given.seen_from.ground.pitch_rad) == (
        1.2,
        pytest.approx(np.deg2rad(10)),
    )
    filed = open_photo(picture, None, folder / "calib.json", None, 2.0)
    assert filed.seen_from.camera == the_car().seen_from.camera
    assert filed.seen_from.ground.height_m == 1.5
    assert filed.seen_from.ground.pitch_rad == pytest.approx(np.deg2rad(2))
    (tmp_path / "half.json").write_text('{"fx": 300}')
    with pytest.raises(RescoreError, match=r"half.json: expected .*fx with fy, cx, cy\), got fx;"):
        open_photo(picture, None, tmp_path / "half.json", None, None)


def test_the_camera_comes_from_the_calibration_of_any_tool(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """OpenCV's YAML, KITTI's text and ROS's file of a bent lens, all of one left camera."""
    own.write_text(tmp_path / "opencv.yaml", own.opencv_yaml({"cameraMatrix": own.K, "height_m": 1.7}))
    own.write_text(tmp_path / "kitti.txt", own.kitti_calib())
    ros = {
        "image_width": 320,
        "image_height": 240,
        "camera_matrix": {"rows": 3, "cols": 3, "data": own.K.ravel()},
    }
    bent = {"rows": 1, "cols": 5, "data": [0.1, 0, 0, 0, 0]}
    flat = json.dumps(ros | {"distortion_coefficients": bent}, default=np.ndarray.tolist)
    own.write_text(tmp_path / "ros.yaml", flat)
    for name, height_m in (("opencv.yaml", 1.7), ("kitti.txt", 1.5), ("ros.yaml", 1.5)):
        seen_from = open_photo(folder / "car.png", None, tmp_path / name, None, None).seen_from
        assert (seen_from.camera.fx_px, seen_from.camera.cx_px) == (own.FX, own.K[0, 2])
        assert (seen_from.camera.width_px, seen_from.ground.height_m) == (320, height_m)
        assert ("lens distortion (up to 0.1) is not undone" in capsys.readouterr().err) == (
            name == "ros.yaml"
        )
    own.write_text(tmp_path / "ros.yaml", flat.replace("320", "640"))
    with pytest.raises(
        RescoreError, match="calibration of pictures of 320 x 240 pixels, got that of 640 x 240"
    ):
        open_photo(folder / "car.png", None, tmp_path / "ros.yaml", None, None)


def test_a_box_partly_outside_is_a_box() -> None:
    np.testing.assert_array_equal(parse_box("-10,5,30,20", 100, 50), [-10, 5, 20, 25])
    with pytest.raises(RescoreError, match="write them with commas"):
        parse_box("1 2 3 4", 100, 50)
    with pytest.raises(RescoreError, match="expected numbers"):
        parse_box("1,2,nan,4", 100, 50)


def test_the_class_must_be_that_of_the_model(folder: Path) -> None:
    assert load_class(folder / "car.json", "car").class_name == "car"
    with pytest.raises(RescoreError, match="mend --class"):
        load_class(folder / "car.json", "chair")
