"""A rescorer in one file as the package may bring one, and a street that it judges: one car.

Its class model has the shape space of ``tests.recon.localization.stepped_car``; D asks whether the box
is that of what the disparity shows.
"""

import gzip
import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from recon.boxes import xywh_from_xyxy
from recon.class_model import ClassModel
from recon.localization.depth_views import DepthViewsConfig
from recon.localization.disparity_fit import DisparityFitConfig
from recon.localization.standing_box import StandingBox
from recon.stereo.sgbm import write_disparity
from rescore.evidence.cues import cues_of
from rescore.evidence.model import EvidenceModel
from rescore.evidence.registration import Registration
from rescore.evidence.settings import RescoreConfig
from rescore.library.bundles import Bundle
from tests.bank_judge import DATA
from tests.recon.localization import stepped_car as car

PLACE = StandingBox(np.array([-2.0, 12.0]), np.radians(60.0), car.SIZE_M)
"""Where the car stands in the ground frame: its rear and its right side are seen."""


def class_model() -> ClassModel:
    """The stored class model with a shape space of two modes that change nothing; files need some."""
    stored = json.loads(gzip.decompress((DATA / "class_model.json.gz").read_bytes()))
    space = car.space()
    space = replace(
        space,
        modes=np.zeros((*space.mean.shape, 2), np.float32),
        log_size_modes=np.zeros((3, 2)),
        part_labels=(1,),
        outlines=np.zeros((1, 4, 3)),
        outline_modes=np.zeros((1, 4, 3, 2)),
    )
    return replace(ClassModel.from_json(stored, DATA), shape_space=space)


def bundle() -> Bundle:
    names = cues_of(Registration.INSTANCE)
    knots = {name: np.array([0.0, 1.0]) for name in names}
    odds = {name: np.zeros(2) for name in names} | {"overlap": np.array([-4.0, 4.0])}
    model = EvidenceModel(Registration.INSTANCE, knots, odds, 0.0, 0.3, {})
    config = RescoreConfig(fit=DisparityFitConfig(views=DepthViewsConfig(coefficients=((0.0,),))))
    return Bundle(class_model(), model, 0.4, config, ("rescore reproduce", "publish it"))


def boxes_px() -> np.ndarray:
    """The whole car, its left half, and a box beside it on bare road, pixel edges, shape (3, 4)."""
    nowhere = StandingBox(np.array([0.0, 400.0]), 0.0, car.SIZE_M)
    whole = car.silhouette_of(car.disparity_of(PLACE), car.disparity_of(nowhere))
    half, beside = whole.copy(), whole.copy()
    half[2] = whole[[0, 2]].mean()
    beside[[0, 2]] += whole[2] - whole[0] + 100
    return np.stack([whole, half, beside])


LIKELIHOODS = (0.6, 0.7, 0.5)


def write_street(root: Path, *, calibrated: bool = True) -> tuple[Path, Path]:
    """The folder of a data set of one frame, and a file of detections in it."""
    root.mkdir()
    camera = car.RIG.stereo.left
    cv2.imwrite(str(root / "left.png"), np.full((camera.height_px, camera.width_px, 3), 90, np.uint8))
    write_disparity(root / "disparity.png", car.disparity_of(PLACE, noise_px=0.3))
    lens = {"fx": camera.fx_px, "fy": camera.fy_px, "cx": camera.cx_px, "cy": camera.cy_px}
    rig = lens | {"baseline_m": car.RIG.stereo.baseline_m, "height_m": 1.65, "pitch_rad": 0.0}
    image = {"id": 1, "file_name": "left.png", "disparity_file_name": "disparity.png"}
    image |= {"width": camera.width_px, "height": camera.height_px, "split": "test"}
    image |= {"camera": rig} if calibrated else {}
    content = {"images": [image], "annotations": [], "categories": [{"id": 1, "name": "car"}]}
    (root / "annotations.json").write_text(json.dumps(content))
    rows = [
        {"image_id": 1, "category_id": 1, "bbox": box, "score": score}
        for box, score in zip(xywh_from_xyxy(boxes_px()).tolist(), LIKELIHOODS, strict=True)
    ]
    found = root / "found.json"
    found.write_text(json.dumps(rows))
    return root, found
