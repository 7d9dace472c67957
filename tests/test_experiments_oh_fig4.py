"""Fig. 4 of Oh: the paper's rule gives the paper's errors; the fit beside it."""

import numpy as np

from trackfield.experiments import oh_fig4


def test_the_paper_rule_errs_as_in_the_figure_and_the_fit_errs_less():
    found = oh_fig4.fig4(400, fits=60)
    chance = 2.5 * found.centroid_error_m / found.paper_m
    assert (np.abs(found.centroid_m / found.paper_m - 1.0) <= 0.02 + chance).all()
    assert (found.fit_m[2:] < 0.6 * found.centroid_m[2:]).all()  # where more than a few hear
    assert not found.missed[1:].any()
    assert 0.05 < found.missed[0] < 0.4  # R_s = 1: four sensors hear 4 sigma at best


def test_the_figure_repeats():
    one, two = (oh_fig4.fig4(20, fits=5, seed=1) for _ in range(2))
    for a, b in zip(one, two, strict=True):
        np.testing.assert_array_equal(a, b)
