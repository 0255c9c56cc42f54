"""Tables in parts that others wrote: columns of other types are read, or refused in a line that names one."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from recon.errors import RescoreError
from rescore.formats.labels import ClassMap
from rescore.formats.parts.candidates import read_part_detections
from rescore.formats.parts.frames import count_part_frames, read_frame_parts, truth_of_parts
from rescore.formats.parts.table import PartTable
from rescore.results.evaluate_parts import EvaluatedFrames, evaluate_parts
from tests.rescore.large_tables import write_tables

Change = Callable[[pa.Table], pa.Table]


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Folders of a data set of 20 frames and of its rescored candidates."""
    frames, rescored = write_tables(tmp_path_factory.mktemp("forms"), 20, seed=2)
    return frames.root, rescored.root


def changed(root: Path, to: Path, change: Change) -> PartTable:
    """A copy of a table whose last groups of rows are changed."""
    shutil.copytree(root, to)
    table = PartTable.read(to)
    for part in table.parts:
        file = pq.ParquetFile(table.file(part))
        groups = [file.read_row_group(i) for i in range(file.num_row_groups)]
        groups = [change(group) for group in groups]
        with pq.ParquetWriter(table.file(part), groups[0].schema) as writer:
            for group in groups:
                writer.write_table(group, row_group_size=max(len(group), 1))
    return table


def column(name: str, of: Callable[[pa.ChunkedArray], pa.Array | pa.ChunkedArray]) -> Change:
    def change(rows: pa.Table) -> pa.Table:
        return rows.set_column(rows.schema.get_field_index(name), name, of(rows[name]))

    return change


def as_type(is_own: Callable[[pa.DataType], bool], wanted: pa.DataType) -> Change:
    def change(rows: pa.Table) -> pa.Table:
        schema = [f.with_type(wanted) if is_own(f.type) else f for f in rows.schema]
        return rows.cast(pa.schema(schema))

    return change


def filled(value: object) -> Callable[[pa.ChunkedArray], pa.Array]:
    return lambda values: pa.array([value] * len(values))


@pytest.mark.parametrize(
    "change",
    [
        as_type(pa.types.is_integer, pa.int32()),
        as_type(pa.types.is_integer, pa.uint64()),
        as_type(pa.types.is_string, pa.large_string()),
        as_type(pa.types.is_string, pa.binary()),
        as_type(pa.types.is_string, pa.dictionary(pa.int32(), pa.string())),
        column("image_id", lambda values: values.cast(pa.string())),
        column("image_id", lambda values: values.cast(pa.float64())),
        lambda rows: rows.select(rows.column_names[::-1]).append_column("more", pa.nulls(len(rows))),
    ],
)
def test_columns_of_other_types_say_the_same(
    written: tuple[Path, Path], tmp_path: Path, change: Change
) -> None:
    frames, rescored = written
    known = read_frame_parts(frames, ClassMap("car"))
    data = read_frame_parts(changed(frames, tmp_path / "frames", change).root, ClassMap("car"))
    assert [replace(f, left_path=Path()) for f in data.frames] == [
        replace(f, left_path=Path()) for f in known.frames
    ]
    a, b = (read_part_detections(changed(rescored, tmp_path / "b", change).root, data, None),
            read_part_detections(rescored, known, None))  # fmt: skip
    for name in ("image_id", "rank", "xyxy_px", "score", "likelihood", "cues"):
        np.testing.assert_array_equal(getattr(a.table, name), getattr(b.table, name))
    np.testing.assert_array_equal(a.posterior, b.posterior)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (column("image_id", filled("one")), "column 'image_id' of int64, got string"),
        (column("image_id", filled(1.5)), "column 'image_id' of int64, got double"),
        (column("image_id", filled(None)), "column 'image_id' without empty values, got 20"),
        (column("left_file", filled(None)), "column 'left_file' without empty values"),
        (column("left_file", filled("a\0b")), "'left_file' without a zero byte"),
        (column("split", filled("bogus")), "expected split train, .*, got 'bogus'"),
        (column("width_px", filled(None)), "column 'width_px' without empty values"),
        (column("fx", filled(np.inf)), "column 'fx' of finite numbers"),
        (column("pitch_rad", filled(np.nan)), "column 'pitch_rad' of finite numbers"),
        (column("instance_kinds", filled("[1,2")), "frames of a data set, could not read it"),
        (column("objects", filled(1.0)), "column 'objects' of objects, got double"),
        (column("image_id", filled(7)), "expected each image id once, got 7 twice"),
        (lambda rows: rows.drop_columns(["left_file"]), "no column 'left_file'"),
        (lambda rows: rows.append_column("split", rows["split"]), "2 times"),
    ],
)
def test_a_data_set_that_cannot_be_is_refused(
    written: tuple[Path, Path], tmp_path: Path, change: Change, told: str
) -> None:
    table = changed(written[0], tmp_path / "frames", change)
    with pytest.raises(RescoreError, match=told) as raised:
        read_frame_parts(table.root, ClassMap("car"))
    assert str(table.root) in str(raised.value)
    assert "\n" not in str(raised.value)


def test_frames_of_one_number_are_refused_before_any_is_read(
    written: tuple[Path, Path], tmp_path: Path
) -> None:
    assert count_part_frames(PartTable.read(written[0]), "all") == 20
    assert count_part_frames(PartTable.read(written[0]), "train") == 0
    table = changed(written[0], tmp_path / "frames", column("image_id", filled(7)))
    with pytest.raises(RescoreError, match="got 7 twice"):
        count_part_frames(table, "all")


def test_boxes_of_objects_are_finite(written: tuple[Path, Path], tmp_path: Path) -> None:
    def endless(objects: pa.ChunkedArray) -> pa.Array:
        return pa.array([[o | {"x0": np.inf} for o in of] for of in objects.to_pylist()], objects.type)

    table = changed(written[0], tmp_path / "frames", column("objects", endless))
    for read in (lambda: truth_of_parts(table, "all"), lambda: read_frame_parts(table.root, ClassMap("car"))):
        with pytest.raises(RescoreError, match=r"objects of frames, could not read it .*'x0' of finite"):
            read()


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (column("x0", filled(None)), "column 'x0' without empty values"),
        (column("x1", filled(np.inf)), "column 'x1' of finite numbers"),
        (column("likelihood", filled(None)), "column 'likelihood' without empty values"),
        (column("likelihood", filled(-7.5)), r"column 'likelihood' of numbers in \[0, 1\], got -7.5 to -7.5"),
        (column("posterior", filled(np.nan)), r"column 'posterior' of numbers in \[0, 1\], got nan"),
        (column("likelihood", filled("high")), "column 'likelihood' of double, got string"),
        (lambda rows: rows.drop_columns(["y1"]), "no column 'y1'"),
    ],
)
def test_candidates_that_cannot_be_are_refused(
    written: tuple[Path, Path], tmp_path: Path, change: Change, told: str
) -> None:
    frames, rescored = written
    table = changed(rescored, tmp_path / "rescored", change)
    with pytest.raises(RescoreError, match=told):
        evaluate_parts(EvaluatedFrames.of_parts(PartTable.read(frames), "all"), [table], tmp_path / "run")
    with pytest.raises(RescoreError, match=told):
        read_part_detections(table.root, read_frame_parts(frames, ClassMap("car")), None)


def test_what_a_table_is_about_is_named_where_it_is_missing(written: tuple[Path, Path]) -> None:
    frames = PartTable.read(written[0])
    with pytest.raises(RescoreError, match=r"parts.json: expected 'detector' in 'about', got none"):
        replace(PartTable.read(written[1]), about={}).said("detector")
    odd = replace(PartTable.read(written[1]), about={"detector": "hog", "registration": "odd"})
    with pytest.raises(RescoreError, match=r"expected candidates rescored by paper, .*, got 'odd'"):
        evaluate_parts(EvaluatedFrames.of_parts(frames, "all"), [odd], written[1] / "run")
