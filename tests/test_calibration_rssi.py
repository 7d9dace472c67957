"""Signal strength calibrated on surveys and runs, against dense Gaussians and the truth."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from trackfield.calibration.fingerprints import calibrate_fingerprints
from trackfield.calibration.rssi import calibrate_rssi
from trackfield.calibration.rssi_law import HeardPlaces, Scatter, fit_laws
from trackfield.calibration.scatter import scatter_of_each
from trackfield.errors import ConfigurationError, InputError
from trackfield.network.fingerprints import Fingerprints
from trackfield.network.radio_map import radio_map
from trackfield.network.site import Site, Target
from trackfield.sensing import rssi
from trackfield.sensing.bearing import BearingModel
from trackfield.sensing.rssi import UNSURVEYED, RssiModel
from trackfield.sensing.rssi_world import draw_shadows, shadow_at, simulate
from trackfield.types import Readings, Truth

PRIOR_LEVEL, PRIOR_EXPONENT = (-70.0, 30.0), (2.0, 1.5)
LAWS = [(-58.0, 1.6), (-62.0, 2.2), (-60.0, 1.9), (-64.0, 2.4)]
TRUE = RssiModel(sigma_db=4.0, shadow_db=3.0, shadow_m=3.0, fading_db=2.0)


def some_heard(seed=0, sizes=(9, 14, 0, 6)):
    rng = np.random.default_rng(seed)
    heard = []
    for k, size in enumerate(sizes):
        place = rng.uniform(0, 12, (size, 2))
        x = 10 * np.log10(rng.uniform(1, 20, size))
        level = -60.0 - 2 * k - 1.8 * x + 3.0 * rng.standard_normal(size)
        heard.append(HeardPlaces(place, x, level, rng.uniform(0.1, 2.0, size)))
    return heard


def dense(heard, laws, scatter, weight):
    """Everything at once: mean and covariance of all levels and all laws, written out."""
    rows = [(i, k) for i, one in enumerate(heard) for k in range(one.x.size)]
    n, m = len(heard), len(rows)
    y = np.array([heard[i].level_dbm[k] for i, k in rows])
    # Unknowns: common level and exponent, then each receiver's deviations from them.
    A = np.zeros((m, 2 + 2 * n))
    K = np.zeros((m, m))
    for r, (i, k) in enumerate(rows):
        lean = laws.centre - heard[i].x[k]
        A[r, :2] = 1.0, lean
        A[r, 2 + 2 * i : 4 + 2 * i] = 1.0, lean
        for s, (j, q) in enumerate(rows):
            if i == j:
                d = math.dist(heard[i].place[k], heard[j].place[q])
                K[r, s] += scatter.shadow_db**2 * math.exp(-d / scatter.shadow_m)
        K[r, r] += (scatter.fading_db**2 + heard[i].noise[k]) / weight[r]
    own = [scatter.level_spread_db**2, scatter.exponent_spread**2]
    prior = np.diag([PRIOR_LEVEL[1] ** 2, PRIOR_EXPONENT[1] ** 2, *(own * n)])
    mean = np.array([PRIOR_LEVEL[0], PRIOR_EXPONENT[0], *([0.0, 0.0] * n)])
    return y, A, K, prior, mean


def test_laws_are_the_posterior_of_one_dense_gaussian():
    heard = some_heard()
    laws = fit_laws(heard)
    y, A, K, prior, mean = dense(heard, laws, laws.scatter, laws.weight)
    S = A @ prior @ A.T + K
    gain = prior @ A.T @ np.linalg.inv(S)
    posterior = mean + gain @ (y - A @ mean)
    covariance = prior - gain @ A @ prior
    np.testing.assert_allclose(laws.common, posterior[:2], rtol=1e-6)
    np.testing.assert_allclose(laws.common_covariance, covariance[:2, :2], rtol=1e-6)
    for i in range(len(heard)):
        both = np.zeros((2, posterior.size))
        both[:, :2] = np.eye(2)
        both[:, 2 + 2 * i : 4 + 2 * i] = np.eye(2)
        np.testing.assert_allclose(laws.own[i], both @ posterior, rtol=1e-6)
        np.testing.assert_allclose(
            laws.covariance[i], both @ covariance @ both.T, rtol=1e-5, atol=1e-9
        )


def test_scatter_is_the_summit_of_the_dense_likelihood():
    heard = some_heard(1, sizes=(20, 25, 15))
    laws = fit_laws(heard)

    def cost(logs):
        scatter = Scatter(*np.exp(logs))
        y, A, K, prior, mean = dense(heard, laws, scatter, laws.weight)
        S = A @ prior @ A.T + K
        away = (logs - np.log(np.array(Scatter()))) / 0.8
        return -multivariate_normal(A @ mean, S).logpdf(y) + 0.5 * away @ away

    best = np.log(np.array(laws.scatter))
    summit = cost(best)
    for e in np.eye(5):
        for step in (-0.1, 0.1):
            assert cost(best + step * e) > summit - 1e-3


def test_errors_of_leaving_one_out_are_those_of_a_fit_without_it():
    heard = some_heard(2, sizes=(8, 10))
    laws = fit_laws(heard)
    y, A, K, _, _ = dense(heard, laws, laws.scatter, laws.weight)
    own = np.diag([laws.scatter.level_spread_db**2, laws.scatter.exponent_spread**2])
    of = np.repeat([0, 1], [8, 10])
    B = A[:, :2]
    for covariance, found in ((K, laws.off), (np.diag(np.diag(K)), laws.off_law)):
        for r in range(y.size):
            rest = np.flatnonzero((of == of[r]) & (np.arange(y.size) != r))
            C = covariance + B @ own @ B.T
            gain = np.linalg.solve(C[np.ix_(rest, rest)], C[rest, r])
            expected = B[r] @ laws.common + gain @ (y[rest] - B[rest] @ laws.common)
            assert found[r] == pytest.approx(y[r] - expected, abs=1e-8)
            if covariance is K:
                assert laws.variance[r] == pytest.approx(C[r, r] - gain @ C[rest, r])


def test_a_gross_fingerprint_hardly_moves_the_laws():
    heard = some_heard(3, sizes=(20, 20))
    clean = fit_laws(heard)
    level = heard[0].level_dbm.copy()
    level[4] -= 40.0
    bad = [heard[0]._replace(level_dbm=level), heard[1]]
    laws = fit_laws(bad)
    assert laws.weight[4] < 0.1
    assert laws.weight[4] == laws.weight.min()
    sigma = np.sqrt(np.diagonal(laws.covariance[0]))
    assert (np.abs(laws.own[0] - clean.own[0]) < sigma).all()


def test_shadow_and_fading_of_many_places_are_found_from_some(monkeypatch):
    heard = some_heard(4, sizes=(90, 90))
    whole = fit_laws(heard)
    monkeypatch.setattr("trackfield.calibration.rssi_law._ENOUGH", 60)
    some = fit_laws(heard)
    assert some.off.size == whole.off.size == 180
    assert some.scatter != whole.scatter
    np.testing.assert_allclose(some.own, whole.own, atol=1.5)


def a_site(models=(UNSURVEYED,) * 4):
    corners = [[0.0, 0.0, 2.0], [14.0, 0.0, 2.5], [14.0, 10.0, 2.0], [0.0, 10.0, 2.5]]
    target = Target(height_m=1.2)
    return Site("hall", ("A", "B", "C", "D"), np.array(corners), models, target=target)


def true_models(model=TRUE):
    return tuple(dataclasses.replace(model, power_dbm=p, exponent=n) for p, n in LAWS)


def a_survey(seed=0, *, n=200, model=TRUE):
    """Readings drawn one by one at 60 places, and their means and deviations."""
    rng = np.random.default_rng(seed)
    site = a_site(true_models(model))
    columns = rssi.columns(true_models(model))
    places = np.column_stack([rng.uniform(0, [14, 10], (60, 2)), np.full(60, 1.2)])
    shadow = shadow_at(draw_shadows(columns, sensors=4, rng=rng), places)
    local = rssi.expected(columns, rssi.distance(site.positions, places)) + shadow
    local += model.fading_db * rng.standard_normal(local.shape)
    white = math.sqrt(model.sigma_db**2 - model.fading_db**2)
    z = local + white * rng.standard_normal((n, *local.shape))
    return site, Fingerprints(
        sensor=np.tile(np.arange(4, dtype=np.int32), 60),
        position=np.repeat(places, 4, axis=0),
        mean_dbm=z.mean(axis=0).ravel(),
        std_db=z.std(axis=0).ravel(),
        count=np.full(240, float(n)),
    )


def test_a_survey_tells_laws_shadow_fading_and_noise():
    _, survey = a_survey()
    found = calibrate_fingerprints(a_site(), survey)
    for row, (power, exponent), model in zip(found.receivers, LAWS, found.site.models, strict=True):
        assert abs(row.power_dbm - power) < 3 * row.power_error_db
        assert abs(row.exponent - exponent) < 3 * row.exponent_error
        assert (model.power_dbm, model.exponent) == (row.power_dbm, row.exponent)
        assert model.sigma_db == pytest.approx(4.0, abs=0.3)
        assert row.fingerprints == 60
    assert found.pooled.shadow_db == pytest.approx(3.0, abs=1.0)
    assert found.pooled.fading_db == pytest.approx(2.0, abs=0.5)
    assert found.site.survey is survey
    assert found.map_error_db < 0.95 * found.law_error_db
    assert found.expected_error_db == pytest.approx(found.map_error_db, rel=0.15)
    assert (found.given, found.used) == (240, 240)


def test_the_map_of_a_calibrated_site_is_nearer_to_the_truth_than_the_law():
    site, survey = a_survey(5)
    kept = np.arange(len(survey)) % 24 >= 4  # every sixth place is left out
    half = Fingerprints(*(getattr(survey, f.name)[kept] for f in dataclasses.fields(survey)))
    found = calibrate_fingerprints(a_site(), half).site
    out = np.flatnonzero(~kept)
    error = {}
    for name, one in (("map", found), ("law", dataclasses.replace(found, survey=None))):
        mean = radio_map(one).expected(survey.position[out]).mean
        off = mean[np.arange(out.size), survey.sensor[out]] - survey.mean_dbm[out]
        error[name] = float(np.sqrt(np.mean(off**2)))
    assert error["map"] < error["law"]
    assert site.survey is None


def test_a_receiver_that_heard_nothing_is_like_the_others_and_less_sure():
    _, survey = a_survey()
    rows = survey.sensor != 2
    some = Fingerprints(*(getattr(survey, f.name)[rows] for f in dataclasses.fields(survey)))
    found = calibrate_fingerprints(a_site(), some)
    lone = found.receivers[2]
    assert lone.fingerprints == 0
    assert lone.off_db == 0.0
    assert lone.power_dbm == pytest.approx(found.pooled.power_dbm)
    assert lone.exponent == pytest.approx(found.pooled.exponent)
    assert lone.exponent_error > max(row.exponent_error for row in found.receivers[:2])


def test_a_survey_without_deviations_leaves_the_noise_of_the_site():
    _, survey = a_survey()
    bare = dataclasses.replace(survey, std_db=np.full(240, np.nan), count=np.full(240, np.nan))
    model = dataclasses.replace(TRUE, sigma_db=5.0, fading_db=3.0)
    found = calibrate_fingerprints(a_site((model,) * 4), bare)
    for one in found.site.models:
        assert one.sigma_db == pytest.approx(math.hypot(4.0, one.fading_db))


def test_what_a_survey_cannot_tell_is_the_sites():
    _, survey = a_survey()
    model = dataclasses.replace(UNSURVEYED, p_blocked=0.3, blocked_db=9.0, min_dbm=-95.0)
    found = calibrate_fingerprints(a_site((model,) * 4), survey).site.models[1]
    assert (found.p_blocked, found.blocked_db, found.min_dbm) == (0.3, 9.0, -95.0)


def few(places, rows_each=1):
    k = len(places)
    return Fingerprints(
        sensor=np.repeat(np.arange(rows_each, dtype=np.int32), k),
        position=np.tile(np.asarray(places, float), (rows_each, 1)),
        mean_dbm=np.full(k * rows_each, -60.0),
        std_db=np.full(k * rows_each, np.nan),
        count=np.full(k * rows_each, np.nan),
    )


@pytest.mark.parametrize(
    ("places", "expected"),
    [
        ([[1, 1, 1]] * 9, "fingerprints of 1 places, expected 5 or more"),
        ([[1, 1, 1], [2, 2, 1], [3, 3, 1], [4, 4, 1]], "of 4 places"),
        ([[3 * math.cos(a), 3 * math.sin(a), 2] for a in range(8)], "expected nearer and farther"),
    ],
)
def test_a_survey_that_tells_no_law_is_refused(places, expected):
    with pytest.raises(InputError, match=expected):
        calibrate_fingerprints(a_site(), few(places))


def test_sensors_of_other_kinds_are_refused():
    with pytest.raises(ConfigurationError, match="kind 'bearing'"):
        calibrate_fingerprints(a_site((BearingModel(),) * 4), a_survey()[1])


def a_run(seed=0, *, model=TRUE, steps=1200, targets=("b",), power_db=(0.0,)):
    """A beacon, or several, carried round the hall; two receivers speak in each step."""
    rng = np.random.default_rng(seed)
    site = a_site(true_models(model))
    t = np.arange(steps) * 0.25
    columns = rssi.columns(true_models(model))
    shadows = draw_shadows(columns, sensors=4, rng=rng)
    rows, truth = [], []
    for k, extra in enumerate(power_db):
        way = t / 9.0 + k
        path = np.column_stack(
            [7 + 6 * np.sin(way) * np.cos(way / 7), 5 + 4 * np.cos(1.3 * way), np.full(steps, 1.2)]
        )
        drawn = simulate(columns, site.positions, path=path, t_s=t, rng=rng, shadows=shadows)
        for step in range(steps):
            pair = (step % 4, (step + 1) % 4)
            rows += [(t[step], i, drawn.value[step, i] + extra, k) for i in pair]
        truth.append(path)
    rows.sort()
    stamp, sensor, value, target = (np.array(column) for column in zip(*rows, strict=True))
    n = stamp.size
    readings = Readings(
        t_s=stamp,
        sensor=sensor.astype(np.int32),
        value=value,
        target=target.astype(np.int32),
        kind=np.zeros(n, np.int32),
        sigma=np.full(n, np.nan),
        arrival_s=np.full(n, np.nan),
        sensor_ids=site.sensor_ids,
        target_ids=targets,
        kinds=("rssi",),
    )
    known = Truth(
        np.tile(t, len(truth)),
        np.repeat(np.arange(len(truth), dtype=np.int32), steps),
        np.concatenate(truth),
        targets,
    )
    return readings, known


def test_a_run_with_truth_tells_laws_and_noise():
    readings, truth = a_run(3)
    found = calibrate_rssi(a_site(), readings, truth)
    for row, (power, exponent) in zip(found.receivers, LAWS, strict=True):
        assert abs(row.power_dbm - power) < 3 * row.power_error_db
        assert abs(row.exponent - exponent) < 3 * row.exponent_error
        assert row.power_error_db < 4.0
    assert found.pooled.sigma_db == pytest.approx(4.0, abs=0.8)
    assert found.pooled.shadow_db == pytest.approx(3.0, abs=1.2)
    assert (found.given, found.used) == (2400, 2400)
    assert found.site.survey is None
    assert found.site.target_models == {}


def test_bodies_and_outliers_of_a_run_are_told_from_noise():
    model = dataclasses.replace(
        TRUE,
        sigma_db=2.0,
        fading_db=0.0,
        shadow_db=0.5,
        p_blocked=0.15,
        blocked_db=9.0,
        blocked_sigma_db=1.0,
        p_outlier=0.04,
        outlier_db=25.0,
    )
    readings, truth = a_run(4, model=model, steps=1600)
    start = RssiModel(blocked_db=9.0, blocked_sigma_db=1.0, outlier_db=25.0)  # no share of either
    found = calibrate_rssi(a_site((start,) * 4), readings, truth).site.models
    assert found[0].p_blocked == pytest.approx(0.15, abs=0.04)
    assert found[0].p_outlier == pytest.approx(0.04, abs=0.02)
    for one, (power, _) in zip(found, LAWS, strict=True):
        assert one.sigma_db == pytest.approx(2.0, abs=0.5)
        level = one.power_dbm - 10 * one.exponent * math.log10(8.0)
        true = power - 10 * LAWS[found.index(one)][1] * math.log10(8.0)
        assert level == pytest.approx(true, abs=0.7)


def test_beacons_that_differ_in_power_get_models_of_their_own():
    readings, truth = a_run(5, targets=("weak", "strong"), power_db=(-4.0, 4.0))
    found = calibrate_rssi(a_site(), readings, truth).site
    assert set(found.target_models) == {"weak", "strong"}
    apart = [
        strong.power_dbm - weak.power_dbm
        for weak, strong in zip(
            found.target_models["weak"], found.target_models["strong"], strict=True
        )
    ]
    np.testing.assert_allclose(apart, 8.0, atol=1.0)
    assert found.models[0].sigma_db < 5.5


def test_cells_grow_where_a_run_covers_much(monkeypatch):
    readings, truth = a_run(6)
    fine = calibrate_rssi(a_site(), readings, truth)
    monkeypatch.setattr("trackfield.calibration.rssi._MOST_CELLS", 30)
    coarse = calibrate_rssi(a_site(), readings, truth)
    assert coarse.off.size <= 4 * 30 < fine.off.size
    assert coarse.pooled.exponent == pytest.approx(fine.pooled.exponent, abs=0.4)


def test_a_run_whose_readings_never_meet_in_a_cell_has_the_noise_of_the_site(monkeypatch):
    readings, truth = a_run(7, steps=60)
    monkeypatch.setattr("trackfield.calibration.rssi._CELL_M", 0.002)
    found = calibrate_rssi(a_site(), readings, truth)
    assert found.off.size == 120
    assert all(4.0 <= model.sigma_db < 7.0 for model in found.site.models)


def altered(readings, **changes):
    return dataclasses.replace(readings, **changes)


def test_readings_without_truth_beside_them_are_refused():
    readings, truth = a_run(8, steps=100)
    late = dataclasses.replace(truth, t_s=truth.t_s + 1e4)
    with pytest.raises(InputError, match="found 0 of 200 readings of kind 'rssi' with truth"):
        calibrate_rssi(a_site(), readings, late)
    other = dataclasses.replace(truth, target_ids=("x",))
    two = altered(readings, target_ids=("b", "c"))
    with pytest.raises(InputError, match="targets of the readings: b, c; of the truth: x"):
        calibrate_rssi(a_site(), two, other)
    with pytest.raises(InputError, match="found 0 of 0"):
        calibrate_rssi(a_site(), altered(readings, kinds=("range",)), truth)
    gaps = dataclasses.replace(truth, t_s=truth.t_s * 100.0)
    slow = altered(readings, t_s=readings.t_s * 100.0 + 1.0)
    with pytest.raises(InputError, match="expected 50 or more"):
        calibrate_rssi(a_site(), slow, gaps)


def test_an_only_truth_serves_an_only_beacon_of_another_name_or_of_none():
    readings, truth = a_run(9, steps=300)
    named = calibrate_rssi(a_site(), readings, truth)
    other = dataclasses.replace(truth, target_ids=("x",))
    assert calibrate_rssi(a_site(), readings, other).receivers == named.receivers
    none = altered(readings, target=np.full(600, -1, np.int32), target_ids=())
    assert calibrate_rssi(a_site(), none, truth).receivers == named.receivers


def test_readings_of_a_stranger_are_refused():
    readings, truth = a_run(8, steps=100)
    strange = altered(readings, sensor_ids=("A", "B", "C", "Z"))
    with pytest.raises(InputError, match="'Z', which is no sensor of the site"):
        calibrate_rssi(a_site(), strange, truth)


def test_scatter_is_shrunk_to_what_sensors_share():
    rng = np.random.default_rng(0)
    sensor = np.repeat(np.arange(5, dtype=np.int32), 200)
    same = 9.0 * rng.chisquare(4, 1000)
    found = scatter_of_each(same, np.full(1000, 4.0), sensor=sensor, count=6)
    np.testing.assert_allclose(found, 3.0, atol=0.12)
    raw = np.sqrt(np.bincount(sensor, same) / 800.0)
    assert np.ptp(found) < 0.7 * np.ptp(raw)
    factor = np.array([0.5, 1.0, 1.0, 1.0, 2.0])
    own = scatter_of_each(same * factor[sensor] ** 2, np.full(1000, 4.0), sensor=sensor, count=6)
    np.testing.assert_allclose(own[:5], 3.0 * factor, rtol=0.08)
    assert own[5] == pytest.approx(math.sqrt((same * factor[sensor] ** 2).sum() / 4000.0))


def test_scatter_of_nothing_is_unknown():
    nothing = scatter_of_each(np.zeros(3), np.zeros(3), sensor=np.zeros(3, np.int32), count=2)
    assert nothing is None
    one = scatter_of_each(np.array([8.0]), np.array([2.0]), sensor=np.zeros(1, np.int32), count=2)
    np.testing.assert_allclose(one, 2.0)


@pytest.mark.recorded
def test_on_the_recorded_survey_the_map_buys_half_a_decibel(shared):
    from trackfield.io.fingerprints import read_fingerprints
    from trackfield.network.site_file import site_from_toml

    text = "sensors_file = 'sensors.csv'\n[models.ble]\nkind = 'rssi'\n[target]\nheight_m = 1.8\n"
    site = site_from_toml(text, shared / "data" / "ble_straight_01")
    file = shared / "data" / "ble_calibration" / "fingerprints.csv"
    survey = read_fingerprints(file, sensor_ids=site.sensor_ids)
    found = calibrate_fingerprints(site, survey)
    assert found.law_error_db < 4.0
    assert found.map_error_db < 3.55
    assert found.expected_error_db == pytest.approx(found.map_error_db, rel=0.03)
    assert min(row.exponent for row in found.receivers) > 0.9
    assert max(row.exponent for row in found.receivers) < 2.0
