"""Pictures of a recording in the viewer: ``python -m reports.recording_pictures RUN FOLDER COMMAND``.

One picture a tab, and a page that says how to read them. The viewer draws without a screen; it needs a Vulkan
driver, which Debian has as ``mesa-vulkan-drivers``.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import rerun_cli  # type: ignore[import-untyped]

from recon.errors import RescoreError
from reports.palette import detector_name, mode_name
from reports.rerun_blueprint import TABS
from reports.rerun_log import write_recording
from reports.rerun_story import Frames, Story, count_flips
from reports.run_folder import load_run
from reports.templating import render
from rescore.store import atomic_path

WINDOW_PX = (1600, 900)
MAX_FRAMES = 12
_QUALITY = 88
_TIMEOUT_S = 180


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
        for i, name in enumerate(TABS):
            # the pictures show the first frames alone, and the curves are those of all frames
            recording = write_recording(
                run_dir, Path(scratch) / "tab.rrd", frames, MAX_FRAMES, show=False, tab=i
            )
            draw_window(recording, folder / f"{name.replace(' ', '_')}.jpg")
    first = story.run.detectors[0]
    page = folder / "README.md"
    page.write_text(
        render(
            "recording_page.md.j2",
            command=command,
            metrics=story.run.metrics,
            detector=detector_name(first, short=True),
            mode=mode_name(story.mode_of(first)),
            point=story.points[first].text,
            flips=flips,
        ),
        encoding="utf-8",
    )
    return page


def draw_window(recording: Path, picture: Path) -> None:
    """Draw the viewer's window with a recording, as it opens, into a JPEG file.

    Raises:
        RescoreError: the viewer failed.
    """
    viewer = Path(rerun_cli.__file__).parent / "rerun"
    with tempfile.TemporaryDirectory() as scratch, recording.open("rb") as data:
        shot = Path(scratch) / "window.png"
        size = "x".join(str(v) for v in WINDOW_PX)
        options = ["--headless", "--bind", "127.0.0.1", "--port", "auto", "--window-size", size]
        try:
            # a recording from standard input is read whole before the picture is taken
            done = subprocess.run(
                [viewer, "-", *options, "--screenshot-to", shot],
                stdin=data,
                env={**os.environ, "CI": "true", "RUST_LOG": "off"},
                timeout=_TIMEOUT_S,
                capture_output=True,
                check=False,
            )
        except subprocess.TimeoutExpired as error:
            raise RescoreError(
                f"viewer: expected a picture within {_TIMEOUT_S} s, got none; try again on an idle machine"
            ) from error
        window = cv2.imread(str(shot)) if shot.is_file() else None
        if window is None:
            raise RescoreError(
                f"viewer: expected a picture, got exit code {done.returncode}; it draws with Vulkan: "
                "`apt-get install mesa-vulkan-drivers`"
            )
        with atomic_path(picture) as beside:
            cv2.imwrite(
                str(beside),
                cv2.resize(window, WINDOW_PX, interpolation=cv2.INTER_AREA),
                [cv2.IMWRITE_JPEG_QUALITY, _QUALITY],
            )


if __name__ == "__main__":
    print(publish_recording(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3]))
