"""The scripts in examples/ run as a user runs them, on input that they make and on files."""

import gzip
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from datasets_synth.objects.object_classes import object_class
from tests.conftest import ROOT, run_rescore
from tests.single_car import car_from

CLASS_MODEL = ROOT / "tests" / "data" / "class_model.json.gz"


def run_example(name: str, *arguments: object) -> str:
    """What an example prints; it must end well."""
    command = [sys.executable, str(ROOT / "examples" / f"{name}.py"), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def extents_m(path: Path) -> np.ndarray:
    scene = trimesh.load_scene(path)
    assert sum(len(mesh.faces) for mesh in scene.geometry.values()) > 100
    return np.asarray(scene.extents)


def test_one_picture_in_3d(tmp_path: Path) -> None:
    out = tmp_path / "chair.glb"
    said = run_example("one_picture_in_3d", "--out", out)
    assert said.startswith("chair: ")
    chairs = object_class("chair")
    mesh = chairs.build(chairs.test[0], np.random.default_rng(0))
    depth, width, height = np.ptp(mesh.vertices_m, axis=0)
    # glTF: x is across, y up, z along the object
    assert extents_m(out) == pytest.approx([width, height, depth], rel=0.35)
    assert extents_m(out)[1] == pytest.approx(height, rel=0.1)


def test_one_picture_in_3d_from_files(tmp_path: Path) -> None:
    car = car_from(90.0)
    model = tmp_path / "car.json"
    model.write_bytes(gzip.decompress(CLASS_MODEL.read_bytes()))
    Image.fromarray(car.rgb).save(tmp_path / "car.png")
    x0, y0, x1, y1 = car.box_px
    box = f"{x0},{y0},{x1 - x0},{y1 - y0}"
    out = tmp_path / "car.glb"
    said = run_example(
        "one_picture_in_3d", "--out", out, "--picture", tmp_path / "car.png", "--box", box, "--model", model
    )
    assert said.startswith("car: ")
    _, height, length = extents_m(out)
    # the camera is the assumed one, so only the ratio of sizes can be told
    assert length / height == pytest.approx(car.size_m[0] / car.size_m[2], rel=0.25)


@pytest.fixture(scope="module")
def pairs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder in which the example of pairs has made its input and its result."""
    folder = tmp_path_factory.mktemp("pairs")
    run_example("folder_of_pairs", "--out", folder / "rescored.json")
    return folder


def rows_of(path: Path) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = json.loads(path.read_text())
    return rows


def test_folder_of_pairs_rescores_every_box(pairs: Path) -> None:
    given, out = rows_of(pairs / "boxes.json"), rows_of(pairs / "rescored.json")
    assert sorted((r["image_id"], r["bbox"]) for r in out) == sorted(
        (r["image_id"], r["bbox"]) for r in given
    )
    compared = [r for r in out if r["status"] == "ok"]
    assert len(compared) >= len(out) / 2
    assert all(0 <= r["score"] <= 1 and r["score"] != r["detector_score"] for r in compared)
    # eq. 7 without a D of eq. 6
    assert all(r["score"] == r["detector_score"] for r in out if r["status"] != "ok")


def test_folder_of_pairs_from_files_gives_the_same(pairs: Path, tmp_path: Path) -> None:
    again = tmp_path / "again.json"
    own = ("--data", pairs / "data", "--boxes", pairs / "boxes.json", "--model", pairs / "car.json")
    run_example("folder_of_pairs", "--out", again, *own)
    assert again.read_bytes() == (pairs / "rescored.json").read_bytes()


def test_rescored_pairs_can_be_evaluated(pairs: Path, tmp_path: Path) -> None:
    done = run_rescore("evaluate", pairs / "data", pairs / "rescored.json", "--out", tmp_path, "--no-report")
    assert done.returncode == 0, done.stderr
    assert json.loads((tmp_path / "metrics.json").read_text())["n_cars"] > 0


def test_live_loop_puts_the_car_above_the_wall() -> None:
    lines = run_example("live_loop", "--frames", 2).splitlines()
    assert len(lines) == 2
    for number, line in enumerate(lines):
        head, _, rest = line.partition(": ")
        assert head == f"frame {number}"
        car, car_status, wall, _ = rest.split()[:4]
        assert car_status == "ok"
        assert float(car) > float(wall)
