"""Data for a recording kept in order, so that another process than the one that writes can prepare it."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import pyarrow as pa
import rerun as rr

_PARTS = ("component", "archetype", "component_type")
"""What names a column."""


class Recorder(Protocol):
    """What takes data at the times that are set: a recording, or a tape."""

    def set_time(self, timeline: str, *, sequence: int) -> None:
        """Set the time of a timeline for what is logged next."""

    def log(self, entity_path: str, entity: rr.AsComponents, *extra: rr.AsComponents) -> None:
        """Take data at an entity path."""


@dataclass(frozen=True)
class _Time:
    timeline: str
    sequence: int


@dataclass(frozen=True, eq=False)
class _Data:
    path: str
    descriptors: tuple[rr.ComponentDescriptor, ...]
    arrays: tuple[pa.Array, ...]


@dataclass(frozen=True, eq=False)
class _Batch:
    """A column as Rerun asks for it."""

    array: pa.Array

    def as_arrow_array(self) -> pa.Array:
        return self.array


class Tape:
    """Times and data in the order in which they came; unlike archetypes it can be pickled."""

    def __init__(self) -> None:
        self._entries: list[_Time | _Data] = []

    def set_time(self, timeline: str, *, sequence: int) -> None:
        """Keep the time of a timeline."""
        self._entries.append(_Time(timeline, sequence))

    def log(self, entity_path: str, entity: rr.AsComponents, *extra: rr.AsComponents) -> None:
        """Keep data."""
        batches = [b for one in (entity, *extra) for b in one.as_component_batches()]
        descriptors = tuple(b.component_descriptor() for b in batches)
        self._entries.append(_Data(entity_path, descriptors, tuple(b.as_arrow_array() for b in batches)))

    def play(self, rec: rr.RecordingStream) -> None:
        """Log all that was kept, with the other times that are set on the recording."""
        for entry in self._entries:
            if isinstance(entry, _Time):
                rec.set_time(entry.timeline, sequence=entry.sequence)
                continue
            pairs = zip(entry.arrays, entry.descriptors, strict=True)
            rec.log(entry.path, [rr.DescribedComponentBatch(_Batch(a), d) for a, d in pairs])

    def __getstate__(self) -> dict[str, Any]:
        """Entries alike are packed as the rows of one stream; ``order`` holds times and numbers of streams.

        In Arrow's own format, as pickled types lose which values may be missing.
        """
        alike: dict[Any, tuple[int, list[_Data]]] = {}
        order: list[_Time | int] = []
        for entry in self._entries:
            if isinstance(entry, _Time):
                order.append(entry)
                continue
            key = entry.path, entry.descriptors, tuple(a.type for a in entry.arrays)
            number, rows = alike.setdefault(key, (len(alike), []))
            rows.append(entry)
            order.append(number)
        return {"order": order, "streams": [_pack(rows) for _, rows in alike.values()]}

    def __setstate__(self, state: dict[str, Any]) -> None:
        streams = [_unpack(stream) for stream in state["streams"]]
        self._entries = [e if isinstance(e, _Time) else next(streams[e]) for e in state["order"]]


def _pack(rows: list[_Data]) -> bytes:
    """Entries of one path whose columns have the same names and types, as a stream of one row an entry."""
    columns, fields = [], []
    for i, descriptor in enumerate(rows[0].descriptors):
        arrays = [row.arrays[i] for row in rows]
        offsets = np.cumsum([0, *map(len, arrays)]).astype(np.int32)
        columns.append(pa.ListArray.from_arrays(offsets, pa.concat_arrays(arrays)))
        fields.append(pa.field(str(i), columns[-1].type, metadata=_name(descriptor)))
    schema = pa.schema(fields, metadata={"path": rows[0].path})
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, schema) as stream:
        stream.write_batch(pa.record_batch(columns, schema=schema))
    return bytes(sink.getvalue().to_pybytes())


def _unpack(stream: bytes) -> Iterator[_Data]:
    """The entries of a stream one after another."""
    batch = pa.ipc.open_stream(stream).read_next_batch()
    path = batch.schema.metadata[b"path"].decode()
    descriptors = tuple(_descriptor(f.metadata) for f in batch.schema)
    ends = [column.offsets.to_pylist() for column in batch.columns]
    for i in range(batch.num_rows):
        slices = (c.values[own[i] : own[i + 1]] for c, own in zip(batch.columns, ends, strict=True))
        # copies, as Rerun takes slices for as large as the whole and cuts chunks early
        yield _Data(path, descriptors, tuple(pa.concat_arrays([a]) for a in slices))


def _name(descriptor: rr.ComponentDescriptor) -> dict[str, str]:
    parts = {part: getattr(descriptor, part) for part in _PARTS}
    return {part: str(value) for part, value in parts.items() if value is not None}


def _descriptor(name: dict[bytes, bytes]) -> rr.ComponentDescriptor:
    component, archetype, component_type = (
        name[part.encode()].decode() if part.encode() in name else None for part in _PARTS
    )
    return rr.ComponentDescriptor(component, archetype=archetype, component_type=component_type)
