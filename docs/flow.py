"""Draws docs/flow.svg: what flows from a frame to a posterior, and the folder that does each step.

Run ``python docs/flow.py``; a test sees that the committed picture is what this script draws.
"""

from dataclasses import dataclass
from html import escape
from pathlib import Path

PICTURE = Path(__file__).with_name("flow.svg")
WIDTH, HEIGHT = 1340, 796
FONT = "Inter, 'Helvetica Neue', Arial, 'Liberation Sans', 'DejaVu Sans', sans-serif"
INK, SOFT, LINE = "#1d2733", "#5b6876", "#75828f"
GREY, GREEN, BLUE, ORANGE = "#6b7785", "#00795a", "#0072b2", "#b85a00"


@dataclass(frozen=True)
class Room:
    """A panel: one folder and what it is for."""

    x: int
    y: int
    width: int
    height: int
    path: str
    purpose: str
    colour: str


@dataclass(frozen=True)
class Step:
    """A box: one thing that flows, and the module that makes it."""

    x: int
    y: int
    width: int
    height: int
    name: str
    lines: tuple[str, ...]
    module: str
    colour: str

    @property
    def left(self) -> tuple[float, float]:
        """Middle of the left edge."""
        return self.x, self.y + self.height / 2

    @property
    def right(self) -> tuple[float, float]:
        """Middle of the right edge."""
        return self.x + self.width, self.y + self.height / 2

    @property
    def top(self) -> tuple[float, float]:
        """Middle of the upper edge."""
        return self.x + self.width / 2, self.y

    @property
    def bottom(self) -> tuple[float, float]:
        """Middle of the lower edge."""
        return self.x + self.width / 2, self.y + self.height


TOP = 122
ROOMS = (
    Room(20, TOP, 222, 560, "what comes in", "one type each", GREY),
    Room(292, TOP, 236, 412, "recon/reconstruction/", "section 4: one box to 3D", GREEN),
    Room(292, TOP + 428, 236, 132, "recon/stereo/", "what is measured", GREEN),
    Room(578, TOP, 250, 560, "rescore/evidence/", "eq. 6 and what goes past it", BLUE),
    Room(878, TOP, 190, 560, "rescore/fusion/", "eq. 7", BLUE),
    Room(1112, TOP, 208, 196, "rescore/metrics/", "arrays in, figures out", BLUE),
    Room(1112, TOP + 212, 208, 142, "rescore/results/", "a run, evaluated", BLUE),
    Room(1112, TOP + 370, 208, 190, "reports/", "what people look at", ORANGE),
)


def _step(room: int, down: int, height: int, name: str, module: str, *lines: str) -> Step:
    """A box in a room, ``down`` pixels below the top of all rooms."""
    r = ROOMS[room]
    return Step(r.x + 14, TOP + down, r.width - 28, height, name, lines, module, r.colour)


MODEL = _step(
    0,
    54,
    96,
    "ClassModel",
    "recon/class_model.py",
    "parts, planes, views by bin;",
    "learned in recon/learning/",
)
FRAME = _step(
    0, 240, 96, "Frame", "rescore/data/frames.py", "left picture, disparity,", "camera, ground plane"
)
BOXES = _step(
    0,
    426,
    112,
    "Candidates",
    "evidence/candidates.py",
    "15 boxes: score, likelihood l;",
    "from rescore/detectors/",
    "or your own detector",
)
OUTLINE = _step(1, 54, 74, "Outline", "segment.py", "4.1: level set from the box")
PARTS = _step(1, 152, 74, "Registered parts", "part_registration.py", "4.2: labelled view, deformed")
GROUND = _step(1, 250, 56, "Ground line", "ground_line.py")
DEPTH = _step(1, 330, 74, "Predicted depth Zi", "place_parts.py", "4.3: planes from the ground up")
STEREO = _step(2, 480, 72, "Measured depth Zs", "sgbm.py", "disparity by StereoSGBM or a file")
PAPER = _step(
    3, 54, 92, "paper: DepthAlignment", "align_depth.py", "eq. 6: Zs against a1 Zi + a2,", "a1 and a2 free"
)
GUARDED = _step(
    3, 170, 92, "guarded: relief", "guarded.py", "a1 bounded and positive, robust,", "against a flat surface"
)
METRIC = _step(
    3,
    286,
    110,
    "metric, instance: cues",
    "cues.py",
    "size, depth edges, ground, and",
    "a 3D instance fitted to the box",
    "and the disparity (rescore/cues/)",
)
DIFFERENCE = _step(
    3,
    448,
    92,
    "D in [0, 1]",
    "registration.py, model.py",
    "of eq. 6, or of the evidence",
    "model, one function a cue",
)
WEIGHT = _step(
    4, 54, 110, "Weight w", "tune.py", "chosen on validation", "frames alone, with", "its interval"
)
POSTERIOR = _step(4, 286, 110, "Posterior", "fuse.py", "exp(w log l", "+ (1 − w) log(1 − D))")
MATCHES = _step(5, 54, 54, "Match table", "matching.py")
CURVES = _step(5, 130, 54, "Curves, intervals", "curves.py, bootstrap.py")
FILES = _step(6, 268, 74, "Run folder", "run_folder.py", "metrics.json, candidates")
PAGE = _step(7, 424, 54, "report.html", "page/report.py")
RECORDING = _step(7, 492, 54, "recording.rrd", "recording/log.py")
STEPS = (
    *(MODEL, FRAME, BOXES, OUTLINE, PARTS, GROUND, DEPTH, STEREO, PAPER, GUARDED, METRIC, DIFFERENCE),
    *(WEIGHT, POSTERIOR, MATCHES, CURVES, FILES, PAGE, RECORDING),
)

Point = tuple[float, float]


def _text(
    x: float, y: float, words: str, size: int, colour: str, weight: int = 400, anchor: str = "start"
) -> str:
    return (
        f'<text x="{x:g}" y="{y:g}" font-size="{size}" fill="{colour}" font-weight="{weight}" '
        f'text-anchor="{anchor}">{escape(words)}</text>'
    )


def _room(room: Room) -> list[str]:
    return [
        f'<rect x="{room.x}" y="{room.y}" width="{room.width}" height="{room.height}" rx="10" '
        f'fill="{room.colour}" fill-opacity="0.07" stroke="{room.colour}" stroke-opacity="0.45"/>',
        _text(room.x + 14, room.y + 22, room.path, 15, room.colour, 700),
        _text(room.x + 14, room.y + 40, room.purpose, 12, SOFT),
    ]


def _box(step: Step) -> list[str]:
    out = [
        f'<rect x="{step.x}" y="{step.y}" width="{step.width}" height="{step.height}" rx="6" fill="#ffffff" '
        f'stroke="{step.colour}" stroke-width="1.4"/>',
        _text(step.x + 10, step.y + 21, step.name, 14, INK, 700),
    ]
    for i, line in enumerate(step.lines):
        out.append(_text(step.x + 10, step.y + 39 + 16 * i, line, 12, INK))
    out.append(_text(step.x + 10, step.y + step.height - 9, step.module, 11, step.colour, 600))
    return out


def _arrow(*points: Point) -> str:
    """An arrow along straight pieces whose corners are rounded."""
    path = [f"M{points[0][0]:g} {points[0][1]:g}"]
    for before, corner, after in zip(points, points[1:], points[2:], strict=False):
        start, end = _towards(corner, before), _towards(corner, after)
        path.append(f"L{start[0]:g} {start[1]:g} Q{corner[0]:g} {corner[1]:g} {end[0]:g} {end[1]:g}")
    path.append(f"L{points[-1][0]:g} {points[-1][1]:g}")
    return (
        f'<path d="{" ".join(path)}" fill="none" stroke="{LINE}" stroke-width="1.6" marker-end="url(#tip)"/>'
    )


def _towards(corner: Point, other: Point, radius: float = 7) -> Point:
    dx, dy = other[0] - corner[0], other[1] - corner[1]
    length = max((dx * dx + dy * dy) ** 0.5, 1e-9)
    share = min(radius / length, 0.5)
    return corner[0] + share * dx, corner[1] + share * dy


def _across(start: Point, end: Point, x: float) -> str:
    """An arrow to the right with one upright piece at ``x``."""
    return _arrow(start, (x, start[1]), (x, end[1]), end)


def _moved(point: Point, down: float) -> Point:
    return point[0], point[1] + down


def _arrows() -> list[str]:
    out = [
        # the class model serves three steps, the frame two; the box is where the outline starts
        *(_across(MODEL.right, _moved(step.left, -14), 258) for step in (OUTLINE, PARTS, DEPTH)),
        *(_across(FRAME.right, end, 267) for end in (OUTLINE.left, STEREO.left)),
        _across(BOXES.right, _moved(OUTLINE.left, 14), 276),
        _arrow(OUTLINE.bottom, PARTS.top),
        _arrow(PARTS.bottom, GROUND.top),
        _arrow(GROUND.bottom, DEPTH.top),
    ]
    modes = (PAPER, GUARDED, METRIC)
    out += [_across(DEPTH.right, _moved(mode.left, -8), 548) for mode in modes]
    out += [_across(STEREO.right, _moved(mode.left, 8), 560) for mode in modes]
    rail, above = ROOMS[3].x + ROOMS[3].width - 6, DIFFERENCE.y - 26
    for mode in modes:
        corner = (rail, mode.right[1])
        out.append(_arrow(mode.right, corner, (rail, above), (DIFFERENCE.top[0], above), DIFFERENCE.top))
    below, entry = TOP + 578, _moved(POSTERIOR.left, 20)
    out += [
        _across(DIFFERENCE.right, _moved(POSTERIOR.left, -10), 846),
        _arrow(WEIGHT.bottom, POSTERIOR.top),
        _arrow(BOXES.bottom, (BOXES.bottom[0], below), (858, below), (858, entry[1]), entry),
        _across(POSTERIOR.right, MATCHES.left, 1090),
        _arrow(MATCHES.bottom, CURVES.top),
    ]
    # at the edge of the column, where no title stands
    x = CURVES.x + CURVES.width - 16
    out += [_arrow((x, CURVES.bottom[1]), (x, FILES.y)), _arrow((x, FILES.bottom[1]), (x, PAGE.y))]
    return out


def _bracket() -> list[str]:
    """The bar over the rooms that ``rescore_frame`` walks through."""
    left, right, y = ROOMS[1].x, ROOMS[4].x + ROOMS[4].width, TOP - 26
    words = "rescore_frame in rescore/fusion/rescore_frame.py: the method on one screen, in the paper's order"
    around = f"M{left} {TOP - 6} V{y} H{right} V{TOP - 6}"
    return [
        f'<path d="{around}" fill="none" stroke="{BLUE}" stroke-width="1.6"/>',
        _text((left + right) / 2, y - 8, words, 13, BLUE, 600, "middle"),
    ]


NOTES = (
    "A step that cannot be done gives a Failure with its reason (recon/errors.py), which becomes the status "
    "of the candidate. In mode paper it then keeps its likelihood;",
    "in the others it gets the D of silent cues. Around all this: datasets_synth/ renders scenes with truth, "
    "rescore/experiment/ runs the stages, rescore/studies/ measures,",
    "rescore/library/ offers the method to programs, rescore/commands/ to people.",
)


def draw() -> str:
    """The whole picture as SVG."""
    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" '
        f'height="{HEIGHT}" font-family="{FONT}" role="img" aria-labelledby="title">',
        '<title id="title">From a frame to a posterior, and the folder that does each step</title>',
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" '
        f'orient="auto"><path d="M0 0.5 L7.5 4 L0 7.5 z" fill="{LINE}"/></marker></defs>',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#ffffff"/>',
        _text(20, 34, "From a frame to a posterior", 22, INK, 700),
        _text(20, 57, "Boxes: what flows, and the module that makes it. Panels: the folder.", 13, SOFT),
    ]
    for room in ROOMS:
        out += _room(room)
    out += _arrows()
    for step in STEPS:
        out += _box(step)
    out += _bracket()
    out.append(_text(300, TOP + 596, "likelihood l", 12, SOFT, 600))
    out += [_text(20, TOP + 626 + 19 * i, note, 13, SOFT) for i, note in enumerate(NOTES)]
    out.append("</svg>")
    return "\n".join(out) + "\n"


if __name__ == "__main__":
    PICTURE.write_text(draw(), encoding="utf-8")
