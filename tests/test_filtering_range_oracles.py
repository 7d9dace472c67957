"""The compiled tracker against what is written elsewhere: EKF, IEKF, IMM, smoother, quadrature."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import minimize
from scipy.stats import norm

from range_runs import Heard, box, run, scans, table
from range_snapshot import opened, rewritten
from range_twin import decaying_noise, told
from trackfield.filtering import extended, interacting, kalman, smoothing
from trackfield.filtering.extended import Ranges
from trackfield.filtering.smoothing import Lag, Passed
from trackfield.sensing import range as ranging
from trackfield.sensing.range import RangeModel
from trackfield.types import Gaussian, join_rows

NOISE = RangeModel(sigma_m=0.1, sigma_scale=0.01)
ONCE = {"robust": 0, "iterations": 1, "velocity_time": 10.0}
DT = 0.3  # with the velocity's memory above, long enough for exact noise


@dataclass(frozen=True)
class Decaying:
    """White acceleration of density q, velocity forgotten with time constant 1/beta: Van Loan."""

    q: float
    beta: float = 0.1
    dimensions: int = 2

    def transition(self, dt_s):
        return self._both(dt_s)[0]

    def noise(self, dt_s):
        return self._both(dt_s)[1]

    def _both(self, dt):
        D = self.dimensions
        A, L = np.zeros((2 * D, 2 * D)), np.zeros((2 * D, 2 * D))
        A[:D, D:] = np.eye(D)
        A[D:, D:] = -self.beta * np.eye(D)
        L[D:, D:] = self.q * np.eye(D)
        whole = expm(np.block([[-A, L], [np.zeros_like(A), A.T]]) * dt)
        F = whole[2 * D :, 2 * D :].T
        return F, F @ whole[: 2 * D, 2 * D :]


def started(site, scan, **changed):
    """A tracker with a track, and the belief it begins with."""
    tracker, _, _ = told(site, **changed)
    first = tracker.process(table(site, scan), watermark_s=scan[-1].t)
    belief = opened(tracker._bank.snapshot()).targets[0].belief
    assert belief.alive
    return tracker, first, Gaussian(np.array(belief.mean), np.array(belief.covariance))


def dense(site, scan):
    """Readings of a scan as a row over all sensors, NaN where not made."""
    z = np.full(8, np.nan)
    z[[h.sensor for h in scan]] = [h.value for h in scan]
    return z


def steady(site, *, steps=40, seed=1, **asked):
    rng = np.random.default_rng(seed)
    return run(rng, site, 100.0 + DT * np.arange(steps), **asked)


def shown(rows, D):
    """Beliefs as rows show them: mean of position and velocity; xx, xy, yy."""
    return np.hstack([rows.position[:, :D], rows.velocity[:, :D]]), rows.covariance


def corner(P):
    return P[..., [0, 0, 1], [0, 1, 1]]


@pytest.mark.parametrize("dimensions", [2, 3])
def test_one_gaussian_mode_is_the_ekf(dimensions):
    heights = (0.3, 6.0, 3.0) if dimensions == 3 else None
    site = box(
        NOISE,
        replace(NOISE, bias_m=0.2, scale=0.02),
        motion="cv",
        dimensions=dimensions,
        heights=heights,
    )
    (_, first), *rest = scans(steady(site))
    tracker, _, belief = started(site, first, **ONCE)
    rows = join_rows(
        [tracker.process(table(site, [z for _, s in rest for z in s])), tracker.finish()]
    )
    sensor = Ranges(site.positions[:, :dimensions], ranging.columns(site.models))
    motion = Decaying(0.5, dimensions=dimensions)
    for k, (_, scan) in enumerate(rest):
        prior = kalman.predict(belief, motion.transition(DT), motion.noise(DT))
        r = ranging.distance(sensor.sensors, prior.mean[:dimensions])
        variance = ranging.variance(sensor.models, r)
        belief = extended.update(prior, dense(site, scan), sensor, variance=variance).posterior
        mean, P = shown(rows, dimensions)
        np.testing.assert_allclose(mean[k], belief.mean, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(P[k], corner(belief.covariance), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_iterations_end_where_the_iekf_does(seed):
    """From a prior that is a metre wrong; what is left is far below the noise."""
    site = box(RangeModel(sigma_m=0.1), size=5.0, motion="cv")
    (_, first), *_ = scans(steady(site, seed=seed, steps=1))
    tracker, _, belief = started(site, first, robust=0, iterations=20, velocity_time=10.0)
    mean = belief.mean + np.array([np.cos(seed), np.sin(seed), 0.0, 0.0])
    P = np.diag([0.5, 0.5, 0.1, 0.1])
    tracker._bank.restore(rewritten(tracker._bank.snapshot(), 0, mean, P))
    scan = [z._replace(t=100.0 + DT) for z in first[:5]]
    tracker.process(table(site, scan))
    rows = tracker.finish()
    motion = Decaying(0.5)
    prior = kalman.predict(Gaussian(mean, P), motion.transition(DT), motion.noise(DT))
    sensor = Ranges(site.positions[:, :2], site.models[0])
    iterated = extended.iterate(prior, dense(site, scan), sensor)
    assert iterated.converged
    posterior = iterated.update.posterior
    off = (shown(rows, 2)[0][0] - posterior.mean)[:2]
    assert off @ np.linalg.solve(posterior.covariance[:2, :2], off) < 0.05**2
    np.testing.assert_allclose(
        rows.covariance[0], corner(posterior.covariance), rtol=0.05, atol=2e-4
    )
    once = extended.update(prior, dense(site, scan), sensor).posterior
    far = (once.mean - posterior.mean)[:2]
    assert far @ np.linalg.solve(posterior.covariance[:2, :2], far) > 4 * 0.05**2


def test_modes_that_go_straight_are_the_imm():
    site = box(NOISE)
    modes = [
        {"accel_density": q, "turns": 0, "switch_rate": r}
        for q, r in ((0.01, 0.3), (0.2, 1.0), (3.0, 2.0))
    ]
    (_, first), *rest = scans(steady(site, noise=0.2))
    tracker, _, belief = started(site, first, modes=modes, **ONCE)
    rows = join_rows(
        [tracker.process(table(site, [z for _, s in rest for z in s])), tracker.finish()]
    )
    # The kernel lets go of a mode at its rate and draws the next from all of them.
    leave = 2 / 3 * (1 - np.exp([-m["switch_rate"] * DT for m in modes]))
    bank = interacting.Bank(
        tuple(Decaying(m["accel_density"]) for m in modes), tuple(-DT / np.log(1 - leave))
    )
    sensor = Ranges(site.positions[:, :2], site.models[0])

    def rule(prior, z):
        r = ranging.distance(sensor.sensors, prior.mean[..., :2])
        return extended.update(prior, z, sensor, variance=ranging.variance(sensor.models, r))

    imm = interacting.init(belief, (1, 1, 1))
    mean, P = shown(rows, 2)
    for k, (_, scan) in enumerate(rest):
        imm, _ = interacting.step(imm, dense(site, scan), rule=rule, bank=bank, dt_s=DT)
        whole = interacting.combined(imm)
        np.testing.assert_allclose(mean[k], whole.mean, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(P[k], corner(whole.covariance), rtol=1e-9, atol=1e-12)
    found = opened(tracker._bank.snapshot()).targets[0].belief.probability[:3]
    np.testing.assert_allclose(found, imm.weights, rtol=1e-8)
    assert np.ptp(imm.weights) > 0.1


def test_rows_with_a_lag_are_the_smoother_s():
    site = box(NOISE, motion="cv")
    (_, first), *rest = scans(steady(site))
    tracker, begun, belief = started(site, first, lag_steps=3, **ONCE)
    later = tracker.process(table(site, [z for _, s in rest for z in s]))
    rows = join_rows([begun, later])
    sensor, motion = Ranges(site.positions[:, :2], site.models[0]), Decaying(0.5)
    lag, k = Lag(), 0
    for _, scan in rest[:-1]:  # the last scan is still open
        F = motion.transition(DT)
        prior = kalman.predict(belief, F, motion.noise(DT))
        r = ranging.distance(sensor.sensors, prior.mean[:2])
        variance = ranging.variance(sensor.models, r)
        after = extended.update(prior, dense(site, scan), sensor, variance=variance).posterior
        lag, smoothed = smoothing.step(lag, Passed(belief, F, prior), now=after, lag=3)
        belief = after
        if smoothed is not None:
            mean, P = shown(rows, 2)
            np.testing.assert_allclose(mean[k], smoothed.mean, rtol=1e-8, atol=1e-8)
            np.testing.assert_allclose(P[k], corner(smoothed.covariance), rtol=1e-8, atol=1e-10)
            k += 1
    assert k == len(rows) > 30


@pytest.mark.parametrize("error", [0.0, 0.25, 0.6, 1.0, -1.0, 4.0])
def test_a_mixture_keeps_the_moments_of_the_exact_posterior(error):
    """One far sensor, so that the range is straight: mean and variance by quadrature."""
    site = box(RangeModel(sigma_m=0.1), motion="cv")
    far = np.array(site.positions)
    far[7] = [1000.0, 0.0, np.nan]
    site = replace(site, positions=far)
    at, spread = np.zeros(2), 0.3
    first = [Heard(100.0, i, float(np.linalg.norm(at - far[i, :2]))) for i in range(8)]
    tracker, _, _ = started(site, first)
    mean, P = np.zeros(4), np.diag([spread**2, spread**2, 1.0, 1.0])
    tracker._bank.restore(rewritten(tracker._bank.snapshot(), 0, mean, P))
    tracker.process(table(site, [Heard(100.0 + 1e-6, 7, 1000.0 + error)]))
    rows = tracker.finish()

    x = np.linspace(-3.0, 3.0, 20_001)  # the range grows towards -x
    joint = norm.pdf(x, 0, spread) * (
        0.88 * norm.pdf(error + x, 0, 0.1)
        + 0.10 * norm.pdf(error + x, 0.5, np.hypot(0.1, 0.5))
        + 0.02 * norm.pdf(error + x, 0, np.hypot(0.1, 3.0))
    )
    expected = np.average(x, weights=joint)
    variance = np.average((x - expected) ** 2, weights=joint)
    assert rows.position[0, 0] == pytest.approx(expected, abs=1e-5)
    assert rows.covariance[0, 0] == pytest.approx(variance, rel=1e-4)


@pytest.mark.parametrize("dimensions", [2, 3])
@pytest.mark.parametrize("seed", range(2))
def test_a_start_is_the_best_of_many_descents(seed, dimensions):
    """The least Cauchy cost by another minimizer, and the curvature there."""
    heights = (0.3, 6.0, 3.0) if dimensions == 3 else None
    model = RangeModel(
        sigma_m=0.1, bias_m=0.1, scale=0.01, correlated_sigma_m=0.05, bias_sigma_m=0.04
    )
    site = box(model, dimensions=dimensions, heights=heights, window_s=0.0)
    rng = np.random.default_rng(seed)
    truth = rng.uniform(-4, 4, 3) * (1, 1, dimensions == 3)
    at = np.nan_to_num(site.positions)
    r = np.linalg.norm(truth - at, axis=1)
    z = 1.01 * r + 0.1 + 0.1 * rng.standard_normal(8)
    z[2] += 1.5  # late
    first = [Heard(99.0 + 0.1 * k, int(i), float(z[i])) for k, i in enumerate(rng.permutation(8))]
    used = first[:6]  # six readings of four sensors suffice
    _, rows, belief = started(site, used)
    assert rows.t_s == [used[-1].t]

    def terms(p):
        i = [h.sensor for h in used]
        d = p - at[i, :dimensions]
        if dimensions == 2:
            d = np.column_stack([d, -at[i, 2]])
        r = np.linalg.norm(d, axis=1)
        e = np.array([h.value for h in used]) - 1.01 * r - 0.1
        age = used[-1].t - np.array([h.t for h in used])
        V = (1.5 * age) ** 2 + 0.05**2 + 0.04**2 + 0.1**2
        return e, V, 1.01 * d[:, :dimensions] / r[:, None]

    def cost(p):
        e, V, _ = terms(p)
        return 2 * np.log1p(e**2 / (4 * V)).sum()

    found = min(
        (minimize(cost, rng.uniform(-15, 15, dimensions), method="BFGS") for _ in range(12)),
        key=lambda m: m.fun,
    )
    np.testing.assert_allclose(belief.mean[:dimensions], found.x, atol=1e-4)
    e, V, J = terms(belief.mean[:dimensions])
    weight = 1 / (V * (1 + e**2 / (4 * V)))
    inverse = np.linalg.inv(J.T @ (weight[:, None] * J))
    np.testing.assert_allclose(
        belief.covariance[:dimensions, :dimensions], inverse, rtol=1e-3, atol=1e-8
    )


@pytest.mark.parametrize("x", [1e-4, 0.005, 0.0199, 0.0201, 0.3, 3.0])
def test_noise_of_a_decaying_velocity_is_its_integral(x):
    """The shared formula is the exact one, but for 2e-4 of the position's variance."""
    beta = 0.01
    dt = x / beta
    pp, pv, vv = decaying_noise(0.7, beta, dt)
    exact = Decaying(0.7, beta).noise(dt)
    assert vv == pytest.approx(exact[2, 2], rel=1e-9)
    assert pv == pytest.approx(exact[0, 2], rel=1e-7)
    assert pp == pytest.approx(exact[0, 0], rel=2e-4)
