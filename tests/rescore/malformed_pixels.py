"""Malformed pictures and measured files of our own layout, and what the doctor must say of each."""

import numpy as np

from tests.rescore import own_data as own
from tests.rescore.spoiling import (
    Spoil,
    annotations,
    camera,
    cut,
    disparity,
    first,
    measured,
    png,
    swapped,
    text,
)

FULL = np.full((own.HEIGHT, own.WIDTH), 1536, np.uint16)
NOISE = np.random.default_rng(0).integers(1, 9999, FULL.shape, dtype=np.uint16)
FLOATS = np.full((own.HEIGHT, own.WIDTH), 6.0)
PIXELS: dict[str, tuple[Spoil, str]] = {
    "picture cut off": (cut(lambda _: None, "left/1.png", 900), "left/1.png: expected a picture that OpenCV"),
    "picture with a wrong byte": (
        lambda root: (root / "left/1.png").write_bytes(
            (root / "left/1.png").read_bytes()[:700] + b"\0\0" + (root / "left/1.png").read_bytes()[702:]
        ),
        "left/1.png: expected a picture that OpenCV",
    ),
    "picture of no byte": (cut(lambda _: None, "left/1.png", 0), "left/1.png: expected a picture"),
    "picture of text": (text("right/1.png", "hello"), "right/1.png: expected a picture"),
    "picture of another size": (png("right/1.png", own.pair()[1][:40]), "right/1.png has 96 x 40 pixels"),
    "picture missing": (lambda root: (root / "left/1.png").unlink(), "image 1: no file .*left/1.png"),
    "sides swapped": (swapped, "left and right are swapped"),
    "baseline in millimetres": (camera(baseline_m=500), "baseline of 500 m .* millimetres, write 0.5"),
    "baseline in centimetres": (camera(baseline_m=50), "baseline of 50 m .* centimetres, write 0.5"),
    "disparity of 8 bits": (
        disparity(FULL.astype(np.uint8)),
        "d.png: expected 16-bit grey.*got a PNG of mode L",
    ),
    "disparity in colour": (disparity(np.dstack([FULL] * 3)), "d.png: expected 16-bit grey"),
    "disparity of another size": (disparity(FULL[:, :50]), "d.png: expected 96 x 64 pixels, got 50 x 64"),
    "disparity cut off": (cut(disparity(FULL), "d.png", 90), "d.png: expected a whole disparity PNG"),
    "disparity with a wrong byte": (
        lambda root: [
            disparity(NOISE)(root),
            (root / "d.png").write_bytes(
                (root / "d.png").read_bytes()[:900] + b"\0\0" + (root / "d.png").read_bytes()[902:]
            ),
        ],
        "d.png: expected a whole disparity PNG",
    ),
    "disparity of zeros": (disparity(0 * FULL), "image 1: no pixel has a disparity"),
    "disparity missing": (first("images", disparity_file_name="d.png"), "image 1: no file .*d.png"),
    "depth of 8 bits": (
        measured("z.png", png("z.png", FULL.astype(np.uint8)), "depth"),
        "z.png: expected 16-bit grey with value = 256 x depth",
    ),
    "depth without camera": (
        lambda root: [
            annotations(
                lambda d: (
                    d["images"][0].pop("camera")
                    and d["images"][0].update(measured={"file_name": "z.npy", "quantity": "depth"})
                )
            )(root),
            np.save(root / "z.npy", FLOATS),
        ],
        "z.npy: expected a calibration to use depth in metres",
    ),
    "PFM cut off": (
        cut(measured("d.pfm", lambda root: own.write_pfm(root / "d.pfm", FLOATS)), "d.pfm", 999),
        "d.pfm: expected a whole grey PFM",
    ),
    "PFM in colour": (measured("d.pfm", text("d.pfm", "PF\n96 64\n-1\nabc")), "d.pfm: .*kind b'PF'"),
    "PFM of another size": (
        measured("d.pfm", lambda root: own.write_pfm(root / "d.pfm", FLOATS[:9])),
        r"d.pfm: expected a disparity file of 96 x 64 values .* shape \(9, 96\)",
    ),
    "NPY of objects": (
        measured("d.npy", lambda root: np.save(root / "d.npy", np.array([{}]), allow_pickle=True)),
        "d.npy: expected a whole NPY array of numbers",
    ),
    "NPY of words": (
        measured("d.npy", lambda root: np.save(root / "d.npy", np.array(["a"]))),
        "d.npy: expected an array of numbers",
    ),
    "NPY cut off": (
        cut(measured("d.npy", lambda root: np.save(root / "d.npy", FLOATS)), "d.npy", 500),
        "d.npy: expected a whole NPY array",
    ),
    "NPY of three axes": (
        measured("d.npy", lambda root: np.save(root / "d.npy", FLOATS[..., None])),
        r"d.npy: .*shape \(64, 96, 1\)",
    ),
    "NPY of infinities": (
        measured("d.npy", lambda root: np.save(root / "d.npy", FLOATS * np.inf)),
        "image 1: no pixel has a disparity",
    ),
    "file of another kind": (measured("d.tiff", text("d.tiff", "x")), "d.tiff: expected a disparity file as"),
}
