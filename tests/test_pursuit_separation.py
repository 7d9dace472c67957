"""Pursuers keep clear of each other and of obstacles, whatever their actuators do."""

import numpy as np
import pytest

from trackfield.errors import ConfigurationError, InputError
from trackfield.pursuit.separation import Body, Fleet, check_start, move
from trackfield.pursuit.steering import held_thrust

STEP = 0.5
CENTRES = np.array([[5.0, 5.0], [12.0, 6.0], [8.0, 13.0]])
RADII = np.array([1.5, 1.0, 2.0])


def discs(points):
    return (np.linalg.norm(points[:, None] - CENTRES, axis=-1) - RADII).min(axis=1)


def started(rng, body, pursuers):
    while True:
        place = rng.uniform(0.0, 18.0, (pursuers, 2))
        fleet = Fleet(place, np.zeros((pursuers, 2)))
        try:
            check_start(fleet, body, step_s=STEP, clearance=discs)
        except InputError:
            continue
        return fleet


def run(seed, *, noise, steps=40, pursuers=8):
    """Least distance between pursuers, to obstacles, and worst error of following."""
    rng = np.random.default_rng(seed)
    body = Body(thrust_m_s2=1.0, error_m_s2=noise, speed_m_s=2.0, apart_m=1.0, clear_m=0.5)
    fleet = actual = started(rng, body, pursuers)
    goal = rng.uniform(0.0, 18.0, (pursuers, 2))
    apart, away, tube = np.inf, np.inf, 0.0
    start = np.linalg.norm(fleet.position - goal, axis=1)
    for _ in range(steps):
        wanted = held_thrust(
            fleet.position - goal, fleet.velocity, limit_m_s2=body.reserve_m_s2, step_s=STEP
        ).thrust_m_s2
        moved = move(fleet, wanted, body, step_s=STEP, actual=actual, clearance=discs)
        assert np.abs(moved.thrust_m_s2).max() <= body.thrust_m_s2
        wrong = rng.choice([-1.0, 0.3, 1.0], (pursuers, 2)) * noise  # mostly the worst there is
        thrust = moved.thrust_m_s2 + wrong
        for t in np.linspace(0.0, STEP, 9):
            place = actual.position + t * actual.velocity + 0.5 * t**2 * thrust
            between = np.linalg.norm(place[:, None] - place, axis=-1)
            apart = min(apart, between[~np.eye(pursuers, dtype=bool)].min())
            away = min(away, discs(place).min())
        actual = Fleet(
            actual.position + STEP * actual.velocity + 0.5 * STEP**2 * thrust,
            actual.velocity + STEP * thrust,
        )
        fleet = moved.fleet
        tube = max(tube, np.abs(actual.position - fleet.position).max())
    left = np.linalg.norm(fleet.position - goal, axis=1)
    return apart, away, tube, (start - left).mean()


@pytest.mark.parametrize("noise", [0.0, 0.1, 0.3])
def test_all_keep_clear_in_every_run_and_get_nearer_to_where_they_want(noise):
    runs = 5 if noise < 0.3 else 2  # braking takes longer, and so does looking ahead
    results = np.array([run(seed, noise=noise) for seed in range(runs)])
    apart, away, tube, nearer = results.T
    assert apart.min() >= 1.0
    assert away.min() >= 0.5
    assert tube.max() <= STEP**2 * noise * (1.0 + 1e-9)
    assert nearer.mean() > (3.0 if noise < 0.3 else 0.2)  # little thrust is left at three times .3
    if noise == 0.1:
        assert tube.max() > 0.99 * STEP**2 * noise  # the tube is no wider than it must be


def test_head_on_they_go_round_each_other():
    body = Body(apart_m=1.0, speed_m_s=2.0)
    fleet = Fleet(np.array([[0.0, 0.0], [6.0, 0.0]]), np.zeros((2, 2)))
    wanted = np.array([[1.0, 0.0], [-1.0, 0.0]])
    for _ in range(12):
        fleet = move(fleet, wanted, body, step_s=STEP).fleet
        assert np.linalg.norm(np.diff(fleet.position, axis=0)) >= 1.0
    assert fleet.position[0, 0] > fleet.position[1, 0]


def test_braking_is_told():
    body = Body(apart_m=0.5, speed_m_s=2.0, clear_m=0.0)
    fleet = Fleet(np.zeros((1, 2)), np.array([[0.31, 0.0]]))

    def lane(points):  # as long as the way of braking, and no wider
        inside = (points[:, 0] > -1e-9) & (points[:, 0] < 0.0776) & (np.abs(points[:, 1]) < 1e-9)
        return np.where(inside, 1.0, -1.0)

    moved = move(fleet, np.ones((1, 2)), body, step_s=STEP, clearance=lane)
    assert moved.braked.tolist() == [True]
    assert moved.fleet.velocity.tolist() == [[0.0, 0.0]]


@pytest.mark.parametrize(
    ("place", "speed", "said"),
    [
        ([[0.0, 0.0], [0.5, 0.0]], 0.0, "pursuer 1 at .* too near"),
        ([[5.0, 5.0]], 0.0, "pursuer 0 at .* too near"),
        ([[0.0, 0.0]], 9.0, "found 9 m/s, expected at most 2 m/s"),
        ([[1.0, 5.0]], 2.0, "too fast to brake"),
    ],
)
def test_a_start_that_is_not_clear_is_refused(place, speed, said):
    body = Body(speed_m_s=2.0, clear_m=0.9)
    fleet = Fleet(np.array(place), np.tile([speed, 0.0], (len(place), 1)))
    with pytest.raises(InputError, match=said):
        check_start(fleet, body, step_s=STEP, clearance=discs)


def test_bad_bodies_and_thrusts_are_refused_all_at_once():
    with pytest.raises(ConfigurationError) as caught:
        Body(thrust_m_s2=0.0, speed_m_s=np.nan, apart_m=-1.0)
    assert len(caught.value.problems) == 3
    with pytest.raises(ConfigurationError, match="less than a third of the thrust"):
        Body(thrust_m_s2=1.0, error_m_s2=0.34)
    fleet = Fleet(np.zeros((1, 2)), np.zeros((1, 2)))
    with pytest.raises(InputError, match="wanted thrusts"):
        move(fleet, np.full((1, 2), np.nan), Body(), step_s=STEP)
