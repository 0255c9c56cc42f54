"""Damages good inputs at random, reads them, counts what is no single line: `python -m tests.faults.fuzz`."""

import argparse
import contextlib
import io
import multiprocessing as mp
import resource
import shutil
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from recon.errors import RescoreError
from tests.faults.inputs import KINDS, Kind
from tests.faults.mutate import damaged

HANG_S = 20.0
MEMORY_BYTES = 2**30
OK, REFUSED = "read", "refused"
"""Outcomes that are right: the damage does no harm, or is one line."""


@dataclass
class Tally:
    """What became of the cases of one kind of file."""

    outcomes: Counter[str] = field(default_factory=Counter)
    peak_bytes: int = 0
    longest_s: float = 0.0


def outcome(kind: Kind, root: Path) -> tuple[str, str]:
    """What reading gives: ``OK``, ``REFUSED``, or a fault with what was seen of it."""
    told = io.StringIO()
    try:
        with (
            contextlib.redirect_stdout(io.StringIO()),
            contextlib.redirect_stderr(told),
            warnings.catch_warnings(),
        ):
            warnings.simplefilter("ignore")
            kind.read(root)
    except SystemExit as ended:
        return _judged(ended.code, told.getvalue())
    except RescoreError as error:
        return (REFUSED, str(error)) if "\n" not in str(error) else ("several lines", str(error))
    except Exception:
        return "traceback", traceback.format_exc()
    return OK, ""


def _judged(code: object, text: str) -> tuple[str, str]:
    if code in (None, 0):
        return OK, ""
    lines = [line for line in text.splitlines() if line.startswith("rescore: ")]
    # the doctor lists what is wrong and ends with their number
    if code == 1 and (len(lines) == 1 or " warning" in text) and "expected enough memory" not in text:
        return REFUSED, text
    return "no line", f"exit {code!r}\n{text}"


def cases(n: int, seed: int) -> Iterator[tuple[int, Kind]]:
    """Numbers of cases and their kinds, evenly."""
    for i in range(n):
        yield seed * 10_000_000 + i, KINDS[i % len(KINDS)]


def run_case(number: int, kind: Kind, good: Path, work: Path) -> tuple[str, str]:
    """Damage one file of a copy of a good folder, read it, and say what became of it."""
    rng = np.random.default_rng(number)
    root = work / "case"
    shutil.rmtree(root, ignore_errors=True)
    shutil.copytree(good, root, copy_function=shutil.copyfile)
    files = [p for pattern in kind.files for p in sorted(root.glob(pattern))]
    path = files[int(rng.integers(len(files)))]
    how, data = damaged(path.read_bytes(), rng)
    path.write_bytes(data)
    found, text = outcome(kind, root)
    return found, f"{kind.name}: case {number}: {path.relative_to(root)}: {how}\n{text}"


def good_folders(kinds: tuple[Kind, ...], work: Path) -> dict[str, Path]:
    """A good folder of each kind; each is read without a fault."""
    made = {}
    for i, kind in enumerate(kinds):
        made[kind.name] = work / f"good_{i}"
        made[kind.name].mkdir(parents=True)
        kind.make(made[kind.name])
        copy = work / "case"
        shutil.rmtree(copy, ignore_errors=True)
        shutil.copytree(made[kind.name], copy)
        found, text = outcome(kind, copy)
        assert found == OK, f"{kind.name}: expected a good input to be read, got {found}: {text}"
    return made


def _work(pipe: Connection, n: int, seed: int, start: int) -> None:
    """Run cases from ``start`` on, in a process of its own, and send what becomes of each."""
    with tempfile.TemporaryDirectory() as place:
        work = Path(place)
        good = good_folders(KINDS, work)
        # what one case takes beyond what is loaded: an input must not ask for more
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + 3 * MEMORY_BYTES, resource.RLIM_INFINITY))
        for i, (number, kind) in enumerate(cases(n, seed)):
            if i >= start:
                pipe.send(("begin", i, kind.name, number))
                Path("/proc/self/clear_refs").write_text("5")  # the peak of memory begins anew
                began = time.monotonic()
                found, text = run_case(number, kind, good[kind.name], work)
                status = Path("/proc/self/status").read_text()
                peak = int(status.split("VmHWM:")[1].split()[0]) * 1024
                pipe.send((found, text, time.monotonic() - began, peak))
        pipe.send(None)


def fuzz(n: int, seed: int) -> tuple[dict[str, Tally], list[str]]:
    """Tallies by kind of file, and the text of every fault."""
    tallies = {kind.name: Tally() for kind in KINDS}
    faults: list[str] = []
    start = 0
    while start < n:
        here, there = mp.Pipe()
        worker = mp.get_context("spawn").Process(target=_work, args=(there, n, seed, start))
        worker.start()
        there.close()
        try:
            start = _watch(here, worker, tallies, faults, n)
        except KeyboardInterrupt:
            print("stopped: what was done until now", file=sys.stderr)
            start = n
        finally:
            worker.kill()
            worker.join()
    return tallies, faults


def _watch(
    pipe: Connection, worker: mp.process.BaseProcess, tallies: dict[str, Tally], faults: list[str], n: int
) -> int:
    """Take what a worker sends until it is through, hangs or dies; returns the next case to do.

    Raises:
        RuntimeError: it ended before its first case, as it would each time.
    """
    name, number, i, begun = "", 0, -1, False
    while True:
        wait_s = HANG_S if begun else 300.0
        sent: tuple[object, ...] | str | None = "the process died"
        if not pipe.poll(wait_s):
            sent = "hang" if worker.is_alive() else "the process died"
        else:
            with contextlib.suppress(EOFError):
                sent = pipe.recv()
        if isinstance(sent, str):
            if not name:
                raise RuntimeError(f"fuzz: expected good inputs to be read first, got: {sent}; see above")
            faults.append(f"{name}: case {number}: {sent}")
            tallies.setdefault(name, Tally()).outcomes["hang" if sent == "hang" else "death"] += 1
            return i + 1
        if sent is None:
            return n
        if sent[0] == "begin":
            _, i, name, number = sent
            begun = True
            continue
        begun = False
        found, text, took_s, peak = sent
        tally = tallies[name]
        tally.outcomes[found] += 1
        tally.peak_bytes, tally.longest_s = max(tally.peak_bytes, peak), max(tally.longest_s, took_s)
        if found not in (OK, REFUSED):
            faults.append(text)


def table(tallies: dict[str, Tally]) -> str:
    """The tallies as a Markdown table."""
    rows = ["| kind of file | cases | read | refused in one line | faults | longest, s | peak, MB |"]
    rows.append("|---|---:|---:|---:|---:|---:|---:|")
    total = Tally()
    for name, tally in tallies.items():
        rows.append(_row(name, tally))
        total.outcomes += tally.outcomes
        total.peak_bytes = max(total.peak_bytes, tally.peak_bytes)
        total.longest_s = max(total.longest_s, tally.longest_s)
    return "\n".join([*rows, _row("**all**", total)])


def _row(name: str, tally: Tally) -> str:
    n, good = tally.outcomes.total(), tally.outcomes[OK] + tally.outcomes[REFUSED]
    figures = (n, tally.outcomes[OK], tally.outcomes[REFUSED], n - good)
    peak = tally.peak_bytes / 2**20
    return f"| {name} | {' | '.join(map(str, figures))} | {tally.longest_s:.1f} | {peak:.0f} |"


def main() -> None:
    """Print the table and every fault; exit 1 where there is one, or memory goes past the limit."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=5250)
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    tallies, faults = fuzz(chosen.cases, chosen.seed)
    print(*(f"{fault}\n" for fault in faults), sep="\n")
    print(table(tallies))
    peak = max(t.peak_bytes for t in tallies.values())
    print(f"\n{len(faults)} faults, {peak / 2**20:.0f} MB at most")
    sys.exit(1 if faults or peak > MEMORY_BYTES else 0)


if __name__ == "__main__":
    main()
