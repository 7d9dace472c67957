"""Sources by maximum likelihood: found all, nothing else, honest covariances, whatever is said."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from source_scenes import OH, ROUGH, grid, match, nis
from trackfield.errors import InputError
from trackfield.localization import source_fit
from trackfield.localization.source_settings import SourceSettings, settings_for, spacing
from trackfield.sensing import signal

FIELD = grid(30)
seeds = st.integers(0, 2**32 - 1)


def apart(rng, k, least_m=3.0, side=29.0):
    """Places of k targets, none nearer to another than `least_m`."""
    places = [rng.uniform(0, side, 2)]
    while len(places) < k:
        p = rng.uniform(0, side, 2)
        if min(np.hypot(*(p - q)) for q in places) >= least_m:
            places.append(p)
    return np.array(places)


def scene(seed, *, k=4, model=OH, field=FIELD):
    rng = np.random.default_rng(seed)
    targets = apart(rng, k, side=field.max())
    factors = np.exp(model.sigma_factor * rng.standard_normal(k))
    return targets, signal.simulate(model, field, targets=targets, rng=rng, factors=factors)


def same(one, other):
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize(
    ("model", "off"),
    [(OH, 0.3), (ROUGH, 0.6), (replace(OH, combination="max"), 0.3)],  # .3: of 240 draws, 2.3 sigma
)
def test_every_target_is_found_with_an_honest_covariance(model, off):
    """Rough sensors are known to first order only: their reports are a little too sure."""
    errors, misfits = [], []
    for seed in range(60):
        targets, z = scene(seed, model=model)
        found = source_fit.locate(model, FIELD, values=z)
        pairs = match(found, targets)
        assert len(found.position) == len(pairs.targets) == len(targets)
        assert found.complete
        errors.extend(nis(found, targets, pairs))
        misfits.extend(found.misfit)
    assert np.mean(errors) == pytest.approx(2.0, abs=off)
    assert np.mean(misfits) == pytest.approx(1.0, abs=0.15)


def test_two_targets_a_fifth_of_the_spacing_apart_are_two():
    for seed in range(40):
        rng = np.random.default_rng(seed)
        turn = rng.uniform(0, 2 * math.pi)
        arm = 0.1 * np.array([math.cos(turn), math.sin(turn)])
        targets = rng.uniform(10, 20, 2) + np.array([arm, -arm])
        z = signal.simulate(OH, FIELD, targets=targets, rng=rng)
        found = source_fit.locate(OH, FIELD, values=z)
        assert len(found.position) == len(match(found, targets, radius_m=0.1).targets) == 2


def test_amplitudes_are_told_where_they_differ():
    targets = np.array([[8.3, 9.1], [20.2, 14.7]])
    factors = np.array([0.6, 1.7])
    model = replace(OH, sigma_factor=0.4)
    rng = np.random.default_rng(1)
    z = signal.simulate(model, FIELD, targets=targets, rng=rng, factors=factors)
    found = source_fit.locate(model, FIELD, values=z)
    pairs = match(found, targets)
    expected = 195.0 * factors[pairs.targets]
    np.testing.assert_allclose(found.amplitude[pairs.reports], expected, rtol=0.03)


@given(seeds, st.booleans())
def test_the_order_of_the_sensors_does_not_matter(seed, rough):
    model = ROUGH if rough else OH
    _, z = scene(seed, model=model)
    order = np.random.default_rng(seed).permutation(len(z))
    one = source_fit.locate(model, FIELD, values=z)
    other = source_fit.locate(model, FIELD[order], values=z[order])
    np.testing.assert_allclose(other.position, one.position, atol=1e-6)
    np.testing.assert_allclose(other.gain, one.gain, rtol=1e-4)
    np.testing.assert_array_equal(order[other.leader], one.leader)


@given(seeds)
def test_a_moved_and_turned_field_gives_moved_and_turned_reports(seed):
    _, z = scene(seed)
    away = np.array([100.0, -50.0])
    turned = np.column_stack([-FIELD[:, 1], FIELD[:, 0]]) + away
    one = source_fit.locate(OH, FIELD, values=z)
    other = source_fit.locate(OH, turned, values=z)
    expected = np.column_stack([-one.position[:, 1], one.position[:, 0]]) + away
    np.testing.assert_allclose(other.position, expected, atol=1e-5)
    xx, xy, yy = one.covariance.T
    np.testing.assert_allclose(
        other.covariance, np.column_stack([yy, -xy, xx]), rtol=1e-3, atol=1e-8
    )


def test_a_scan_repeats_and_leaves_its_input_alone():
    _, z = scene(2)
    before = z.copy()
    same(source_fit.locate(OH, FIELD, values=z), source_fit.locate(OH, FIELD, values=z))
    np.testing.assert_array_equal(z, before)


def test_a_silent_sensor_is_as_good_as_none():
    targets, z = scene(3)
    silent = np.random.default_rng(3).random(len(z)) < 0.2
    heard = np.where(silent, math.nan, z)
    one = source_fit.locate(OH, FIELD, values=heard, settings=settings_for(OH, FIELD))
    other = source_fit.locate(
        OH, FIELD[~silent], values=z[~silent], settings=settings_for(OH, FIELD)
    )
    np.testing.assert_allclose(one.position, other.position, atol=1e-9)
    assert len(match(one, targets).targets) == len(targets)
    np.testing.assert_array_equal(FIELD[one.leader], FIELD[~silent][other.leader])


def test_noise_alone_is_no_target():
    rng = np.random.default_rng(4)
    for _ in range(50):
        found = source_fit.locate(OH, FIELD, values=rng.standard_normal(len(FIELD)))
        assert not len(found.position)


@pytest.mark.parametrize("value", [60.0, 500.0, 1e9, -1e9])
@pytest.mark.parametrize("near", [False, True])
def test_a_stuck_sensor_is_no_target_and_spoils_none(value, near):
    targets = np.array([[14.3, 15.2]])
    rng = np.random.default_rng(5)
    z = signal.simulate(OH, FIELD, targets=targets, rng=rng)
    stuck = int(np.hypot(*(FIELD - ([15.0, 15.0] if near else [3.0, 3.0])).T).argmin())
    z[stuck] = value
    found = source_fit.locate(OH, FIELD, values=z)
    assert len(found.position) == 1
    np.testing.assert_allclose(found.position, targets, atol=0.03)
    if value > 200.0:
        assert stuck in found.suspects


def test_a_dead_sensor_next_to_a_target_spoils_nothing():
    targets = np.array([[14.3, 15.2]])
    z = signal.simulate(OH, FIELD, targets=targets, rng=np.random.default_rng(6))
    z[int(np.hypot(*(FIELD - [14.0, 15.0]).T).argmin())] = 0.0
    found = source_fit.locate(OH, FIELD, values=z)
    assert len(found.position) == 1
    np.testing.assert_allclose(found.position, targets, atol=0.03)


def test_saturated_readings_say_only_that_it_is_loud():
    model = replace(OH, saturation=40.0)
    errors = []
    for seed in range(40):
        targets, z = scene(seed, model=model)
        found = source_fit.locate(model, FIELD, values=z)
        pairs = match(found, targets)
        assert len(found.position) == len(pairs.targets) == len(targets)
        errors.extend(nis(found, targets, pairs))
    assert np.mean(errors) == pytest.approx(2.0, abs=0.6)


def test_one_sensor_alone_gives_a_report_as_wide_as_its_range():
    found = source_fit.locate(OH, np.array([[3.0, 4.0]]), values=np.array([50.0]))
    assert len(found.position) == 1
    assert np.hypot(*(found.position[0] - [3.0, 4.0])) == pytest.approx(1.7, abs=0.3)
    xx, _, yy = found.covariance[0]
    assert xx + yy > 0.5 * OH.max_range_m**2


def test_an_empty_scan_has_no_sources():
    for sensors, values in (
        (np.empty((0, 2)), np.empty(0)),
        (FIELD, np.full(len(FIELD), math.nan)),
        (FIELD, np.zeros(len(FIELD))),
        (FIELD, np.full(len(FIELD), -1e6)),
    ):
        found = source_fit.locate(OH, sensors, values=values)
        assert found.position.shape == (0, 2)
        assert found.covariance.shape == (0, 3)
        assert found.complete


@pytest.mark.parametrize("level", [5.0, 10.0, 200.0, 1e6])
def test_a_field_that_is_loud_everywhere_costs_no_more_than_it_may(level):
    field = grid(60)
    settings = replace(settings_for(OH, field), work=300_000)
    found = source_fit.locate(OH, field, values=np.full(len(field), level), settings=settings)
    assert np.isfinite(found.covariance).all()
    assert len(found.position) <= len(field)


def test_a_crowd_in_one_place_costs_no_more_than_it_may():
    rng = np.random.default_rng(7)
    targets = rng.normal(15.0, 2.0, (100, 2))
    z = signal.simulate(OH, FIELD, targets=targets, rng=rng)
    settings = replace(settings_for(OH, FIELD), work=300_000)
    found = source_fit.locate(OH, FIELD, values=z, settings=settings)
    assert not found.complete
    assert len(found.suspects)
    assert np.isfinite(found.position).all()
    assert (found.covariance[:, [0, 2]] > 0).all()


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"amplitude": 0.0}, "amplitude"),
        ({"sigma": -1.0}, "sigma"),
        ({"sigma": math.nan}, "sigma"),
        ({"exponent": 0.0}, "exponent"),
        ({"sigma_gain": -0.1}, "sigma_gain"),
        ({"sigma_factor": math.inf}, "sigma_factor"),
        ({"combination": "mean"}, "combination"),
    ],
)
def test_parameters_outside_their_domain_are_named(change, word):
    with pytest.raises(InputError, match=word):
        source_fit.locate(replace(OH, **change), FIELD, values=np.zeros(len(FIELD)))


def test_input_that_is_none_is_named():
    z = np.zeros(len(FIELD))
    with pytest.raises(InputError, match="shape"):
        source_fit.locate(OH, FIELD, values=z[:-1])
    with pytest.raises(InputError, match="sensor 7: found inf"):
        source_fit.locate(OH, FIELD, values=np.where(np.arange(len(z)) == 7, math.inf, z))
    with pytest.raises(InputError, match="sensor 3: its place"):
        source_fit.locate(OH, np.where(np.arange(len(z))[:, None] == 3, math.nan, FIELD), values=z)
    table = signal.columns([OH] * 3)
    with pytest.raises(InputError, match="amplitude of shape"):
        source_fit.locate(table, FIELD, values=z)


@pytest.mark.parametrize("name", ["leader_radius_m", "gain", "group", "rounds", "work"])
def test_settings_outside_their_domain_are_named(name):
    with pytest.raises(InputError, match=name):
        replace(settings_for(OH, FIELD), **{name: 0})


def test_settings_follow_the_spacing_of_the_sensors():
    assert spacing(grid(20, 3.0)) == pytest.approx(3.0)
    assert spacing(np.column_stack([np.arange(5) * 2.0, np.zeros(5)])) == pytest.approx(2.0)
    assert spacing(np.zeros((1, 2))) == math.inf
    told = SourceSettings(1.5, 4.0, 3.0, 0.7)
    assert settings_for(OH, grid(20)) == told
    wide = settings_for(OH, grid(20, 3.0))
    assert (wide.leader_radius_m, wide.fit_radius_m, wide.group_radius_m) == (4.5, 8.0, 7.0)
    assert settings_for(OH, grid(200)).work == 200 * 200**2  # a large field may cost more
    assert settings_for(replace(OH, placement_sigma_m=0.5), grid(20)).leader_sigmas == 6.0


def test_columns_give_each_sensor_its_own_model():
    """Half of the sensors are twice as loud and noisier; told so, the report is as good."""
    models = [replace(OH, amplitude=400.0, sigma=2.0) if i % 2 else OH for i in range(len(FIELD))]
    table = signal.columns(models)
    errors = []
    for seed in range(30):
        targets, z = scene(seed, model=table)
        found = source_fit.locate(table, FIELD, values=z)
        pairs = match(found, targets)
        assert len(found.position) == len(pairs.targets) == len(targets)
        errors.extend(nis(found, targets, pairs))
    assert np.mean(errors) == pytest.approx(2.0, abs=0.5)
