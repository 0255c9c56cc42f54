"""A car of planar polygons whose every plane and centroid is known, and its labelled views."""

import numpy as np

from recon.arrays import FloatArray
from recon.outlines import fill_polygon
from recon.part_views import PartView
from recon.view_bins import ViewBins

PART_NAMES = (
    "front",
    "hood",
    "windshield",
    "roof",
    "rear_window",
    "trunk",
    "rear",
    "left_body",
    "left_windows",
    "right_body",
    "right_windows",
    "front_left_wheel",
    "rear_left_wheel",
    "front_right_wheel",
    "rear_right_wheel",
)


def box_car(length: float = 4.4, width: float = 1.8, height: float = 1.5) -> dict[str, FloatArray]:
    """Polygon (m, 3) of each part in the object frame; all parts planar, the cabin's sides lean inward."""
    x, y = length / 2, width / 2
    low, belt, top = 0.25, 0.6 * height, height
    lean = 0.25
    x_ws, x_rf, x_rr, x_rw = 0.45 * x, 0.15 * x, -0.45 * x, -0.7 * x
    parts = {
        "front": [(x, y, low), (x, -y, low), (x, -y, belt - 0.1), (x, y, belt - 0.1)],
        "hood": [(x, y, belt - 0.1), (x, -y, belt - 0.1), (x_ws, -y, belt), (x_ws, y, belt)],
        "windshield": [(x_ws, y, belt), (x_ws, -y, belt), (x_rf, -y + lean, top), (x_rf, y - lean, top)],
        "roof": [
            (x_rf, y - lean, top),
            (x_rf, -y + lean, top),
            (x_rr, -y + lean, top),
            (x_rr, y - lean, top),
        ],
        "rear_window": [(x_rr, y - lean, top), (x_rr, -y + lean, top), (x_rw, -y, belt), (x_rw, y, belt)],
        "trunk": [(x_rw, y, belt), (x_rw, -y, belt), (-x, -y, belt - 0.05), (-x, y, belt - 0.05)],
        "rear": [(-x, y, belt - 0.05), (-x, -y, belt - 0.05), (-x, -y, low), (-x, y, low)],
        "left_body": [
            (x, y, low),
            (x, y, belt - 0.1),
            (x_ws, y, belt),
            (x_rw, y, belt),
            (-x, y, belt - 0.05),
            (-x, y, low),
        ],
        "left_windows": [(x_ws, y, belt), (x_rf, y - lean, top), (x_rr, y - lean, top), (x_rw, y, belt)],
    }
    angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    for name, at in (("front_left_wheel", 0.62 * x), ("rear_left_wheel", -0.62 * x)):
        parts[name] = [(at + 0.32 * np.cos(t), y + 0.01, 0.32 + 0.32 * np.sin(t)) for t in angle]
    polygons = {name: np.array(p, float) for name, p in parts.items()}
    for name in [n for n in polygons if "left" in n]:
        polygons[name.replace("left", "right")] = polygons[name] * np.array([1.0, -1.0, 1.0])
    return {name: _outward(polygons[name]) for name in PART_NAMES}


def normal_of(polygon: FloatArray) -> FloatArray:
    """Unit normal (3,) of a polygon by Newell's sum over its edges."""
    n = np.cross(polygon, np.roll(polygon, -1, axis=0)).sum(axis=0)
    return np.asarray(n / np.linalg.norm(n))


def centroid_of(polygon: FloatArray) -> FloatArray:
    """Area centroid (3,) of a convex planar polygon, as a fan of triangles."""
    a, b, c = polygon[0], polygon[1:-1], polygon[2:]
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return np.asarray((area[:, None] * (a + b + c) / 3).sum(axis=0) / area.sum())


def _outward(polygon: FloatArray) -> FloatArray:
    middle = np.array([0.0, 0.0, 0.7])
    return polygon if normal_of(polygon) @ (polygon.mean(axis=0) - middle) > 0 else polygon[::-1]


def labelled_view(
    car: dict[str, FloatArray], view_bin: int, bins: ViewBins, width_px: int = 300, instance_id: str = "box"
) -> PartView:
    """The car under scaled orthography: faces turned away are dropped, wheels are drawn last."""
    rotation = bins.view_from_object(view_bin)
    seen = {name: p @ rotation.T for name, p in car.items() if normal_of(p) @ rotation[2] < -0.02}
    points = np.concatenate(list(seen.values()))[:, :2]
    low, size = points.min(axis=0), float(np.ptp(points, axis=0).max())
    scale = width_px / size
    height, width = np.ceil((points.max(axis=0) - low) * scale).astype(int)[::-1] + 8
    labels = np.zeros((height, width), np.uint8)
    # far to near; the wheels lie on the sides
    for name in sorted(seen, key=lambda n: ("wheel" in n, -seen[n][:, 2].mean())):
        labels[fill_polygon((seen[name][:, :2] - low) * scale + 4, height, width)] = (
            PART_NAMES.index(name) + 1
        )
    return PartView(view_bin, labels, instance_id)
