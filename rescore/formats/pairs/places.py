"""Where the pictures of a plain folder lie: its folders of left and right pictures and of measured files."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from recon.errors import RescoreError
from recon.stores import remote
from rescore.data.depth_files import Quantity
from rescore.data.pictures import PICTURES, pictures_in
from rescore.formats.pairs.names import OTHER, Side, differ_in_side, side_of

PAIRS = (
    ("left", "right"),
    ("image_0", "image_1"),
    ("image_2", "image_3"),
    ("image_02", "image_03"),
    ("image_00", "image_01"),
    ("im0", "im1"),
    ("cam0", "cam1"),
    ("image_left", "image_right"),
    ("leftImg8bit", "rightImg8bit"),
)
"""Names of the folders of left and right pictures; others are found by the words for a side in them."""
LEFT_ALONE = (*(left for left, _ in PAIRS), "rgb", "color", "colour", "images")
"""Names of folders of pictures that have measured files beside them."""
MEASURED = (
    ("disparity", Quantity.DISPARITY),
    ("disp", Quantity.DISPARITY),
    ("disp0", Quantity.DISPARITY),
    ("depth", Quantity.DEPTH),
    ("depth_left", Quantity.DEPTH),
)
"""Names of the folders of measured files, and what they hold."""
MOST_DEEP = 2
"""Folders between one of a side and its pictures (Cityscapes' split and city)."""


@dataclass(frozen=True)
class Place:
    """Where left pictures lie, with right pictures or measured files; None for what is not there."""

    left: Path
    right: Path | None
    """The folder of left pictures itself where both sides lie in it."""
    measured: Path | None
    quantity: Quantity
    sub: tuple[str, ...] = ()
    """Names of the folders between that of a side and its pictures, the same on both sides."""

    def lefts(self) -> list[Path]:
        """The left pictures.

        Raises:
            RescoreError: there are none, or two bear one name.
        """
        return _of_side(self.left, Side.LEFT) if self.right == self.left else pictures_in(self.left)

    def rights(self) -> list[Path]:
        """The right pictures.

        Raises:
            RescoreError: as for the left ones.
        """
        assert self.right is not None
        return _of_side(self.right, Side.RIGHT) if self.right == self.left else pictures_in(self.right)


def places_in(root: Path) -> list[Place]:
    """Where the pictures of a folder lie, one place for each pair of folders; nothing where it is not plain.

    Raises:
        RescoreError: several pairs of folders have names of two sides.
    """
    folders = {p.name: p for p in _folders(root)}
    measured, quantity = next(((folders[n], q) for n, q in MEASURED if n in folders), (None, Quantity.DEPTH))
    left, right = next(
        ((folders[a], folders[b]) for a, b in PAIRS if a in folders and b in folders), (None, None)
    )
    if left is None and measured is not None:
        left = next((folders[n] for n in LEFT_ALONE if n in folders), None)
    if left is None:
        left, right = _by_side(root, folders) or (None, None)
    if left is not None:
        return _under(left, right, measured, quantity)
    return [Place(root, root, None, quantity)] if _holds_both_sides(root) else []


def folders_in(root: Path) -> list[Path]:
    """The folders in a folder that are not hidden, in the order of their names."""
    try:
        with os.scandir(root) as entries:
            names = sorted(e.name for e in entries if not e.name.startswith(".") and e.is_dir())
    except OSError:
        # whoever reads files of it says what is wrong
        return []
    return [root / name for name in names]


def has_pictures(folder: Path) -> bool:
    """Whether there are pictures in a folder; a large one is not listed."""
    return next(_picture_names(folder), None) is not None


def _folders(root: Path) -> list[Path]:
    if remote(root) is None:
        return folders_in(root)
    # to ask a store what each thing is takes long
    names = {*sum(PAIRS, ()), *LEFT_ALONE, *(name for name, _ in MEASURED)}
    return [p for p in root.iterdir() if p.name in names and p.is_dir()]


def _picture_names(folder: Path) -> Iterator[str]:
    """Names of the pictures of a folder without their ends, one by one: a large folder is not listed."""
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                stem, suffix = os.path.splitext(entry.name)
                if suffix.lower() in PICTURES and not stem.startswith("."):
                    yield stem
    except OSError:
        return


def _by_side(root: Path, folders: dict[str, Path]) -> tuple[Path, Path] | None:
    """The two folders of pictures whose names differ in the side alone.

    Raises:
        RescoreError: there are several, and none or several of them are called stereo.
    """
    pairs = differ_in_side(name for name in folders if not OTHER.search(name))
    pairs = [(a, b) for a, b in pairs if _leaves(folders[a]) and _leaves(folders[b])]
    if len(pairs) > 1:
        pairs = [pair for pair in pairs if "stereo" in pair[0].casefold()] or pairs
    if len(pairs) > 1:
        told = "; ".join(f"{a} and {b}" for a, b in pairs[:3])
        raise RescoreError(
            f"{root}: expected one pair of folders of left and right pictures, got {told}; cameras that look "
            "to different sides are no pair: put a rectified pair into folders left and right"
        )
    return (folders[pairs[0][0]], folders[pairs[0][1]]) if pairs else None


def _under(left: Path, right: Path | None, measured: Path | None, quantity: Quantity) -> list[Place]:
    """A place for each folder of pictures under that of the left side."""
    subs: list[tuple[str, ...]] = [()] if remote(left) is not None else _leaves(left) or [()]

    def beside(folder: Path | None, sub: tuple[str, ...]) -> Path | None:
        if folder is None or not sub:
            return folder
        found = folder.joinpath(*sub)
        if found.is_dir():
            return found
        # files that are measured for a single folder need not repeat its name
        return folder if folder == measured and len(subs) == 1 else None

    # both sides may lie under the one folder, as Camera_0 and Camera_1 in Virtual KITTI's rgb
    others = {} if right else _right_of(subs)
    return [
        Place(
            left.joinpath(*sub),
            left.joinpath(*others[sub]) if sub in others else beside(right, sub),
            beside(measured, sub),
            quantity,
            sub,
        )
        for sub in subs
        if sub not in others.values()
    ]


def _right_of(subs: list[tuple[str, ...]]) -> dict[tuple[str, ...], tuple[str, ...]]:
    """The folder of right pictures of each of left ones, by their names from the folder they lie in."""
    inside: dict[tuple[str, ...], list[str]] = {}
    for sub in subs:
        if sub:
            inside.setdefault(sub[:-1], []).append(sub[-1])
    return {(*at, a): (*at, b) for at, names in inside.items() for a, b in differ_in_side(names)}


def _leaves(folder: Path) -> list[tuple[str, ...]]:
    """The folders of pictures under a folder by their names from it: itself alone where it holds some."""
    found: list[tuple[str, ...]] = []
    level: list[tuple[str, ...]] = [()]
    for _ in range(MOST_DEEP + 1):
        places = {sub: folder.joinpath(*sub) for sub in level}
        here = {sub for sub, place in places.items() if has_pictures(place)}
        found += here
        level = [
            (*sub, p.name) for sub, place in places.items() if sub not in here for p in folders_in(place)
        ]
    return sorted(found)


def _holds_both_sides(root: Path) -> bool:
    """Whether every picture of a folder has a side in its name, and there are pictures of both."""
    if remote(root) is not None:
        return False
    found: set[Side] = set()
    for stem in _picture_names(root):
        side = side_of(stem)
        if OTHER.search(stem):
            continue
        if side is None:
            return False
        found.add(side)
    return found == set(Side)


def _of_side(folder: Path, side: Side) -> list[Path]:
    found = [p for p in pictures_in(folder) if side_of(p.stem) is side and not OTHER.search(p.stem)]
    if not found:
        raise RescoreError(
            f"{folder}: expected pictures called {' or '.join(side.value[:2])}, found none; check the folder"
        )
    return found
