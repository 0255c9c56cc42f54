"""What is published of real cars is small, shown with its source, and of the boxes that the rule takes."""

import numpy as np
from PIL import Image

from reports.publishing.real_cars import KEPT, large_boxes
from rescore.files import read_json
from tests.conftest import REAL_STREET, ROOT

PUBLISHED = ROOT / "reports" / "published" / "reconstructions"


def test_the_rule_takes_the_large_vehicles_of_the_example() -> None:
    boxes = large_boxes(read_json(REAL_STREET / "detections.json", "detections"))
    assert [b["image_id"] for b in boxes] == [1, 2, 2, 3, 3, 3]
    assert all("car" in b["shows"] or "truck" in b["shows"] for b in boxes)
    assert boxes[KEPT]["shows"] == "car"


def test_what_is_published_is_small_and_names_its_source() -> None:
    page = (PUBLISHED / "real_cars.md").read_text()
    assert "CC BY 4.0" in page
    assert "SID Mini" in page
    assert page.count("\n| ") == 1 + 6
    assert (PUBLISHED / "real_car.glb").stat().st_size < 2_000_000
    assert (PUBLISHED / "real_cars.png").stat().st_size < 600_000
    sheet = np.asarray(Image.open(PUBLISHED / "real_cars.png").convert("RGB"))
    assert sheet.shape == (6 * 186 - 6, 6 * 246 - 6, 3)
