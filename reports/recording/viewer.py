"""Opening a recording in the Rerun viewer at one image."""

import os
import socket
import subprocess
import sys
import time
import warnings
from pathlib import Path

import rerun_cli
from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning
from rerun.experimental import ViewerClient

from recon.errors import RescoreError
from reports.palette import detector_name

TIMELINE = "image_id"
_STARTS_WITHIN_S = 30.0


def open_recording(
    recording: Path, image_id: int, detector: str, headless: bool = False
) -> subprocess.Popen[bytes]:
    """The viewer's process, which goes on after this one, with the recording at an image.

    Args:
        recording: what ``rescore log`` wrote.
        image_id: the image to show.
        detector: whose tab is shown, if the recording has one.
        headless: without a window.

    Raises:
        RescoreError: no recording, one without the image, no display, or the viewer does not start.
    """
    _check_recording(recording, image_id)
    if not headless and sys.platform.startswith("linux"):
        _check_display(recording)
    viewer, client = start_viewer(recording, headless)
    try:
        client.set_time(TIMELINE, sequence=image_id, play_state="paused")
        _show_tab(client, detector_name(detector, short=True))
    except BaseException:
        viewer.terminate()
        raise
    return viewer


def start_viewer(
    recording: Path, headless: bool, timeline: str = TIMELINE
) -> tuple[subprocess.Popen[bytes], ViewerClient]:
    """The viewer's process with a recording, and its client, once it shows one of its timelines.

    ``headless`` is without a window.

    Raises:
        RescoreError: the viewer does not start.
    """
    port = _free_port()
    binary = Path(rerun_cli.__file__).with_name("rerun")
    # the viewer listens on all interfaces, unless told otherwise
    command = [str(binary), "--bind", "127.0.0.1", "--port", str(port)]
    size = ["--headless", "--window-size", "1600x900"] if headless else []
    viewer = subprocess.Popen(
        [*command, *size, str(recording)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        # the viewer sends no usage statistics where it believes to be on a build machine
        env=os.environ | {"CI": "true"},
        start_new_session=True,
    )
    try:
        return viewer, _connected(viewer, port, timeline)
    except BaseException:
        viewer.terminate()
        raise


def images_of(recording: Path) -> set[int]:
    """Ids of the images that a recording shows.

    Raises:
        RescoreError: no recording.
    """
    if not recording.is_file():
        raise RescoreError(f"{recording}: expected a recording, found none; run `rescore log` first")
    found: set[int] = set()
    try:
        with warnings.catch_warnings():
            # a file that was cut short is a warning there
            warnings.simplefilter("error", RerunWarning)
            for chunk in RrdReader(str(recording)).stream().filter(has_timeline=TIMELINE):
                found.update(chunk.to_record_batch()[TIMELINE].to_pylist())
    except (ValueError, OSError, RuntimeError, RerunWarning) as error:
        raise RescoreError(
            f"{recording}: expected a recording, got {error}; run `rescore log` again"
        ) from error
    return found


def _check_recording(recording: Path, image_id: int) -> None:
    images = images_of(recording)
    if image_id not in images:
        raise RescoreError(
            f"{recording}: expected frame {image_id} among the {len(images)} recorded, found it not; "
            "`rescore log` without --frames records all"
        )


def _check_display(recording: Path) -> None:
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise RescoreError(
            "--open: expected a display, found neither DISPLAY nor WAYLAND_DISPLAY set; copy "
            f"{recording} to a machine with a screen and run `rerun` on it there"
        )


def _free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def _connected(viewer: subprocess.Popen[bytes], port: int, timeline: str) -> ViewerClient:
    """A client of the viewer once it shows the recording."""
    deadline = time.monotonic() + _STARTS_WITHIN_S
    while time.monotonic() < deadline:
        if viewer.poll() is not None:
            break
        try:
            client = ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
            if any(t.name == timeline for r in client.get_state().recordings for t in r.timelines):
                return client
        except ConnectionError:
            # not up yet
            pass
        time.sleep(0.2)
    ended = f"it ended with code {viewer.returncode}" if viewer.poll() is not None else "it shows nothing"
    raise RescoreError(
        f"--open: expected the Rerun viewer to show the recording within {_STARTS_WITHIN_S:.0f} s, {ended}; "
        "run `rerun` on the recording to see why"
    )


def _show_tab(client: ViewerClient, name: str) -> None:
    """Bring the frames of the detector with this name to the front, if there are any.

    The first detector's tab has no name.
    """
    blueprint = client.get_blueprint().blueprint
    for entry in blueprint.values():
        container = entry.get("ContainerBlueprint", {})
        if container.get("container_kind") != "Tabs":
            continue
        title_of = {
            blueprint.get(f"/{child}", {}).get("ContainerBlueprint", {}).get("display_name", ""): child
            for child in container["contents"]
        }
        found = [title_of[title] for title in (f"frame: {name}", "frame") if title in title_of]
        if found:
            container["active_tab"] = found[0]
            client.set_blueprint(blueprint, of="recording")
            return
