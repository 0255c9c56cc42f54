import numpy as np

from datasets_synth.objects.object_classes import labelled_views, object_class
from recon.class_model import ClassModel
from recon.view_bins import ViewBins
from rescore.studies.view_bins import view_confusion


def test_every_photograph_is_counted_once_and_a_seed_repeats():
    chair = object_class("chair")
    bins = ViewBins(4, chair.elevation_rad)
    views = labelled_views(chair, chair.train[:1], bins, 100)
    model = ClassModel("chair", chair.part_names, bins, (), views.views)
    # whoever chooses
    first, second = (view_confusion(chair, model, 2, np.random.default_rng(1), jobs) for jobs in (1, 2))
    assert set(first) == {"level_set", "true_outline"}
    for name, table in first.items():
        assert table.photos == 2
        # azimuths go through the bins in turn
        assert (table.counts[2:] == 0).all()
        np.testing.assert_array_equal(table.counts, second[name].counts)
