"""The meter: equal to a plain loop, whatever happens; exact however time is cut; fast."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meter_twin import Plain
from trackfield.errors import InputError
from trackfield.network import meter
from trackfield.network.energy import Energy, message_energy
from trackfield.network.meter_events import Messages, messages_along, messages_to_sinks
from trackfield.network.relays import path_of, relays
from trackfield.types import Commands, Mode, select_rows

ENERGY = Energy(tx_uj_per_bit=500.0, rx_uj_per_bit=300.0, hop_uj=2e4)
NAMES = tuple("abcdefg")
N = len(NAMES)


def orders_of(rows):
    t, node, mode = (list(column) for column in zip(*rows, strict=True)) if rows else ([], [], [])
    return Commands(np.array(t, float), np.array(node, np.int32), np.array(mode, np.int32), NAMES)


@st.composite
def scenes(draw):
    """Batteries that may last or not, orders and messages, some at the same times."""
    rng = np.random.default_rng(draw(st.integers(0, 10**6)))
    weak = draw(st.sampled_from([3.0, 30.0, 1e4]))
    battery = rng.uniform(0.2, 1.0, N) * weak
    ticks = np.sort(rng.choice([*np.linspace(0, 10, 5), *rng.uniform(0, 10, 12)], 14))
    orders = [(t, int(rng.integers(N)), int(rng.integers(4))) for t in ticks]
    messages = []
    for number, t in enumerate(rng.choice(ticks, draw(st.integers(0, 8)))):
        path = rng.permutation(N + 1)[: rng.integers(1, 5)].tolist()
        if N in path:  # the sink ends a path
            path = path[: path.index(N) + 1]
        path = path if path != [N] else [0, N]
        messages.append((t, number, float(rng.integers(0, 3000)), path))
    return battery, orders, messages


def told(messages):
    return messages_along(
        [m[0] for m in messages], [m[2] for m in messages], [m[3] for m in messages]
    )


@given(scene=scenes())
@settings(max_examples=150)
def test_the_meter_counts_as_a_plain_loop_does(scene):
    battery, orders, messages = scene
    twin = Plain(ENERGY, battery)
    twin.run(10.0, orders, sorted(messages, key=lambda m: m[0]))
    start = meter.init(ENERGY, NAMES, battery_j=battery)
    found, spent = meter.step(start, 10.0, commands=orders_of(orders), messages=told(messages))
    np.testing.assert_allclose(found.spent_j, twin.spent, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.exhausted_s, twin.died, rtol=1e-9, atol=1e-9)
    assert np.flatnonzero(spent.undelivered).tolist() == sorted(twin.lost)
    np.testing.assert_allclose(spent.joules, found.spent_j.sum(axis=1))
    dead = sorted((t, i) for i, t in enumerate(found.exhausted_s) if math.isfinite(t))
    assert [i for _, i in dead] == spent.exhausted.tolist()


@given(scene=scenes(), cuts=st.lists(st.floats(0.0, 10.0), max_size=4))
def test_time_may_be_cut_anywhere(scene, cuts):
    battery, orders, messages = scene
    commands, sent = orders_of(orders), told(messages)
    now = whole = meter.init(ENERGY, NAMES, battery_j=battery)
    whole, at_once = meter.step(whole, 10.0, commands=commands, messages=sent)
    lost, joules, past = np.zeros(len(messages), bool), np.zeros(N), -1.0
    for until in [*sorted(cuts), 10.0]:
        # What happens at a cut belongs to the part that it ends.
        rows, which = ((t > past) & (t <= until) for t in (commands.t_s, sent.t_s))
        part = sent.rows(which)
        now, spent = meter.step(now, until, commands=select_rows(commands, rows), messages=part)
        lost[which] |= spent.undelivered
        joules, past = joules + spent.joules, until
    np.testing.assert_allclose(now.spent_j, whole.spent_j, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(now.exhausted_s, whole.exhausted_s, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(now.mode[whole.alive], whole.mode[whole.alive])
    np.testing.assert_array_equal(lost, at_once.undelivered)
    np.testing.assert_allclose(joules, at_once.joules, atol=1e-9)
    np.testing.assert_allclose(now.sent_bits, whole.sent_bits)


@given(scene=scenes())
def test_nothing_is_spent_twice_and_nobody_spends_more_than_there_is(scene):
    battery, orders, messages = scene
    start = meter.init(ENERGY, NAMES, battery_j=battery)
    found, _ = meter.step(start, 10.0, commands=orders_of(orders), messages=told(messages))
    np.testing.assert_allclose(found.residual_j + found.spent_j.sum(axis=1), battery, rtol=1e-12)
    assert (found.residual_j >= 0.0).all()
    assert (found.residual_j[found.alive] > 0.0).all()
    assert sum(found.totals_j.values()) == pytest.approx(found.spent_j.sum())


def test_a_relay_pays_for_what_it_passes_on_and_a_bit_costs_the_same_at_every_hop():
    line = np.column_stack([np.arange(1.0, 5.0), np.zeros(4)])
    way = relays(line, np.zeros((1, 2)), hop_m=1.0)
    sent = messages_to_sinks([1.0, 2.0], 100.0, senders=np.array([3, 0], np.int32), way=way)
    assert [[n for n in row if n >= 0] for row in sent.path.tolist()] == [
        path_of(way, 3),
        path_of(way, 0),
    ]
    energy = Energy()
    found, _ = meter.step(meter.init(energy, "abcd"), 3.0, messages=sent)
    np.testing.assert_allclose(found.sent_bits, [200, 100, 100, 100])
    np.testing.assert_allclose(found.received_bits, [100, 100, 100, 0])
    expected = [200 * 5.6e-6 + 100 * 4e-6, *[960e-6] * 2, 560e-6]
    np.testing.assert_allclose(found.spent_j[:, 4:].sum(axis=1), expected)
    to_sink = float(message_energy(energy, 100, 4)) - 400e-6  # the sink's own part counts nowhere
    assert sum(expected) == pytest.approx(to_sink + 560e-6)
    assert found.per_bit_and_hop_j == pytest.approx(sum(expected) / 500)
    assert meter.init(energy, "abcd").per_bit_and_hop_j == 0.0


def test_who_reaches_no_sink_is_told_undelivered_and_pays_nothing():
    way = relays(np.array([[0.5, 0.0], [9.0, 0.0]]), np.zeros((1, 2)), hop_m=1.0)
    sent = messages_to_sinks(1.0, 10.0, senders=np.array([0, 1], np.int32), way=way)
    found, spent = meter.step(meter.init(Energy(), "ab"), 1.0, messages=sent)
    assert spent.undelivered.tolist() == [False, True]
    assert found.sent_bits.tolist() == [10.0, 0.0]


def test_the_end_of_a_battery_is_told_with_its_time():
    energy = Energy(sleep_mw=100.0)
    found, spent = meter.step(
        meter.init(energy, "ab", battery_j=np.array([5.0, 2.0]), t_s=1.0), 30.0
    )
    np.testing.assert_allclose(found.exhausted_s, [math.inf, 21.0])
    assert spent.exhausted.tolist() == [1]
    np.testing.assert_allclose(spent.joules, [2.9, 2.0])
    np.testing.assert_allclose(found.residual_j, [2.1, 0.0])


@given(scene=scenes())
@settings(max_examples=40)
def test_how_long_nodes_last_is_how_long_the_first_of_them_does(scene):
    battery, orders, _ = scene
    now, _ = meter.step(
        meter.init(ENERGY, NAMES, battery_j=1e3 + battery), 10.0, commands=orders_of(orders)
    )
    first = now.lasts_s.min()
    before, _ = meter.step(now, 10.0 + 0.999 * first)
    after, spent = meter.step(now, 10.0 + 1.001 * first)
    assert before.alive.all()
    assert spent.exhausted[0] == np.argmin(now.lasts_s)
    assert after.exhausted_s.min() == pytest.approx(10.0 + first)
    assert (after.lasts_s[spent.exhausted] == 0.0).all()


def test_who_spends_nothing_lasts_for_ever():
    assert np.isinf(meter.init(Energy(sleep_mw=0.0), "ab").lasts_s).all()


def test_commands_are_told_by_name():
    commands = Commands(
        np.array([0.0]), np.array([1], np.int32), np.array([1], np.int32), ("x", "b")
    )
    found, _ = meter.step(meter.init(Energy(), "ab"), 1.0, commands=commands)
    assert found.mode.tolist() == [Mode.SLEEPING, Mode.ACTIVE]
    with pytest.raises(InputError, match="commands: found 'x', expected a node of the meter"):
        meter.step(
            found,
            2.0,
            commands=Commands(np.array([1.0]), np.array([0], np.int32), commands.mode, ("x", "b")),
        )


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda m: meter.step(m, 1.0), "until_s: found 1.0, expected a time from 2.0 s on"),
        (lambda m: meter.step(m, math.inf), "until_s: found inf"),
        (lambda m: meter.step(m, 3.0, commands=orders_of([(1.0, 0, 1)])), "commands: found times"),
        (
            lambda m: meter.step(m, 3.0, messages=messages_along(4.0, 1, [[0, 7]])),
            "messages: found",
        ),
        (lambda m: meter.step(m, 3.0, messages=messages_along(2.0, 1, [[0, 7, 1]])), "the path"),
        (lambda m: meter.step(m, 3.0, messages=messages_along(2.0, 1, [[7, 1]])), "the path"),
        (lambda m: messages_along(math.nan, 1, [[0]]), "found times or bits"),
        (lambda m: meter.init(ENERGY, "ab", battery_j=0.0), "found a battery of 0.0 J"),
    ],
)
def test_what_cannot_be_is_refused(call, said):
    with pytest.raises(InputError, match=said):
        call(meter.init(ENERGY, NAMES, t_s=2.0))


def busy(n, steps, rng):
    """Orders and messages of a field in which one in a hundred nodes works."""
    t = np.repeat(np.arange(steps, dtype=float), n // 100)
    node = rng.integers(0, n, t.size).astype(np.int32)
    names = tuple(f"n{i}" for i in range(n))
    commands = Commands(t, node, rng.integers(0, 4, t.size).astype(np.int32), names)
    path = np.column_stack([node, (node + 1) % n, np.full(t.size, n)]).astype(np.int32)
    return commands, Messages(t, np.full(t.size, 128.0), path)


def test_a_run_at_once_and_in_steps_is_the_same_for_thousands_of_nodes():
    commands, sent = busy(2000, 50, np.random.default_rng(0))
    now = meter.init(Energy(), commands.sensor_ids)
    for k in range(50):
        rows = slice(20 * k, 20 * (k + 1))
        now, _ = meter.step(
            now, k + 0.5, commands=select_rows(commands, rows), messages=sent.rows(rows)
        )
    start = meter.init(Energy(), commands.sensor_ids)
    whole, _ = meter.step(start, 49.5, commands=commands, messages=sent)
    np.testing.assert_allclose(now.spent_j, whole.spent_j, rtol=1e-9, atol=1e-12)
    assert (whole.spent_j.sum(axis=0) > 0.0).all()


@pytest.mark.speed
def test_ten_thousand_nodes_take_twice_the_time_of_a_plain_loop_over_their_powers():
    """About 1 ms: the loop only adds up powers, and knows nothing of orders, relays, batteries."""
    n, steps = 10_000, 30
    commands, sent = busy(n, steps, np.random.default_rng(0))
    now = meter.init(Energy(), commands.sensor_ids)
    ours, plain = [], []
    power, spent = [0.13, 1.83, 3.33, 5.33], [0.0] * n
    for k in range(steps):
        rows = slice(100 * k, 100 * (k + 1))
        told, part = select_rows(commands, rows), sent.rows(rows)
        begun = time.process_time()
        now, _ = meter.step(now, k + 0.5, commands=told, messages=part)
        done = time.process_time()
        ours.append(done - begun)
        for i, mode in enumerate(now.mode.tolist()):
            spent[i] += power[mode] * 0.5
        plain.append(time.process_time() - done)
    assert min(ours) < 1.5 * 2.0 * min(plain), (min(ours), min(plain))
