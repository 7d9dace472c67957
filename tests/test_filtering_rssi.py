"""Beacons by signal strength: each stage against an independent computation, and the laws."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import expm

from trackfield.errors import ConfigurationError, InputError, StateError
from trackfield.filtering import rssi_prior, rssi_tracker
from trackfield.filtering.rssi_cloud import (
    Cloud,
    Fading,
    Moments,
    UsualPaths,
    Walk,
    carried,
    confined,
    effective,
    fade,
    going,
    joined,
    moments,
    move,
    resampled,
    weights,
)
from trackfield.filtering.rssi_evidence import PathBelief, hear, surprise
from trackfield.filtering.rssi_field import field
from trackfield.filtering.rssi_state import RssiState, pack, unpack
from trackfield.filtering.scans import Scan
from trackfield.network.fingerprints import Fingerprints
from trackfield.network.radio_map import radio_map
from trackfield.network.site import ReportSettings, Room, Site, Target, TrackerSettings
from trackfield.raster import Region
from trackfield.sensing import rssi
from trackfield.sensing.bearing import BearingModel
from trackfield.sensing.rssi import RssiModel
from trackfield.types import Status

PLAIN = RssiModel(power_dbm=-60.0, exponent=2.0, sigma_db=3.0)
CORNERS = np.array([[0.0, 0, 2], [12, 0, 2], [0, 10, 2], [12, 10, 2], [6, 5, 2]])
SHADY = RssiModel(
    power_dbm=-60.0,
    exponent=1.8,
    sigma_db=4.0,
    shadow_db=3.0,
    shadow_m=3.0,
    fading_db=2.0,
    p_blocked=0.1,
    p_outlier=0.02,
)


def hall(model=PLAIN, *, survey=None, **target):
    n = len(CORNERS)
    return Site(
        "hall",
        tuple("ABCDE"),
        CORNERS,
        (model,) * n,
        target=Target(**{"height_m": 1.2, **target}),
        survey=survey,
    )


def surveyed(model=SHADY, seed=3):
    rng = np.random.default_rng(seed)
    x, y = (g.ravel() for g in np.meshgrid(np.arange(0, 13, 3.0), np.arange(0, 11, 2.5)))
    n, m = x.size, len(CORNERS)
    place = np.column_stack([x, y, np.full(n, 1.2)])
    survey = Fingerprints(
        sensor=np.repeat(np.arange(m), n).astype(np.int32),
        position=np.tile(place, (m, 1)),
        mean_dbm=rng.uniform(-85, -65, m * n),
        std_db=np.full(m * n, np.nan),
        count=np.full(m * n, np.nan),
    )
    return hall(model, survey=survey)


def scan(t_s, values, sensors=None, sigma=math.nan):
    sensors = range(len(values)) if sensors is None else sensors
    return Scan(
        t_s, np.array(sensors, np.int32), np.array(values, float), np.full(len(values), sigma)
    )


def readings(place, model=PLAIN, *, rng=None, height_m=1.2):
    r = np.linalg.norm(CORNERS - [*place, height_m], axis=1)
    noise = 0.0 if rng is None else model.sigma_db * rng.standard_normal(r.size)
    return rssi.expected(model, r) + noise


def run(tracker, scans, state=None):
    states = [tracker.start() if state is None else state]
    for one in scans:
        states.append(tracker.step(states[-1], one))
    return states[1:]


def a_cloud(n=50, slots=2, seed=0):
    rng = np.random.default_rng(seed)
    return Cloud(
        rng.normal(5, 2, (3, n)),
        rng.normal(0, 0.5, (3, n)),
        rng.random(n) < 0.7,
        rng.normal(0, 1, n),
        np.log(rng.random(n)),
        np.arange(slots, dtype=np.int32),
        rng.normal(0, 2, (slots, n)),
        rng.uniform(0.5, 9, (slots, n)),
        rng.uniform(0, 1, (slots, n)),
    )


def assert_same(first, second):
    for a, b in zip(first, second, strict=True):
        assert_array_equal(a, b)


# --- what readings say ---------------------------------------------------------------------------


@pytest.mark.parametrize("model", [PLAIN, SHADY, replace(SHADY, p_outlier=0.0)])
def test_a_reading_gives_the_likelihood_and_moments_of_an_integral_over_the_shadow(model):
    rng = np.random.default_rng(1)
    off, mean, var = rng.normal(0, 8, 6), rng.normal(0, 2, 6), rng.uniform(0.5, 9, 6)
    blocked = rng.uniform(0.0, 0.9, 6)
    heard = hear(
        rssi.columns([model] * 3),
        np.array([2], np.int32),
        off_db=off[None],
        sigma_db=np.array([3.0]),
        path=PathBelief(mean[None], var[None], blocked[None]),
    )
    g = np.linspace(-60, 60, 240_001)
    for i in range(off.size):
        believed, white = replace(model, p_blocked=blocked[i]), np.full(g.size, 9.0)
        prior = np.exp(-0.5 * (g - mean[i]) ** 2 / var[i]) / math.sqrt(2 * math.pi * var[i])
        like = np.exp(rssi.log_density(believed, off[i] - g, variance=white))
        total = np.trapezoid(prior * like, g)
        first = np.trapezoid(prior * like * g, g) / total
        second = np.trapezoid(prior * like * g * g, g) / total
        hidden = rssi.shares(believed, off[i] - g, variance=white)[1]
        assert_allclose(heard.log_likelihood[i], math.log(total), atol=1e-6)
        assert_allclose(heard.path.shadow_db[0, i], first, atol=1e-6)
        assert_allclose(heard.path.shadow_var[0, i], second - first**2, atol=1e-5)
        blocked_now = np.trapezoid(prior * like * hidden, g) / total
        assert_allclose(heard.path.blocked[0, i], blocked_now, atol=1e-6)


def test_readings_of_several_receivers_say_as_much_as_one_by_one():
    rng = np.random.default_rng(2)
    off = rng.normal(0, 8, (3, 9))
    path = PathBelief(
        rng.normal(0, 2, (3, 9)), rng.uniform(0, 9, (3, 9)), rng.uniform(0, 0.9, (3, 9))
    )
    models = rssi.columns([SHADY, PLAIN, SHADY])
    who, sigma = np.array([2, 0, 1], np.int32), np.array([4.0, 4.0, 3.0])
    heard = hear(models, who, off_db=off, sigma_db=sigma, path=path)
    parts = [
        hear(
            models,
            who[[k]],
            off_db=off[[k]],
            sigma_db=sigma[[k]],
            path=PathBelief(*(column[[k]] for column in path)),
        )
        for k in range(3)
    ]
    assert_allclose(heard.log_likelihood, sum(p.log_likelihood for p in parts), rtol=1e-12)
    for column, one_by_one in zip(
        heard.path, zip(*(p.path for p in parts), strict=True), strict=True
    ):
        assert_allclose(column, np.concatenate(one_by_one), rtol=1e-10)


def test_surprise_is_one_a_reading_in_the_mean_of_what_is_believed():
    rng = np.random.default_rng(3)
    n = 40_000
    model = replace(SHADY, p_outlier=0.05)
    path = PathBelief(*(np.full((1, 2), x) for x in (1.0, 4.0, 0.3)))
    off = np.array([[0.0, 3.0]])
    w = np.array([0.4, 0.6])
    kind = rng.random(n)
    # What is heard, told from the first particle's mean; the second expects 3 dB less.
    z = np.where(rng.random(n) < 0.4, 0.0, -3.0) + rng.normal(1.0, math.sqrt(4.0 + 16.0), n)
    z -= np.where(kind < 0.3, rng.normal(6.0, 3.0, n), 0.0)
    z += np.where(kind > 0.95, rng.normal(0.0, 20.0, n), 0.0)
    columns, who = rssi.columns([model]), np.zeros(1, np.int32)
    every = [
        surprise(columns, who, off_db=off + x, sigma_db=np.array([4.0]), path=path, w=w) for x in z
    ]
    assert np.mean(every) == pytest.approx(1.0, abs=0.03)


def test_a_reading_beyond_all_belief_stays_finite():
    heard = hear(
        rssi.columns([PLAIN]),
        np.zeros(1, np.int32),
        off_db=np.full((1, 4), 1e6),
        sigma_db=np.array([3.0]),
        path=PathBelief(np.zeros((1, 4)), np.full((1, 4), 4.0), np.zeros((1, 4))),
    )
    assert np.all(np.isfinite(heard.log_likelihood))
    assert np.all(np.isfinite(heard.path.shadow_db))
    assert np.all(heard.path.shadow_var >= 0.0)


# --- the field -----------------------------------------------------------------------------------


def test_without_a_survey_strengths_are_the_law():
    found, rng = field(hall()), np.random.default_rng(0)
    places = np.vstack([rng.uniform(0, 10, (2, 20)), rng.uniform(0, 3, 20)])
    who = np.array([4, 0], np.int32)
    r = rssi.distance(CORNERS[who], places.T)
    assert_allclose(found.strength(who, places), rssi.expected(PLAIN, r).T, rtol=1e-12)
    assert_array_equal(field(hall(SHADY)).unknown(who, places), [[9.0], [9.0]])


def test_with_a_survey_strengths_are_the_radio_map_between_the_corners_of_cells():
    site = surveyed()
    found, chart = field(site), radio_map(site)
    assert found.table is not None
    x0, y0 = found.table.corner
    who = np.arange(5, dtype=np.int32)
    rng = np.random.default_rng(1)
    corners = np.column_stack(
        [x0 + 0.5 * rng.integers(4, 20, 30), y0 + 0.5 * rng.integers(4, 20, 30)]
    )
    between = rng.uniform(1, 9, (300, 2))
    for places, off_db, off_var in ((corners, 1e-4, 1e-4), (between, 0.9, 1.5)):
        told = chart.expected(places)
        flat = np.vstack([places.T, np.full(len(places), 1.2)])
        assert_allclose(found.strength(who, flat).T, told.mean, atol=off_db)
        assert_allclose(found.unknown(who, flat).T, told.variance + 3.0, atol=off_var)


def test_targets_are_taken_to_be_where_the_site_says_or_about_its_receivers():
    assert field(hall()).area == pytest.approx(Region(-1.2, -1.2, 13.2, 11.2))
    told = Region(1.0, 2.0, 3.0, 4.0)
    assert field(replace(hall(), reports=ReportSettings(region=told))).area == told
    room = Room("attic", ((0.0, 0.0), (4.0, 0.0), (4.0, 11.0)))
    assert field(replace(hall(), rooms=(room,))).area == Region(0.0, 0.0, 12.0, 11.0)
    row = replace(hall(), positions=CORNERS[:2], sensor_ids=("A", "B"), models=(PLAIN,) * 2)
    assert field(row).area == pytest.approx(Region(-6.0, -6.0, 18.0, 6.0))
    long = replace(hall(), positions=CORNERS * [1.0, 0.1, 1.0])
    assert field(long).area == pytest.approx(Region(-1.2, -3.1, 13.2, 4.1))
    alone = replace(hall(), positions=CORNERS[:1], sensor_ids=("A",), models=(PLAIN,))
    assert field(alone).area == pytest.approx(Region(-10.0, -10.0, 10.0, 10.0))


def test_beside_a_line_of_receivers_a_beacon_may_be_on_either_side():
    line = np.array([[0.0, 0.0, 2.0], [10.0, 0.0, 2.0], [20.0, 0.0, 2.0]])
    site = Site("line", ("A", "B", "C"), line, (PLAIN,) * 3)
    assert field(site).area == Region(-10.0, -10.0, 30.0, 10.0)
    tracker = rssi_tracker.create(site, seed=1)
    level = rssi.expected(PLAIN, rssi.distance(line, np.array([14.0, 5.0, 2.0])))
    state = run(tracker, [scan(float(t), level) for t in range(20)])[-1]
    shown = tracker.shown(state, 19.0)
    assert abs(shown.position[0] - 14.0) < 3.0
    assert shown.covariance[2] > 3.0**2  # both sides


def test_a_big_site_has_a_table_of_bounded_size():
    site = surveyed()
    far = np.array(CORNERS) * [400.0, 400.0, 1.0]
    table = field(replace(site, positions=far)).table
    assert table is not None
    assert table.mean.size < 1_100_000


def test_other_sensors_are_refused():
    site = hall()
    with pytest.raises(ConfigurationError, match="expected 'rssi'"):
        rssi_tracker.create(replace(site, models=(*site.models[:-1], BearingModel())))


# --- the cloud -----------------------------------------------------------------------------------


def test_walking_has_the_moments_of_the_process_and_of_what_is_carried_ahead():
    n, dt = 200_000, 1.5
    walk = Walk(stops_per_s=0.0, goes_per_s=1.0, pace_m_s=0.6, velocity_time_s=3.0)
    rng = np.random.default_rng(5)
    still = np.zeros((3, n))
    start = Cloud(
        still,
        np.vstack([rng.normal(0.4, 0.2, (2, n)), np.zeros(n)]),
        np.ones(n, bool),
        np.zeros(n),
        np.zeros(n),
        np.empty(0, np.int32),
        np.empty((0, n)),
        np.empty((0, n)),
        np.empty((0, n)),
    )
    w = np.full(n, 1 / n)
    one, _ = move(start, dt, rng, walk=walk, fading=Fading())
    two = start
    for _ in range(3):
        two, _ = move(two, dt / 3, rng, walk=walk, fading=Fading())
    expected = carried(moments(start.position, start.velocity, w), dt, walk)
    for cloud in (one, two):
        found = moments(cloud.position, cloud.velocity, w)
        assert_allclose(found.position, expected.position, atol=0.01)
        assert_allclose(found.covariance, expected.covariance, atol=0.01)
        assert_allclose(found.velocity, expected.velocity, atol=0.01)
    spread = math.exp(-2 * dt / 3.0) * 0.2**2 + 0.6**2 * -math.expm1(-2 * dt / 3.0)
    assert_allclose(np.var(one.velocity[0]), spread, rtol=0.02)


def test_beacons_stop_and_go_at_their_rates_and_forget_power_and_height():
    n = 100_000
    walk = Walk(stops_per_s=0.3, goes_per_s=0.1, height_m=1.5, height_sigma_m=0.4)
    fading = Fading(offset_db=2.0, offset_s=5.0)
    cloud = a_cloud(n)._replace(moves=np.ones(n, bool), position=np.zeros((3, n)))
    rng = np.random.default_rng(6)
    moved, _ = move(cloud, 2.0, rng, walk=walk, fading=fading)
    left = 0.25 + 0.75 * math.exp(-0.4 * 2.0)
    assert_allclose(moved.moves.mean(), left, atol=0.006)
    later, _ = move(cloud, 1000.0, rng, walk=walk, fading=fading)
    assert_allclose(later.moves.mean(), 0.25, atol=0.006)
    assert_allclose([later.offset_db.mean(), later.offset_db.std()], [0.0, 2.0], atol=0.03)
    assert_allclose([later.position[2].mean(), later.position[2].std()], [1.5, 0.4], atol=0.01)


@pytest.mark.parametrize("lengths", [(2.0, 2.0), (2.0, 5.0)])
def test_shadows_and_blocks_become_usual_with_distance_and_time(lengths):
    cloud = a_cloud()._replace(moves=np.ones(50, bool))
    walk, fading = Walk(), Fading(shadow_s=10.0)
    moved, far = move(cloud, 0.7, np.random.default_rng(0), walk=walk, fading=fading)
    assert_allclose(far, moved.moves * np.hypot(*(moved.position - cloud.position)[:2]))
    usual = UsualPaths(
        np.full((2, 50), 7.0), np.array(lengths), np.full((2, 50), 0.1), np.array([0.0, 2.0])
    )
    faded = fade(cloud, far, 0.7, usual=usual, fading=fading)
    rho = np.exp(-far / np.array(lengths)[:, None] - 0.07)
    assert_allclose(faded.shadow_db, cloud.shadow_db * rho)
    assert_allclose(faded.shadow_var - 7.0, (cloud.shadow_var - 7.0) * rho**2)
    assert_allclose(faded.blocked[0], 0.1)
    assert_allclose(faded.blocked[1] - 0.1, (cloud.blocked[1] - 0.1) * math.exp(-0.35))


def test_the_chance_of_a_blocked_path_is_that_of_the_two_state_chain():
    model = replace(SHADY, p_blocked=0.2, burst_s=3.0)
    tracker = rssi_tracker.create(hall(model), particles=400)
    state = tracker.step(tracker.start(), scan(0.0, [-60.0]))
    known = state.cloud._replace(blocked=np.full_like(state.cloud.blocked, 0.7))
    later = tracker.step(state._replace(cloud=known), scan(2.0, [-60.0], [1])).cloud
    comes, goes = 0.2 / 0.8 / 3.0, 1.0 / 3.0
    chain = expm(2.0 * np.array([[-comes, comes], [goes, -goes]]))
    assert later.blocked[0].max() == pytest.approx(0.3 * chain[0, 1] + 0.7 * chain[1, 1])


def test_one_that_stands_only_sways():
    walk = Walk(goes_per_s=0.0, stops_per_s=1.0, sway_m=0.1)
    n = 50_000
    cloud = a_cloud(n)._replace(moves=np.zeros(n, bool))
    moved, far = move(cloud, 4.0, np.random.default_rng(0), walk=walk, fading=Fading())
    assert not moved.moves.any()
    assert_array_equal(far, 0.0)
    assert_array_equal(going(moved), 0.0)
    assert_allclose((moved.position - cloud.position)[:2].std(axis=1), 0.2, rtol=0.02)


@given(st.integers(0, 1000), st.floats(0.0, 0.999), st.integers(1, 80))
@settings(max_examples=40)
def test_particles_are_drawn_as_often_as_they_weigh(seed, u, count):
    cloud = a_cloud(seed=seed)
    drawn, parent = resampled(cloud, u, count)
    copies = np.bincount(parent, minlength=50)
    assert np.all(np.abs(copies - count * weights(cloud)) < 1.0 + 1e-9)
    assert_array_equal(drawn.position, cloud.position[:, parent])
    assert_array_equal(drawn.shadow_var, cloud.shadow_var[:, parent])
    assert effective(drawn) == pytest.approx(count)


def test_moments_are_those_of_a_weighted_sample():
    cloud = a_cloud()
    w = weights(cloud)
    found = moments(cloud.position, cloud.velocity, w)
    both = np.cov(np.vstack([cloud.position, cloud.velocity]), aweights=w, bias=True)
    assert_allclose(found.position, np.average(cloud.position, axis=1, weights=w))
    assert_allclose(found.covariance, both[:3, :3])
    assert_allclose(found.velocity_covariance, both[3:, 3:])
    assert_allclose(found.cross, both[:3, 3:])


def test_clouds_are_joined_and_confined():
    cloud = joined(a_cloud(20), a_cloud(30, seed=1))
    assert cloud.position.shape == (3, 50)
    area = Region(4.0, 4.0, 6.0, 6.0)
    kept = confined(cloud, area)
    assert area.contains(kept.position[:2].T).all()
    out = (cloud.position[:2] < 4.0) | (cloud.position[:2] > 6.0)
    assert_array_equal(kept.velocity[:2], np.where(out, -1.0, 1.0) * cloud.velocity[:2])
    wide = Region(-99.0, -99.0, 99.0, 99.0)
    assert confined(cloud, wide) is cloud


def test_belief_carried_back_a_moment_moves_back():
    now = Moments(np.zeros(3), np.eye(3), np.array([1.0, 0, 0]), np.zeros((3, 3)), np.zeros((3, 3)))
    assert_allclose(carried(now, -0.01, Walk()).position, [-0.01, 0, 0])


# --- the filter ----------------------------------------------------------------------------------


def test_of_a_beacon_that_stands_it_believes_what_a_grid_of_all_places_does():
    site = replace(hall(), tracker=TrackerSettings(self_calibration=False))
    tracker = rssi_tracker.create(site, particles=8000)
    still = Walk(stops_per_s=1.0, goes_per_s=0.0, sway_m=0.0, height_m=1.2)
    tracker = replace(tracker, prior=replace(tracker.prior, walk=still))
    rng = np.random.default_rng(4)
    scans = [scan(float(k), readings((7.0, 3.0), rng=rng)) for k in range(2)]
    state = run(tracker, scans)[-1]
    area = tracker.prior.field.area
    x, y = np.meshgrid(
        np.linspace(area.x_min, area.x_max, 400), np.linspace(area.y_min, area.y_max, 400)
    )
    places = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 1.2)])
    mean = rssi.expected(PLAIN, rssi.distance(CORNERS, places))
    log_p = sum(-0.5 * (((s.value - mean) / 3.0) ** 2).sum(axis=1) for s in scans)
    p = np.exp(log_p - log_p.max())
    p /= p.sum()
    centre = p @ places[:, :2]
    C = np.cov(places[:, :2].T, aweights=p, bias=True)
    shown = tracker.shown(state, 1.0)
    assert shown is not None
    assert_allclose(shown.position[:2], centre, atol=0.08)
    assert_allclose(shown.covariance, [C[0, 0], C[0, 1], C[1, 1]], rtol=0.15, atol=0.03)


@pytest.fixture(scope="module")
def walked():
    site = hall(SHADY)
    tracker = rssi_tracker.create(site, particles=300)
    rng = np.random.default_rng(8)
    scans = [
        scan(0.5 * k, readings((3.0 + 0.2 * k, 4.0), SHADY, rng=rng)[: 3 + k % 3])
        for k in range(24)
    ]
    return tracker, scans, run(tracker, scans)


def test_a_state_is_a_value_and_its_bytes_are_as_good(walked):
    tracker, scans, states = walked
    before = [tracker.pack(state) for state in states]
    again = run(tracker, scans[10:], states[9])
    for one, other, data in zip(again, states[10:], before[10:], strict=True):
        assert tracker.pack(one) == tracker.pack(other) == data
    restored = tracker.unpack(before[9])
    assert tracker.pack(run(tracker, scans[10:], restored)[-1]) == before[-1]
    empty = tracker.unpack(tracker.pack(tracker.start()))
    assert empty.cloud is None
    assert empty.heard == 0


@pytest.mark.parametrize("data", [b"", b"\x05\x00\x00\x00{}", b"\x02\x00\x00\x00{}"])
def test_other_bytes_are_refused(data, walked):
    with pytest.raises(StateError):
        unpack(data)
    good = pack(walked[2][-1])
    with pytest.raises(StateError):
        unpack(good[: len(good) // 2])
    with pytest.raises(StateError, match="version"):
        unpack(good.replace(b'"version": 1', b'"version": 9'))


def test_hindsight_of_one_state_is_what_is_shown(walked):
    tracker, _, states = walked
    shown = tracker.shown(states[5], states[5].t_s)
    late = tracker.hindsight(states[5:6])
    assert shown is not None
    assert late is not None
    assert_allclose(late.position, shown.position)
    assert_allclose(late.covariance, shown.covariance)
    assert tracker.hindsight([tracker.start()]) is None


def test_particles_that_were_found_anew_say_nothing_of_before(walked):
    tracker, _, states = walked
    first, last = states[3], states[4]
    strangers = last._replace(parent=np.full(last.cloud.moves.size, -1, np.int32))
    shown = tracker.shown(first, first.t_s)
    assert_array_equal(tracker.hindsight([first, strangers]).position, shown.position)


def test_hindsight_is_better_than_what_was_shown():
    live, late = [], []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        tracker = rssi_tracker.create(hall(), particles=400, seed=seed)
        truth = [(2.0 + 0.35 * k, 3.0 + 0.2 * k) for k in range(26)]
        scans = [scan(0.5 * k, readings(p, rng=rng)) for k, p in enumerate(truth)]
        states = run(tracker, scans)
        for k in range(8, 16):
            shown, after = (
                tracker.shown(states[k], states[k].t_s),
                tracker.hindsight(states[k : k + 8]),
            )
            live.append(np.linalg.norm(shown.position[:2] - truth[k]))
            late.append(np.linalg.norm(after.position[:2] - truth[k]))
    assert np.mean(np.square(late)) < 0.8 * np.mean(np.square(live))


def test_statuses_go_from_tentative_to_ended_and_then_another_track_begins(walked):
    tracker, _, states = walked
    assert tracker.shown(tracker.start(), 0.0) is None
    assert tracker.shown(states[0], 0.0).status == Status.TENTATIVE
    last = states[-1]
    assert tracker.shown(last, last.t_s).status == Status.CONFIRMED
    assert tracker.shown(last, last.t_s + 2.0).status == Status.CONFIRMED
    coasting = tracker.shown(last, last.t_s + 20.0)
    assert coasting.status == Status.COASTING
    assert math.isnan(coasting.nis)
    assert coasting.covariance[0] > tracker.shown(last, last.t_s).covariance[0]
    assert tracker.shown(last, last.t_s + 301.0).status == Status.ENDED
    anew = tracker.step(last, scan(last.t_s + 301.0, readings((6.0, 5.0))))
    assert anew.born > last.born
    assert anew.heard == 5
    shown = tracker.shown(last, last.t_s)
    assert_array_equal(tracker.hindsight([last, anew]).position, shown.position)


def test_a_beacon_that_was_carried_off_is_found_again():
    found = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        tracker = rssi_tracker.create(hall(SHADY), seed=seed)
        here = [scan(0.5 * k, readings((2.0, 2.0), SHADY, rng=rng)) for k in range(20)]
        there = [scan(10 + 0.5 * k, readings((11.0, 8.0), SHADY, rng=rng)) for k in range(20)]
        state = run(tracker, here + there)[-1]
        found.append(np.linalg.norm(tracker.shown(state, 19.5).position[:2] - [11.0, 8.0]))
    assert np.mean(np.array(found) < 3.0) >= 0.7


def test_belief_is_honest_on_walks_of_its_own_kind():
    inside, nis = [], []
    for seed in range(12):
        rng = np.random.default_rng(100 + seed)
        tracker = rssi_tracker.create(hall(SHADY), particles=400, seed=seed)
        shadow = 3.0 * rng.standard_normal(5)
        place, velocity = rng.uniform([3, 3], [9, 7]), 0.45 * rng.standard_normal(2)
        state = tracker.start()
        for k in range(40):
            a = math.exp(-0.5 / 6.0)
            velocity = a * velocity + 0.45 * math.sqrt(1 - a * a) * rng.standard_normal(2)
            place = np.clip(place + 0.5 * velocity, [0, 0], [12, 10])
            fall = math.exp(-0.5 * np.linalg.norm(velocity) / 3.0 - 0.5 / 30.0)
            shadow = fall * shadow + 3.0 * math.sqrt(1 - fall**2) * rng.standard_normal(5)
            value = readings(place, SHADY, rng=rng) + shadow
            value -= np.where(rng.random(5) < 0.1, rng.normal(6, 3, 5), 0.0)
            value += np.where(rng.random(5) < 0.02, rng.normal(0, 20, 5), 0.0)
            state = tracker.step(state, scan(0.5 * k, value))
            if k >= 10:
                shown = tracker.shown(state, 0.5 * k)
                xx, xy, yy = shown.covariance
                off = shown.position[:2] - place
                inside.append(off @ np.linalg.solve([[xx, xy], [xy, yy]], off) < 5.99)
                nis.append(shown.nis)
    assert 0.88 <= np.mean(inside) <= 1.0
    assert 0.8 <= np.mean(nis) <= 1.2


def test_a_reading_may_bring_its_own_sigma_and_come_twice_in_a_scan():
    tracker = rssi_tracker.create(hall(), particles=300)
    near = readings((3.0, 3.0))
    state = run(tracker, [scan(0.0, near), scan(1.0, near)])[-1]
    loud = scan(2.0, near + np.array([30.0, 0, 0, 0, 0]), sigma=1e6)
    shown, before = tracker.shown(tracker.step(state, loud), 2.0), tracker.shown(state, 2.0)
    assert np.linalg.norm(shown.position[:2] - before.position[:2]) < 0.3
    twice = tracker.step(state, scan(2.0, [*near, *near], [*range(5), *range(5)]))
    assert twice.heard == state.heard + 10
    assert tracker.step(state, scan(2.0, [])) is state


def test_only_so_many_shadows_are_followed():
    n = 40
    rng = np.random.default_rng(0)
    positions = np.column_stack([rng.uniform(0, 30, (n, 2)), np.full(n, 2.0)])
    site = Site("many", tuple(map(str, range(n))), positions, (SHADY,) * n)
    tracker = rssi_tracker.create(site, particles=100)
    state = tracker.start()
    for k in range(n):
        state = tracker.step(state, scan(0.1 * k, [-75.0], [k]))
    assert state.cloud is not None
    assert_array_equal(state.cloud.receiver, np.arange(16, 40))


def test_heights_follow_the_site():
    volume = rssi_tracker.create(hall(dimensions=3, height_m=None), particles=200)
    assert (volume.prior.walk.height_m, volume.prior.walk.height_sigma_m) == (2.0, 1.0)
    near = readings((3.0, 3.0))
    shown = volume.shown(volume.step(volume.start(), scan(0.0, near)), 0.0)
    assert np.isfinite(shown.position).all()
    carried_about = rssi_tracker.create(hall(height_m=None), particles=200)
    assert (carried_about.prior.walk.height_m, carried_about.prior.walk.height_sigma_m) == (
        1.0,
        0.5,
    )
    shown = carried_about.shown(carried_about.step(carried_about.start(), scan(0.0, near)), 0.0)
    assert math.isnan(shown.position[2])


def test_the_walk_follows_what_is_told_of_targets():
    usual = Walk(height_m=1.2)
    assert rssi_prior.walk(hall()) == usual
    told = rssi_prior.walk(hall(accel_sigma_m_s2=0.3, motion="cv", max_speed_m_s=0.4))
    assert told == usual._replace(pace_m_s=0.4, stops_per_s=0.0)
    slow = rssi_prior.walk(hall(accel_sigma_m_s2=0.1))
    assert slow.pace_m_s == pytest.approx(0.1 * math.sqrt(3.0))


@pytest.mark.parametrize(
    ("bad", "told"),
    [
        (scan(-1.0, [-70.0]), "scan at -1.0 s"),
        (scan(math.nan, [-70.0]), "scan at nan s"),
        (scan(1.0, [math.nan]), "finite"),
        (scan(1.0, [-70.0], [5]), "receivers"),
        (scan(1.0, [-70.0], [-1]), "receivers"),
    ],
)
def test_bad_scans_are_refused(bad, told):
    tracker = rssi_tracker.create(hall(), particles=50)
    state = tracker.step(tracker.start(), scan(0.0, readings((3.0, 3.0))))
    with pytest.raises(InputError, match=told):
        tracker.step(state, bad)


@given(
    st.lists(
        st.tuples(st.floats(0.0, 400.0), st.integers(0, 4), st.floats(-200.0, 50.0)),
        min_size=1,
        max_size=12,
    )
)
@settings(max_examples=25)
def test_whatever_is_heard_what_is_shown_is_finite(rows):
    tracker = rssi_tracker.create(hall(SHADY), particles=60)
    state, t_s = tracker.start(), 0.0
    for dt, sensor, value in rows:
        t_s += dt
        state = tracker.step(state, scan(t_s, [value], [sensor]))
        shown = tracker.shown(state, t_s + dt)
        assert shown is not None
        assert np.isfinite(shown.position).all()
        xx, xy, yy = shown.covariance
        assert xx >= 0.0
        assert yy >= 0.0
        assert xx * yy - xy * xy >= -1e-9
    assert isinstance(state, RssiState)
