"""The object in a box from where it is explained best, and whether to believe it."""

from dataclasses import replace

import numpy as np

from recon.arrays import BoolArray, FloatArray, UInt8Array
from recon.camera import PinholeCamera
from recon.class_model import ClassModel
from recon.errors import Failure
from recon.reconstruction.view_selection import ViewChoice, best_view_bin
from rescore.library.single_picture import FoundObject, Photo, find_object
from rescore.library.tail_lamps import tail_costs

_VIEWS_TRIED = 4
_VIEWS_WITHIN = 6.0
"""View bins that cost more nats than the best by this much are not tried."""
_VIEW_WEIGHT = 1.5
"""Weight of what the view bins say beside the shape: the silhouette hardly tells a nose from a tail."""
_LEAST_PROBABILITY = 1e-6
_CUT_PX = 2.0
"""Boxes this near to the left or right edge of the picture are cut by it."""
_DOUBTFUL_NATS = 7.0
"""Shapes that agree worse with picture and box are not to be believed."""
_LEAST_BORDERS = 0.13
"""Borders of shapes agree less than this with the edges of road, bushes and walls: of 28 cars of the first
half of KITTI's road frames 5 % are below, of 29 boxes without a car 83 %."""
_LAMP_CLASS = "car"


def choose_view(rgb: UInt8Array, xyxy_px: FloatArray, model: ClassModel) -> ViewChoice | Failure:
    """The view bin that explains the object in a box (4,) of a picture (h, w, 3) best, or why none does.

    Of cars, tail lamps speak beside what ``best_view_bin`` looks at.
    """
    choice = best_view_bin(rgb, xyxy_px, model)
    if isinstance(choice, Failure) or model.class_name != _LAMP_CLASS:
        return choice
    cost = choice.cost + tail_costs(rgb, xyxy_px, model.bins)
    return replace(choice, cost=cost, view_bin=int(np.nanargmin(cost)))


def find_likeliest(
    photo: Photo,
    xyxy_px: FloatArray,
    choice: ViewChoice,
    model: ClassModel,
    occluded: BoolArray | None = None,
) -> FoundObject | Failure:
    """The object in a box (4,) in 3D, seen from where it is explained best, or why there is none.

    How a box looks does not always tell a side from a corner. Where the class has closed shapes, one is
    fitted from each of the likeliest view bins, and what is known of the view is weighed against how well the
    shape goes with picture and box.

    Args:
        photo: the picture.
        xyxy_px: the box, drawn tightly.
        choice: what ``choose_view`` says of the box.
        model: the class model.
        occluded: pixels (h, w) where something else hides the object (see ``build_instance``).
    """
    solid = model.shape_space is not None and not model.shape_space.is_thin
    near = choice.cost[choice.order] <= choice.cost[choice.view_bin] + _VIEWS_WITHIN
    tried = choice.order[near][: _VIEWS_TRIED if solid else 1].tolist()
    found = [find_object(photo, xyxy_px, view_bin, model, occluded) for view_bin in tried]
    fitted = [one for one in found if isinstance(one, FoundObject) and one.agreement is not None]
    if fitted:
        return min(fitted, key=lambda one: _against(one, choice, model))
    return next((one for one in found if isinstance(one, FoundObject)), found[0])


def _against(one: FoundObject, choice: ViewChoice, model: ClassModel) -> float:
    """What speaks against an object with a closed shape, nats; the view is that of the fitted shape."""
    assert one.agreement is not None
    at, count = one.instance.azimuth_rad / (2 * np.pi) * model.bins.count, model.bins.count
    view = float(np.interp(at, np.arange(count), choice.probability, period=count))
    return one.agreement.nats - _VIEW_WEIGHT * float(np.log(max(view, _LEAST_PROBABILITY)))


def doubt_of(found: FoundObject, xyxy_px: FloatArray, camera: PinholeCamera) -> str | None:
    """Why an object in a box (4,) is not to be believed, in a line; None where nothing speaks against it.

    Of classes without closed shapes nothing is said.
    """
    if found.agreement is None:
        return (
            None if found.closed_failure is None else f"no closed shape fits: {found.closed_failure.detail}"
        )
    if found.borders is not None and found.borders < _LEAST_BORDERS:
        return (
            f"unlikely to be a {found.instance.class_name}: borders of its shape and parts agree by "
            f"{found.borders:.2f} with the edges of the picture, {_LEAST_BORDERS:.2f} or more expected"
        )
    if xyxy_px[0] < _CUT_PX or xyxy_px[2] > camera.width_px - _CUT_PX:
        return "the picture cuts the box, so that length and view are guesses"
    if found.agreement.nats > _DOUBTFUL_NATS:
        return (
            f"silhouette and outline share {found.agreement.overlap:.0%}, and its sides are "
            f"{found.agreement.beside:.0%} off those of the box"
        )
    return None
