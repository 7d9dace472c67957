"""Orders to pursuers: who chases whom, whatever becomes of tracks."""

import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pursuit_runs import carried, rows
from trackfield.errors import ConfigurationError, InputError, StateError
from trackfield.hierarchy.archive import packed, unpacked
from trackfield.pipeline.pursuing import Pursuit
from trackfield.pursuit.coordinator import coordinator
from trackfield.pursuit.coordinator_state import decode, encode, learned
from trackfield.pursuit.detours import delayed, leg
from trackfield.pursuit.separation import Body
from trackfield.pursuit.settings import PursuitSettings
from trackfield.pursuit.vehicles import Runner, Thruster
from trackfield.pursuit.wheeled import Wheels
from trackfield.robot.car import Car
from trackfield.robot.obstacles import Obstacles
from trackfield.types import Status

STEP = 0.5
SETTINGS = PursuitSettings(step_s=STEP)
EVADERS = np.array([[10.0, 0.0, 0.3, 0.2], [-8.0, 6.0, -0.2, 0.4]])
PURSUERS = np.array([[0.0, 0.0, 0.0, 0.0], [2.0, 2.0, 0.0, 0.0]])
WALL = [[4.0, -5.0], [5.0, -5.0], [5.0, 5.0], [4.0, 5.0]]


def run(vehicle, *, evaders=EVADERS, pursuers=PURSUERS, steps=60, polygons=(), numbers=None):
    """Least distance (e,) of pursuers to evaders that are seen exactly, and all orders."""
    made = coordinator(vehicle, SETTINGS, polygons=polygons)
    operator, orders = Pursuit(made), []
    closest = np.full(len(evaders), np.inf)
    for k in range(steps):
        shown = rows(evaders, t_s=k * STEP, sigma_m=0.05, numbers=numbers)
        orders.append(operator.process(shown, pursuers, t_s=k * STEP))
        pursuers = made.vehicle.moved(pursuers, orders[-1].commands, step_s=STEP)
        evaders = carried(evaders, STEP)
        away = np.linalg.norm(pursuers[:, None, :2] - evaders[:, :2], axis=-1)
        closest = np.minimum(closest, away.min(axis=0))
    return closest, orders


@pytest.mark.parametrize(
    ("vehicle", "pursuers"),
    [
        (Thruster(1.0, speed_m_s=3.0), PURSUERS),
        (Body(thrust_m_s2=1.0, apart_m=0.5), PURSUERS),
        (Runner(1.5), PURSUERS[:, :2]),
        (Wheels(Car(1.5)), PURSUERS[:, :3]),
    ],
)
def test_every_vehicle_catches_what_it_sees(vehicle, pursuers):
    closest, orders = run(vehicle, pursuers=pursuers)
    assert closest.max() < 0.3
    assert sorted(orders[0].track.tolist()) == [1, 2]
    assert not orders[0].trouble
    first = orders[0]
    j = first.track - 1
    ahead = EVADERS[j, :2] + first.expected_s[:, None] * EVADERS[j, 2:]
    np.testing.assert_allclose(first.meeting, ahead)


def test_the_first_orders_are_the_bottleneck_of_the_times_to_capture():
    evaders = np.array([[1.0, 0, 0, 0], [-3.0, 0, 0, 0]])  # both nearest to pursuer 0
    pursuers = np.array([[0.0, 0, 0, 0], [3.0, 0, 0, 0]])
    _, orders = run(Thruster(), evaders=evaders, pursuers=pursuers, steps=1)
    assert orders[0].track.tolist() == [2, 1]
    np.testing.assert_allclose(orders[0].expected_s, [2 * 3**0.5, 2 * 2**0.5])


def test_a_wall_is_gone_around_and_kept_clear_of():
    body = Body(thrust_m_s2=1.0, speed_m_s=2.0, clear_m=0.5)
    evaders = np.array([[8.0, 0.0, 0.0, 0.0]])
    pursuers = np.array([[0.0, 0.0, 0.0, 0.0]])
    made = coordinator(body, SETTINGS, polygons=[WALL])
    operator = Pursuit(made)
    for k in range(80):
        orders = operator.process(rows(evaders, t_s=k * STEP), pursuers, t_s=k * STEP)
        pursuers = made.vehicle.moved(pursuers, orders.commands, step_s=STEP)
        assert made.clearance(pursuers[:, :2])[0] >= 0.5
    assert np.linalg.norm(pursuers[0, :2] - evaders[0, :2]) < 0.3
    free = coordinator(body, SETTINGS)
    _, straight = free.step(free.initial(), 0.0, tracks=rows(evaders, t_s=0.0), pursuers=PURSUERS)
    _, around = made.step(made.initial(), 0.0, tracks=rows(evaders, t_s=0.0), pursuers=PURSUERS)
    assert around.expected_s[around.track == 1].min() > straight.expected_s.min() + 1.0


def test_what_is_walled_in_is_out_of_reach_and_what_is_inside_is_waited_for():
    ring = [
        [[-1.0, -4], [11, -4], [11, -3], [-1, -3]],
        [[-1.0, 3], [11, 3], [11, 4], [-1, 4]],
        [[-1.0, -4], [0, -4], [0, 4], [-1, 4]],
        [[10.0, -4], [11, -4], [11, 4], [10, 4]],
    ]
    outside = np.array([[20.0, 0.0, 0.0, 0.0]])
    made = coordinator(Runner(1.0), SETTINGS, polygons=ring)
    evaders = np.array([[5.0, 0.0, 0.0, 0.0], [10.7, 0.0, 0.0, 0.0]])
    _, orders = made.step(
        made.initial(), 0.0, tracks=rows(evaders, t_s=0.0), pursuers=outside[:, :2]
    )
    assert orders.out_of_reach == (1,)
    assert orders.track.tolist() == [2]
    assert orders.commands[0, 0] < 0.0


def test_spare_pursuers_help_and_waiting_evaders_are_told():
    evaders = np.vstack([EVADERS, [[3.0, -9.0, 0.0, 0.0]]])
    _, orders = run(Thruster(), evaders=evaders, steps=1)
    assert len(orders[0].unchased) == 1
    _, orders = run(Thruster(), evaders=EVADERS[:1], steps=1)
    assert orders[0].track.tolist() == [1, 1]
    alone = coordinator(Thruster(), PursuitSettings(double=False))
    _, told = alone.step(alone.initial(), 0.0, tracks=rows(EVADERS[:1], t_s=0.0), pursuers=PURSUERS)
    assert sorted(told.track.tolist()) == [-1, 1]
    assert np.isinf(told.expected_s[told.track < 0]).all()
    assert np.isnan(told.meeting[told.track < 0]).all()


def test_noise_does_not_make_them_flap():
    evaders = np.array([[5.0, 0.0, 0.0, 0.0], [5.2, 0.0, 0.0, 0.0]])
    pursuers = np.array([[0.0, 0.0, 0, 0], [0.2, 0.0, 0, 0]])
    changes = {}
    for margin in (0.0, 0.1):
        operator = Pursuit(coordinator(Thruster(), PursuitSettings(margin=margin)))
        noise = np.random.default_rng(1)
        for k in range(40):
            shown = evaders + np.array([0.3, 0.0, 0.0, 0.0]) * noise.standard_normal((2, 4))
            operator.process(rows(shown, t_s=k), pursuers, t_s=float(k))
        changes[margin] = operator.counts["changed"]
    assert changes[0.0] > 20
    assert changes[0.1] <= 4


def test_ended_tracks_free_their_pursuers_and_dismissed_ones_are_caught():
    operator = Pursuit(coordinator(Thruster(), SETTINGS))
    first = operator.process(rows(EVADERS, t_s=0.0), PURSUERS, t_s=0.0)
    assert set(first.track.tolist()) == {1, 2}
    gone = rows(EVADERS[:1], t_s=0.5, status=Status.ENDED)
    assert set(operator.process(gone, PURSUERS, t_s=0.5).track.tolist()) == {2}
    none = operator.process(rows([], t_s=1.0), PURSUERS, t_s=1.0, dismissed=[2])
    assert none.track.tolist() == [-1, -1]
    again = operator.process(rows(EVADERS[1:], t_s=1.5, numbers=[2]), PURSUERS, t_s=1.5)
    assert again.track.tolist() == [-1, -1]
    later = rows(EVADERS[1:], t_s=11.5, numbers=[2])
    data = operator.snapshot()
    assert (operator.process(later, PURSUERS, t_s=11.5).track == 2).all()  # somebody else is there
    operator.restore(data)
    fresh = operator.process(rows(EVADERS, t_s=2.0, numbers=[7, 8]), PURSUERS, t_s=2.0)
    assert set(fresh.track.tolist()) == {7, 8}
    late = operator.process(rows([], t_s=20.0), PURSUERS, t_s=20.0)
    assert late.track.tolist() == [-1, -1]
    assert "found nothing for 18 s, and gave it up" in " ".join(late.trouble)


def test_who_holds_brakes():
    moving = PURSUERS + np.array([0.0, 0.0, 0.4, -2.0])
    made = coordinator(Thruster(), SETTINGS)
    _, orders = made.step(made.initial(), 0.0, tracks=rows([], t_s=0.0), pursuers=moving)
    np.testing.assert_allclose(orders.commands, [[-0.8, 1.0]] * 2)


def test_tentative_tracks_are_chased_only_if_they_were_shown():
    operator = Pursuit(coordinator(Thruster(), SETTINGS))
    young = rows(EVADERS[:1], t_s=0.0, status=Status.TENTATIVE)
    assert (operator.process(young, PURSUERS, t_s=0.0).track == -1).all()
    operator.process(rows(EVADERS[:1], t_s=1.0), PURSUERS, t_s=1.0)
    young = rows(EVADERS[:1], t_s=2.0, status=Status.TENTATIVE)
    assert (operator.process(young, PURSUERS, t_s=2.0).track == 1).all()


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda t: t.position.__setitem__((0, 0), np.nan), "track 1: found a row that is not"),
        (lambda t: t.covariance.__setitem__(0, np.nan), "track 1: found a row that is not"),
        (lambda t: t.covariance.__setitem__(0, -1.0), "track 1: found a row that is not"),
        (lambda t: t.covariance.__setitem__(0, 1e9), "track 1: known to 3.16e[+]04 m only"),
        (lambda t: t.t_s.__setitem__(0, 5.0), "track 1: found a row of 5 s, after 0 s"),
    ],
)
def test_tracks_that_make_no_sense_are_left_out_and_said(spoil, said):
    shown = rows(EVADERS, t_s=0.0)
    spoil(shown)
    made = coordinator(Thruster(), SETTINGS)
    _, orders = made.step(made.initial(), 0.0, tracks=shown, pursuers=PURSUERS)
    assert (orders.track == 2).all()
    assert np.isfinite(orders.commands).all()
    with pytest.raises(AssertionError, match=said):
        raise AssertionError(" ".join(orders.trouble))


def test_nobody_there_and_nobody_to_chase():
    made = coordinator(Body(), SETTINGS)
    state, orders = made.step(
        made.initial(), 0.0, tracks=rows(EVADERS, t_s=0.0), pursuers=np.zeros((0, 4))
    )
    assert orders.commands.shape == (0, 2)
    assert orders.unchased == (1, 2)
    assert orders.out_of_reach == ()
    _, orders = made.step(state, 1.0, tracks=rows([], t_s=1.0), pursuers=np.zeros((0, 4)))
    assert orders.unchased == (1, 2)


def test_evaders_that_nobody_can_catch_are_told_and_the_others_are_chased():
    fast = np.vstack([[[5.0, 0.0, 4.0, 0.0]], EVADERS[1:]])
    _, orders = run(Body(speed_m_s=2.0), evaders=fast, steps=1)
    assert orders[0].out_of_reach == (1,)
    assert set(orders[0].track.tolist()) <= {2, -1}


def test_a_pursuer_that_is_not_heard_of_brakes_and_the_others_go_on():
    lost = np.array(PURSUERS)
    lost[1] = np.nan
    made = coordinator(Thruster(), SETTINGS)
    _, orders = made.step(made.initial(), 0.0, tracks=rows(EVADERS, t_s=0.0), pursuers=lost)
    assert orders.track[1] == -1
    assert np.isfinite(orders.commands).all()
    made = coordinator(Body(), SETTINGS)
    with pytest.raises(InputError, match="pursuer 1: found a first state"):
        made.step(made.initial(), 0.0, tracks=rows(EVADERS, t_s=0.0), pursuers=lost)
    state, _ = made.step(made.initial(), 0.0, tracks=rows(EVADERS, t_s=0.0), pursuers=PURSUERS)
    state, orders = made.step(state, STEP, tracks=rows(EVADERS, t_s=STEP), pursuers=lost)
    assert "pursuer 1: found no state of it" in " ".join(orders.trouble)
    assert "pursuer 0: found it off its way" in " ".join(orders.trouble)  # it has not moved
    assert orders.track[1] == -1


def test_a_start_that_is_not_clear_is_said():
    close = np.array([[0.0, 0, 0, 0], [0.2, 0, 0, 0]])
    made = coordinator(Body(apart_m=1.0), SETTINGS)
    _, orders = made.step(made.initial(), 0.0, tracks=rows(EVADERS, t_s=0.0), pursuers=close)
    assert "too near" in orders.trouble[0]


@given(st.integers(0, 10_000))
def test_whatever_tracks_do_orders_are_finite_and_within_limits(seed):
    rng = np.random.default_rng(seed)
    vehicle = Body(thrust_m_s2=1.0, error_m_s2=0.05, apart_m=0.5)
    made = coordinator(vehicle, SETTINGS)
    pursuers = PURSUERS * 1.0
    operator, other = Pursuit(made), Pursuit(made)
    for k in range(6):
        m = int(rng.integers(0, 5))
        shown = rows(
            rng.normal(0.0, 8.0, (m, 4)),
            t_s=k * STEP,
            numbers=rng.integers(1, 6, m),
            sigma_m=float(rng.choice([0.0, 0.3, 1e6])),
            status=int(rng.integers(0, 4)),
        )
        shown.position[rng.random(m) < 0.1] = np.nan
        data = operator.snapshot()
        orders = operator.process(shown, pursuers, t_s=k * STEP)
        assert np.isfinite(orders.commands).all()
        assert np.abs(orders.commands).max() <= 1.0 + 1e-12
        other.restore(data)
        again = other.process(shown, pursuers, t_s=k * STEP)
        for one, two in zip(orders, again, strict=True):
            np.testing.assert_array_equal(one, two)
        wrong = rng.uniform(-0.05, 0.05, (2, 2))
        thrust = orders.commands + wrong
        pursuers = np.hstack(
            [
                pursuers[:, :2] + STEP * pursuers[:, 2:] + 0.5 * STEP**2 * thrust,
                pursuers[:, 2:] + STEP * thrust,
            ]
        )
        assert np.linalg.norm(pursuers[0, :2] - pursuers[1, :2]) >= 0.5
        assert not any("off its way" in line for line in orders.trouble)
    assert operator.counts["steps"] == 6


def test_snapshots_of_others_are_refused():
    one, other = (Pursuit(coordinator(Thruster(u), SETTINGS)) for u in (1.0, 2.0))
    one.process(rows(EVADERS, t_s=0.0), PURSUERS, t_s=0.0)
    with pytest.raises(StateError, match="another site or of other options"):
        other.restore(one.snapshot())
    with pytest.raises(StateError, match="not a tracker's snapshot"):
        one.restore(b"nothing")


def test_states_of_another_version_are_refused():
    state = coordinator(Thruster(), SETTINGS).initial()
    head, _ = unpacked(encode(state), parts=0)
    assert decode(encode(state)) == state
    with pytest.raises(StateError, match="another version of a coordinator"):
        decode(packed({**head, "version": 2}, []))


def test_older_rows_of_a_track_do_not_take_it_back():
    now, doubts = learned({}, rows(EVADERS[:1], t_s=2.0), until_s=3.0, density=0.1)
    again, _ = learned(now, rows(EVADERS[1:], t_s=1.0, numbers=[1]), until_s=3.0, density=0.1)
    assert again[1].t_s == 2.0
    np.testing.assert_array_equal(again[1].mean, EVADERS[0])
    expected = np.cbrt(2.0 * 0.1**2 * 0.3**2)
    np.testing.assert_allclose(now[1].variance, [0.09, 0.09, expected, expected])
    assert not doubts


def test_where_no_way_leads_a_pursuer_stays():
    box = Obstacles([[[-1.0, -1], [1, -1], [1, 1], [-1, 1]]])
    walls = [
        [[-5.0, -5], [5, -5], [5, -4], [-5, -4]],
        [[-5.0, 4], [5, 4], [5, 5], [-5, 5]],
        [[-5.0, -5], [-4, -5], [-4, 5], [-5, 5]],
        [[4.0, -5], [5, -5], [5, 5], [4, 5]],
    ]
    aim = leg(np.zeros(2), np.array([9.0, 0, 0, 0]), 1.0, Obstacles(walls), 0.5)
    np.testing.assert_array_equal(aim, 0.0)
    # From inside an obstacle it goes out of it first, by the nearest border.
    aim = leg(np.array([0.5, 0.0]), np.array([-9.0, 0, 0, 0]), 1.0, box, 0.5)
    np.testing.assert_allclose(aim[:2], [1.0, 0.0])
    way = [[0.0, 0.0]]
    free = delayed(np.ones((1, 1)), np.array(way), np.array([[3.0, 0, 0, 0]]), Obstacles())
    assert free.tolist() == [[1.0]]


def test_bad_calls_and_settings_are_refused():
    operator = Pursuit(coordinator(Thruster(), SETTINGS))
    with pytest.raises(InputError, match=r"of shape \(2, 2\): expected states \(p, 4\)"):
        operator.process(rows([], t_s=0.0), PURSUERS[:, :2], t_s=0.0)
    with pytest.raises(InputError, match="expected a finite time"):
        operator.process(rows([], t_s=0.0), PURSUERS, t_s=np.nan)
    operator.process(rows([], t_s=0.0), PURSUERS, t_s=1.0)
    with pytest.raises(InputError, match=r"found orders for 1\.0 s after those for 1\.0 s"):
        operator.process(rows([], t_s=0.0), PURSUERS, t_s=1.0)
    with pytest.raises(ConfigurationError) as caught:
        PursuitSettings(step_s=0.0, margin=1.0, objective="best")  # type: ignore[arg-type]
    assert len(caught.value.problems) == 3


@pytest.mark.speed
def test_a_step_of_100_by_100_costs_little_more_than_its_table_of_times():
    rng = np.random.default_rng(2)
    made = coordinator(Thruster(1.0, 3.0), SETTINGS)
    evaders, pursuers = rng.normal(0.0, 50.0, (2, 100, 4)) * [1, 1, 0.01, 0.01]
    shown, empty = rows(evaders, t_s=0.0), made.initial()
    spent, table = [], []
    for _ in range(12):
        begun = time.process_time()
        made.step(empty, 0.0, tracks=shown, pursuers=pursuers)
        spent.append(time.process_time() - begun)
        begun = time.process_time()
        made.vehicle.times(pursuers, evaders)
        table.append(time.process_time() - begun)
    assert min(spent) < 1.5 * 8.0 * min(table)
