"""A picture of the recording of a grasp: ``python -m reports.publishing.grasp_recording RECORDING FILE``."""

import sys
from pathlib import Path

from reports.publishing.recording_pictures import draw_moment
from reports.recording.grasp import TIME

_SECONDS = 6.0
"""When the car hangs in the hand."""

if __name__ == "__main__":
    draw_moment(Path(sys.argv[1]), TIME, _SECONDS, Path(sys.argv[2]))
