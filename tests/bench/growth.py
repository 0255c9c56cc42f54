"""How time grows: with candidates, picture size and views. Frames are with the memory of `rescore apply`."""

from functools import partial

from reports.publishing.bench_file import Growth
from tests.bench.rows_evidence import N, evidence
from tests.bench.scenes import across_pairs, kitti_pairs
from tests.bench.timing import median_s

CANDIDATES = (1, 2, 5, 15, 50, 100, 200)
SIZES = ((320, 240), (640, 480), (1024, 768), (1600, 1200), (2048, 1536))
REPEATS = 3
_WINDOWS = "the windows of boxes keep one size; what is done for the whole picture grows"


def growing() -> list[Growth]:
    """Time of the evidence of a frame, and of SGBM, over what can grow."""
    return [*over_candidates(), *over_picture_size(), over_views()]


def over_candidates() -> list[Growth]:
    """1 to 200 candidates of a frame of KITTI's size, view known and view chosen among 12."""
    (pair,) = kitti_pairs(2)[:1]
    frame = pair.frame()
    known = [
        median_s(partial(evidence, frame, pair.candidates(n, view_known=True)), REPEATS) for n in CANDIDATES
    ]
    few = tuple(n for n in CANDIDATES if n <= 50)
    chosen = [
        median_s(partial(evidence, frame, pair.candidates(n, view_known=False), "model"), 1) for n in few
    ]
    sizes = tuple(map(float, CANDIDATES))
    return [
        Growth("evidence, view known", "candidates", sizes, tuple(known)),
        Growth("evidence, view chosen among 12", "candidates", sizes[: len(few)], tuple(chosen)),
    ]


def over_views() -> Growth:
    """One view, known, and the choice among all 12, of 15 candidates of a frame of KITTI's size."""
    (pair,) = kitti_pairs(2)[:1]
    frame = pair.frame()
    calls = (
        partial(evidence, frame, pair.candidates(N, view_known=True)),
        partial(evidence, frame, pair.candidates(N, view_known=False), "model"),
    )
    seconds = tuple(median_s(call, REPEATS) for call in calls)
    return Growth("evidence of 15 candidates", "views", (1.0, 12.0), seconds)


def over_picture_size() -> list[Growth]:
    """The same scene in five sizes, 15 candidates, with its boxes as large as the picture makes them."""
    (largest,) = across_pairs(1, *SIZES[-1])
    ours, matcher = [], []
    for width, height in SIZES:
        pair = largest.resized(width, height)
        frame = pair.frame()
        ours.append(median_s(partial(evidence, frame, pair.candidates(N, view_known=True)), REPEATS))
        matcher.append(median_s(pair.disparity_px, REPEATS))
    pixels = tuple(width * height / 1e6 for width, height in SIZES)
    along = "megapixels"
    return [
        Growth("evidence of 15 candidates, view known", along, pixels, tuple(ours), _WINDOWS),
        Growth("SGBM", along, pixels, tuple(matcher)),
    ]
