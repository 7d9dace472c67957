import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2, norm

from trackfield.filtering import extended, kalman, robust
from trackfield.filtering.extended import Iteration, Ranges
from trackfield.filtering.matrices import apply
from trackfield.filtering.robust import Component, Gate, Huber, Mixture, Student
from trackfield.sensing.range import RangeModel
from trackfield.types import Gaussian

RULES = [Mixture(), Huber(), Student()]
SENSORS = np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 4.0], [4.0, 4.0], [2.0, 5.0]])


@pytest.mark.parametrize("rule", RULES, ids=repr)
@given(
    residual=st.floats(-50, 50),
    variance=st.floats(1e-4, 10),
    unknown=st.floats(0, 10),
)
def test_no_rule_trusts_a_reading_more_than_its_noise_allows(rule, residual, variance, unknown):
    noise = rule(np.array([residual]), np.array([variance + unknown]), np.array([variance]))
    assert noise.variance[0] >= variance * (1 - 1e-12)
    assert 0.0 <= noise.trust[0] <= 1.0 + 1e-12
    assert np.isfinite(noise.bias[0])


def test_mixture_has_the_moments_of_the_three_kinds_of_reading():
    e, S, v = 1.3, 0.2, 0.05
    sigma = np.sqrt(v)
    density = [
        0.88 * norm(0, np.sqrt(S)).pdf(e),
        0.10 * norm(5 * sigma, np.sqrt(S + (5 * sigma) ** 2)).pdf(e),
        0.02 * norm(0, np.sqrt(S + (30 * sigma) ** 2)).pdf(e),
    ]
    p = np.array(density) / sum(density)
    mean = p[1] * 5 * sigma
    second = p[0] * v + p[1] * (v + 50 * v) + p[2] * (v + 900 * v)
    noise = Mixture()(np.array([e]), np.array([S]), np.array([v]))
    assert noise.trust[0] == pytest.approx(p[0], rel=1e-12)
    assert noise.bias[0] == pytest.approx(mean, rel=1e-12)
    assert noise.variance[0] == pytest.approx(second - mean**2, rel=1e-12)


def test_a_mixture_of_sure_things_changes_nothing():
    plain = Mixture((Component(1.0, 0.0, 0.0),))
    residual, v = np.array([0.1, 9.0]), np.array([0.04, 0.09])
    noise = plain(residual, v, v)
    np.testing.assert_allclose(noise.variance, v)
    np.testing.assert_array_equal(noise.bias, 0.0)


def test_late_readings_are_taken_as_late_and_early_ones_as_wrong():
    v = np.full(2, 0.01)
    noise = Mixture()(np.array([0.8, -1.5]), v, v)
    assert noise.bias[0] > 0.3
    assert noise.bias[1] < 0.1
    assert (noise.trust < 1e-6).all()


class Direct:
    """Readings of a constant, m times."""

    def __init__(self, m, variance):
        self.m, self.v = m, variance

    def predict(self, state):
        return np.repeat(state[..., :1], self.m, axis=-1)

    def jacobian(self, state):
        return np.ones((*state.shape[:-1], self.m, 1))

    def variance(self, reading):
        return np.full(reading.shape, self.v)


def test_huber_rounds_end_at_the_minimum_of_his_cost():
    # With many readings leverage and prior vanish, and S is v: the classical location estimate.
    rng = np.random.default_rng(0)
    z = rng.standard_normal(400)
    z[:60] += 6.0
    prior = Gaussian(np.zeros(1), 1e8 * np.eye(1))
    found = extended.iterate(
        prior, z, Direct(400, 1.0), weigh=Huber(1.345), iteration=Iteration(rounds=60)
    )
    grid = np.linspace(-0.5, 2.0, 2_501)
    size = np.abs(z[:, None] - grid)
    cost = np.where(size < 1.345, size**2 / 2, 1.345 * size - 1.345**2 / 2).sum(axis=0)
    assert found.update.posterior.mean[0] == pytest.approx(grid[cost.argmin()], abs=0.005)


def test_student_rounds_end_where_the_weighted_residuals_balance():
    rng = np.random.default_rng(1)
    z = rng.standard_t(4, 400)
    prior = Gaussian(np.zeros(1), 1e8 * np.eye(1))
    found = extended.iterate(
        prior, z, Direct(400, 1.0), weigh=Student(4.0), iteration=Iteration(rounds=60)
    )
    grid = np.linspace(-0.5, 0.5, 10_001)
    inside = np.minimum(5.0 / (4.0 + (z[:, None] - found.update.posterior.mean[0]) ** 2), 1.0)
    assert inside.max() == 1.0
    # The weights are capped at 1, so the fixed point solves sum w e = 0 with the capped weights.
    balance = [(np.minimum(5.0 / (4.0 + (z - x) ** 2), 1.0) * (z - x)).sum() for x in grid]
    root = grid[np.abs(balance).argmin()]
    assert found.update.posterior.mean[0] == pytest.approx(root, abs=0.01)


def test_weights_are_the_textbook_ones():
    # Residuals of 3 and 0.5 standard deviations (2 m) of what was expected.
    e, spread, v = np.array([6.0, 1.0]), np.full(2, 4.0), np.full(2, 0.5)
    huber = Huber(1.5)(e, spread, v)
    np.testing.assert_allclose(huber.trust, [0.5, 1.0])
    np.testing.assert_allclose(huber.variance, [1.0, 0.5])
    student = Student(4.0)(e, spread, v)
    np.testing.assert_allclose(student.trust, [5.0 / 13.0, 1.0])
    np.testing.assert_allclose(student.variance, [1.3, 0.5])


@pytest.mark.parametrize("rule", RULES, ids=repr)
def test_one_blocked_reading_among_five_does_little_harm(rule):
    truth = np.array([1.2, 2.3, 0.0, 0.0])
    model = RangeModel(sigma_m=0.05)
    z = np.linalg.norm(truth[:2] - SENSORS, axis=1)
    z[2] += 1.5
    prior = Gaussian(truth + 0.1, np.diag([0.04, 0.04, 0.1, 0.1]))
    sensor = Ranges(SENSORS, model)
    plain = extended.iterate(prior, z, sensor).update.posterior.mean
    forgiving = extended.iterate(prior, z, sensor, weigh=rule).update.posterior.mean
    error = [np.hypot(*(x - truth)[:2]) for x in (plain, forgiving)]
    assert error[1] < 0.6 * error[0]


@given(degrees=st.integers(1, 8), probability=st.sampled_from([0.9, 0.99, 0.9999]))
def test_the_gate_lets_pass_what_it_promises(degrees, probability):
    gate = Gate(probability)
    limit = chi2(degrees).ppf(probability)
    assert gate.threshold(np.array(degrees), np.array(0.0)) == pytest.approx(limit, rel=1e-9)


def test_the_gate_reopens_and_closes_again():
    gate, refused = Gate(0.99, 2.0), np.zeros(2)
    distance2, degrees = np.array([150.0, 1.0]), np.array([2.0, 2.0])
    history = []
    for _ in range(8):
        refused, passes = robust.step(refused, distance2, degrees=degrees, gate=gate)
        history.append(passes.tolist())
    # 9.21 doubles until it exceeds 150: five refusals, then one pass, and it is shut again.
    assert [h[0] for h in history] == [False] * 5 + [True] + [False] * 2
    assert all(h[1] for h in history)
    assert refused.tolist() == [2.0, 0.0]


def test_silence_neither_opens_nor_closes_the_gate():
    refused, passes = robust.step(
        np.array([3.0]), np.array([0.0]), degrees=np.array([0.0]), gate=Gate()
    )
    assert refused.tolist() == [3.0]
    assert not passes.any()


def test_a_gated_filter_finds_its_target_again_after_an_outage():
    """The hard gate of the same size never does."""

    def run(gate):
        belief, refused = Gaussian(np.zeros(2), 1e-4 * np.eye(2)), np.zeros(())
        F, Q = np.eye(2), 0.01 * np.eye(2)
        sensor = kalman.Linear(np.eye(2), 0.01 * np.eye(2))
        target = np.array([5.0, 5.0])  # it moved while nobody listened
        for _ in range(40):
            prior = kalman.predict(belief, F, Q)
            updated = kalman.update(prior, target, sensor)
            refused, passes = robust.step(
                refused, updated.distance2, degrees=updated.readings, gate=gate
            )
            belief = updated.posterior if passes else prior
        return np.abs(apply(np.eye(2), belief.mean) - target).max()

    assert run(Gate(0.99, 2.0)) < 0.5
    assert run(Gate(0.99, 1.0)) > 4.0
