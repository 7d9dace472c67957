"""The base: one track a target, whoever saw it, and what happens when a group is silent."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hierarchy_parts import believed
from trackfield.association.model import Targets
from trackfield.hierarchy.cells import Cells
from trackfield.hierarchy.group import GroupReport
from trackfield.hierarchy.track_fusion import TrackFusion
from trackfield.raster import Region

BASE = TrackFusion(
    Cells(np.array([[25.0, 25.0], [75.0, 25.0]])),
    Targets(lifetime_s=50.0),
    1.0,
    (Region(0.0, 0.0, 55.0, 50.0), Region(45.0, 0.0, 100.0, 50.0)),
)


def report(group, t_s, *rows, renamed=(), **columns):
    return GroupReport(group, believed(t_s, rows, **columns), tuple(renamed))


def shown(estimates):
    return estimates.track[estimates.shown].tolist()


def test_each_group_speaks_of_its_own_cell():
    reports = [
        report(0, 0.0, (1, 10.0, 10.0), (3, 90.0, 10.0)),  # the second is far in the other's cell
        report(1, 0.0, (2, 60.0, 10.0)),
    ]
    _, united = BASE.step(BASE.initial(), 0.0, reports=reports)
    assert shown(united) == [1, 2]


def test_of_two_sights_of_one_name_the_surer_one_stays():
    ours = report(0, 0.0, (1, 50.5, 10.0))
    theirs = report(1, 0.0, (1, 50.7, 10.0), covariance=[np.diag([0.01, 0.01, 0.01, 0.01])])
    _, united = BASE.step(BASE.initial(), 0.0, reports=[ours, theirs])
    assert shown(united) == [1]
    assert_allclose(united.mean[0, 0], 50.7)
    assert united.first_s[0] == 0.0


def test_a_second_name_for_a_target_is_hidden_at_once_and_united_after_two_steps():
    state = BASE.initial()
    seen = []
    for t in range(4):
        place = (50.5 + t, 10.0)
        ours = report(0, float(t), (1, *place), first_s=0.0)
        theirs = report(1, float(t), (2, *place), first_s=1.0)
        state, united = BASE.step(state, float(t), reports=[ours, theirs])
        seen.append(shown(united))
    # The older name is 1, but whoever looks on has seen 2 already.
    assert seen == [[2], [2], [2], [2]]
    assert state.same == {1: 2}


def test_of_two_names_that_nobody_has_seen_the_older_one_stays():
    state = BASE.initial()
    for t in range(3):
        rows = [(1, 47.0, 10.0), (2, 48.0, 20.0)]
        reports = [report(0, float(t), *rows, shown=[True, True])]
        reports += [report(1, float(t), (5, 47.0, 10.0), (6, 48.0, 20.0), first_s=-2.0)]
        state, united = BASE.step(state, float(t), reports=reports)
    assert shown(united) == [1, 2]
    assert state.same == {5: 1, 6: 2}


def test_names_are_parted_again_where_a_group_shows_both():
    state, _ = BASE.step(BASE.initial(), 0.0, reports=[report(1, 0.0, (2, 60.0, 10.0))])
    state, _ = BASE.step(state, 1.0, reports=[report(1, 1.0, (1, 61.0, 10.0), renamed=[(1, 2)])])
    assert state.same == {1: 2}
    both = [report(1, 2.0, (1, 62.0, 10.0), (2, 80.0, 40.0))]
    state, united = BASE.step(state, 2.0, reports=both)
    assert state.same == {}
    assert shown(united) == [1, 2]


def test_two_targets_side_by_side_stay_two():
    state = BASE.initial()
    for t in range(5):
        rows = [(1, 50.5, 10.0), (3, 50.5, 10.4)]
        reports = [
            report(0, float(t), *rows),
            report(1, float(t), (1, 50.5, 10.0), (3, 50.5, 10.4)),
        ]
        state, united = BASE.step(state, float(t), reports=reports)
        assert shown(united) == [1, 3]
    assert state.same == {}


def test_a_late_renaming_changes_nothing_for_who_looks_on():
    state, _ = BASE.step(BASE.initial(), 0.0, reports=[report(1, 0.0, (2, 60.0, 10.0))])
    renamed = [report(1, 1.0, (1, 61.0, 10.0), renamed=[(1, 2)])]
    state, united = BASE.step(state, 1.0, reports=renamed)
    assert shown(united) == [2]
    # Whatever name a group says from now on, it is that target.
    for t, name in ((2.0, 1), (3.0, 2)):
        state, united = BASE.step(state, t, reports=[report(1, t, (name, 60.0 + t, 10.0))])
        assert united.track.tolist() == [2]


def test_the_owner_of_a_place_is_asked_first_and_the_neighbour_where_it_knows_nothing():
    lone = [report(0, 0.0, (1, 52.0, 10.0)), report(1, 0.0)]
    assert shown(BASE.step(BASE.initial(), 0.0, reports=lone)[1]) == [1]
    doubted = [lone[0], report(1, 0.0, (1, 52.0, 10.0), shown=[False])]
    assert shown(BASE.step(BASE.initial(), 0.0, reports=doubted)[1]) == []


def test_a_silent_group_is_believed_for_three_steps():
    state, _ = BASE.step(BASE.initial(), 0.0, reports=[report(1, 0.0, (2, 60.0, 10.0))])
    counts = []
    for t in range(1, 6):
        state, united = BASE.step(state, float(t), reports=[report(0, float(t))])
        counts.append(len(shown(united)))
        if counts[-1]:
            assert_allclose(united.mean[0, 0], 60.0 + t)
            assert united.existence[0] == pytest.approx(0.9 * np.exp(-t / 50))
            assert not united.detected[0]
    assert counts == [1, 1, 1, 0, 0]


def test_old_and_repeated_reports_change_nothing():
    new = report(1, 5.0, (2, 60.0, 10.0))
    state, before = BASE.step(BASE.initial(), 5.0, reports=[new])
    _, after = BASE.step(state, 5.0, reports=[report(1, 3.0, (4, 70.0, 10.0)), new])
    assert after.track.tolist() == before.track.tolist() == [2]


def test_names_that_are_gone_are_forgotten():
    state = BASE.initial()
    for t in range(3):
        place = (50.5, 10.0)
        reports = [report(0, float(t), (1, *place)), report(1, float(t), (2, *place))]
        state, _ = BASE.step(state, float(t), reports=reports)
    for t in range(3, 5):
        state, united = BASE.step(
            state, float(t), reports=[report(0, float(t)), report(1, float(t))]
        )
    assert (state.same, state.suspected) == ({}, {})
    assert united.track.size == 0
