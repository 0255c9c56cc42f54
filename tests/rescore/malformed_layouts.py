"""Malformed data sets of every layout: by name, how each is spoilt and a pattern of what must be said."""

from pathlib import Path
from typing import Any

import numpy as np

from tests.rescore import own_data as own
from tests.rescore.spoiling import (
    INF,
    NAN,
    Spoil,
    annotations,
    camera,
    first,
    raw,
    text,
    twice,
    without,
)

OWN: dict[str, tuple[Spoil, str]] = {
    "cut off": (raw(b'{"images": ['), r"annotations.json: expected a data set .* invalid JSON: EOF"),
    "no byte": (raw(b""), "invalid JSON: EOF"),
    "a list": (raw(b"[]"), r"got input should be"),
    "an empty object": (raw(b"{}"), "images: field required, and 2 more"),
    "null": (raw(b"null"), "got input should be"),
    "a text": (raw(b'"images"'), "got input should be"),
    "utf-16": (raw('{"images": []}'.encode("utf-16")), "annotations: field required"),
    "a picture": (raw(b"\x89PNG\r\n\x1a\n\x00"), "invalid JSON"),
    "deep": (raw(b"[" * 100_000), "invalid JSON: recursion limit"),
    "images a number": (
        annotations(lambda d: d.update(images=3)),
        r"images: input should be a valid .* \(3\)",
    ),
    "no width": (without("images", "width"), r"images\[0\].width: field required"),
    "width 0": (first("images", width=0), r"images\[0\].width: input should be greater than 0 \(0\)"),
    "width negative": (first("images", width=-96), r"images\[0\].width: .*greater than 0"),
    "width half": (first("images", width=96.5), r"images\[0\].width: .*valid integer"),
    "height a word": (first("images", height="tall"), r"images\[0\].height: .*'tall'"),
    "name out of the folder": (
        first("images", name="../1"),
        "expected a name of image 1 of letters .*got '../1'",
    ),
    "split unknown": (first("images", split="dev"), "image 1: expected split .*got 'dev'"),
    "image twice": (twice("images"), "expected each image id once, got 1 twice"),
    "box twice": (twice("annotations"), "expected each annotation id once, got 1 twice"),
    "class twice": (twice("categories"), "expected each category id once, got 1 twice"),
    "no such image": (first("annotations", image_id=77), "annotation 1: .*got image_id 77"),
    "no such class": (first("annotations", category_id=77), "annotation 1: .*got category_id 77"),
    "box with NaN": (first("annotations", bbox=[1, 2, NAN, 4]), r"annotations\[0\].bbox\[2\]: .*finite"),
    "box without end": (first("annotations", bbox=[1, 2, INF, 4]), r"annotations\[0\].bbox\[2\]: .*finite"),
    "box beyond reason": (
        first("annotations", bbox=[1e308, 2, 1e308, 4]),
        r"bbox\[0\]: .*less than or equal",
    ),
    "box inside out": (first("annotations", bbox=[1, 2, -3, 4]), "annotation 1: .*positive sizes"),
    "box of three": (first("annotations", bbox=[1, 2, 3]), r"bbox\[3\]: field required"),
    "box null": (first("annotations", bbox=None), r"annotations\[0\].bbox: .*\(None\)"),
    "number too long": (first("annotations", id=10**30), r"annotations\[0\].id: input should be"),
    "baseline negative": (camera(baseline_m=-0.5), "image 1: .*left and right may be swapped"),
    "focal length 0": (camera(fx=0), "image 1: camera: focal lengths and sizes must be positive"),
    "focal length NaN": (camera(fx=NAN), r"images\[0\].camera.fx: .*finite"),
    "no fy": (annotations(lambda d: d["images"][0]["camera"].pop("fy")), "camera.fy: field required"),
    "camera below ground": (camera(height_m=-1), "image 1: ground plane: the camera must be above"),
    "other classes": (
        annotations(lambda d: d.update(categories=[{"id": 1, "name": "a"}, {"id": 2, "name": "b"}])),
        r"expected a category named 'car', got \['a', 'b'\]",
    ),
    "measures weight": (
        first("images", measured={"file_name": "x.npy", "quantity": "weight"}),
        r"measured.quantity: .*'disparity' or 'depth' \('weight'\)",
    ),
    "factor 0": (
        first("images", measured={"file_name": "x.png", "quantity": "depth", "factor": 0}),
        "x.png: expected a positive factor",
    ),
}


def label(line: str) -> Spoil:
    return text("label_2/000003.txt", f"{own.KITTI_CAR}\n{line}\n")


def calib(old: str, new: str) -> Spoil:
    return text("calib/000003.txt", own.kitti_calib().replace(old, new))


def car(column: int, word: str) -> Spoil:
    words = own.KITTI_CAR.split()
    words[column] = word
    return label(" ".join(words))


LINE = r"label_2/000003.txt:2: "
KITTI: dict[str, tuple[Spoil, str]] = {
    "14 columns": (label("Car 0 0 0 1 2 3 4 1 1 1 1 1 1"), LINE + "expected 15 columns .* got 14"),
    "a word": (car(4, "left"), LINE + "expected a finite number for left, got 'left'"),
    "NaN": (car(5, "nan"), LINE + "expected a finite number for top, got 'nan'"),
    "infinite": (car(6, "inf"), LINE + "expected a finite number for right, got 'inf'"),
    "box inside out": (car(6, "5"), LINE + "expected left < right"),
    "occlusion 7": (car(2, "7"), LINE + "expected truncated up to 1 and occluded in -1 to 3"),
    "no text": (
        lambda root: (root / "label_2" / "000003.txt").write_bytes(b"\xff\xfdCar"),
        "000003.txt: expected lines as text in UTF-8",
    ),
    "no calibration": (
        lambda root: (root / "calib" / "000007.txt").unlink(),
        "calib/000007.txt: expected a calibration, found no file",
    ),
    "no P3": (calib("P3:", "P9:"), "calib/000003.txt: P3: expected 3 x 4 numbers, got no such entry"),
    "11 numbers": (calib(" 0.003", ""), r"calib/000003.txt: P\d: expected 3 x 4 numbers, got 11"),
    "NaN in calibration": (calib("P2: 80.0", "P2: nan"), "000003.txt: P2: expected finite numbers"),
    "word in calibration": (calib("P2: 80.0", "P2: eighty"), "000003.txt: P2: expected numbers, got 'eighty"),
    "cameras swapped": (
        text("calib/000003.txt", own.kitti_calib(baseline_m=-0.5)),
        "000003.txt: .* got a baseline of -0.5; left and right may be swapped",
    ),
    "two focal lengths": (calib("P3: 80.0", "P3: 95.0"), "000003.txt: .*one focal length, got fx 80 and 95"),
    "no right picture": (
        lambda root: (root / "image_3" / "000007.png").unlink(),
        "image_3/000007.png: expected the right picture of 000007.png",
    ),
    "no right folder": (
        lambda root: (root / "image_3").rename(root / "elsewhere"),
        "expected KITTI's right pictures in image_3",
    ),
    "no pictures": (
        lambda root: [p.unlink() for p in (root / "image_2").iterdir()],
        r"image_2: expected pictures .* found none",
    ),
    "no picture": (
        lambda root: (root / "image_2" / "000003.png").write_text("hello"),
        "image_2/000003.png: expected a picture, could not read it .ValueError: its head",
    ),
    "one name twice": (
        lambda root: own.write_png(root / "image_2" / "000003.jpg", own.pair()[0]),
        "expected one file of the name '000003', got 000003.jpg and 000003.png",
    ),
    "split of a stranger": (
        text("ImageSets/train.txt", "000004\n"),
        "train.txt:1: expected the name of a picture, got '000004'",
    ),
}


def yaml(**values: np.ndarray[Any, Any] | float) -> Spoil:
    return text("calib.yaml", own.opencv_yaml(values))


def depth(root: Path) -> None:
    """Depth in place of right pictures."""
    (root / "right").rename(root / "depth")


VOC = "<annotation>{}</annotation>"
OBJECT = "<object><name>car</name>{}</object>"
CORNERS = "<bndbox><xmin>9</xmin><ymin>1</ymin><xmax>{}</xmax><ymax>5</ymax></bndbox>"
K = np.array([[own.FX, 0, 48], [0, own.FX, 32], [0, 0, 1]])
PLAIN: dict[str, tuple[Spoil, str]] = {
    "calibration of nothing": (
        text("calib.yaml", "%YAML:1.0\n---\nname: 3\n"),
        "calib.yaml: expected a calib",
    ),
    "calibration cut off": (
        text("calib.yaml", "%YAML:1.0\n---\nP1: !!opencv-matrix\n   ro"),
        "calib.yaml: exp",
    ),
    "calibration of bytes": (
        lambda root: (root / "calib.yaml").write_bytes(b"\xff\xfd\x00"),
        "calib.yaml: expected a calibration as text",
    ),
    "calibration without baseline": (yaml(cameraMatrix=K), "calib.yaml: expected a calibrated pair"),
    "calibration of 2 x 2": (
        yaml(cameraMatrix=np.eye(2)),
        "calib.yaml: cameraMatrix: expected 3 x 3 numbers",
    ),
    "calibration of another size": (
        yaml(cameraMatrix=K, baseline=0.5, imageSize=np.array([640, 480], np.int32)),
        "calib.yaml: expected the calibration of pictures of 96 x 64 pixels, got that of 640 x 480",
    ),
    "Q of zeros": (yaml(Q=np.zeros((4, 4))), r"calib.yaml: Q: expected Q\[2, 3\] > 0"),
    "focal length negative": (yaml(K1=-K, baseline=0.5), "calib.yaml: expected positive focal lengths"),
    "two calibrations": (
        lambda root: (root / "calib.yaml").rename(root / "a.yaml") and text("b.yaml", "")(root),
        "expected one calibration.*found a.yaml, b.yaml",
    ),
    "other names": (
        lambda root: [p.rename(p.with_stem(f"x{p.stem}")) for p in (root / "right").iterdir()],
        "right: expected files of the names in left, as 'a', got 'xa'",
    ),
    "no right pictures": (
        lambda root: [p.unlink() for p in (root / "right").iterdir()],
        r"right: expected pictures .* found none",
    ),
    "depth without unit": (depth, "depth: expected to be told the value of one metre"),
    "depth without calibration": (
        lambda root: (
            [depth(root), (root / "calib.yaml").unlink()]
            + [np.save((root / "depth" / f"{s}.npy"), np.ones((64, 96))) for s in "ab"]
            + [p.unlink() for p in (root / "depth").glob("*.png")]
        ),
        "expected a calibration to use depth in metres, found none",
    ),
    "XML cut off": (
        text("Annotations/a.xml", "<annotation><object>"),
        "a.xml: expected VOC XML, got damaged",
    ),
    "XML of a page": (text("Annotations/a.xml", "<html/>"), "a.xml: expected VOC's element.*got 'html'"),
    "XML of another picture": (
        text("Annotations/a.xml", VOC.format("<size><width>9</width><height>9</height></size>")),
        "a.xml: expected boxes in a picture of 96 x 64 pixels, got one of 9 x 9",
    ),
    "XML without box": (
        text("Annotations/a.xml", VOC.format(OBJECT.format(""))),
        "a.xml: object 1: expected name",
    ),
    "XML box inside out": (
        text("Annotations/a.xml", VOC.format(OBJECT.format(CORNERS.format(2)))),
        "a.xml: object 1: expected left < right",
    ),
    "XML box of NaN": (
        text("Annotations/a.xml", VOC.format(OBJECT.format(CORNERS.format("nan")))),
        "a.xml: object 1: expected a finite number",
    ),
    "YOLO without names": (
        text("labels/a.txt", "0 .5 .5 .1 .1\n1 .5 .5 .1 .1\n"),
        "labels: expected the names of YOLO's cl",
    ),
    "YOLO names of bytes": (
        lambda root: [
            text("labels/a.txt", "0 .5 .5 .1 .1\n")(root),
            (root / "data.yaml").write_bytes(b"names: [\xff]"),
        ],
        "data.yaml: expected names of classes as text in UTF-8",
    ),
    "YOLO names none": (
        lambda root: [text("labels/a.txt", "0 .5 .5 .1 .1\n")(root), text("data.yaml", "nc: 3\n")(root)],
        "data.yaml: expected names of classes, found none",
    ),
} | {
    name: (
        lambda root, line=line: [text("labels/a.txt", line)(root), text("labels/classes.txt", "car\n")(root)],
        "labels/a.txt:1: " + message,
    )
    for name, line, message in (
        ("YOLO in pixels", "0 48 32 10 10", r"expected shares of the picture in \[0, 1\]"),
        ("YOLO class 3", "3 .5 .5 .1 .1", "expected a class number of 0 to 0, got '3'"),
        ("YOLO of four", "0 .1 .1 .2", "expected YOLO's class.* or a polygon, got 4 columns"),
        ("YOLO NaN", "0 nan .5 .1 .1", "expected a finite number for x"),
    )
}
