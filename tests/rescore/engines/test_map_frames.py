"""One interface over frames, by real engines on the loopback address: the same results, and nothing lost.

All that works on their clusters is in this file, since a cluster takes seconds to start.
"""

import json
import os
import signal
import socket
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from http.server import SimpleHTTPRequestHandler
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from socketserver import BaseRequestHandler, ThreadingTCPServer
from typing import Any

import cv2
import numpy as np
import pytest

from recon.errors import RescoreError
from rescore.engines import clusters
from rescore.engines.engine import TRIES
from rescore.engines.executor import Executor
from rescore.engines.map_frames import Failed, map_frames
from rescore.large import run as run_module
from tests.conftest import ROOT
from tests.faults.small_parts import DAMAGED, write_street
from tests.rescore.conftest import Run
from tests.rescore.engines import light_work


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
    # the engine is free again, and what was left is not done first: no more than what two workers had begun
    assert list(map_frames(light_work.doubled, range(3), 0, executor)) == [0, 2, 4]
    assert len(list(tmp_path.iterdir())) <= begun + 2 * 256


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


@pytest.mark.parametrize(
    ("address", "told"),
    [
        ("foo", r"^--address: expected HOST:PORT, got 'foo'; name host and port"),
        ("tcp://h:99999", "^--address: expected HOST:PORT"),
        ("127.0.0.1:{}", r"answers, got Connection refused for 0\.3 s; start it by `ray start --head`"),
    ],
)
def test_an_address_where_nothing_answers(address: str, told: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clusters, "CONNECT_S", 0.3)
    with socket.create_server(("127.0.0.1", 0)) as one:
        port = one.getsockname()[1]
        clusters.wait_for_answer(f"tcp://127.0.0.1:{port}", "HOST:PORT", "ray start --head", None)
    with pytest.raises(RescoreError, match=told):
        clusters.wait_for_answer(address.format(port), "HOST:PORT", "ray start --head", None)


class _Speaks(BaseRequestHandler):
    def handle(self) -> None:
        self.request.sendall(b"SSH-2.0-OpenSSH_9.9\r\n")


class _HangsUp(BaseRequestHandler):
    def handle(self) -> None:
        """Say nothing, and the connection ends."""


class _Silent(BaseRequestHandler):
    def handle(self) -> None:
        while self.request.recv(1024):
            pass


@pytest.mark.parametrize(
    ("engine", "wait"),
    [
        pytest.param("on_dask", "wait_for_scheduler", marks=missing("distributed", "dask")),
        pytest.param("on_ray", "wait_for_head", marks=missing("ray", "ray")),
    ],
)
@pytest.mark.parametrize(
    ("server", "told"),
    [
        (_Silent, r"that answers, got timed out for 0\.5 s; start it by `"),
        (SimpleHTTPRequestHandler, "that answers, got (timed out|a server of another kind)"),
        (_Speaks, "that answers, got a server of another kind; name the port of `"),
        (_HangsUp, r"that answers, got a closed connection for 0\.5 s; start it by `"),
    ],
)
def test_an_address_of_another_server(
    engine: str, wait: str, server: type[BaseRequestHandler], told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(clusters, "CONNECT_S", 0.5)
    wait_for = getattr(import_module(f"rescore.engines.{engine}"), wait)
    with ThreadingTCPServer(("127.0.0.1", 0), server) as one:
        threading.Thread(target=one.serve_forever, daemon=True).start()
        with pytest.raises(RescoreError, match=told):
            wait_for(f"127.0.0.1:{one.server_address[1]}")
        one.shutdown()


def test_the_head_that_ray_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    on_ray = pytest.importorskip("rescore.engines.on_ray", reason="no ray; pip install rescore[ray]")
    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    monkeypatch.setenv("RAY_TMPDIR", str(tmp_path))
    with pytest.raises(RescoreError, match="start a head by `ray start --head`"):
        on_ray.address_of("auto")
    (tmp_path / "ray").mkdir()
    (tmp_path / "ray" / "ray_current_cluster").write_text("192.0.2.1:6379\n")
    assert on_ray.address_of("auto") == "192.0.2.1:6379"
    monkeypatch.setenv("RAY_ADDRESS", "192.0.2.2:6379")
    assert on_ray.address_of("auto") == "192.0.2.2:6379"
    assert on_ray.address_of("host:1") == "host:1"


@dataclass(frozen=True)
class Streets:
    """What the commands work on, and what one process makes of it."""

    toy: Path
    """Small pictures with a detector, one of them damaged."""
    real: Path
    """Real pairs and a damaged one, with detections of all."""
    by_one: dict[str, bytes]


@pytest.fixture
def small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_module, "FRAMES_A_PART", 2)


def half_size(street: Path, out: Path) -> Path:
    """The real pairs and their detections at half their size, which takes a quarter of the time."""
    for picture in street.glob("*/*.jpg"):
        (out / picture.parent.name).mkdir(parents=True, exist_ok=True)
        half = cv2.resize(cv2.imread(str(picture)), None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        cv2.imwrite(str(out / picture.parent.name / f"{picture.stem}.png"), half)
    calibration = (street / "calib.yaml").read_text()
    for whole, of_half in {
        "1280": "640",
        "720": "360",
        "700.": "350.",
        "639.5": "319.5",
        "359.5": "179.5",
        "-84.": "-42.",
    }.items():
        calibration = calibration.replace(f" {whole}", f" {of_half}")
    (out / "calib.yaml").write_text(calibration)
    rows = json.loads((street / "detections.json").read_text())
    found = [row | {"bbox": [v / 2 for v in row["bbox"]]} for row in rows]
    (out / "detections.json").write_text(json.dumps(found))
    return out


@pytest.fixture(scope="module")
def streets(tmp_path_factory: pytest.TempPathFactory) -> Streets:
    root = tmp_path_factory.mktemp("streets")
    toy, _ = write_street(root / "toy", 7)
    real = half_size(ROOT / "examples" / "real_street", root / "real")
    for side in ("left", "right"):
        first = min((real / side).iterdir())
        (real / side / "damaged.png").write_bytes(first.read_bytes()[:-40])
    # the best one of each frame: what is compared is the way there and back, not the method
    best: dict[int, dict[str, Any]] = {}
    for one in json.loads((real / "detections.json").read_text()):
        best[one["image_id"]] = max(one, best.get(one["image_id"], one), key=lambda d: float(d["score"]))
    whole = list(best.values())
    (real / "detections.json").write_text(json.dumps(whole))
    (real / "and_damaged.json").write_text(json.dumps([*whole, whole[0] | {"image_id": len(whole) + 1}]))
    return Streets(toy, real, {})


def commands(run: Run, streets: Streets, out: Path, *who: object) -> dict[str, bytes]:
    """What `detect` into parts and `apply` into a file and into parts write, by name."""
    toy, real = streets.toy, streets.real
    given = {
        "found": ("detect", toy, "--detector", toy / "hog.npz", "--split", "train"),
        "rescored.json": ("apply", real, real / "detections.json", "--evidence", out / "of_file"),
        "rescored": ("apply", real, real / "and_damaged.json", "--evidence", out / "of_parts"),
    }
    for name, arguments in given.items():
        code, _, err = run(*arguments, "--out", out / name, *who)
        assert code == 0, err
        assert ("1 frame failed" in err) == (name != "rescored.json"), err
        assert name != "found" or "in 6 of 7 frames" in err
    files = (p for p in out.rglob("*") if p.is_file())
    return {p.relative_to(out).as_posix(): p.read_bytes() for p in files}


@pytest.mark.usefixtures("small_parts")
@engines_with_workers
def test_commands_write_the_same_bytes_and_a_row_for_a_damaged_picture(
    executor: Executor, run: Run, tmp_path: Path, streets: Streets
) -> None:
    if not streets.by_one:
        streets.by_one.update(commands(run, streets, tmp_path / "one", "--jobs", 1))
        assert sum(name.endswith(".parquet") for name in streets.by_one) == 4 + 2
        assert sum(name.endswith(".npz") for name in streets.by_one) == 4 + 3
    out = tmp_path / "other"
    found = commands(run, streets, out, "--engine", executor.engine, "--jobs", executor.jobs)
    assert found == streets.by_one
    for table, image, picture in (("found", DAMAGED, f"{DAMAGED:03d}.png"), ("rescored", 4, "damaged.png")):
        code, told, _ = run("inspect", out / table, "--failed")
        assert (code, told.split("\t")[0], told.count("\n")) == (0, str(image), 1)
        assert f"{picture}: expected a picture" in told


def test_a_damaged_picture_ends_a_run_into_one_file(run: Run, tmp_path: Path, streets: Streets) -> None:
    real = streets.real
    code, _, err = run("apply", real, real / "and_damaged.json", "--out", tmp_path / "a.json", "--jobs", 1)
    assert (code, err.count("rescore: ")) == (1, 1)
    assert "damaged.png: expected a picture" in err
