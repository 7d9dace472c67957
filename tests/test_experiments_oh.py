"""The experiments on Oh's paper: what they set up, judge and conclude."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from many_runs import tracks_of
from trackfield.experiments import oh, oh_network, oh_sweeps, oh_walkers
from trackfield.experiments.results import Interval, mean_interval
from trackfield.metrics.many import score_many
from trackfield.types import Truth


@pytest.fixture(scope="module")
def found():
    shares = []
    result = oh.reproduce(np.random.default_rng(0), quick=True, progress=shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    return result


def test_every_figure_has_its_table(found):
    titles = " ".join(table.title for table in found.tables)
    for name in (
        "Fig. 4",
        "Figs. 6-8",
        "Fig. 10",
        "Loss",
        "Delay",
        "Misplaced",
        "Moves",
        "17-18",
        "Fig. 12",
        "Last capture",
    ):
        assert name in titles
    for table in found.tables:
        assert {len(row) for row in table.rows} == {len(table.columns)}


def test_the_numbers_of_a_table_are_those_of_the_runs(found):
    (table,) = [t for t in found.tables if t.title.startswith("Fig. 10: live")]
    cells = {row[0]: row[1:] for row in table.rows}
    for name, runs in found.network.items():
        assert float(cells[name][0].split()[0]) == pytest.approx(
            np.mean([run.live.sets.gospa_m for run in runs]), abs=0.006
        )
        again = score_many(runs[0].truth, runs[0].tracks)
        assert again.sets == runs[0].live.sets
    assert set(cells) > set(found.network)


def test_source_fits_beat_centroids_and_hindsight_beats_live(found):
    score = {name: runs[0].live.sets.gospa_m for name, runs in found.network.items()}
    assert score[oh_network.OURS.name] < 0.6 * score[oh_network.PAPER_CENTRAL.name]
    lagged = found.network[oh_network.OURS.name][0].lagged
    assert lagged.sets.gospa_m < 0.6 * score[oh_network.OURS.name]


def test_more_loss_and_delay_are_worse(found):
    name = oh_network.OURS.name
    for sweep in (found.sweeps.loss, found.sweeps.delay):
        values = [point.gospa_m[name].value for point in sweep]
        assert values[0] < values[-1]
    lost = [point.lost for point in found.sweeps.loss]
    assert lost[0] == 0.0
    assert lost[-1] > 0.5
    assert len(oh_sweeps.tables(found.sweeps)) == 4


def test_findings_say_what_holds(found):
    said = " ".join(found.findings)
    for word in (
        "Fig. 4",
        "Peeling",
        "fusion",
        "Four groups",
        "Misplaced",
        "tolerates",
        "Walkers",
        "greedy",
        "Robust",
    ):
        assert word in said
    assert found.to_dict()["paper"] == "oh"


def test_every_figure_is_drawn(found, tmp_path):
    figures = found.figures()
    assert {name.split("_")[0] for name in figures} == {
        "fig4", "fig6", "fig7", "fig8", "fig10", "fig11", "fig12", "fig17", "fig18", "fig19",
        "sweeps",
    }  # fmt: skip
    figures["sweeps"].savefig(tmp_path / "sweeps.png")
    assert (tmp_path / "sweeps.png").stat().st_size > 10_000


def test_the_network_leaves_reports_and_truth_alone():
    made = oh_network.field("fit", 3, steps=15)
    runs = [
        oh_network.run(oh_network.OURS, made, oh_network.Conditions(p_loss, 0.0))
        for p_loss in (0.0, 0.5)
    ]
    assert runs[0].passed.sent == runs[1].passed.sent == len(made.reports)
    assert runs[0].passed.lost == 0 < runs[1].passed.lost
    np.testing.assert_array_equal(runs[0].truth.position, runs[1].truth.position)


def walk(step=0.0):
    """Two walkers a hundred metres apart, 30 s each, and tracks that are right."""
    t = np.arange(30.0)
    position = np.concatenate([np.column_stack([t, t, t]), np.column_stack([t + 100, t, t])])
    truth = Truth(np.tile(t, 2), np.repeat([0, 1], 30).astype(np.int32), position, ("a", "b"))
    seen = truth.t_s % 30 >= 3
    return truth, tracks_of(truth.t_s[seen], truth.target[seen] + 1, position[seen, :2] + step)


def test_a_right_run_is_right():
    assert oh_walkers.is_right(*walk())


@pytest.mark.parametrize("fault", ["far", "switch", "extra", "gap", "end", "missing"])
def test_a_run_with_a_fault_is_not(fault):
    truth, tracks = walk(step=7.0 if fault == "far" else 0.0)
    second = tracks.track == 2
    match fault:
        case "switch":
            track = np.where(second & (tracks.t_s > 15), 3, tracks.track).astype(np.int32)
            tracks = replace(tracks, track=track)
        case "extra":
            more = tracks_of(np.arange(10.0, 16.0), [8] * 6, [[50.0, 50.0]] * 6)
            every = [np.concatenate([getattr(tracks, n), getattr(more, n)]) for n in COLUMNS]
            tracks = replace(tracks, **dict(zip(COLUMNS, every, strict=True)))
        case "gap":
            tracks = rows(tracks, ~(second & (tracks.t_s > 8) & (tracks.t_s < 20)))
        case "end":
            tracks = rows(tracks, ~(second & (tracks.t_s == 28)))
        case "missing":
            tracks = rows(tracks, ~second)
    assert not oh_walkers.is_right(truth, tracks)


COLUMNS = ("t_s", "track", "position", "velocity", "covariance", "status", "target", "nis")


def rows(tracks, kept):
    return replace(tracks, **{name: getattr(tracks, name)[kept] for name in COLUMNS})


def test_a_mean_has_the_interval_of_its_runs():
    values = np.random.default_rng(1).normal(5.0, 2.0, 400)
    found = mean_interval(values, np.random.default_rng(2))
    assert found.value == pytest.approx(values.mean())
    half = 1.96 * values.std() / 20.0
    assert found.low == pytest.approx(values.mean() - half, abs=0.1 * half)
    assert found.high == pytest.approx(values.mean() + half, abs=0.1 * half)
    assert Interval(1.234, 1.0, 2.0).text() == "1.23 (1.00 to 2.00)"
