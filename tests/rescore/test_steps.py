from pathlib import Path

import numpy as np
import pytest

from recon.camera import PinholeCamera, StereoCamera
from rescore.frames import DataSet, FrameRecord, Truth
from rescore.steps import automatic_stereo


def data_set(width: int, height: int, camera: StereoCamera | None) -> DataSet:
    record = FrameRecord(1, Path("l.png"), Path("r.png"), None, "test", width, height, camera, None)
    none = Truth(np.zeros(0, np.int64), np.zeros((0, 4)), np.zeros(0, bool), np.zeros(0), ())
    return DataSet(Path(), 1, "car", (record,), {1: none})


@pytest.mark.parametrize(("width", "expected"), [(640, 64), (1242, 128), (20, 16)])
def test_without_a_camera_a_tenth_of_the_width_is_searched(width: int, expected: int):
    assert automatic_stereo(data_set(width, 375, None)).num_disparities == expected


def test_with_a_camera_the_search_reaches_two_metres_but_not_over_half_the_picture():
    # 721.5 x 0.5327 / 2 = 192.2 pixels of disparity at 2 m, so disparities 0 to 207
    kitti = StereoCamera(PinholeCamera(721.5, 721.5, 609.6, 172.9, 1242, 375), 0.5327)
    assert automatic_stereo(data_set(1242, 375, kitti)).num_disparities == 208
    # 300 x 2 / 2 = 300 pixels at 2 m, of a picture 320 wide: half is 160
    wide = StereoCamera(PinholeCamera(300.0, 300.0, 159.5, 119.5, 320, 240), 2.0)
    assert automatic_stereo(data_set(320, 240, wide)).num_disparities == 160
