"""The model of a cluster against sums that can be done by hand, and the page."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from reports.publishing.scaling import page
from reports.publishing.scaling.model import Cluster, Replayed, replay
from reports.publishing.scaling.page import publish_scaling
from reports.publishing.scaling.recorded import EngineCost, Recorded, read_recorded, write_recorded

NEVER = 1e-12
CALM = Cluster(
    workers=1,
    task_s=0.0,
    caller_task_s=0.0,
    caller_frame_s=0.0,
    latency_s=0.0,
    store_bytes_s=float("inf"),
    spread=0.0,
    slow_share=0.0,
    deaths_per_hour=NEVER,
)
FRAME_S = np.full(5, 0.1)


def run(cluster: Cluster, frames: int = 1000, read_bytes: float = 0.0) -> Replayed:
    return replay(FRAME_S, read_bytes, frames, cluster, seed=0)


@pytest.mark.parametrize("workers", [1, 4, 10])
def test_nothing_is_lost_where_nothing_is_in_the_way(workers: int) -> None:
    found = run(replace(CALM, workers=workers))
    assert found.makespan_s == pytest.approx(1000 * 0.1 / workers)
    assert found.efficiency == pytest.approx(1)


def test_one_process_that_gives_tasks_out_is_a_limit() -> None:
    # 20 ms each: 50 frames a second, where ten workers could do 100
    found = run(replace(CALM, workers=10, caller_task_s=0.02))
    assert found.makespan_s == pytest.approx(1000 * 0.02, rel=0.01)
    assert found.caller_busy == pytest.approx(1, abs=0.01)


def test_a_scheduler_between_is_a_limit_of_its_own() -> None:
    # 10 ms here and 20 ms there go on side by side: the slower one decides
    found = run(replace(CALM, workers=10, caller_task_s=0.01, scheduler_task_s=0.02))
    assert found.makespan_s == pytest.approx(1000 * 0.02, rel=0.01)
    assert found.scheduler_busy == pytest.approx(1, abs=0.01)
    assert found.caller_busy == pytest.approx(0.5, abs=0.01)


def test_tasks_of_more_frames_move_that_limit() -> None:
    # ten frames a task: 20 ms a second of work, which ten workers do not feel
    found = run(replace(CALM, workers=10, caller_task_s=0.02, task_s=1.0))
    assert found.efficiency > 0.95


def test_a_store_that_gives_so_many_bytes_is_a_limit() -> None:
    # 1 MB a frame of 10 MB a second: ten frames a second
    found = run(replace(CALM, workers=4, store_bytes_s=1e7), frames=200, read_bytes=1e6)
    assert found.makespan_s == pytest.approx(20, rel=0.02)
    assert found.store_busy == pytest.approx(1, abs=0.02)


def test_slow_tasks_cost_their_time() -> None:
    # one in ten takes three times as long: 1.2 times the work
    found = run(replace(CALM, slow_share=0.1, slow_times=3.0), frames=20_000)
    assert found.efficiency == pytest.approx(1 / 1.2, rel=0.02)


def test_workers_that_die_cost_their_task_and_the_time_to_come_back() -> None:
    # 360 an hour: one in ten seconds of work; then it is away for 10 s
    cluster = replace(CALM, workers=4, deaths_per_hour=360.0, renewal_s=10.0, noticed_s=1.0)
    found = run(cluster, frames=8000)
    assert found.deaths > 40
    assert found.efficiency == pytest.approx(0.5, abs=0.07)


def test_a_worker_that_is_alone_and_dies_ends_its_run_too() -> None:
    found = run(replace(CALM, deaths_per_hour=720.0, renewal_s=1.0, noticed_s=0.5), frames=300)
    assert found.deaths > 0
    assert found.makespan_s > 30


def test_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page, "FRAMES", 20_000)
    monkeypatch.setattr(page, "MOST_OF_A_WORKER", 500)
    costs = tuple(EngineCost(name, 0.002, 0.0001, 0.0005, 0.93) for name in ("dask", "ray"))
    recorded = Recorded("a command", (0.1, 0.2), 8e5, 5e3, costs, 0.0003)
    write_recorded(tmp_path / "recorded.json", recorded)
    assert read_recorded(tmp_path / "recorded.json") == recorded
    text = publish_scaling(tmp_path / "recorded.json", tmp_path / "out", "make it").read_text()
    assert "in parts, with their reading, 0.30 ms a frame" in text
    assert "Dask 2.00 ms a task and 0.10 ms a frame in it" in text
    assert (tmp_path / "out" / "scaling.png").stat().st_size > 10_000
    assert (tmp_path / "out" / "recorded.json").read_bytes() == (tmp_path / "recorded.json").read_bytes()
