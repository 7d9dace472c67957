"""Loss, delay and garbling: closed forms against SciPy, enumeration and draws."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from trackfield.errors import InputError
from trackfield.network.channel import (
    Channel,
    arrived_within,
    delay_probability,
    delayed_at_most,
    delivery_probability,
    transmit,
)
from trackfield.network.detection_by_age import (
    ages_that_matter,
    detection_by_age,
    detection_maps,
    leaders_at,
)
from trackfield.network.passage import in_order, pass_readings, pass_reports
from trackfield.network.topology import lay_out
from trackfield.raster import Raster, Region
from trackfield.types import Readings, Reports, join_rows, select_rows

REGION = Region(0.0, 0.0, 10.0, 10.0)
LINE = np.column_stack([np.arange(10) + 0.5, np.full(10, 5.0)])
BASE = np.array([[0.0, 5.0]])


def by_enumeration(p_loss, k):
    """P(one of k disjoint paths of k hops works), over all outcomes of all k * k hops."""
    total = 0.0
    for fails in itertools.product((0, 1), repeat=k * k):
        weight = math.prod(p_loss if f else 1.0 - p_loss for f in fails)
        total += weight * any(not any(fails[i * k : (i + 1) * k]) for i in range(k))
    return total


@pytest.mark.parametrize("k", [1, 2, 3])
@pytest.mark.parametrize("p_loss", [0.0, 0.3, 0.8, 1.0])
def test_delivery_over_k_paths_is_that_of_all_outcomes(k, p_loss):
    found = delivery_probability(Channel(p_loss=p_loss), k)
    np.testing.assert_allclose(found, by_enumeration(p_loss, k), rtol=1e-12, atol=1e-15)


def test_delivery_of_one_path_of_none_and_as_printed():
    one = delivery_probability(Channel(p_loss=0.3, multipath=False), [-1, 0, 1, 2, 3])
    np.testing.assert_allclose(one, [0.0, 1.0, 0.7, 0.49, 0.343])
    many = delivery_probability(Channel(p_loss=0.3), [-1, 0])
    np.testing.assert_allclose(many, [0.0, 1.0])
    printed = delivery_probability(Channel(p_loss=0.3), [-1, 1, 2], printed=True)
    np.testing.assert_allclose(printed, [0.0, 0.3, 0.51])


@given(k=st.integers(1, 8), p=st.floats(0.0, 0.99), d=st.integers(-2, 60))
def test_delays_are_negative_binomial(k, p, d):
    there = stats.nbinom(k, 1.0 - p)
    np.testing.assert_allclose(delay_probability(p, k, d), there.pmf(d), rtol=1e-9, atol=1e-14)
    np.testing.assert_allclose(delayed_at_most(p, k, d), there.cdf(d), rtol=1e-9, atol=1e-14)


def test_delays_at_the_ends_of_their_domain():
    assert delay_probability(0.3, 0, [0, 1]).tolist() == [1.0, 0.0]  # the leader itself
    assert delayed_at_most(0.3, 0, [-1, 0]).tolist() == [0.0, 1.0]
    assert delay_probability(0.0, 3, [0, 1]).tolist() == [1.0, 0.0]
    assert delayed_at_most(1.0, 3, [0, 1000]).tolist() == [0.0, 0.0]  # put off for ever


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"p_loss": -0.1}, "p_loss: found -0.1, expected a probability from 0 to 1"),
        ({"p_delay": 1.5}, "p_delay: found 1.5"),
        ({"p_garbled": math.nan}, "p_garbled: found nan"),
        ({"hop_m": 0.0}, "hop_m: found 0.0, expected a length above 0"),
        ({"hop_m": math.nan}, "hop_m: found nan"),
        ({"delay_step_s": math.inf}, "delay_step_s: found inf, expected a time above 0"),
    ],
)
def test_a_channel_that_cannot_be_is_refused(changes, said):
    with pytest.raises(InputError, match=said):
        Channel(**changes)


def test_what_is_drawn_has_the_probabilities_that_are_told():
    """Shares of 40,000 messages a number of hops, within four standard errors."""
    channel = Channel(p_loss=0.3, p_delay=0.4, delay_step_s=0.5, p_garbled=0.1)
    count, rng = 40_000, np.random.default_rng(1)
    for k in (0, 1, 2, 4):
        sent = transmit(channel, rng, t_s=np.full(count, 7.0), hops=np.full(count, k, np.int32))
        for age_s in (0.0, 0.5, 1.5):
            p = float(arrived_within(channel, k, age_s))
            share = np.mean(sent.arrival_s <= 7.0 + age_s)
            assert abs(share - p) <= 4.0 * math.sqrt(p * (1.0 - p) / count)
        arrived = int(sent.arrived.sum())
        assert abs(sent.garbled.sum() - 0.1 * arrived) < 4.0 * math.sqrt(0.09 * arrived)
        assert not (sent.garbled & ~sent.arrived).any()


def test_a_channel_without_faults_hands_on_at_once_and_one_that_always_delays_never():
    t_s, hops = np.arange(4.0), np.array([-1, 0, 1, 3], np.int32)
    clean = transmit(Channel(), np.random.default_rng(0), t_s=t_s, hops=hops)
    assert clean.arrival_s.tolist() == [math.inf, 1.0, 2.0, 3.0]
    never = transmit(Channel(p_delay=1.0), np.random.default_rng(0), t_s=t_s, hops=hops)
    assert never.arrival_s.tolist() == [math.inf, 1.0, math.inf, math.inf]


def readings(t_s, sensor, value, kind="detection"):
    n = len(t_s)
    return Readings(
        t_s=np.asarray(t_s, float),
        sensor=np.asarray(sensor, np.int32),
        value=np.asarray(value, float),
        target=np.full(n, -1, np.int32),
        kind=np.zeros(n, np.int32),
        sigma=np.full(n, np.nan),
        arrival_s=np.full(n, np.nan),
        sensor_ids=tuple(f"s{i}" for i in range(10)),
        target_ids=(),
        kinds=(kind,),
    )


def reports(position, t_s=None):
    n = len(position)
    return Reports(
        t_s=np.zeros(n) if t_s is None else np.asarray(t_s, float),
        arrival_s=np.full(n, np.nan),
        position=np.column_stack([position, np.full(n, np.nan)]),
        covariance=np.full((n, 3), np.nan),
        confidence=np.full(n, np.nan),
    )


def test_readings_pass_counted_and_in_order_of_arrival():
    network = lay_out(Channel(hop_m=1.0, p_loss=0.3, p_delay=0.5), LINE, BASE, dead=[3])
    n = 5000
    rng = np.random.default_rng(3)
    sent = readings(np.repeat(np.arange(n / 10), 10), np.tile(np.arange(10), n // 10), np.ones(n))
    there, passed = pass_readings(sent, network, rng)
    assert passed.dead == n / 10
    assert passed.unreached == 6 * n / 10  # behind the dead one
    assert passed.sent == passed.lost + len(there) == 9 * n / 10
    assert passed.delayed == np.count_nonzero(there.arrival_s > there.t_s)
    assert set(there.sensor.tolist()) == {0, 1, 2}
    assert (np.diff(there.arrival_s) >= 0.0).all()
    assert (there.arrival_s >= there.t_s).all()
    assert (there.value == 1.0).all()
    share = [np.mean(there.sensor == i) * len(there) / (n / 10) for i in range(3)]
    expected = delivery_probability(network.channel, [1, 2, 3])
    np.testing.assert_allclose(share, expected, atol=4 * 0.5 / math.sqrt(n / 10))
    assert passed.plus(passed) == tuple(2 * count for count in passed)


def test_garbled_detections_are_turned_and_other_values_off_by_a_factor():
    network = lay_out(Channel(p_garbled=0.25), LINE, BASE)
    rng = np.random.default_rng(0)
    sent = readings(np.zeros(4000), np.zeros(4000, int), np.ones(4000))
    there, passed = pass_readings(sent, network, rng)
    assert np.count_nonzero(there.value == 0.0) == passed.garbled
    assert abs(passed.garbled - 1000) < 120
    signals = readings(np.zeros(4000), np.zeros(4000, int), np.full(4000, 3.0), kind="signal")
    there, passed = pass_readings(signals, network, rng)
    off = there.value[there.value != 3.0]
    assert off.size == passed.garbled
    assert abs(np.log(off / 3.0).std() - 1.0) < 0.1


def test_reports_travel_from_the_node_nearest_to_them():
    network = lay_out(Channel(hop_m=1.0, p_loss=0.5, multipath=False), LINE, BASE, dead=[9])
    n = 4000
    far = np.full((n, 2), [9.6, 9.0])  # nearest to the dead node 9; node 8, nine hops, speaks
    near = np.full((n, 2), [0.1, 4.0])
    assert leaders_at(network, np.vstack([far[:1], near[:1]])).tolist() == [8, 0]
    sent = reports(np.vstack([far, near]))
    there, passed = pass_reports(sent, network, np.random.default_rng(0), region=REGION)
    assert abs(np.count_nonzero(there.position[:, 0] < 1.0) - n / 2) < 130
    assert abs(np.count_nonzero(there.position[:, 0] > 9.0) - n / 2**9) < 15
    assert passed.sent == 2 * n
    assert (there.arrival_s == 0.0).all()


def test_garbled_reports_are_anywhere_in_the_region():
    network = lay_out(Channel(p_garbled=0.5), LINE, BASE)
    sent = reports(np.full((4000, 2), 5.0))
    there, passed = pass_reports(sent, network, np.random.default_rng(0), region=REGION)
    wrong = there.position[there.position[:, 0] != 5.0]
    assert len(wrong) == passed.garbled
    assert REGION.contains(wrong).all()
    assert abs(wrong[:, 0].mean() - 5.0) < 0.3
    assert (sent.position[:, 0] == 5.0).all()  # what was sent is untouched


def test_rows_and_joins_keep_names_and_order():
    table = readings([0.0, 1.0, 2.0], [1, 2, 3], [1, 1, 1])
    both = join_rows([select_rows(table, slice(1)), select_rows(table, np.array([2, 1]))])
    assert both.t_s.tolist() == [0.0, 2.0, 1.0]
    assert both.sensor_ids == table.sensor_ids
    late = select_rows(both, slice(None))
    late.arrival_s[:] = [5.0, math.inf, 4.0]
    assert in_order(late).t_s.tolist() == [1.0, 0.0]


def test_detection_by_age_is_sensing_times_delivery_times_arrived_by_now():
    channel = Channel(hop_m=1.0, p_loss=0.3, p_delay=0.3, delay_step_s=2.0)
    network = lay_out(channel, LINE, BASE, dead=[7])
    found = detection_by_age(network, 6, step_s=1.0, p_sensing=0.9)
    assert found.shape == (6, 10)
    for age, i in itertools.product(range(6), range(10)):
        k = i + 1
        expected = 0.0
        if i < 7:
            p_cs = 1.0 - (1.0 - 0.7**k) ** k
            expected = 0.9 * p_cs * stats.nbinom(k, 0.7).cdf(age // 2)
        np.testing.assert_allclose(found[age, i], expected, rtol=1e-9)


def test_ages_end_where_nearly_all_that_arrives_is_there():
    network = lay_out(Channel(hop_m=1.0, p_delay=0.3), LINE, BASE)
    ages = ages_that_matter(network, step_s=1.0)
    there = stats.nbinom(10, 0.7).cdf(np.arange(ages))
    assert there[-1] >= 0.999 > there[-2]
    assert ages_that_matter(lay_out(Channel(p_loss=0.3), LINE, BASE), step_s=1.0) == 1
    slow = lay_out(Channel(p_delay=0.999), LINE, BASE)
    assert ages_that_matter(slow, step_s=1.0) == 64


def test_maps_have_the_value_of_the_node_that_speaks_for_a_place():
    network = lay_out(Channel(hop_m=1.0, p_loss=0.3, p_delay=0.3), LINE, BASE, dead=[4])
    west = Raster(REGION, np.array([[0.8, 0.4]]))
    maps = detection_maps(network, REGION, step_s=1.0, cell_m=1.0, p_sensing=west)
    assert len(maps) == ages_that_matter(network, step_s=1.0)
    places = np.random.default_rng(0).uniform(0, 10, (50, 2))
    centres = np.floor(places) + 0.5  # constant within a cell
    node = leaders_at(network, centres)
    assert 4 not in node
    sensing = np.where(centres[:, 0] < 5.0, 0.8, 0.4)
    for age, raster in enumerate(maps):
        expected = sensing * arrived_within(network.channel, network.routes.hops, age)[node]
        np.testing.assert_allclose(raster.at(places), expected)
    assert detection_maps(network, REGION, step_s=1.0)[0].values.shape == (6, 6)


def test_a_field_of_dead_nodes_speaks_for_nobody():
    network = lay_out(Channel(), LINE, BASE, dead=range(10))
    with pytest.raises(InputError, match="found no sensor that lives"):
        leaders_at(network, LINE)
