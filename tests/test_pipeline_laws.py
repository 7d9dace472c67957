"""What must hold for every run: cuts, restarts of the program, order, company, places, clocks."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from range_runs import Heard, box, run, scans, table
from range_snapshot import opened
from range_twin import told
from trackfield.pipeline.tagged import Tracker, track
from trackfield.sensing.range import UNCALIBRATED, RangeModel
from trackfield.types import Tracks, join_rows

NUMBERS = ("t_s", "position", "velocity", "covariance", "status", "nis")
COLUMNS = (*NUMBERS, "track", "target")
OUTPUTS = ({}, {"lag_s": 0.4}, {"lag_steps": 3}, {"every_s": 0.25}, {"lag_s": 0.3, "every_s": 0.2})
LEARNS = box(UNCALIBRATED, heights=(0.0, 3.0, 2.0), drop_s=4.0)
SIMPLE = box(RangeModel(sigma_m=0.1), RangeModel(sigma_m=0.1, clock_offset_s=0.03), drop_s=4.0)
SITES = {"learns": LEARNS, "simple": SIMPLE}
few = settings(max_examples=25)
seeds = st.integers(0, 2**32 - 1)


def scene(rng, site, *, targets=("", "x", "y"), steps=40) -> list[Heard]:
    """Several targets at their own uneven times, an outage, late arrivals, duplicates."""
    rows = []
    for i, name in enumerate(targets):
        pauses = rng.choice([0.0625, 0.125, 0.5], steps)
        pauses[steps // 2] = rng.choice([0.5, 3.0, 6.0])
        times = 64.0 + rng.integers(16) / 16 + np.cumsum(pauses)
        rows += run(rng, site, times, late=0.05, target=name or None, phase=float(i))
    rows = arriving(rng, rows, lateness=0.3)
    again = rng.integers(len(rows), size=5)
    return [copy for i, z in enumerate(rows) for copy in ([z, z] if i in again else [z])]


def arriving(rng, rows, *, lateness):
    """Rows in the order in which they come when each is up to `lateness` late."""
    arrival = [z.t + rng.uniform(0.0, lateness) for z in rows]
    return [rows[i] for i in np.argsort(arrival, kind="stable")]


def tracked(site, rows, *, cuts=(), **asked) -> Tracks:
    tracker = Tracker(site, **asked)
    edges = [0, *sorted(cuts), len(rows)]
    parts = [tracker.process(table(site, rows[a:b])) for a, b in pairwise(edges)]
    return join_rows([*parts, tracker.finish()])


def same(a: Tracks, b: Tracks, columns=COLUMNS):
    for name in columns:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)
    if "target" in columns:
        assert a.target_ids == b.target_ids


def of_target(rows: Tracks, name) -> Tracks:
    target = -1 if name is None else rows.target_ids.index(name)
    keep = rows.target == target
    return Tracks(
        **{column: getattr(rows, column)[keep] for column in COLUMNS}, target_ids=rows.target_ids
    )


@few
@given(
    seed=seeds,
    name=st.sampled_from(sorted(SITES)),
    asked=st.sampled_from(OUTPUTS),
    cuts=st.lists(st.integers(0, 250), max_size=12),
)
def test_rows_do_not_depend_on_cuts(seed, name, asked, cuts):
    site = SITES[name]
    rows = scene(np.random.default_rng(seed), site)
    whole = tracked(site, rows, **asked)
    assert len(whole) > 20
    same(tracked(site, rows, cuts=[min(c, len(rows)) for c in cuts], **asked), whole)


def test_one_by_one_is_all_at_once():
    rows = scene(np.random.default_rng(5), LEARNS)
    same(tracked(LEARNS, rows, cuts=range(1, len(rows))), tracked(LEARNS, rows))


@few
@given(
    seed=seeds,
    name=st.sampled_from(sorted(SITES)),
    asked=st.sampled_from(OUTPUTS),
    share=st.floats(0.0, 1.0),
    drain=st.booleans(),
)
def test_a_restored_run_goes_on_bit_by_bit(seed, name, asked, share, drain):
    site = SITES[name]
    rows = scene(np.random.default_rng(seed), site)
    cut = int(share * len(rows))
    first, second = Tracker(site, **asked), Tracker(site, **asked)
    first.process(table(site, rows[: cut // 2]))
    if drain:
        first.process(table(site, rows[cut // 2 : cut]), watermark_s=rows[0].t)
    else:  # rows that nobody took yet are part of the state
        first._add(table(site, rows[cut // 2 : cut]))
    second.process(table(site, rows[:7]))  # what was there is forgotten
    second.restore(first.snapshot())
    rest = table(site, rows[cut:])
    for a, b in ((first.process(rest), second.process(rest)), (first.finish(), second.finish())):
        same(a, b)
    assert first.counts == second.counts
    assert first.heard == second.heard
    assert first.snapshot() == second.snapshot()


@few
@given(seed=seeds, name=st.sampled_from(sorted(SITES)), lateness=st.floats(0.05, 0.99))
def test_late_readings_lead_to_the_state_of_punctual_ones(seed, name, lateness):
    site = SITES[name]
    rng = np.random.default_rng(seed)
    times = 64.0 + np.cumsum(rng.choice([0.0625, 0.125, 0.375, 1.5], 60, p=[0.4, 0.4, 0.15, 0.05]))
    rows = arriving(rng, run(rng, site, times, late=0.1), lateness=lateness)
    late, punctual = Tracker(site), Tracker(site)
    shown = late.process(table(site, rows))
    # Readings of one time count in the order in which they came.
    punctual.process(table(site, sorted(rows, key=lambda z: z.t)))
    shown = join_rows([shown, late.finish()])
    rest = punctual.finish()
    a, b = (opened(t._bank.snapshot()).targets[0].belief for t in (late, punctual))
    assert (a.alive, a.t, a.step, a.slots, a.surprises) == (
        b.alive,
        b.t,
        b.step,
        b.slots,
        b.surprises,
    )
    for part in ("probability", "mean", "covariance", "pool", "heard"):
        np.testing.assert_array_equal(getattr(a, part), getattr(b, part), err_msg=part)
    assert {**late.counts, "rewound": 0} == {**punctual.counts, "rewound": 0}
    assert np.all(np.diff(shown.t_s) > 0)  # nothing shown is shown again
    if shown.t_s[-1] == rest.t_s[-1]:
        np.testing.assert_array_equal(shown.position[-1], rest.position[-1])


@few
@given(seed=seeds, name=st.sampled_from(sorted(SITES)), asked=st.sampled_from(OUTPUTS))
def test_targets_do_not_see_each_other(seed, name, asked):
    site = SITES[name]
    rows = scene(np.random.default_rng(seed), site)
    together = tracked(site, rows, **asked)
    for who in (None, "x", "y"):
        alone = tracked(site, [z for z in rows if z.target == who], **asked)
        same(of_target(together, who), alone, NUMBERS)
        assert len(set(of_target(together, who).track)) == len(set(alone.track))
    numbers = {(t, k) for t, k in zip(together.target, together.track, strict=True)}
    assert len({k for _, k in numbers}) == len(numbers)  # a track belongs to one target


def test_a_whole_run_comes_in_order_of_time():
    shown = tracked(SIMPLE, scene(np.random.default_rng(2), SIMPLE))
    assert np.any(np.diff(shown.t_s) < 0)
    whole = track(SIMPLE, table(SIMPLE, scene(np.random.default_rng(2), SIMPLE)))
    order = np.argsort(shown.t_s, kind="stable")
    for name in COLUMNS:
        np.testing.assert_array_equal(getattr(whole.tracks, name), getattr(shown, name)[order])


def test_a_shifted_clock_moves_nothing_else():
    site = replace(LEARNS, tracker=replace(LEARNS.tracker, drop_s=300.0))
    rows = scene(np.random.default_rng(7), site)
    there = [z._replace(t=z.t + 2.0**20) for z in rows]  # sums stay exact
    a, b = tracked(site, rows, every_s=0.25), tracked(site, there, every_s=0.25)
    same(a, b, [name for name in COLUMNS if name != "t_s"])
    np.testing.assert_array_equal(a.t_s + 2.0**20, b.t_s)


@pytest.mark.parametrize("mirror", [1.0, -1.0])
@pytest.mark.parametrize("site", [LEARNS, SIMPLE], ids=("learns", "simple"))
def test_a_moved_site_moves_its_tracks(site, mirror):
    c, s = np.cos(0.7), np.sin(0.7)
    A = np.array([[c, -s * mirror], [s, c * mirror]])
    shift = np.array([120.0, -45.0])
    moved = np.array(site.positions)
    moved[:, :2] = moved[:, :2] @ A.T + shift
    rows = scene(np.random.default_rng(11), site)
    here, there = tracked(site, rows), tracked(replace(site, positions=moved), rows)
    same(here, there, ["t_s", "status", "track", "target"])
    # A start descends from another grid of points, to within its tolerance.
    np.testing.assert_allclose(there.position[:, :2], here.position[:, :2] @ A.T + shift, atol=1e-3)
    np.testing.assert_allclose(there.velocity[:, :2], here.velocity[:, :2] @ A.T, atol=2e-3)
    xx, xy, yy = here.covariance.T
    P = A @ np.array([[xx, xy], [xy, yy]]).transpose(2, 0, 1) @ A.T
    np.testing.assert_allclose(there.covariance, P[:, [0, 0, 1], [0, 1, 1]], rtol=0.01, atol=1e-4)


def test_the_order_of_sensors_in_the_site_does_not_matter():
    rng = np.random.default_rng(13)
    rows = scene(rng, LEARNS)
    order = rng.permutation(8)
    place = np.argsort(order)
    shuffled = replace(
        LEARNS,
        sensor_ids=tuple(LEARNS.sensor_ids[i] for i in order),
        positions=LEARNS.positions[order],
        models=tuple(LEARNS.models[i] for i in order),
    )
    moved = [z._replace(sensor=int(place[z.sensor])) for z in rows]
    same(tracked(shuffled, moved), tracked(LEARNS, rows))


def test_a_sensor_s_clock_is_set_right():
    """A sensor whose clock is wrong and known gives the rows of one whose clock is right."""
    model = RangeModel(sigma_m=0.1)
    slow = replace(model, clock_offset_s=0.25)
    right, wrong = box(model, model), box(model, slow)
    rows = run(np.random.default_rng(3), right, 64.0 + 0.125 * np.arange(40))
    told_wrong = [z._replace(t=z.t - 0.25 * (z.sensor % 2)) for z in rows]
    same(tracked(wrong, told_wrong), tracked(right, rows))


def test_a_target_s_own_models_take_the_place_of_the_site_s():
    model, other = RangeModel(sigma_m=0.1), RangeModel(sigma_m=0.05, bias_m=0.4)
    plain, special = box(model), box(other)
    both = replace(plain, target_models={"x": special.models})
    rng = np.random.default_rng(4)
    rows = scene(rng, special, targets=("x", "y"))
    together = tracked(both, rows)
    for name, site in (("x", special), ("y", plain)):
        alone = tracked(site, [z for z in rows if z.target == name])
        same(of_target(together, name), alone, NUMBERS)


def test_readings_that_arrived_otherwise_are_taken_as_they_arrived():
    rng = np.random.default_rng(6)
    rows = scene(rng, SIMPLE, targets=("x",))
    arrival = np.array([z.t for z in rows]) + rng.uniform(0, 0.5, len(rows))
    order = np.argsort(arrival, kind="stable")
    asked = replace(table(SIMPLE, rows), arrival_s=arrival)
    tracker = Tracker(SIMPLE)
    found = join_rows([tracker.process(asked), tracker.finish()])
    same(found, tracked(SIMPLE, [rows[i] for i in order]))


@pytest.mark.parametrize("site", [LEARNS, box(RangeModel(sigma_m=0.1))], ids=("learns", "simple"))
def test_scan_by_scan_is_reading_by_reading(site):
    rows = run(np.random.default_rng(8), site, 64.0 + 0.125 * np.arange(40), late=0.1)
    expected = tracked(site, rows)
    tracker, fixes = Tracker(site), []
    for t, scan in scans(rows):
        sensor = np.array([z.sensor for z in scan], np.int32)
        fix = tracker.step(t, sensor, value=np.array([z.value for z in scan]))
        if fix is not None:
            fixes.append(fix)
    for name, found in (
        ("t_s", [f.t_s for f in fixes]),
        ("position", [f[1:4] for f in fixes]),
        ("velocity", [f[4:7] for f in fixes]),
        ("covariance", [f[7:10] for f in fixes]),
        ("nis", [f.nis for f in fixes]),
        ("track", [f.track for f in fixes]),
        ("status", [f.status for f in fixes]),
    ):
        np.testing.assert_array_equal(found, getattr(expected, name), err_msg=name)
    late = tracker.step(60.0, np.array([0], np.int32), value=np.array([5.0]))
    assert late is None
    assert tracker.counts["late"] == 1


def test_a_run_in_which_settings_are_told_is_the_usual_one():
    """The tests' way to change the kernel's settings changes nothing by itself."""
    rows = scene(np.random.default_rng(9), LEARNS)
    tracker, _, _ = told(LEARNS)
    found = join_rows([tracker.process(table(LEARNS, rows)), tracker.finish()])
    same(found, tracked(LEARNS, rows))
