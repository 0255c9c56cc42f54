"""Data sets with a user's own cars."""

import io
import json
from contextlib import redirect_stderr
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from datasets_synth.build import build_dataset
from datasets_synth.cars.models import ImportedModel, cars_of_splits, part_labelled_cars
from datasets_synth.presets import CarConfig, ClutterConfig, LightConfig, SplitSize, synth_preset
from recon.arrays import BoolArray, UInt8Array
from recon.part_views import load_part_views

CONFIG = replace(
    synth_preset("tiny"),
    splits={
        "train": SplitSize(1, 1),
        "calibration": SplitSize(1, 0),
        "validation": SplitSize(1, 0),
        "test": SplitSize(2, 2),
    },
    cars=CarConfig(far_m=12.0, other_view_share=0.0),
    clutter=ClutterConfig(occluder_share=0.0, pictures=0, wheeled=0, boxes=0, furniture=0),
    light=LightConfig(sunny=0.0, overcast=1.0, dusk=0.0, level=(1.0, 1.0), haze_per_m=(0.0, 0.0)),
    n_pictures=1,
)


def box_lines(low: tuple[float, float, float], high: tuple[float, float, float], first: int) -> list[str]:
    """OBJ lines of a box with outward faces, glTF axes."""
    corners = [(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return [f"v {x} {y} {z}" for x, y, z in corners] + [
        "f " + " ".join(str(first + i) for i in face) for face in faces
    ]


def write_car(folder: Path, name: str, group: str = "") -> None:
    """A car 4 m long: red behind, a blue nose block at +Z, both 0.8 m high, and a red cabin behind."""
    folder.mkdir(exist_ok=True)
    (folder / f"{name}.mtl").write_text("newmtl paint\nKd 0.7 0.02 0.02\nnewmtl nose\nKd 0.02 0.02 0.7\n")
    lines = [
        f"mtllib {name}.mtl",
        *([f"g {group}"] if group else []),
        "usemtl paint",
        *box_lines((-0.9, 0, -2), (0.9, 0.8, 1), 1),
        *box_lines((-0.8, 0.8, -1.8), (0.8, 1.5, 0.2), 9),
        "usemtl nose",
        *box_lines((-0.9, 0, 1), (0.9, 0.8, 2), 17),
    ]
    (folder / f"{name}.obj").write_text("\n".join(lines))


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A data set with own cars to train and to test on, and what was said while building."""
    root = tmp_path_factory.mktemp("meshes")
    write_car(root / "train", "block-a")
    write_car(root / "test", "block-b")
    said = io.StringIO()
    with redirect_stderr(said):
        build_dataset(CONFIG, root / "data", seed=1, train_meshes=root / "train", test_meshes=root / "test")
    return root / "data", said.getvalue()


def cars_seen(data: Path) -> list[tuple[Any, UInt8Array, BoolArray]]:
    """Annotation, left picture (RGB) and mask of each annotated car of the test split."""
    record = json.loads((data / "annotations.json").read_text())
    out = []
    for image in (i for i in record["images"] if i["split"] == "test"):
        rgb = cv2.imread(str(data / image["file_name"]))[..., ::-1]
        instance = cv2.imread(str(data / image["instance_file_name"]), cv2.IMREAD_UNCHANGED)
        ids = [i["id"] for i in image["instances"] if i["kind"] == "car"]
        rows = [a for a in record["annotations"] if a["image_id"] == image["id"]]
        if len(ids) == 1:  # one car in the frame: the annotation is its own
            out.append((rows[0], rgb, instance == ids[0]))
    return out


def test_own_cars_stand_on_their_wheels_with_the_nose_to_the_left(built: tuple[Path, str]) -> None:
    seen = cars_seen(built[0])
    assert seen
    for row, rgb, mask in seen:
        assert row["shape_id"] == "block-b"
        assert row["size_m"] == pytest.approx([4.0, 1.8, 1.5], abs=1e-3)
        red = mask & (rgb[..., 0] > 1.5 * rgb[..., 2].astype(float))
        blue = mask & (rgb[..., 2] > 1.5 * rgb[..., 0].astype(float))
        # from the side: nose 1 x 0.8 of 4 x 0.8 + 2 x 0.7 = 4.6 square metres, 0.17; a car turned by up
        # to 15 degrees shows a little of its front or rear too
        assert 0.08 < blue.sum() / mask.sum() < 0.35
        assert red.sum() > 0.5 * mask.sum()
        (red_v, red_u), (blue_v, blue_u) = np.nonzero(red), np.nonzero(blue)
        assert blue_u.mean() < red_u.min() + 0.3 * np.ptp(red_u)
        # the cabin is red, and above
        assert red_v.min() < blue_v.min()
        v, u = np.nonzero(mask)
        x, y, w, h = row["bbox"]
        # nothing but a kerb may hide the foot of a car here, so the box of its pixels is its box
        assert [u.min(), v.min(), u.max() + 1] == pytest.approx([x, y, x + w], abs=1.01)
        assert y + 0.9 * h < v.max() + 1 < y + h + 1.01


def test_without_part_labels_the_views_are_of_parametric_cars_and_it_is_said(
    built: tuple[Path, str],
) -> None:
    data, said = built
    parametric = {c.shape_id for c in cars_of_splits()["train"]}
    assert {v.instance_id for v in load_part_views(data / "part_views").views} <= parametric
    assert "parametric cars, since no training mesh has part labels" in said
    assert "parametric cars" in json.loads((data / "synth_config.json").read_text())["part_views_of"]


def test_views_are_of_the_training_meshes_that_have_part_labels(tmp_path: Path) -> None:
    write_car(tmp_path, "plain")
    write_car(tmp_path, "with-parts", "front")
    chosen, where = part_labelled_cars(cars_of_splits(train_meshes=tmp_path)["train"])
    assert [c.shape_id for c in chosen] == ["with-parts"]
    assert where.startswith("1 of 2 training cars")


def test_another_colour_is_another_car(tmp_path: Path) -> None:
    """A build with repainted cars starts anew, since another colour is another car."""
    write_car(tmp_path, "block")
    (before,) = cars_of_splits(test_meshes=tmp_path)["test"]
    text = (tmp_path / "block.mtl").read_text()
    (tmp_path / "block.mtl").write_text(text.replace("0.7 0.02 0.02", "0.02 0.7 0.02"))
    (after,) = cars_of_splits(test_meshes=tmp_path)["test"]
    assert isinstance(before, ImportedModel)
    assert isinstance(after, ImportedModel)
    assert before.digest != after.digest
    (again,) = cars_of_splits(test_meshes=tmp_path)["test"]
    assert isinstance(again, ImportedModel)
    assert again.digest == after.digest
