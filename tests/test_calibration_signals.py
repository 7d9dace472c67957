"""Signal models from a run with truth: what was drawn comes back, as surely as it is said."""

import math
from dataclasses import replace

import numpy as np
import pytest

from source_scenes import OH, grid, match
from trackfield.calibration.signal_site import calibrate_signal_site
from trackfield.calibration.signals import SignalRun, calibrate_signals
from trackfield.errors import InputError
from trackfield.localization import source_fit
from trackfield.network.site import Site
from trackfield.sensing import signal
from trackfield.sensing.range import RangeModel
from trackfield.sensing.signal import SignalModel
from trackfield.types import Readings, Truth

TRUE = SignalModel(
    amplitude=80.0, falloff=0.6, exponent=2.4, max_range_m=6.0, sigma=0.8, sigma_gain=0.12
)
FIELD = grid(8)


def run(seed, model=TRUE, *, steps=60, k=1):
    rng = np.random.default_rng(seed)
    targets = rng.uniform(0, 7, (steps, k, 2))
    errors = signal.draw_errors(model, FIELD, rng=rng)
    z = signal.simulate(model, FIELD, targets=targets, rng=rng, errors=errors)
    return SignalRun(z, FIELD, targets), errors


def test_the_law_the_noise_and_the_gains_come_back_within_their_errors():
    off, gains = [], []
    for seed in range(12):
        given, errors = run(seed)
        found = calibrate_signals(given, replace(SignalModel(), max_range_m=6.0))
        law = found.pooled
        own = replace(TRUE, amplitude=TRUE.amplitude * (1.0 + errors.gain.mean()))
        off.append(
            [
                (getattr(law, name) - getattr(own, name)) / getattr(found.errors, name)
                for name in ("amplitude", "falloff", "exponent")
            ]
        )
        assert law.sigma == pytest.approx(TRUE.sigma, rel=0.05)
        assert law.sigma_gain == pytest.approx(TRUE.sigma_gain, rel=0.35)
        heard = signal.strength(TRUE, 1.5) * (1.0 + errors.gain)
        said = [signal.strength(model, 1.5) for model in found.models]
        gains.append((said / heard - 1.0) / found.gain_error)
        assert not found.broken.any()
    rms = np.sqrt(np.mean(np.square(off), axis=0))
    assert ((rms > 0.5) & (rms < 2.0)).all()
    assert np.sqrt(np.mean(np.square(gains))) == pytest.approx(1.1, abs=0.3)


def test_two_targets_at_once_and_silence_are_no_trouble():
    given, _ = run(1, k=2, steps=40)
    z = np.where(np.random.default_rng(1).random(given.values.shape) < 0.2, math.nan, given.values)
    targets = given.targets.copy()
    targets[:10, 1] = math.nan
    z[:10] = run(1, k=1, steps=10)[0].values
    targets[:10, 0] = run(1, k=1, steps=10)[0].targets[:, 0]
    found = calibrate_signals(SignalRun(z, FIELD, targets), TRUE)
    assert found.pooled.exponent == pytest.approx(TRUE.exponent, abs=0.15)
    assert found.given == np.isfinite(z).sum()


def test_a_stuck_sensor_is_named_and_moves_nothing():
    given, _ = run(2)
    clean = calibrate_signals(given, TRUE)
    z = given.values.copy()
    z[:, 27] = 300.0
    found = calibrate_signals(SignalRun(z, FIELD, given.targets), TRUE)
    assert np.flatnonzero(found.broken).tolist() == [27]
    for name in ("amplitude", "falloff", "exponent", "sigma"):
        expected = getattr(clean.pooled, name)
        assert getattr(found.pooled, name) == pytest.approx(expected, rel=0.05)


def test_calibrated_sensors_locate_better():
    """Gains told one by one: the error falls, and stays honest."""
    model = replace(OH, sigma_gain=0.15)
    rng = np.random.default_rng(3)
    field = grid(12)
    errors = signal.draw_errors(model, field, rng=rng)
    walk = rng.uniform(0, 11, (150, 1, 2))
    values = signal.simulate(model, field, targets=walk, rng=rng, errors=errors)
    learned = calibrate_signals(SignalRun(values, field, walk), model)
    table = signal.columns(learned.models)
    square = {"told": [], "calibrated": []}
    for _ in range(60):
        target = rng.uniform(2, 9, (1, 2))
        z = signal.simulate(model, field, targets=target, rng=rng, errors=errors)
        for name, models in (("told", model), ("calibrated", table)):
            reports = source_fit.locate(models, field, values=z)
            pairs = match(reports, target)
            square[name].extend(((reports.position[pairs.reports] - target) ** 2).ravel())
    assert len(square["told"]) == len(square["calibrated"]) == 120
    assert np.mean(square["calibrated"]) < 0.25 * np.mean(square["told"])


def test_a_run_that_cannot_be_used_is_refused():
    given, _ = run(4, steps=20)
    with pytest.raises(InputError, match="shape"):
        calibrate_signals(SignalRun(given.values[:, :5], FIELD, given.targets))
    with pytest.raises(InputError, match="finite"):
        calibrate_signals(SignalRun(np.full_like(given.values, np.inf), FIELD, given.targets))
    with pytest.raises(InputError, match="near targets"):
        calibrate_signals(SignalRun(given.values, FIELD, given.targets + 1e3))
    few = given.values.copy()
    few[1:] = math.nan
    few[0] += np.random.default_rng(4).choice([-1e5, 1e5], 64)
    with pytest.raises(InputError, match="fit"):
        calibrate_signals(SignalRun(few, FIELD, given.targets), TRUE)


def tables(given):
    """A site and its run as tables: a range sensor stands beside the signal sensors."""
    n = len(FIELD)
    names = tuple(f"s{i}" for i in range(n))
    places = np.full((n + 1, 3), np.nan)
    places[:n, :2], places[n, :2] = FIELD, 0.0
    site = Site("field", (*names, "r"), places, (TRUE,) * n + (RangeModel(),))
    steps = len(given.values)
    rows = steps * n
    readings = Readings(
        t_s=np.repeat(np.arange(steps) * 1.0, n),
        sensor=np.tile(np.arange(n, dtype=np.int32), steps),
        value=given.values.ravel(),
        target=np.full(rows, -1, np.int32),
        kind=np.zeros(rows, np.int32),
        sigma=np.full(rows, math.nan),
        arrival_s=np.full(rows, math.nan),
        sensor_ids=names,
        target_ids=(),
        kinds=("signal",),
    )
    path = np.column_stack([given.targets[:, 0], np.full(steps, math.nan)])
    truth = Truth(np.arange(steps) * 1.0, np.zeros(steps, np.int32), path, ("a",))
    return site, readings, truth


def test_a_site_is_calibrated_from_its_tables():
    given, _ = run(5)
    site, readings, truth = tables(given)
    found = calibrate_signal_site(site, readings, truth)
    direct = calibrate_signals(given, TRUE)
    assert found.calibration.pooled == direct.pooled
    assert found.site.models == (*direct.models, RangeModel())
    assert found.sensor_ids == site.sensor_ids[:-1]


def test_tables_that_do_not_fit_the_site_are_refused():
    given, _ = run(5, steps=5)
    site, readings, truth = tables(given)
    with pytest.raises(InputError, match="no sensor of kind"):
        calibrate_signal_site(replace(site, models=(RangeModel(),) * 65), readings, truth)
    with pytest.raises(InputError, match="no reading of kind"):
        calibrate_signal_site(site, replace(readings, kinds=("range",)), truth)
    strange = tuple(f"x{i}" for i in range(64))
    with pytest.raises(InputError, match="'x0', which is no signal sensor"):
        calibrate_signal_site(site, replace(readings, sensor_ids=strange), truth)
