"""Bad input and bad snapshots: one clear error each, and the tracker is as it was before."""

import struct
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from range_runs import Heard, box, path, run, table
from trackfield.errors import ConfigurationError, InputError, StateError
from trackfield.pipeline.tagged import Tracker, track
from trackfield.sensing.range import UNCALIBRATED, RangeModel

SITE = box(UNCALIBRATED, heights=(0.0, 3.0, 2.0))
ROWS = [
    z
    for i, name in enumerate((None, "x"))
    for z in run(np.random.default_rng(i), SITE, 100.0 + 0.125 * np.arange(30), target=name)
]
ROWS.sort(key=lambda z: z.t)


def half_way(site=SITE, **asked):
    tracker = Tracker(site, **asked)
    tracker.process(table(site, ROWS[: len(ROWS) // 2]))
    return tracker


SNAPSHOT = half_way(lag_steps=2).snapshot()


# Snapshots --------------------------------------------------------------------------------------


def assert_refused(data, match=None):
    tracker = half_way(lag_steps=2)
    with pytest.raises(StateError, match=match):
        tracker.restore(data)
    assert tracker.snapshot() == SNAPSHOT


@settings(max_examples=60)
@given(end=st.integers(0, len(SNAPSHOT) - 1))
def test_a_truncated_snapshot_is_refused(end):
    assert_refused(SNAPSHOT[:end])


@settings(max_examples=100)
@given(at=st.integers(0, 8 * len(SNAPSHOT) - 1))
def test_a_snapshot_with_one_wrong_bit_is_refused(at):
    data = bytearray(SNAPSHOT)
    data[at // 8] ^= 1 << at % 8
    assert_refused(bytes(data))


@settings(max_examples=40)
@given(tail=st.binary(min_size=1, max_size=200))
def test_a_snapshot_with_more_bytes_is_refused(tail):
    assert_refused(SNAPSHOT + tail)


@given(data=st.binary(max_size=300))
def test_foreign_bytes_are_refused(data):
    assert_refused(data, "not a tracker's snapshot")
    assert_refused(b"TRACKFLD" + data)


def test_a_snapshot_of_another_version_is_refused():
    at = len(b"TRACKFLD")
    data = SNAPSHOT[:at] + struct.pack("<H", 99) + SNAPSHOT[at + 2 :]
    assert_refused(data, "version 99, expected 1")


MOVED = SITE.positions + np.array([0.0, 0.0, 1e-9])


@pytest.mark.parametrize(
    ("site", "asked"),
    [
        (SITE, {}),
        (SITE, {"lag_steps": 3}),
        (SITE, {"lag_steps": 2, "every_s": 1.0}),
        (replace(SITE, positions=MOVED), {"lag_steps": 2}),
        (replace(SITE, sensor_ids=tuple("abcdefgi")), {"lag_steps": 2}),
        (replace(SITE, models=(RangeModel(sigma_m=0.2),) * 8), {"lag_steps": 2}),
        (replace(SITE, target=replace(SITE.target, motion="cv")), {"lag_steps": 2}),
        (replace(SITE, tracker=replace(SITE.tracker, drop_s=9.0)), {"lag_steps": 2}),
        (replace(SITE, target_models={"x": (UNCALIBRATED,) * 8}), {"lag_steps": 2}),
    ],
)
def test_a_snapshot_of_another_site_or_other_options_is_refused(site, asked):
    assert_refused(half_way(site, **asked).snapshot(), "another site or of other options")


def test_a_site_by_another_name_is_the_same_site():
    tracker = Tracker(replace(SITE, name="new name"), lag_steps=2)
    tracker.restore(SNAPSHOT)
    assert tracker.snapshot() == SNAPSHOT


@settings(max_examples=60)
@given(share=st.floats(0.0, 1.0, exclude_max=True))
def test_the_kernel_refuses_truncated_bytes_too(share):
    """A second line of defence, for bytes whose digest was forged."""
    whole = half_way()._bank.snapshot()
    bank = half_way()._bank
    with pytest.raises(RuntimeError, match=r"too early|damaged"):
        bank.restore(whole[: int(share * len(whole))])
    with pytest.raises(RuntimeError, match="longer than its contents"):
        bank.restore(whole + b"\0")
    assert bank.snapshot() == whole


# Readings ---------------------------------------------------------------------------------------


def assert_nothing_happens(readings, match):
    tracker = half_way(lag_steps=2)
    with pytest.raises(InputError, match=match):
        tracker.process(readings)
    assert tracker.snapshot() == SNAPSHOT


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize(("field", "name"), [("t", "t_s"), ("value", "value")])
def test_what_is_no_number_is_refused(field, name, bad):
    rows = [*ROWS[:3], ROWS[3]._replace(**{field: bad}), *ROWS[4:]]
    assert_nothing_happens(table(SITE, rows), f"reading 4: found {name} .*expected a finite number")


def test_an_unknown_sensor_is_refused():
    readings = replace(table(SITE, ROWS), sensor_ids=tuple("abcdeXgh"))
    assert_nothing_happens(readings, r"reading \d+: found sensor 'X', which the site does not have")


def test_names_that_nobody_uses_are_no_fault():
    """A file's table of names may hold more than the readings at hand."""
    readings = table(SITE, ROWS)
    more = replace(
        readings,
        sensor_ids=(*readings.sensor_ids, "X"),
        kinds=("range", "rssi"),
        target_ids=("nobody", *readings.target_ids),
        target=np.where(readings.target >= 0, readings.target + 1, -1).astype(np.int32),
    )
    a, b = Tracker(SITE).process(readings), Tracker(SITE).process(more)
    np.testing.assert_array_equal(a.position, b.position)
    assert a.target_ids == b.target_ids == ("x",)  # who has no name is not named


def test_another_kind_is_refused():
    readings = table(SITE, ROWS)
    kind = np.zeros(len(readings), np.int32)
    kind[5] = 1
    mixed = replace(readings, kinds=("range", "rssi"), kind=kind)
    assert_nothing_happens(mixed, "reading 6: found kind 'rssi', expected 'range'")


def test_a_stated_sigma_of_no_use_is_the_model_s():
    rows = ROWS[:200]
    plain = Tracker(SITE).process(table(SITE, rows))
    for useless in (np.nan, 0.0, -1.0):
        readings = table(SITE, rows)
        shown = Tracker(SITE).process(replace(readings, sigma=np.full(len(rows), useless)))
        np.testing.assert_array_equal(shown.position, plain.position)


@pytest.mark.parametrize("sigma", [1e-30, 1e-9, 1e-3, 1e6, 1e30, 1e300, np.inf])
def test_a_stated_sigma_beyond_reason_does_no_harm(sigma):
    readings = replace(table(SITE, ROWS), sigma=np.full(len(ROWS), sigma))
    shown = Tracker(SITE).process(readings)
    assert len(shown) > 20
    assert np.isfinite(shown.position[:, :2]).all()
    assert (shown.covariance[:, [0, 2]] > 0).all()


@pytest.mark.parametrize("sigma_m", [0.0, 1e-9])
def test_a_model_without_noise_tracks_exact_readings(sigma_m):
    site = box(RangeModel(sigma_m=sigma_m))
    rows = run(np.random.default_rng(0), site, 100.0 + 0.125 * np.arange(60), noise=0.0)
    shown = Tracker(site).process(table(site, rows))
    error = np.linalg.norm((shown.position - path(shown.t_s))[:, :2], axis=1)
    assert len(shown) == 59
    assert error[20:].max() < 0.02


@pytest.mark.parametrize(
    ("t_s", "sensor", "value", "match"),
    [
        (200.0, [0, 8], [5.0, 5.0], "a sensor number that the site does not have"),
        (200.0, [-1, 2], [5.0, 5.0], "a sensor number that the site does not have"),
        (200.0, [0, 1], [5.0, np.nan], "a value that is not finite"),
        (np.inf, [0, 1], [5.0, 5.0], "a time that is not finite"),
        (200.0, [0, 1], [5.0], "columns of one length expected"),
    ],
)
def test_a_scan_that_cannot_be_is_refused(t_s, sensor, value, match):
    tracker = half_way(lag_steps=2)
    with pytest.raises(InputError, match=match):
        tracker.step(t_s, np.array(sensor, np.int32), value=np.array(value))
    assert tracker.snapshot() == SNAPSHOT


def test_a_scan_of_sensors_with_several_clocks_is_refused():
    site = box(RangeModel(), RangeModel(clock_offset_s=0.1))
    with pytest.raises(InputError, match="several clocks"):
        Tracker(site).step(0.0, np.array([0, 1], np.int32), value=np.array([5.0, 5.0]))


# Sites and whole runs ---------------------------------------------------------------------------


def test_a_site_without_geometry_is_refused():
    line = np.array(SITE.positions)
    line[:, 1] = 0.0
    with pytest.raises(ConfigurationError, match=r"site box: found all 8 sensors .* on a line"):
        Tracker(replace(SITE, positions=line))


def test_a_run_that_never_starts_says_what_was_missing():
    rows = [Heard(100.0 + k, k % 2, 5.0) for k in range(10)]
    with pytest.raises(InputError, match=r"found 10 usable readings from 2 sensors \(a, b\)"):
        track(SITE, table(SITE, rows))


def test_a_run_without_readings_is_empty():
    run_ = track(SITE, table(SITE, []))
    assert len(run_.tracks) == 0
    assert set(run_.counts.values()) == {0}


def test_a_run_in_chunks_is_the_run():
    chunks = [table(SITE, ROWS[i : i + 17]) for i in range(0, len(ROWS), 17)]
    whole, parts = track(SITE, table(SITE, ROWS)), track(SITE, iter(chunks))
    np.testing.assert_array_equal(whole.tracks.position, parts.tracks.position)
    assert whole.counts == parts.counts


@pytest.mark.parametrize(
    "asked",
    [
        {"lag_s": -1.0},
        {"lag_s": float("nan")},
        {"every_s": float("inf")},
        {"lag_steps": 1.5},
        {"lag_s": "x"},
    ],
)
def test_a_lag_that_cannot_be_is_refused(asked):
    with pytest.raises(ConfigurationError, match="expected finite numbers, 0 or more"):
        Tracker(box(), **asked)


def test_what_is_no_table_is_refused():
    with pytest.raises(InputError, match="found dict, expected Readings"):
        Tracker(box()).process({"t_s": [1.0]})
