"""Boxes of other tools, a file a picture: Pascal VOC XML and YOLO text."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

from recon.errors import RescoreError
from rescore.formats.labels import ClassMap, LabelRow, checked_box, number, read_lines
from rescore.formats.yaml_files import read_yaml

NAME_FILES = ("classes.txt", "obj.names", "data.yaml", "dataset.yaml", "data.yml")
"""Where YOLO keeps the names of its class numbers."""


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
    name = (element.findtext("name") or "").strip()
    if not name or None in texts:
        raise RescoreError(f"{where}: expected name and bndbox with xmin, ymin, xmax, ymax; add them")
    x0, y0, x1, y1 = (number(where, "bndbox", text or "") for text in texts)
    return LabelRow(
        name=name,
        xyxy_px=checked_box(where, (x0 - 1, y0 - 1, x1, y1)),
        ignore=(element.findtext("difficult") or "0").strip() == "1",
    )


def class_names(folder: Path) -> list[str]:
    """The names of YOLO's class numbers, from a file in the folder or the one above.

    Raises:
        RescoreError: there is no such file, or it holds no names, or not one for each number from 0.
    """
    places = [place / name for place in (folder, folder.parent) for name in NAME_FILES]
    path = next((p for p in places if p.is_file()), None)
    if path is None:
        raise RescoreError(
            f"{folder}: expected the names of YOLO's classes in {', '.join(NAME_FILES)}, found none; write "
            "classes.txt with a name a line"
        )
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise RescoreError(f"{path}: expected names in UTF-8, got other bytes; write it again") from error
    if path.suffix in (".yaml", ".yml"):
        names = _yaml_names(path, text)
    else:
        names = [n.strip().strip("'\"") for n in text.splitlines() if n.strip()]
    if not names:
        raise RescoreError(f"{path}: expected names of classes, found none; write them in order")
    return names


def _yaml_names(path: Path, text: str) -> list[str]:
    """The names by their numbers, which a list leaves out: ``names: [a, b]`` or ``names: {0: a, 1: b}``."""
    told = [document["names"] for document in read_yaml(path, text) if document.get("names")]
    if not told:
        return []
    by_number = dict(enumerate(told[0])) if isinstance(told[0], list) else told[0]
    if len(told) > 1 or not isinstance(by_number, dict):
        raise RescoreError(f"{path}: names: expected one list of names, got other values; mend it")
    names = {str(number): name for number, name in by_number.items()}
    if set(names) != {str(i) for i in range(len(names))}:
        raise RescoreError(
            f"{path}: names: expected a name for each number from 0 to {len(names) - 1}, got the numbers "
            f"{', '.join(names)[:40]}; number them without gaps"
        )
    in_order = [names[str(i)] for i in range(len(names))]
    if not all(isinstance(name, str) and name.strip() for name in in_order):
        raise RescoreError(f"{path}: names: expected texts, got an empty name or a list; mend it")
    return [name.strip() for name in in_order]


def read_yolo(path: Path, width_px: int, height_px: int, names: Sequence[str]) -> list[LabelRow]:
    """The boxes of a YOLO file, all classes: class, centre and size as shares of the picture, and a score.

    Raises:
        RescoreError: a line has another shape; it is named.
    """
    return [_yolo_row(where, words, (width_px, height_px), names) for where, words in read_lines(path)]


def _yolo_row(where: str, words: list[str], size: tuple[int, int], names: Sequence[str]) -> LabelRow:
    if len(words) not in (5, 6):
        raise RescoreError(
            f"{where}: expected YOLO's class, x, y, width, height (and a score), got {len(words)} columns; "
            "polygons are not read"
        )
    # numbers of thousands of digits are refused by int itself
    if not words[0].isdecimal() or len(words[0]) > 9 or int(words[0]) >= len(names):
        raise RescoreError(
            f"{where}: expected a class number below {len(names)}, got {words[0][:20]!r}; mend it, or the "
            "names"
        )
    x, y, w, h = (
        number(where, what, t) for what, t in zip(("x", "y", "width", "height"), words[1:5], strict=True)
    )
    # a little over 1 comes of rounding
    if not all(0 <= v <= 1.001 for v in (x, y, w, h)):
        raise RescoreError(
            f"{where}: expected shares of the picture in [0, 1], got {' '.join(words[1:5])}; pixels must be "
            "divided by width and height"
        )
    box = ((x - w / 2) * size[0], (y - h / 2) * size[1], (x + w / 2) * size[0], (y + h / 2) * size[1])
    return LabelRow(
        name=names[int(words[0])],
        xyxy_px=checked_box(where, box),
        score=number(where, "the score", words[5]) if len(words) == 6 else None,
    )


def is_kitti_text(paths: Sequence[Path]) -> bool:
    """Whether text files hold KITTI's boxes, which begin with a name, and not YOLO's; or are all empty."""
    for path in paths:
        for _, words in read_lines(path)[:1]:
            return not words[0].isdecimal()
    return True


def chosen(
    rows: Sequence[Sequence[LabelRow]], classes: ClassMap
) -> tuple[list[list[LabelRow]], Counter[str]]:
    """The boxes of a class in each file, and how many boxes each class has in all."""
    counts = Counter(r.name for own in rows for r in own)
    return [[r for r in own if classes.takes(r.name)] for own in rows], counts
