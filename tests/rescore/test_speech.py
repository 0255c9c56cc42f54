"""What is told while work goes on, by a clock of the test's own."""

import sys
from collections.abc import Iterator
from dataclasses import dataclass

import pytest

from rescore import speech
from rescore.parallel import track

SLOW_LINES = ["slow: 1 of 3, 0.005 a second, 7 min left", "slow: 2 of 3, 0.005 a second, 3 min left"]
"""Three items that take 200 s each."""


@dataclass
class Clock:
    now: float = 1000.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Iterator[Clock]:
    """Time stands still unless the test moves it; what is silenced is loud again afterwards."""
    clock = Clock()
    monkeypatch.setattr(speech, "now_s", clock)
    yield clock
    speech.silence(False)


def slow(clock: Clock, count: int, seconds: float) -> Iterator[int]:
    """Items that take their time to come."""
    for i in range(count):
        clock.now += seconds
        yield i


def test_a_line_a_minute_where_there_is_no_terminal(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    assert list(track(slow(clock, 20, 10), "depth evidence hog", 25, done=5)) == list(range(20))
    # 10 s an item: lines at 60, 120 and 180 s, with what was done before counted
    assert capsys.readouterr().err.splitlines() == [
        # 14 items left at 0.1 a second
        "depth evidence hog: 11 of 25, 0.1 a second, 2 min left",
        "depth evidence hog: 17 of 25, 0.1 a second, 1 min left",
        "depth evidence hog: 23 of 25, 0.1 a second, 0 min left",
    ]


def test_quick_work_says_nothing_and_slow_items_a_line_each(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    assert list(track(slow(clock, 6, 9.9), "quick", 6)) == list(range(6))
    assert capsys.readouterr().err == ""
    assert list(track(slow(clock, 3, 200), "slow", 3)) == [0, 1, 2]
    assert capsys.readouterr().err.splitlines() == SLOW_LINES


def test_quiet_silences_notes_and_progress(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    speech.silence(True)
    assert list(track(slow(clock, 3, 200), "slow", 3)) == [0, 1, 2]
    speech.say("note")
    with speech.doing("something long"), speech.heartbeat(0.001):
        clock.now += 1000
        speech.say_what_is_done()
    assert capsys.readouterr().err == ""
    speech.silence(False)
    speech.say("note")
    assert capsys.readouterr().err == "note\n"


def test_hidden_progress_is_silent(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    assert list(track(slow(clock, 3, 200), "slow", 3, show=False)) == [0, 1, 2]
    assert capsys.readouterr().err == ""


def test_a_terminal_gets_a_bar_and_no_lines(
    clock: Clock, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    assert list(track(slow(clock, 3, 200), "slow", 3)) == [0, 1, 2]
    shown = capsys.readouterr().err
    assert "3/3" in shown
    assert "of 3" not in shown


def test_a_terminal_that_draws_no_bar_gets_lines(
    clock: Clock, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "dumb")
    assert list(track(slow(clock, 3, 200), "slow", 3)) == [0, 1, 2]
    assert capsys.readouterr().err.splitlines() == SLOW_LINES


def test_long_work_without_items_says_that_it_goes_on(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    speech.say("begin")
    with speech.doing("reproduce"):
        clock.now += 30
        with speech.doing("train_boosted"):
            for _ in range(10):
                clock.now += 20
                speech.say_what_is_done()
        speech.say_what_is_done()
    # silent for 90 s after "begin", then for 80 s: the innermost work is named
    assert capsys.readouterr().err.splitlines() == [
        "begin",
        "train_boosted: 1 min so far",
        "train_boosted: 2 min so far",
    ]


def test_the_heartbeat_speaks_by_itself_and_ends(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(speech, "SILENT_S", 0.0)
    begun = speech.threading.active_count()
    with speech.heartbeat(0.001), speech.doing("waiting"):
        shown, tries = "", 0
        while "\n" not in shown and tries < 1000:
            speech.time.sleep(0.005)
            shown, tries = shown + capsys.readouterr().err, tries + 1
    assert shown.startswith("waiting: 0 min so far\n")
    assert speech.threading.active_count() == begun
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with speech.heartbeat(0.001):
        assert speech.threading.active_count() == begun
