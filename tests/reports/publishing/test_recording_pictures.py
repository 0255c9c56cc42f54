from pathlib import Path

import cv2
import pytest

from reports.publishing.recording_pictures import publish_recording
from reports.recording.blueprint import TABS


def test_each_tab_is_drawn_without_a_fault_and_the_page_shows_it(run_dir: Path, tmp_path: Path):
    if not list(Path("/usr/share/vulkan/icd.d").glob("*.json")):
        pytest.skip("the viewer needs a Vulkan driver: apt-get install mesa-vulkan-drivers")
    page = publish_recording(run_dir, tmp_path / "recording", "make this")
    text = page.read_text()
    assert "Made by `make this`" in text
    for name in TABS:
        file = page.parent / f"{name.replace(' ', '_')}.jpg"
        assert f"({file.name})" in text
        window = cv2.imread(str(file))
        # an empty window has one colour
        assert window.shape[1] == 1600
        assert window.std() > 8
