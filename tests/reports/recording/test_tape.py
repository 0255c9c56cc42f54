import pickle
from pathlib import Path

import numpy as np
import pytest
import rerun as rr

from reports.recording.log import write_recording
from reports.recording.tape import Tape
from tests.reports.recording_reader import read


def test_a_pickled_tape_keeps_order_types_and_what_may_be_missing():
    tape = Tape()
    shapes = [rr.Points2D(np.arange(2 * n).reshape(-1, 2), radii=rr.Radius.ui_points(2)) for n in (3, 0, 5)]
    for i, shape in enumerate(shapes):
        tape.set_time("step", sequence=i)
        tape.log("points", shape, rr.AnyValues(score=np.full(i + 1, 0.5)))
        tape.log("gone", rr.Clear(recursive=False))
    before, after = tape._entries, pickle.loads(pickle.dumps(tape))._entries
    assert [e for e in after if not hasattr(e, "path")] == [e for e in before if not hasattr(e, "path")]
    assert [getattr(e, "path", "") for e in after] == ["", "points", "gone"] * 3
    for old, new in zip(before, after, strict=True):
        if hasattr(old, "path"):
            assert new.descriptors == old.descriptors
            assert [a.type for a in new.arrays] == [a.type for a in old.arrays]
            assert all(a.equals(b) for a, b in zip(new.arrays, old.arrays, strict=True))


@pytest.mark.parametrize("entity", ["/world/stereo_points", "/world/camera/image/left"])
def test_two_processes_record_what_one_does(
    run_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, entity: str
):
    monkeypatch.setattr("reports.recording.log._FRAMES_WORTH_A_PROCESS", 1)
    one, two = (
        write_recording(run_dir, tmp_path / f"{n}.rrd", max_frames=3, show=False, jobs=n) for n in (1, 2)
    )
    expected = read(one, entity)
    assert expected
    assert read(two, entity) == expected
