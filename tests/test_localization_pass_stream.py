"""Messages one by one: the last estimate is the batch one, whatever their order."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from passes_of_fields import FIELD, TARGETS, TIMES, messages_of, nearest, told
from trackfield.localization.pass_fusion import PassVerdict, fuse
from trackfield.localization.pass_lifted import empty
from trackfield.localization.pass_messages import PassMessages, common_records, fishers
from trackfield.localization.pass_stream import (
    PassStream,
    added,
    estimated,
    first_guess,
    together,
)
from trackfield.sensing.amplitude import AmplitudeModel
from trackfield.sensing.profile import Profile

MODEL = AmplitudeModel(sigma=10**-1.0)
SAID = told(TARGETS[:1], MODEL, np.random.default_rng(1))[0]
MESSAGES = messages_of(SAID, MODEL)


def streamed(messages):
    stream = PassStream()
    for one in messages:
        stream = added(stream, one)
    return stream


@given(st.permutations(range(8)))
def test_the_last_estimate_is_the_batch_one_bit_by_bit(order):
    found = estimated(streamed([MESSAGES[k] for k in order]), start_s=2.0)
    records = common_records(8, TIMES)
    batch = fuse(PassMessages(FIELD[:8], (MODEL,) * 8, SAID[:8], records, start_s=2.0))
    for one, other in zip(found, batch, strict=True):
        np.testing.assert_array_equal(one, other)


def test_there_is_an_estimate_after_each_message_and_it_gets_better():
    stream, apart, verdicts = PassStream(), [], []
    for one in MESSAGES:
        stream = added(stream, one)
        found = estimated(stream)
        verdicts.append(found.verdict)
        if len(found.theta):
            apart.append(nearest(found.theta[0])[1])
    assert verdicts[0] == PassVerdict.NOTHING
    assert verdicts[1] == PassVerdict.TOO_FEW
    assert set(verdicts[3:]) == {PassVerdict.GOOD}
    assert apart[-1] < 20.0
    assert np.mean(apart[-5:]) < np.mean(apart[2:7])


def test_the_linear_sum_is_that_of_the_messages_whatever_their_order():
    forth, back = streamed(MESSAGES[:6]), streamed(MESSAGES[5::-1])
    one, other = first_guess(forth), first_guess(back)
    assert one.determined
    np.testing.assert_allclose(one.theta, other.theta, rtol=1e-6)
    total = empty(FIELD[0], time_s=SAID[0, 1])
    J = fishers(together(MESSAGES[:6]))
    for k in range(6):
        total = total.added(Profile(*SAID[k]), J[k], FIELD[k])
    np.testing.assert_allclose(forth.linear.matrix, total.matrix, rtol=1e-12)
    assert nearest(one.theta)[1] < 400.0


def test_a_second_message_of_a_sensor_takes_the_place_of_the_first():
    wrong = MESSAGES[2]._replace(profile=Profile(5.0, 3.0, 1.0))
    stream = streamed([*MESSAGES[:2], wrong, *MESSAGES[3:6]])
    assert estimated(stream).verdict == PassVerdict.CONTRADICTORY
    mended = added(stream, MESSAGES[2])
    assert mended.messages == streamed(MESSAGES[:6]).messages
    np.testing.assert_allclose(mended.linear.matrix, streamed(MESSAGES[:6]).linear.matrix)
    assert estimated(mended).verdict == PassVerdict.GOOD


def test_a_message_that_comes_twice_counts_once():
    stream = streamed(MESSAGES[:5])
    assert added(stream, MESSAGES[3]) is stream


def test_a_sensor_that_heard_nothing_has_no_equations_but_counts():
    silent = MESSAGES[6]._replace(profile=Profile(0.0, 0.0, 0.0))
    stream = added(streamed(MESSAGES[:5]), silent)
    assert stream.linear.messages == 5
    assert len(stream.messages) == 6
    assert estimated(stream).deviance.shape[1] == 6


def test_nothing_yet_is_nothing():
    assert first_guess(PassStream()) is None
    assert estimated(PassStream()).verdict == PassVerdict.NOTHING
    assert first_guess(streamed(MESSAGES[:2])).determined is False
    assert together([]).profiles.shape == (0, 3)


@pytest.mark.parametrize("k", [0, 3])
def test_streams_are_values(k):
    stream = streamed(MESSAGES[:k])
    before = stream.messages
    added(stream, MESSAGES[9])
    assert stream.messages is before
