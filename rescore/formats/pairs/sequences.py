"""Folders of several sequences, each of a known layout, as one data set."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from recon.errors import RescoreError
from recon.stores import remote
from rescore.data.frames import DataSet, FrameRecord, Truth
from rescore.formats.kitti import is_kitti, read_kitti
from rescore.formats.labels import ClassMap, image_ids
from rescore.formats.pairs.names import OTHER
from rescore.formats.pairs.places import folders_in
from rescore.formats.pairs.plain import is_plain, read_plain

MOST_DEEP = 4
"""Folders from that of the data set to a sequence (Virtual KITTI: scene, weather, frames, rgb)."""
MOST_FOLDERS = 5000
"""Folders without pictures of a known layout that are looked at."""
OF_THEIR_OWN = ("annotations.json", "parts.json")
"""What lies in data sets that name their pictures, and are read alone."""


def has_sequences(root: Path) -> bool:
    """Whether sequences lie in a folder."""
    return next(_sequences(root), None) is not None


def read_sequences(root: Path, classes: ClassMap) -> DataSet:
    """The frames of all sequences in a folder, in the order of their paths, with the boxes of each.

    Frames are named as in their sequence, and where two of the data set would have one name, by the folders
    from ``root`` to the sequence too, joined by "-". A calibration counts for all sequences below it.

    Raises:
        RescoreError: a sequence is damaged.
    """
    # a class to map may be one of some sequences alone
    several = replace(classes, of_several=True)
    found = sorted(_sequences(root))
    data = _joined(root, [_read(folder, several, root) for folder in found])
    return replace(data, notes=(*_left_out(root), *data.notes))


def _left_out(root: Path) -> tuple[str, ...]:
    """What to say of data sets beside the sequences, which name pictures of their own."""
    names = [folder.name for folder in folders_in(root) if _of_its_own(folder)]
    told = f"{root}: left out {', '.join(names)}, data sets of their own; give each alone"
    return (told,) if names else ()


def _of_its_own(folder: Path) -> bool:
    return any((folder / name).exists() for name in OF_THEIR_OWN)


def _read(folder: Path, classes: ClassMap, top: Path) -> DataSet:
    return read_kitti(folder, classes) if is_kitti(folder) else read_plain(folder, classes, top)


def _sequences(root: Path) -> Iterator[Path]:
    """The nearest folders of a known layout below a folder, level by level.

    Raises:
        RescoreError: among more folders than are looked at.
    """
    if remote(root) is not None:
        return
    level, n_other, found = [root], 0, False
    for _ in range(MOST_DEEP):
        deeper = []
        for folder in (p for above in level for p in folders_in(above) if not OTHER.search(p.name)):
            if _of_its_own(folder):
                continue
            if is_kitti(folder) or is_plain(folder):
                found = True
                yield folder
                continue
            deeper.append(folder)
            n_other += 1
            if n_other > MOST_FOLDERS:
                if not found:
                    return
                raise RescoreError(
                    f"{root}: expected sequences in at most {MOST_FOLDERS} other folders, got more; give a "
                    "folder nearer to the pictures"
                )
        level = deeper


def _joined(root: Path, parts: Sequence[DataSet]) -> DataSet:
    """The data sets of sequences as one, with ids and annotations numbered anew where there are several."""
    if len(parts) == 1:
        return replace(parts[0], root=root)
    names = [[f.name or f.left_path.stem for f in part.frames] for part in parts]
    repeated = len({name for own in names for name in own}) < sum(map(len, names))
    if repeated:
        folders = ["-".join(part.root.relative_to(root).parts) for part in parts]
        names = [[f"{folder}-{n}" for n in own] for folder, own in zip(folders, names, strict=True)]
    ids = iter(image_ids([name for own in names for name in own]))
    frames: list[FrameRecord] = []
    truth: dict[int, Truth] = {}
    first = 1
    for part, own in zip(parts, names, strict=True):
        for frame, name in zip(part.frames, own, strict=True):
            boxes, image_id = part.truth[frame.image_id], next(ids)
            frames.append(replace(frame, image_id=image_id, name=name if repeated else frame.name))
            n = len(boxes.annotation_id)
            truth[image_id] = replace(
                boxes, annotation_id=boxes.annotation_id - boxes.annotation_id[:1] + first
            )
            first += n
    return replace(parts[0], root=root, frames=tuple(frames), truth=truth, notes=_notes(parts))


def _notes(parts: Sequence[DataSet]) -> tuple[str, ...]:
    """What the readers of the sequences say, each kind once with the number of sequences."""
    told: dict[str, str] = {}
    counts: Counter[str] = Counter()
    for part in parts:
        for kind, note in {n.replace(str(part.root), ""): n for n in part.notes}.items():
            told.setdefault(kind, note)
            counts[kind] += 1
    notes = [
        note if counts[kind] == 1 else f"{note} (so in {counts[kind]} of {len(parts)} sequences)"
        for kind, note in told.items()
    ]
    return tuple(notes)
