import json
import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import same_color
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from PIL import Image

from recon.boxes import iou_matrix
from recon.errors import RescoreError
from reports.publishing.birds_eye import FARTHEST_M, draw_birds_eye
from reports.publishing.prose import marks
from reports.publishing.real_street import PICTURES, publish_street
from reports.publishing.street_boxes import AGAINST, FOR, SILENT, StreetFrame, street_frames
from reports.publishing.street_card import WIDTH_PX, place_labels
from rescore.results.run_folder import Run, load_run
from tests.conftest import REAL_STREET, ROOT

MOST_BYTES = 400_000
SIDE_PX = 500


@pytest.fixture(scope="module")
def frames(real_street_run: Path) -> tuple[StreetFrame, ...]:
    return street_frames(load_run(real_street_run))


@pytest.fixture(scope="module")
def page(real_street_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return publish_street(real_street_run, tmp_path_factory.mktemp("published"), "make this")


def test_a_picture_a_frame_that_a_page_can_show(page: Path) -> None:
    text = page.read_text()
    for name in PICTURES:
        file = page.parent / f"{name}.webp"
        assert f"({file.name})" in text
        assert file.stat().st_size < MOST_BYTES
        picture = np.asarray(Image.open(file).convert("RGB"))
        assert picture.shape[1] == WIDTH_PX
        assert picture.std() > 30


def test_the_pictures_have_the_colours_of_what_depth_says(
    page: Path, frames: tuple[StreetFrame, ...]
) -> None:
    for name, frame in zip(PICTURES, frames, strict=True):
        picture = np.asarray(Image.open(page.parent / f"{name}.webp").convert("RGB")).astype(int)
        used = {b.colour for b in frame.boxes}
        for colour in (FOR, AGAINST):
            rgb = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)])
            # a label has thousands of pixels, the picture itself hardly any of just this colour
            count = (np.abs(picture - rgb).max(axis=2) < 8).sum()
            assert (count > 1000) == (colour in used), (name, colour, count)


def test_the_page_has_every_box_with_the_numbers_of_the_rescored_file(
    real_street_run: Path, page: Path
) -> None:
    text = page.read_text()
    assert "Made by `make this`" in text
    assert "CC BY\n4.0" in text
    rows = json.loads((real_street_run / "rescored.json").read_text())
    assert len(re.findall(r"^\| \d+ \|", text, flags=re.MULTILINE)) == len(rows) == 21
    order = sorted(rows, key=lambda r: -r["score"])
    shown = {(r["image_id"], *r["bbox"][:2]): r["shows"] for r in detections()}
    for row in rows:
        what = shown[(row["image_id"], *row["bbox"][:2])]
        numbers = (row["likelihood"], 1 - row["depth_difference"], row["score"])
        told = " | ".join(f"{v:.2f}" for v in numbers)
        place = 1 + order.index(row)
        assert re.search(
            rf"^\| \d+ \| {what} \| [^|]+ \| {re.escape(told)} \| \d+ \| {place} \|$", text, re.M
        )


def test_what_is_published_was_made_by_the_rescorer_that_comes_with_the_package(page: Path) -> None:
    published = ROOT / "reports" / "published" / "real_street" / "README.md"
    now, then = (_numbers(p.read_text()) for p in (page, published))
    assert now.shape == (21, 3)
    # another decoder of pictures may move a score a little
    assert then == pytest.approx(now, abs=0.05), "run make published-street"


def _numbers(text: str) -> np.ndarray:
    """Likelihood, 1 - D and score of each box in the tables of a page, shape (n, 3)."""
    rows = re.findall(r"^\| \d+ \|.*?((?: \d\.\d\d \|){3}) \d+ \| \d+ \|$", text, flags=re.MULTILINE)
    return np.array([[float(v) for v in row.split("|")[:3]] for row in rows])


def detections() -> list[dict[str, object]]:
    rows: list[dict[str, object]] = json.loads((REAL_STREET / "detections.json").read_text())
    return rows


def test_colours_and_reasons_are_on_the_side_that_depth_takes(frames: tuple[StreetFrame, ...]) -> None:
    boxes = [b for frame in frames for b in frame.boxes]
    assert {b.colour for b in boxes} == {FOR, AGAINST, SILENT}
    for b in boxes:
        d, silent = b.view.depth_difference, b.view.status != "ok"
        assert b.colour == (SILENT if silent else FOR if d < b.neutral else AGAINST)
        assert bool(b.reasons) is not silent
        assert str(b.number) in b.label
        assert ("→" in b.label) is not silent
    road = next(b for b in boxes if b.shows == "bare road with a white line")
    assert road.colour == AGAINST
    assert road.title == (
        f"bare road with a white line: detector 0.24, depth {1 - road.view.depth_difference:.2f}, "
        f"together {road.view.posterior:.2f}"
    )


def test_from_above_cars_stand_at_their_distance_and_what_is_none_is_dashed(
    frames: tuple[StreetFrame, ...],
) -> None:
    for frame in frames:
        axes = Figure(figsize=(5, 5), dpi=100).add_axes((0, 0, 1, 1))
        draw_birds_eye(axes, frame.view, frame.boxes, 20.0)
        drawn = [p for p in axes.patches if isinstance(p, Polygon)][1:]
        shown = [b for b in frame.boxes if b.has_evidence and b.view.box3d is not None]
        shown = [b for b in shown if b.view.box3d.distance_m[0] < FARTHEST_M]
        assert len(drawn) == len(shown)
        for b, patch in zip(shown, drawn, strict=True):
            assert (patch.get_linestyle() in ("-", "solid")) is b.speaks_for
            assert same_color(patch.get_edgecolor(), b.colour)
            corners = patch.get_xy()[:4]
            box = b.view.box3d
            # the ground leans by a few degrees against the plane in which the distance is told
            assert np.hypot(*corners.mean(axis=0)) == pytest.approx(box.distance_m[0], rel=0.02)
            sides = np.linalg.norm(np.diff(corners, axis=0), axis=1)
            np.testing.assert_allclose(sides, box.size_m[0][[1, 0, 1]], rtol=1e-9)
            assert any(f"{box.distance_m[0]:.0f} m" in t.get_text() for t in axes.texts)


def test_labels_stay_in_the_picture_and_off_each_other() -> None:
    rng = np.random.default_rng(0)
    crop = np.array([0.0, 200.0, 1000.0, 700.0])
    for _ in range(50):
        low = rng.uniform([0, 230], [800, 500], (5, 2))
        boxes = np.concatenate([low, low + rng.uniform(20, 150, (5, 2))], axis=1)
        sizes = np.column_stack([rng.uniform(60, 180, 5), np.full(5, 30.0)])
        places = place_labels(boxes, sizes, crop)
        np.testing.assert_allclose(places[:, 2:] - places[:, :2], sizes)
        assert (places[:, :2] >= crop[:2]).all()
        assert (places[:, 2:] <= crop[2:]).all()
        overlap = iou_matrix(places, places)
        assert overlap[~np.eye(5, dtype=bool)].max() == 0


def test_a_single_label_stands_above_its_box() -> None:
    places = place_labels(
        np.array([[300.0, 300, 400, 380]]), np.array([[80.0, 20]]), np.array([0, 0, 999, 999])
    )
    np.testing.assert_allclose(places, [[300, 275, 380, 295]])


def test_a_run_of_other_frames_is_refused(instance_run: Run, tmp_path: Path) -> None:
    with pytest.raises(RescoreError, match=r"detections\.json: expected detections"):
        publish_street(instance_run.root, tmp_path / "published", "make this")
    assert not (tmp_path / "published").exists()


def test_the_readme_begins_with_the_real_picture_and_names_its_source() -> None:
    text = (ROOT / "README.md").read_text()
    pictures = re.findall(r"!\[[^]]+\]\(([^)]+)\)", text)
    assert pictures[0] == "reports/published/real_street/sun.webp"
    caption = re.sub(r"\s+", " ", text[text.index(pictures[0]) : text.index(marks("real")[0])])
    assert re.search(r"SID Mini, University of Michigan-Dearborn .+CC BY 4\.0", caption)
    for name in PICTURES:
        file = ROOT / "reports" / "published" / "real_street" / f"{name}.webp"
        assert file.stat().st_size < MOST_BYTES
        assert Image.open(file).width == WIDTH_PX
