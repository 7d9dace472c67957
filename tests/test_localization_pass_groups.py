"""Several passes at once: told apart by invariant and geometry; what fits none is said."""

from dataclasses import replace

import numpy as np
import pytest

from passes_of_fields import FIELD, TARGETS, TIMES, amplitudes, nearest, shuffled, told
from trackfield.errors import InputError
from trackfield.localization.pass_evidence import evidence, misfits
from trackfield.localization.pass_fusion import fuse
from trackfield.localization.pass_groups import group
from trackfield.localization.pass_messages import PassMessages, common_records
from trackfield.sensing.amplitude import AmplitudeModel
from trackfield.sensing.pass_profile import predict

LOUD = AmplitudeModel(sigma=10**-1.0)  # 20 dB at 1 km
WEAK = AmplitudeModel(sigma=10**-0.5)  # 10 dB


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize(
    ("model", "times"),
    [
        (LOUD, TIMES),
        (WEAK, TIMES),
        (replace(LOUD, clock_sigma_s=0.3), TIMES),
        (replace(LOUD, fading="rayleigh"), np.arange(0.0, 24.01, 0.25)),
    ],
    ids=["20 dB", "10 dB", "clocks", "fading"],
)
def test_every_target_gets_its_own_pass(count, model, times):
    for seed in range(3):
        rng = np.random.default_rng([seed, count])
        profiles = told(TARGETS[:count], model, rng, times=times)
        messages, sensor, owner = shuffled(profiles, model, rng, times=times)
        found = group(messages, sensor)
        assert len(found.groups) == count
        hit = [nearest(one.passes.theta[0]) for one in found.groups]
        assert {which for which, _ in hit} == set(range(count))
        assert max(apart for _, apart in hit) < (150.0 if model is WEAK else 200.0)
        for one, (which, _) in zip(found.groups, hit, strict=True):
            loud = one.messages[messages.profiles[one.messages, 0] > 4.0 * model.sigma]
            assert np.mean(owner[loud] == which) > 0.8
            assert np.unique(sensor[one.messages]).size == one.messages.size
        everyone = np.concatenate(
            [*(g.messages for g in found.groups), found.unexplained, found.quiet]
        )
        assert sorted(everyone.tolist()) == list(range(len(sensor)))
        assert found.unexplained.size <= 2


def test_the_order_of_messages_does_not_matter():
    rng = np.random.default_rng(5)
    messages, sensor, _ = shuffled(told(TARGETS[:2], LOUD, rng), LOUD, rng)
    found = group(messages, sensor)
    back = np.random.default_rng(6).permutation(len(sensor))
    mixed = messages._replace(sensors=messages.sensors[back], profiles=messages.profiles[back])
    other = group(mixed, sensor[back])
    for one, same in zip(found.groups, other.groups, strict=True):
        assert set(back[same.messages].tolist()) == set(one.messages.tolist())
        np.testing.assert_allclose(same.passes.theta[0], one.passes.theta[0], rtol=1e-6)


def test_a_message_that_fits_no_pass_is_said_to():
    rng = np.random.default_rng(7)
    profiles = told(TARGETS[:1], LOUD, rng)
    profiles[0, 2] = 5.0, 3.0, 1.0  # where it was, the target was late, and far less loud
    messages, sensor, _ = shuffled(profiles, LOUD, rng)
    found = group(messages, sensor)
    assert len(found.groups) == 1
    assert sensor[found.unexplained].tolist() == [2]
    assert nearest(found.groups[0].passes.theta[0])[1] < 60.0


def test_messages_of_two_sensors_are_no_pass():
    rng = np.random.default_rng(8)
    messages, sensor, _ = shuffled(
        told(TARGETS[:1], LOUD, rng)[:, :2], LOUD, rng, sensors=FIELD[:2]
    )
    found = group(messages, sensor)
    assert found.groups == ()
    assert sorted(found.unexplained.tolist()) == [0, 1]


def test_silence_is_heard_too_and_empty_is_empty():
    messages = PassMessages(FIELD, (LOUD,) * 20, np.zeros((20, 3)), common_records(20, TIMES))
    found = group(messages, np.arange(20, dtype=np.int32))
    assert found.groups == ()
    assert found.unexplained.size == 0
    assert found.quiet.size == 20
    none = PassMessages(np.empty((0, 2)), (), np.empty((0, 3)), common_records(0, TIMES))
    assert group(none, np.empty(0, np.int32)).groups == ()


def test_sensors_must_match_the_messages():
    messages = PassMessages(FIELD, (LOUD,) * 20, np.zeros((20, 3)), common_records(20, TIMES))
    with pytest.raises(InputError, match="20 messages"):
        group(messages, np.zeros(3, np.int32))


@pytest.mark.parametrize("fading", ["none", "rayleigh"])
@pytest.mark.parametrize("exponent", [1.0, 1.6])
def test_a_misfit_is_twice_the_likelihood_that_a_trajectory_costs(fading, exponent):
    """Of the told profile itself in place of samples, summed sample by sample."""
    model = AmplitudeModel(exponent=exponent, sigma=0.05, fading=fading)
    truth = np.array([1000.0 ** (2 * exponent), *TARGETS[0, 1:]])
    psi = predict(truth, FIELD[:4], exponent=exponent).array()
    messages = PassMessages(FIELD[:4], (model,) * 4, psi, common_records(4, TIMES), start_s=3.0)
    given = evidence(messages)
    here = truth + np.array([0, 3 * truth[3], 3 * truth[4], 0, 0])
    np.testing.assert_allclose(misfits(given, here, exponent=exponent), 0.0, atol=1e-12)
    other = truth * [1.3, 1.02, 0.9, 1.0, 1.1]
    a, b = (amplitudes(one, model, sensors=FIELD[:4]) for one in (truth, other))
    if fading == "none":
        expected = ((a - b) ** 2).sum(axis=1) / 0.05**2
    else:
        v, w = 0.05**2 + a**2, 0.05**2 + b**2
        expected = 2 * (v / w - 1 - np.log(v / w)).sum(axis=1)
    there = other + np.array([0, 3 * other[3], 3 * other[4], 0, 0])
    np.testing.assert_allclose(misfits(given, there, exponent=exponent), expected, rtol=1e-9)
    silence = misfits(given, there * [1e-30, 1, 1, 1, 1], exponent=exponent)
    np.testing.assert_allclose(silence, given.loudness, rtol=1e-9)


def test_misfits_are_those_of_the_fusion():
    rng = np.random.default_rng(9)
    for fading in ("none", "rayleigh"):
        model = replace(LOUD, fading=fading)
        messages, _, _ = shuffled(told(TARGETS[:1], model, rng), model, rng)
        found = fuse(messages)
        given = evidence(messages)
        np.testing.assert_allclose(
            misfits(given, found.theta[0]), found.deviance[0], rtol=1e-6, atol=1e-6
        )


def test_long_records_are_thinned_but_weigh_the_same():
    psi = predict(TARGETS[0], FIELD[:5]).array()
    times = np.arange(0.0, 24.0, 0.02)
    models = (LOUD,) * 5
    long = evidence(PassMessages(FIELD[:5], models, psi, common_records(5, times)))
    assert long.t_s.shape == (5, 256)
    other = TARGETS[0] * [1.2, 1.01, 0.95, 1.0, 1.0]
    full = (amplitudes(TARGETS[0], LOUD, times=times) - amplitudes(other, LOUD, times=times)) ** 2
    np.testing.assert_allclose(
        misfits(long, other), full[:5].sum(axis=1) / LOUD.sigma**2, rtol=5e-3
    )


def test_a_clock_that_may_be_wrong_is_forgiven_at_a_price():
    psi = predict(TARGETS[0], FIELD[:3]).array()
    psi[2, 1] += 0.6
    records = common_records(3, TIMES)
    sure = misfits(evidence(PassMessages(FIELD[:3], (LOUD,) * 3, psi, records)), TARGETS[0])
    doubted = (replace(LOUD, clock_sigma_s=0.3),) * 3
    doubt = misfits(evidence(PassMessages(FIELD[:3], doubted, psi, records)), TARGETS[0])
    theta = TARGETS[0]
    costs = []
    for ahead in np.linspace(0.0, 0.6, 601):  # the clock's place and its price, tried one by one
        late = theta + ahead * np.array([0, *-theta[3:5], 0, 0])
        a = amplitudes(late, LOUD, sensors=FIELD[2:3])[0]
        told = amplitudes(theta + 0.6 * np.array([0, *-theta[3:5], 0, 0]), LOUD, sensors=FIELD[2:3])
        costs.append(((a - told[0]) ** 2).sum() / LOUD.sigma**2 + (ahead / 0.3) ** 2)
    assert doubt[2] == pytest.approx(min(costs), rel=1e-3)
    assert doubt[2] < 0.2 * sure[2]
    np.testing.assert_allclose(doubt[:2], 0.0, atol=1e-9)
