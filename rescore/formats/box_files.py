"""Boxes of other tools, a file a picture: Pascal VOC XML and YOLO text."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree

from recon.errors import RescoreError
from recon.reading import read_text
from rescore.formats.folders import NAME_FILES
from rescore.formats.labels import ClassMap, LabelRow, checked_box, number, read_lines
from rescore.formats.yaml_files import read_yaml


def read_voc(path: Path, width_px: int, height_px: int) -> list[LabelRow]:
    """The boxes of a VOC file, all classes; difficult ones are ``ignore``, as in VOC's evaluation.

    VOC counts pixels from 1 and includes the last, so that xmin 1 is the edge 0 and xmax the right edge.

    Raises:
        RescoreError: not VOC's XML, or a size other than the picture's.
    """
    try:
        root = ElementTree.fromstring(path.read_bytes())
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        raise RescoreError(f"{path}: expected VOC XML, got damaged XML ({error}); write it again") from error
    if root.tag != "annotation":
        raise RescoreError(f"{path}: expected VOC's element annotation, got {root.tag[:40]!r}; convert it")
    size = tuple(root.findtext(f"size/{side}") for side in ("width", "height"))
    said = [int(number(str(path), "size", text)) for text in size if text]
    if said and any(said) and said != [width_px, height_px]:
        raise RescoreError(
            f"{path}: expected boxes in a picture of {width_px} x {height_px} pixels, got one of "
            f"{' x '.join(map(str, said))}; label this picture"
        )
    return [_voc_row(f"{path}: object {i}", element) for i, element in enumerate(root.iter("object"), 1)]


def _voc_row(where: str, element: ElementTree.Element) -> LabelRow:
    texts = [element.findtext(f"bndbox/{side}") for side in ("xmin", "ymin", "xmax", "ymax")]
    name = " ".join((element.findtext("name") or "").split())
    if not name or None in texts:
        raise RescoreError(f"{where}: expected name and bndbox with xmin, ymin, xmax, ymax; add them")
    x0, y0, x1, y1 = (number(where, "bndbox", text or "") for text in texts)
    return LabelRow(
        name=name,
        xyxy_px=checked_box(where, (x0 - 1, y0 - 1, x1, y1)),
        ignore=_difficult(where, element.findtext("difficult") or "0"),
    )


def _difficult(where: str, text: str) -> bool:
    told = text.strip().casefold()
    if told not in ("0", "1", "false", "true"):
        raise RescoreError(f"{where}: difficult: expected 0 or 1, got {text[:40]!r}; mend it")
    return told in ("1", "true")


@dataclass(frozen=True)
class YoloClasses:
    """What YOLO's files of boxes say by a class number."""

    names: Mapping[int, str]
    """The name of each number."""
    key_points: bool = False
    """Whether key points follow each box."""
    tracks: bool = False
    """Whether the number of a track ends each line, behind the score."""


def yolo_classes(
    folder: Path, files: Sequence[Path], classes: ClassMap
) -> tuple[YoloClasses, tuple[str, ...]]:
    """The names of YOLO's class numbers, from a file in the folder or the one above, and what to say of them.

    Without such a file the numbers are the names, so that a class can be mapped from its number; where number
    0 is the only one, it is the class.

    Raises:
        RescoreError: the file holds no names, or there is none and several numbers.
    """
    places = [place / name for place in (folder, folder.parent) for name in NAME_FILES]
    path = next((p for p in places if p.is_file()), None)
    numbers, tracks = _scanned(files)
    found, notes = (_named(path), ()) if path is not None else _numbered(folder, numbers, classes)
    return replace(found, tracks=tracks), notes


def _scanned(files: Sequence[Path]) -> tuple[list[int], bool]:
    """The class numbers in the order in which they first come, and whether a tracker wrote a line.

    A tracker writes a box, its score and a whole number that is no corner's.
    """
    numbers: dict[int, None] = {}
    tracks = False
    for file in files:
        for _, words in read_lines(file):
            if (number := _class_number(words[0])) is not None:
                numbers[number] = None
            tracks = tracks or (len(words) == 7 and words[-1].isdecimal() and int(words[-1]) > 1)
    return list(numbers), tracks


def _numbered(folder: Path, numbers: Sequence[int], classes: ClassMap) -> tuple[YoloClasses, tuple[str, ...]]:
    """The numbers of the classes for their names."""
    texts = {n: str(n) for n in numbers}
    if set(classes.renamed) & set(texts.values()):
        return YoloClasses(texts), ()
    if set(texts) <= {0}:
        note = f"{folder}: no names of classes, so class number 0 is taken for {classes.target!r}"
        return YoloClasses({0: classes.target}), (note,)
    raise RescoreError(
        f"{folder}: expected the names of YOLO's classes in {', '.join(NAME_FILES)}, found none, and "
        f"numbers {', '.join(texts.values())[:60]}; write classes.txt with a name a line, or map a "
        f"number, as --map {next(iter(texts))}={classes.target}"
    )


def _named(path: Path) -> YoloClasses:
    """The names that a file has."""
    text = read_text(path, "names of classes")
    if path.suffix not in (".yaml", ".yml"):
        lines = [n.strip().strip("'\"") for n in text.rstrip().splitlines()]
        if not all(lines):
            raise RescoreError(
                f"{path}: expected the names of classes 0, 1, 2, ... a line each, got an empty line "
                f"{lines.index('') + 1}; name that class, or remove the line"
            )
        found = YoloClasses(dict(enumerate(lines)))
    else:
        documents = read_yaml(path, text)
        key_points = any(d.get("kpt_shape") for d in documents)
        found = YoloClasses(_yaml_names(path, [d["names"] for d in documents if d.get("names")]), key_points)
    if not found.names:
        raise RescoreError(f"{path}: expected names of classes, found none; write them in order")
    return found


def _yaml_names(path: Path, told: Sequence[object]) -> dict[int, str]:
    """The names by their numbers, which a list leaves out: ``names: [a, b]`` or ``names: {0: a, 1: b}``."""
    if not told:
        return {}
    by_number = dict(enumerate(told[0])) if isinstance(told[0], list) else told[0]
    if len(told) > 1 or not isinstance(by_number, dict):
        raise RescoreError(f"{path}: names: expected one list of names, got other values; mend it")
    names = {_class_number(str(number)): name for number, name in by_number.items()}
    if None in names or len(names) < len(by_number):
        raise RescoreError(
            f"{path}: names: expected each name by a whole number of its own, got the numbers "
            f"{', '.join(map(str, by_number))[:40]}; mend them"
        )
    if not all(isinstance(name, str) and name.strip() for name in names.values()):
        raise RescoreError(f"{path}: names: expected texts, got an empty name or a list; mend it")
    return {number: name.strip() for number, name in names.items() if number is not None}


def _class_number(text: str) -> int | None:
    """The number of a class, which some tools write as 0.0; None where a text is no such number."""
    try:
        value = float(text)
    except ValueError:
        return None
    return int(value) if value.is_integer() and 0 <= value < 1e9 else None


def read_yolo(path: Path, width_px: int, height_px: int, classes: YoloClasses) -> list[LabelRow]:
    """The boxes of a YOLO file, all classes: class, centre and size as shares of the picture, and a score.

    Of a polygon, corners as shares of the picture after the class, the enclosing box is read.

    Raises:
        RescoreError: a line has another shape; it is named.
    """
    return [_yolo_row(where, words, (width_px, height_px), classes) for where, words in read_lines(path)]


def _yolo_row(where: str, words: list[str], size: tuple[int, int], classes: YoloClasses) -> LabelRow:
    if len(words) < 5:
        raise RescoreError(
            f"{where}: expected YOLO's class, x, y, width, height (and a score), or a polygon, got "
            f"{len(words)} columns; mend the line"
        )
    class_number = _class_number(words[0])
    if class_number not in classes.names or class_number is None:
        raise RescoreError(
            f"{where}: expected a class number of {_numbers(classes.names)}, got {words[0][:20]!r}; mend it, "
            "or the names"
        )
    if classes.key_points:
        words = words[:5]
    elif classes.tracks and len(words) == 7:
        words = words[:6]
    # coordinates come in pairs, so that an even count of columns has a score behind them
    scored = len(words) % 2 == 0
    told = words[1:-1] if scored else words[1:]
    shares = [number(where, _YOLO_BOX[i] if len(told) == 4 else "a corner", t) for i, t in enumerate(told)]
    # a little over 1 comes of rounding
    if not all(0 <= v <= 1.001 for v in shares):
        raise RescoreError(
            f"{where}: expected shares of the picture in [0, 1], got {' '.join(told)[:60]}; pixels must be "
            "divided by width and height"
        )
    box = _of_centre(shares) if len(shares) == 4 else _around(shares)
    return LabelRow(
        name=classes.names[class_number],
        xyxy_px=checked_box(where, tuple(v * size[i % 2] for i, v in enumerate(box))),
        score=number(where, "the score", words[-1]) if scored else None,
    )


_YOLO_BOX = ("x", "y", "width", "height")


def _of_centre(shares: Sequence[float]) -> tuple[float, float, float, float]:
    x, y, w, h = shares
    return (x - w / 2, y - h / 2, x + w / 2, y + h / 2)


def _around(shares: Sequence[float]) -> tuple[float, float, float, float]:
    x, y = shares[::2], shares[1::2]
    return (min(x), min(y), max(x), max(y))


def refuse_track_numbers(folder: Path, rows: Sequence[LabelRow]) -> None:
    """Raises RescoreError where the scores of all boxes are whole numbers above 0, as trackers number."""
    scores = [r.score or 0.0 for r in rows]
    if all(s.is_integer() and s > 0 for s in scores) and max(scores, default=0.0) > 1:
        raise RescoreError(
            f"{folder}: expected a score in the last column, got whole numbers in all {len(rows)} lines, as "
            "of tracks; write scores too (save_conf=True)"
        )


def _numbers(names: Mapping[int, str]) -> str:
    listed = sorted(names)
    return f"0 to {listed[-1]}" if listed == list(range(len(listed))) else ", ".join(map(str, listed))[:60]


def is_kitti_text(paths: Sequence[Path]) -> bool:
    """Whether text files hold KITTI's boxes, which begin with a name, and not YOLO's; or are all empty."""
    for path in paths:
        for _, words in read_lines(path)[:1]:
            return _class_number(words[0]) is None
    return True


def chosen(
    rows: Sequence[Sequence[LabelRow]], classes: ClassMap
) -> tuple[list[list[LabelRow]], Counter[str]]:
    """The boxes of a class in each file, and how many boxes each class has in all."""
    counts = Counter(r.name for own in rows for r in own)
    return [[r for r in own if classes.takes(r.name)] for own in rows], counts
