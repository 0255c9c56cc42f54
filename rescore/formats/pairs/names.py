"""Pairs of files by their names alone: what goes with each left picture."""

import math
import re
from collections.abc import Callable, Iterable, Sequence
from enum import Enum
from pathlib import Path

from recon.errors import RescoreError
from rescore.formats.time_pairs import MAX_SECONDS_APART, nearest_pairs


class Side(Enum):
    """The words by which names tell a side: ``left``, an ``l`` that stands alone, an ``L`` behind a letter or
    before a number, ``cam0``."""

    LEFT = ("left", "l", "0")
    RIGHT = ("right", "r", "1")

    @property
    def words(self) -> re.Pattern[str]:
        """What a name of this side holds and one of the other does not."""
        word, letter, number = self.value
        alone = rf"(?<![A-Za-z]){letter}(?![A-Za-z])|(?<![A-Za-z]){letter.upper()}(?![A-Za-z])"
        joined = rf"(?<=[A-Za-z]){letter.upper()}(?=\d|[_-]|$)"
        camera = rf"(?i:cam(?:era)?[_-]?){number}(?!\d)"
        # Cityscapes joins the kind of picture to the word
        return re.compile(rf"(?i:{word}(?:img8bit)?)|{camera}|{alone}|{joined}")


OTHER = re.compile(
    r"depth|disp(?!l)|flow(?!er)|segmentation|(?<![a-z])seg(?![a-z])|semantic|instance|mask|normals|"
    r"labels?(?![a-z])|annotations?(?![a-z])|gtfine|gtcoarse|gtbbox|lidar|velodyne|oxts",
    re.IGNORECASE,
)
"""What names of files and folders have that hold no pictures of the cameras."""
_KIND = re.compile(r"[_-](depth|disparity|disp)$|^(rgb|color|image|depth|disparity|disp)[_-]", re.IGNORECASE)
"""What names of files have that tells pictures from what is measured for them."""


def side_of(name: str) -> Side | None:
    """The side that a name tells; None where it tells none, or both."""
    left, right = (side.words.search(name) is not None for side in Side)
    return None if left == right else Side.LEFT if left else Side.RIGHT


def differ_in_side(names: Iterable[str]) -> list[tuple[str, str]]:
    """The pairs of a left and a right name that differ in words for the side alone."""
    listed = sorted(names)
    rights: dict[str, list[str]] = {}
    for name in listed:
        for form in _without_side(name, Side.RIGHT):
            rights.setdefault(form, []).append(name)
    found = {
        (name, other): None
        for name in listed
        for form in sorted(_without_side(name, Side.LEFT))
        for other in rights.get(form, ())
    }
    return list(found)


def _without_side(name: str, side: Side) -> set[str]:
    """The name less one or all words for a side; nothing where it has none."""
    return (_without_one(name, side) | _without_all(name, side)) - {name}


def paired(lefts: Sequence[Path], others: Sequence[Path], side: Side) -> list[tuple[Path, Path]]:
    """Left pictures with the files that go with them, in the order of the left ones.

    A file of the same name goes first, then one whose name differs in one word for a side, then one that
    differs in all such words, or in what it measures (``_depth``); what is left is paired by times of nearly
    one moment, as in TUM.

    Args:
        lefts: The left pictures, no name twice.
        others: Right pictures, or measured files, no name twice.
        side: The side that the others are of: ``LEFT`` for what is measured for left pictures.

    Raises:
        RescoreError: a file goes with two others.
    """
    found: dict[Path, Path] = {}
    taken: set[Path] = set()
    for form in (_whole, _without_one, _without_all, _without_kind):
        found |= _matched([p for p in lefts if p not in found], others, side, form, taken)
    found |= _by_time([p for p in lefts if p not in found], [p for p in others if p not in taken])
    return [(p, found[p]) for p in lefts if p in found]


def _matched(
    lefts: Sequence[Path],
    others: Sequence[Path],
    side: Side,
    form: Callable[[str, Side], set[str]],
    taken: set[Path],
) -> dict[Path, Path]:
    """The files that share a form of their name with a left picture; they are added to ``taken``.

    Raises:
        RescoreError: two files have it, or the one that has it goes with another left picture.
    """
    by_form: dict[str, list[Path]] = {}
    for path in others:
        for name in form(path.stem, side):
            by_form.setdefault(name, []).append(path)
    found: dict[Path, Path] = {}
    for path in lefts:
        forms = form(path.stem, Side.LEFT)
        fits = sorted({other for name in forms for other in by_form.get(name, ())})
        if len(fits) > 1:
            raise RescoreError(
                f"{path}: expected one file of its name, got {fits[0].name} and {fits[1].name} in "
                f"{fits[0].parent}; remove one, or give both sides the same names"
            )
        if not fits:
            continue
        if fits[0] in taken:
            raise RescoreError(
                f"{fits[0]}: expected one left picture of its name, got {path.name} and another in "
                f"{path.parent}; remove one, or give both sides the same names"
            )
        found[path] = fits[0]
        taken.add(fits[0])
    return found


def _whole(stem: str, side: Side) -> set[str]:
    return {stem}


def _without_one(stem: str, side: Side) -> set[str]:
    """The name, and the name less each of the words for its side."""
    return {stem} | {_tidy(stem[: m.start()], stem[m.end() :]) for m in side.words.finditer(stem)}


def _without_all(stem: str, side: Side) -> set[str]:
    return {_tidy(side.words.sub("", stem), "")}


def _without_kind(stem: str, side: Side) -> set[str]:
    plain = _KIND.sub("", stem)
    return {name.rstrip("_- ") for name in {plain} | _without_one(plain, side)}


def _tidy(before: str, after: str) -> str:
    # left_07 and 07, 07 and 07_left
    return (before + after).strip("_- ") if not (before and after) else before + after


def _by_time(lefts: Sequence[Path], others: Sequence[Path]) -> dict[Path, Path]:
    """Pairs of files named by nearly one time, the closest first, each file once."""
    first, second = ([(t, p) for p in paths if (t := _time(p.stem)) is not None] for paths in (lefts, others))
    pairs = nearest_pairs([t for t, _ in first], [t for t, _ in second], MAX_SECONDS_APART)
    return {first[i][1]: second[j][1] for i, j in pairs.items()}


def _time(stem: str) -> float | None:
    # a time in seconds with a fraction, not the number of a frame
    return float(stem) if re.fullmatch(r"\d+\.\d+", stem) and math.isfinite(float(stem)) else None
