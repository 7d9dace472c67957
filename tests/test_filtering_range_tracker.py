from dataclasses import astuple, replace

import numpy as np
import pytest

from range_runs import box, run, scans, table, uneven
from range_snapshot import opened
from range_twin import Twin, told
from trackfield.filtering.range_tracker import (
    MANOEUVRING,
    STRAIGHT,
    TURNING,
    Mode,
    height_prior,
    modes,
)
from trackfield.network.site import Target
from trackfield.sensing.range import UNCALIBRATED, RangeModel

PLAIN = (RangeModel(sigma_m=0.1), RangeModel(sigma_m=0.12, bias_m=0.05, scale=0.01))
LEARNING = tuple(
    RangeModel(sigma_m=0.12, bias_m=b, sigma_scale=0.01, learn_noise=learn)
    for b, learn in ((0.05, True), (-0.03, True), (0.0, False))
)
OPEN = (
    UNCALIBRATED,
    RangeModel(
        sigma_m=0.1,
        bias_m=0.1,
        scale=0.01,
        correlated_sigma_m=0.08,
        correlation_length_m=0.8,
        bias_sigma_m=0.05,
        learn_noise=True,
    ),
    RangeModel(sigma_m=0.1, correlated_sigma_m=0.05),
)
HIGH = {"heights": (0.3, 6.0, 3.0)}
CASES = {
    "one mode": (box(*PLAIN, motion="cv"), {}),
    "one mode, not robust": (box(*PLAIN, motion="cv"), {"robust": 0}),
    "3-D": (box(*PLAIN, motion="cv", dimensions=3, **HIGH), {}),
    "modes": (box(*PLAIN), {}),
    "modes, not robust": (box(*LEARNING), {"robust": 0}),
    "modes, 3-D": (box(*LEARNING, dimensions=3, **HIGH), {}),
    "known height": (box(*LEARNING, height_m=0.7, **HIGH), {}),
    "open height": (box(*LEARNING, **HIGH), {}),
    "all open": (box(*OPEN, **HIGH), {}),
    "all open, few slots": (box(*OPEN, **HIGH), {"slots": 3, "slot_idle": 0.5}),
    "all open, one mode": (box(*OPEN, motion="cv", **HIGH), {}),
    "correlated, 3-D": (box(*OPEN, dimensions=3, self_calibration=False, **HIGH), {}),
}
ALIKE = 1e-9
LAGS = ({}, {"lag_steps": 4}, {"lag_s": 1.0})


def side_by_side(site, rows, **asked):
    """Kernel and twin after the same readings, the twin from the kernel's start."""
    tracker, settings, models = told(site, restart_window=31, **asked)
    ((first, scan), *rest) = scans(rows)
    shown = [tracker.process(table(site, scan), watermark_s=first)]
    begun = kernel_belief(tracker)
    assert begun.alive
    D = settings["dimensions"]
    twin = Twin(settings, models)
    twin.start(first, begun.mean[:D], begun.covariance[:D, :D])
    for t, scan in rest:
        twin.step(t, scan)
    shown.append(tracker.process(table(site, [z for _, scan in rest for z in scan])))
    shown.append(tracker.finish())
    return tracker, twin, shown


def kernel_belief(tracker, target=0):
    return opened(tracker._bank.snapshot()).targets[target].belief


def alike(found, expected, *, rtol=ALIKE):
    """Equal to rounding, small numbers measured by the largest of their kind."""
    expected = np.asarray(expected)
    np.testing.assert_allclose(found, expected, rtol=rtol, atol=rtol * np.abs(expected).max())


def asked_of_twins():
    for i, name in enumerate(CASES):
        yield pytest.param(name, {}, id=name)
        lag = ({"lag_steps": 4}, {"lag_s": 1.0})[i % 2]
        yield pytest.param(name, lag, id=f"{name}, {next(iter(lag))}")


@pytest.mark.parametrize(("name", "lag"), list(asked_of_twins()))
def test_the_kernel_is_its_twin(name, lag):
    site, changed = CASES[name]
    rng = np.random.default_rng([*name.encode(), len(lag)])
    late = 0.1 if changed.get("robust", 1) else 0.0
    height = 0.0 if np.isnan(site.positions[0, 2]) else 0.7
    # Without robustness an outage ends in likelihoods below any float.
    times = uneven(rng, 40) if late else 100.0 + 0.1 * np.arange(40)
    rows = run(rng, site, times, late=late, given=0.2, noise=0.15, height=height)
    tracker, twin, shown = side_by_side(site, rows, **lag, **changed)

    assert tracker.counts["restarted"] == 0  # a twin does not start
    belief, D = kernel_belief(tracker), twin.D
    alike(belief.probability[: len(twin.p)], twin.p)
    for j, (mean, covariance) in enumerate(belief.modes[: len(twin.p)]):
        alike(mean, twin.x[j])
        alike(covariance, twin.P[j])
    for found, expected in zip((belief.mean, belief.covariance), twin.moments(), strict=True):
        alike(found, expected)
    alike([belief.pool, belief.heard[:2]], [[twin.pool_weight, twin.pool_power], twin.heard[:2]])
    alike(belief.heard, twin.heard)
    assert [slot.sensor for slot in belief.slots] == [slot.sensor for slot in twin.slots]
    if twin.slots:
        alike([s[2:] for s in belief.slots], [s[2:] for s in twin.slots])

    expected = twin.lagged(**lag) if lag else twin.rows
    joined = {
        column: np.concatenate([getattr(part, column) for part in shown])
        for column in ("t_s", "position", "velocity", "covariance", "nis", "status")
    }
    np.testing.assert_array_equal(joined["t_s"], [row.t for row in expected])
    np.testing.assert_array_equal(joined["status"], [0, 0, 0] + [1] * (len(expected) - 3))
    alike(joined["position"][:, :D], [row.mean[:D] for row in expected])
    alike(joined["velocity"][:, :D], [row.mean[D : 2 * D] for row in expected])
    alike(joined["covariance"], [twin.shown_covariance(row) for row in expected])
    alike(joined["nis"][1:], [row.nis for row in expected[1:]])


# Settings ---------------------------------------------------------------------------------------


def test_the_kernel_s_table_holds_the_models():
    models = tuple(
        RangeModel(*(100.0 * i + k for k in range(10)), bool(i % 2), 0.5 + i, 7.0) for i in range(8)
    )
    _, settings, table = told(box(*models, heights=(1.0, 2.0)))
    for i, (row, model) in enumerate(zip(table, models, strict=True)):
        assert row[:3] == tuple(box(*models, heights=(1.0, 2.0)).positions[i])
        expected = np.array(astuple(model), float)[[0, 1, 2, 3, 4, 5, 6, 7, 10, 11]]
        expected[[2, 3, 9]] **= 2
        np.testing.assert_allclose(row[3:], expected)
    assert settings["common_bias_sigma"] == 708.0
    assert settings["scale_sigma"] == 709.0


@pytest.mark.parametrize(
    ("change", "key", "expected"),
    [
        ({}, "slot_bias", True),
        ({"bias_sigma_m": 0.0}, "slot_bias", False),
        ({}, "slot_correlated", True),
        ({"correlated_sigma_m": 0.0}, "slot_correlated", False),
        ({}, "slots", 8),
        ({"bias_sigma_m": 0.0, "correlated_sigma_m": 0.0}, "slots", 8),  # for learned noise
        ({"bias_sigma_m": 0.0, "correlated_sigma_m": 0.0, "learn_noise": False}, "slots", 0),
    ],
)
def test_only_what_is_open_is_estimated(change, key, expected):
    assert told(box(replace(UNCALIBRATED, **change))).settings[key] == expected


def test_a_calibrated_site_is_left_alone_when_asked():
    settings = told(box(UNCALIBRATED, self_calibration=False)).settings
    assert not settings["slot_bias"]
    assert settings["common_bias_sigma"] == settings["scale_sigma"] == 0.0
    assert settings["slot_correlated"]


def test_a_target_s_own_models_open_what_they_need():
    site = replace(box(RangeModel()), target_models={"x": (UNCALIBRATED,) * 8})
    settings = told(site).settings
    assert settings["slot_bias"]
    assert settings["slot_correlated"]
    assert settings["common_bias_sigma"] == UNCALIBRATED.common_bias_sigma_m


def test_ways_to_move():
    assert modes(Target()) == (STRAIGHT, TURNING, MANOEUVRING)
    assert modes(Target(motion="cv")) == (
        Mode(MANOEUVRING.accel_density, turns=False, switch_rate=0.0),
    )
    assert modes(Target(motion="cv", accel_sigma_m_s2=0.3)) == (
        Mode(0.09, turns=False, switch_rate=0.0),
    )
    wild = modes(Target(accel_sigma_m_s2=3.0))
    assert [m.accel_density for m in wild] == [STRAIGHT.accel_density, TURNING.accel_density, 9.0]
    calm = modes(Target(accel_sigma_m_s2=0.1))
    assert [m.turns for m in calm] == [False, True, True]
    # No mode is wilder than what is told; a straight way is as quiet as it was.
    expected = [STRAIGHT.accel_density, 0.01, 0.01]
    np.testing.assert_allclose([m.accel_density for m in calm], expected)


@pytest.mark.parametrize(
    ("heights", "asked", "expected"),
    [
        (None, {}, (0.0, 0.0)),  # sensors without heights
        ((0.0,), {}, (0.0, 0.0)),
        ((3.0, 2.5), {"height_m": 0.4}, (0.4, 0.0)),
        ((3.0, 2.5), {"dimensions": 3}, (0.0, 0.0)),
        ((3.0, 2.5), {}, (1.0, 0.5)),  # carried
        ((0.2, 0.5), {}, (0.5, 0.5)),  # not above all sensors
        ((9.0, 8.0), {}, (6.0, 0.5)),  # nor far below them
    ],
)
def test_heights_of_targets(heights, asked, expected):
    assert height_prior(box(heights=heights, **asked)) == expected
