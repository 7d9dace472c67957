"""Berger's sensors: fits at the bound, examples, what encoding costs, and what is told of it."""

import numpy as np
import pytest

from trackfield.experiments import berger_local as experiment
from trackfield.experiments.berger_local_tables import BITS, SNR_DB
from trackfield.sensing.profile import Profile


@pytest.fixture(scope="module")
def found():
    return experiment.run(np.random.default_rng(1), quick=True)


def test_the_fits_reach_the_bound(found):
    """RMSE of 100 records: 5 % each of 63, so within a fifth; the median within a third."""
    for name, first in (("fig6", 2), ("fig10_10hz", 0)):
        errors = found.errors[name]
        ratio = (errors.rmse / errors.bound)[first:]
        np.testing.assert_allclose(ratio, 1.0, atol=0.35)
        assert ratio.mean() == pytest.approx(1.0, abs=0.05)
    for errors in found.errors.values():
        np.testing.assert_allclose(errors.median.mean(axis=(0, 1)), 1.0, atol=0.1)
        assert errors.missed.max() <= 0.02
        assert errors.good[2:].min() > 0.9


def test_bounds_fall_with_the_noise_but_not_under_fading(found):
    white, fading = found.errors["fig6"].bound, found.errors["fig10"].bound
    np.testing.assert_allclose(white[0] / white[-1], 10**1.5, rtol=1e-9)
    assert (fading[0] / fading[-1]).max() < 1.5


def test_the_coarse_estimate_is_the_largest_sample_and_the_one_nearest_to_half():
    t_s = np.array([0.0, 1.0, 2.0, 4.0])
    values = np.array([[0.1, 0.6, 1.0, 0.4], [2.0, 0.5, 1.1, 0.0]])
    at = experiment.coarse(t_s, values)
    assert Profile(*(part.tolist() for part in at)) == ([1.0, 2.0], [2.0, 0.0], [1.0, 2.0])
    errors = experiment.run(np.random.default_rng(2), quick=True).errors["fig6"]
    assert (errors.coarse > errors.rmse).mean() > 0.95


def test_encoding_costs_what_the_formula_says(found):
    cost = found.encoding
    fine = [BITS.index(bits) for bits in (10, 12, 16)]
    np.testing.assert_allclose(cost.measured[fine] / cost.told[fine], 1.0, atol=0.1)
    assert (np.diff(cost.told, axis=0) <= 1e-12).all()
    assert cost.measured[BITS.index(12), :3].max() < 1.03


def test_tables_and_findings_tell_it(found):
    tables = experiment.tables(found)
    assert len(tables) == 4
    for table in tables:
        assert {len(row) for row in table.rows} == {len(table.columns)}
    assert len(tables[0].rows) == 3 * len(SNR_DB)
    text = " ".join(experiment.findings(found))
    for words in ("reach the bound", "coarse estimates", "12 bits", "Not recoverable"):
        assert words in text


def test_figures_are_drawn(found):
    figures = experiment.figures(found)
    assert set(figures) == {"fig5", "fig6", "fig9", "fig10", "fig10_10hz", "encoding"}
    assert [len(figure.axes) for figure in figures.values()] == [3, 3, 3, 3, 3, 1]
