import io
import json
import tracemalloc
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from recon.errors import RescoreError
from recon.reading import MAX_ARRAY_BYTES, array_of, arrays_of, json_of, reading, refuse_large_picture


def fail(error: BaseException) -> None:
    with reading("x.bin", "a thing", "write it again"):
        raise error


@pytest.mark.parametrize(
    "error",
    [
        RecursionError("deep"),
        zlib.error("Error -3"),
        MemoryError(),
        Image.DecompressionBombError("large"),
        OverflowError("int too large"),
        UnicodeDecodeError("utf-8", b"\xff", 0, 1, "invalid start byte"),
        KeyError("image_id"),
        zipfile.BadZipFile("no zip"),
        ZeroDivisionError(),
        AttributeError("'list' object has no attribute 'items'"),
    ],
)
def test_whatever_a_reader_raises_is_one_line(error: Exception) -> None:
    with pytest.raises(
        RescoreError, match=r"^x\.bin: expected a thing, could not read it \(\w+.*\); write"
    ) as e:
        fail(error)
    assert "\n" not in str(e.value)
    assert type(error).__name__ in str(e.value)


def test_what_is_no_fault_of_the_file_passes() -> None:
    with pytest.raises(RescoreError, match=r"^own$"):
        fail(RescoreError("own"))
    with pytest.raises(KeyboardInterrupt):
        fail(KeyboardInterrupt())
    with pytest.raises(RescoreError, match=r"\(Permission denied\)"):
        fail(PermissionError(13, "Permission denied"))


@pytest.mark.parametrize("text", [b"[" * 100_000, b"9" * 5000, b"\xff\xfe", b"{", b"", b"1e5000" * 2])
def test_damaged_json_is_one_line(tmp_path: Path, text: bytes) -> None:
    (tmp_path / "a.json").write_bytes(text)
    with pytest.raises(RescoreError, match=r"a\.json: expected a value as JSON, could not read it"):
        json_of(tmp_path / "a.json", "a value", "mend it")


def npy(shape: str, kind: str = "<f8", data: bytes = b"") -> bytes:
    head = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}"
    head = head.ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head.encode() + data


@pytest.mark.parametrize("shape", ["(100000, 100000)", "(4294967296, 4294967296, 1)", "(2,)", "(-3,)"])
def test_an_array_that_claims_more_than_there_is_takes_no_memory(tmp_path: Path, shape: str) -> None:
    (tmp_path / "a.npy").write_bytes(npy(shape, data=b"12345678"))
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as packed:
        packed.writestr("a.npy", npy(shape, data=b"12345678"))
    tracemalloc.start()
    for name, read in (("a.npy", array_of), ("a.npz", arrays_of)):
        with pytest.raises(ValueError, match="an array of shape"):
            read(tmp_path / name)
    assert tracemalloc.get_traced_memory()[1] < 2e6
    tracemalloc.stop()


def test_arrays_come_back_as_they_were(tmp_path: Path) -> None:
    values = {"a": np.arange(6.0).reshape(2, 3), "none": np.zeros((0, 4), np.uint8), "one": np.array("text")}
    np.savez_compressed(tmp_path / "a.npz", **values)
    read = arrays_of(tmp_path / "a.npz")
    assert list(read) == list(values)
    for name, value in values.items():
        np.testing.assert_array_equal(read[name], value)
        assert read[name].dtype == value.dtype
        np.save(tmp_path / "a.npy", value)
        np.testing.assert_array_equal(array_of(tmp_path / "a.npy"), value)


def test_objects_are_not_unpickled(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.array([{}], dtype=object), allow_pickle=True)
    with pytest.raises(ValueError, match="Object arrays cannot be loaded"):
        array_of(tmp_path / "a.npy")


def test_a_zip_that_unpacks_to_too_much_is_refused_from_its_list(tmp_path: Path) -> None:
    member = zipfile.ZipInfo("a.npy")
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as packed:
        packed.writestr(member, b"0" * 1000)
    raw = (tmp_path / "a.npz").read_bytes()
    # the unpacked size, in the list at the end of the file
    place = raw.index(b"PK\x01\x02") + 24
    raw = raw[:place] + (MAX_ARRAY_BYTES + 1).to_bytes(4, "little") + raw[place + 4 :]
    (tmp_path / "a.npz").write_bytes(raw)
    with pytest.raises(ValueError, match=f"{MAX_ARRAY_BYTES + 1} bytes of arrays, at most"):
        arrays_of(tmp_path / "a.npz")


def bomb(width: int, height: int) -> bytes:
    """A PNG of one colour that says it has this size; its rows are missing."""
    written = io.BytesIO()
    Image.new("L", (1, 1)).save(written, "PNG")
    raw = bytearray(written.getvalue())
    raw[16:24] = width.to_bytes(4, "big") + height.to_bytes(4, "big")
    raw[29:33] = zlib.crc32(raw[12:29]).to_bytes(4, "big")
    return bytes(raw)


@pytest.mark.parametrize("size", [(20_000, 20_000), (12_000, 9_000), (2**31 - 1, 2**31 - 1)])
def test_a_picture_of_too_many_pixels_is_refused_from_its_head(
    tmp_path: Path, size: tuple[int, int], recwarn: pytest.WarningsRecorder
) -> None:
    with pytest.raises(RescoreError, match=r"a\.png: expected a picture of at most 100 million pixels, got "):
        refuse_large_picture(tmp_path / "a.png", bomb(*size))
    assert not recwarn.list
    assert refuse_large_picture(tmp_path / "a.png", bomb(10_000, 10_000)) == (10_000, 10_000)


def test_json_values_come_back(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text(json.dumps({"é": [1, None]}), encoding="utf-8")
    assert json_of(tmp_path / "a.json", "a value", "mend it") == {"é": [1, None]}
    with pytest.raises(RescoreError, match="found no file"):
        json_of(tmp_path / "b.json", "a value", "mend it")
