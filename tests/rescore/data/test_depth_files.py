"""Files of measured depth: heads of PFM as different tools write them."""

from pathlib import Path

import numpy as np
import pytest

from recon.errors import RescoreError
from rescore.data.depth_files import read_map

VALUES = np.arange(6, dtype=np.float32).reshape(2, 3)


def write(path: Path, head: bytes, order: str) -> Path:
    path.write_bytes(head + np.flipud(VALUES).astype(order).tobytes())
    return path


@pytest.mark.parametrize(
    ("head", "order"),
    [
        (b"Pf\n3 2\n-1.0\n", "<f4"),
        (b"Pf\n3 2\n1.0\n", ">f4"),
        # width and height on two lines, all on one, and lines that end with two characters
        (b"Pf\n3\n2\n-1.000000\n", "<f4"),
        (b"Pf 3 2 -1\n", "<f4"),
        (b"Pf\r\n3 2\r\n-1e0\r\n", "<f4"),
    ],
)
def test_heads_of_pfm(tmp_path: Path, head: bytes, order: str) -> None:
    np.testing.assert_array_equal(read_map(write(tmp_path / "a.pfm", head, order), "depth", 1, 3, 2), VALUES)


@pytest.mark.parametrize(
    ("head", "problem"),
    [
        (b"Pf\n3 2\n", "no head in|values"),
        (b"PF\n3 2\n-1\n", "kind b'PF'"),
        (b"Pf\n3 0\n-1\n", "size 3 x 0"),
        (b"Pf\n3 3\n-1\n", "6 of 9 values"),
        (b"Pf\n999999999 999999999\n-1\n", "6 of 999999998000000001 values"),
        (b"Pf\n3 2\nleft\n", "could not convert"),
    ],
)
def test_pfm_that_is_refused(tmp_path: Path, head: bytes, problem: str) -> None:
    with pytest.raises(RescoreError, match=f"a.pfm: expected a whole grey PFM .*({problem})"):
        read_map(write(tmp_path / "a.pfm", head, "<f4"), "depth", 1, 3, 2)
