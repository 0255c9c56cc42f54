"""Figures of 3D boxes as metrics.json holds them, made up."""

from rescore.results.metrics_file import (
    BoxErrorFigures,
    Boxes3DRow,
    MeanMedian,
    PoseFigures,
    Precision3D,
)


def boxes3d_level(name: str, value: float | None) -> Precision3D:
    figures = {"0.7": value, "0.5": None if value is None else 2 * value}
    return Precision3D(
        level=name, n_cars=60, in_picture=figures, orientation=figures, from_above=figures, in_space=figures
    )


def boxes3d_row(detector: str, mode: str, *levels: Precision3D) -> Boxes3DRow:
    def pose(whole: bool, high: float | None, share: float | None) -> PoseFigures:
        return PoseFigures(
            whole=whole,
            distance_m=(0.0, high),
            n_found=50,
            n_boxes=40,
            correct_share=share,
            median_translation_m=0.25,
            median_orientation_rad=0.0349,
        )

    return Boxes3DRow(
        detector=detector,
        mode=mode,
        n_boxes=70,
        precision=levels,
        errors=BoxErrorFigures(
            within_m=2.0,
            n_cars=60,
            n_found=44,
            translation_m=MeanMedian(mean=0.5, median=0.3),
            scale=MeanMedian(mean=0.125, median=0.1),
            orientation_rad=MeanMedian(mean=None, median=0.1),
        ),
        poses=(pose(False, None, 0.5), pose(True, 25.0, 0.875)),
    )
