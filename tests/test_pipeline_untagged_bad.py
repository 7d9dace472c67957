"""Bad input for the operator of unknown targets: clear errors or counted drops, bounded work."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from plain_associator import PlainAssociator
from trackfield.errors import ConfigurationError, InputError
from trackfield.network.channel import Channel
from trackfield.network.site import ReportSettings
from trackfield.pipeline.scene import scene, watched
from trackfield.raster import Raster
from trackfield.sensing.signal import SignalModel
from trackfield.types import Readings, select_rows
from untagged_runs import REGION, assert_same_rows, joined, operator, run, site, table, walkers

STEADY = [(0.5 * k, 10.0 + 0.1 * k, 20.0) for k in range(40)]


def test_reports_outside_the_region_are_counted_but_not_those_on_its_border():
    told, untold = site(), site(reports=ReportSettings(region=REGION, step_s=0.5))
    border, beyond = (5.0, -1.19, 5.0), (5.0, 61.21, 5.0)  # four sigmas of .3 m
    tracker = operator(told)
    rows = run(tracker, table(STEADY), table([(19.5, -1.19, 5.0), (19.5, 61.21, 5.0)]))
    assert tracker.counts["outside"] == 1
    assert tracker.counts["accepted"] == 41
    assert_same_rows(rows, run(operator(), table([*STEADY, (19.5, -1.19, 5.0)])))
    strict = operator(untold)
    run(strict, table([border, beyond]))
    assert (strict.counts["outside"], strict.counts["accepted"]) == (2, 0)
    wide = table([beyond])
    sure = replace(wide, covariance=np.array([[9.0, 0.0, 1.0]]))
    own = operator(untold)
    run(own, sure)
    assert own.counts["outside"] == 0  # its own sigma is 3 m


@pytest.mark.parametrize(
    ("column", "value", "said"),
    [
        ("t_s", np.nan, "report 3: found t_s nan, expected a finite number"),
        ("t_s", np.inf, "report 3: found t_s inf, expected a finite number"),
        ("position", np.nan, "report 3: found x_m nan, expected a finite number"),
    ],
)
def test_numbers_that_are_none_are_refused_and_nothing_is_taken(column, value, said):
    tracker = operator()
    tracker.process(table(STEADY[:10]))
    before = tracker.snapshot()
    bad = table(STEADY[10:20])
    getattr(bad, column)[2] = value
    with pytest.raises(InputError, match=said):
        tracker.process(bad)
    assert tracker.snapshot() == before


@pytest.mark.parametrize(
    "covariance", [[-1.0, 0.0, 1.0], [1.0, 2.0, 1.0], [0.0, 0.0, 1.0], [np.inf, 0.0, 1.0]]
)
def test_a_covariance_that_is_none_is_refused(covariance):
    bad = replace(table(STEADY[:2]), covariance=np.array([[1.0, 0.0, 1.0], covariance]))
    with pytest.raises(InputError, match=r"report 2: found covariance .* expected xx, xy, yy of a"):
        operator().process(bad)


def test_tables_of_something_else_and_watermarks_that_are_no_time_are_refused():
    with pytest.raises(InputError, match="found list, expected Reports"):
        operator().process([])
    for wrong in (np.nan, np.inf):
        with pytest.raises(InputError, match="watermark_s: found"):
            operator().process(table(STEADY), watermark_s=wrong)


@pytest.mark.parametrize(
    "options",
    [
        {"lag_s": -1.0},
        {"lag_s": np.nan},
        {"lag_steps": 1.5},
        {"lag_steps": 2000},
        {"every_s": np.inf},
        {"lag_s": "late"},
    ],
)
def test_lags_that_cannot_be_are_refused(options):
    with pytest.raises(ConfigurationError, match="expected finite numbers, 0 or more"):
        operator(**options)


def test_a_site_must_say_or_span_a_region_and_have_a_step():
    with pytest.raises(ConfigurationError) as caught:
        operator(site(reports=ReportSettings()))
    assert [problem.split(": ")[1] for problem in caught.value.problems] == [
        "reports.region",
        "reports.step_s",
    ]
    with pytest.raises(ConfigurationError, match="network: found no sensors"):
        operator(site(network=Channel()))


def test_sensors_span_a_region():
    grid = np.array([(x, y, np.nan) for x in (0.0, 10.0) for y in (0.0, 5.0)])
    field = site(
        sensor_ids=tuple("ABCD"),
        positions=grid,
        models=(SignalModel(),) * 4,
        reports=ReportSettings(step_s=1.0),
    )
    margin = 0.5 * np.sqrt(50.0 / 4.0)
    assert watched(field) == pytest.approx((-margin, -margin, 10.0 + margin, 5.0 + margin))
    assert watched(replace(field, positions=grid[:1])) is None
    line = replace(field, positions=grid * [1.0, 0.0, 1.0])
    assert watched(line) is None


def test_a_network_makes_detection_grow_with_age():
    grid = np.array([(x, y, np.nan) for x in (5.0, 30.0, 55.0) for y in (10.0, 30.0)])
    field = site(
        sensor_ids=tuple("ABCDEF"),
        positions=grid,
        models=(SignalModel(),) * 6,
        network=Channel(p_loss=0.2, p_delay=0.5, delay_step_s=0.5),
        reports=ReportSettings(region=REGION, step_s=0.5, p_detection=0.9),
    )
    ages = scene(field).reporting.p_detection
    assert ages is not None
    assert len(ages) > 3
    means = [age.mean() for age in ages if isinstance(age, Raster)]
    assert means[0] == pytest.approx(0.9 * 0.8 * 0.5)
    assert means == sorted(means)
    assert means[-1] == pytest.approx(0.9 * 0.8, abs=1e-3)
    sure = replace(field, reports=replace(field.reports, p_detection=None))
    assert scene(sure).reporting.p_detection[0].mean() == pytest.approx(0.8 * 0.5)
    assert scene(replace(sure, network=None)).reporting.p_detection is None
    assert scene(replace(field, network=None)).reporting.p_detection == (0.9,)
    assert scene(replace(sure, network=None), of_signals=True).reporting.p_detection == (0.98,)


def test_over_a_network_arrival_closes_steps():
    grid = np.array([(5.0, 10.0, np.nan), (55.0, 30.0, np.nan)])
    field = site(
        sensor_ids=("A", "B"),
        positions=grid,
        models=(SignalModel(),) * 2,
        network=Channel(p_delay=0.5, delay_step_s=0.5),
    )
    # The report of .5 s arrives at 1.6 s: by then the steps of .5 and 1 s are over.
    rows = table([(0.0, 10.0, 20.0, 0.1), (1.0, 10.4, 20.0, 1.1), (0.5, 10.2, 20.0, 1.6)])
    live = operator(field)
    told = run(live, rows)
    assert live.counts["delayed"] == 1
    assert told.t_s.tolist() == [1.0]
    wild = operator(field)  # an arrival far ahead says nothing
    told = run(wild, table([(0.0, 10.0, 20.0, 0.1), (0.5, 10.2, 20.0, 1e9)]))
    assert wild.counts["steps"] == 2


@pytest.mark.parametrize("jump_s", [1e3, 1e9, 1e300, -1e9])
@pytest.mark.parametrize("at", [0, 1, 20, 40])
def test_a_clock_that_jumps_once_costs_only_its_own_report(jump_s, at):
    wild = [(STEADY[min(at, 39)][0] + jump_s, 30.0, 30.0)]
    rows = [*STEADY[:at], *wild, *STEADY[at:]]
    tracker = operator()
    told = run(tracker, table(rows))
    counts = tracker.counts
    assert counts["accepted"] == 40 + (jump_s < 0 and at == 0)
    assert counts["ahead"] + counts["late"] == 1 - (jump_s < 0 and at == 0)
    # Of two first reports nobody knows which one is wild: then the other one is lost.
    lost = jump_s < 0 and at == 1
    plain = run(operator(), table(STEADY[lost:]))
    same = told.t_s >= 0.0
    np.testing.assert_allclose(told.position[same, :2], plain.position[:, :2])
    np.testing.assert_allclose(told.t_s[same], plain.t_s)


def test_a_clock_that_stays_ahead_does_not_make_all_others_late():
    wild = [(t + 5000.0, 30.0, 30.0) for t, *_ in STEADY]
    rows = [row for pair in zip(STEADY, wild, strict=True) for row in pair]
    tracker = operator()
    assert_same_rows(run(tracker, table(rows)), run(operator(), table(STEADY)))
    assert tracker.counts["ahead"] == 40


def test_a_burst_of_one_wild_time_waits_and_is_dropped():
    burst = [(900.0, 1.0 + 0.01 * k, 1.0) for k in range(300)]
    tracker = operator()
    rows = [*STEADY[:20], *burst, *STEADY[20:]]
    assert_same_rows(run(tracker, table(rows)), run(operator(), table(STEADY)))
    assert tracker.counts["ahead"] == 300


def test_a_field_that_wakes_after_hours_is_believed_at_its_second_step():
    later = [(t + 20_000.0, x, y) for t, x, y in STEADY]
    tracker = operator()
    told = run(tracker, table(STEADY), table(later))
    assert tracker.counts["accepted"] == 80
    assert tracker.counts["ahead"] == 0
    assert np.count_nonzero(told.t_s >= 20_000.0) == 39
    backwards = [*later[1::-1], *later[2:]]  # two steps that came in the wrong order
    swapped = operator()
    run(swapped, table(STEADY), table(backwards))
    assert swapped.counts["accepted"] == 80


def test_a_watermark_confirms_what_waits():
    tracker = operator()
    tracker.process(table(STEADY))
    tracker.process(table([(5000.0, 30.0, 30.0)]), watermark_s=4000.0)
    assert tracker.counts["ahead"] == 0
    tracker.process(table([]), watermark_s=5000.25)
    assert tracker.counts["accepted"] == 41
    lone = operator()
    run(lone, table(STEADY), table([(5000.0, 30.0, 30.0)]))
    assert lone.counts["ahead"] == 1  # nothing ever confirmed it


def test_a_run_of_a_single_moment_is_taken():
    tracker = operator()
    run(tracker, table([(7.0, 5.0, 5.0), (7.0, 9.0, 9.0)]))
    assert (tracker.counts["accepted"], tracker.counts["steps"]) == (2, 1)


def test_a_flood_is_cut_off_and_counted():
    associator = PlainAssociator(6)
    tracker = operator(associator=associator)
    rng = np.random.default_rng(5)
    flood = [(10.0, *rng.uniform((0, 0), (60, 40))) for _ in range(6000)]
    tracker.process(joined(table(STEADY[:20]), table(flood)))
    assert tracker.counts["accepted"] == 5000 + 20
    assert tracker.counts["flooded"] == 1000


def test_a_hundredfold_burst_of_clutter_passes():
    burst = table([(8.0, *place) for place in np.random.default_rng(1).uniform(0, 40, (600, 2))])
    quiet = walkers(seed=2, targets=2, clutter=0.0)
    order = np.argsort(np.concatenate([quiet.t_s, burst.t_s]), kind="stable")
    tracker = operator()
    rows = run(tracker, select_rows(joined(quiet, burst), order))
    assert tracker.counts["accepted"] == len(quiet) + 600
    last = rows.t_s == rows.t_s.max()
    assert np.count_nonzero(rows.status[last] <= 2) <= 3  # the burst leaves no tracks behind


def test_half_the_field_falling_silent_leaves_the_other_half_as_it_was():
    west = [(t, 10.0, 10.0 + 0.5 * t) for t, *_ in STEADY]
    east = [(t, 50.0, 10.0 + 0.5 * t) for t, *_ in STEADY]
    both = [row for pair in zip(west, east, strict=True) for row in pair]
    silenced = [row for row in both if not (row[1] > 30.0 and 5.0 <= row[0] < 15.0)]
    all_there, some_gone = run(operator(), table(both)), run(operator(), table(silenced))

    def of_west(rows):
        return [tuple(p) for p in rows.position[rows.position[:, 0] < 30.0, :2].tolist()]

    assert of_west(some_gone) == of_west(all_there)
    gone = (some_gone.t_s >= 8.0) & (some_gone.t_s < 15.0) & (some_gone.position[:, 0] > 30.0)
    assert not np.any(gone)


def readings(kind="signal", value=1.0, sensor="A", target=-1) -> Readings:
    kinds = ("range", "signal", "detection")
    return Readings(
        t_s=np.zeros(1),
        sensor=np.zeros(1, np.int32),
        value=np.array([value]),
        target=np.array([target], np.int32),
        kind=np.array([kinds.index(kind)], np.int32),
        sigma=np.full(1, np.nan),
        arrival_s=np.full(1, np.nan),
        sensor_ids=(sensor,),
        target_ids=("tag",),
        kinds=kinds,
    )


def test_readings_are_no_reports():
    with pytest.raises(InputError, match="found Readings, expected Reports"):
        operator().process(readings())
