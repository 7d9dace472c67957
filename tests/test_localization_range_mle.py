"""Maximum likelihood from ranges: slopes, SciPy as oracle, honest covariances, no failed starts."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import approx_fprime, minimize
from scipy.stats import norm

from trackfield.errors import InputError
from trackfield.linalg import gate, mahalanobis2
from trackfield.localization.range_likelihood import RangeScan, problem, terms
from trackfield.localization.range_mle import cost_gradient_hessian, mle, mle_batch, newton
from trackfield.sensing.range import RangeModel, columns, distance, expected, simulate, variance

SQUARE = np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 2.0], [2.0, 2.0]])
WANG = RangeModel(-0.0386, 0.0174, math.sqrt(7.97e-5), math.sqrt(2.916e-4))
LOUD = RangeModel(0.1, -0.05, 0.05, 0.05)
seeds = st.integers(0, 2**32 - 1)


def scenes(seed, *, d=2, n=5, models=LOUD):
    """A random scan, its true position, and a start not far from it."""
    rng = np.random.default_rng(seed)
    sensors, truth = rng.uniform(0, 5, (n, d)), rng.uniform(0, 5, d)
    ranges = simulate(models, sensors, path=truth[None], rng=rng).value[0]
    return RangeScan(sensors, ranges, models), truth, truth + rng.normal(size=d) * 0.2


def log_likelihood(scan, position):
    """Wang (6), by SciPy."""
    full = position if scan.height_m is None else np.append(position, scan.height_m)
    r = distance(scan.sensors, full)
    mean, v = expected(scan.models, r), variance(scan.models, r)
    return norm.logpdf(scan.ranges, mean, np.sqrt(v)).sum()


@given(seeds, st.sampled_from([2, 3]), st.booleans())
def test_gradient_and_hessian_are_the_slopes_of_the_cost(seed, d, exact):
    scan, _, p = scenes(seed, d=d)
    given_problem = problem(scan)

    def at(x):
        return terms(given_problem, x[None], exact=exact)

    def slope(f, h=1e-5):
        return np.array([(f(p + h * e) - f(p - h * e)) / (2 * h) for e in np.eye(d)])

    near = min(1.0, distance(scan.sensors, p).min())
    size = np.abs(at(p).hessian).max()
    np.testing.assert_allclose(
        at(p).gradient[0], slope(lambda x: at(x).cost[0]), rtol=1e-5, atol=1e-6 * size / near**2
    )
    np.testing.assert_allclose(
        at(p).hessian[0], slope(lambda x: at(x).gradient[0]), atol=1e-5 * size / near**3
    )


@given(seeds)
def test_the_exact_cost_is_minus_the_log_likelihood_but_for_a_constant(seed):
    scan, truth, start = scenes(seed)
    cost = [terms(problem(scan), p[None], exact=True).cost[0] for p in (truth, start)]
    density = [log_likelihood(scan, p) for p in (truth, start)]
    assert cost[0] - cost[1] == pytest.approx(density[1] - density[0], rel=1e-9, abs=1e-9)


def test_the_paper_cost_is_wang_9_term_by_term():
    scan, _, p = scenes(15)
    cost = 0.0
    for c, z in zip(scan.sensors, scan.ranges, strict=True):
        v = 0.05**2 + 0.05**2 * z**2
        cost += (0.95 * math.hypot(*(p - c)) - (z - 0.1)) ** 2 / (2 * v)
    assert cost_gradient_hessian(scan, p).cost == pytest.approx(cost, rel=1e-12)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("seed", range(8))
def test_mle_is_the_maximum_that_scipy_finds(d, seed):
    scan, _, start = scenes(seed, d=d, n=6)
    found = mle(scan, start)
    assert found.converged
    oracle = minimize(
        lambda p: -log_likelihood(scan, p), found.position + 0.01, method="BFGS", tol=1e-9
    )
    sigma = math.sqrt(np.trace(found.covariance))
    np.testing.assert_allclose(found.position, oracle.x, atol=1e-4 * sigma)
    slope = approx_fprime(found.position, lambda p: log_likelihood(scan, p), 1e-7)
    assert np.abs(slope).max() * sigma < 1e-3


def test_a_known_height_is_a_constraint_in_space():
    rng = np.random.default_rng(16)
    sensors = rng.uniform(0, 5, (5, 3))
    truth = np.array([2.0, 3.0, 1.2])
    z = simulate(LOUD, sensors, path=truth[None], rng=rng).value[0]
    flat = mle(RangeScan(sensors, z, LOUD, height_m=1.2), np.array([1.0, 1.0]))
    assert flat.position.shape == (2,)
    oracle = minimize(
        lambda p: -log_likelihood(RangeScan(sensors, z, LOUD), np.append(p, 1.2)),
        flat.position + 0.01,
        method="BFGS",
    )
    np.testing.assert_allclose(flat.position, oracle.x, atol=1e-5)
    free = mle(RangeScan(sensors, z, LOUD), truth)
    assert np.trace(flat.covariance) < np.trace(free.covariance[:2, :2])


def test_each_sensor_may_have_its_own_model():
    rng = np.random.default_rng(17)
    models = columns([RangeModel(0.1 * i, 0.01 * i, 0.02 + 0.05 * i) for i in range(6)])
    sensors, truth = rng.uniform(0, 5, (6, 2)), np.array([2.0, 3.0])
    exact = RangeScan(sensors, expected(models, distance(sensors, truth)), models)
    np.testing.assert_allclose(mle(exact, truth + 0.3).position, truth, atol=1e-8)
    z = simulate(models, sensors, path=truth[None], rng=rng).value[0]
    noisy = RangeScan(sensors, z, models)
    oracle = minimize(lambda p: -log_likelihood(noisy, p), truth, method="BFGS")
    np.testing.assert_allclose(mle(noisy, truth).position, oracle.x, atol=1e-6)


@given(seeds, st.floats(0, 2 * math.pi))
def test_a_moved_and_turned_world_has_a_moved_and_turned_answer(seed, angle):
    scan, _, start = scenes(seed)
    R = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    shift = np.array([30.0, -20.0])
    here = mle(scan, start)
    there = mle(scan._replace(sensors=scan.sensors @ R.T + shift), R @ start + shift)
    np.testing.assert_allclose(there.position, R @ here.position + shift, atol=1e-6)
    np.testing.assert_allclose(there.covariance, R @ here.covariance @ R.T, rtol=1e-4, atol=1e-8)


def test_readings_not_used_do_not_count_and_order_does_not_matter():
    scan, _, start = scenes(18, n=6)
    spoiled = scan._replace(ranges=np.append(scan.ranges[:5], 99.0))
    used = np.array([[True] * 5 + [False]])
    masked = mle_batch(spoiled, start, used=used).row(0)
    fewer = mle(scan._replace(sensors=scan.sensors[:5], ranges=scan.ranges[:5]), start)
    np.testing.assert_allclose(masked.position, fewer.position, atol=1e-10)
    np.testing.assert_allclose(masked.covariance, fewer.covariance, rtol=1e-9)
    turned = mle(scan._replace(sensors=scan.sensors[::-1], ranges=scan.ranges[::-1]), start)
    np.testing.assert_allclose(turned.position, mle(scan, start).position, atol=1e-9)


def test_a_batch_is_its_scans_one_by_one():
    rng = np.random.default_rng(19)
    truth = rng.uniform(0, 2, (20, 2))
    z = simulate(WANG, SQUARE, path=truth[:, None], rng=rng).value[:, 0]
    starts = rng.uniform(0, 2, (20, 2))
    together = mle_batch(RangeScan(SQUARE, z, WANG), starts)
    for i in range(20):
        alone = mle(RangeScan(SQUARE, z[i], WANG), starts[i])
        np.testing.assert_allclose(together.position[i], alone.position, atol=1e-10)
        assert together.row(i).cost == pytest.approx(alone.cost)


def cloud(runs, *, box, seed=20):
    rng = np.random.default_rng(seed)
    truth = rng.uniform(0.1, 1.9, (runs, 2))  # nearer to a sensor there really are two minima
    z = simulate(WANG, SQUARE, path=truth[:, None], rng=rng).value[:, 0]
    return RangeScan(SQUARE, z, WANG), truth, rng.uniform(*box, (runs, 2))


@pytest.mark.parametrize("box", [(0.0, 2.0), (-4.0, 6.0)])
def test_no_start_of_4000_fails(box):
    scan, truth, starts = cloud(4000, box=box)
    found, wanted = mle_batch(scan, starts), mle_batch(scan, truth)
    assert found.converged.all()
    assert found.determined.all()
    assert np.abs(found.position - wanted.position).max() < 1e-6


def test_the_search_never_ends_uphill_of_its_start():
    rng = np.random.default_rng(33)
    model = RangeModel(sigma_m=0.3)
    sensors = np.array([[0.0, 0.0], [5.0, 0.2], [2.0, 0.4]])
    truth, starts = rng.uniform(-5, 10, (4000, 2)), rng.uniform(-50, 50, (4000, 2))
    z = simulate(model, sensors, path=truth[:, None], rng=rng).value[:, 0]
    scan = RangeScan(sensors, z, model)
    found = mle_batch(scan, starts)
    assert found.converged.mean() > 0.999
    assert (found.cost <= terms(problem(scan), starts, exact=False).cost).all()
    near = mle_batch(scan, found.position + rng.normal(size=starts.shape) * 0.01)
    assert (near.cost >= found.cost - 1e-9).all()  # and at a minimum


def test_gross_errors_in_a_bad_geometry_do_not_drive_the_search_away():
    rng = np.random.default_rng(34)
    model = RangeModel(sigma_m=0.05, sigma_scale=0.1)
    sensors = np.array([[0.0, 0.0], [5.0, 0.01], [2.0, 0.03]])
    truth, starts = rng.uniform(-5, 10, (2000, 2)), rng.uniform(-20, 20, (2000, 2))
    z = simulate(model, sensors, path=truth[:, None], rng=rng).value[:, 0]
    scan = RangeScan(sensors, z + np.array([3.0, 0.0, 0.0]), model)
    found = mle_batch(scan, starts)
    assert found.converged.mean() > 0.998
    given_problem = problem(scan)
    before = terms(given_problem, starts, exact=True).cost
    assert np.mean(found.cost <= before) > 0.998


def test_a_few_iterations_do():
    scan, _, starts = cloud(4000, box=(0.0, 2.0))
    found = mle_batch(scan, starts)
    assert found.iterations.mean() < 8.0
    assert mle_batch(scan, found.position).iterations.max() <= 6


def test_raw_newton_goes_astray_where_the_damped_search_does_not():
    scan, truth, starts = cloud(300, box=(0.0, 2.0))
    found = [newton(scan._replace(ranges=z), p) for z, p in zip(scan.ranges, starts, strict=True)]
    lost = sum(not f.determined for f in found)
    assert 3 <= lost <= 40  # a few per cent: saddles and maxima
    good = np.array([f.determined for f in found])
    away = np.linalg.norm([f.position for f in found] - truth, axis=1)
    assert np.mean(away[good] < 0.2) > 0.97


def test_newton_gives_the_inverse_hessian_where_it_ends():
    scan, _, start = scenes(21)
    found = newton(scan, start)
    assert found.converged
    assert found.determined
    at = cost_gradient_hessian(scan, found.position)
    assert np.abs(at.gradient).max() < 1e-6
    np.testing.assert_allclose(found.covariance, np.linalg.inv(at.hessian), rtol=1e-9)


def test_covariances_are_those_of_repetition():
    scan, truth, _ = cloud(4000, box=(0.0, 2.0))
    found = mle_batch(scan, truth)
    nees, ok = mahalanobis2(found.position - truth, found.covariance)
    assert ok.all()
    assert nees.mean() == pytest.approx(2.0, abs=0.12)
    assert np.mean(nees < gate(0.95, 2)) == pytest.approx(0.95, abs=0.012)


def test_one_sensor_leaves_a_huge_finite_variance_across_and_says_so():
    scan = RangeScan(np.zeros((1, 2)), np.array([3.0]), RangeModel(sigma_m=0.1))
    found = mle(scan, np.array([2.0, 0.0]))
    np.testing.assert_allclose(found.position, [3.0, 0.0], atol=1e-8)
    assert not found.determined
    np.testing.assert_allclose(found.covariance[0, 0], 0.01)
    assert 1e6 < found.covariance[1, 1] < math.inf


def test_starts_at_a_sensor_and_noise_that_vanishes_there_are_survived():
    scan, truth, _ = scenes(22, models=RangeModel(sigma_m=0.0, sigma_scale=0.02))
    wanted = mle(scan, truth)
    for start in scan.sensors:
        found = mle(scan, start)
        assert np.isfinite(found.position).all()
        assert np.isfinite(found.covariance).all()
    assert wanted.converged
    assert np.linalg.norm(wanted.position - truth) < 0.3


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sensors": np.zeros((4, 4))}, "expected"),
        ({"ranges": np.ones(3)}, "for 4 sensors"),
        ({"ranges": np.array([1.0, 1.0, 1.0, -1.0])}, "not negative"),
        ({"ranges": np.array([1.0, 1.0, 1.0, np.nan])}, "finite"),
        ({"sensors": np.full((4, 2), np.inf)}, "finite"),
        ({"models": RangeModel(sigma_m=0.0)}, "noise above zero"),
        ({"models": RangeModel(scale=-1.0)}, "scale above -1"),
        ({"height_m": 1.0}, "three coordinates"),
    ],
)
def test_scans_that_cannot_be_are_refused(change, message):
    scan = RangeScan(SQUARE, np.ones(4), WANG)._replace(**change)
    with pytest.raises(InputError, match=message):
        mle(scan, np.ones(2))


def test_starts_that_do_not_fit_are_refused():
    scan = RangeScan(SQUARE, np.ones(4), WANG)
    with pytest.raises(InputError, match="starts of shape"):
        mle(scan, np.ones(3))
    with pytest.raises(InputError, match="finite"):
        mle(scan, np.array([np.nan, 0.0]))
    with pytest.raises(InputError, match="2 scans for 3"):
        mle_batch(scan._replace(ranges=np.ones((2, 4))), np.ones((3, 2)))
