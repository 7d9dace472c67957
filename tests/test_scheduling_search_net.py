"""Nets: everything that can be covered three times is, by few, able and well-spread sensors."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from trackfield.raster import Region
from trackfield.scheduling import search_net
from trackfield.types import Gaussian

REACH = 1.4


def test_places_are_the_middle_and_two_rings():
    belief = Gaussian(np.array([3.0, 4.0]), np.array([[0.5, 0.2], [0.2, 0.3]]))
    found = search_net.places(belief)
    off = found - belief.mean
    distance = np.sqrt((off * np.linalg.solve(belief.covariance, off.T).T).sum(axis=1))
    assert_allclose(distance, [0.0] + 12 * [1.0] + 12 * [2.0], atol=1e-9)
    field = Region(3.0, 0.0, 10.0, 10.0)
    inside = search_net.places(belief, field)
    assert field.contains(inside).all()
    assert 1 < len(inside) < len(found)
    outside = search_net.places(belief, Region(100.0, 100.0, 101.0, 101.0))
    assert len(outside) == len(found)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), spread=st.floats(0.1, 1.5), most=st.integers(1, 60))
def test_a_net_covers_what_it_can_and_stops(seed, spread, most):
    rng = np.random.default_rng(seed)
    sensors = rng.uniform(0, 10, (150, 2))
    able = rng.random(150) < 0.8
    wanted = search_net.places(Gaussian(rng.uniform(2, 8, 2), spread**2 * np.eye(2)))
    net = search_net.cast(sensors, wanted, reach_m=REACH, able=able, most=most)
    covers = np.linalg.norm(sensors[:, None] - wanted, axis=-1) <= REACH
    assert len(net) <= most
    assert len(set(net.tolist())) == len(net)
    assert able[net].all()
    if len(net) < most:
        possible = np.minimum(covers[able].sum(axis=0), 3)
        assert (covers[net].sum(axis=0) >= possible).all()
    for k in range(len(net)):  # each one helps where the earlier ones left a need
        need = np.maximum(3 - covers[net[:k]].sum(axis=0), 0)
        assert (covers[net[k]] & (need > 0)).any()


def test_of_sensors_that_cover_as_much_the_far_one_is_taken():
    sensors = np.array([[0.0, 0.5], [0.01, 0.5], [0.02, 0.5], [0.5, -0.3], [-0.5, -0.3]])
    net = search_net.cast(sensors, np.zeros((1, 2)), reach_m=REACH, able=np.ones(5, bool), most=3)
    assert sorted(net.tolist())[1:] == [3, 4]


def test_nobody_near_is_no_net():
    net = search_net.cast(
        np.full((3, 2), 50.0), np.zeros((1, 2)), reach_m=REACH, able=np.ones(3, bool), most=8
    )
    assert net.shape == (0,)
