"""Pictures of a recording: ``python -m reports.publishing.recording_pictures RUN FOLDER COMMAND``.

One picture a tab, and a page that says how to read them. The viewer draws without a screen, and listens on
this machine alone; it needs a Vulkan driver, which Debian has as ``mesa-vulkan-drivers``.
"""

import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from recon.errors import RescoreError
from recon.files import atomic_path
from reports.pages import write_page
from reports.palette import detector_name, mode_name
from reports.recording.blueprint import TABS
from reports.recording.log import write_recording
from reports.recording.story import Frames, Story, count_flips
from reports.recording.viewer import start_viewer
from reports.templating import render
from rescore.results.run_folder import load_run

MAX_FRAMES = 12
_QUALITY = 88
_MENU_PX = 34
_SETTLING_SHOTS = 8
"""Data and fonts are loaded while the window is drawn."""


def publish_recording(run_dir: Path, folder: Path, command: str) -> Path:
    """Draw the tabs of a run's recording into a folder, with a page that shows them; returns the page.

    Args:
        run_dir: a finished run.
        folder: where to publish; made where it is missing.
        command: what makes it, for the page.

    Raises:
        RescoreError: not a run folder, or the viewer could not draw.
    """
    story = Story.of(load_run(run_dir))
    flips = count_flips(story)
    frames = Frames.FLIPS if flips else Frames.ALL
    with tempfile.TemporaryDirectory() as scratch:
        # the pictures show the first frames alone, and the curves are those of all frames
        recording = write_recording(run_dir, Path(scratch) / "some.rrd", frames, MAX_FRAMES, show=False)
        draw_tabs(recording, folder)
    first = story.run.detectors[0]
    text = render(
        "reports.publishing",
        "recording_page.md.j2",
        command=command,
        name=story.run.root.name,
        metrics=story.run.metrics,
        detector=detector_name(first, short=True),
        mode=mode_name(story.mode_of(first)),
        point=story.points[first].text,
        flips=flips,
    )
    return write_page(folder, text)


def draw_tabs(recording: Path, folder: Path) -> None:
    """Draw the viewer's window with each tab of the first detector into JPEG files.

    Raises:
        RescoreError: the viewer could not draw, or a view reports a fault.
    """
    viewer, client = start_viewer(recording.resolve(), headless=True)
    try:
        store = client.get_state().active_recording
        container, tabs = _tabs(client.get_blueprint().blueprint)
        for name, tab in zip(TABS, tabs, strict=False):
            layout = client.get_blueprint().blueprint
            layout[container]["ContainerBlueprint"]["active_tab"] = tab
            client.set_blueprint(layout, store_id=store)
            for _ in range(_SETTLING_SHOTS):
                client.take_screenshot(max_size=64)
                time.sleep(0.25)
            faults = [f"{v.name}: {r.summary}" for v in client.get_state().views for r in v.reports]
            if faults:
                raise RescoreError(f"viewer: expected views without a fault, got {faults[0]}")
            _write_jpeg(client.take_screenshot(), folder / f"{name.replace(' ', '_')}.jpg")
    except ConnectionError as error:
        raise RescoreError(
            f"viewer: expected an answer, got {str(error).splitlines()[0]!r}; it draws with Vulkan: "
            "`apt-get install mesa-vulkan-drivers`"
        ) from error
    finally:
        viewer.terminate()
        viewer.wait(10)


def draw_moment(recording: Path, timeline: str, seconds: float, path: Path) -> None:
    """Draw the viewer's window at a moment of a recording into a JPEG file.

    Raises:
        RescoreError: the viewer could not draw.
    """
    viewer, client = start_viewer(recording.resolve(), headless=True, timeline=timeline)
    try:
        client.set_time(timeline, duration=seconds, play_state="paused")
        for _ in range(_SETTLING_SHOTS):
            client.take_screenshot(max_size=64)
            time.sleep(0.25)
        _write_jpeg(client.take_screenshot(), path)
    finally:
        viewer.terminate()
        viewer.wait(10)


def _tabs(layout: dict[str, Any]) -> tuple[str, list[str]]:
    """The container of the tabs in a blueprint, and its tabs in order."""
    for path, entry in layout.items():
        container = entry.get("ContainerBlueprint", {})
        if container.get("container_kind") == "Tabs" and isinstance(container["contents"], list):
            return path, container["contents"]
    raise RescoreError("recording: expected a blueprint with tabs, found none; write it with `rescore log`")


def _write_jpeg(png: bytes, path: Path) -> None:
    window = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    if window is None:
        raise RescoreError("viewer: expected a picture, got no PNG; try again")
    # without the menu, which speaks of the machine
    window = window[_MENU_PX:]
    with atomic_path(path) as beside:
        cv2.imwrite(str(beside), window, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])


if __name__ == "__main__":
    print(publish_recording(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3]))
