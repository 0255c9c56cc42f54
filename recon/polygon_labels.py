"""Part-labelled views of any kind: rendered ones, and a user's own photos labelled with polygons."""

from pathlib import Path

from recon.errors import RescoreError
from recon.part_views import LABELS_FILE, load_part_views
from recon.polygon_files import read_coco_polygons, read_labelme_polygons
from recon.polygon_views import LabelledViews, warnings_of
from recon.view_bins import ViewBins


def read_labelled_views(path: Path, bins: ViewBins | None = None) -> LabelledViews:
    """The part-labelled views at a path, which may be one of four.

    - a folder with ``part_views.json``, or a data set with such a folder ``part_views`` in it;
    - a COCO segmentation file (see ``recon.polygon_files``);
    - a folder of LabelMe files (see there).

    Args:
        path: the file or folder.
        bins: view bins of polygons, None for the defaults; ``part_views.json`` names its own.

    Raises:
        RescoreError: nothing is there, or it is none of these; or something in it cannot be used.
    """
    bins = bins or ViewBins()
    if path.is_file():
        return read_coco_polygons(path, bins)
    for folder in (path, path / "part_views"):
        if (folder / LABELS_FILE).is_file():
            views = load_part_views(folder)
            return LabelledViews(views, None, warnings_of(views))
    if any(path.glob("*.json")):
        return read_labelme_polygons(path, bins)
    raise RescoreError(
        f"{path}: expected {LABELS_FILE}, a COCO segmentation file or a folder of LabelMe files, found none; "
        "check the path"
    )
