"""The profile by stages names functions that there are, and books what stages take where they take it."""

import time

from recon.stereo import sgbm
from tests import profile_stages
from tests.profile_stages import STAGES, Watch, found, watched


def test_the_functions_of_all_stages_are_there() -> None:
    names = [name for stage in STAGES.values() for name in stage]
    assert len(names) == len(set(names))
    for name in names:
        assert callable(getattr(*found(name))), name


def test_what_a_stage_calls_that_is_another_stage_counts_there_alone() -> None:
    watch = Watch()
    watch.enter("outer")
    busy(0.02)
    watch.enter("inner")
    busy(0.06)
    watch.leave()
    watch.leave()
    assert watch.spent["inner"].cpu_s >= 0.06
    assert watch.spent["outer"].cpu_s >= 0.02
    assert set(watch.spent) == {"outer", "inner"}


def busy(cpu_s: float) -> None:
    until = time.process_time() + cpu_s
    while time.process_time() < until:
        pass


def test_stages_are_themselves_again_afterwards() -> None:
    before, cues = sgbm.disparity_of_scene, profile_stages.cues.CUES
    with watched(Watch()):
        assert sgbm.disparity_of_scene is not before
        assert profile_stages.cues.CUES is not cues
    assert sgbm.disparity_of_scene is before
    assert profile_stages.cues.CUES is cues
