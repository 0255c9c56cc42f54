"""The robot: what precedes a grasp, and a grasp in the engine."""

from datasets_synth.cars.models import cars_of_splits
from recon.errors import Failure
from recon.localization.learn_shapes import ShapeSpaceConfig
from reports.publishing.bench_file import Row
from rescore.grasping.act import execute
from rescore.grasping.cars import experiment_cars, solid_of
from rescore.grasping.choose import Estimate
from rescore.grasping.hands import HANDS
from rescore.grasping.judge import judge
from rescore.grasping.plan import Motion
from rescore.grasping.solids import Solid
from rescore.grasping.trial import placed_car, planned
from rescore.parallel import one_thread
from rescore.studies.localization.learned import TableClassConfig, learn_class
from rescore.studies.localization.segment import empty_table, segment_table
from rescore.studies.localization.trials import TrialConfig, fit_region
from tests.bench.timing import processor_s


def grasping() -> list[Row]:
    """One trial without rendering, and what precedes it: the joint fit to a picture, and the plan."""
    car = experiment_cars(8, "validation")[1]
    placed, solid, hand = placed_car(car, 1, 0, 0), solid_of(car), HANDS["three_fingers"]
    assert isinstance(solid, Solid)
    table_class = learn_class(
        cars_of_splits()["train"][::4],
        TableClassConfig(space=ShapeSpaceConfig(modes=4), heading_pictures=0),
        2,
    )
    config, box = TrialConfig(), placed.placement.box

    def perceived_and_planned() -> Motion:
        with one_thread():
            regions = segment_table(placed.rgb, empty_table(config.segment))
            assert not isinstance(regions, Failure)
            fit = fit_region(placed.rgb, regions[0], table_class, config)
            assert not isinstance(fit, Failure)
        motion = planned(Estimate(fit.box), hand, 0)
        assert isinstance(motion, Motion)
        return motion

    motion = perceived_and_planned()
    plan_s = processor_s(perceived_and_planned)
    grasp_s = processor_s(lambda: judge(execute(motion, hand, solid, box), solid))
    return [
        Row("segmentation, joint fit and plan of a grasp", plan_s, "s", 1.5),
        Row("a grasp in the engine, approach to put down", grasp_s, "s", 0.3),
    ]
