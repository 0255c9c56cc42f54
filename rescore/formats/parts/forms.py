"""What tables in parts are: their kinds, and the columns of their rows with types and allowed values."""

from collections.abc import Sequence
from dataclasses import dataclass

import pyarrow as pa
import pyarrow.compute as pc

from rescore.data.boxes3d import BOX_NAMES
from rescore.evidence.candidates import NUMBERS
from rescore.evidence.cues import CUES

FRAMES = "frames"
DETECTIONS = "detections"
RESCORED = "rescored"
CORNERS = ("x0", "y0", "x1", "y1")
BOXES3D = tuple(f"box3d_{name}" for name in BOX_NAMES)
DEVIATIONS = tuple(f"box3d_sd_{name}" for name in BOX_NAMES)
FILES = ("left_file", "right_file", "disparity_file")
CAMERA = ("fx", "fy", "cx", "cy", "baseline_m", "height_m", "pitch_rad", "roll_rad")

OBJECT_SCHEMA = pa.schema(
    {
        "annotation_id": pa.int64(),
        **dict.fromkeys(CORNERS, pa.float64()),
        "ignore": pa.bool_(),
        **dict.fromkeys(("visibility", "azimuth_deg", "truncated"), pa.float64()),
        "occluded": pa.int64(),
        "shape_id": pa.string(),
        **dict.fromkeys(BOXES3D, pa.float64()),
    }
)
"""What is known of an object of a frame."""
FRAME_SCHEMA = pa.schema(
    {
        "image_id": pa.int64(),
        "name": pa.string(),
        "split": pa.string(),
        "width_px": pa.int64(),
        "height_px": pa.int64(),
        **dict.fromkeys(
            (*FILES, "instance_file", "instance_kinds", "measured_file", "quantity"), pa.string()
        ),
        **dict.fromkeys(("factor", *CAMERA, "disparity_offset_px"), pa.float64()),
        "objects": pa.list_(pa.struct(list(OBJECT_SCHEMA))),
    }
)
"""Columns of a part of frames."""
CANDIDATE_SCHEMA = pa.schema(
    {
        "image_id": pa.int64(),
        "rank": pa.int64(),
        **dict.fromkeys((*CORNERS, "detector_score", "likelihood", "posterior"), pa.float64()),
        "status": pa.string(),
        "reason_detail": pa.string(),
        **dict.fromkeys(NUMBERS, pa.float64()),
        **{f"cue_{name}": pa.float64() for name in CUES},
        **dict.fromkeys((*BOXES3D, *DEVIATIONS, "azimuth_deg", "view_probability"), pa.float64()),
        **dict.fromkeys(("ground", "view_bin", "second_view"), pa.string()),
    }
)
"""Columns of a part of detections: the names of candidates.parquet, where that has the same."""


@dataclass(frozen=True)
class Form:
    """What rows must be like."""

    schema: pa.Schema
    filled: tuple[str, ...]
    """Columns of which no value may be empty."""
    shares: tuple[str, ...] = ()
    """Columns whose values lie in [0, 1]."""
    finite: tuple[str, ...] = ()
    """Columns whose values are finite where they are not empty."""

    def shaped(self, rows: pa.Table) -> pa.Table:
        """Rows with the types of the form; columns that it does not know stay as they are.

        Raises:
            ValueError: a column is of another type, or a value of it is not allowed.
        """
        columns = [self._column(name, rows[name]) for name in rows.column_names]
        return pa.table(columns, names=rows.column_names)

    def _column(self, name: str, values: pa.ChunkedArray) -> pa.ChunkedArray:
        if name not in self.schema.names:
            return values
        wanted = self.schema.field(name).type
        if values.type != wanted:
            try:
                values = values.cast(wanted)
            except (pa.ArrowInvalid, pa.ArrowNotImplementedError) as error:
                raise ValueError(f"column {name!r} of {_named(wanted)}, got {values.type}: {error}") from None
        if name in self.filled and values.null_count:
            raise ValueError(f"column {name!r} without empty values, got {values.null_count}")
        if name in self.finite and not pc.all(pc.is_finite(values), min_count=0).as_py():
            raise ValueError(f"column {name!r} of finite numbers, got NaN or infinity")
        if name in self.shares and len(values):
            least, most = pc.min_max(values).as_py().values()
            if not (least >= 0 and most <= 1):
                raise ValueError(f"column {name!r} of numbers in [0, 1], got {least:g} to {most:g}")
        return values


def _named(kind: pa.DataType) -> str:
    """The name of a type; what is in an object is told by its own columns."""
    return "objects" if pa.types.is_list(kind) else str(kind)


_BOXED: Sequence[str] = ("image_id", "rank", *CORNERS, "detector_score")
_NUMBERS_OF_FRAMES = ("factor", *CAMERA, "disparity_offset_px")
FORMS = {
    FRAMES: Form(
        FRAME_SCHEMA,
        filled=("image_id", "split", "width_px", "height_px", "left_file"),
        finite=_NUMBERS_OF_FRAMES,
    ),
    DETECTIONS: Form(CANDIDATE_SCHEMA, filled=tuple(_BOXED), finite=(*CORNERS, "detector_score")),
    RESCORED: Form(
        CANDIDATE_SCHEMA,
        filled=(*_BOXED, "likelihood", "posterior"),
        finite=(*CORNERS, "detector_score"),
        shares=("likelihood", "posterior"),
    ),
}
"""The rows of each kind of table whose columns are known."""
FRAME_STATES = Form(CANDIDATE_SCHEMA, filled=("image_id", "status"))
"""The rows of frames in a part of detections."""
OBJECTS = Form(OBJECT_SCHEMA, filled=("annotation_id", *CORNERS, "ignore"), finite=CORNERS)
"""Objects of frames, a row each."""
