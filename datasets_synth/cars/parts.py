"""Names of the parts of a car; label i is the part at index i - 1, label 0 is no part."""

CAR_PARTS = (
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
"""The parts that section 3 treats as planar; a face of the mesh belongs to at most one of them."""

PART_LABEL = {name: i + 1 for i, name in enumerate(CAR_PARTS)}

CAR_GROUPS: dict[str, tuple[str, ...]] = {
    "front": ("front",),
    "hood": ("hood",),
    "top": ("windshield", "roof", "rear_window"),
    "rear": ("trunk", "rear"),
    "left_side": ("left_body", "left_windows", "front_left_wheel", "rear_left_wheel"),
    "right_side": ("right_body", "right_windows", "front_right_wheel", "rear_right_wheel"),
}
"""Six parts of a car, as many as figure 1 of the report has, each with the parts of CAR_PARTS it holds."""
