import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize

from trackfield.filtering import extended, kalman, matrices
from trackfield.filtering.extended import Iteration, Ranges
from trackfield.filtering.robust import Student
from trackfield.motion import ConstantVelocity, CoordinatedTurn, UnknownTurn
from trackfield.sensing.range import RangeModel, columns
from trackfield.types import Gaussian

MODEL = RangeModel(bias_m=0.1, scale=0.02, sigma_m=0.05, sigma_scale=0.03)
SENSORS = np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 3.0], [5.0, 4.0]])
SEEDS = st.integers(0, 2**32 - 1)


def scene(seed, spread=0.5):
    """A target, a prior that does not know it well, and its ranges."""
    rng = np.random.default_rng(seed)
    truth = np.append(rng.uniform(0.5, 3.5, 2), rng.standard_normal(2))
    root = rng.standard_normal((4, 4)) * spread
    P = root @ root.T + 0.05 * np.eye(4)
    prior = Gaussian(truth + np.linalg.cholesky(P) @ rng.standard_normal(4), P)
    r = np.linalg.norm(truth[:2] - SENSORS, axis=1)
    z = 1.02 * r + 0.1 + 0.05 * rng.standard_normal(4)
    return prior, z


class Plane:
    """A linear sensor, for which every extended filter is the Kalman filter."""

    H = np.array([[1.0, 0.5, 0.0, 0.1], [0.0, 1.0, 0.3, 0.0], [0.2, 0.0, 0.0, 1.0]])

    def predict(self, state):
        return matrices.apply(self.H, state)

    def jacobian(self, state):
        return np.broadcast_to(self.H, (*state.shape[:-1], 3, 4))

    def variance(self, reading):
        return np.broadcast_to([0.1, 0.2, 0.3], reading.shape)


@pytest.mark.parametrize("rule", [extended.update, lambda *a: extended.iterate(*a).update])
def test_on_a_linear_sensor_it_is_the_kalman_filter(rule):
    prior, _ = scene(4)
    z = np.array([0.3, -1.0, 2.0])
    R = np.diag([0.1, 0.2, 0.3])
    exact = kalman.update(prior, z, kalman.Linear(Plane.H, R))
    updated = rule(prior, z, Plane())
    np.testing.assert_allclose(updated.posterior.mean, exact.posterior.mean, rtol=1e-10)
    np.testing.assert_allclose(updated.posterior.covariance, exact.posterior.covariance, rtol=1e-9)
    assert updated.log_likelihood == pytest.approx(exact.log_likelihood, rel=1e-10)


@given(seed=SEEDS)
def test_slopes_are_slopes(seed):
    prior, _ = scene(seed)
    sensor, h = Ranges(SENSORS, MODEL), 1e-6
    slope = [
        (sensor.predict(prior.mean + h * e) - sensor.predict(prior.mean - h * e)) / (2 * h)
        for e in np.eye(4)
    ]
    np.testing.assert_allclose(sensor.jacobian(prior.mean), np.stack(slope, -1), atol=1e-7)


def test_a_sensor_at_the_target_is_no_trouble():
    prior, z = scene(5)
    at_sensor = Gaussian(np.append(SENSORS[0], [0.0, 0.0]), prior.covariance)
    updated = extended.update(at_sensor, z, Ranges(SENSORS, MODEL))
    assert np.isfinite(updated.posterior.mean).all()
    assert (Ranges(SENSORS, MODEL).jacobian(at_sensor.mean)[0] == 0.0).all()


def test_noise_is_that_of_the_distance_a_reading_stands_for():
    reading = 1.02 * 2.0 + 0.1
    assert Ranges(SENSORS[:1], MODEL).variance(np.array([reading])) == pytest.approx(
        0.05**2 + 0.03**2 * 4.0, rel=1e-12
    )


def test_extended_update_is_the_textbook_one():
    prior, z = scene(6)
    r = np.linalg.norm(prior.mean[:2] - SENSORS, axis=1)
    H = np.hstack([1.02 * (prior.mean[:2] - SENSORS) / r[:, None], np.zeros((4, 2))])
    R = np.diag(0.05**2 + 0.03**2 * ((z - 0.1) / 1.02) ** 2)
    S = H @ prior.covariance @ H.T + R
    K = prior.covariance @ H.T @ np.linalg.inv(S)
    updated = extended.update(prior, z, Ranges(SENSORS, MODEL)).posterior
    np.testing.assert_allclose(updated.mean, prior.mean + K @ (z - 1.02 * r - 0.1), rtol=1e-10)
    np.testing.assert_allclose(
        updated.covariance, prior.covariance - K @ H @ prior.covariance, rtol=1e-8, atol=1e-12
    )


@given(seed=SEEDS)
def test_iterated_update_finds_the_most_likely_state(seed):
    prior, z = scene(seed)
    sensor = Ranges(SENSORS, MODEL)
    found = extended.iterate(prior, z, sensor, iteration=Iteration(300, rounds=1, tolerance=1e-9))
    assert found.converged
    v, inverse = sensor.variance(z), np.linalg.inv(prior.covariance)

    def slope(x):
        misfit = z - sensor.predict(x)
        return inverse @ (x - prior.mean) - sensor.jacobian(x).T @ (misfit / v)

    at = found.update.posterior
    scale = np.sqrt(np.diag(at.covariance))
    np.testing.assert_allclose(slope(at.mean) * scale, 0.0, atol=1e-5)
    H = sensor.jacobian(at.mean)
    np.testing.assert_allclose(
        np.linalg.inv(at.covariance), inverse + H.T @ np.diag(1 / v) @ H, rtol=1e-6, atol=1e-5
    )


def test_iterated_update_is_scipys_minimum_and_its_noise_that_of_the_fit():
    prior, z = scene(7)
    sensor = Ranges(SENSORS, MODEL)
    found = extended.iterate(prior, z, sensor, iteration=Iteration(rounds=6, tolerance=1e-9))
    inverse = np.linalg.inv(prior.covariance)
    fitted = sensor.predict(found.update.posterior.mean)
    np.testing.assert_allclose(found.noise.variance, sensor.variance(fitted), rtol=1e-6)

    def cost(x):
        misfit = z - sensor.predict(x)
        d = x - prior.mean
        return d @ inverse @ d + (misfit**2 / found.noise.variance).sum()

    best = minimize(cost, prior.mean, method="BFGS", options={"gtol": 1e-9})
    np.testing.assert_allclose(found.update.posterior.mean, best.x, atol=1e-5)


def test_iterated_update_survives_a_start_that_breaks_the_extended_one():
    truth = np.array([1.2, 1.4, 0.0, 0.0])
    z = 1.02 * np.linalg.norm(truth[:2] - SENSORS, axis=1) + 0.1
    prior = Gaussian(np.array([3.7, 3.6, 0.0, 0.0]), np.diag([4.0, 4.0, 1.0, 1.0]))
    once = extended.update(prior, z, Ranges(SENSORS, MODEL)).posterior.mean
    found = extended.iterate(prior, z, Ranges(SENSORS, MODEL))
    assert np.hypot(*(once - truth)[:2]) > 0.2
    assert np.hypot(*(found.update.posterior.mean - truth)[:2]) < 0.02
    assert found.converged


def test_few_steps_are_owned_up_to():
    prior, z = scene(8)
    found = extended.iterate(prior, z, Ranges(SENSORS, MODEL), iteration=Iteration(1, 1))
    assert not found.converged


@pytest.mark.parametrize("weigh", [None, Student()])
def test_many_at_once_with_gaps_is_one_by_one(weigh):
    scenes = [scene(seed) for seed in range(6)]
    mean = np.array([p.mean for p, _ in scenes]).reshape(2, 3, 4)
    P = np.array([p.covariance for p, _ in scenes]).reshape(2, 3, 4, 4)
    z = np.array([z for _, z in scenes]).reshape(2, 3, 4)
    z[0, 1, 2] = z[1, 2, 0] = np.nan
    z[1, 0] = np.nan
    columned = columns([MODEL] * 4)
    tight = Iteration(tolerance=1e-9)

    def run(prior, z, sensor):
        return extended.iterate(prior, z, sensor, weigh=weigh, iteration=tight)

    together = run(Gaussian(mean, P), z, Ranges(SENSORS, columned))
    assert together.converged.all()
    for i in np.ndindex(2, 3):
        made = ~np.isnan(z[i])
        alone = run(Gaussian(mean[i], P[i]), z[i][made], Ranges(SENSORS[made], MODEL)).update
        one = together.update
        np.testing.assert_allclose(one.posterior.mean[i], alone.posterior.mean, atol=1e-8)
        np.testing.assert_allclose(
            one.posterior.covariance[i], alone.posterior.covariance, atol=1e-8
        )
        assert one.log_likelihood[i] == pytest.approx(alone.log_likelihood, abs=1e-6)
        assert one.readings[i] == made.sum()


def test_reweighing_judges_a_reading_by_the_others_alone():
    seen = {}

    def spy(residual, spread, variance):
        seen.update(residual=residual, spread=spread)
        return extended.Noise(np.zeros_like(residual), variance, np.ones_like(residual))

    prior, z = scene(9, spread=0.2)
    z[1] += 0.3
    sensor = Ranges(SENSORS, RangeModel(bias_m=0.1, scale=0.02, sigma_m=0.05))
    tight = Iteration(tolerance=1e-10)
    full = extended.iterate(prior, z, sensor, weigh=spy, iteration=tight).update.posterior.mean
    others = np.arange(4) != 1
    H = sensor.jacobian(full)
    linear = z - sensor.predict(full) + H @ full  # the readings as linear ones, at the fit
    without = kalman.update_information(
        prior, linear[others], H[others], variance=np.full(3, 0.05**2)
    ).posterior
    assert seen["residual"][1] == pytest.approx(linear[1] - H[1] @ without.mean, rel=1e-6)
    expected = H[1] @ without.covariance @ H[1] + 0.05**2
    assert seen["spread"][1] == pytest.approx(expected, rel=1e-6)


def test_steps_predict_first():
    prior, z = scene(10)
    motion, sensor = ConstantVelocity(0.1), Ranges(SENSORS, MODEL)
    moved = kalman.predict(prior, motion.transition(0.2), motion.noise(0.2))
    belief, info = extended.step(prior, z, sensor=sensor, motion=motion, dt_s=0.2)
    np.testing.assert_array_equal(info.prior.mean, moved.mean)
    np.testing.assert_array_equal(belief.mean, extended.update(moved, z, sensor).posterior.mean)
    belief, info = extended.step_iterated(prior, z, sensor=sensor, motion=motion, dt_s=0.2)
    again = extended.iterate(moved, z, sensor).update.posterior
    np.testing.assert_array_equal(belief.mean, again.mean)
    np.testing.assert_array_equal(info.update.posterior.covariance, again.covariance)


def test_a_curved_prediction_of_a_known_turn_is_the_linear_one():
    turn = CoordinatedTurn(0.7, 0.0)
    belief, _ = scene(11)
    P = np.zeros((5, 5))
    P[:4, :4] = belief.covariance
    curved = extended.predict(
        Gaussian(np.append(belief.mean, 0.7), P), UnknownTurn(0.0, 0.0), dt_s=0.5
    )
    linear = kalman.predict(belief, turn.transition(0.5), turn.noise(0.5))
    np.testing.assert_allclose(curved.mean[:4], linear.mean, rtol=1e-12)
    np.testing.assert_allclose(curved.covariance[:4, :4], linear.covariance, rtol=1e-10, atol=1e-14)
