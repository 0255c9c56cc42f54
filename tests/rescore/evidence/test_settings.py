from pathlib import Path

import numpy as np
import pytest

from recon.camera import PinholeCamera, StereoCamera
from recon.errors import RescoreError
from recon.stereo.sgbm import KITTI_SGBM
from rescore.data.frames import DataSet, FrameRecord, Truth
from rescore.evidence.settings import RescoreConfig, automatic_stereo, with_stereo_for


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
    assert automatic_stereo(data_set(1242, 375, kitti)) == KITTI_SGBM
    assert KITTI_SGBM.num_disparities == 208
    # 300 x 2 / 2 = 300 pixels at 2 m, of a picture 320 wide: half is 160
    wide = StereoCamera(PinholeCamera(300.0, 300.0, 159.5, 119.5, 320, 240), 2.0)
    assert automatic_stereo(data_set(320, 240, wide)).num_disparities == 160


def test_the_nearest_depth_wanted_sets_the_search():
    # 384.3 px m: 96.1 px at 4 m is under the tenth of the width, 128; 384.3 px at 1 m takes 400
    data = data_set(1242, 375, StereoCamera(PinholeCamera(721.5, 721.5, 609.6, 172.9, 1242, 375), 0.5327))
    for nearest_m, expected in ((4.0, 128), (2.0, 208), (1.0, 400)):
        config = with_stereo_for(RescoreConfig(nearest_m=nearest_m), data, None)
        assert config.stereo.num_disparities == expected
    assert with_stereo_for(RescoreConfig(nearest_m=1.0), data, 96).stereo.num_disparities == 96
    with pytest.raises(RescoreError, match="nearest_m: expected metres above 0, got 0; try 2"):
        RescoreConfig(nearest_m=0.0)
