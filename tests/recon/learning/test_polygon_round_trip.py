"""Labelled views of a parametric car, written as the files of labelling tools and read again."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from datasets_synth.cars.models import cars_of_splits
from datasets_synth.cars.parts import CAR_PARTS
from datasets_synth.render.part_render import render_part_labels
from recon.arrays import UInt8Array
from recon.class_model import ClassModel
from recon.learning.label_files import read_labelled_views
from recon.learning.learn import learn_class_model
from recon.outlines import mask_rings
from recon.part_views import PartView, PartViews
from recon.view_bins import ViewBins
from rescore.cli import app

BINS = ViewBins()
Polygons = list[tuple[str, list[list[float]]]]


@pytest.fixture(scope="module")
def original() -> PartViews:
    mesh = cars_of_splits(None, None)["train"][0].build(np.random.default_rng(0))
    views = [render_part_labels(mesh, BINS.view_from_object(b), 200) for b in (1, 2, 4)]
    return PartViews(
        CAR_PARTS, BINS, tuple(PartView(b, v, "sedan") for b, v in zip((1, 2, 4), views, strict=True))
    )


def polygons_of(labels: UInt8Array) -> Polygons:
    """Polygons in pixel edges that paint a picture of labels: outer rings, large ones first."""
    rings = [(label, r) for label in np.unique(labels[labels > 0]) for r in mask_rings(labels == label)]
    # rings of holes turn the other way; what is in a hole is painted over it; specks are no polygons
    rings = [(label, r) for label, r in rings if cv2.contourArea(r, oriented=True) < -3]
    rings.sort(key=lambda pair: -float(np.prod(np.ptp(pair[1], axis=0))))
    # the rings run through pixel centres
    return [(CAR_PARTS[label - 1], (ring + 0.5).tolist()) for label, ring in rings]


def write_coco(path: Path, views: PartViews) -> Path:
    images, annotations = [], []
    for i, view in enumerate(views.views):
        height, width = view.labels.shape
        size = {"width": width, "height": height}
        image = {"id": i, "file_name": f"{i}.jpg", "view_bin": view.view_bin, "instance_id": view.instance_id}
        images.append(image | size)
        annotations += [
            {
                "image_id": i,
                "category_id": CAR_PARTS.index(p) + 1,
                "segmentation": [np.ravel(points).tolist()],
            }
            for p, points in polygons_of(view.labels)
        ]
    names = [{"id": i + 1, "name": n, "supercategory": "van"} for i, n in enumerate(CAR_PARTS)]
    path.write_text(json.dumps({"images": images, "categories": names, "annotations": annotations}))
    return path


def write_labelme(folder: Path, views: PartViews) -> Path:
    folder.mkdir()
    (folder / "labels.txt").write_text("\n".join(CAR_PARTS) + "\n")
    for view in views.views:
        shapes = [
            {"label": part, "points": points, "shape_type": "polygon"}
            for part, points in polygons_of(view.labels)
        ]
        flags = {f"view_bin_{b:02d}": b == view.view_bin for b in range(12)} | {"instance_one": True}
        file: dict[str, Any] = {"flags": flags, "shapes": shapes}
        file |= {"imageHeight": view.labels.shape[0], "imageWidth": view.labels.shape[1]}
        (folder / f"{view.view_bin}.json").write_text(json.dumps(file))
    return folder


def agree(a: ClassModel, b: ClassModel) -> None:
    """Parts of both models are at the same place and turned the same way."""
    of_name = {b.part_names[p.label - 1]: p for p in b.parts}
    compared = [(p, of_name[a.part_names[p.label - 1]]) for p in a.parts if p.view_count > 1]
    assert len(compared) >= 5
    for p, q in compared:
        assert q.view_count == p.view_count
        np.testing.assert_allclose(q.centroid, p.centroid, atol=0.01)
        assert p.plane[:3] @ q.plane[:3] > np.cos(np.deg2rad(5))


def test_round_trip(original: PartViews, tmp_path: Path) -> None:
    model = learn_class_model(original, "car", CAR_PARTS)
    for path in (write_coco(tmp_path / "parts.json", original), write_labelme(tmp_path / "me", original)):
        back = read_labelled_views(path).part_views
        for mine, theirs in zip(back.views, original.views, strict=True):
            assert (mine.view_bin, mine.labels.shape) == (theirs.view_bin, theirs.labels.shape)
            names = np.array(["", *back.part_names])[mine.labels]
            true = np.array(["", *CAR_PARTS])[theirs.labels]
            assert (names != true).sum() < 0.01 * (true != "").sum()
        agree(model, learn_class_model(back, "car", back.part_names))


def test_the_command_takes_both(original: PartViews, tmp_path: Path) -> None:
    paths = {
        "coco": write_coco(tmp_path / "parts.json", original),
        "me": write_labelme(tmp_path / "me", original),
    }
    for name, path in paths.items():
        out = tmp_path / f"{name}.model.json"
        done = CliRunner().invoke(app, ["learn", str(path), "--out", str(out)], catch_exceptions=False)
        assert done.exit_code == 0, done.output
        # LabelMe files name no class, so it is the preset's
        assert ClassModel.load(out).class_name == {"coco": "van", "me": "car"}[name]
        assert "one view shows it" in done.stderr
    named = tmp_path / "named.json"
    CliRunner().invoke(app, ["learn", str(paths["coco"]), "--out", str(named), "--class", "sedan"])
    assert ClassModel.load(named).class_name == "sedan"
