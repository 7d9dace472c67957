"""The whole hierarchy as one tracker: names over borders, states as bytes, hindsight, reasons."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from hierarchy_parts import Believer
from trackfield.association.contract import ReportScan
from trackfield.association.model import Reporting, Scene, Targets
from trackfield.errors import StateError
from trackfield.hierarchy.field import tracked_field
from trackfield.raster import Region

SCENE = Scene(
    Reporting(Region(0.0, 0.0, 100.0, 100.0), sigma_m=0.2, p_detection=(0.9,), false_per_scan=1.0),
    Targets(velocity_sigma_m_s=0.5),
)
QUARTERS = np.array([[25.0, 25.0], [75.0, 25.0], [25.0, 75.0], [75.0, 75.0]])


def field(margin_m=None):
    return tracked_field(SCENE, QUARTERS, tracker=lambda _: Believer(), margin_m=margin_m)


def scan(t_s, *places):
    n = len(places)
    number = np.arange(n, dtype=np.int32)
    return ReportScan(t_s, np.array(places, float).reshape(n, 2), np.full((n, 3), np.nan), number)


def walk(one, steps, state=None, start=0):
    """Four targets that walk east, each through two or three of the regions."""
    state = one.initial() if state is None else state
    states = []
    for t in range(start, start + steps):
        places = [(30.0 + t, 20.0), (40.0 + t, 49.0), (2.0 + t, 80.0), (10.0 + t, 51.5)]
        state, _ = one.step(state, scan(float(t), *places))
        states.append(state)
    return states


@pytest.mark.parametrize("margin_m", [0.0, None])
def test_a_target_keeps_its_name_from_region_to_region(margin_m):
    one = field(margin_m)
    seen = [one.estimates(state) for state in walk(one, 50)]
    # A track begins with its first report, and at a border without a margin one step may pass
    # before the neighbour has heard of it.
    names = {tuple(sorted(e.track[e.shown].tolist())) for e in seen[3:]}
    assert len(names) == 1
    assert all(e.shown.sum() == 4 for e in seen)


def test_the_margin_follows_from_the_speed():
    one = field()
    assert one.base.regions[0] == pytest.approx((0.0, 0.0, 58.6, 58.6), abs=1e-9)


def test_states_come_back_from_bytes_and_go_on_the_same():
    one = field()
    states = walk(one, 24)
    again = one.decode(one.encode(states[18]))
    assert one.encode(again) == one.encode(states[18])
    ours, theirs = states[-1], walk(one, 5, again, start=19)[-1]
    assert one.encode(ours) == one.encode(theirs)
    for a, b in zip(one.estimates(ours), one.estimates(theirs), strict=True):
        assert_array_equal(a, b)
    assert one.decode(one.encode(one.initial())).groups == one.initial().groups


def test_other_bytes_are_refused():
    one, other = field(), tracked_field(SCENE, QUARTERS[:2], tracker=lambda _: Believer())
    data = one.encode(walk(one, 3)[-1])
    for wrong in (
        b"",
        b"nonsense",
        data[:-1],
        data + b"x",
        data[:30],
        other.encode(other.initial()),
    ):
        with pytest.raises(StateError):
            one.decode(wrong)
    cut = bytearray(data)
    cut[20] ^= 0xFF
    with pytest.raises(StateError):
        one.decode(bytes(cut))


def test_hindsight_goes_through_the_base_too():
    one = field()
    state = walk(one, 30)[-1]
    now, before = one.estimates(state), one.estimates(state, 2)
    assert before.t_s == now.t_s - 2
    assert_array_equal(before.track, now.track)
    assert_array_equal(before.mean[:, 0], now.mean[:, 0] - 2)


def test_a_track_says_why_it_is_there_under_the_fields_name():
    one = field()
    state = walk(one, 30)[-1]
    for name in one.estimates(state).track.tolist():
        why = one.explain(state, name)
        assert why is not None
        assert why.track == name
    assert one.explain(state, 10_000) is None


def test_late_reports_reach_the_groups_that_hear_of_them():
    one = field()
    state = walk(one, 3)[-1]
    late = [scan(1.0, (10.0, 10.0)), scan(2.0, (90.0, 90.0))]
    _, info = one.step(state, scan(3.0), late)
    assert info.counts["late"] == 2
    assert info.learned == {"p": 0.5}
    assert info.work == 4


def test_names_do_not_depend_on_the_order_of_reports_in_a_scan():
    one = field()
    for order in itertools.permutations(range(3)):
        state = one.initial()
        for t in range(12):
            places = [(44.0 + t, 20.0), (46.0 + t, 30.0), (40.0 + t, 70.0)]
            state, _ = one.step(state, scan(float(t), *(places[i] for i in order)))
        assert len(one.estimates(state).track) == 3
