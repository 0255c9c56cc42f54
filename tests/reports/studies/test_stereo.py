import json
import re
import zipfile
from pathlib import Path

import cv2
import numpy as np
from typer.testing import CliRunner

from reports.publishing.stereo_pairs import lay_out_aloe, lay_out_motorcycle
from rescore.cli import app
from rescore.formats.stereo_truth import find_true_scenes
from rescore.studies.stereo import RULES, Method
from rescore.studies.stereo_file import PUBLIC, StereoResult
from tests.true_pairs import HEIGHT, WIDTH, kitti_2015, noise, scene, untrue, write_png


def test_the_study_writes_page_numbers_and_figure(tmp_path: Path):
    out = tmp_path / "out"
    folders = [scene(tmp_path / "wall"), kitti_2015(tmp_path / "kitti"), untrue(tmp_path / "mine")]
    result = CliRunner().invoke(app, ["study-stereo", *map(str, folders), "--out", str(out)])
    assert result.exit_code == 0, result.output
    page = (out / "README.md").read_text()
    numbers = json.loads((out / "stereo.json").read_text())
    wall, kitti = numbers["known_disparity"]
    assert (wall["name"], kitti["name"], kitti["n_pairs"]) == ("wall", "KITTI 2015", 2)
    assert "on every pixel of 5 pairs" in page
    assert wall["n_pixels_unlike_same_call"] == kitti["n_pixels_unlike_same_call"] == 0

    def error(one: dict, **which: str) -> dict:
        (row,) = [e for e in one["errors"] if all(e[k] == v for k, v in which.items())]
        return row

    ours = error(kitti, measured_by="rescore", pixels="all", rule="D1")
    assert ours == error(kitti, measured_by="same call", pixels="all", rule="D1") | {"measured_by": "rescore"}
    # KITTI's table: the shares of the JSON
    shares = [
        error(kitti, measured_by="rescore", pixels=f"all{g}", rule="D1")["wrong_share_filled"]
        for g in (", background", ", foreground", "")
    ]
    cells = " | ".join(f"{s:.2%}".replace("%", " %") for s in shares)
    assert f"| rescore | All / All | {cells} |" in page
    assert shares[0] > shares[2] > shares[1]  # the made truth is wrong in the background alone
    assert len(numbers["without_truth"]) == 2
    assert "were not at hand" not in page
    assert cv2.imread(str(out / "maps.png")) is not None
    assert str(tmp_path) not in re.sub(r"Made by .*", "", page)


def test_json_is_what_the_file_holds_also_where_a_share_is_of_nothing(tmp_path: Path):
    out, kitti = tmp_path / "out", kitti_2015(tmp_path / "kitti")
    for objects in (kitti / "obj_map").iterdir():
        write_png(objects, np.zeros((HEIGHT, WIDTH), np.uint8))
    folders = (kitti, untrue(tmp_path / "mine"))
    result = CliRunner().invoke(app, ["study-stereo", *map(str, folders), "--out", str(out), "--json"])
    assert result.exit_code == 0, result.output
    numbers = json.loads(result.stdout)
    assert numbers == json.loads((out / "stereo.json").read_text())
    (known,) = numbers["known_disparity"]
    foreground = [e for e in known["errors"] if e["pixels"].endswith("foreground")]
    assert len(foreground) == len(Method) * 2 * len(RULES)
    shares = ("density", "end_point_error_px", "wrong_share_measured", "wrong_share_filled")
    assert all(e["n_truth"] == 0 and e[name] is None for e in foreground for name in shares)
    read = StereoResult.model_validate(numbers)
    assert all(np.isnan(e.density) for e in read.known_disparity[0].errors if e.pixels.endswith("foreground"))


def test_public_figures_are_on_the_page_without_kitti_truth(tmp_path: Path):
    out = tmp_path / "out"
    folder = untrue(tmp_path / "mine")
    result = CliRunner().invoke(app, ["study-stereo", str(folder), "--out", str(out), "--nearest", "4"])
    assert result.exit_code == 0, result.output
    page = (out / "README.md").read_text()
    assert "KITTI's true disparities were not at hand" in page
    assert "surfaces from 4 m on" in page
    for figure in PUBLIC:
        assert f"| {figure.pictures} |" in page
        assert f"{figure.wrong_all:.2f} %" in page
        assert figure.source in page
    assert not (out / "maps.png").exists()


def test_a_data_set_without_pairs_is_one_error(tmp_path: Path):
    (tmp_path / "mine" / "images").mkdir(parents=True)
    result = CliRunner().invoke(app, ["study-stereo", str(tmp_path / "mine"), "--out", str(tmp_path / "out")])
    assert result.exit_code == 1


def test_shipped_pairs_are_laid_out_as_scenes(tmp_path: Path):
    data = tmp_path / "package" / "usr/share/doc/opencv-doc/examples/data"
    left, right = noise(1)
    truth = np.full(left.shape, 12, np.uint8)
    truth[0] = 0
    for name, value in (("aloeL.jpg", left), ("aloeR.jpg", right), ("aloeGT.png", truth)):
        write_png(data / name, value)
    wheel = tmp_path / "skimage.whl"
    disparity = np.where(truth == 0, np.inf, truth).astype(np.float32)
    np.savez(tmp_path / "disp.npz", disparity)
    with zipfile.ZipFile(wheel, "w") as files:
        files.write(tmp_path / "disp.npz", "skimage/data/motorcycle_disp.npz")
        for side, picture in (("left", left), ("right", right)):
            files.writestr(f"skimage/data/motorcycle_{side}.png", cv2.imencode(".png", picture)[1].tobytes())
    out = tmp_path / "scenes"
    lay_out_aloe(tmp_path / "package", out)
    lay_out_motorcycle(wheel, out)
    scenes = find_true_scenes(out)
    assert scenes is not None
    assert [s.name for s in scenes.scenes] == ["aloe", "motorcycle"]
    for pair in (s.load() for s in scenes.scenes):
        assert np.isnan(pair.truth_px[0]).all()
        assert (pair.truth_px[1:] == 12).all()
