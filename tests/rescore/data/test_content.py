"""One content in two containers, as two versions of Python or of zlib write it, has one digest."""

import io
import zipfile
from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np
import pytest

from recon.errors import RescoreError
from rescore.data.content import content_digest
from rescore.files import digest_of

ARRAYS = {
    "weights": np.linspace(-1, 1, 24).reshape(4, 6),
    "labels": np.arange(5, dtype=np.uint8),
    "name": np.array("hog"),
}
PIXELS = np.random.default_rng(0).integers(0, 256, (20, 31, 3), dtype=np.uint8)


def packed(path: Path, arrays: Mapping[str, np.ndarray], zip64: bool = True, compressed: bool = True) -> Path:
    """An npz whose zip headers and packing are the writer's choice."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED if compressed else zipfile.ZIP_STORED) as file:
        for name, array in arrays.items():
            data = io.BytesIO()
            np.save(data, array)
            # Python 3.11.4 began to write other zip64 headers
            with file.open(f"{name}.npy", "w", force_zip64=zip64) as member:
                member.write(data.getvalue())
    return path


def test_arrays_in_another_zip_are_the_same(tmp_path: Path) -> None:
    np.savez_compressed(tmp_path / "numpy.npz", **ARRAYS)
    files = [
        tmp_path / "numpy.npz",
        packed(tmp_path / "header.npz", ARRAYS, zip64=False),
        packed(tmp_path / "stored.npz", ARRAYS, compressed=False),
        packed(tmp_path / "order.npz", dict(reversed(ARRAYS.items()))),
    ]
    assert len({digest_of(f) for f in files}) == len(files)
    assert len({content_digest(f) for f in files}) == 1


@pytest.mark.parametrize(
    "change",
    [
        {"weights": ARRAYS["weights"] + np.eye(4, 6) * 1e-15},
        {"weights": ARRAYS["weights"].reshape(6, 4)},
        {"labels": ARRAYS["labels"].astype(np.int8)},
        {"more": np.zeros(1)},
    ],
)
def test_other_arrays_differ(tmp_path: Path, change: Mapping[str, np.ndarray]) -> None:
    before = content_digest(packed(tmp_path / "a.npz", ARRAYS))
    assert content_digest(packed(tmp_path / "b.npz", {**ARRAYS, **change})) != before


def test_byte_order_is_packing(tmp_path: Path) -> None:
    for order in ("<", ">"):
        np.save(tmp_path / f"{order}.npy", ARRAYS["weights"].astype(f"{order}f8"))
    assert content_digest(tmp_path / "<.npy") == content_digest(tmp_path / ">.npy")


@pytest.mark.parametrize("pixels", [PIXELS, PIXELS[:, :, 0].astype(np.uint16) * 200])
def test_pixels_of_another_compression_are_the_same(tmp_path: Path, pixels: np.ndarray) -> None:
    for level in (0, 9):
        cv2.imwrite(str(tmp_path / f"{level}.png"), pixels, [cv2.IMWRITE_PNG_COMPRESSION, level])
    assert digest_of(tmp_path / "0.png") != digest_of(tmp_path / "9.png")
    before = content_digest(tmp_path / "0.png")
    assert content_digest(tmp_path / "9.png") == before
    pixels = pixels.copy()
    pixels[3, 4] ^= 1
    cv2.imwrite(str(tmp_path / "9.png"), pixels)
    assert content_digest(tmp_path / "9.png") != before


def test_other_files_are_their_bytes(tmp_path: Path) -> None:
    for name, text in (("a.json", "{}"), ("b.json", "{}"), ("c.json", "{ }")):
        (tmp_path / name).write_text(text)
    same, copy, other = (content_digest(tmp_path / f"{name}.json") for name in "abc")
    assert same == copy != other


@pytest.mark.parametrize("name", ["a.npz", "a.npy", "a.png"])
def test_damage_is_no_content(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    with pytest.raises(RescoreError, match="expected a file, found none"):
        content_digest(path)
    if path.suffix == ".npz":
        packed(path, ARRAYS)
    elif path.suffix == ".npy":
        np.save(path, ARRAYS["weights"])
    else:
        cv2.imwrite(str(path), PIXELS)
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(RescoreError, match=r"expected (whole arrays|a whole PNG).*; write"):
        content_digest(path)
