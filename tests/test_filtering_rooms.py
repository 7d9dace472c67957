"""Rooms told from tracks: the chain against enumeration, hysteresis, cuts, and the home."""

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import benches
from trackfield.errors import InputError
from trackfield.filtering.rooms import (
    RoomRules,
    first_belief,
    follow_rooms,
    next_belief,
)
from trackfield.io.rooms import COLUMNS, write_rooms
from trackfield.network.site import Room
from trackfield.types import Status, Tracks, select_rows

WEST = Room("west", ((0.0, 0.0), (3.0, 0.0), (3.0, 4.0), (0.0, 4.0)))
EAST = Room("east", ((3.0, 0.0), (6.0, 0.0), (6.0, 4.0), (3.0, 4.0)))
HOME = (WEST, EAST)
FLOOR = 0.02


def make_tracks(rows):
    """Tracks of (t, track, x, y, sigma, status)."""
    t, track, x, y, sigma, status = (np.array(column) for column in zip(*rows, strict=True))
    n = t.size
    square = np.square(sigma.astype(float))
    return Tracks(
        t_s=t.astype(float),
        track=track.astype(np.int32),
        position=np.column_stack([x, y, np.full(n, np.nan)]).astype(float),
        velocity=np.zeros((n, 3)),
        covariance=np.column_stack([square, np.zeros(n), square]),
        status=status.astype(np.int32),
        target=np.zeros(n, np.int32),
        nis=np.full(n, np.nan),
        target_ids=("tag",),
    )


def test_the_chain_is_that_of_all_histories_enumerated():
    rng = np.random.default_rng(0)
    rules = RoomRules(settle_s=1.5, stay_s=20.0)
    steps, k = 6, 3
    t = np.cumsum(rng.uniform(0.2, 3.0, steps))
    shares = rng.dirichlet(np.ones(k), steps)
    belief = first_belief(t[0], shares[0])
    for time, share in zip(t[1:], shares[1:], strict=True):
        belief = next_belief(belief, time, share, rules)
    total = np.zeros(k)
    for history in itertools.product(range(k), repeat=steps):
        weight = shares[0][history[0]] + FLOOR
        for n in range(1, steps):
            dt = t[n] - t[n - 1]
            leaves = 1.0 - math.exp(-dt / 20.0)
            stayed = history[n] == history[n - 1]
            weight *= (1.0 - leaves) if stayed else leaves / (k - 1)
            weight *= (shares[n][history[n]] + FLOOR) ** min(dt / 1.5, 1.0)
        total[history[-1]] += weight
    np.testing.assert_allclose(belief.probability, total / total.sum(), rtol=1e-10)


@given(
    st.lists(st.tuples(st.floats(0.0, 30.0), st.integers(0, 2**32 - 1)), min_size=1, max_size=20),
    st.floats(0.5, 0.99),
)
def test_the_shown_room_changes_only_when_another_is_sure(steps, sure):
    rules = RoomRules(sure=sure)
    belief, t = first_belief(0.0, np.array([0.5, 0.3, 0.2])), 0.0
    for dt, seed in steps:
        t += dt
        share = np.random.default_rng(seed).dirichlet(np.ones(3) * 0.3)
        after = next_belief(belief, t, share, rules)
        assert after.probability.sum() == pytest.approx(1.0)
        assert (after.probability > 0.0).all()
        if after.shown != belief.shown:
            assert after.probability[after.shown] >= sure
        belief = after


def test_a_target_that_walks_over_is_told_in_its_new_room_a_little_later():
    t = np.arange(0.0, 40.0)
    x = np.where(t < 20, 1.0, 5.0)
    tracks = make_tracks([(a, 0, b, 2.0, 0.6, Status.CONFIRMED) for a, b in zip(t, x, strict=True)])
    rows, _ = follow_rooms(HOME, tracks)
    assert rows.room[:20].tolist() == [0] * 20
    (change,) = np.flatnonzero(np.diff(rows.room))
    assert 20 <= change + 1 <= 22
    assert rows.room[-1] == 1
    assert rows.probability[-1] > 0.95
    assert rows.room_ids == ("west", "east")


def test_jumping_across_a_wall_and_back_does_not_flip_the_room():
    rng = np.random.default_rng(1)
    t = np.arange(0.0, 600.0)
    x = 2.8 + 0.5 * rng.standard_normal(600)
    tracks = make_tracks([(a, 0, b, 2.0, 0.5, Status.CONFIRMED) for a, b in zip(t, x, strict=True)])
    raw = np.flatnonzero(np.diff((x > 3.0).astype(int))).size
    rows, _ = follow_rooms(HOME, tracks)
    flips = np.flatnonzero(np.diff(rows.room)).size
    assert raw > 150
    assert flips <= 2


def test_outside_of_all_rooms_no_room_is_told():
    tracks = make_tracks([(a, 0, 20.0, 2.0, 0.5, Status.COASTING) for a in range(5)])
    rows, _ = follow_rooms(HOME, tracks)
    assert (rows.room == -1).all()
    assert (rows.probability > 0.9).all()


def test_only_rows_that_are_shown_count():
    rows = [(0, 0, 1.0, 2.0, 0.5, Status.TENTATIVE), (1, 0, 1.0, 2.0, 0.5, Status.CONFIRMED)]
    rows += [(2, 0, 1.0, 2.0, 0.5, Status.COASTING), (3, 0, 5.0, 2.0, 0.5, Status.ENDED)]
    found, beliefs = follow_rooms(HOME, make_tracks(rows))
    assert found.t_s.tolist() == [1.0, 2.0]
    assert beliefs[0].t_s == 2.0
    nothing, none = follow_rooms(HOME, make_tracks(rows[:1]))
    assert len(nothing) == 0
    assert none == {}


@given(st.integers(0, 2**32 - 1), st.integers(0, 60))
def test_cutting_a_run_changes_nothing(seed, cut):
    rng = np.random.default_rng(seed)
    rows = [
        (k, k % 2, *rng.uniform(-1, 7, 2), 0.2 + rng.random(), Status.CONFIRMED) for k in range(60)
    ]
    tracks = make_tracks(rows)
    whole, _ = follow_rooms(HOME, tracks)
    first, beliefs = follow_rooms(HOME, select_rows(tracks, slice(0, cut)))
    second, _ = follow_rooms(HOME, select_rows(tracks, slice(cut, 60)), beliefs)
    np.testing.assert_array_equal(np.concatenate([first.room, second.room]), whole.room)
    np.testing.assert_array_equal(
        np.concatenate([first.probability, second.probability]), whole.probability
    )


def test_a_time_before_the_last_one_is_refused():
    belief = first_belief(5.0, np.array([1.0, 0.0]))
    with pytest.raises(InputError, match=r"found a time of 4.0 s, expected none before 5.0 s"):
        next_belief(belief, 4.0, np.array([1.0, 0.0]))
    with pytest.raises(InputError, match="found no rooms"):
        follow_rooms((), make_tracks([(0, 0, 1.0, 2.0, 0.5, Status.CONFIRMED)]))


def test_rooms_are_written_with_their_names(tmp_path):
    rows = [(0, 3, 1.0, 2.0, 0.3, Status.CONFIRMED), (1, 4, 20.0, 2.0, 0.3, Status.CONFIRMED)]
    found, _ = follow_rooms(HOME, make_tracks(rows))
    write_rooms(tmp_path / "rooms.csv", found)
    head, first, second = (tmp_path / "rooms.csv").read_text().splitlines()
    assert head == ",".join(COLUMNS)
    assert first.startswith("0")
    assert first.split(",")[1:4] == ["3", "tag", "west"]
    assert second.split(",")[1:4] == ["4", "tag", ""]
    assert float(first.split(",")[4]) == found.probability[0]


def test_at_home_the_room_is_right_and_does_not_flap(monkeypatch):
    root = Path(__file__).resolve().parents[1]
    monkeypatch.syspath_prepend(root / "benchmarks")
    bench = benches.load(root / "benchmarks" / "bench_rooms.py")
    run = bench.room_run(7, rate_hz=1.0, duration_s=300.0)
    found = bench.judged(run, bench.gridded(run))
    assert np.median(found.error_m) < 0.5
    assert found.flips <= 1
    assert found.right / found.rows > 0.8
