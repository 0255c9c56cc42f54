"""What was measured with two workers: times of frames, and what an engine spends on a task; as one file."""

from dataclasses import asdict, dataclass
from pathlib import Path

from pydantic import TypeAdapter

from recon.reading import json_of, reading
from rescore.files import write_json


@dataclass(frozen=True)
class EngineCost:
    """What one engine spends, processor seconds."""

    engine: str
    caller_task_s: float
    """In the process that gives tasks out, a task."""
    caller_frame_s: float
    """What a frame in a task adds to it."""
    scheduler_task_s: float
    """In the scheduler, a process of its own, a task; 0 where the engine has none that all tasks pass."""
    efficiency: float
    """Time in frames of 100 ms over the time of all processes, two workers."""


@dataclass(frozen=True)
class Recorded:
    """The content of recorded.json."""

    command: str
    frame_s: tuple[float, ...]
    """Processor seconds of each frame of the trace."""
    read_bytes: float
    """Bytes of pictures that a frame reads, the mean."""
    sent_bytes: float
    """Bytes of its record and its result, the mean."""
    engines: tuple[EngineCost, ...]
    parts_frame_s: float
    """Processor seconds a frame, in the process that gives parts out: it reads the frame's record and its
    candidates, and sends them; the worker writes the part."""


def write_recorded(file: Path, recorded: Recorded) -> None:
    """Write recorded.json."""
    write_json(file, asdict(recorded))


def read_recorded(file: Path) -> Recorded:
    """The content of recorded.json.

    Raises:
        RescoreError: no such file or another content.
    """
    value = json_of(file, "what two workers recorded", "record it again")
    with reading(file, "what two workers recorded", "record it again"):
        return TypeAdapter(Recorded).validate_python(value)
