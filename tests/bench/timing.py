"""Times of one call and of pairs of calls, on one core."""

import statistics
import time
from collections.abc import Callable, Iterable

from reports.publishing.bench_file import Row
from rescore.parallel import one_thread

REPEATS = 5
Call = Callable[[], object]


def processor_s(work: Call) -> float:
    """Processor time of one call of all threads of this process."""
    start = time.process_time()
    work()
    return time.process_time() - start


def median_s(work: Call, repeats: int = REPEATS) -> float:
    """The median processor time of a call after one warm-up, one thread."""
    with one_thread():
        work()
        return statistics.median(processor_s(work) for _ in range(repeats))


def paired(what: str, wanted: float, pairs: Iterable[tuple[Call, Call]], repeats: int = REPEATS) -> Row:
    """Medians of both sides, run in turn on each pair after one warm-up, and the median of the ratios."""
    ours: list[float] = []
    bare: list[float] = []
    with one_thread():
        for our_call, bare_call in pairs:
            our_call()
            bare_call()
            for _ in range(repeats):
                ours.append(processor_s(our_call))
                bare.append(processor_s(bare_call))
    ratio = statistics.median(a / b for a, b in zip(ours, bare, strict=True))
    ours_ms, bare_ms = 1e3 * statistics.median(ours), 1e3 * statistics.median(bare)
    return Row(what, ratio, "ratio", wanted, ours_ms=ours_ms, bare_ms=bare_ms)
