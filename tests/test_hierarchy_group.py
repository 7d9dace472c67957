"""A tracking group and its hand-overs: on time, late, lost, repeated, and in any order."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hierarchy_parts import SPREAD, Believer, believed
from trackfield.association.contract import ReportScan
from trackfield.association.model import Targets
from trackfield.filtering import kalman
from trackfield.hierarchy.group import TrackingGroup
from trackfield.hierarchy.handover import Handover, claims, distances2, newest, predicted
from trackfield.motion import SteppedAcceleration
from trackfield.raster import Region
from trackfield.types import Gaussian

TARGETS = Targets(accel_sigma_m_s2=0.2, lifetime_s=40.0)
REGIONS = (Region(0.0, 0.0, 54.0, 50.0), Region(46.0, 0.0, 100.0, 50.0))


def group(number):
    return TrackingGroup(number, REGIONS, Believer(), TARGETS, 1.0, 0.6)


def scan(t_s, *places):
    n = len(places)
    return ReportScan(
        t_s,
        np.array(places, float).reshape(n, 2),
        np.full((n, 3), np.nan),
        np.arange(n, dtype=np.int32),
    )


def message(target=1, t_s=0.0, x=48.0, y=20.0, existence=0.9, first_s=-5.0, sender=0):
    return Handover(sender, target, t_s, existence, np.array([x, y, 1.0, 0.0]), SPREAD, first_s)


def test_a_message_is_carried_on_by_the_kalman_prediction():
    moved = predicted(message(), 3.0, targets=TARGETS, step_s=1.0)
    belief = Gaussian(message().mean, SPREAD)
    motion = SteppedAcceleration((0.04, 0.04))
    for _ in range(3):
        belief = kalman.predict(belief, motion.transition(1.0), motion.noise(1.0))
    assert_allclose(moved.mean, belief.mean)
    assert_allclose(moved.covariance, belief.covariance)
    assert moved.existence == pytest.approx(0.9 * np.exp(-3 / 40))
    assert predicted(message(), -1.0, targets=TARGETS, step_s=1.0) is not None
    assert predicted(message(), 0.0, targets=TARGETS, step_s=1.0).t_s == 0.0


def test_of_repeated_messages_the_newest_counts_in_any_order():
    sent = [message(t_s=0.0), message(t_s=2.0), message(target=7), message(t_s=1.5, sender=1)]
    for order in itertools.permutations(sent):
        kept = newest(order)
        assert [(m.sender, m.target, m.t_s) for m in kept] == [
            (0, 1, 2.0),
            (0, 7, 0.0),
            (1, 1, 1.5),
        ]


def test_distances_are_those_of_mahalanobis():
    rng = np.random.default_rng(3)
    a, b = rng.normal(size=(2, 4)), rng.normal(size=(3, 4))
    roots = rng.normal(size=(5, 4, 4))
    spreads = roots @ roots.transpose(0, 2, 1) + np.eye(4)
    found = distances2(a, spreads[:2], means=b, covariances=spreads[2:])
    for i, j in itertools.product(range(2), range(3)):
        gap = a[i] - b[j]
        expected = gap @ np.linalg.inv(spreads[i] + spreads[2 + j]) @ gap
        assert found[i, j] == pytest.approx(expected)


def test_claims_pair_each_message_with_one_track_and_none_beyond_the_gate():
    found = believed(0.0, [(1, 10.0, 0.0), (2, 10.5, 0.0), (3, 90.0, 0.0)])
    told = [message(target=8, x=10.4, y=0.0), message(target=9, x=10.1, y=0.0), message(x=50.0)]
    assert claims(told, found, bearers={}) == [(0, 1), (1, 0)]
    # Who bears a name keeps it within the gate, and loses it beyond.
    assert claims(told, found, bearers={8: 0}) == [(0, 0), (1, 1)]
    assert claims(told, found, bearers={8: 2}) == [(0, 1), (1, 0)]
    assert claims([], found, bearers={}) == []
    assert claims(told, believed(0.0, []), bearers={}) == []


def test_a_target_about_to_leave_is_handed_over_and_again_each_step():
    west = group(0)
    state, sent = west.initial(), []
    for t in range(5):
        state, outcome = west.step(state, scan(float(t), (43.0 + t, 20.0)))
        sent.append(
            {to: [m.target for m in messages] for to, messages in outcome.handovers.items()}
        )
    # Of 4 m before the border at x = 50 on, by the predicted next position.
    assert sent == [{}, {}, {1: [1]}, {1: [1]}, {1: [1]}]


def test_the_neighbour_gives_the_target_its_name():
    east = group(1)
    state, outcome = east.step(east.initial(), scan(1.0, (49.0, 20.0)), handed=[message()])
    assert outcome.report.estimates.track.tolist() == [1]
    assert outcome.report.renamed == ()
    assert not state.pending


def test_a_late_hand_over_renames_the_track_that_began_without_it():
    east, handed = group(1), message(t_s=0.0)
    state = east.initial()
    names, renamed = [], []
    for t in range(1, 6):
        late = [handed] if t == 4 else []
        state, outcome = east.step(state, scan(float(t), (48.0 + t, 20.0)), handed=late)
        names.append(outcome.report.estimates.track.tolist())
        renamed.extend(outcome.report.renamed)
    own = 2  # the first name that the second of two groups gives
    assert names == [[own]] * 3 + [[1]] * 2
    assert renamed == [(1, own)]


def test_repeated_and_old_messages_change_nothing():
    east = group(1)
    state, _ = east.step(east.initial(), scan(1.0, (49.0, 20.0)), handed=[message()])
    again = [message(), message(t_s=-3.0)]
    state, outcome = east.step(state, scan(2.0, (50.0, 20.0)), handed=again)
    assert outcome.report.estimates.track.tolist() == [1]
    assert not state.pending


def test_neighbours_that_found_a_target_together_agree_on_the_older_name():
    west, east = group(0), group(1)
    states = [west.initial(), east.initial()]
    under_way = [[], []]
    for t in range(4):
        place = (48.0 + t, 20.0)
        sent = [[], []]
        names = []
        for i, one in enumerate((west, east)):
            states[i], outcome = one.step(states[i], scan(float(t), place), handed=under_way[i])
            names.append(outcome.report.estimates.track.tolist())
            for to, messages in outcome.handovers.items():
                sent[to].extend(messages)
        under_way = sent
    assert names == [[1], [1]]


def test_a_target_that_nobody_finds_is_expected_less_each_step_and_then_given_up():
    east = group(1)
    state, outcome = east.step(east.initial(), scan(1.0), handed=[message(existence=0.9)])
    estimates = outcome.report.estimates
    assert estimates.track.tolist() == [1]
    assert estimates.shown.tolist() == [True]
    assert estimates.detected.tolist() == [False]
    assert_allclose(estimates.mean[0, :2], [49.0, 20.0])
    r = 0.9 * np.exp(-1 / 40)
    assert estimates.existence[0] == pytest.approx(r * 0.4 / (1 - 0.6 * r))
    for t in range(2, 7):
        state, outcome = east.step(state, scan(float(t)))
    assert state.pending == ()
    assert outcome.report.estimates.track.size == 0


def test_two_names_that_one_sender_tells_apart_stay_two():
    east = group(1)
    told = [message(target=1, y=20.0), message(target=3, y=20.3)]
    state, _ = east.step(east.initial(), scan(1.0, (49.0, 20.0), (49.0, 24.0)), handed=told[:1])
    state, outcome = east.step(state, scan(2.0, (50.0, 20.0), (50.0, 24.0)), handed=told)
    assert outcome.report.renamed == ()
    assert 1 in outcome.report.estimates.track


def test_a_name_moves_to_the_track_that_bears_the_target_now():
    east = group(1)
    state, _ = east.step(east.initial(), scan(1.0, (49.0, 20.0)), handed=[message()])
    # The old track is led astray; the target is somewhere else and has a track of its own there.
    state, _ = east.step(state, scan(2.0, (52.9, 20.0), (70.0, 40.0)))
    moved = message(t_s=2.0, x=70.0, y=40.0)
    state, outcome = east.step(state, scan(3.0, (53.9, 20.0), (71.0, 40.0)), handed=[moved])
    estimates = outcome.report.estimates
    assert estimates.mean[estimates.track == 1, 0].tolist() == [71.0]
    assert len(set(estimates.track.tolist())) == 2


def test_names_of_tracks_that_ended_are_forgotten():
    west = group(0)
    state, _ = west.step(west.initial(), scan(0.0, (10.0, 10.0)))
    state, _ = west.step(state, scan(1.0))
    assert state.names == {}


def test_groups_never_give_the_same_name():
    names = []
    for one in (group(0), group(1)):
        state = one.initial()
        for t in range(20):
            state, _ = one.step(state, scan(float(t), (10.0 * (t % 7), 5.0 * (t % 3))))
            names.append({n.target for n in state.names.values()})
    west, east = set().union(*names[:20]), set().union(*names[20:])
    assert len(west) > 10
    assert not west & east
    assert min(west | east) == 1
