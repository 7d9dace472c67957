"""Front ends of a node, Oh V.A: against a plain loop; streams; measured p and q; simulated PIR."""

import math
import statistics

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

from trackfield.errors import ConfigurationError, InputError
from trackfield.sensing.detection_rates import measured_rates
from trackfield.sensing.pir import PirWorld, simulate_pir
from trackfield.sensing.waveform import (
    ACOUSTIC,
    AdaptiveThreshold,
    FixedThreshold,
    FrontEnd,
    detect,
    initial,
    join_windows,
    step,
)

RATE = 40.0
FIXED = FrontEnd(RATE, FixedThreshold(0.25, rest=1.2))
ADAPTIVE = FrontEnd(RATE)
NOBODY = np.full((int(600 * RATE), 1, 2), np.nan)


def noise(rng, n=4000, *, sigma=0.1, rest=1.2):
    return rest + sigma * rng.standard_normal(n)


def burst(x, start, stop, *, size=1.0, hz=1.5):
    t = np.arange(x.size) / RATE
    return x + np.where((t >= start) & (t < stop), size * np.sin(2 * np.pi * hz * t), 0.0)


def test_a_fixed_threshold_looks_at_every_sample():
    rng = np.random.default_rng(0)
    x = noise(rng)
    found = detect(FIXED, x)
    for k in range(100):
        window = [abs(v - 1.2) for v in x[40 * k : 40 * k + 40]]
        assert found.level[k] == pytest.approx(max(window))
        assert found.detected[k] == any(v > 0.25 for v in window)
        assert found.end_s[k] == k + 1
    assert 0 < found.detected.sum() < 100
    assert (found.threshold == 0.25).all()


def test_the_adaptive_front_end_is_a_plain_loop_over_the_filtered_waveform():
    x = burst(noise(np.random.default_rng(1)), 40.0, 46.0)
    sections = signal.butter(2, (0.3, 4.0), "bandpass", fs=RATE, output="sos")
    start = signal.sosfilt_zi(sections) * x[0]
    y = np.abs(signal.sosfilt(sections, x, zi=start)[0])
    found = detect(ADAPTIVE, x)
    sigma = None
    for k in range(100):
        window = sorted(y[40 * k : 40 * k + 40])
        here = statistics.median(window) / 0.6745
        sigma = here if sigma is None else sigma
        level = window[35] + 0.1 * (window[36] - window[35])  # a tenth of 40 is above
        assert found.level[k] == pytest.approx(level)
        assert found.threshold[k] == pytest.approx(4 * sigma)
        assert found.detected[k] == (level > 4 * sigma)
        gain = max(1 / 60, 1 / (k + 1)) * (0.1 if level > 4 * sigma else 1.0)
        sigma = sigma ** (1 - gain) * here**gain
    assert found.detected[41:46].all()
    assert not found.detected[20:40].any()


@given(st.lists(st.integers(0, 300), max_size=12), st.sampled_from([FIXED, ADAPTIVE]))
def test_however_a_waveform_is_cut_the_windows_are_the_same(cuts, front):
    x = burst(noise(np.random.default_rng(2), n=1000), 10.0, 13.0)
    ends = np.minimum(np.cumsum([*cuts, 1000]), 1000)
    state, parts = initial(front), []
    for begin, end in zip([0, *ends[:-1]], ends, strict=True):
        state, windows = step(front, state, x[begin:end])
        parts.append(windows)
    whole = detect(front, x)
    for streamed, batch in zip(join_windows(parts), whole, strict=True):
        np.testing.assert_array_equal(streamed, batch)
    assert state.left.size == 0


def test_units_and_offsets_do_not_matter_to_the_adaptive_one():
    x = burst(noise(np.random.default_rng(3)), 50.0, 55.0)
    plain = detect(ADAPTIVE, x)
    counts = FrontEnd(RATE, AdaptiveThreshold(least_sigma=1.0))
    scaled = detect(counts, 1000.0 * x - 7000.0)
    np.testing.assert_array_equal(plain.detected, scaled.detected)
    np.testing.assert_allclose(scaled.threshold, 1000.0 * plain.threshold, rtol=1e-6)


def test_it_gets_used_to_a_noise_that_stays_and_not_to_a_walker():
    rng = np.random.default_rng(4)
    louder = np.concatenate([noise(rng, 6000), noise(rng, 30_000, sigma=1.0)])
    found = detect(ADAPTIVE, louder).detected
    assert found[155:165].mean() > 0.8  # at first it looks like somebody
    assert found[-100:].mean() < 0.1
    walker = burst(noise(rng, 8000), 100.0, 110.0)
    seen = detect(ADAPTIVE, walker)
    assert seen.detected[101:110].all()
    assert seen.threshold[111] < 1.5 * seen.threshold[99]


def test_a_sound_is_heard_above_hiss_and_hum():
    front = FrontEnd(4000.0, ACOUSTIC, window_s=0.5)
    rng = np.random.default_rng(5)
    t = np.arange(40_000) / 4000.0
    x = 0.01 * rng.standard_normal(t.size) + 0.2 * np.sin(2 * np.pi * 10 * t)
    x += np.where((t > 6) & (t < 8), 0.05 * np.sin(2 * np.pi * 300 * t), 0.0)
    found = detect(front, x).detected
    np.testing.assert_array_equal(np.flatnonzero(found), [12, 13, 14, 15])


def test_resolution_steps_are_no_events():
    x = np.full(4000, 1.0)
    x[1500] = 1.0 + 1e-3
    found = detect(ADAPTIVE, x)
    assert not found.detected.any()
    assert found.constant.sum() == 99


def walks(rng, *, visits, every_s=30.0, speed=1.2):
    """Walk past the sensor every half minute; when within 7.62 m, the intervals (visits, 2)."""
    n = int(visits * every_s * RATE)
    t = np.arange(n) / RATE
    paths, intervals = np.full((n, 1, 2), np.nan), []
    for k in range(visits):
        aside, turn = rng.uniform(-6, 6), rng.uniform(0, 2 * math.pi)
        start = k * every_s + rng.uniform(0, every_s - 20 / speed)
        now = (t >= start) & (t < start + 20 / speed)
        along = speed * (t[now] - start) - 10
        c, s = math.cos(turn), math.sin(turn)
        paths[now, 0] = np.stack([c * along - s * aside, s * along + c * aside], axis=1)
        half = math.sqrt(7.62**2 - aside**2)
        intervals.append([start + (10 - half) / speed, start + (10 + half) / speed])
    return paths, np.array(intervals)


def rates(front, world, seed=6):
    rng = np.random.default_rng(seed)
    paths, intervals = walks(rng, visits=30)
    x = simulate_pir(world, paths, rate_hz=RATE, rng=rng)
    found = detect(front, x)
    return measured_rates(found.end_s, found.detected, window_s=1.0, intervals=intervals)


def test_measured_rates_of_both_front_ends_on_a_mild_and_a_hot_day():
    fixed = FrontEnd(RATE, FixedThreshold(0.25))
    hot = PirWorld(drift_v=0.4, plumes_per_s=0.05, plume_v=0.8)
    for front, world, p, q in (
        (fixed, PirWorld(), (0.8, 0.97), (0.0, 0.15)),
        (fixed, hot, (0.8, 1.0), (0.4, 0.9)),
        (ADAPTIVE, PirWorld(), (0.8, 0.97), (0.0, 0.12)),
        (ADAPTIVE, hot, (0.6, 0.95), (0.0, 0.12)),
    ):
        found = rates(front, world)
        assert p[0] < found.p_detection < p[1]
        assert q[0] <= found.p_false < q[1]
        assert 0.005 < found.p_error < 0.05
        assert found.q_error < 0.1


def test_a_walker_across_the_zones_swings_and_one_towards_the_sensor_does_not():
    calm = PirWorld(noise_v=0.0, drift_v=0.0, plumes_per_s=0.0)
    t = np.arange(int(20 * RATE)) / RATE
    across = np.stack([1.2 * t - 12, np.full(t.size, 4.0)], axis=1)
    towards = np.stack([12.3 - 0.6 * t, np.zeros(t.size)], axis=1)
    far = np.stack([1.2 * t - 12, np.full(t.size, 16.0)], axis=1)
    rng = np.random.default_rng(7)
    power = [
        simulate_pir(calm, path[:, None], rate_hz=RATE, rng=rng).std()
        for path in (across, towards, far)
    ]
    assert power[0] > 5 * power[1]
    assert power[0] > 5 * power[2]
    both = np.stack([across, far], axis=1)
    alone = [simulate_pir(calm, p[:, None], rate_hz=RATE, rng=rng) for p in (across, far)]
    together = simulate_pir(calm, both, rate_hz=RATE, rng=rng)
    np.testing.assert_allclose(together, alone[0] + alone[1], atol=1e-12)


def test_an_empty_scene_is_noise_drift_and_plumes():
    rng = np.random.default_rng(8)
    white = PirWorld(noise_v=0.05, drift_v=0.0, plumes_per_s=0.0)
    x = simulate_pir(white, NOBODY, rate_hz=RATE, rng=rng)
    assert x.std() == pytest.approx(0.05, rel=0.02)
    slow = PirWorld(noise_v=0.0, drift_v=0.3, drift_s=2.0, plumes_per_s=0.0)
    x = simulate_pir(slow, NOBODY, rate_hz=RATE, rng=rng)
    assert x.std() == pytest.approx(0.3, rel=0.15)
    lag = int(2 * RATE)
    assert np.corrcoef(x[:-lag], x[lag:])[0, 1] == pytest.approx(math.exp(-1), abs=0.12)
    warm = PirWorld(noise_v=0.0, drift_v=0.0, plumes_per_s=0.05, plume_v=0.3)
    x = simulate_pir(warm, NOBODY, rate_hz=RATE, rng=rng)
    assert 0.05 < np.mean(x != 0.0) < 0.4
    assert np.abs(x).max() <= 0.6
    again, same = (
        simulate_pir(PirWorld(), NOBODY, rate_hz=RATE, rng=np.random.default_rng(9)) for _ in "ab"
    )
    np.testing.assert_array_equal(again, same)


def test_rates_by_counting():
    end = np.arange(1.0, 21.0)
    intervals = np.array([[10.0, 14.0], [2.5, 5.5]])
    inside = [4, 5, 11, 12, 13, 14]  # windows that end there lie within
    across = [3, 6]
    detected = np.isin(end, [4, 11, 12, 13, 3, 20])
    found = measured_rates(end, detected, window_s=1.0, intervals=intervals)
    assert found.inside == len(inside)
    assert found.outside == 20 - len(inside) - len(across)
    assert found.p_detection == pytest.approx(4 / 6)
    assert found.p_false == pytest.approx(1 / 12)


def test_windows_of_a_visit_hang_together():
    """All or nothing in each of 50 visits: 50 independent facts, not 500."""
    rng = np.random.default_rng(10)
    begin = 20.0 * np.arange(50)
    end = np.arange(1.0, 1001.0)
    visit = ((end - 1) // 20).astype(int)
    alike = (rng.random(50) < 0.5)[visit] & ((end - 1) % 20 < 10)
    intervals = np.stack([begin, begin + 10], axis=1)
    found = measured_rates(end, alike, window_s=1.0, intervals=intervals)
    assert found.p_error == pytest.approx(math.sqrt(0.25 / 50), rel=0.1)
    apart = (rng.random(1000) < 0.5) & ((end - 1) % 20 < 10)
    loose = measured_rates(end, apart, window_s=1.0, intervals=intervals)
    assert loose.p_error == pytest.approx(math.sqrt(0.25 / 500), rel=0.25)
    assert 0 < loose.q_error < 0.01  # none seen in 500 is not never


@pytest.mark.parametrize(
    ("front", "words"),
    [
        (FrontEnd(0.0), "rate_hz: found 0, expected more than 0"),
        (FrontEnd(math.nan), "rate_hz: found nan"),
        (FrontEnd(RATE, window_s=-1.0), "window_s: found -1"),
        (FrontEnd(RATE, window_s=0.02), "expected at least 2"),
        (FrontEnd(8.0), "band_hz: found 0.3 to 4"),
        (FrontEnd(RATE, AdaptiveThreshold(band_hz=(3.0, 1.0))), "band_hz: found 3 to 1"),
        (FrontEnd(RATE, AdaptiveThreshold(factor=0.0)), "factor: found 0"),
        (FrontEnd(RATE, AdaptiveThreshold(share=1.5)), "share: found 1.5, expected .* at most 1"),
        (FrontEnd(RATE, AdaptiveThreshold(memory_s=math.inf)), "memory_s: found inf"),
        (FrontEnd(RATE, AdaptiveThreshold(least_sigma=0.0)), "least_sigma: found 0"),
        (FrontEnd(RATE, FixedThreshold(0.0)), "threshold: found 0"),
        (FrontEnd(RATE, FixedThreshold(1.0, rest=math.nan)), "rest: found nan"),
    ],
)
def test_a_front_end_that_cannot_be_is_refused(front, words):
    with pytest.raises(ConfigurationError, match=words):
        initial(front)


@pytest.mark.parametrize(
    ("x", "words"),
    [
        (np.empty(0), "found 0 samples, expected at least a window of 40"),
        (np.zeros(39), "found 39 samples"),
        (np.zeros(400), "the value 0 throughout, .* stuck or not connected"),
        (np.array([0.0, math.nan] * 40), "found nan at sample 1"),
        (np.array([0.0, 1.0, math.inf] * 40), "found inf at sample 2"),
        (np.ones((40, 2)), r"found shape \(40, 2\)"),
    ],
)
def test_a_waveform_that_cannot_be_used_is_refused(x, words):
    with pytest.raises(InputError, match=words):
        detect(ADAPTIVE, x)


def test_scenes_and_rates_that_cannot_be_used_are_refused():
    rng = np.random.default_rng(0)
    for paths in (np.zeros((10, 2)), np.zeros((0, 1, 2)), np.zeros((10, 1, 3))):
        with pytest.raises(InputError, match="paths: found shape"):
            simulate_pir(PirWorld(), paths, rate_hz=RATE, rng=rng)
    with pytest.raises(InputError, match="rate_hz: found 10"):
        simulate_pir(PirWorld(), NOBODY, rate_hz=10.0, rng=rng)
    end, detected = np.arange(1.0, 11.0), np.zeros(10, bool)
    for intervals, words in (
        ([[0.0, 0.5]], "0 windows inside"),
        ([[0.0, 20.0]], "0 outside"),
        ([[3.0, 2.0]], "ends before it begins"),
        ([3.0, 4.0], "intervals of shape"),
    ):
        with pytest.raises(InputError, match=words):
            measured_rates(end, detected, window_s=1.0, intervals=np.array(intervals))
