"""How many nodes: one fewer does not do, and the bound of each place is that of all pairs."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trackfield.errors import InputError
from trackfield.localization.bounds import range_bound, range_information
from trackfield.network.boxes import Box
from trackfield.network.layouts import lattice, lattice_count, random_places
from trackfield.raster import Region
from trackfield.scheduling.provision import (
    Wanted,
    field_bound,
    field_reaches,
    first_guess,
    nodes_needed,
)
from trackfield.sensing.bearing import BearingModel
from trackfield.sensing.range import RangeModel

FIELD = Region(0, 0, 40, 30)
SPACE = Box(np.zeros(3), np.array([20.0, 20.0, 15.0]))
RANGES = RangeModel(sigma_m=0.1, max_range_m=8.0)


@settings(max_examples=30)
@given(
    seed=st.integers(0, 1000),
    d=st.sampled_from([2, 3]),
    reach=st.sampled_from([3.0, 9.0, math.inf]),
    scale=st.sampled_from([0.0, 0.05]),
)
def test_the_bound_near_a_place_is_that_of_all_nodes(seed, d, reach, scale):
    rng = np.random.default_rng(seed)
    nodes, places = rng.uniform(0, 20, (60, d)), rng.uniform(-5, 25, (30, d))
    model = RangeModel(sigma_m=0.2, sigma_scale=scale, max_range_m=reach)
    found, expected = (
        field_bound(nodes, places, model=model),
        range_bound(nodes, places, models=model),
    )
    np.testing.assert_array_equal(found.determined, expected.determined)
    sure = expected.determined
    np.testing.assert_allclose(found.covariance[sure], expected.covariance[sure], rtol=1e-6)


def test_what_a_field_reaches_is_what_places_tried_at_random_say():
    rng = np.random.default_rng(0)
    nodes = random_places(FIELD, 90, rng=rng)
    wanted = Wanted(0.12, 0.8)
    found = field_reaches(nodes, FIELD, model=RANGES, wanted=wanted)
    places = rng.uniform([0, 0], [40, 30], (20_000, 2))
    bound = range_bound(nodes, places, models=RANGES)
    rms = np.where(bound.determined, np.sqrt(np.trace(bound.covariance, axis1=1, axis2=2)), np.inf)
    assert found.share == pytest.approx((rms <= 0.12).mean(), abs=0.01)
    assert found.rms_m == pytest.approx(np.quantile(rms, 0.8), rel=0.02)


def test_one_random_node_fewer_does_not_do():
    for seed, wanted in ((1, Wanted(0.12)), (2, Wanted(0.3, 0.6)), (3, Wanted(0.08, 1.0))):
        found = nodes_needed(
            FIELD,
            RANGES,
            wanted=wanted,
            layout="random",
            most=3000,
            rng=np.random.default_rng(seed),
        )
        drawn = random_places(FIELD, 3000, rng=np.random.default_rng(seed))
        np.testing.assert_array_equal(found.nodes, drawn[: found.number])
        assert found.enough
        assert found.reached.share >= wanted.share
        assert found.reached.rms_m <= wanted.rms_m
        fewer = field_reaches(drawn[: found.number - 1], FIELD, model=RANGES, wanted=wanted)
        assert fewer.share < wanted.share
        assert fewer.rms_m > wanted.rms_m


@pytest.mark.parametrize(
    ("region", "layout"),
    [(FIELD, "hexagonal"), (FIELD, "square"), (SPACE, "cubic"), (SPACE, "body-centred")],
)
def test_the_next_wider_lattice_does_not_do(region, layout):
    wanted = Wanted(0.15, 0.9)
    found = nodes_needed(region, RANGES, wanted=wanted, layout=layout)
    assert found.enough
    np.testing.assert_array_equal(found.nodes, lattice(region, found.spacing_m, layout=layout))
    assert found.number == len(found.nodes)
    assert found.reached == field_reaches(found.nodes, region, model=RANGES, wanted=wanted)
    wider = found.spacing_m * (1 + 1e-6)
    assert lattice_count(region, wider, layout=layout) < found.number
    sparse = lattice(region, wider, layout=layout)
    assert field_reaches(sparse, region, model=RANGES, wanted=wanted).share < 0.9


@pytest.mark.parametrize("layout", ["hexagonal", "random"])
def test_out_of_reach_it_says_the_best_there_is(layout):
    found = nodes_needed(
        FIELD,
        RANGES,
        wanted=Wanted(0.001),
        layout=layout,
        most=500,
        rng=np.random.default_rng(0),
    )
    assert not found.enough
    assert 450 < found.number <= 500
    assert found.reached.share == 0.0
    assert 0.001 < found.reached.rms_m < 0.15
    few = nodes_needed(FIELD, RANGES, wanted=Wanted(0.1), layout="square", most=2)
    assert not few.enough
    assert few.number <= 2
    assert few.reached.rms_m == math.inf
    assert nodes_needed(Region(0, 0, 100, 1), RANGES, wanted=Wanted(0.1), most=1).number <= 1


@pytest.mark.parametrize("d", [2, 3])
def test_the_first_guess_is_the_mean_information_of_a_random_field(d):
    """In closed form for ranges, and against the mean over random fields around a place."""
    region = FIELD if d == 2 else SPACE
    measure, ball = (1200.0, math.pi * 8**2) if d == 2 else (6000.0, 4 / 3 * math.pi * 8**3)
    expected = d**2 * 0.1**2 * measure / (ball * 0.02**2)
    assert first_guess(region, RANGES, wanted=Wanted(0.02), most=10**6) == math.ceil(expected)
    assert first_guess(region, RANGES, wanted=Wanted(0.02), most=7) == 7

    rng = np.random.default_rng(4)
    nodes = rng.uniform(-8, 8, (40_000, d))
    mean = range_information(nodes, np.zeros((1, d)), models=RANGES)[0] / 40_000
    np.testing.assert_allclose(
        mean * 16**d, np.eye(d) * ball / (d * 0.1**2), rtol=0.03, atol=0.03 * ball / 0.02
    )


def test_a_mean_over_fields_is_never_better_than_the_guess_says():
    """Jensen: the mean trace of the bound is above the trace of the mean information's inverse."""
    rng, wanted = np.random.default_rng(5), Wanted(0.05)
    count = first_guess(FIELD, RANGES, wanted=wanted, most=10**5)
    middle = np.array([[20.0, 15.0]])
    traces = [
        np.trace(range_bound(nodes, middle, models=RANGES).covariance[0])
        for nodes in rng.uniform([0, 0], [40, 30], (200, count, 2))
    ]
    assert np.mean(traces) > 0.05**2


def test_more_is_asked_for_with_less_noise_to_spare():
    def needed(wanted, model=RANGES):
        rng = np.random.default_rng(0)
        return nodes_needed(FIELD, model, wanted=wanted, layout="random", most=1500, rng=rng).number

    usual = needed(Wanted(0.12))
    assert usual > needed(Wanted(0.2))
    assert usual > needed(Wanted(0.12, 0.5))
    assert needed(Wanted(0.12), RangeModel(sigma_m=0.1, max_range_m=12.0)) < usual
    assert needed(Wanted(0.12), RangeModel(sigma_m=0.2, max_range_m=8.0)) > usual


def test_bearings_are_provided_for_too():
    model = BearingModel(sigma_rad=0.02, max_range_m=10.0)
    found = nodes_needed(FIELD, model, wanted=Wanted(0.15), layout="square")
    assert found.enough
    assert found.guess <= found.number < 2000


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"wanted": Wanted(0.0)}, "above 0"),
        ({"wanted": Wanted(math.inf)}, "above 0"),
        ({"wanted": Wanted(0.1, 1.1)}, "up to 1"),
        ({"most": 0}, "from 1"),
        ({"layout": "random"}, "rng"),
    ],
)
def test_what_cannot_be_wanted_is_refused(change, words):
    with pytest.raises(InputError, match=words):
        nodes_needed(FIELD, RANGES, **({"wanted": Wanted(0.1)} | change))
