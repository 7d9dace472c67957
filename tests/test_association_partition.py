"""The posterior of a partition, and where its targets are, against dense Gaussians."""

import numpy as np
import pytest
from scipy.stats import norm

from mcmcda_twin import ROOM, Problem, window
from trackfield.association.partition import accumulated, follow, log_ratio, track_table

GIVEN = [
    {"seed": 1, "region": ROOM},
    {"seed": 7, "round_reports": False, "region": ROOM},
    {"seed": 4, "slots": 4, "log_death": -2.0},
]


@pytest.mark.parametrize("given", GIVEN)
def test_scores_of_all_tracks_are_those_of_dense_gaussians(given):
    problem = Problem(window(**given), informed=False)
    table = track_table(problem.window, problem.tracks)
    scores = follow(problem.window, table, 0).log_ratio
    np.testing.assert_allclose(scores, [problem.score(t) for t in problem.tracks], atol=1e-9)


def test_a_partition_scores_the_sum_of_its_tracks_and_no_tracks_score_nothing():
    problem = Problem(window(1), informed=False)
    partition = max(problem.partitions, key=len)
    total = sum(problem.score(t) for t in partition)
    assert log_ratio(problem.window, sorted(partition)) == pytest.approx(total)
    assert log_ratio(problem.window, []) == 0.0


@pytest.mark.parametrize("given", GIVEN)
def test_positions_in_hindsight_are_those_of_a_dense_gaussian(given):
    problem = Problem(window(**given), informed=False)
    w = problem.window
    tracks = [t for t in problem.tracks if len(t) > 2]
    for slot in range(w.t_s.size):
        found = follow(w, track_table(w, tracks), slot)
        for k, track in enumerate(tracks):
            if problem.slot[track[0]] <= slot:
                mean, covariance = dense_state(w, track, slot)
                np.testing.assert_allclose(found.mean[k], mean, atol=1e-9)
                np.testing.assert_allclose(found.covariance[k], covariance, atol=1e-9)


@pytest.mark.parametrize("given", GIVEN[:2])
def test_existence_is_certain_between_reports_and_by_bayes_after_them(given):
    problem = Problem(window(**given), informed=False)
    w = problem.window
    table = track_table(w, problem.tracks)
    for slot in range(w.t_s.size):
        found = follow(w, table, slot).existence
        for k, track in enumerate(problem.tracks):
            assert found[k] == pytest.approx(alive(problem, track, slot), abs=1e-12)


@pytest.mark.parametrize(("dt_s", "steps"), [(1.0, 1), (3.0, 3), (0.5, 1), (2.0, 4)])
def test_accelerations_add_up_step_by_step(dt_s, steps):
    h = dt_s / steps
    F, g = np.array([[1.0, h], [0.0, 1.0]]), np.array([h * h / 2, h])
    P = np.zeros((2, 2))
    for _ in range(steps):
        P = F @ P @ F.T + 0.3**2 * np.outer(g, g)
    step_s = h if steps > 1 else 1.0
    found = accumulated(dt_s, step_s=step_s, accel_sigma_m_s2=0.3)
    np.testing.assert_allclose(found, [P[0, 0], P[0, 1], P[1, 1]])


def dense_state(w, track, slot):
    """State in a slot given all reports of a track: one regression on start and accelerations."""
    t = w.t_s - w.t_s[w.slot[track[0]]]
    steps = round(t[-1])

    def row(time):
        """Position and velocity by [p, v, u_0, u_1, ...] of one axis."""
        pushed = [max(0.0, time - k - 0.5) for k in range(steps)]
        return np.array(
            [[1.0, time, *pushed], [0.0, 1.0, *(float(time > k) for k in range(steps))]]
        )

    prior = np.kron(
        np.diag([0.0, w.life.velocity_sigma_m_s**2, *[w.life.accel_sigma_m_s2**2] * steps]),
        np.eye(2),
    )
    first = track[0]
    prior[:2, :2] = w.covariance[first][[[0, 1], [1, 2]]]
    mean = np.zeros(len(prior))
    mean[:2] = w.position[first]
    H = np.vstack([np.kron(row(t[w.slot[i]])[:1], np.eye(2)) for i in track[1:]])
    R = np.zeros((len(H), len(H)))
    for k, i in enumerate(track[1:]):
        R[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = w.covariance[i][[[0, 1], [1, 2]]]
    gain = prior @ H.T @ np.linalg.inv(H @ prior @ H.T + R)
    mean = mean + gain @ (w.position[list(track[1:])].ravel() - H @ mean)
    P = prior - gain @ H @ prior
    A = np.kron(row(t[slot]), np.eye(2))
    return A @ mean, A @ P @ A.T


def alive(problem, track, slot):
    """P(alive in a slot | reports, silence), over all slots in which the target may have ended."""
    w, last = problem.window, problem.slot[track[-1]]
    if slot < problem.slot[track[0]]:
        return 0.0
    ends = {}
    going = 1.0
    for t in range(last + 1, problem.slots):
        mean, variance = problem.ahead(track, t)
        inside = 1.0
        if w.life.region is not None:
            for axis in range(2):
                at = norm(mean[axis], variance[axis] ** 0.5)
                inside *= at.cdf(w.life.region[2 + axis]) - at.cdf(w.life.region[axis])
        stay = w.survival[t] * inside
        ends[t] = going * (1 - stay)
        going *= stay * (1 - w.p_detection[t, track[-1]])
    total = going + sum(ends.values())
    return (going + sum(p for t, p in ends.items() if t > slot)) / total
