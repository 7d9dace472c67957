"""The centroid of Oh (12): the plain rule as oracle, ties, limits, and its errors as in Fig. 4."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackfield.errors import InputError
from trackfield.localization.centroid import Election, locate

seeds = st.integers(0, 2**32 - 1)


def plain(sensors, z, election):
    """Oh IV.A.1, sensor by sensor."""
    theta, R_s = election
    speak = [i for i in range(len(z)) if z[i] >= theta]
    leaders, estimates = [], []
    for i in speak:
        heard = [j for j in speak if np.hypot(*(sensors[j] - sensors[i])) <= 2 * R_s]
        if all((z[j], -j) <= (z[i], -i) for j in heard):
            leaders.append(i)
            estimates.append(sum(z[j] * sensors[j] for j in heard) / sum(z[j] for j in heard))
    return leaders, estimates


@given(seeds, st.sampled_from([0.5, 1.0, 2.0]), st.booleans())
def test_leaders_and_centres_are_those_of_the_plain_rule(seed, R_s, ties):
    rng = np.random.default_rng(seed)
    sensors, z = rng.uniform(0, 12, (120, 2)), rng.normal(2.0, 3.0, 120)
    z = np.round(z) if ties else z
    election = Election(2.0, R_s)
    found = locate(sensors, z, election=election)
    leaders, estimates = plain(sensors, z, election)
    assert found.leader.tolist() == leaders
    np.testing.assert_allclose(found.position, estimates, rtol=1e-12)
    np.testing.assert_array_equal(found.amplitude, z[leaders])
    assert np.isnan(found.covariance).all()


def test_one_speaker_is_its_own_centre_and_silence_has_none():
    sensors = np.array([[1.0, 2.0], [3.0, 4.0]])
    found = locate(sensors, np.array([5.0, np.nan]))
    np.testing.assert_array_equal(found.position, [[1.0, 2.0]])
    for values in ([1.9, np.nan], [np.nan, np.nan], [-5.0, 0.0]):
        assert len(locate(sensors, np.array(values)).position) == 0
    assert len(locate(np.empty((0, 2)), np.empty(0)).position) == 0


def test_many_speakers_in_one_place_have_one_leader():
    sensors = np.zeros((3000, 2))
    found = locate(sensors, np.full(3000, 7.0))
    assert found.leader.tolist() == [0]


@pytest.mark.parametrize("election", [Election(0.0, 1.0), Election(2.0, 0.0), Election(np.nan, 1)])
def test_an_election_without_sense_is_refused(election):
    with pytest.raises(InputError, match="expected"):
        locate(np.zeros((1, 2)), np.ones(1), election=election)


def test_readings_without_sense_are_refused():
    with pytest.raises(InputError, match="sensor 0"):
        locate(np.zeros((1, 2)), np.array([np.inf]))
