"""One interface over frames, by real engines on the loopback address: the same results, and nothing lost."""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from recon.errors import RescoreError
from rescore.engines.engine import TRIES
from rescore.engines.executor import Executor
from rescore.engines.map_frames import Failed, map_frames
from tests.conftest import ROOT
from tests.faults.faults_of_engines import caller_killed
from tests.rescore.engines import light_work

# clusters take seconds to start, so one process has them
pytestmark = pytest.mark.xdist_group("engines")


def missing(module: str, extra: str) -> pytest.MarkDecorator:
    return pytest.mark.skipif(find_spec(module) is None, reason=f"no {extra}; pip install rescore[{extra}]")


JOBLIB_1 = pytest.param(Executor.of("joblib", 1, None), id="joblib-1")
JOBLIB = pytest.param(Executor.of("joblib", 2, None), id="joblib-2")
DASK = pytest.param(Executor.of("dask", 2, None), id="dask", marks=missing("distributed", "dask"))
RAY = pytest.param(Executor.of("ray", 2, None), id="ray", marks=missing("ray", "ray"))
every_engine = pytest.mark.parametrize("executor", [JOBLIB_1, JOBLIB, DASK, RAY])
engines_with_workers = pytest.mark.parametrize("executor", [JOBLIB, DASK, RAY])


@every_engine
def test_results_come_in_the_order_of_the_records(executor: Executor) -> None:
    assert list(map_frames(light_work.doubled, range(200), 7, executor)) == [2 * n + 7 for n in range(200)]


@every_engine
def test_or_as_they_are_done(executor: Executor) -> None:
    found = list(map_frames(light_work.doubled, range(200), 7, executor, ordered=False))
    assert sorted(found) == [2 * n + 7 for n in range(200)]


@every_engine
def test_no_records_no_results(executor: Executor) -> None:
    assert list(map_frames(light_work.doubled, (), 7, executor)) == []


@every_engine
def test_the_same_bytes_and_arrays_that_may_be_written_to(executor: Executor) -> None:
    # larger than what joblib, Dask and Ray hand over without a copy, which is read-only
    weights = np.linspace(0, 1, 20_000)
    want = [light_work.drawn(n, weights.copy()) for n in range(6)]
    found = list(map_frames(light_work.drawn, range(6), weights.copy(), executor))
    assert [f.tobytes() for f in found] == [w.tobytes() for w in want]
    found[0][0] = 0.0


@every_engine
def test_a_function_of_a_script_and_a_partial_one(executor: Executor) -> None:
    factor = 3
    assert list(map_frames(lambda n, s: n * s * factor, range(4), 2, executor)) == [0, 6, 12, 18]
    assert list(map_frames(partial(max, 2), range(4), 1, executor)) == [2, 2, 2, 3]


@every_engine
def test_an_error_is_raised_at_its_turn(executor: Executor) -> None:
    found = map_frames(light_work.raises, range(40), "damaged", executor)
    assert [next(found) for _ in range(4)] == [0, 1, 2, 3]
    with pytest.raises(ValueError, match="damaged\nof record 4"):
        next(found)


@every_engine
def test_or_is_a_result_with_its_reason_in_one_line(executor: Executor) -> None:
    found: list[Any] = list(map_frames(light_work.raises, range(6), "damaged", executor, failed=lambda f: f))
    assert [f for f in found if not isinstance(f, Failed)] == [0, 1, 2, 3, 5]
    lost = found[4]
    assert (lost.record, lost.reason, lost.killed) == (4, "ValueError: damaged of record 4", False)


@engines_with_workers
def test_workers_that_die_are_replaced_and_nothing_is_lost(executor: Executor, tmp_path: Path) -> None:
    assert list(map_frames(light_work.kills_once, range(40), tmp_path, executor)) == list(range(40))
    assert {p.name for p in tmp_path.iterdir()} == {"3", "17", "31"}


@engines_with_workers
def test_a_record_that_ends_every_worker_is_set_aside_after_three(executor: Executor, tmp_path: Path) -> None:
    found: list[Any] = list(
        map_frames(light_work.kills_always, range(12), tmp_path, executor, failed=lambda f: f)
    )
    assert [f for f in found if not isinstance(f, Failed)] == [n for n in range(12) if n != 5]
    assert (found[5].record, found[5].reason, found[5].killed) == (5, "ended its worker 3 times", True)
    assert len(list(tmp_path.iterdir())) == TRIES


def test_and_named_where_no_one_takes_failures(tmp_path: Path) -> None:
    with pytest.raises(RescoreError, match="record 5: expected a result, got none: it ended its worker 3"):
        list(map_frames(light_work.kills_always, range(12), tmp_path, 2))


@every_engine
def test_few_records_are_taken_ahead_of_the_one_that_is_wanted(executor: Executor) -> None:
    taken = 0

    def records() -> Iterator[int]:
        nonlocal taken
        while True:
            taken += 1
            yield taken

    found = map_frames(light_work.doubled, records(), 0, executor)
    ahead = []
    for yielded in range(1, 1501):
        next(found)
        ahead.append(taken - yielded)
    found.close()
    # what is out and what is done: five times two tasks a worker of at most 256 records, for ever
    assert max(ahead[:750]) <= 5 * 2 * 2 * 256
    assert max(ahead[750:]) <= 5 * 2 * 2 * 256


@every_engine
def test_leaving_cancels_what_waits(executor: Executor, tmp_path: Path) -> None:
    found = map_frames(light_work.marks, range(10_000), tmp_path, executor)
    assert next(found) == 0
    found.close()
    begun = len(list(tmp_path.iterdir()))
    assert begun < 2_000
    # the engine is free again, and what was left is not done first
    assert list(map_frames(light_work.doubled, range(3), 0, executor)) == [0, 2, 4]
    assert len(list(tmp_path.iterdir())) <= begun + 256


@engines_with_workers
def test_workers_are_other_processes_and_are_kept(executor: Executor) -> None:
    first = set(map_frames(light_work.pid_of, range(30), None, executor))
    assert os.getpid() not in first
    assert set(map_frames(light_work.pid_of, range(30), None, executor)) & first


def test_an_idle_process_that_was_killed_is_replaced() -> None:
    for pid in set(map_frames(light_work.pid_of, range(30), None, 2)):
        os.kill(pid, signal.SIGKILL)
    assert list(map_frames(light_work.doubled, range(30), 0, 2)) == [2 * n for n in range(30)]


def test_what_cannot_be_sent_is_an_error_of_its_record() -> None:
    found: list[Any] = list(
        map_frames(lambda _n, _s: threading.Lock(), range(2), None, 2, failed=lambda f: f)
    )
    assert all("cannot be sent" in f.reason for f in found)


@pytest.mark.parametrize("executor", [JOBLIB, DASK])
def test_a_caller_that_is_killed_leaves_nothing_and_its_run_goes_on(executor: Executor) -> None:
    found = caller_killed(executor.engine, 30, seed=1)
    assert 3 <= found.before < 30
    assert found.processes >= 2
    assert found.after == 30
    # what the two workers were at when it was killed
    assert found.begun_twice <= 2


@pytest.mark.parametrize(
    ("engine", "address", "told"),
    [
        ("spark", None, "--engine: expected joblib, dask, ray, got 'spark'"),
        ("joblib", "tcp://127.0.0.1:1", "--address: expected --engine dask or ray"),
    ],
)
def test_unknown_engines_are_refused(engine: str, address: str | None, told: str) -> None:
    with pytest.raises(RescoreError, match=told):
        Executor.of(engine, 2, address)


@pytest.mark.parametrize(("engine", "module"), [("dask", "distributed"), ("ray", "ray")])
def test_a_missing_extra_is_told_in_one_line(
    engine: str, module: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rescore.engines.clusters.find_spec", lambda name: None if name == module else 1)
    with pytest.raises(RescoreError, match=rf'pip install "rescore\[{engine}\]"$'):
        list(map_frames(light_work.doubled, range(3), 0, Executor.of(engine, 2, None)))


def test_nothing_of_the_extras_is_imported_without_them() -> None:
    script = (
        "import sys; from rescore.engines.map_frames import map_frames\n"
        "assert list(map_frames(lambda n, s: n, range(2), None, 1)) == [0, 1]\n"
        "assert not {'distributed', 'dask', 'ray'} & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", script], check=True, cwd=ROOT)
