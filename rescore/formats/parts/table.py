"""A table in parts: a folder with ``parts.json``, which names its Parquet files in their order.

A part is whole or not there: it is written by one put under a name that what it was made of decides, and
``parts.json`` comes last. So a store needs no rename, and who finds that file finds a whole table.

A part of detections has two groups of rows: one of its frames, and one of their candidates. Where a frame
failed, its row says why. Parts of other tables have one group.
"""

import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import pyarrow as pa
import pyarrow.dataset as pads
import pyarrow.fs as pafs
import pyarrow.parquet as pq
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, TypeAdapter

from recon.errors import RescoreError
from recon.files import atomic_path, refuse_as_input
from recon.reading import reading
from recon.stores import RemotePath, remote
from rescore.files import write_json
from rescore.formats.checked_json import read_checked
from rescore.formats.parts.forms import FORMS, FRAME_STATES, Form
from rescore.formats.parts.manifest import MANIFEST

PARTS = "parts"
"""Name of the folder below in which the Parquet files lie."""
VERSION = 1
"""Version of the form, for readers of later ones."""

Columns = Mapping[str, NDArray[Any]]


class Part(BaseModel):
    """One Parquet file of a table."""

    model_config = ConfigDict(frozen=True)

    name: str
    """Name of its file without the end."""
    rows: int
    """Rows of its last group: candidates, or frames."""
    bytes: int
    frames: int = 0
    """Frames whose candidates it holds."""
    failed: int = 0
    """Frames that failed."""


class _Manifest(BaseModel):
    version: int
    kind: str
    about: dict[str, Any] = {}
    parts: tuple[Part, ...]


_MANIFEST = TypeAdapter(_Manifest)


@dataclass(frozen=True, eq=False)
class PartTable:
    """A table in parts, of which nothing is in memory but the names of its parts."""

    root: Path
    kind: str
    """What its rows are: "frames", "detections", "rescored" or "candidates"."""
    about: Mapping[str, Any]
    """What holds for all rows, as the name of the detector."""
    parts: tuple[Part, ...] = field(repr=False)

    @classmethod
    def read(cls, root: Path) -> Self:
        """The table of a folder.

        Raises:
            RescoreError: there is none, it is damaged, or of a later version.
        """
        file = root / MANIFEST
        if not file.is_file():
            raise RescoreError(
                f"{root}: expected a table in parts, found no {MANIFEST}; where its command was stopped, run "
                "it again"
            )
        found = read_checked(file, _MANIFEST, "the names of the parts of a table")
        if found.version > VERSION:
            raise RescoreError(
                f"{file}: expected version {VERSION} or older, got {found.version}; use a newer rescore"
            )
        return cls(root, found.kind, found.about, found.parts)

    def write(self) -> None:
        """Write ``parts.json``: from then on there is a table here."""
        parts = [p.model_dump(exclude_defaults=True) for p in self.parts]
        about = {"version": VERSION, "kind": self.kind, "about": dict(self.about)}
        write_json(self.root / MANIFEST, about | {"parts": parts})

    def said(self, name: str) -> Any:
        """What ``about`` says under a name.

        Raises:
            RescoreError: it says nothing.
        """
        if name not in self.about:
            raise RescoreError(
                f"{self.root / MANIFEST}: expected {name!r} in 'about', got none; write the table again"
            )
        return self.about[name]

    @property
    def rows(self) -> int:
        """Rows of all parts, without those of frames."""
        return sum(p.rows for p in self.parts)

    @property
    def n_failed(self) -> int:
        """Frames that failed."""
        return sum(p.failed for p in self.parts)

    @cached_property
    def schema(self) -> pa.Schema:
        """Columns of the first part, which all parts have."""
        if not self.parts:
            return pa.schema([])
        with reading(self.root, "a part of a table", "write the table again"):
            return self._open(self.parts[0]).schema_arrow

    def file(self, part: Part) -> Path:
        """Where a part lies."""
        return part_file(self.root, part.name)

    def columns(self, part: Part, names: Sequence[str] | None = None) -> pa.Table:
        """Columns of the last group of rows of a part, in the form of its kind; of the file no more is read.

        Raises:
            RescoreError: the part is not there, is damaged, lacks a column, or has one that is not allowed.
        """
        return self._group(part, names, -1, FORMS.get(self.kind))

    def frame_rows(self, part: Part, names: Sequence[str]) -> pa.Table:
        """Columns of the rows of the frames of a part of detections."""
        return self._group(part, names, 0, FRAME_STATES)

    def _group(self, part: Part, names: Sequence[str] | None, group: int, form: Form | None) -> pa.Table:
        with reading(self.file(part), "a part of a table", "make it again: remove it, run the command"):
            file = self._open(part)
            lacks = set(names or ()) - set(file.schema_arrow.names)
            if lacks:
                raise ValueError(f"no column {sorted(lacks)[0]!r}")
            rows = file.read_row_group(group % file.num_row_groups, columns=names)
            return rows if form is None else form.shaped(rows)

    def failed_frames(self) -> Iterator[tuple[int, str]]:
        """Image id of each frame that failed, and why."""
        for part in self.parts:
            if part.failed:
                found = self.frame_rows(part, ["image_id", "status", "reason_detail"]).to_pylist()
                yield from ((r["image_id"], r["reason_detail"]) for r in found if r["status"] != "ok")

    def dataset(self) -> pads.Dataset:
        """The table as Arrow's data set: who asks for some columns or rows reads no others."""
        form = pads.ParquetFileFormat()
        away = remote(self.root)
        system = pafs.LocalFileSystem() if away is None else pafs.PyFileSystem(_Objects())
        files = [form.make_fragment(str(self.file(p)), system) for p in self.parts]
        return pads.FileSystemDataset(files, self.schema, form, system)

    def _open(self, part: Part) -> pq.ParquetFile:
        file = self.file(part)
        away = remote(file)
        return pq.ParquetFile(file if away is None else pa.PythonFile(away.open(), mode="r"))


def part_file(root: Path, name: str) -> Path:
    """Where the part of a name lies in the folder of a table."""
    return root / PARTS / f"{name}.parquet"


def names_there(root: Path) -> set[str]:
    """Names of the parts that lie in the folder of a table, whether it is finished or not."""
    folder = root / PARTS
    if remote(folder) is None and not folder.is_dir():
        return set()
    return {p.stem for p in folder.iterdir() if p.suffix == ".parquet" and not p.name.startswith(".")}


def refuse_as_table(root: Path, kind: str, inputs: Iterable[Path] = ()) -> None:
    """Raises RescoreError where a table of a kind cannot go to a folder without harm to what is there.

    A folder with such a table, or with the parts of one that was stopped, is as good as an empty one.
    """
    refuse_as_input(root, inputs)
    told = f"{root}: expected a new folder, or {kind} in parts to go on with, got"
    if (root / MANIFEST).is_file():
        found = PartTable.read(root).kind
        if found != kind:
            raise RescoreError(f"{told} {found} in parts; choose another --out")
        return
    if any(map(counted_part, names_there(root))):
        return
    there = root.iterdir() if root.is_dir() else ()
    others = sorted(p.name for p in there if p.name != PARTS and not p.name.startswith("."))
    if others:
        raise RescoreError(f"{told} one that holds {others[0]!r}; choose another --out")


def write_part(root: Path, name: str, groups: Iterable[pa.Table]) -> int:
    """Write a part of one or two groups of rows by a single put; returns its bytes."""
    data = _parquet(groups)
    _put(root, name, data)
    return len(data)


def write_counted_part(root: Path, part: Part, groups: Iterable[pa.Table]) -> Part:
    """Write a part under a name that tells its counts after the one that is given; returns it so named."""
    data = _parquet(groups)
    counts = (part.frames, part.rows, part.failed, len(data))
    name = "-".join([part.name, *map(str, counts)])
    _put(root, name, data)
    return part.model_copy(update={"name": name, "bytes": len(data)})


def counted_part(name: str) -> Part | None:
    """The part of a name that tells its counts; None where it does not."""
    digest, *counts = name.split("-")
    if len(counts) != 4 or not all(c.isdecimal() for c in counts):
        return None
    frames, rows, failed, n_bytes = map(int, counts)
    return Part(name=name, rows=rows, bytes=n_bytes, frames=frames, failed=failed) if digest else None


def _parquet(groups: Iterable[pa.Table]) -> memoryview:
    whole = io.BytesIO()
    writer = None
    for table in groups:
        # a dictionary of numbers, few of which are equal, takes most of the time and makes files larger
        texts = [path for f in table.schema for path in _texts_in(f.name, f.type)]
        writer = writer or pq.ParquetWriter(whole, table.schema, compression="zstd", use_dictionary=texts)
        writer.write_table(table, row_group_size=max(len(table), 1))
    assert writer is not None, "a part has rows of some table"
    writer.close()
    return whole.getbuffer()


def _texts_in(path: str, kind: pa.DataType) -> Iterator[str]:
    """Paths of the columns of texts in a column."""
    if pa.types.is_string(kind):
        yield path
    elif pa.types.is_list(kind):
        yield from _texts_in(f"{path}.list.element", kind.value_type)
    elif pa.types.is_struct(kind):
        for field_of in kind:
            yield from _texts_in(f"{path}.{field_of.name}", field_of.type)


def _put(root: Path, name: str, data: memoryview) -> None:
    with atomic_path(part_file(root, name)) as beside:
        beside.write_bytes(data)


class _Objects(pafs.FileSystemHandler):  # type: ignore[misc]
    """Objects of a store for Arrow, which asks for those that ``parts.json`` names alone."""

    def get_type_name(self) -> str:
        return "rescore.objects"

    def normalize_path(self, path: str) -> str:
        return path

    def get_file_info(self, paths: Sequence[str]) -> list[pafs.FileInfo]:
        return [pafs.FileInfo(p, pafs.FileType.File, size=RemotePath(p).stat().st_size) for p in paths]

    def open_input_file(self, path: str) -> pa.NativeFile:
        return pa.PythonFile(RemotePath(path).open(), mode="r")

    def open_input_stream(self, path: str) -> pa.NativeFile:
        return self.open_input_file(path)

    def get_file_info_selector(self, selector: pafs.FileSelector) -> list[pafs.FileInfo]:
        raise NotImplementedError("parts are named, not looked for")

    def create_dir(self, path: str, recursive: bool) -> None:
        raise NotImplementedError("tables are read through Arrow, not written")

    def delete_dir(self, path: str) -> None:
        self.create_dir(path, recursive=False)

    def delete_dir_contents(self, path: str, missing_dir_ok: bool = False) -> None:
        self.create_dir(path, recursive=False)

    def delete_root_dir_contents(self) -> None:
        self.create_dir("", recursive=False)

    def delete_file(self, path: str) -> None:
        self.create_dir(path, recursive=False)

    def move(self, src: str, dest: str) -> None:
        self.create_dir(dest, recursive=False)

    def copy_file(self, src: str, dest: str) -> None:
        self.create_dir(dest, recursive=False)

    def open_output_stream(self, path: str, metadata: Any) -> None:
        self.create_dir(path, recursive=False)

    def open_append_stream(self, path: str, metadata: Any) -> None:
        self.create_dir(path, recursive=False)
