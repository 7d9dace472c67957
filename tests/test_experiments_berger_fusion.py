"""Berger's fusion center: errors against the bound, the paper's way beside ours, what is told."""

import numpy as np
import pytest

from trackfield.experiments import berger, berger_fusion
from trackfield.experiments.berger_fusion_tables import (
    COUNTS,
    METHODS,
    OURS,
    PAPER,
    PARTS,
    RAW,
    BergerFusion,
    FusionErrors,
    GroupingScore,
    findings,
    tables,
)
from trackfield.localization.pass_bounds import pass_bound
from trackfield.sensing.amplitude import AmplitudeModel


@pytest.fixture(scope="module")
def found():
    return berger_fusion.run(np.random.default_rng(1), quick=True)


def test_with_ten_sensors_ours_is_as_good_as_all_samples(found):
    """Eight runs of each SNR: RMSE within a third of the bound, and close to all samples."""
    for name, errors in found.errors.items():
        for c in (COUNTS.index(10), COUNTS.index(20)):
            ours = errors.ratio(OURS, 1, all_runs=True)[c]
            assert np.sqrt(np.mean(ours**2)) == pytest.approx(1.0, abs=0.3), name
            np.testing.assert_allclose(ours, errors.ratio(RAW, 1)[c], rtol=0.15)
            assert errors.lost(OURS)[c].max() == 0.0
            assert errors.truth_weight[c].min() > 0.9


def test_the_paper_way_is_no_better(found):
    for errors in found.errors.values():
        theirs, ours = (errors.error[m, 2:, :, :, 1] for m in (PAPER, OURS))
        assert np.sqrt(np.mean(theirs**2)) > np.sqrt(np.mean(ours**2))
        assert errors.lost(PAPER).sum() >= errors.lost(OURS).sum()


def test_the_bounds_are_those_of_all_samples(found):
    C = pass_bound(
        berger_fusion.THETA,
        berger_fusion.LAYOUT_KM[:5],
        np.arange(25.0),
        models=AmplitudeModel(sigma=10**-0.5),
    ).covariance
    expected = [C[0, 0], C[1, 1] + C[2, 2], C[3, 3] + C[4, 4]]
    bound = found.errors["white"].bound[COUNTS.index(5), 0]
    np.testing.assert_allclose(bound**2, expected)


def test_several_targets_are_told_apart(found):
    assert all(one.right == one.runs for one in found.grouping)
    assert {(one.targets, one.snr_db) for one in found.grouping} == {
        (k, snr) for k in (1, 2, 3) for snr in (10.0, 20.0, 30.0)
    }


def some(error):
    """One part of errors (methods, runs) of x0, with a bound of 1."""
    shape = (len(METHODS), len(COUNTS), 4, error.shape[-1], 3)
    full = np.broadcast_to(error[:, None, None, :, None], shape)
    return FusionErrors(np.ones((len(COUNTS), 4, 3)), full, np.ones(shape[1:4]))


def test_ratios_leave_out_lost_runs_and_say_how_many():
    error = np.ones((len(METHODS), 4))
    error[PAPER] = [1.0, 1.0, 1.0, 7.0]
    error[OURS] = [np.inf] * 4
    errors = some(error)
    assert errors.lost(PAPER)[0, 0] == 0.25
    assert errors.ratio(PAPER, 1)[0, 0] == 1.0
    assert errors.ratio(PAPER, 1, all_runs=True)[0, 0] == pytest.approx(np.sqrt(13.0))
    assert errors.lost(OURS)[0, 0] == 1.0
    assert np.isnan(errors.ratio(OURS, 1)[0, 0])


def test_what_finds_nothing_is_infinitely_wrong():
    assert np.isinf(berger_fusion._off(np.empty((0, 5)))).all()
    np.testing.assert_array_equal(berger_fusion._off(berger_fusion.THETA[None]), 0.0)
    assert berger_fusion._which(berger_fusion.THETA + 9.0, berger_fusion.THETA[None]) == -1


def test_tables_and_findings_tell_it(found):
    for table in tables(found):
        assert {len(row) for row in table.rows} == {len(table.columns)}
    text = " ".join(findings(found))
    for words in ("Figs. 7, 8", "Fig. 11", "Fig. 12", "Three sensors", "Not recoverable", "gate"):
        assert words in text
    assert "nan" not in text


def test_figures_are_drawn(found):
    drawn = berger_fusion.figures(found)
    assert list(drawn) == ["fig7", "fig8", "fig11", "fig12"]
    assert [len(figure.axes) for figure in drawn.values()] == [3, 4, 2, 2]
    lines = drawn["fig11"].axes[0].lines
    assert len(lines) == 4 * len(COUNTS)


def test_the_whole_reproduction_has_both_sides(monkeypatch, found):
    monkeypatch.setattr(berger_fusion, "run", lambda *_, **__: found)
    shares = []
    result = berger.reproduce(np.random.default_rng(2), quick=True, progress=shares.append)
    assert shares
    plain = result.to_dict()
    assert plain["paper"] == "berger"
    titles = " ".join(table.title for table in result.tables)
    for figure in ("Fig. 6", "Fig. 7", "Figs. 7, 8", "Fig. 10", "Fig. 11", "Fig. 12"):
        assert figure in titles
    assert {"fig5", "fig12"} <= set(result.figures())
    assert isinstance(result.fusion, BergerFusion)
    assert isinstance(found.grouping[0], GroupingScore)


def test_progress_goes_to_the_end():
    seen = []
    parts = {"white": PARTS["white"]._replace(snr_db=(30.0,))}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(berger_fusion, "PARTS", parts)
        berger_fusion.run(np.random.default_rng(3), quick=True, tick=lambda: seen.append(1))
        assert len(seen) == berger_fusion.ticks() == 1
